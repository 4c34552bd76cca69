//! Glass: reflection and refraction at a boundary between two clear media, smooth or with GGX facets
//! [Walter07].

use super::ggx::mirrored;
use super::{BsdfSample, Ggx, fresnel_dielectric};
use crate::math::{Rgb, dot, length, mean};
use glam::{Vec2, Vec3};

/// Reflection and transmission; delta lobes where the widths are below 1e-3 or nothing refracts.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Dielectric {
    /// Inside over outside.
    eta: f32,
    ggx: Ggx,
    reflect_tint: Rgb,
    transmit_tint: Rgb,
}

/// How one facet splits light.
struct Split {
    /// Fresnel reflectance.
    r: f32,
    /// Cosine of the refracted direction to the facet.
    cos_t: f32,
    /// Probabilities of reflection and transmission.
    pr: f32,
    pt: f32,
}

impl Dielectric {
    /// With the index of refraction inside over outside, the GGX widths and factors on what is
    /// reflected and transmitted (1 is physical).
    #[inline]
    pub fn new(
        eta: f32,
        alpha_x: f32,
        alpha_y: f32,
        reflect_tint: Rgb,
        transmit_tint: Rgb,
    ) -> Self {
        let ggx = if eta == 1.0 {
            Ggx::new(0.0, 0.0)
        } else {
            Ggx::new(alpha_x, alpha_y)
        };
        Dielectric {
            eta,
            ggx,
            reflect_tint,
            transmit_tint,
        }
    }

    #[inline]
    pub(super) fn is_delta(&self) -> bool {
        self.ggx.is_smooth()
    }

    /// Far side over near side as seen from `wo`.
    #[inline]
    fn eta_from(&self, wo: Vec3) -> f32 {
        if wo.z > 0.0 { self.eta } else { 1.0 / self.eta }
    }

    /// `None` where the tints leave nothing.
    #[inline]
    fn split(&self, cos: f32, eta: f32) -> Option<Split> {
        let (r, cos_t) = fresnel_dielectric(cos, eta);
        let pr = r * mean(self.reflect_tint);
        let pt = (1.0 - r) * mean(self.transmit_tint);
        let sum = pr + pt;
        if sum <= 0.0 {
            return None;
        }
        Some(Split {
            r,
            cos_t,
            pr: pr / sum,
            pt: pt / sum,
        })
    }

    pub(super) fn eval_pdf(&self, wo: Vec3, wi: Vec3) -> (Rgb, f32) {
        const NOTHING: (Rgb, f32) = (Rgb::ZERO, 0.0);
        // Along the surface; products of smaller cosines would vanish.
        if self.is_delta() || wo.z.abs() < 1e-16 || wi.z.abs() < 1e-16 {
            return NOTHING;
        }
        let eta = self.eta_from(wo);
        // By the signs: the product of two tiny cosines is zero.
        let reflected = (wo.z > 0.0) == (wi.z > 0.0);
        // From here on wo is above.
        let wi = if wo.z < 0.0 { wi.with_z(-wi.z) } else { wi };
        let wo = wo.with_z(wo.z.abs());
        if reflected {
            let (f, pdf, cos) = self.ggx.reflection(wo, wi);
            let Some(split) = self.split(cos, eta) else {
                return NOTHING;
            };
            return (self.reflect_tint * (f * split.r), pdf * split.pr);
        }
        // The facet that refracts wo into wi: along wo + eta wi [Walter07, eq. 16].
        let h = wo + wi * eta;
        let len = length(h);
        if len == 0.0 {
            return NOTHING;
        }
        let m = h * (if h.z < 0.0 { -1.0 } else { 1.0 } / len);
        let (cos_o, cos_i) = (dot(wo, m), dot(wi, m));
        if cos_o <= 0.0 || cos_i >= 0.0 {
            return NOTHING;
        }
        let Some(split) = self.split(cos_o, eta) else {
            return NOTHING;
        };
        let (lo, li) = (self.ggx.l(wo), self.ggx.l(wi));
        let zi = -wi.z;
        // Solid angle of normals per solid angle of wi, times wo.m [Walter07, eq. 17].
        let denom = cos_i + cos_o / eta;
        let dm = self.ggx.d(m) * cos_o * -cos_i / (denom * denom);
        let f = dm * (1.0 - split.r) * 2.0 * zi / ((zi * lo + wo.z * li) * eta * eta);
        let pdf = dm * split.pt * 2.0 / (wo.z + lo);
        (self.transmit_tint * f, pdf)
    }

    pub(super) fn sample(&self, wo: Vec3, u_lobe: f32, u: Vec2) -> Option<BsdfSample> {
        if wo.z == 0.0 {
            return None;
        }
        let eta = self.eta_from(wo);
        let wo_up = wo.with_z(wo.z.abs());
        let delta = self.is_delta();
        let m = if delta {
            Vec3::Z
        } else {
            self.ggx.sample_visible(wo_up, u)
        };
        let cos = dot(wo_up, m);
        let split = self.split(cos, eta)?;
        let transmitted = u_lobe >= split.pr;
        let wi = if transmitted {
            // Total reflection cannot get here, as then pr is 1 (or there is nothing to split).
            m * (cos / eta - split.cos_t) - wo_up * (1.0 / eta)
        } else {
            mirrored(wo_up, m)
        };
        if wi.z == 0.0 || (wi.z < 0.0) != transmitted {
            return None;
        }
        let shadowing = if delta {
            1.0
        } else {
            self.ggx.shadowing(wo_up, wi.with_z(wi.z.abs()))
        };
        let (weight, pdf) = if transmitted {
            let scale = (1.0 - split.r) / (split.pt * eta * eta);
            (self.transmit_tint * (scale * shadowing), split.pt)
        } else {
            let scale = split.r / split.pr;
            (self.reflect_tint * (scale * shadowing), split.pr)
        };
        let wi = if wo.z < 0.0 { wi.with_z(-wi.z) } else { wi };
        let pdf = if delta { pdf } else { self.eval_pdf(wo, wi).1 };
        if pdf <= 0.0 {
            return None;
        }
        Some(BsdfSample {
            wi,
            weight,
            pdf,
            eta: if transmitted { eta } else { 1.0 },
            delta,
            transmitted,
        })
    }

    /// Fresnel at the shading normal, without the scaling of radiance; leaves out shadowing.
    #[inline]
    pub(super) fn albedo(&self, wo: Vec3) -> Rgb {
        let (r, _) = fresnel_dielectric(wo.z.abs(), self.eta_from(wo));
        self.reflect_tint * r + self.transmit_tint * (1.0 - r)
    }
}
