//! Materials: metallic-roughness and its extensions as one principled surface each.

use super::Gltf;
use super::properties as known;
use super::textures::Info;
use super::tree::At;
use crate::context::Issue;
use crate::model::{
    BsdfDesc, Channel, ColorTex, Emission, Encoding, FloatOrColor, FloatTex, Material, MaterialId,
    Medium, MediumId, MediumInterface, Principled, Texture, TextureId,
};

/// Most sets of texture coordinates that one material may use: as many as a point carries.
const MAX_SETS: usize = 2;

/// What a primitive takes from its material.
#[derive(Clone, Debug)]
pub(super) struct Surface {
    pub material: MaterialId,
    pub emission: Option<Emission>,
    pub alpha: Option<FloatTex>,
    pub media: Option<MediumInterface>,
    /// The TEXCOORDs that the mesh must keep, in this order; the normal map's comes first.
    pub sets: Vec<u32>,
    /// Where the mesh's tangents come from, if it needs any.
    pub tangents: Option<TangentsOf>,
    /// For messages.
    pub name: String,
}

/// The coordinates that tangents follow where a file has none of its own: those of the normal map,
/// KHR_texture_transform included, so that a map that is turned is lit from the same side.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct TangentsOf {
    /// Which of the sets that the mesh keeps.
    pub set: u32,
    /// As in [`crate::model::UvMap::Uv`].
    pub matrix: [f64; 6],
}

/// A material while it is read.
pub(super) struct Draft<'j> {
    pub at: At<'j>,
    pub sets: Vec<u32>,
    /// Whether the mesh's vertex colours multiply the base colour.
    pub colors: bool,
    pub p: Principled,
    /// Those of the first map that asks for them.
    pub tangents: Option<TangentsOf>,
}

/// Factor and texture of a colour.
pub(super) fn times(rgb: [f32; 3]) -> [f32; 4] {
    [rgb[0], rgb[1], rgb[2], 1.0]
}

impl<'j> Gltf<'_, '_, 'j> {
    /// The surface of a material of the file, or the default one; made once for meshes with vertex
    /// colours and once for those without.
    pub(super) fn surface(&mut self, index: Option<usize>, colors: bool) -> Result<Surface, Issue> {
        if let Some(surface) = self.surfaces.get(&(index, colors)) {
            return Ok(surface.clone());
        }
        let surface = match index {
            Some(index) => {
                let at = self.list_item("materials", index)?;
                let mut name = match at.name()? {
                    Some(name) => name.to_owned(),
                    None => format!("material {index}"),
                };
                if self.surfaces.contains_key(&(Some(index), !colors)) {
                    name += if colors {
                        " with vertex colours"
                    } else {
                        " without vertex colours"
                    };
                }
                self.material(at, name, colors)?
            }
            None => self.default_material(colors)?,
        };
        self.surfaces.insert((index, colors), surface.clone());
        Ok(surface)
    }

    /// What a primitive without a material has: white, metal, rough, as the specification says.
    fn default_material(&mut self, colors: bool) -> Result<Surface, Issue> {
        let mut p = Principled {
            metallic: FloatTex::Const(1.0),
            roughness: FloatTex::Const(1.0),
            ..Principled::default()
        };
        if colors {
            p.base_color = ColorTex::Texture(self.node(Texture::VertexColor)?);
        }
        let name = self.unique("default material".to_owned(), None);
        Ok(Surface {
            material: self.add_material(name.clone(), BsdfDesc::Principled(Box::new(p)), None)?,
            emission: None,
            alpha: None,
            media: None,
            sets: Vec::new(),
            tangents: None,
            name,
        })
    }

    fn add_material(
        &mut self,
        name: String,
        bsdf: BsdfDesc,
        normal_map: Option<(TextureId, f32)>,
    ) -> Result<MaterialId, Issue> {
        self.cx.charge(&self.root.place(), 1024)?;
        let id = MaterialId(self.materials.len() as u32);
        self.materials.push(Material {
            name,
            bsdf,
            normal_map,
            bump_map: None,
        });
        Ok(id)
    }

    /// A name that no other material has; a second one of the same name gets a number, and a warning
    /// if the file gave the name.
    fn unique(&mut self, name: String, at: Option<&At<'j>>) -> String {
        let mut own = name.clone();
        let mut n = 1;
        while !self.material_names.insert(own.clone()) {
            n += 1;
            own = format!("{name} ({n})");
        }
        if own != name
            && let Some(at) = at
        {
            self.cx.warn(
                &at.place(),
                format!("another material is called {name:?} too; this one is {own:?} here"),
            );
        }
        own
    }

    /// Which of the kept sets a texture uses.
    fn set(&mut self, draft: &mut Draft<'j>, info: &Info<'j>) -> u32 {
        let position = draft.sets.iter().position(|s| *s == info.set);
        position.unwrap_or_else(|| {
            if draft.sets.len() < MAX_SETS {
                draft.sets.push(info.set);
                return draft.sets.len() - 1;
            }
            let sets = &draft.sets;
            self.cx.warn(
                &info.at.place(),
                format!(
                    "TEXCOORD_{} is a third set of texture coordinates of one material; TEXCOORD_{} is used",
                    info.set, sets[0]
                ),
            );
            0
        }) as u32
    }

    /// A texture of data: its node, not decoded, multiplied by `scale`.
    pub(super) fn data(
        &mut self,
        draft: &mut Draft<'j>,
        owner: &At<'j>,
        name: &str,
        scale: [f32; 4],
    ) -> Result<Option<TextureId>, Issue> {
        let Some(info) = self.texture_info(owner, name, &[])? else {
            return Ok(None);
        };
        let set = self.set(draft, &info);
        self.image_node(&info, set, Encoding::Linear, scale)
    }

    /// A texture of colours times a factor; the factor where there is none.
    pub(super) fn color(
        &mut self,
        draft: &mut Draft<'j>,
        owner: &At<'j>,
        name: &str,
        factor: [f32; 3],
    ) -> Result<ColorTex, Issue> {
        let Some(info) = self.texture_info(owner, name, &[])? else {
            return Ok(ColorTex::Const(factor));
        };
        let set = self.set(draft, &info);
        let node = self.image_node(&info, set, Encoding::Srgb, times(factor))?;
        Ok(node.map_or(ColorTex::Const(factor), ColorTex::Texture))
    }

    /// A number in [0, 1] times one channel of a texture.
    pub(super) fn weight(
        &mut self,
        draft: &mut Draft<'j>,
        owner: &At<'j>,
        (factor, default): (&str, f64),
        (texture, channel): (&str, Channel),
    ) -> Result<FloatTex, Issue> {
        let x = owner.ranged(factor, default, (0.0, 1.0), self.cx)? as f32;
        let node = self.data(draft, owner, texture, [x; 4])?;
        Ok(node.map_or(FloatTex::Const(x), |id| FloatTex::Texture(id, channel)))
    }

    /// A normal map with its strength.
    pub(super) fn normal_map(
        &mut self,
        draft: &mut Draft<'j>,
        owner: &At<'j>,
        name: &str,
    ) -> Result<Option<(TextureId, f32)>, Issue> {
        let Some(info) = self.texture_info(owner, name, &["scale"])? else {
            return Ok(None);
        };
        let strength = info.at.number_or("scale", 1.0)? as f32;
        let set = self.set(draft, &info);
        draft.tangents.get_or_insert(TangentsOf {
            set,
            matrix: info.matrix,
        });
        let node = self.image_node(&info, set, Encoding::Linear, [1.0; 4])?;
        Ok(node.map(|id| (id, strength)))
    }

    fn material(&mut self, at: At<'j>, name: String, colors: bool) -> Result<Surface, Issue> {
        at.only(known::MATERIAL, self.cx)?;
        self.known_extensions(&at, super::extensions::OF_MATERIALS)?;
        let mut draft = Draft {
            at: at.clone(),
            sets: Vec::new(),
            colors,
            p: Principled::default(),
            tangents: None,
        };
        // First, so that its set of coordinates is the mesh's first.
        let normal_map = self.normal_map(&mut draft, &at, "normalTexture")?;
        let gloss = at.extension("KHR_materials_pbrSpecularGlossiness");
        let base = match &gloss {
            Some(gloss) => self.specular_glossiness(&mut draft, gloss)?,
            None => self.metallic_roughness(&mut draft)?,
        };
        draft.p.base_color = match base {
            Base::Const(rgba) => ColorTex::Const([rgba[0], rgba[1], rgba[2]]),
            Base::Node(id) => ColorTex::Texture(id),
        };
        let alpha = self.alpha(&at, &base)?;
        let strength = self.emissive_strength(&at)?;
        let factor = at.color("emissiveFactor", [0.0; 3], 1.0, self.cx)?;
        let radiance = self.color(&mut draft, &at, "emissiveTexture", factor)?;
        let mut emission = (factor != [0.0; 3] && strength > 0.0).then_some(Emission {
            radiance,
            scale: strength,
            two_sided: true,
        });
        at.flag_or("doubleSided", false)?;
        let own = self.unique(name, Some(&at));
        let mut media = None;
        let bsdf = if at.extension("KHR_materials_unlit").is_some() {
            emission = Some(Emission {
                radiance: draft.p.base_color,
                scale: 1.0,
                two_sided: true,
            });
            BsdfDesc::Diffuse {
                reflectance: ColorTex::Const([0.0; 3]),
            }
        } else {
            let absorption = self.material_extensions(&mut draft)?;
            if let Some(sigma_a) = absorption {
                let medium = MediumId(self.media.len() as u32);
                self.media.push(Medium {
                    name: own.clone(),
                    sigma_a,
                    sigma_s: [0.0; 3],
                    emission: [0.0; 3],
                    g: 0.0,
                    grid: None,
                    translucent: None,
                });
                media = Some(MediumInterface {
                    inside: Some(medium),
                    outside: None,
                });
            }
            BsdfDesc::Principled(Box::new(draft.p.clone()))
        };
        let normal_map = normal_map.filter(|_| matches!(bsdf, BsdfDesc::Principled(_)));
        Ok(Surface {
            material: self.add_material(own.clone(), bsdf, normal_map)?,
            emission,
            alpha,
            media,
            tangents: draft.tangents,
            sets: draft.sets,
            name: own,
        })
    }

    fn metallic_roughness(&mut self, draft: &mut Draft<'j>) -> Result<Base, Issue> {
        let Some(pbr) = draft.at.get("pbrMetallicRoughness") else {
            draft.p.metallic = FloatTex::Const(1.0);
            draft.p.roughness = FloatTex::Const(1.0);
            return self.base(draft, [1.0; 4], None);
        };
        pbr.only(known::METALLIC_ROUGHNESS, self.cx)?;
        let metal = pbr.ranged("metallicFactor", 1.0, (0.0, 1.0), self.cx)? as f32;
        let rough = pbr.ranged("roughnessFactor", 1.0, (0.0, 1.0), self.cx)? as f32;
        let scale = [1.0, rough, metal, 1.0];
        (draft.p.metallic, draft.p.roughness) =
            match self.data(draft, &pbr, "metallicRoughnessTexture", scale)? {
                Some(id) => (
                    FloatTex::Texture(id, Channel::B),
                    FloatTex::Texture(id, Channel::G),
                ),
                None => (FloatTex::Const(metal), FloatTex::Const(rough)),
            };
        let factor = self.rgba(&pbr, "baseColorFactor")?;
        self.base(draft, factor, Some((&pbr, "baseColorTexture")))
    }

    pub(super) fn rgba(&mut self, at: &At<'j>, name: &str) -> Result<[f32; 4], Issue> {
        let Some(rgba) = at.numbers::<4>(name)? else {
            return Ok([1.0; 4]);
        };
        let moved = rgba.map(|c| c.clamp(0.0, 1.0));
        if moved != rgba
            && let Some(at) = at.get(name)
        {
            self.cx.warn(
                &at.place(),
                format!("{rgba:?} is out of range; {moved:?} is used"),
            );
        }
        Ok(moved.map(|c| c as f32))
    }

    /// Base colour and alpha: factor, times texture, times vertex colour.
    pub(super) fn base(
        &mut self,
        draft: &mut Draft<'j>,
        factor: [f32; 4],
        texture: Option<(&At<'j>, &str)>,
    ) -> Result<Base, Issue> {
        let info = match texture {
            Some((owner, name)) => self.texture_info(owner, name, &[])?,
            None => None,
        };
        let node = match &info {
            Some(info) => {
                let set = self.set(draft, info);
                self.image_node(info, set, Encoding::Srgb, factor)?
            }
            None => None,
        };
        if !draft.colors {
            return Ok(node.map_or(Base::Const(factor), Base::Node));
        }
        let vertex = self.node(Texture::VertexColor)?;
        let node = match node {
            Some(node) => node,
            None if factor == [1.0; 4] => return Ok(Base::Node(vertex)),
            None => self.node(Texture::Constant { value: factor })?,
        };
        let product = Texture::Scale {
            a: ColorTex::Texture(node),
            b: FloatOrColor::Color(ColorTex::Texture(vertex)),
        };
        self.node(product).map(Base::Node)
    }

    /// Coverage by the alpha mode.
    fn alpha(&mut self, at: &At<'j>, base: &Base) -> Result<Option<FloatTex>, Issue> {
        let mode = match at.get("alphaMode") {
            None => "OPAQUE",
            Some(mode) => mode.text()?,
        };
        let cutoff = at.number_or("alphaCutoff", 0.5)?;
        if cutoff < 0.0 {
            return Err(at.fail(format!("an \"alphaCutoff\" of {cutoff}")));
        }
        let coverage = match base {
            Base::Const(rgba) => FloatTex::Const(rgba[3]),
            Base::Node(id) => FloatTex::Texture(*id, Channel::A),
        };
        Ok(match (mode, coverage) {
            ("OPAQUE", _) => None,
            ("BLEND", FloatTex::Const(a)) if a >= 1.0 => None,
            ("BLEND", coverage) => Some(coverage),
            ("MASK", FloatTex::Const(a)) if f64::from(a) >= cutoff => None,
            ("MASK", FloatTex::Const(_)) => Some(FloatTex::Const(0.0)),
            ("MASK", value) => {
                let node = self.node(Texture::Threshold {
                    value,
                    at: cutoff as f32,
                })?;
                Some(FloatTex::Texture(node, Channel::R))
            }
            (other, _) => {
                let at = at.get("alphaMode").unwrap_or_else(|| at.clone());
                return Err(at.fail(format!(
                    "unknown alpha mode {other:?}; there are OPAQUE, MASK and BLEND"
                )));
            }
        })
    }
}

/// Base colour with alpha.
pub(super) enum Base {
    Const([f32; 4]),
    Node(TextureId),
}
