//! Lambert on both sides: paper, leaves.

use super::BsdfSample;
use crate::math::{INV_PI, Rgb, mean};
use crate::sampling::cosine_hemisphere;
use glam::{Vec2, Vec3};

/// f = r / pi on the side of `wo`, t / pi on the other.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct DiffuseTransmission {
    r: Rgb,
    t: Rgb,
    /// Probability of reflection.
    p: f32,
}

impl DiffuseTransmission {
    /// With the fractions `r` sent back and `t` sent through; r + t <= 1 conserves energy.
    #[inline]
    pub fn new(r: Rgb, t: Rgb) -> Self {
        let sum = mean(r) + mean(t);
        let p = if sum > 0.0 { mean(r) / sum } else { 1.0 };
        DiffuseTransmission { r, t, p }
    }

    #[inline]
    pub(super) fn eval_pdf(&self, wo: Vec3, wi: Vec3) -> (Rgb, f32) {
        let cos = wi.z.abs() * INV_PI;
        if wo.z * wi.z > 0.0 {
            (self.r * cos, self.p * cos)
        } else {
            (self.t * cos, (1.0 - self.p) * cos)
        }
    }

    #[inline]
    pub(super) fn sample(&self, wo: Vec3, u_lobe: f32, u: Vec2) -> Option<BsdfSample> {
        let wi = cosine_hemisphere(u);
        if wi.z <= 0.0 || wo.z == 0.0 {
            return None;
        }
        let transmitted = u_lobe >= self.p;
        let (f, p) = if transmitted {
            (self.t, 1.0 - self.p)
        } else {
            (self.r, self.p)
        };
        let below = (wo.z < 0.0) != transmitted;
        Some(BsdfSample {
            wi: if below { wi.with_z(-wi.z) } else { wi },
            weight: f * (1.0 / p),
            pdf: p * wi.z * INV_PI,
            eta: 1.0,
            delta: false,
            transmitted,
        })
    }

    #[inline]
    pub(super) fn albedo(&self) -> Rgb {
        self.r + self.t
    }
}
