//! Materials, built at the end of the file, when all textures are known.

use super::params::{Kind, Params};
use super::spectra::{COPPER, Role};
use super::{Importer, MaterialEntry, Materials, legacy, nearest};
use crate::context::Issue;
use crate::model::{
    BsdfDesc, Coat, ColorTex, ConductorFresnel, FloatTex, Material, MaterialId, Roughness,
    RoughnessScale,
};
use std::collections::BTreeSet;

const MATERIALS: [&str; 12] = [
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
            "coateddiffuse" => BsdfDesc::CoatedDiffuse {
                reflectance: self.albedo(params, "reflectance", 0.5)?,
                coat: self.coat(params, "")?,
            },
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
                BsdfDesc::Mix { a, b, amount }
            }
            "interface" | "" | "none" => BsdfDesc::Interface,
            "subsurface" | "hair" | "measured" => {
                for name in [
                    "name",
                    "filename",
                    "g",
                    "sigma_a",
                    "sigma_s",
                    "mfp",
                    "eta",
                    "scale",
                    "roughness",
                    "uroughness",
                ] {
                    params.ignore(&[name]);
                }
                params.ignore(&[
                    "vroughness",
                    "remaproughness",
                    "eumelanin",
                    "pheomelanin",
                    "beta_m",
                    "beta_n",
                    "alpha",
                ]);
                let reflectance = match self.color_tex(params, "color", Role::Albedo)? {
                    Some(color) => color,
                    None => self.albedo(params, "reflectance", 0.5)?,
                };
                self.cx.warn(
                    &params.place,
                    format!("material {:?} is not supported: a diffuse surface of its reflectance stands in", entry.kind),
                );
                BsdfDesc::Diffuse { reflectance }
            }
            other => {
                let hint = legacy::hint("material", other, &MATERIALS);
                return params.fail(format!("unknown material type {other:?}{hint}"));
            }
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
