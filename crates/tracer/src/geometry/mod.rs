//! Shapes: what surfaces there are and what is known about a point on one.

pub mod curves;
pub mod interaction;
pub mod mesh;
pub mod quadric;
pub mod transform;

pub use interaction::Interaction;
pub use mesh::TriMesh;

use crate::ray::NONE;
use scene::model::FloatTex;

/// A shape with its material, as it lies in a tree.
#[derive(Clone, Debug)]
pub struct Surface {
    /// Index into the meshes, or [`NONE`] for curves and quadrics.
    pub mesh: u32,
    /// Index into the sets of curves, or [`NONE`].
    pub curves: u32,
    /// Index into the materials.
    pub material: u32,
    /// Coverage, if it is not solid.
    pub alpha: Option<FloatTex>,
    /// The geometric normal of triangles without vertex normals, and of quadrics, is turned round.
    pub flip: bool,
    /// Media inside and outside where the surface is their border, [`NONE`] for vacuum.
    pub media: Option<[u32; 2]>,
    /// Light of triangle i is `light_of[first_light + i]`; [`NONE`] for what does not shine.
    pub first_light: u32,
    /// Index into the emissions, or [`NONE`].
    pub emission: u32,
}

impl Surface {
    /// Whether it gives off light.
    pub fn shines(&self) -> bool {
        self.emission != NONE
    }
}
