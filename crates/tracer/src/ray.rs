//! Rays and hits.

use glam::Vec3;

/// A ray: points `origin + t direction` for 0 < t < `t_max`, at one moment.
#[derive(Clone, Copy, Debug, bytemuck::Pod, bytemuck::Zeroable)]
#[repr(C, align(32))]
pub struct Ray {
    /// Start.
    pub origin: Vec3,
    /// Need not be of unit length: t is in units of it.
    pub direction: Vec3,
    /// Upper end, exclusive.
    pub t_max: f32,
    /// Seconds.
    pub time: f32,
}

impl Ray {
    /// Without an end.
    #[inline]
    pub fn new(origin: Vec3, direction: Vec3, time: f32) -> Ray {
        Ray {
            origin,
            direction,
            t_max: f32::INFINITY,
            time,
        }
    }
}

/// No instance, no primitive.
pub const NONE: u32 = u32::MAX;

/// Where a ray hits first: smallest (t, instance, primitive).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Hit {
    /// Ray parameter; `t_max` of the ray while nothing is hit.
    pub t: f32,
    /// Placed group, or [`NONE`] for what is in the world directly.
    pub instance: u32,
    /// Primitive of the world or of the group; [`NONE`] while nothing is hit.
    pub prim: u32,
    /// Barycentric weight of the second corner (of the surface's own parameters for other shapes).
    pub u: f32,
    /// Barycentric weight of the third corner.
    pub v: f32,
}

impl Hit {
    /// Nothing yet.
    #[inline]
    pub fn none(t_max: f32) -> Hit {
        Hit {
            t: t_max,
            instance: NONE,
            prim: NONE,
            u: 0.0,
            v: 0.0,
        }
    }
    /// Whether something is hit.
    #[inline]
    pub fn is_some(&self) -> bool {
        self.prim != NONE
    }
}
