//! Metal under a dielectric layer: car paint, varnished brass. An approximation of the mean of pbrt-v4's
//! `coatedconductor`.
//!
//! - The boundary's own reflection as in [`super::Dielectric`].
//! - Light that hits the metal once: T(wo) T(wi) / eta^2 times the metal's GGX lobe at the refracted
//!   directions, exact for a smooth boundary. A rough boundary bends light by its facets' slopes times
//!   (1 - 1/eta) on the way in and out; half of that tilts the half vector, so the metal's lobe is
//!   widened to alpha^2 + s alpha_coat^2 (`COAT_SPREAD`), while T keeps the energy.
//! - Light that the boundary throws back to the metal: the same lobe with alpha^2 doubled, scaled by
//!   the tabulated part that comes back, [`CoatTable::returned`], and by the metal once more for each
//!   hit.
//! - Smooth on smooth: the whole series in one delta lobe, exactly.
//!
//! The tests compare it with the random walk and state the deviations. A scattering medium in the layer
//! only dims.

use super::ggx::mirrored;
use super::{BsdfSample, CoatTable, Ggx, above, fresnel_conductor, fresnel_dielectric, to_side_of};
use crate::math::{Rgb, mean, sqr};
use glam::{Vec2, Vec3};

/// Share of the boundary's squared width that a crossing pair adds to the lobe, over (1 - 1/eta)^2.
const COAT_SPREAD: f32 = 0.5;

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

    /// How far a tilt of the boundary's facet turns the refracted direction, squared, in the plane of
    /// incidence: 1 - cos / (eta cos inside).
    #[inline]
    fn bend(&self, w: Vec3, inner: Vec3) -> f32 {
        if self.boundary.is_smooth() {
            0.0
        } else {
            sqr(1.0 - w.z / (self.coat.ior() * inner.z))
        }
    }

    /// The metal's lobe, widened by what crossing the boundary bends.
    #[inline]
    fn lobe(&self, bend: f32) -> Ggx {
        if self.boundary.is_smooth() {
            return self.base;
        }
        let (cx, cy) = self.boundary.widths();
        let s = COAT_SPREAD * bend;
        self.base.widened(1.0, s * cx * cx, s * cy * cy)
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
            let (bend_o, bend_i) = (self.bend(wo, inner_o), self.bend(wi, inner_i));
            let lobe = self.lobe(0.5 * (bend_o + bend_i));
            let (once, mut density, cos) = lobe.reflection(inner_o, inner_i);
            if !self.boundary.is_smooth() {
                density = self.lobe(bend_o).reflection(inner_o, inner_i).1;
            }
            pdf += (1.0 - p) * density * squeeze;
            if hits > 0 {
                let metal = fresnel_conductor(cos, self.eta, self.k);
                let wide = lobe.widened(2.0, 0.0, 0.0);
                let (again, _, _) = wide.reflection(inner_o, inner_i);
                let (ax, ay) = lobe.widths();
                let alpha = (ax * ay).sqrt();
                let back = (self.coat.returned(alpha, inner_o.z)
                    * self.coat.returned(alpha, inner_i.z))
                .sqrt();
                let more = metal * back * Self::series(metal * back, hits - 1);
                let t = t_o * self.coat.transmittance(wi.z) * squeeze;
                f += metal * (Rgb::splat(once) + more * again) * t;
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
            let lobe = self.lobe(self.bend(wo_up, inner));
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

    /// That of smooth on smooth.
    pub(super) fn albedo(&self, wo: Vec3) -> Rgb {
        self.mirror(wo.z.abs())
    }
}
