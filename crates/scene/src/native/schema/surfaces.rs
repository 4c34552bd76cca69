//! Textures and materials.

use super::defaults::{glass, half, no, one_f32, white, zero};
use super::principled::{Hair, Principled};
use crate::model::{LafortuneLobe, MipFilter, NoisePattern, RoughnessScale, Wrap};
use crate::native::values::{Color, ColorValue, FloatValue};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// From surface to texture.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case", deny_unknown_fields)]
pub enum Map {
    /// Texture coordinates of the mesh.
    Uv {
        /// Which set.
        #[serde(default)]
        set: u32,
        /// s = m0 u + m1 v + m2, t = m3 u + m4 v + m5.
        #[serde(default = "plain")]
        matrix: [f64; 6],
    },
    /// World position through a matrix of three rows of four.
    Planar {
        /// World to texture.
        matrix: [f64; 12],
    },
    /// Angles from and about the z axis of texture space.
    Spherical {
        /// World to texture.
        matrix: [f64; 12],
    },
    /// Angle about the z axis of texture space, and z.
    Cylindrical {
        /// World to texture.
        matrix: [f64; 12],
    },
}

fn plain() -> [f64; 6] {
    [1.0, 0.0, 0.0, 0.0, 1.0, 0.0]
}

impl Default for Map {
    fn default() -> Self {
        Map::Uv {
            set: 0,
            matrix: plain(),
        }
    }
}

fn repeat() -> (Wrap, Wrap) {
    (Wrap::Repeat, Wrap::Repeat)
}
fn ones() -> [f32; 4] {
    [1.0; 4]
}
/// World to texture where nothing is said.
fn unmoved() -> [f64; 12] {
    [1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0]
}

/// A texture.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case", deny_unknown_fields)]
pub enum Texture {
    /// The same everywhere.
    Constant {
        /// RGBA.
        value: [f32; 4],
    },
    /// A picture.
    Image {
        /// The name of a picture, or a path.
        image: String,
        /// Where.
        #[serde(default)]
        map: Map,
        /// Outside [0, 1], by axis.
        #[serde(default = "repeat")]
        wrap: (Wrap, Wrap),
        /// Nearest pixel instead of bilinear.
        #[serde(default, skip_serializing_if = "no")]
        nearest: bool,
        /// A pyramid for where pixels of the render cover many of the picture.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        mip: Option<MipFilter>,
        /// 1 - value, before scale.
        #[serde(default, skip_serializing_if = "no")]
        invert: bool,
        /// Factor on RGBA.
        #[serde(default = "ones")]
        scale: [f32; 4],
    },
    /// Unit squares.
    Checkerboard {
        /// Where.
        #[serde(default)]
        map: Map,
        /// On even cells.
        even: ColorValue,
        /// On odd cells.
        odd: ColorValue,
    },
    /// Product.
    Scale {
        /// A colour.
        a: ColorValue,
        /// Times a number...
        #[serde(default, skip_serializing_if = "Option::is_none")]
        by: Option<FloatValue>,
        /// ...or times a colour.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        by_color: Option<ColorValue>,
    },
    /// (1 - amount) a + amount b.
    Mix {
        /// Where amount is 0.
        a: ColorValue,
        /// Where amount is 1.
        b: ColorValue,
        /// Weight.
        amount: FloatValue,
    },
    /// Bilinear between the corners (0,0), (0,1), (1,0), (1,1).
    Bilerp {
        /// Where.
        #[serde(default)]
        map: Map,
        /// Colours.
        corners: [Color; 4],
    },
    /// Interpolated vertex colour; white where the mesh has none.
    VertexColor,
    /// Unit cubes.
    Checkerboard3d {
        /// World to texture.
        #[serde(default = "unmoved")]
        matrix: [f64; 12],
        /// On even cells.
        even: ColorValue,
        /// On odd cells.
        odd: ColorValue,
    },
    /// Dots in about three of eight unit squares.
    Dots {
        /// Where.
        #[serde(default)]
        map: Map,
        /// On the dots.
        inside: ColorValue,
        /// Between them.
        outside: ColorValue,
    },
    /// Gradient noise in space.
    Noise {
        /// World to texture.
        #[serde(default = "unmoved")]
        matrix: [f64; 12],
        /// Which.
        pattern: NoisePattern,
    },
    /// Two textures by how the surface faces a direction.
    DirectionMix {
        /// Where the surface faces the direction.
        a: ColorValue,
        /// Where it is at right angles to it.
        b: ColorValue,
        /// In the world.
        direction: [f64; 3],
    },
    /// A number as a grey.
    Grey {
        /// The number.
        value: FloatValue,
    },
    /// A picture divided by the mean luminance of its pixels.
    UnitMean {
        /// The name of an image texture.
        texture: String,
    },
    /// 1 where a number is at least a bound, else 0.
    Threshold {
        /// What is compared.
        value: FloatValue,
        /// The bound.
        at: f32,
    },
}

/// Tangent-space normal map.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct NormalMap {
    /// The texture.
    pub texture: String,
    /// Strength on x and y.
    #[serde(default = "one_f32")]
    pub strength: f32,
}

/// A surface.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Material {
    /// How it scatters.
    pub bsdf: Bsdf,
    /// Normal map.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub normal_map: Option<NormalMap>,
    /// Displacement along the normal, for shading.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub bump_map: Option<FloatValue>,
}

/// Width of a microfacet lobe.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Roughness {
    /// Along the tangent.
    pub u: FloatValue,
    /// Along the bitangent; as along the tangent by default.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub v: Option<FloatValue>,
    /// What the numbers are.
    #[serde(default = "alpha")]
    pub scale: RoughnessScale,
}

fn alpha() -> RoughnessScale {
    RoughnessScale::Alpha
}

impl Default for Roughness {
    fn default() -> Self {
        Roughness {
            u: zero(),
            v: None,
            scale: RoughnessScale::Alpha,
        }
    }
}

/// Optical constants of a metal.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case", deny_unknown_fields)]
pub enum Fresnel {
    /// Complex index of refraction by channel.
    EtaK {
        /// Real part.
        eta: ColorValue,
        /// Imaginary part.
        k: ColorValue,
    },
    /// Reflectance at normal incidence.
    Reflectance(ColorValue),
}

/// A dielectric layer.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Coat {
    /// Index of refraction.
    pub ior: f32,
    /// Microfacet width.
    pub roughness: Roughness,
    /// Scene units.
    pub thickness: f32,
    /// Scattering albedo of the medium inside; 0 is clear.
    pub albedo: Color,
    /// Its asymmetry.
    pub g: f32,
    /// Bounces inside.
    pub max_depth: u32,
    /// Walks averaged for a value.
    pub samples: u32,
}

impl Default for Coat {
    fn default() -> Self {
        let roughness = Roughness::default();
        Coat {
            ior: 1.5,
            roughness,
            thickness: 0.01,
            albedo: Color([0.0; 3]),
            g: 0.0,
            max_depth: 10,
            samples: 1,
        }
    }
}

/// How a surface scatters.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case", deny_unknown_fields)]
pub enum Bsdf {
    /// Lambert.
    Diffuse {
        /// Albedo.
        #[serde(default = "half")]
        reflectance: ColorValue,
    },
    /// Rough diffuse.
    OrenNayar {
        /// Albedo.
        reflectance: ColorValue,
        /// Spread of the facets, degrees.
        sigma: FloatValue,
    },
    /// Modified Phong.
    Phong {
        /// Diffuse albedo.
        diffuse: ColorValue,
        /// Specular albedo.
        specular: ColorValue,
        /// Exponent.
        exponent: FloatValue,
    },
    /// Generalised cosine lobes.
    Lafortune {
        /// Diffuse albedo.
        diffuse: ColorValue,
        /// Lobes.
        lobes: Vec<LafortuneLobe>,
    },
    /// Perfect mirror.
    Mirror {
        /// Fraction reflected.
        #[serde(default = "white")]
        reflectance: ColorValue,
    },
    /// Glass.
    Dielectric {
        /// Index of refraction.
        #[serde(default = "glass")]
        ior: f32,
        /// Microfacet width; smooth by default.
        #[serde(default)]
        roughness: Roughness,
        /// Factor on what is reflected.
        #[serde(default = "white")]
        reflect_tint: ColorValue,
        /// Factor on what is transmitted.
        #[serde(default = "white")]
        transmit_tint: ColorValue,
    },
    /// A thin pane.
    ThinDielectric {
        /// Index of refraction.
        #[serde(default = "glass")]
        ior: f32,
    },
    /// Metal.
    Conductor {
        /// Optical constants.
        fresnel: Fresnel,
        /// Microfacet width; smooth by default.
        #[serde(default)]
        roughness: Roughness,
    },
    /// A diffuse base under a layer.
    CoatedDiffuse {
        /// Albedo of the base.
        #[serde(default = "half")]
        reflectance: ColorValue,
        /// The layer.
        #[serde(default)]
        coat: Coat,
    },
    /// A metal under a layer.
    CoatedConductor {
        /// The metal.
        fresnel: Fresnel,
        /// Its microfacet width.
        #[serde(default)]
        roughness: Roughness,
        /// The layer.
        #[serde(default)]
        coat: Coat,
    },
    /// Lambert on both sides.
    DiffuseTransmission {
        /// Fraction sent back.
        reflectance: ColorValue,
        /// Fraction sent through.
        transmittance: ColorValue,
    },
    /// One of two materials, by a weight.
    Mix {
        /// Where amount is 0.
        a: String,
        /// Where amount is 1.
        b: String,
        /// Weight of b.
        amount: FloatValue,
    },
    /// The same on both sides.
    TwoSided {
        /// A material.
        inner: String,
    },
    /// No surface.
    Interface,
    /// Everyday surfaces: metal, glass, plastic, cloth, paint in one.
    Principled(Box<Principled>),
    /// A hair or fur fibre; for curves.
    Hair(Hair),
}
