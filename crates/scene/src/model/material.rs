//! How surfaces scatter.

use super::{ColorTex, FloatTex, MaterialId, Rgb, TextureId};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// A surface: how it scatters and what perturbs its normal.
#[derive(Clone, Debug, PartialEq)]
pub struct Material {
    /// For messages and sharing.
    pub name: String,
    /// Scattering.
    pub bsdf: BsdfDesc,
    /// Tangent-space normal map: texture and strength on x and y.
    pub normal_map: Option<(TextureId, f32)>,
    /// Bump map: displacement along the normal, scene units.
    pub bump_map: Option<FloatTex>,
}

/// Width of a microfacet lobe.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Roughness {
    /// Along the tangent.
    pub u: FloatTex,
    /// Along the bitangent.
    pub v: FloatTex,
    /// Whether the numbers are widths or an artist's roughness.
    pub scale: RoughnessScale,
}

/// What a roughness number means.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case", deny_unknown_fields)]
pub enum RoughnessScale {
    /// GGX alpha itself.
    Alpha,
    /// alpha = sqrt(roughness): pbrt-v4 with `remaproughness`.
    Sqrt,
    /// alpha = roughness^2: glTF, Disney.
    Square,
}

/// How a surface scatters.
#[derive(Clone, Debug, PartialEq)]
pub enum BsdfDesc {
    /// Lambert; black below.
    Diffuse {
        /// Albedo.
        reflectance: ColorTex,
    },
    /// Rough diffuse [OrenNayar94].
    OrenNayar {
        /// Albedo.
        reflectance: ColorTex,
        /// Standard deviation of the facet angle, degrees.
        sigma: FloatTex,
    },
    /// Modified Phong [LafortuneWillems94]: diffuse kd plus ks (n + 2) / 2 pi cos^n about the mirror
    /// direction.
    Phong {
        /// Diffuse albedo.
        diffuse: ColorTex,
        /// Specular albedo at normal incidence.
        specular: ColorTex,
        /// Exponent n.
        exponent: FloatTex,
    },
    /// Generalised cosine lobes [Lafortune97].
    Lafortune {
        /// Diffuse albedo.
        diffuse: ColorTex,
        /// The lobes.
        lobes: Vec<LafortuneLobe>,
    },
    /// Perfect mirror.
    Mirror {
        /// Fraction reflected.
        reflectance: ColorTex,
    },
    /// Glass; smooth where the roughness is 0.
    Dielectric {
        /// Index of refraction inside over outside.
        ior: f32,
        /// Microfacet width.
        roughness: Roughness,
        /// Factor on what is reflected (1 is physical).
        reflect_tint: ColorTex,
        /// Factor on what is transmitted (1 is physical).
        transmit_tint: ColorTex,
    },
    /// A pane so thin that rays are not bent.
    ThinDielectric {
        /// Index of refraction.
        ior: f32,
    },
    /// Metal: GGX with complex index of refraction; smooth where the roughness is 0.
    Conductor {
        /// Optical constants.
        fresnel: ConductorFresnel,
        /// Microfacet width.
        roughness: Roughness,
    },
    /// A diffuse base under a dielectric layer.
    CoatedDiffuse {
        /// Albedo of the base.
        reflectance: ColorTex,
        /// The layer.
        coat: Coat,
    },
    /// A metal under a dielectric layer.
    CoatedConductor {
        /// The metal.
        fresnel: ConductorFresnel,
        /// Microfacet width of the metal.
        roughness: Roughness,
        /// The layer.
        coat: Coat,
    },
    /// Lambert on both sides, reflecting and transmitting.
    DiffuseTransmission {
        /// Fraction sent back.
        reflectance: ColorTex,
        /// Fraction sent through.
        transmittance: ColorTex,
    },
    /// Some of one and the rest of another.
    Mix {
        /// Where amount is 0.
        a: MaterialId,
        /// Where amount is 1.
        b: MaterialId,
        /// Weight of `b`.
        amount: FloatTex,
    },
    /// The same reflection on both sides of the surface (diffuse and metals are so already; this is
    /// for lobes that are black below, as pbrt has them one-sided nowhere).
    TwoSided {
        /// Seen from either side.
        inner: MaterialId,
    },
    /// No surface at all: rays pass.
    Interface,
    /// Everyday surfaces in one: see [`Principled`].
    Principled(Box<Principled>),
    /// A hair or fur fibre [Chiang16]; on curves, or anything with the strand along u.
    Hair {
        /// What the fibre is coloured by.
        color: HairColor,
        /// Index of refraction, 1.55 for hair.
        ior: f32,
        /// Longitudinal roughness, [0, 1].
        beta_m: FloatTex,
        /// Azimuthal roughness, [0, 1].
        beta_n: FloatTex,
        /// Tilt of the scales, degrees.
        alpha: f32,
    },
}

/// What colours a hair.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum HairColor {
    /// Absorption coefficient inside, per radius of the fibre.
    Absorption(ColorTex),
    /// The colour that a mass of it shows; absorption follows by the fit of [Chiang16].
    Reflectance(ColorTex),
    /// Concentrations of the two pigments.
    Melanin {
        /// Brown and black.
        eumelanin: FloatTex,
        /// Red and blond.
        pheomelanin: FloatTex,
    },
}

/// A superset of glTF's metallic-roughness surface with all of its extensions, in the manner of
/// OpenPBR: from the outside in a sheen layer, a clear coat, and a base that mixes metal, glass,
/// translucent and opaque dielectric by weight. Every layer conserves energy (multiple scattering
/// between facets is made up for).
///
/// Roughness r means a GGX width of r^2 (glTF, Disney).
#[derive(Clone, Debug, PartialEq)]
pub struct Principled {
    /// Albedo of the diffuse base, reflectance of the metal at normal incidence, tint of what is
    /// transmitted.
    pub base_color: ColorTex,
    /// Weight of the metal, [0, 1].
    pub metallic: FloatTex,
    /// Of metal, dielectric reflection and transmission, [0, 1].
    pub roughness: FloatTex,
    /// Stretch of the highlight along the tangent turned by `anisotropy_rotation`, [0, 1], as
    /// KHR_materials_anisotropy has it: width along is mix(r^2, 1, anisotropy^2), across r^2.
    pub anisotropy: FloatTex,
    /// Degrees, counter-clockwise from the tangent.
    pub anisotropy_rotation: FloatTex,
    /// Tangent-space direction of the stretch in red and green (as in a normal map, [-1, 1] on
    /// [0, 1]), turned further by the rotation.
    pub anisotropy_direction: Option<TextureId>,
    /// Index of refraction of the dielectric; 0 stands for infinity (glTF).
    pub ior: f32,
    /// Weight of the dielectric reflection at normal incidence.
    pub specular: FloatTex,
    /// Colour of the dielectric reflection at normal incidence (may exceed 1; F0 is clamped).
    pub specular_color: ColorTex,
    /// For metals: reflectance at 82 degrees relative to Schlick's curve [Kutz21]; white is Schlick.
    pub metal_edge: ColorTex,
    /// Weight of transmission against the diffuse base, [0, 1].
    pub transmission: FloatTex,
    /// The surface is a sheet: what is transmitted is not bent (but spread by roughness).
    pub thin: bool,
    /// Weight of diffuse transmission in the diffuse base, [0, 1].
    pub diffuse_transmission: FloatTex,
    /// Its colour.
    pub diffuse_transmission_color: ColorTex,
    /// Weight of the clear coat, [0, 1].
    pub coat: FloatTex,
    /// Of the coat, [0, 1].
    pub coat_roughness: FloatTex,
    /// Of the coat; 1.5 in glTF.
    pub coat_ior: f32,
    /// Normal map of the coat alone: texture and strength on x and y. Without it the coat has the
    /// geometric shading normal, not the base's mapped one.
    pub coat_normal_map: Option<(TextureId, f32)>,
    /// Colour and strength of the sheen; black is none.
    pub sheen_color: ColorTex,
    /// Of the sheen, [0, 1].
    pub sheen_roughness: FloatTex,
    /// Weight of a thin film on the base, [0, 1].
    pub iridescence: FloatTex,
    /// Index of refraction of the film.
    pub iridescence_ior: f32,
    /// Thickness of the film, nanometres.
    pub iridescence_thickness: FloatTex,
}

impl Default for Principled {
    fn default() -> Self {
        let zero = FloatTex::Const(0.0);
        let white = ColorTex::Const([1.0; 3]);
        Principled {
            base_color: white,
            metallic: zero,
            roughness: FloatTex::Const(0.5),
            anisotropy: zero,
            anisotropy_rotation: zero,
            anisotropy_direction: None,
            ior: 1.5,
            specular: FloatTex::Const(1.0),
            specular_color: white,
            metal_edge: white,
            transmission: zero,
            thin: false,
            diffuse_transmission: zero,
            diffuse_transmission_color: white,
            coat: zero,
            coat_roughness: zero,
            coat_ior: 1.5,
            coat_normal_map: None,
            sheen_color: ColorTex::Const([0.0; 3]),
            sheen_roughness: zero,
            iridescence: zero,
            iridescence_ior: 1.3,
            iridescence_thickness: FloatTex::Const(400.0),
        }
    }
}

/// A generalised cosine lobe: (cx wi.x wo.x + cy wi.y wo.y + cz wi.z wo.z)^n, times a colour.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct LafortuneLobe {
    /// Colour.
    pub albedo: Rgb,
    /// cx = cy = -1, cz = 1 is Phong about the mirror direction.
    pub c: [f32; 3],
    /// n.
    pub exponent: f32,
}

/// Optical constants of a metal.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum ConductorFresnel {
    /// Complex index of refraction by channel.
    EtaK {
        /// Real part.
        eta: ColorTex,
        /// Imaginary part.
        k: ColorTex,
    },
    /// Reflectance at normal incidence; k is derived with eta = 1.
    Reflectance(ColorTex),
}

/// A dielectric layer over something.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Coat {
    /// Index of refraction.
    pub ior: f32,
    /// Microfacet width of its surface.
    pub roughness: Roughness,
    /// Thickness in scene units (the medium inside absorbs nothing unless `albedo` says so).
    pub thickness: f32,
    /// Scattering albedo of the medium in the layer; 0 is clear.
    pub albedo: Rgb,
    /// Henyey-Greenstein asymmetry of that medium.
    pub g: f32,
    /// Bounces inside that are followed.
    pub max_depth: u32,
    /// Walks averaged for a value.
    pub samples: u32,
}
