//! Foreign formats, one a module.

pub mod gltf;
#[cfg(test)]
mod mutations;
pub(crate) mod nanovdb;
pub mod obj;
pub mod pbrt;
pub mod ply;
pub(crate) mod stage;

use crate::context::{Context, Issue};
use crate::diagnostic::Place;
use crate::model::{BsdfDesc, ColorTex, Motion, Primitive, SceneDesc, Shape, Texture, TextureId};

/// What a reader of a format with optional views returns.
pub(crate) struct Imported {
    /// Everything but meshes and pictures, which the context holds.
    pub desc: SceneDesc,
    /// Whether the file has a camera.
    pub has_camera: bool,
}

/// A PLY file as a scene of its own: one mesh, grey where it has no colours.
pub(crate) fn ply_scene(main: &str, cx: &mut Context<'_>) -> Result<Imported, Issue> {
    let place = Place {
        file: main.to_owned(),
        ..Place::default()
    };
    let mesh = cx.ply_mesh(&place, main, true)?;
    let colored = !mesh.colors.is_empty();
    let id = cx.add_mesh(&place, mesh)?;
    let mut desc = stage::empty();
    let surface = obj::grey("grey", &mut desc.materials);
    if colored && let BsdfDesc::Principled(p) = &mut desc.materials[0].bsdf {
        desc.textures.push(Texture::VertexColor);
        p.base_color = ColorTex::Texture(TextureId(0));
    }
    desc.primitives.push(Primitive {
        shape: Shape::Mesh(id),
        transform: Motion::identity(),
        material: surface.material,
        emission: None,
        alpha: None,
        reverse_orientation: false,
        media: None,
    });
    Ok(Imported {
        desc,
        has_camera: false,
    })
}
