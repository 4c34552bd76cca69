//! The view: camera, film, integrator, sampler.

use super::{MediumId, Motion, Rgb};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// The camera. In its own space it sits at the origin, looks along -Z, +X is right and +Y is up.
#[derive(Clone, Debug, PartialEq)]
pub struct Camera {
    /// Camera to world; may mirror (pbrt files with `Scale -1 1 1`).
    pub transform: Motion,
    /// How points of the picture become rays.
    pub projection: Projection,
    /// Shutter opening and closing, seconds (relative to the frame's time in an animation).
    pub shutter: (f64, f64),
    /// How much the shutter lets through over its interval.
    pub shutter_curve: ShutterCurve,
    /// What fills the space around the camera; `None` is vacuum.
    pub medium: Option<MediumId>,
}

/// Transmission over the normalised shutter interval [0, 1].
#[derive(Clone, Debug, PartialEq, Default, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case", deny_unknown_fields)]
pub enum ShutterCurve {
    /// Open at once, closed at once.
    #[default]
    Box,
    /// Opens linearly over the first part, closes linearly over the last; fractions of the interval.
    Trapezoid {
        /// Fraction spent opening.
        open: f64,
        /// Fraction spent closing.
        close: f64,
    },
}

/// The part of the image plane that the picture shows, in the units of the projection, before
/// the frame is flipped to picture coordinates: x right, y up.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct ScreenWindow {
    /// Left, right.
    pub x: (f64, f64),
    /// Bottom, top.
    pub y: (f64, f64),
}

/// How points of the picture become rays.
#[derive(Clone, Debug, PartialEq)]
pub enum Projection {
    /// Pinhole or thin lens.
    Perspective {
        /// Full field of view in degrees over `fov_axis`; the plane at distance 1 spans
        /// [-tan(fov/2), tan(fov/2)] there.
        fov: f64,
        /// Which side of the picture `fov` covers.
        fov_axis: FovAxis,
        /// Replaces the frame derived from the picture's aspect: in units of tan(fov/2).
        window: Option<ScreenWindow>,
        /// Thin lens, if any.
        lens: Option<Lens>,
    },
    /// Parallel rays.
    Orthographic {
        /// Half the height of the view in scene units where `window` is absent.
        half_height: f64,
        /// Replaces the frame, in scene units.
        window: Option<ScreenWindow>,
        /// Thin lens, if any: rays meet at `focus_distance`.
        lens: Option<Lens>,
    },
    /// The whole sphere of directions.
    Spherical {
        /// How the sphere is laid out on the picture.
        mapping: SphereMapping,
    },
}

/// Which side of the picture an angle covers.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case", deny_unknown_fields)]
pub enum FovAxis {
    /// Left to right.
    Horizontal,
    /// Bottom to top.
    Vertical,
    /// The shorter side (pbrt).
    Shorter,
}

/// A thin lens.
#[derive(Clone, Debug, PartialEq)]
pub struct Lens {
    /// Radius of the aperture, scene units.
    pub radius: f64,
    /// Distance of the plane in focus along the viewing direction.
    pub focus_distance: f64,
    /// Shape of the aperture.
    pub aperture: Aperture,
    /// Horizontal squeeze of the aperture: its width is `radius / anamorphic`; 1 is round.
    pub anamorphic: f64,
}

/// Shape of an aperture.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case", deny_unknown_fields)]
pub enum Aperture {
    /// A disk.
    Disk,
    /// A regular polygon inscribed in the disk.
    Blades {
        /// At least 3.
        count: u32,
        /// Degrees.
        rotation: f64,
    },
}

/// How directions are laid out on a picture of the sphere.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case", deny_unknown_fields)]
pub enum SphereMapping {
    /// Latitude and longitude: `u = 0.5 + atan2(z, x) / 2 pi`, `v = acos(y) / pi` from the top row.
    LatLong,
    /// Equal-area octahedral, +Z up in its own space [Clarberg08], as pbrt-v4 does it.
    OctahedralEqualArea,
}

/// Picture and pixel filter.
#[derive(Clone, Debug, PartialEq)]
pub struct FilmDesc {
    /// Pixels.
    pub width: u32,
    /// Pixels.
    pub height: u32,
    /// The part that is rendered: x0, y0, x1, y1 in pixels, upper bounds exclusive. The picture has
    /// the size of this part.
    pub crop: Option<[u32; 4]>,
    /// Reconstruction filter; it is importance sampled.
    pub filter: Filter,
    /// Factor on all radiance (sensor iso, exposure time, imaging ratio), by channel.
    pub exposure: Rgb,
    /// Samples brighter than this are scaled down to it (pbrt's maxcomponentvalue); biased.
    pub max_component: Option<f32>,
}

/// Reconstruction filters; radii in pixels, separable unless said otherwise.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case", deny_unknown_fields)]
pub enum Filter {
    /// Constant.
    Box {
        /// Half width by axis.
        radius: (f64, f64),
    },
    /// Linear fall-off.
    Tent {
        /// Half width by axis.
        radius: (f64, f64),
    },
    /// Truncated Gaussian, lowered so that it ends at zero.
    Gaussian {
        /// Half width by axis.
        radius: (f64, f64),
        /// Standard deviation.
        sigma: f64,
    },
    /// Mitchell-Netravali; has negative lobes.
    Mitchell {
        /// Half width by axis.
        radius: (f64, f64),
        /// Parameter B.
        b: f64,
        /// Parameter C.
        c: f64,
    },
    /// Four-term Blackman-Harris window.
    BlackmanHarris {
        /// Half width by axis.
        radius: (f64, f64),
    },
    /// Windowed sinc (pbrt's LanczosSincFilter).
    LanczosSinc {
        /// Half width by axis.
        radius: (f64, f64),
        /// Lobes before the window ends.
        tau: f64,
    },
}

/// How light is gathered.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Integrator {
    /// The lecture's basic ray tracer [Whitted80]: pixel centre, lens centre, shutter opening, one
    /// shadow ray to every light, mirror and glass followed to `max_depth`.
    Whitted {
        /// Bounces.
        max_depth: u32,
    },
    /// Direct light only, with MIS; perfect mirrors and glass are followed to `max_depth`.
    Direct {
        /// Bounces through mirrors and glass.
        max_depth: u32,
    },
    /// Path tracer with next-event estimation and MIS.
    Path {
        /// Scattering events of a path: 0 sees only emission.
        max_depth: u32,
    },
    /// The same, guided: before the picture is begun, some paths find out where light comes from. For light
    /// that arrives through gaps and round corners.
    Guided {
        /// Scattering events of a path.
        max_depth: u32,
    },
    /// World-space shading normal, mapped from [-1, 1] to [0, 1].
    Normals,
    /// Directional albedo of the first surface.
    Albedo,
    /// Distance along the ray.
    Depth,
    /// Texture coordinates as red and green.
    Uv,
}

/// Which points a pixel is sampled at.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case", deny_unknown_fields)]
pub enum SamplerKind {
    /// An embedded lattice sequence, shifted at random.
    #[default]
    Lattice,
    /// Owen-scrambled Sobol points.
    OwenSobol,
    /// Jittered strata over blocks of 16 samples.
    Stratified,
    /// Independent uniform numbers.
    Independent,
}
