//! Rough diffuse surfaces: V-shaped grooves of Lambertian facets, in the 'qualitative' form
//! [OrenNayar94, eq. 30]: without the terms for light that bounces between facets.

use super::{BsdfSample, above, to_side_of};
use crate::math::{FRAC_PI_2, INV_PI, PI, Rgb, acos, safe_sqrt, sqr};
use crate::sampling::cosine_hemisphere;
use glam::{Vec2, Vec3};

/// f = r / pi (A + B max(0, cos(phi_i - phi_o)) sin(alpha) tan(beta)), alpha the larger and beta the
/// smaller of the two polar angles.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct OrenNayar {
    r: Rgb,
    a: f32,
    b: f32,
}

impl OrenNayar {
    /// With the albedo `r` of the facets and the standard deviation of their slope angle in degrees.
    #[inline]
    pub fn new(r: Rgb, sigma_degrees: f32) -> Self {
        let s2 = sqr(sigma_degrees * (PI / 180.0));
        OrenNayar {
            r,
            a: 1.0 - s2 / (2.0 * (s2 + 0.33)),
            b: 0.45 * s2 / (s2 + 0.09),
        }
    }

    /// pi f for directions above.
    #[inline]
    fn shape(&self, wo: Vec3, wi: Vec3) -> f32 {
        // sin(theta_o) sin(theta_i) cos(phi_i - phi_o), over the larger cosine.
        let along = (wo.x * wi.x + wo.y * wi.y).max(0.0);
        self.a + self.b * along / wo.z.max(wi.z)
    }

    #[inline]
    pub(super) fn eval_pdf(&self, wo: Vec3, wi: Vec3) -> (Rgb, f32) {
        let Some((wo, wi)) = above(wo, wi) else {
            return (Rgb::ZERO, 0.0);
        };
        let pdf = wi.z * INV_PI;
        (self.r * (self.shape(wo, wi) * pdf), pdf)
    }

    #[inline]
    pub(super) fn sample(&self, wo: Vec3, u: Vec2) -> Option<BsdfSample> {
        let wi = to_side_of(wo, cosine_hemisphere(u));
        let (wo_up, wi_up) = above(wo, wi)?;
        let weight = self.r * self.shape(wo_up, wi_up);
        Some(BsdfSample::reflected(wi, weight, wi_up.z * INV_PI))
    }

    /// Exact: with t the angle of `wo`, the integral of the second term over the hemisphere is
    /// (2 sin t / pi) ((t - sin t cos t) / 2 + (1 - sin^3 t) / (3 cos t)).
    pub(super) fn albedo(&self, wo: Vec3) -> Rgb {
        let cos = wo.z.abs().min(1.0);
        let sin = safe_sqrt(1.0 - cos * cos);
        // 1 - sin^3 = (1 - sin)(1 + sin + sin^2), and 1 - sin = cos^2 / (1 + sin).
        let rim = cos * (1.0 + sin + sin * sin) / (3.0 * (1.0 + sin));
        let t = if cos > 0.0 { acos(cos) } else { FRAC_PI_2 };
        let g = 2.0 * sin * INV_PI * (0.5 * (t - sin * cos) + rim);
        self.r * (self.a + self.b * g)
    }
}
