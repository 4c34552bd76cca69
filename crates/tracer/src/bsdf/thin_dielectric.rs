//! A pane of glass so thin that rays pass unbent: a window.

use super::{BsdfSample, fresnel_dielectric};
use crate::math::Rgb;
use glam::Vec3;

/// Two delta lobes: the mirror direction and straight on.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ThinDielectric {
    eta: f32,
}

impl ThinDielectric {
    /// With the index of refraction of the pane over that of its surroundings.
    #[inline]
    pub fn new(eta: f32) -> Self {
        ThinDielectric { eta }
    }

    /// Fraction reflected by both faces, all reflections between them included:
    /// R + T R T + T R^3 T + ... = R + T^2 R / (1 - R^2).
    #[inline]
    pub(super) fn reflectance(&self, cos: f32) -> f32 {
        let (r, _) = fresnel_dielectric(cos, self.eta);
        if r < 1.0 {
            let t = 1.0 - r;
            r + t * t * r / (1.0 - r * r)
        } else {
            1.0
        }
    }

    #[inline]
    pub(super) fn sample(&self, wo: Vec3, u_lobe: f32) -> Option<BsdfSample> {
        if wo.z == 0.0 {
            return None;
        }
        let r = self.reflectance(wo.z.abs());
        // Each is chosen with its own share, so the weight is 1.
        let transmitted = u_lobe >= r;
        Some(BsdfSample {
            wi: if transmitted {
                -wo
            } else {
                Vec3::new(-wo.x, -wo.y, wo.z)
            },
            weight: Rgb::ONE,
            pdf: if transmitted { 1.0 - r } else { r },
            eta: 1.0,
            delta: true,
            transmitted,
        })
    }

    #[inline]
    pub(super) fn albedo(&self) -> Rgb {
        Rgb::ONE
    }
}
