//! Lambert under a dielectric layer: plastic, lacquer, wet stone. The mean of pbrt-v4's `coateddiffuse`
//! without its noise; [`CoatTable`] has the derivation.

use super::ggx::mirrored;
use super::{BsdfSample, CoatTable, Ggx, above, fresnel_dielectric, to_side_of};
use crate::math::{INV_PI, PI, Rgb, luminance, sqr};
use crate::sampling::cosine_hemisphere;
use glam::{Vec2, Vec3};

/// The boundary's reflection (a delta lobe where it is smooth) plus T(wo) T(wi) times a constant.
#[derive(Clone, Copy, Debug)]
pub struct CoatedDiffuse<'s> {
    /// Factor on T(wo) T(wi): r sum (r rho)^k / (pi eta^2).
    base: Rgb,
    ggx: Ggx,
    coat: &'s CoatTable,
}

impl<'s> CoatedDiffuse<'s> {
    /// With the albedo of the base and the widths of the layer's boundary; `coat` should have been made
    /// with about the same widths.
    #[inline]
    pub fn new(r: Rgb, coat: &'s CoatTable, alpha_x: f32, alpha_y: f32) -> Self {
        let smooth = coat.ior() == 1.0;
        CoatedDiffuse {
            base: coat.base(r) * (INV_PI / sqr(coat.ior())),
            ggx: if smooth {
                Ggx::new(0.0, 0.0)
            } else {
                Ggx::new(alpha_x, alpha_y)
            },
            coat,
        }
    }

    /// Probability of the boundary's reflection, given its albedo and T(wo).
    #[inline]
    fn specular_probability(&self, t: f32, spec: f32) -> f32 {
        let haze = if self.coat.is_hazy() { 0.05 } else { 0.0 };
        let base = (luminance(self.base) * PI * self.coat.transmittance_mean() + haze) * t;
        if spec + base > 0.0 {
            spec / (spec + base)
        } else {
            1.0
        }
    }

    /// f |cos| and density of everything but a delta lobe, and the probability of the boundary's lobe.
    #[inline]
    fn eval_above(&self, wo: Vec3, wi: Vec3) -> (Rgb, f32, f32) {
        let (t, spec) = self.coat.transmittance_and_reflection(wo.z);
        let p = self.specular_probability(t, spec);
        let mut f = if self.coat.is_hazy() {
            let (through, single) = self.coat.hazy(wo, wi);
            (self.base * through + single) * wi.z
        } else {
            self.base * (t * self.coat.transmittance(wi.z) * wi.z)
        };
        let mut pdf = (1.0 - p) * wi.z * INV_PI;
        if !self.ggx.is_smooth() {
            let (shape, density, cos) = self.ggx.reflection(wo, wi);
            f += Rgb::splat(shape * fresnel_dielectric(cos, self.coat.ior()).0);
            pdf += p * density;
        }
        (f, pdf, p)
    }

    #[inline]
    pub(super) fn eval_pdf(&self, wo: Vec3, wi: Vec3) -> (Rgb, f32) {
        let Some((wo, wi)) = above(wo, wi) else {
            return (Rgb::ZERO, 0.0);
        };
        let (f, pdf, _) = self.eval_above(wo, wi);
        (f, pdf)
    }

    #[inline]
    pub(super) fn sample(&self, wo: Vec3, u_lobe: f32, u: Vec2) -> Option<BsdfSample> {
        if wo.z == 0.0 {
            return None;
        }
        let wo_up = wo.with_z(wo.z.abs());
        let (t, spec) = self.coat.transmittance_and_reflection(wo_up.z);
        let p = self.specular_probability(t, spec);
        let wi = if u_lobe >= p {
            cosine_hemisphere(u)
        } else if self.ggx.is_smooth() {
            // p comes from the table, the reflectance does not.
            let (r, _) = fresnel_dielectric(wo_up.z, self.coat.ior());
            let wi = Vec3::new(-wo.x, -wo.y, wo.z);
            return Some(BsdfSample {
                delta: true,
                ..BsdfSample::reflected(wi, Rgb::splat(r / p), p)
            });
        } else {
            mirrored(wo_up, self.ggx.sample_visible(wo_up, u))
        };
        if wi.z <= 0.0 {
            return None;
        }
        let (f, pdf, _) = self.eval_above(wo_up, wi);
        if pdf <= 0.0 {
            return None;
        }
        Some(BsdfSample::reflected(
            to_side_of(wo, wi),
            f * (1.0 / pdf),
            pdf,
        ))
    }

    /// From the tables; leaves out the light scattered by a hazy medium.
    pub(super) fn albedo(&self, wo: Vec3) -> Rgb {
        let (t, spec) = self.coat.transmittance_and_reflection(wo.z.abs());
        Rgb::splat(spec) + self.base * (PI * self.coat.transmittance_mean() * t)
    }
}
