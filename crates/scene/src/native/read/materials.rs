//! Textures and materials from JSON.

use super::{Reader, json, lookup, map, rows, unit};
use crate::model::*;
use crate::native::values::{ColorValue, FloatValue};
use glam::DVec3;

impl Reader<'_, '_, '_> {
    pub(super) fn image(&mut self, name: &str, pointer: &str) -> Result<ImageId, String> {
        if let Some(&id) = self.images.get(name) {
            return Ok(id);
        }
        let place = self.at(pointer);
        self.cx
            .image(&place, name, Encoding::Auto)
            .map_err(|issue| {
                let near =
                    crate::suggest::did_you_mean(name, self.images.keys().map(String::as_str));
                format!("{}{near}", issue.reason)
            })
    }

    pub(super) fn color(&self, value: &ColorValue) -> Result<ColorTex, String> {
        match value {
            ColorValue::Const(rgb) => Ok(ColorTex::Const(*rgb)),
            ColorValue::Texture(name) => {
                lookup("texture", name, &self.textures).map(ColorTex::Texture)
            }
        }
    }

    pub(super) fn float(&self, value: &FloatValue) -> Result<FloatTex, String> {
        match value {
            FloatValue::Const(v) => Ok(FloatTex::Const(*v)),
            FloatValue::Texture(name, channel) => {
                lookup("texture", name, &self.textures).map(|id| FloatTex::Texture(id, *channel))
            }
        }
    }

    pub(super) fn texture(
        &mut self,
        texture: &json::Texture,
        pointer: &str,
    ) -> Result<Texture, String> {
        Ok(match texture {
            json::Texture::Constant { value } => Texture::Constant { value: *value },
            json::Texture::Image {
                image,
                map: m,
                wrap,
                nearest,
                mip,
                invert,
                scale,
            } => Texture::Image {
                image: self.image(image, &format!("{pointer}/image/image"))?,
                map: map(m),
                wrap: *wrap,
                nearest: *nearest,
                mip: *mip,
                invert: *invert,
                scale: *scale,
            },
            json::Texture::Checkerboard { map: m, even, odd } => Texture::Checkerboard {
                map: map(m),
                even: self.color(even)?,
                odd: self.color(odd)?,
            },
            json::Texture::Scale { a, by, by_color } => Texture::Scale {
                a: self.color(a)?,
                b: match (by, by_color) {
                    (Some(by), None) => FloatOrColor::Float(self.float(by)?),
                    (None, Some(by)) => FloatOrColor::Color(self.color(by)?),
                    _ => return Err("a product needs one of \"by\" and \"by_color\"".into()),
                },
            },
            json::Texture::Mix { a, b, amount } => Texture::Mix {
                a: self.color(a)?,
                b: self.color(b)?,
                amount: self.float(amount)?,
            },
            json::Texture::Bilerp { map: m, corners } => Texture::Bilerp {
                map: map(m),
                corners: corners.map(|c| c.0),
            },
            json::Texture::VertexColor => Texture::VertexColor,
            json::Texture::Checkerboard3d { matrix, even, odd } => Texture::Checkerboard3d {
                matrix: rows(matrix),
                even: self.color(even)?,
                odd: self.color(odd)?,
            },
            json::Texture::Dots {
                map: m,
                inside,
                outside,
            } => Texture::Dots {
                map: map(m),
                inside: self.color(inside)?,
                outside: self.color(outside)?,
            },
            json::Texture::Noise { matrix, pattern } => Texture::Noise {
                matrix: rows(matrix),
                pattern: *pattern,
            },
            json::Texture::DirectionMix { a, b, direction } => Texture::DirectionMix {
                a: self.color(a)?,
                b: self.color(b)?,
                direction: unit(DVec3::from_array(*direction))?,
            },
            json::Texture::Grey { value } => Texture::Grey {
                value: self.float(value)?,
            },
            json::Texture::UnitMean { texture } => Texture::UnitMean {
                texture: lookup("texture", texture, &self.textures)?,
            },
            json::Texture::Threshold { value, at } => Texture::Threshold {
                value: self.float(value)?,
                at: *at,
            },
        })
    }

    fn roughness(&self, roughness: &json::Roughness) -> Result<Roughness, String> {
        let u = self.float(&roughness.u)?;
        let v = roughness.v.as_ref().map_or(Ok(u), |v| self.float(v))?;
        Ok(Roughness {
            u,
            v,
            scale: roughness.scale,
        })
    }

    fn fresnel(&self, fresnel: &json::Fresnel) -> Result<ConductorFresnel, String> {
        Ok(match fresnel {
            json::Fresnel::EtaK { eta, k } => ConductorFresnel::EtaK {
                eta: self.color(eta)?,
                k: self.color(k)?,
            },
            json::Fresnel::Reflectance(r) => ConductorFresnel::Reflectance(self.color(r)?),
        })
    }

    fn coat(&self, coat: &json::Coat) -> Result<Coat, String> {
        Ok(Coat {
            ior: coat.ior,
            roughness: self.roughness(&coat.roughness)?,
            thickness: coat.thickness,
            albedo: coat.albedo.0,
            g: coat.g,
            max_depth: coat.max_depth,
            samples: coat.samples,
        })
    }

    pub(super) fn material(
        &self,
        name: &str,
        material: &json::Material,
    ) -> Result<Material, String> {
        let other = |name: &String| lookup("material", name, &self.materials);
        let bsdf = match &material.bsdf {
            json::Bsdf::Diffuse { reflectance } => BsdfDesc::Diffuse {
                reflectance: self.color(reflectance)?,
            },
            json::Bsdf::OrenNayar { reflectance, sigma } => BsdfDesc::OrenNayar {
                reflectance: self.color(reflectance)?,
                sigma: self.float(sigma)?,
            },
            json::Bsdf::Phong {
                diffuse,
                specular,
                exponent,
            } => BsdfDesc::Phong {
                diffuse: self.color(diffuse)?,
                specular: self.color(specular)?,
                exponent: self.float(exponent)?,
            },
            json::Bsdf::Lafortune { diffuse, lobes } => BsdfDesc::Lafortune {
                diffuse: self.color(diffuse)?,
                lobes: lobes.clone(),
            },
            json::Bsdf::Mirror { reflectance } => BsdfDesc::Mirror {
                reflectance: self.color(reflectance)?,
            },
            json::Bsdf::Dielectric {
                ior,
                roughness,
                reflect_tint,
                transmit_tint,
            } => BsdfDesc::Dielectric {
                ior: *ior,
                roughness: self.roughness(roughness)?,
                reflect_tint: self.color(reflect_tint)?,
                transmit_tint: self.color(transmit_tint)?,
            },
            json::Bsdf::ThinDielectric { ior } => BsdfDesc::ThinDielectric { ior: *ior },
            json::Bsdf::Conductor { fresnel, roughness } => BsdfDesc::Conductor {
                fresnel: self.fresnel(fresnel)?,
                roughness: self.roughness(roughness)?,
            },
            json::Bsdf::CoatedDiffuse { reflectance, coat } => BsdfDesc::CoatedDiffuse {
                reflectance: self.color(reflectance)?,
                coat: self.coat(coat)?,
            },
            json::Bsdf::CoatedConductor {
                fresnel,
                roughness,
                coat,
            } => BsdfDesc::CoatedConductor {
                fresnel: self.fresnel(fresnel)?,
                roughness: self.roughness(roughness)?,
                coat: self.coat(coat)?,
            },
            json::Bsdf::DiffuseTransmission {
                reflectance,
                transmittance,
            } => BsdfDesc::DiffuseTransmission {
                reflectance: self.color(reflectance)?,
                transmittance: self.color(transmittance)?,
            },
            json::Bsdf::Mix { a, b, amount } => BsdfDesc::Mix {
                a: other(a)?,
                b: other(b)?,
                amount: self.float(amount)?,
            },
            json::Bsdf::TwoSided { inner } => BsdfDesc::TwoSided {
                inner: other(inner)?,
            },
            json::Bsdf::Interface => BsdfDesc::Interface,
            json::Bsdf::Principled(p) => BsdfDesc::Principled(Box::new(self.principled(p)?)),
            json::Bsdf::Hair(hair) => self.hair(hair)?,
        };
        let normal_map = self.normal_map(&material.normal_map)?;
        let bump_map = material
            .bump_map
            .as_ref()
            .map(|b| self.float(b))
            .transpose()?;
        Ok(Material {
            name: name.to_owned(),
            bsdf,
            normal_map,
            bump_map,
        })
    }

    fn normal_map(
        &self,
        map: &Option<json::NormalMap>,
    ) -> Result<Option<(TextureId, f32)>, String> {
        map.as_ref()
            .map(|map| {
                Ok((
                    lookup("texture", &map.texture, &self.textures)?,
                    map.strength,
                ))
            })
            .transpose()
    }

    fn principled(&self, p: &json::Principled) -> Result<Principled, String> {
        Ok(Principled {
            base_color: self.color(&p.base_color)?,
            metallic: self.float(&p.metallic)?,
            roughness: self.float(&p.roughness)?,
            anisotropy: self.float(&p.anisotropy)?,
            anisotropy_rotation: self.float(&p.anisotropy_rotation)?,
            anisotropy_direction: p
                .anisotropy_direction
                .as_ref()
                .map(|name| lookup("texture", name, &self.textures))
                .transpose()?,
            ior: p.ior,
            specular: self.float(&p.specular)?,
            specular_color: self.color(&p.specular_color)?,
            metal_edge: self.color(&p.metal_edge)?,
            transmission: self.float(&p.transmission)?,
            thin: p.thin,
            diffuse_transmission: self.float(&p.diffuse_transmission)?,
            diffuse_transmission_color: self.color(&p.diffuse_transmission_color)?,
            coat: self.float(&p.coat)?,
            coat_roughness: self.float(&p.coat_roughness)?,
            coat_ior: p.coat_ior,
            coat_normal_map: self.normal_map(&p.coat_normal_map)?,
            sheen_color: self.color(&p.sheen_color)?,
            sheen_roughness: self.float(&p.sheen_roughness)?,
            iridescence: self.float(&p.iridescence)?,
            iridescence_ior: p.iridescence_ior,
            iridescence_thickness: self.float(&p.iridescence_thickness)?,
        })
    }

    fn hair(&self, hair: &json::Hair) -> Result<BsdfDesc, String> {
        Ok(BsdfDesc::Hair {
            color: match &hair.color {
                json::HairColor::Absorption(c) => HairColor::Absorption(self.color(c)?),
                json::HairColor::Reflectance(c) => HairColor::Reflectance(self.color(c)?),
                json::HairColor::Melanin {
                    eumelanin,
                    pheomelanin,
                } => HairColor::Melanin {
                    eumelanin: self.float(eumelanin)?,
                    pheomelanin: self.float(pheomelanin)?,
                },
            },
            ior: hair.ior,
            beta_m: self.float(&hair.beta_m)?,
            beta_n: self.float(&hair.beta_n)?,
            alpha: hair.alpha,
        })
    }
}
