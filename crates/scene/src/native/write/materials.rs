//! Textures and materials to JSON.

use super::{WriteError, Writer, color, float, json, map, rows, texture_name};
use crate::model::*;
use crate::native::values::Color;

fn roughness(r: &Roughness) -> json::Roughness {
    json::Roughness {
        u: float(&r.u),
        v: (r.v != r.u).then(|| float(&r.v)),
        scale: r.scale,
    }
}

fn fresnel(f: &ConductorFresnel) -> json::Fresnel {
    match f {
        ConductorFresnel::EtaK { eta, k } => json::Fresnel::EtaK {
            eta: color(eta),
            k: color(k),
        },
        ConductorFresnel::Reflectance(r) => json::Fresnel::Reflectance(color(r)),
    }
}

fn coat(c: &Coat) -> json::Coat {
    json::Coat {
        ior: c.ior,
        roughness: roughness(&c.roughness),
        thickness: c.thickness,
        albedo: Color(c.albedo),
        g: c.g,
        max_depth: c.max_depth,
        samples: c.samples,
    }
}

fn normal_map(map: Option<(TextureId, f32)>) -> Option<json::NormalMap> {
    map.map(|(id, strength)| json::NormalMap {
        texture: texture_name(id),
        strength,
    })
}

fn principled(p: &Principled) -> json::Principled {
    json::Principled {
        base_color: color(&p.base_color),
        metallic: float(&p.metallic),
        roughness: float(&p.roughness),
        anisotropy: float(&p.anisotropy),
        anisotropy_rotation: float(&p.anisotropy_rotation),
        anisotropy_direction: p.anisotropy_direction.map(texture_name),
        ior: p.ior,
        specular: float(&p.specular),
        specular_color: color(&p.specular_color),
        metal_edge: color(&p.metal_edge),
        transmission: float(&p.transmission),
        thin: p.thin,
        diffuse_transmission: float(&p.diffuse_transmission),
        diffuse_transmission_color: color(&p.diffuse_transmission_color),
        coat: float(&p.coat),
        coat_roughness: float(&p.coat_roughness),
        coat_ior: p.coat_ior,
        coat_normal_map: normal_map(p.coat_normal_map),
        sheen_color: color(&p.sheen_color),
        sheen_roughness: float(&p.sheen_roughness),
        iridescence: float(&p.iridescence),
        iridescence_ior: p.iridescence_ior,
        iridescence_thickness: float(&p.iridescence_thickness),
    }
}

fn hair_color(c: &HairColor) -> json::HairColor {
    match c {
        HairColor::Absorption(c) => json::HairColor::Absorption(color(c)),
        HairColor::Reflectance(c) => json::HairColor::Reflectance(color(c)),
        HairColor::Melanin {
            eumelanin,
            pheomelanin,
        } => json::HairColor::Melanin {
            eumelanin: float(eumelanin),
            pheomelanin: float(pheomelanin),
        },
    }
}

impl Writer<'_> {
    pub(super) fn texture(&self, texture: &Texture) -> Result<json::Texture, WriteError> {
        Ok(match texture {
            Texture::Constant { value } => json::Texture::Constant { value: *value },
            Texture::Image {
                image,
                map: m,
                wrap,
                nearest,
                mip,
                invert,
                scale,
            } => json::Texture::Image {
                image: format!("i{}", image.0),
                map: map(m),
                wrap: *wrap,
                nearest: *nearest,
                mip: *mip,
                invert: *invert,
                scale: *scale,
            },
            Texture::Checkerboard { map: m, even, odd } => json::Texture::Checkerboard {
                map: map(m),
                even: color(even),
                odd: color(odd),
            },
            Texture::Scale { a, b } => {
                let (by, by_color) = match b {
                    FloatOrColor::Float(b) => (Some(float(b)), None),
                    FloatOrColor::Color(b) => (None, Some(color(b))),
                };
                json::Texture::Scale {
                    a: color(a),
                    by,
                    by_color,
                }
            }
            Texture::Mix { a, b, amount } => json::Texture::Mix {
                a: color(a),
                b: color(b),
                amount: float(amount),
            },
            Texture::Bilerp { map: m, corners } => json::Texture::Bilerp {
                map: map(m),
                corners: corners.map(Color),
            },
            Texture::VertexColor => json::Texture::VertexColor,
            Texture::Checkerboard3d { matrix, even, odd } => json::Texture::Checkerboard3d {
                matrix: rows(matrix),
                even: color(even),
                odd: color(odd),
            },
            Texture::Dots {
                map: m,
                inside,
                outside,
            } => json::Texture::Dots {
                map: map(m),
                inside: color(inside),
                outside: color(outside),
            },
            Texture::Noise { matrix, pattern } => json::Texture::Noise {
                matrix: rows(matrix),
                pattern: *pattern,
            },
            Texture::DirectionMix { a, b, direction } => json::Texture::DirectionMix {
                a: color(a),
                b: color(b),
                direction: direction.to_array(),
            },
            Texture::Grey { value } => json::Texture::Grey {
                value: float(value),
            },
            Texture::UnitMean { texture } => json::Texture::UnitMean {
                texture: texture_name(*texture),
            },
            Texture::Threshold { value, at } => json::Texture::Threshold {
                value: float(value),
                at: *at,
            },
        })
    }

    pub(super) fn material(&self, material: &Material) -> Result<json::Material, WriteError> {
        let bsdf = match &material.bsdf {
            BsdfDesc::Diffuse { reflectance } => json::Bsdf::Diffuse {
                reflectance: color(reflectance),
            },
            BsdfDesc::OrenNayar { reflectance, sigma } => json::Bsdf::OrenNayar {
                reflectance: color(reflectance),
                sigma: float(sigma),
            },
            BsdfDesc::Phong {
                diffuse,
                specular,
                exponent,
            } => json::Bsdf::Phong {
                diffuse: color(diffuse),
                specular: color(specular),
                exponent: float(exponent),
            },
            BsdfDesc::Lafortune { diffuse, lobes } => json::Bsdf::Lafortune {
                diffuse: color(diffuse),
                lobes: lobes.clone(),
            },
            BsdfDesc::Mirror { reflectance } => json::Bsdf::Mirror {
                reflectance: color(reflectance),
            },
            BsdfDesc::Dielectric {
                ior,
                roughness: r,
                reflect_tint,
                transmit_tint,
            } => json::Bsdf::Dielectric {
                ior: *ior,
                roughness: roughness(r),
                reflect_tint: color(reflect_tint),
                transmit_tint: color(transmit_tint),
            },
            BsdfDesc::ThinDielectric { ior } => json::Bsdf::ThinDielectric { ior: *ior },
            BsdfDesc::Conductor {
                fresnel: f,
                roughness: r,
            } => json::Bsdf::Conductor {
                fresnel: fresnel(f),
                roughness: roughness(r),
            },
            BsdfDesc::CoatedDiffuse {
                reflectance,
                coat: c,
            } => json::Bsdf::CoatedDiffuse {
                reflectance: color(reflectance),
                coat: coat(c),
            },
            BsdfDesc::CoatedConductor {
                fresnel: f,
                roughness: r,
                coat: c,
            } => json::Bsdf::CoatedConductor {
                fresnel: fresnel(f),
                roughness: roughness(r),
                coat: coat(c),
            },
            BsdfDesc::DiffuseTransmission {
                reflectance,
                transmittance,
            } => json::Bsdf::DiffuseTransmission {
                reflectance: color(reflectance),
                transmittance: color(transmittance),
            },
            BsdfDesc::Mix { a, b, amount } => json::Bsdf::Mix {
                a: self.material_name(*a)?,
                b: self.material_name(*b)?,
                amount: float(amount),
            },
            BsdfDesc::TwoSided { inner } => json::Bsdf::TwoSided {
                inner: self.material_name(*inner)?,
            },
            BsdfDesc::Interface => json::Bsdf::Interface,
            BsdfDesc::Principled(p) => json::Bsdf::Principled(Box::new(principled(p))),
            BsdfDesc::Hair {
                color,
                ior,
                beta_m,
                beta_n,
                alpha,
            } => json::Bsdf::Hair(json::Hair {
                color: hair_color(color),
                ior: *ior,
                beta_m: float(beta_m),
                beta_n: float(beta_n),
                alpha: *alpha,
            }),
        };
        let normal_map = normal_map(material.normal_map);
        Ok(json::Material {
            bsdf,
            normal_map,
            bump_map: material.bump_map.as_ref().map(float),
        })
    }
}
