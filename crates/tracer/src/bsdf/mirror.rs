//! A perfect mirror.

use super::BsdfSample;
use crate::math::Rgb;
use glam::Vec3;

/// A delta lobe in the mirror direction.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Mirror {
    r: Rgb,
}

impl Mirror {
    /// Reflecting the fraction `r`.
    #[inline]
    pub fn new(r: Rgb) -> Self {
        Mirror { r }
    }

    #[inline]
    pub(super) fn sample(&self, wo: Vec3) -> Option<BsdfSample> {
        if wo.z == 0.0 {
            return None;
        }
        Some(BsdfSample {
            delta: true,
            ..BsdfSample::reflected(Vec3::new(-wo.x, -wo.y, wo.z), self.r, 1.0)
        })
    }

    #[inline]
    pub(super) fn albedo(&self) -> Rgb {
        self.r
    }
}
