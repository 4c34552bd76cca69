//! The principled surface and hair.

use super::surfaces::NormalMap;
use crate::model;
use crate::native::values::{ColorValue, FloatValue};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// A superset of glTF's metallic-roughness surface: sheen over clear coat over a base that mixes
/// metal, glass, translucent and opaque dielectric by weight. Weights are in [0, 1].
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Principled {
    /// Albedo of the diffuse base, reflectance of the metal, tint of what is transmitted.
    pub base_color: ColorValue,
    /// Weight of the metal.
    pub metallic: FloatValue,
    /// Roughness r; the width of the highlight is r^2.
    pub roughness: FloatValue,
    /// Stretch of the highlight along the tangent.
    pub anisotropy: FloatValue,
    /// Turn of the stretch, degrees counterclockwise from the tangent.
    pub anisotropy_rotation: FloatValue,
    /// Texture with the direction of the stretch in red and green.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub anisotropy_direction: Option<String>,
    /// Index of refraction; 0 stands for infinity.
    pub ior: f32,
    /// Weight of the dielectric reflection at normal incidence.
    pub specular: FloatValue,
    /// Colour of the dielectric reflection at normal incidence.
    pub specular_color: ColorValue,
    /// Reflectance of the metal at 82 degrees relative to Schlick's curve.
    pub metal_edge: ColorValue,
    /// Weight of transmission against the diffuse base.
    pub transmission: FloatValue,
    /// A sheet: what is transmitted is not bent.
    pub thin: bool,
    /// Weight of diffuse transmission in the diffuse base.
    pub diffuse_transmission: FloatValue,
    /// Its colour.
    pub diffuse_transmission_color: ColorValue,
    /// Weight of the clear coat.
    pub coat: FloatValue,
    /// Roughness of the coat.
    pub coat_roughness: FloatValue,
    /// Index of refraction of the coat.
    pub coat_ior: f32,
    /// Normal map of the coat alone.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub coat_normal_map: Option<NormalMap>,
    /// Colour and strength of the sheen; black is none.
    pub sheen_color: ColorValue,
    /// Roughness of the sheen.
    pub sheen_roughness: FloatValue,
    /// Weight of a thin film on the base.
    pub iridescence: FloatValue,
    /// Index of refraction of the film.
    pub iridescence_ior: f32,
    /// Thickness of the film, nanometres.
    pub iridescence_thickness: FloatValue,
}

impl Default for Principled {
    fn default() -> Self {
        // The model's defaults have constants only; a texture would have no name here.
        let color = |value: model::ColorTex| match value {
            model::ColorTex::Const(rgb) => ColorValue::Const(rgb),
            model::ColorTex::Texture(_) => ColorValue::Const([0.0; 3]),
        };
        let float = |value: model::FloatTex| match value {
            model::FloatTex::Const(x) => FloatValue::Const(x),
            model::FloatTex::Texture(..) => FloatValue::Const(0.0),
        };
        let d = model::Principled::default();
        Principled {
            base_color: color(d.base_color),
            metallic: float(d.metallic),
            roughness: float(d.roughness),
            anisotropy: float(d.anisotropy),
            anisotropy_rotation: float(d.anisotropy_rotation),
            anisotropy_direction: None,
            ior: d.ior,
            specular: float(d.specular),
            specular_color: color(d.specular_color),
            metal_edge: color(d.metal_edge),
            transmission: float(d.transmission),
            thin: d.thin,
            diffuse_transmission: float(d.diffuse_transmission),
            diffuse_transmission_color: color(d.diffuse_transmission_color),
            coat: float(d.coat),
            coat_roughness: float(d.coat_roughness),
            coat_ior: d.coat_ior,
            coat_normal_map: None,
            sheen_color: color(d.sheen_color),
            sheen_roughness: float(d.sheen_roughness),
            iridescence: float(d.iridescence),
            iridescence_ior: d.iridescence_ior,
            iridescence_thickness: float(d.iridescence_thickness),
        }
    }
}

/// A hair or fur fibre.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Hair {
    /// What colours it; brown by default.
    pub color: HairColor,
    /// Index of refraction.
    pub ior: f32,
    /// Longitudinal roughness, [0, 1].
    pub beta_m: FloatValue,
    /// Azimuthal roughness, [0, 1].
    pub beta_n: FloatValue,
    /// Tilt of the scales, degrees.
    pub alpha: f32,
}

impl Default for Hair {
    fn default() -> Self {
        Hair {
            color: HairColor::Melanin {
                eumelanin: FloatValue::Const(1.3),
                pheomelanin: FloatValue::Const(0.0),
            },
            ior: 1.55,
            beta_m: FloatValue::Const(0.3),
            beta_n: FloatValue::Const(0.3),
            alpha: 2.0,
        }
    }
}

/// What colours a hair.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case", deny_unknown_fields)]
pub enum HairColor {
    /// Absorption coefficient inside, per radius of the fibre.
    Absorption(ColorValue),
    /// The colour that a mass of it shows.
    Reflectance(ColorValue),
    /// Concentrations of the two pigments.
    Melanin {
        /// Brown and black.
        eumelanin: FloatValue,
        /// Red and blond.
        #[serde(default = "super::defaults::zero")]
        pheomelanin: FloatValue,
    },
}
