//! Materials, built at the end of the file, when all textures are known.

use super::params::{Kind, Params};
use super::spectra::{COPPER, Role};
use super::{Importer, MaterialEntry, Materials, legacy, nearest};
use crate::context::Issue;
use crate::model::{
    BsdfDesc, Coat, ColorTex, ConductorFresnel, FloatTex, HairColor, Material, MaterialId,
    MediumId, Roughness, RoughnessScale,
};
use crate::spectrum;
use std::collections::BTreeSet;

pub(super) const MATERIALS: [&str; 12] = [
    "coatedconductor",
    "coateddiffuse",
    "conductor",
    "dielectric",
    "diffuse",
    "diffusetransmission",
    "hair",
    "interface",
    "measured",
    "mix",
    "subsurface",
    "thindielectric",
];

impl Importer<'_, '_> {
    /// All materials in an order in which each refers only to earlier ones, and where each entry went.
    pub(super) fn build_materials(&mut self) -> Materials {
        let entries = std::mem::take(&mut self.materials);
        let mut built = Vec::with_capacity(entries.len());
        let mut ids = Vec::with_capacity(entries.len());
        let mut names = BTreeSet::new();
        self.interiors = vec![None; entries.len()];
        for (index, entry) in entries.iter().enumerate() {
            let result = self.material(entry, index, &ids);
            let material = match self.cx.keep(result) {
                Some(material) => {
                    self.warn_unused(&entry.params, &format!("material {:?}", entry.kind));
                    material
                }
                // An error was noted: what stands here is never rendered.
                None => Material {
                    name: String::new(),
                    bsdf: grey(),
                    normal_map: None,
                    bump_map: None,
                },
            };
            let mut name = entry.name.clone();
            while !names.insert(name.clone()) {
                name.push('\'');
            }
            ids.push(MaterialId(built.len() as u32));
            built.push(Material { name, ..material });
        }
        self.materials = entries;
        (built, ids)
    }

    fn material(
        &mut self,
        entry: &MaterialEntry,
        index: usize,
        ids: &[MaterialId],
    ) -> Result<Material, Issue> {
        let params = &entry.params;
        params.ignore(&["type"]);
        let bsdf = self.bsdf(entry, index, ids)?;
        let bump_map = self
            .float_tex(params, "displacement")?
            .filter(|t| matches!(t, FloatTex::Texture(..)));
        let normal_map = match params.find("normalmap", &[Kind::String])? {
            Some(param) => Some((self.normal_map(param)?, 1.0)),
            None => None,
        };
        Ok(Material {
            name: String::new(),
            bsdf,
            normal_map,
            bump_map,
        })
    }

    fn albedo(&mut self, params: &Params, name: &str, default: f32) -> Result<ColorTex, Issue> {
        Ok(self
            .color_tex(params, name, Role::Albedo)?
            .unwrap_or(ColorTex::Const([default; 3])))
    }

    fn roughness(&mut self, params: &Params, prefix: &str) -> Result<Roughness, Issue> {
        let named = |suffix: &str| format!("{prefix}{suffix}");
        let both = self
            .float_tex(params, &named("roughness"))?
            .unwrap_or(FloatTex::Const(0.0));
        let u = self
            .float_tex(params, &named("uroughness"))?
            .unwrap_or(both);
        let v = self
            .float_tex(params, &named("vroughness"))?
            .unwrap_or(both);
        for value in [u, v] {
            if let FloatTex::Const(value) = value
                && value < 0.0
            {
                return params.fail(format!("a roughness of {value}"));
            }
        }
        let scale = if params.bool("remaproughness", true)? {
            RoughnessScale::Sqrt
        } else {
            RoughnessScale::Alpha
        };
        Ok(Roughness { u, v, scale })
    }

    fn fresnel(&mut self, params: &Params, prefix: &str) -> Result<ConductorFresnel, Issue> {
        let eta = self.color_tex(params, &format!("{prefix}eta"), Role::Unbounded)?;
        let k = self.color_tex(params, &format!("{prefix}k"), Role::Unbounded)?;
        match self.color_tex(params, "reflectance", Role::Albedo)? {
            Some(_) if eta.is_some() || k.is_some() => {
                params.fail("a metal has either \"reflectance\" or \"eta\" and \"k\", not both")
            }
            Some(reflectance) => Ok(ConductorFresnel::Reflectance(reflectance)),
            None => Ok(ConductorFresnel::EtaK {
                eta: eta.unwrap_or(ColorTex::Const(COPPER.0)),
                k: k.unwrap_or(ColorTex::Const(COPPER.1)),
            }),
        }
    }

    /// A number where pbrt allows a texture and the model does not.
    fn constant(&mut self, params: &Params, name: &str, default: f32) -> Result<f32, Issue> {
        match self.float_tex(params, name)? {
            None => Ok(default),
            Some(FloatTex::Const(value)) => Ok(value),
            Some(FloatTex::Texture(..)) => {
                self.cx.warn(
                    &params.place,
                    format!("{name:?} as a texture is not supported: {default} is used"),
                );
                Ok(default)
            }
        }
    }

    fn coat(&mut self, params: &Params, prefix: &str) -> Result<Coat, Issue> {
        let roughness = self.roughness(params, prefix)?;
        let thickness = self.constant(params, "thickness", 0.01)?;
        let g = self.constant(params, "g", 0.0)?;
        if thickness < 0.0 || !(-1.0..=1.0).contains(&g) {
            return params.fail(format!(
                "a coat with thickness {thickness} and asymmetry {g}"
            ));
        }
        let albedo = match self.color_tex(params, "albedo", Role::Albedo)? {
            None => [0.0; 3],
            Some(ColorTex::Const(albedo)) => albedo,
            Some(ColorTex::Texture(_)) => {
                self.cx.warn(
                    &params.place,
                    "\"albedo\" of a coat as a texture is not supported: the coat is clear",
                );
                [0.0; 3]
            }
        };
        Ok(Coat {
            ior: self.ior(params, &format!("{prefix}eta"))?,
            roughness,
            thickness,
            albedo,
            g,
            max_depth: params.count("maxdepth", 10, 1..=1000)?,
            samples: params.count("nsamples", 1, 1..=1000)?,
        })
    }

    fn bsdf(
        &mut self,
        entry: &MaterialEntry,
        index: usize,
        ids: &[MaterialId],
    ) -> Result<BsdfDesc, Issue> {
        let params = &entry.params;
        let white = ColorTex::Const([1.0; 3]);
        Ok(match entry.kind.as_str() {
            "diffuse" => BsdfDesc::Diffuse {
                reflectance: self.albedo(params, "reflectance", 0.5)?,
            },
            "dielectric" => BsdfDesc::Dielectric {
                ior: self.ior(params, "eta")?,
                roughness: self.roughness(params, "")?,
                reflect_tint: white,
                transmit_tint: white,
            },
            "thindielectric" => BsdfDesc::ThinDielectric {
                ior: self.ior(params, "eta")?,
            },
            "conductor" => BsdfDesc::Conductor {
                fresnel: self.fresnel(params, "")?,
                roughness: self.roughness(params, "")?,
            },
            "coateddiffuse" => {
                let coat = self.coat(params, "")?;
                let reflectance = match self.albedo(params, "reflectance", 0.5)? {
                    ColorTex::Const(c) => ColorTex::Const(spectrum::under_coat(c, coat.ior)),
                    texture => texture,
                };
                BsdfDesc::CoatedDiffuse { reflectance, coat }
            }
            "coatedconductor" => BsdfDesc::CoatedConductor {
                fresnel: self.fresnel(params, "conductor.")?,
                roughness: self.roughness(params, "conductor.")?,
                coat: self.coat(params, "interface.")?,
            },
            "diffusetransmission" => {
                let reflectance = self.albedo(params, "reflectance", 0.25)?;
                let transmittance = self.albedo(params, "transmittance", 0.25)?;
                let scale = params.float("scale", 1.0)? as f32;
                let mut scaled = |color: ColorTex| match color {
                    color if scale == 1.0 => color,
                    ColorTex::Const(c) => ColorTex::Const(c.map(|c| c * scale)),
                    texture => {
                        let b = crate::model::FloatOrColor::Float(FloatTex::Const(scale));
                        self.textures
                            .push(crate::model::Texture::Scale { a: texture, b });
                        ColorTex::Texture(crate::model::TextureId(self.textures.len() as u32 - 1))
                    }
                };
                BsdfDesc::DiffuseTransmission {
                    reflectance: scaled(reflectance),
                    transmittance: scaled(transmittance),
                }
            }
            "mix" => {
                let names = params.find("materials", &[Kind::String])?;
                let Some([a, b]) = names.map(|p| p.texts()) else {
                    return params.fail("a mix needs \"string materials\" with two names");
                };
                let a = self.mixed(params, a, index, ids)?;
                let b = self.mixed(params, b, index, ids)?;
                let amount = self
                    .float_tex(params, "amount")?
                    .unwrap_or(FloatTex::Const(0.5));
                self.interiors[index] = self.mixed_interior(params)?;
                BsdfDesc::Mix { a, b, amount }
            }
            "interface" | "" | "none" => BsdfDesc::Interface,
            "subsurface" => {
                let ior = params.positive("eta", 1.33)? as f32;
                if !(0.01..=100.0).contains(&ior) {
                    return params.fail(format!("an index of refraction of {ior}"));
                }
                let (interior, tint) = self.interior(params, ior)?;
                self.interiors[index] = Some(interior);
                let transmit_tint = match tint {
                    None => white,
                    Some((texture, factor)) => {
                        let b = crate::model::FloatOrColor::Float(FloatTex::Const(factor));
                        self.textures
                            .push(crate::model::Texture::Scale { a: texture, b });
                        ColorTex::Texture(crate::model::TextureId(self.textures.len() as u32 - 1))
                    }
                };
                BsdfDesc::Dielectric {
                    ior,
                    roughness: self.roughness(params, "")?,
                    reflect_tint: white,
                    transmit_tint,
                }
            }
            "hair" => self.hair(params)?,
            "measured" => {
                let Some(name) = params.text_opt("filename")? else {
                    return params.fail("a measured material needs a \"filename\"");
                };
                self.cx.warn(
                    &params.place,
                    format!("material \"measured\" ({name}) is not read: a grey diffuse surface stands in"),
                );
                grey()
            }
            other => {
                let hint = legacy::hint("material", other, &MATERIALS);
                return params.fail(format!("unknown material type {other:?}{hint}"));
            }
        })
    }

    /// What a mix is filled with: light that passes either part is inside the same.
    fn mixed_interior(&mut self, params: &Params) -> Result<Option<MediumId>, Issue> {
        let names = params.find("materials", &[Kind::String])?;
        let filled: Vec<MediumId> = names
            .map_or(&[][..], |p| p.texts())
            .iter()
            .filter_map(|name| self.interiors[*self.material_names.get(name)?])
            .collect();
        if filled.len() > 1 && filled[0] != filled[1] {
            return params.fail("a mix of two subsurface materials with different insides");
        }
        Ok(filled.first().copied())
    }

    fn hair(&mut self, params: &Params) -> Result<BsdfDesc, Issue> {
        let absorption = self.color_tex(params, "sigma_a", Role::Unbounded)?;
        let reflectance = self.color_tex(params, "reflectance", Role::Albedo)?;
        let reflectance = match reflectance {
            Some(reflectance) => Some(reflectance),
            None => self.color_tex(params, "color", Role::Albedo)?,
        };
        let eumelanin = self.float_tex(params, "eumelanin")?;
        let pheomelanin = self.float_tex(params, "pheomelanin")?;
        let ways = [
            absorption.is_some(),
            reflectance.is_some(),
            eumelanin.or(pheomelanin).is_some(),
        ];
        if ways.iter().filter(|given| **given).count() > 1 {
            self.cx.warn(
                &params.place,
                "hair coloured in several ways: sigma_a counts before reflectance, that before melanin, as in pbrt",
            );
        }
        let none = FloatTex::Const(0.0);
        let color = match (absorption, reflectance) {
            (Some(absorption), _) => HairColor::Absorption(absorption),
            (None, Some(reflectance)) => HairColor::Reflectance(reflectance),
            (None, None) if ways[2] => HairColor::Melanin {
                eumelanin: eumelanin.unwrap_or(none),
                pheomelanin: pheomelanin.unwrap_or(none),
            },
            // Brown where nothing is said.
            (None, None) => HairColor::Melanin {
                eumelanin: FloatTex::Const(1.3),
                pheomelanin: none,
            },
        };
        let ior = self.constant(params, "eta", 1.55)?;
        if !(1.0..=10.0).contains(&ior) {
            return params.fail(format!("hair with an index of refraction of {ior}"));
        }
        let width = |value: Option<FloatTex>| value.unwrap_or(FloatTex::Const(0.3));
        let (beta_m, beta_n) = (
            width(self.float_tex(params, "beta_m")?),
            width(self.float_tex(params, "beta_n")?),
        );
        for beta in [beta_m, beta_n] {
            if let FloatTex::Const(beta) = beta
                && !(0.0..=1.0).contains(&beta)
            {
                return params.fail(format!("hair with a roughness of {beta}; 0 to 1 is meant"));
            }
        }
        let alpha = self.constant(params, "alpha", 2.0)?;
        if !(-90.0..=90.0).contains(&alpha) {
            return params.fail(format!("hair with scales tilted by {alpha} degrees"));
        }
        Ok(BsdfDesc::Hair {
            color,
            ior,
            beta_m,
            beta_n,
            alpha,
        })
    }

    /// A part of a mix, which must be defined before it.
    fn mixed(
        &mut self,
        params: &Params,
        name: &str,
        index: usize,
        ids: &[MaterialId],
    ) -> Result<MaterialId, Issue> {
        match self.material_names.get(name) {
            Some(&part) if part < index => match ids.get(part) {
                Some(&id) => Ok(id),
                None => params.fail(format!("material {name:?} cannot be mixed")),
            },
            Some(_) => params.fail(format!(
                "material {name:?} must be defined before the mix that uses it"
            )),
            None => {
                let near = nearest(name, self.material_names.keys());
                params.fail(format!("unknown material {name:?} in a mix{near}"))
            }
        }
    }
}

fn grey() -> BsdfDesc {
    BsdfDesc::Diffuse {
        reflectance: ColorTex::Const([0.5; 3]),
    }
}
