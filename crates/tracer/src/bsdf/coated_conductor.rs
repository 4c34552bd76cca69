//! Metal under a dielectric layer: car paint, varnished brass. An approximation of the mean of the random
//! walk that pbrt-v4's `coatedconductor` takes.
//!
//! - The boundary's own reflection as in [`super::Dielectric`].
//! - Light that hits the metal once: T(wo) T(wi) / eta^2 times the metal's GGX lobe at the refracted
//!   directions, exact for a smooth boundary. Facets of a rough boundary bend light by their slope times
//!   1 - cos / (eta cos inside), on the way in and on the way out; half of that tilts the half vector, so
//!   the lobe is widened by as much. Where the metal is sharper than the boundary, a tabulated factor
//!   repairs the energy.
//! - Light that the boundary throws back to the metal: the same lobe with alpha^2 doubled and the
//!   tabulated energy, [`CoatTable::again`], times the metal's reflectance once more for each hit.
//! - Smooth on smooth: the whole series in one delta lobe, exactly.
//!
//! Albedo against the walk (copper, eta 1.5, from normal to cos 0.15): smooth boundary within 1.3 % where
//! the metal's alpha is 0.6 or 1, within 7 % at 0.1 and 0.3; boundary and metal 0.1: +2 to +7 %; boundary 0.2
//! on metal 0.3: 0 to +8 %; boundary 0.1 on a mirror: +6 to -13 %; boundary 0.4 on metal 0.2: +13 to -10 %, on
//! a mirror +10 to -24 %; 0.6 on 0.6: -7 to -27 %. A scattering medium in the layer is ignored.

use super::coat::{bend, spread};
use super::ggx::mirrored;
use super::{BsdfSample, CoatTable, Ggx, above, fresnel_conductor, fresnel_dielectric, to_side_of};
use crate::math::{Rgb, mean, sqr};
use glam::{Vec2, Vec3};

/// Weight of the metal's squared width against the boundary's in [`CoatedConductor::memory`]: of 1, 2 and
/// 4 the nearest to the walk.
const MEMORY: f32 = 4.0;

/// See the module's documentation.
#[derive(Clone, Copy, Debug)]
pub struct CoatedConductor<'s> {
    eta: Rgb,
    k: Rgb,
    base: Ggx,
    boundary: Ggx,
    coat: &'s CoatTable,
    /// About the metal's reflectance, for the choice between the lobes.
    base_weight: f32,
}

impl<'s> CoatedConductor<'s> {
    #[inline]
    pub(super) fn narrowness(&self) -> u32 {
        self.base.narrowness()
    }

    /// With the metal's optical constants as in air (they are divided by the layer's index here) and its
    /// widths, and the layer with the widths of its boundary; `coat` should have been made with about
    /// the same.
    pub fn new(
        eta: Rgb,
        k: Rgb,
        alpha_x: f32,
        alpha_y: f32,
        coat: &'s CoatTable,
        coat_alpha_x: f32,
        coat_alpha_y: f32,
    ) -> Self {
        let ior = coat.ior();
        let (eta, k) = (eta * (1.0 / ior), k * (1.0 / ior));
        let boundary = if ior == 1.0 {
            Ggx::new(0.0, 0.0)
        } else {
            Ggx::new(coat_alpha_x, coat_alpha_y)
        };
        CoatedConductor {
            eta,
            k,
            base: Ggx::new(alpha_x, alpha_y),
            boundary,
            coat,
            base_weight: mean(fresnel_conductor(1.0, eta, k)),
        }
    }

    #[inline]
    pub(super) fn is_delta(&self) -> bool {
        self.boundary.is_smooth() && self.base.is_smooth()
    }

    /// Correction of T(wo) T(wi) for what a sharp metal remembers of the way in.
    #[inline]
    fn memory(&self, wo: Vec3, wi: Vec3) -> f32 {
        if self.boundary.is_smooth() {
            return 1.0;
        }
        let (ax, ay) = self.base.widths();
        let (cx, cy) = self.boundary.widths();
        let sharp = cx * cy / (cx * cy + MEMORY * ax * ay);
        let m = self.coat.mirror_factor(wo.z) * self.coat.mirror_factor(wi.z);
        1.0 + (m - 1.0) * sharp
    }

    /// Probability of the boundary's own reflection, given its albedo and T(wo).
    #[inline]
    fn boundary_probability(&self, t: f32, spec: f32) -> f32 {
        let base = self.base_weight * t;
        if spec + base > 0.0 {
            spec / (spec + base)
        } else {
            1.0
        }
    }

    /// Sum over 0 <= k < n of q^k.
    #[inline]
    fn series(q: Rgb, n: u32) -> Rgb {
        let mut sum = Rgb::ZERO;
        for _ in 0..n.min(16) {
            sum = sum * q + Rgb::ONE;
        }
        sum
    }

    /// f |cos| and density of everything but a delta lobe. Not for smooth on smooth.
    fn eval_above(&self, wo: Vec3, wi: Vec3) -> (Rgb, f32) {
        let (t_o, spec) = self.coat.transmittance_and_reflection(wo.z);
        let p = self.boundary_probability(t_o, spec);
        let (mut f, mut pdf) = (Rgb::ZERO, 0.0);
        if let (Some(inner_o), Some(inner_i)) = (self.coat.refracted(wo), self.coat.refracted(wi)) {
            let hits = self.coat.hits();
            // Solid angle and cosine inside per outside: cos / (eta^2 cos inside).
            let squeeze = wi.z / (sqr(self.coat.ior()) * inner_i.z);
            // Samples know the way in only.
            let ior = self.coat.ior();
            let (bend_o, bend_i) = (bend(wo, inner_o, ior), bend(wi, inner_i, ior));
            let lobe = spread(self.base, self.boundary, 0.5 * (bend_o + bend_i));
            let (once, mut density, cos) = lobe.reflection(inner_o, inner_i);
            if !self.boundary.is_smooth() {
                let lobe = spread(self.base, self.boundary, bend_o);
                density = lobe.reflection(inner_o, inner_i).1;
            }
            pdf += (1.0 - p) * density * squeeze;
            if hits > 0 {
                let metal = fresnel_conductor(cos, self.eta, self.k);
                let wide = lobe.widened(2.0, 0.0, 0.0);
                let (shape, _, _) = wide.reflection(inner_o, inner_i);
                let (ax, ay) = lobe.widths();
                let alpha = (ax * ay).sqrt();
                let (o, i) = (
                    self.coat.again(alpha, inner_o.z),
                    self.coat.again(alpha, inner_i.z),
                );
                // Geometric means keep it reciprocal.
                let second = (o.second * i.second).sqrt();
                let ratio = (o.ratio * i.ratio).sqrt();
                let more = metal * second * Self::series(metal * ratio, hits - 1);
                let t = t_o * self.coat.transmittance(wi.z) * squeeze * self.memory(wo, wi);
                f += metal * (Rgb::splat(once) + more * shape) * t;
            }
        }
        if !self.boundary.is_smooth() {
            let (shape, density, cos) = self.boundary.reflection(wo, wi);
            f += Rgb::splat(shape * fresnel_dielectric(cos, self.coat.ior()).0);
            pdf += p * density;
        }
        (f, pdf)
    }

    pub(super) fn eval_pdf(&self, wo: Vec3, wi: Vec3) -> (Rgb, f32) {
        let (false, Some((wo, wi))) = (self.is_delta(), above(wo, wi)) else {
            return (Rgb::ZERO, 0.0);
        };
        self.eval_above(wo, wi)
    }

    /// Reflectance of smooth on smooth.
    fn mirror(&self, cos: f32) -> Rgb {
        let (r, cos_t) = fresnel_dielectric(cos, self.coat.ior());
        let a = self.coat.attenuation(cos_t);
        let metal = fresnel_conductor(cos_t, self.eta, self.k) * (a * a);
        Rgb::splat(r) + metal * Self::series(metal * r, self.coat.hits()) * sqr(1.0 - r)
    }

    pub(super) fn sample(&self, wo: Vec3, u_lobe: f32, u: Vec2) -> Option<BsdfSample> {
        if wo.z == 0.0 {
            return None;
        }
        let wo_up = wo.with_z(wo.z.abs());
        let mirror_sample = |weight: Rgb, pdf: f32| BsdfSample {
            delta: true,
            ..BsdfSample::reflected(Vec3::new(-wo.x, -wo.y, wo.z), weight, pdf)
        };
        if self.is_delta() {
            return Some(mirror_sample(self.mirror(wo_up.z), 1.0));
        }
        let (t, spec) = self.coat.transmittance_and_reflection(wo_up.z);
        let p = self.boundary_probability(t, spec);
        let wi = if u_lobe >= p {
            let inner = self.coat.refracted(wo_up)?;
            let bend = bend(wo_up, inner, self.coat.ior());
            let lobe = spread(self.base, self.boundary, bend);
            let w = mirrored(inner, lobe.sample_visible(inner, u));
            // Out again; nothing leaves beyond the critical angle.
            let eta = self.coat.ior();
            let z2 = 1.0 - (1.0 - w.z * w.z) * (eta * eta);
            if w.z <= 0.0 || z2 <= 0.0 {
                return None;
            }
            Vec3::new(w.x * eta, w.y * eta, z2.sqrt())
        } else if self.boundary.is_smooth() {
            let (r, _) = fresnel_dielectric(wo_up.z, self.coat.ior());
            return Some(mirror_sample(Rgb::splat(r / p), p));
        } else {
            mirrored(wo_up, self.boundary.sample_visible(wo_up, u))
        };
        if wi.z <= 0.0 {
            return None;
        }
        let (f, pdf) = self.eval_above(wo_up, wi);
        if pdf <= 0.0 {
            return None;
        }
        Some(BsdfSample::reflected(
            to_side_of(wo, wi),
            f * (1.0 / pdf),
            pdf,
        ))
    }

    /// Of light that hits the metal once or twice, leaving out the spread of the metal's lobe (shadowing,
    /// and what it sends beyond the critical angle).
    pub(super) fn albedo(&self, wo: Vec3) -> Rgb {
        let cos = wo.z.abs();
        let (false, Some(inner)) = (self.is_delta(), self.coat.refracted(wo.with_z(cos))) else {
            return self.mirror(cos);
        };
        let (t, spec) = self.coat.transmittance_and_reflection(cos);
        let metal = fresnel_conductor(inner.z, self.eta, self.k);
        let t = t * self.coat.mirror_factor(cos);
        let (ax, ay) = self.base.widths();
        let more = metal * self.coat.again((ax * ay).sqrt(), inner.z).second;
        Rgb::splat(spec) + metal * (Rgb::ONE + more) * (t * t)
    }
}
