//! Lights that are not shapes.

use super::{ImageId, Rgb, SphereMapping};
use glam::{DAffine3, DVec3};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// A light that is not a shape.
#[derive(Clone, Debug, PartialEq)]
pub enum Light {
    /// Equal radiant intensity in all directions, from the origin of `transform`.
    Point {
        /// Light to world.
        transform: DAffine3,
        /// Power per solid angle.
        intensity: Rgb,
    },
    /// A cone about +Z of light space.
    Spot {
        /// Light to world.
        transform: DAffine3,
        /// Power per solid angle on the axis.
        intensity: Rgb,
        /// Half angle where it is dark, degrees.
        cone_angle: f64,
        /// Half angle up to which it has full strength, degrees.
        full_angle: f64,
        /// Shape between the two angles.
        falloff: SpotFalloff,
    },
    /// Parallel light from infinitely far away.
    Distant {
        /// Direction the light travels in, world space.
        direction: DVec3,
        /// Irradiance on a surface facing it.
        irradiance: Rgb,
    },
    /// Light from all directions.
    Environment {
        /// Light space to world; only its linear part matters.
        transform: DAffine3,
        /// Radiance, or factor on the picture.
        radiance: Rgb,
        /// Picture, if any, and its layout.
        image: Option<(ImageId, SphereMapping)>,
        /// Alpha 0 where it is seen directly.
        hidden: bool,
        /// Scales the picture, before `radiance`, until a surface facing +Z of light space receives this
        /// luminance from it: by pbrt-v4's sum, which counts half of the solid angle of each pixel (so
        /// that a white picture comes out at twice the radiance of a constant sky of the same
        /// illuminance).
        illuminance: Option<f32>,
        /// Corners of a planar rectangle in the world, in order around it. Light is only seen and only
        /// arrives through it, from the side that (p3 - p0) x (p1 - p0) points to. `None` is everywhere.
        portal: Option<[DVec3; 4]>,
    },
    /// From a point with an intensity that depends on the direction (goniometric).
    Goniometric {
        /// Light to world; the middle of the picture is +Y, as pbrt-v4 has it.
        transform: DAffine3,
        /// Power per solid angle where the picture is 1.
        intensity: Rgb,
        /// Square picture in the equal-area octahedral layout; the mean of its channels counts.
        image: ImageId,
        /// Scales the picture, before `intensity`, until it sums to this over the sphere.
        power: Option<f32>,
    },
    /// A picture thrown from a point along +Z of light space, +Y up, +X to its right.
    Projection {
        /// Light to world.
        transform: DAffine3,
        /// Power per solid angle where the picture is 1.
        intensity: Rgb,
        /// What is thrown.
        image: ImageId,
        /// Full angle over the shorter side of the picture, degrees.
        fov: f64,
        /// Scales the picture, before `intensity`, until its luminance sums to this over the solid
        /// angle that it fills.
        power: Option<f32>,
    },
}

/// Shape of a spot light's edge. With c the cosine of the angle to the axis, c0 of `cone_angle`, c1
/// of `full_angle`, x = (c - c0) / (c1 - c0) clamped.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case", deny_unknown_fields)]
pub enum SpotFalloff {
    /// x^2 (3 - 2x), pbrt.
    SmoothStep,
    /// x^2, glTF.
    Squared,
}
