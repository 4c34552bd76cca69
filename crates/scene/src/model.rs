//! The scene as plain data: flat lists, typed indices, no pointers. Readers fill it, `validate`
//! checks it, the tracer prepares it. Lengths in scene units, angles in degrees, time in seconds,
//! colours linear Rec. 709, right-handed coordinates, everything here in double precision where it
//! is placed and in single precision where it is bulk data.

mod geometry;
mod light;
mod material;
mod media;
mod texture;
mod view;

pub use geometry::*;
pub use light::*;
pub use material::*;
pub use media::*;
pub use texture::*;
pub use view::*;

use glam::DAffine3;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// Linear Rec. 709 red, green, blue.
pub type Rgb = [f32; 3];

macro_rules! index {
    ($($(#[$doc:meta])* $name:ident),* $(,)?) => {$(
        $(#[$doc])*
        #[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
        pub struct $name(pub u32);
        impl $name {
            /// As an index into the list that it names.
            pub fn index(self) -> usize { self.0 as usize }
        }
    )*};
}
index! {
    /// Index into [`SceneDesc::meshes`].
    MeshId,
    /// Index into [`SceneDesc::images`].
    ImageId,
    /// Index into [`SceneDesc::textures`].
    TextureId,
    /// Index into [`SceneDesc::materials`].
    MaterialId,
    /// Index into [`SceneDesc::groups`].
    GroupId,
    /// Index into [`SceneDesc::media`].
    MediumId,
    /// Index into [`SceneDesc::curves`].
    CurvesId,
}

/// A whole scene.
#[derive(Clone, Debug, PartialEq)]
pub struct SceneDesc {
    /// The view that is rendered.
    pub camera: Camera,
    /// Picture size, filter, exposure.
    pub film: FilmDesc,
    /// How light is gathered.
    pub integrator: Integrator,
    /// Which points a pixel is sampled at.
    pub sampler: SamplerKind,
    /// Samples per pixel that the file asks for.
    pub spp: Option<u32>,
    /// Animation, if the scene has more than one frame.
    pub animation: Option<Animation>,
    /// Triangle meshes.
    pub meshes: Vec<Mesh>,
    /// Pictures, by path.
    pub images: Vec<ImageDesc>,
    /// Textures; a texture refers only to textures before it.
    pub textures: Vec<Texture>,
    /// Materials; a material refers only to materials before it.
    pub materials: Vec<Material>,
    /// Participating media.
    pub media: Vec<Medium>,
    /// Bundles of hair, fur, grass.
    pub curves: Vec<Curves>,
    /// Shapes placed in the world directly.
    pub primitives: Vec<Primitive>,
    /// Sets of shapes that are placed by instances.
    pub groups: Vec<Group>,
    /// Placed groups.
    pub instances: Vec<Instance>,
    /// Lights that are not shapes.
    pub lights: Vec<Light>,
}

/// Frames of an animation. Frame `n` opens the shutter at `start + n / fps + shutter.0`.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Animation {
    /// Frames per second.
    pub fps: f64,
    /// Time of frame 0, seconds.
    pub start: f64,
    /// First and last frame number that the file suggests, inclusive.
    pub frames: (u32, u32),
}

/// A transform over time: one key is a fixed transform. Between keys translation and scale (with
/// shear) are interpolated linearly and rotation spherically; before the first and after the last
/// key the nearest one holds. Times rise strictly, in seconds.
#[derive(Clone, Debug, PartialEq)]
pub struct Motion {
    /// At least one.
    pub keys: Vec<MotionKey>,
}

/// One key of a [`Motion`].
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MotionKey {
    /// Seconds.
    pub time: f64,
    /// Local to parent.
    pub transform: DAffine3,
}

impl Motion {
    /// No motion.
    pub fn fixed(transform: DAffine3) -> Self {
        Motion {
            keys: vec![MotionKey {
                time: 0.0,
                transform,
            }],
        }
    }
    /// No motion, no placement.
    pub fn identity() -> Self {
        Self::fixed(DAffine3::IDENTITY)
    }
    /// Whether it has more than one key.
    pub fn is_moving(&self) -> bool {
        self.keys.len() > 1
    }
}
