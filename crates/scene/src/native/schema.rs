//! The JSON of a scene as types. The JSON Schema in `api/` is generated from them.

mod defaults;
mod media;
mod principled;
mod shapes;
mod surfaces;

pub use media::{Curves, Grid, Medium, MediumGrid, MediumInterface};
pub use principled::{Hair, HairColor, Principled};
pub use shapes::{Emission, Group, Instance, Mesh, Primitive, Shape};
pub use surfaces::{Bsdf, Coat, Fresnel, Map, Material, NormalMap, Roughness, Texture};

use super::values::{Color, Named, Placement};
use crate::model::{
    Animation, Aperture, Filter, FovAxis, SamplerKind, ScreenWindow, ShutterCurve, SphereMapping,
    SpotFalloff,
};
use defaults::{no, one, white_color};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// A Brolly scene. Lengths in scene units, angles in degrees, time in seconds, +Y up, right-handed.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Scene {
    /// Version of the format: 1.
    pub brolly: u32,
    /// The view.
    pub camera: Camera,
    /// Picture size and pixel filter.
    #[serde(default)]
    pub film: Film,
    /// How light is gathered.
    #[serde(default)]
    pub integrator: Integrator,
    /// Which points a pixel is sampled at.
    #[serde(default)]
    pub sampler: SamplerKind,
    /// Samples per pixel.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub spp: Option<u32>,
    /// Frames, if there is more than one.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub animation: Option<Animation>,
    /// Pictures that are given names; others are named by their path where they are used.
    #[serde(default, skip_serializing_if = "Named::is_empty")]
    pub images: Named<Image>,
    /// Textures; one refers only to those before it.
    #[serde(default, skip_serializing_if = "Named::is_empty")]
    pub textures: Named<Texture>,
    /// Materials; one refers only to those before it.
    #[serde(default, skip_serializing_if = "Named::is_empty")]
    pub materials: Named<Material>,
    /// Participating media.
    #[serde(default, skip_serializing_if = "Named::is_empty")]
    pub media: Named<Medium>,
    /// Meshes.
    #[serde(default, skip_serializing_if = "Named::is_empty")]
    pub meshes: Named<Mesh>,
    /// Bundles of hair, fur, grass.
    #[serde(default, skip_serializing_if = "Named::is_empty")]
    pub curves: Named<Curves>,
    /// Groups of shapes, for instances.
    #[serde(default, skip_serializing_if = "Named::is_empty")]
    pub groups: Named<Group>,
    /// Shapes in the world.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub primitives: Vec<Primitive>,
    /// Placed groups.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub instances: Vec<Instance>,
    /// Lights that are not shapes.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub lights: Vec<Light>,
}

/// The camera: `look_from`, `look_at`, `up`, or a `transform` of a camera that looks along -Z.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Camera {
    /// Eye.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub look_from: Option<[f64; 3]>,
    /// Target.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub look_at: Option<[f64; 3]>,
    /// Up direction; +Y by default.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub up: Option<[f64; 3]>,
    /// Camera to world, in place of the three above.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub transform: Option<Placement>,
    /// Vertical field of view, degrees; 40 by default.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub vfov: Option<f64>,
    /// Any projection, in place of `vfov`.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub projection: Option<Projection>,
    /// Thin lens.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub lens: Option<Lens>,
    /// Opening and closing, seconds.
    pub shutter: (f64, f64),
    /// How much the shutter lets through over time.
    pub shutter_curve: ShutterCurve,
    /// What fills the space around the camera: the name of a medium; vacuum by default.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub medium: Option<String>,
}

/// How points of the picture become rays.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case", deny_unknown_fields)]
pub enum Projection {
    /// Pinhole or thin lens.
    Perspective {
        /// Degrees.
        fov: f64,
        /// The side that it covers.
        fov_axis: FovAxis,
        /// Another frame, in units of tan(fov/2).
        #[serde(default, skip_serializing_if = "Option::is_none")]
        window: Option<ScreenWindow>,
    },
    /// Parallel rays.
    Orthographic {
        /// Half the height of the view.
        half_height: f64,
        /// Another frame, in scene units.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        window: Option<ScreenWindow>,
    },
    /// All directions.
    Spherical {
        /// Layout on the picture.
        mapping: SphereMapping,
    },
}

/// A thin lens.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Lens {
    /// Radius of the aperture.
    pub radius: f64,
    /// Distance of the plane in focus.
    pub focus_distance: f64,
    /// Shape of the aperture.
    #[serde(default = "disk")]
    pub aperture: Aperture,
    /// Horizontal squeeze; 1 is round.
    #[serde(default = "one")]
    pub anamorphic: f64,
}

fn disk() -> Aperture {
    Aperture::Disk
}

/// Picture and filter.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Film {
    /// Width and height in pixels.
    pub size: [u32; 2],
    /// The part that is rendered: x0, y0, x1, y1.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub crop: Option<[u32; 4]>,
    /// Reconstruction filter.
    pub filter: Filter,
    /// Factor on all radiance.
    pub exposure: Color,
    /// Bound on the brightness of samples; biased.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub max_component: Option<f32>,
}

impl Default for Film {
    fn default() -> Self {
        let filter = Filter::BlackmanHarris { radius: (1.5, 1.5) };
        Film {
            size: [1280, 720],
            crop: None,
            filter,
            exposure: white_color(),
            max_component: None,
        }
    }
}

/// How light is gathered.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Integrator {
    /// path, guided, direct, whitted, normals, albedo, depth or uv.
    pub name: String,
    /// Bounces that are followed.
    pub max_depth: u32,
}

impl Default for Integrator {
    fn default() -> Self {
        Integrator {
            name: "path".into(),
            max_depth: crate::apply::DEFAULT_DEPTH,
        }
    }
}

/// A picture file.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Image {
    /// Path beside the scene.
    pub file: String,
    /// How stored numbers become linear ones.
    #[serde(default)]
    pub encoding: Encoding,
}

/// How the stored numbers of a picture become linear ones.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case", deny_unknown_fields)]
pub enum Encoding {
    /// sRGB for integers, linear for floats.
    #[default]
    Auto,
    /// sRGB.
    Srgb,
    /// As they are.
    Linear,
    /// A power, in millionths.
    GammaMicros(u32),
}

/// A light that is not a shape.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case", deny_unknown_fields)]
pub enum Light {
    /// From the origin, equally in all directions.
    Point {
        /// Power per solid angle.
        intensity: Color,
        /// Where.
        #[serde(default, skip_serializing_if = "Placement::is_identity")]
        transform: Placement,
    },
    /// A cone about +Z.
    Spot {
        /// Power per solid angle on the axis.
        intensity: Color,
        /// Half angle where it is dark.
        cone_angle: f64,
        /// Half angle of full strength.
        full_angle: f64,
        /// Shape of the edge.
        #[serde(default = "smooth")]
        falloff: SpotFalloff,
        /// Where.
        #[serde(default, skip_serializing_if = "Placement::is_identity")]
        transform: Placement,
    },
    /// Parallel light.
    Distant {
        /// The way that it travels.
        direction: [f64; 3],
        /// On a surface facing it.
        irradiance: Color,
    },
    /// From all directions.
    Environment {
        /// Radiance, or factor on the picture.
        #[serde(default = "white_color")]
        radiance: Color,
        /// The name of a picture, or a path.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        image: Option<String>,
        /// Its layout.
        #[serde(default = "lat_long")]
        mapping: SphereMapping,
        /// How it is turned.
        #[serde(default, skip_serializing_if = "Placement::is_identity")]
        transform: Placement,
        /// Alpha 0 where it is seen directly.
        #[serde(default, skip_serializing_if = "no")]
        hidden: bool,
        /// Scales the picture until a surface facing +Z receives this from it.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        illuminance: Option<f32>,
        /// Corners of the only rectangle in the world that it comes in through.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        portal: Option<[[f64; 3]; 4]>,
    },
    /// A point whose intensity depends on the direction.
    Goniometric {
        /// Power per solid angle where the picture is 1.
        #[serde(default = "white_color")]
        intensity: Color,
        /// The name of a square octahedral picture, or a path.
        image: String,
        /// Scales the picture until it sums to this over the sphere.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        power: Option<f32>,
        /// Where.
        #[serde(default, skip_serializing_if = "Placement::is_identity")]
        transform: Placement,
    },
    /// A picture thrown along +Z.
    Projection {
        /// Power per solid angle where the picture is 1.
        #[serde(default = "white_color")]
        intensity: Color,
        /// The name of a picture, or a path.
        image: String,
        /// Full angle over the shorter side, degrees.
        fov: f64,
        /// Scales the picture until its luminance sums to this over the solid angle it fills.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        power: Option<f32>,
        /// Where.
        #[serde(default, skip_serializing_if = "Placement::is_identity")]
        transform: Placement,
    },
}

fn smooth() -> SpotFalloff {
    SpotFalloff::SmoothStep
}
fn lat_long() -> SphereMapping {
    SphereMapping::LatLong
}

/// The JSON Schema of a scene, as text that ends in a line break.
pub fn schema() -> String {
    let schema = schemars::schema_for!(Scene);
    // A schema is made of maps with string keys: writing it cannot fail.
    serde_json::to_string_pretty(&schema)
        .map(|text| text + "\n")
        .unwrap_or_default()
}
