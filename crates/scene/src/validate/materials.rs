//! Textures and materials: references point backwards, numbers are in range.

use super::Findings;
use crate::limits::MAX_OCTAVES;
use crate::model::{
    BsdfDesc, Coat, ColorTex, ConductorFresnel, FloatOrColor, FloatTex, HairColor, MipFilter,
    NoisePattern, Principled, Roughness, SceneDesc, Texture, UvMap,
};

fn color(what: &str, value: ColorTex, limit: usize, found: &mut Findings) {
    match value {
        ColorTex::Const(c) => {
            found.check(c.iter().all(|c| c.is_finite() && *c >= 0.0), || {
                format!("{what}: a colour of {c:?}")
            });
        }
        ColorTex::Texture(id) => {
            found.check(id.index() < limit, || {
                format!("{what}: refers to a texture that does not come before it")
            });
        }
    }
}

fn float(what: &str, value: FloatTex, limit: usize, found: &mut Findings) {
    match value {
        FloatTex::Const(v) => found.check(v.is_finite(), || {
            format!("{what}: a number that is not finite")
        }),
        FloatTex::Texture(id, _) => {
            found.check(id.index() < limit, || {
                format!("{what}: refers to a texture that does not come before it")
            });
        }
    }
}

fn map(what: &str, map: &UvMap, found: &mut Findings) {
    let finite = match map {
        UvMap::Uv { matrix, .. } => matrix.iter().all(|x| x.is_finite()),
        UvMap::Planar { matrix } | UvMap::Spherical { matrix } | UvMap::Cylindrical { matrix } => {
            matrix.is_finite()
        }
    };
    found.check(finite, || {
        format!("{what}: a mapping with numbers that are not finite")
    });
}

fn noise(what: &str, pattern: &NoisePattern, found: &mut Findings) {
    let (octaves, numbers) = match *pattern {
        NoisePattern::Fbm { octaves, roughness }
        | NoisePattern::Wrinkled { octaves, roughness } => (octaves, [roughness, 0.0, 0.0]),
        NoisePattern::Windy => (0, [0.0; 3]),
        NoisePattern::Marble {
            octaves,
            roughness,
            scale,
            variation,
        } => (octaves, [roughness, scale, variation]),
    };
    found.check(octaves <= MAX_OCTAVES, || {
        format!("{what}: {octaves} octaves of noise; the limit is {MAX_OCTAVES}")
    });
    found.check(numbers.iter().all(|x| x.is_finite()), || {
        format!("{what}: numbers that are not finite")
    });
}

pub(super) fn check(desc: &SceneDesc, found: &mut Findings) {
    for (index, texture) in desc.textures.iter().enumerate() {
        let what = format!("texture {index}");
        match texture {
            Texture::Constant { value } => {
                found.check(value.iter().all(|v| v.is_finite()), || {
                    format!("{what}: numbers that are not finite")
                });
            }
            Texture::Image {
                image,
                map: m,
                mip,
                scale,
                ..
            } => {
                if let Some(MipFilter::Ewa { max_anisotropy }) = mip {
                    found.check((1.0..=1000.0).contains(max_anisotropy), || {
                        format!("{what}: an anisotropy of {max_anisotropy}; 1 to 1000 are possible")
                    });
                }
                found.check(image.index() < desc.images.len(), || {
                    format!("{what}: refers to no picture")
                });
                found.check(scale.iter().all(|v| v.is_finite()), || {
                    format!("{what}: numbers that are not finite")
                });
                map(&what, m, found);
            }
            Texture::Checkerboard { map: m, even, odd } => {
                map(&what, m, found);
                color(&what, *even, index, found);
                color(&what, *odd, index, found);
            }
            Texture::Scale { a, b } => {
                color(&what, *a, index, found);
                match b {
                    FloatOrColor::Float(b) => float(&what, *b, index, found),
                    FloatOrColor::Color(b) => color(&what, *b, index, found),
                }
            }
            Texture::Mix { a, b, amount } => {
                color(&what, *a, index, found);
                color(&what, *b, index, found);
                float(&what, *amount, index, found);
            }
            Texture::Bilerp { map: m, corners } => {
                map(&what, m, found);
                corners
                    .iter()
                    .for_each(|c| color(&what, ColorTex::Const(*c), index, found));
            }
            Texture::VertexColor => {}
            Texture::Threshold { value, at } => {
                float(&what, *value, index, found);
                found.check(at.is_finite(), || format!("{what}: a threshold of {at}"));
            }
            Texture::Checkerboard3d { matrix, even, odd } => {
                map(&what, &UvMap::Planar { matrix: *matrix }, found);
                color(&what, *even, index, found);
                color(&what, *odd, index, found);
            }
            Texture::Dots {
                map: m,
                inside,
                outside,
            } => {
                map(&what, m, found);
                color(&what, *inside, index, found);
                color(&what, *outside, index, found);
            }
            Texture::Noise { matrix, pattern } => {
                map(&what, &UvMap::Planar { matrix: *matrix }, found);
                noise(&what, pattern, found);
            }
            Texture::DirectionMix { a, b, direction } => {
                color(&what, *a, index, found);
                color(&what, *b, index, found);
                found.check((0.999..1.001).contains(&direction.length()), || {
                    format!("{what}: a direction that is not of unit length")
                });
            }
            Texture::Grey { value } => float(&what, *value, index, found),
            Texture::UnitMean { texture } => {
                let picture = texture.index() < index
                    && matches!(desc.textures[texture.index()], Texture::Image { .. });
                found.check(picture, || {
                    format!("{what}: the mean of something that is no picture before it")
                });
            }
        }
    }
    let mut names = std::collections::BTreeSet::new();
    let textures = desc.textures.len();
    for (index, material) in desc.materials.iter().enumerate() {
        let what = format!("material {:?}", material.name);
        found.check(names.insert(material.name.as_str()), || {
            format!("{what} is there twice")
        });
        bsdf(&what, &material.bsdf, index, textures, found);
        if let Some((id, strength)) = material.normal_map {
            found.check(id.index() < textures, || {
                format!("{what}: refers to no texture")
            });
            found.check(strength.is_finite(), || {
                format!("{what}: a normal map of strength {strength}")
            });
        }
        if let Some(bump) = material.bump_map {
            float(&what, bump, textures, found);
        }
    }
}

fn roughness(what: &str, value: &Roughness, textures: usize, found: &mut Findings) {
    for value in [value.u, value.v] {
        float(what, value, textures, found);
        if let FloatTex::Const(v) = value {
            found.check(v >= 0.0, || format!("{what}: a roughness of {v}"));
        }
    }
}

fn ior(what: &str, value: f32, found: &mut Findings) {
    found.check((0.01..=100.0).contains(&value), || {
        format!("{what}: an index of refraction of {value}")
    });
}

fn fresnel(what: &str, value: &ConductorFresnel, textures: usize, found: &mut Findings) {
    match value {
        ConductorFresnel::EtaK { eta, k } => {
            color(what, *eta, textures, found);
            color(what, *k, textures, found);
        }
        ConductorFresnel::Reflectance(r) => color(what, *r, textures, found),
    }
}

fn coat(what: &str, value: &Coat, textures: usize, found: &mut Findings) {
    ior(what, value.ior, found);
    roughness(what, &value.roughness, textures, found);
    color(what, ColorTex::Const(value.albedo), textures, found);
    found.check(
        value.thickness >= 0.0 && value.thickness.is_finite() && (-1.0..=1.0).contains(&value.g),
        || {
            format!(
                "{what}: a coat of thickness {} and asymmetry {}",
                value.thickness, value.g
            )
        },
    );
    found.check(
        (1..=1000).contains(&value.max_depth) && (1..=1000).contains(&value.samples),
        || {
            format!(
                "{what}: a coat with depth {} and {} samples; 1 to 1000 are possible",
                value.max_depth, value.samples
            )
        },
    );
}

fn bsdf(what: &str, bsdf: &BsdfDesc, index: usize, textures: usize, found: &mut Findings) {
    let t = textures;
    match bsdf {
        BsdfDesc::Diffuse { reflectance } | BsdfDesc::Mirror { reflectance } => {
            color(what, *reflectance, t, found)
        }
        BsdfDesc::OrenNayar { reflectance, sigma } => {
            color(what, *reflectance, t, found);
            float(what, *sigma, t, found);
        }
        BsdfDesc::Phong {
            diffuse,
            specular,
            exponent,
        } => {
            color(what, *diffuse, t, found);
            color(what, *specular, t, found);
            float(what, *exponent, t, found);
        }
        BsdfDesc::Lafortune { diffuse, lobes } => {
            color(what, *diffuse, t, found);
            for lobe in lobes {
                color(what, ColorTex::Const(lobe.albedo), t, found);
                let fine = lobe.c.iter().all(|c| c.is_finite())
                    && lobe.exponent >= 0.0
                    && lobe.exponent.is_finite();
                found.check(fine, || format!("{what}: a lobe with numbers out of range"));
            }
        }
        BsdfDesc::Dielectric {
            ior: i,
            roughness: r,
            reflect_tint,
            transmit_tint,
        } => {
            ior(what, *i, found);
            roughness(what, r, t, found);
            color(what, *reflect_tint, t, found);
            color(what, *transmit_tint, t, found);
        }
        BsdfDesc::ThinDielectric { ior: i } => ior(what, *i, found),
        BsdfDesc::Conductor {
            fresnel: f,
            roughness: r,
        } => {
            fresnel(what, f, t, found);
            roughness(what, r, t, found);
        }
        BsdfDesc::CoatedDiffuse {
            reflectance,
            coat: c,
        } => {
            color(what, *reflectance, t, found);
            coat(what, c, t, found);
        }
        BsdfDesc::CoatedConductor {
            fresnel: f,
            roughness: r,
            coat: c,
        } => {
            fresnel(what, f, t, found);
            roughness(what, r, t, found);
            coat(what, c, t, found);
        }
        BsdfDesc::DiffuseTransmission {
            reflectance,
            transmittance,
        } => {
            color(what, *reflectance, t, found);
            color(what, *transmittance, t, found);
        }
        BsdfDesc::Mix { a, b, amount } => {
            found.check(a.index() < index && b.index() < index, || {
                format!("{what}: refers to a material that does not come before it")
            });
            float(what, *amount, t, found);
        }
        BsdfDesc::TwoSided { inner } => {
            found.check(inner.index() < index, || {
                format!("{what}: refers to a material that does not come before it")
            });
        }
        BsdfDesc::Interface => {}
        BsdfDesc::Principled(p) => principled(what, p, t, found),
        BsdfDesc::Hair {
            color: c,
            ior: i,
            beta_m,
            beta_n,
            alpha,
        } => {
            match c {
                HairColor::Absorption(c) | HairColor::Reflectance(c) => color(what, *c, t, found),
                HairColor::Melanin {
                    eumelanin,
                    pheomelanin,
                } => {
                    for (name, value) in [("eumelanin", eumelanin), ("pheomelanin", pheomelanin)] {
                        float(what, *value, t, found);
                        if let FloatTex::Const(v) = value {
                            found.check(*v >= 0.0, || format!("{what}: {name} of {v}"));
                        }
                    }
                }
            }
            ior(what, *i, found);
            weight(what, "beta_m", *beta_m, t, found);
            weight(what, "beta_n", *beta_n, t, found);
            found.check((-45.0..=45.0).contains(alpha), || {
                format!("{what}: scales tilted by {alpha} degrees; -45 to 45 are possible")
            });
        }
    }
}

/// A number in [0, 1], or a texture.
fn weight(what: &str, name: &str, value: FloatTex, textures: usize, found: &mut Findings) {
    float(what, value, textures, found);
    if let FloatTex::Const(v) = value {
        found.check((0.0..=1.0).contains(&v) || !v.is_finite(), || {
            format!("{what}: {name} is {v}; 0 to 1 is possible")
        });
    }
}

fn principled(what: &str, p: &Principled, textures: usize, found: &mut Findings) {
    let t = textures;
    for c in [
        p.base_color,
        p.specular_color,
        p.metal_edge,
        p.diffuse_transmission_color,
        p.sheen_color,
    ] {
        color(what, c, t, found);
    }
    for (name, value) in [
        ("metallic", p.metallic),
        ("roughness", p.roughness),
        ("anisotropy", p.anisotropy),
        ("specular", p.specular),
        ("transmission", p.transmission),
        ("diffuse_transmission", p.diffuse_transmission),
        ("coat", p.coat),
        ("coat_roughness", p.coat_roughness),
        ("sheen_roughness", p.sheen_roughness),
        ("iridescence", p.iridescence),
    ] {
        weight(what, name, value, t, found);
    }
    float(what, p.anisotropy_rotation, t, found);
    float(what, p.iridescence_thickness, t, found);
    if let FloatTex::Const(nm) = p.iridescence_thickness {
        found.check(nm >= 0.0, || format!("{what}: a film {nm} nm thick"));
    }
    if p.ior != 0.0 {
        ior(what, p.ior, found);
    }
    ior(what, p.coat_ior, found);
    ior(what, p.iridescence_ior, found);
    let coat_normals = p.coat_normal_map.map(|(id, _)| id);
    for id in p.anisotropy_direction.into_iter().chain(coat_normals) {
        found.check(id.index() < t, || format!("{what}: refers to no texture"));
    }
    if let Some((_, strength)) = p.coat_normal_map {
        found.check(strength.is_finite(), || {
            format!("{what}: a normal map of strength {strength}")
        });
    }
}
