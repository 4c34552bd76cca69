//! Modified Phong: a Lambertian part and a cosine lobe about the mirror direction
//! [LafortuneWillems94]. 'Modified', because the lobe is a BRDF (it is multiplied by the cosine), and
//! normalised so that it conserves energy at normal incidence.

use super::{BsdfSample, above, to_side_of};
use crate::math::{Frame, INV_2PI, INV_PI, Rgb, luminance, powf, sqr};
use crate::sampling::{cosine_hemisphere, power_cosine};
use glam::{Vec2, Vec3};

/// f = kd / pi + ks (n + 2) / (2 pi) cos^n(alpha), alpha the angle from the mirror direction to `wi`;
/// conserves energy where kd + ks <= 1.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Phong {
    kd: Rgb,
    ks: Rgb,
    n: f32,
}

impl Phong {
    /// With the diffuse and specular albedo and the exponent n >= 0.
    #[inline]
    pub fn new(kd: Rgb, ks: Rgb, n: f32) -> Self {
        Phong {
            kd,
            ks,
            n: n.max(0.0),
        }
    }

    /// The mirror ray, jittered: density (n + 1) / (2 pi) cos^n(alpha) over the whole sphere, exactly
    /// the shape of the lobe. May lie below the surface.
    #[inline]
    pub(super) fn jitter(mirror: Vec3, n: f32, u: Vec2) -> Vec3 {
        Frame::from_normal(mirror).to_world(power_cosine(u, n))
    }

    /// Albedo of the lobe for ks = 1, about: 1 at normal incidence; towards the horizon it falls like
    /// the cosine where the lobe is sharp, and to a half where it is constant (n = 0).
    #[inline]
    fn lobe_albedo(&self, cos: f32) -> f32 {
        cos + 0.5 * (1.0 - cos) / sqr(1.0 + 0.5 * self.n)
    }

    /// Probability of the diffuse part.
    #[inline]
    fn diffuse_probability(&self, cos: f32) -> f32 {
        let d = luminance(self.kd);
        let s = luminance(self.ks) * self.lobe_albedo(cos);
        if d + s > 0.0 { d / (d + s) } else { 1.0 }
    }

    /// f |cos| and the density for `wo` above and `wi` anywhere; the lobe's density goes on below the
    /// surface, where its samples are lost.
    #[inline]
    fn eval_above(&self, wo: Vec3, wi: Vec3, p_diffuse: f32) -> (Rgb, f32) {
        let cos_lobe = wo.z * wi.z - wo.x * wi.x - wo.y * wi.y;
        let lobe = if cos_lobe > 0.0 {
            powf(cos_lobe.min(1.0), self.n) * INV_2PI
        } else {
            0.0
        };
        let cos = wi.z.max(0.0);
        (
            (self.kd * INV_PI + self.ks * ((self.n + 2.0) * lobe)) * cos,
            p_diffuse * cos * INV_PI + (1.0 - p_diffuse) * (self.n + 1.0) * lobe,
        )
    }

    #[inline]
    pub(super) fn eval_pdf(&self, wo: Vec3, wi: Vec3) -> (Rgb, f32) {
        if wo.z == 0.0 {
            return (Rgb::ZERO, 0.0);
        }
        let (wo, wi) = (to_side_of(wo, wo), to_side_of(wo, wi));
        self.eval_above(wo, wi, self.diffuse_probability(wo.z))
    }

    #[inline]
    pub(super) fn sample(&self, wo: Vec3, u_lobe: f32, u: Vec2) -> Option<BsdfSample> {
        let wo_up = wo.with_z(wo.z.abs());
        let p = self.diffuse_probability(wo_up.z);
        let wi = if u_lobe < p {
            cosine_hemisphere(u)
        } else {
            Self::jitter(Vec3::new(-wo.x, -wo.y, wo_up.z), self.n, u)
        };
        above(wo_up, wi)?;
        let (f, pdf) = self.eval_above(wo_up, wi, p);
        if pdf <= 0.0 {
            return None;
        }
        Some(BsdfSample::reflected(
            to_side_of(wo, wi),
            f * (1.0 / pdf),
            pdf,
        ))
    }

    /// Leaves out the exact shape of what the horizon cuts off.
    #[inline]
    pub(super) fn albedo(&self, wo: Vec3) -> Rgb {
        self.kd + self.ks * self.lobe_albedo(wo.z.abs())
    }
}
