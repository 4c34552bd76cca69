//! Lambert: the same radiance in all directions.

use super::{BsdfSample, above, to_side_of};
use crate::math::{INV_PI, Rgb};
use crate::sampling::cosine_hemisphere;
use glam::{Vec2, Vec3};

/// f = r / pi.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Diffuse {
    r: Rgb,
}

impl Diffuse {
    /// With the albedo `r`.
    #[inline]
    pub fn new(r: Rgb) -> Self {
        Diffuse { r }
    }

    #[inline]
    pub(super) fn eval_pdf(&self, wo: Vec3, wi: Vec3) -> (Rgb, f32) {
        if wo.z * wi.z <= 0.0 {
            return (Rgb::ZERO, 0.0);
        }
        let pdf = wi.z.abs() * INV_PI;
        (self.r * pdf, pdf)
    }

    #[inline]
    pub(super) fn sample(&self, wo: Vec3, u: Vec2) -> Option<BsdfSample> {
        let wi = cosine_hemisphere(u);
        above(wo, to_side_of(wo, wi))?;
        Some(BsdfSample::reflected(
            to_side_of(wo, wi),
            self.r,
            wi.z * INV_PI,
        ))
    }

    /// The albedo.
    #[inline]
    pub(crate) fn albedo(&self) -> Rgb {
        self.r
    }
}
