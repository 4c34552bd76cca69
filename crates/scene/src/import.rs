//! Foreign formats, one a module.

pub mod gltf;
pub mod pbrt;
pub mod ply;
pub(crate) mod stage;

use crate::model::SceneDesc;

/// What a reader of a format with optional views returns.
pub(crate) struct Imported {
    /// Everything but meshes and pictures, which the context holds.
    pub desc: SceneDesc,
    /// Whether the file has a camera.
    pub has_camera: bool,
}
