//! Participating media, grids and curves.

use super::defaults::black;
use crate::model::{CurveKind, CurveSegment, Rgb};
use crate::native::values::{Color, Placement};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// A participating medium; coefficients are per scene unit of world space.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Medium {
    /// Absorption coefficient.
    #[serde(default = "black")]
    pub sigma_a: Color,
    /// Scattering coefficient.
    #[serde(default = "black")]
    pub sigma_s: Color,
    /// Radiance given off per absorption.
    #[serde(default = "black")]
    pub emission: Color,
    /// Asymmetry of scattering, between -1 (back) and 1 (forward).
    #[serde(default)]
    pub g: f32,
    /// How it varies in space; the same everywhere without.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub grid: Option<MediumGrid>,
    /// Of what fills a translucent body with a border of glass: that one's index of refraction. Light
    /// leaves as from a diffuse surface, and the walk inside counts as one bounce.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub translucent: Option<f32>,
}

/// How a medium varies: factors on its coefficients, zero outside the bounds.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct MediumGrid {
    /// Medium space to world.
    #[serde(default, skip_serializing_if = "Placement::is_identity")]
    pub transform: Placement,
    /// Two corners of the box in medium space that the grids fill.
    #[serde(default = "unit_box")]
    pub bounds: [[f32; 3]; 2],
    /// Factor on `sigma_a`.
    pub absorption: Grid,
    /// Factor on `sigma_s`; that on `sigma_a` where absent.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub scattering: Option<Grid>,
    /// Factor on `emission`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub emission: Option<Grid>,
}

fn unit_box() -> [[f32; 3]; 2] {
    [[0.0; 3], [1.0; 3]]
}

/// Values on a regular grid: a binary file as `convert` writes it, or `size` with `values` or
/// `colors`, x fastest.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Grid {
    /// The file.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub file: Option<String>,
    /// Cells by axis.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub size: Option<[u32; 3]>,
    /// One number a cell.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub values: Vec<f32>,
    /// One linear colour a cell.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub colors: Vec<Rgb>,
}

/// What lies on the two sides of a surface: names of media; vacuum where absent.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct MediumInterface {
    /// Against the geometric normal.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub inside: Option<String>,
    /// Where the geometric normal points.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub outside: Option<String>,
}

/// Cubic Bezier strands that share a cross-section: `segments`, or a binary file.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Curves {
    /// Cross-section.
    #[serde(default = "cylinder")]
    pub kind: CurveKind,
    /// Pieces of strands.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub segments: Vec<CurveSegment>,
    /// A file as `convert` writes it, in place of `segments`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub file: Option<String>,
}

fn cylinder() -> CurveKind {
    CurveKind::Cylinder
}
