//! Meshes, shapes, groups.

use super::defaults::{is_one, no, one_f32};
use super::media::MediumInterface;
use crate::native::values::{ColorValue, FloatValue, Placement};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// A mesh: one of `ply`, `buffer` and `positions`.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Mesh {
    /// A PLY file.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub ply: Option<String>,
    /// A binary file as `convert` writes it.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub buffer: Option<String>,
    /// Vertices.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub positions: Option<Vec<[f32; 3]>>,
    /// Normals.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub normals: Vec<[f32; 3]>,
    /// Texture coordinates.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub uvs: Vec<[f32; 2]>,
    /// Linear RGBA.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub colors: Vec<[f32; 4]>,
    /// Triangles.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub indices: Vec<[u32; 3]>,
}

/// Geometry.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case", deny_unknown_fields)]
pub enum Shape {
    /// A mesh by name.
    Mesh(String),
    /// A PLY file.
    Ply(String),
    /// A mesh written here.
    Triangles(Box<Mesh>),
    /// A sphere about the origin.
    Sphere {
        /// Radius.
        radius: f64,
    },
    /// A disk with normal +Z.
    Disk {
        /// Radius.
        radius: f64,
        /// Radius of the hole.
        #[serde(default)]
        inner_radius: f64,
        /// Along z.
        #[serde(default)]
        height: f64,
    },
    /// The square [-1, 1]^2 with normal +Z.
    Rectangle,
    /// A bundle of curves by name.
    Curves(String),
}

/// Light given off.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Emission {
    /// Radiance.
    pub radiance: ColorValue,
    /// Factor.
    #[serde(default = "one_f32", skip_serializing_if = "is_one")]
    pub scale: f32,
    /// Both sides shine.
    #[serde(default, skip_serializing_if = "no")]
    pub two_sided: bool,
}

/// A shape with its surface.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Primitive {
    /// Geometry.
    pub shape: Shape,
    /// The name of a material.
    pub material: String,
    /// Where.
    #[serde(default, skip_serializing_if = "Placement::is_identity")]
    pub transform: Placement,
    /// Light given off.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub emission: Option<Emission>,
    /// Coverage.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub alpha: Option<FloatValue>,
    /// The outside becomes the inside.
    #[serde(default, skip_serializing_if = "no")]
    pub reverse_orientation: bool,
    /// The media on its two sides; absent where a ray that crosses it stays in what it is in.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub media: Option<MediumInterface>,
}

/// Shapes that are placed together.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Group {
    /// Shapes.
    pub primitives: Vec<Primitive>,
    /// Groups inside this one.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub instances: Vec<Instance>,
}

/// A placed group.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Instance {
    /// The group's name.
    pub group: String,
    /// Where.
    #[serde(default, skip_serializing_if = "Placement::is_identity")]
    pub transform: Placement,
}
