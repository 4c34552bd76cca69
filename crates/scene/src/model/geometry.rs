//! Shapes and where they are placed.

use super::{ColorTex, CurvesId, FloatTex, GroupId, MaterialId, MediumInterface, MeshId, Motion};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use std::sync::Arc;

/// A triangle mesh. Vertex attributes are either empty or one for every vertex.
#[derive(Clone, Debug, PartialEq, Default)]
pub struct Mesh {
    /// For messages.
    pub name: String,
    /// Vertex positions; with deformation, those of the first key.
    pub positions: Arc<Vec<[f32; 3]>>,
    /// Shading normals.
    pub normals: Arc<Vec<[f32; 3]>>,
    /// Tangents; w is the sign of the bitangent.
    pub tangents: Arc<Vec<[f32; 4]>>,
    /// Texture coordinates, by set; (0, 0) is the bottom left of a picture.
    pub uvs: Vec<Arc<Vec<[f32; 2]>>>,
    /// Colours, linear RGBA.
    pub colors: Arc<Vec<[f32; 4]>>,
    /// Corners of the triangles.
    pub indices: Arc<Vec<[u32; 3]>>,
    /// Further keys of a deforming mesh, times rising strictly after `first_time`.
    pub deformation: Option<Arc<Deformation>>,
}

impl Mesh {
    /// Memory of its arrays, each counted even where another mesh shares it.
    pub fn memory_bytes(&self) -> u64 {
        let deformation = self.deformation.as_ref().map_or(0, |d| {
            d.keys
                .iter()
                .map(|k| (k.positions.len() + k.normals.len()) as u64 * 12)
                .sum::<u64>()
        });
        (self.positions.len() * 12
            + self.normals.len() * 12
            + self.tangents.len() * 16
            + self.uvs.iter().map(|uv| uv.len() * 8).sum::<usize>()
            + self.colors.len() * 16
            + self.indices.len() * 12) as u64
            + deformation
    }
}

/// Vertices of a deforming mesh over time; linear between keys.
#[derive(Clone, Debug, PartialEq)]
pub struct Deformation {
    /// Time of [`Mesh::positions`], seconds.
    pub first_time: f64,
    /// The other keys.
    pub keys: Vec<DeformationKey>,
}

/// One further key of a deforming mesh.
#[derive(Clone, Debug, PartialEq)]
pub struct DeformationKey {
    /// Seconds.
    pub time: f64,
    /// One for every vertex.
    pub positions: Vec<[f32; 3]>,
    /// One for every vertex, or empty.
    pub normals: Vec<[f32; 3]>,
}

/// A shape with its surface, placed.
#[derive(Clone, Debug, PartialEq)]
pub struct Primitive {
    /// Geometry in local space.
    pub shape: Shape,
    /// Local to parent (world, or the group).
    pub transform: Motion,
    /// Surface.
    pub material: MaterialId,
    /// Light given off, beside what the material reflects.
    pub emission: Option<Emission>,
    /// Coverage: a ray passes where a uniform number exceeds it.
    pub alpha: Option<FloatTex>,
    /// The outside becomes the inside (swaps the geometric normal).
    pub reverse_orientation: bool,
    /// Where the surface is the border of media; `None` where a ray that crosses it stays in what
    /// it is in.
    pub media: Option<MediumInterface>,
}

/// Cubic Bezier strands that share a cross-section.
#[derive(Clone, Debug, PartialEq)]
pub struct Curves {
    /// For messages.
    pub name: String,
    /// Cross-section.
    pub kind: CurveKind,
    /// Pieces of strands.
    pub segments: Arc<Vec<CurveSegment>>,
}

/// Cross-section of a curve.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case", deny_unknown_fields)]
pub enum CurveKind {
    /// Turned towards the ray, shaded as flat.
    Flat,
    /// Turned towards the ray, shaded as round.
    Cylinder,
    /// Fixed across: the normals say how it lies.
    Ribbon,
}

/// One cubic Bezier piece of a strand.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct CurveSegment {
    /// Control points, local space.
    pub points: [[f32; 3]; 4],
    /// Full width at the start and the end, scene units; linear between.
    pub width: [f32; 2],
    /// Texture coordinate u (along the strand) at the start and the end; v runs across from 0 to 1.
    #[serde(default = "whole")]
    pub u: [f32; 2],
    /// Normals of a ribbon at the start and the end; zero for the other kinds.
    #[serde(default)]
    pub normals: [[f32; 3]; 2],
}

fn whole() -> [f32; 2] {
    [0.0, 1.0]
}

/// Geometry in local space.
#[derive(Clone, Debug, PartialEq)]
pub enum Shape {
    /// A triangle mesh. The geometric normal is (p1 - p0) x (p2 - p0), turned to the side of the
    /// shading normals where the mesh has them.
    Mesh(MeshId),
    /// A full sphere about the origin; normal outward. uv: pbrt's (phi / 360, from the south pole
    /// (-Z) at v = 0 to the north pole at v = 1).
    Sphere {
        /// Scene units.
        radius: f64,
    },
    /// Points with x^2 + y^2 between the radii squared, at z = `height`; normal +Z.
    Disk {
        /// Scene units.
        radius: f64,
        /// Radius of the hole, or 0.
        inner_radius: f64,
        /// Along z.
        height: f64,
    },
    /// The square [-1, 1]^2 at z = 0; normal +Z; uv from (0, 0) at (-1, -1) to (1, 1).
    Rectangle,
    /// A bundle of curves.
    Curves(CurvesId),
}

/// Light given off by a surface.
#[derive(Clone, Debug, PartialEq)]
pub struct Emission {
    /// Radiance; a texture is multiplied by `scale`.
    pub radiance: ColorTex,
    /// Factor.
    pub scale: f32,
    /// Both sides shine, otherwise the side of the geometric normal.
    pub two_sided: bool,
}

/// Shapes that are placed together.
#[derive(Clone, Debug, PartialEq, Default)]
pub struct Group {
    /// For messages.
    pub name: String,
    /// Their transforms are relative to the group.
    pub primitives: Vec<Primitive>,
    /// Nested instances (no cycles; checked).
    pub instances: Vec<Instance>,
}

/// A placed group.
#[derive(Clone, Debug, PartialEq)]
pub struct Instance {
    /// What is placed.
    pub group: GroupId,
    /// Group to parent.
    pub transform: Motion,
}
