//! Glass: reflection and refraction at a boundary between two clear media, smooth or with GGX facets
//! [Walter07].

use super::ggx::{GgxLanes, mirrored, mirrored_lanes};
use super::lanes::{self, AimOf, Lanes, Params, Samples};
use super::{BsdfSample, Ggx, fresnel_dielectric};
use crate::lanes::{Float, Mask, Row, V3, Wide};
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

    /// For lanes: eta, the widths, the means of the tints; the tints.
    pub(crate) fn params(&self) -> Params {
        let (ax, ay) = self.ggx.widths();
        let (mr, mt) = (mean(self.reflect_tint), mean(self.transmit_tint));
        let ([r0, r1, r2], [t0, t1, t2]) =
            (self.reflect_tint.to_array(), self.transmit_tint.to_array());
        [
            Row([self.eta, ax, ay, mr, mt, 0.0, 0.0, 0.0]),
            Row([r0, r1, r2, t0, t1, t2, 0.0, 0.0]),
        ]
    }
}

/// One a lane.
#[derive(Clone, Copy)]
pub(crate) struct DielectricLanes<W: Wide<N>, const N: usize> {
    eta: W::F,
    ggx: GgxLanes<W, N>,
    reflect_mean: W::F,
    transmit_mean: W::F,
    reflect_tint: V3<W, N>,
    transmit_tint: V3<W, N>,
}

/// A [`Split`] in each lane.
struct SplitLanes<W: Wide<N>, const N: usize> {
    r: W::F,
    cos_t: W::F,
    pr: W::F,
    pt: W::F,
    any: W::M,
}

impl<W: Wide<N>, const N: usize> DielectricLanes<W, N> {
    #[inline(always)]
    fn eta_from(&self, wo: V3<W, N>) -> W::F {
        let above = W::F::splat(0.0).lt(wo.z);
        W::F::select(above, self.eta, W::F::splat(1.0) / self.eta)
    }

    #[inline(always)]
    fn split(&self, cos: W::F, eta: W::F) -> SplitLanes<W, N> {
        let (r, cos_t) = lanes::fresnel_dielectric::<W, N>(cos, eta);
        let pr = r * self.reflect_mean;
        let pt = (W::F::splat(1.0) - r) * self.transmit_mean;
        let sum = pr + pt;
        SplitLanes {
            r,
            cos_t,
            pr: pr / sum,
            pt: pt / sum,
            any: !sum.le(W::F::splat(0.0)),
        }
    }
}

impl<W: Wide<N>, const N: usize> Lanes<W, N> for DielectricLanes<W, N> {
    const AIM: AimOf = AimOf::Anywhere;

    #[inline(always)]
    fn new([[eta, ax, ay, mr, mt, ..], [r0, r1, r2, t0, t1, t2, ..]]: [[W::F; 8]; 2]) -> Self {
        DielectricLanes {
            eta,
            ggx: GgxLanes { ax, ay },
            reflect_mean: mr,
            transmit_mean: mt,
            reflect_tint: V3::new(r0, r1, r2),
            transmit_tint: V3::new(t0, t1, t2),
        }
    }

    #[inline(always)]
    fn is_delta(&self) -> W::M {
        self.ggx.is_smooth()
    }

    #[inline(always)]
    fn eval_pdf(&self, wo: V3<W, N>, wi: V3<W, N>) -> (V3<W, N>, W::F) {
        let (zero, one, two) = (W::F::splat(0.0), W::F::splat(1.0), W::F::splat(2.0));
        let least = W::F::splat(1e-16);
        let nothing = self.is_delta() | wo.z.abs().lt(least) | wi.z.abs().lt(least);
        let eta = self.eta_from(wo);
        let (o, i) = (zero.lt(wo.z), zero.lt(wi.z));
        let reflected = (o & i) | (!o & !i);
        let (wo, wi) = lanes::upright(wo, wi);
        // Reflection.
        let (f_r, pdf_r, cos_r) = self.ggx.reflection(wo, wi);
        // Transmission.
        let h = wo + wi * eta;
        let len = h.length();
        let side = W::F::select(h.z.lt(zero), W::F::splat(-1.0), one);
        let m = h * (side / len);
        let (cos_o, cos_i) = (wo.dot(m), wi.dot(m));
        let lost = len.eq(zero) | cos_o.le(zero) | zero.le(cos_i);
        let split = self.split(W::F::select(reflected, cos_r, cos_o), eta);
        let (lo, li) = (self.ggx.l(wo), self.ggx.l(wi));
        let zi = -wi.z;
        let denom = cos_i + cos_o / eta;
        let dm = self.ggx.d(m) * cos_o * -cos_i / (denom * denom);
        let f_t = dm * (one - split.r) * two * zi / ((zi * lo + wo.z * li) * eta * eta);
        let pdf_t = dm * split.pt * two / (wo.z + lo);
        let nothing = nothing | !split.any | (!reflected & lost);
        let f = V3::select(
            reflected,
            self.reflect_tint * (f_r * split.r),
            self.transmit_tint * f_t,
        );
        let pdf = W::F::select(reflected, pdf_r * split.pr, pdf_t);
        (
            V3::select(nothing, V3::new(zero, zero, zero), f),
            W::F::select(nothing, zero, pdf),
        )
    }

    #[inline(always)]
    fn sample(&self, wo: V3<W, N>, lobe: W::F, u: (W::F, W::F)) -> Samples<W, N> {
        let (zero, one) = (W::F::splat(0.0), W::F::splat(1.0));
        let eta = self.eta_from(wo);
        let up = wo.with_z(wo.z.abs());
        let delta = self.is_delta();
        let all_delta = (!delta).to_bits() == 0;
        let flat = V3::new(zero, zero, one);
        let m = if all_delta {
            flat
        } else {
            V3::select(delta, flat, self.ggx.sample_visible(up, u))
        };
        let cos = up.dot(m);
        let split = self.split(cos, eta);
        let transmitted = split.pr.le(lobe);
        let refracted = m * (cos / eta - split.cos_t) - up * (one / eta);
        let wi = V3::select(transmitted, refracted, mirrored_lanes(up, m));
        let below = wi.z.lt(zero);
        let astray = wi.z.eq(zero) | (below & !transmitted) | (!below & transmitted);
        let scale_t = (one - split.r) / (split.pt * eta * eta);
        let scale_r = split.r / split.pr;
        let scale = W::F::select(transmitted, scale_t, scale_r);
        let tint = V3::select(transmitted, self.transmit_tint, self.reflect_tint);
        let shadowing = if all_delta {
            one
        } else {
            let shadowing = self.ggx.shadowing(up, wi.with_z(wi.z.abs()));
            W::F::select(delta, one, shadowing)
        };
        let weight = tint * (scale * shadowing);
        let wi = lanes::to_side_of(wo, wi);
        let mut pdf = W::F::select(transmitted, split.pt, split.pr);
        if !all_delta {
            pdf = W::F::select(delta, pdf, self.eval_pdf(wo, wi).1);
        }
        Samples {
            wi,
            weight,
            pdf,
            eta: W::F::select(transmitted, eta, one),
            delta,
            any: !wo.z.eq(zero) & split.any & !astray & !pdf.le(zero),
        }
    }

    #[inline(always)]
    fn albedo(&self, wo: V3<W, N>) -> V3<W, N> {
        let (r, _) = lanes::fresnel_dielectric::<W, N>(wo.z.abs(), self.eta_from(wo));
        self.reflect_tint * r + self.transmit_tint * (W::F::splat(1.0) - r)
    }
}
