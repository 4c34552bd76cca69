//! The reference for coated surfaces: a random walk between the boundary and the base, as pbrt-v4 takes
//! it [PharrJakobHumphreys23, section 14.3], without its roulette (which leaves the mean alone) and
//! without its combination of strategies.

use super::*;
use crate::math::exp;

/// A layer over a base, walked.
pub(super) struct Layered {
    pub ior: f32,
    pub alpha: f32,
    pub thickness: f32,
    pub max_depth: u32,
    pub base: Bsdf<'static>,
}

impl Layered {
    fn boundary(&self, reflect: f32, transmit: f32) -> Bsdf<'static> {
        Bsdf::Dielectric(Dielectric::new(
            self.ior,
            self.alpha,
            self.alpha,
            grey(reflect),
            grey(transmit),
        ))
    }

    fn attenuation(&self, w: Vec3) -> f32 {
        exp(-self.thickness / w.z.abs())
    }

    /// One estimate of f for two directions above, without the boundary's own reflection: enter by
    /// transmission, and connect every hit of the base with a direction found from `wi` backwards.
    pub fn estimate(&self, rng: &mut TestRng, wo: Vec3, wi: Vec3) -> Rgb {
        let (into, back) = (self.boundary(0.0, 1.0), self.boundary(1.0, 0.0));
        let mut f = Rgb::ZERO;
        let Some(enter) = into.sample(wo, rng.u(), rng.u2().into()) else {
            return f;
        };
        let Some(leave) = into.sample(wi, rng.u(), rng.u2().into()) else {
            return f;
        };
        // From the light's side nothing is compressed.
        let leave_weight = leave.weight * (self.ior * self.ior) * self.attenuation(leave.wi);
        let mut beta = enter.weight;
        let mut w = enter.wi;
        for depth in 0..self.max_depth {
            beta *= self.attenuation(w);
            let next = if depth % 2 == 0 {
                let hit = self.base.eval(-w, -leave.wi) / leave.wi.z.abs();
                f += beta * hit * leave_weight;
                self.base.sample(-w, rng.u(), rng.u2().into())
            } else {
                back.sample(-w, rng.u(), rng.u2().into())
            };
            let Some(next) = next else { break };
            beta *= next.weight;
            w = next.wi;
        }
        f
    }

    /// One walk from `wo` until it leaves: direction and weight, without the boundary's own reflection.
    pub fn walk(&self, rng: &mut TestRng, wo: Vec3) -> Option<(Vec3, Rgb)> {
        let (into, both) = (self.boundary(0.0, 1.0), self.boundary(1.0, 1.0));
        let enter = into.sample(wo, rng.u(), rng.u2().into())?;
        let (mut beta, mut w) = (enter.weight, enter.wi);
        for depth in 0..self.max_depth {
            beta *= self.attenuation(w);
            let surface = if depth % 2 == 0 { &self.base } else { &both };
            let next = surface.sample(-w, rng.u(), rng.u2().into())?;
            beta *= next.weight;
            w = next.wi;
            if next.transmitted {
                return Some((w, beta));
            }
        }
        None
    }

    /// Mean weight of walks, and its standard error (of the mean of the channels).
    pub fn albedo(&self, wo: Vec3, n: u32) -> (Rgb, f64) {
        let mut rng = TestRng::new(77);
        let mut sum = glam::DVec3::ZERO;
        let mut moments = Moments::default();
        for _ in 0..n {
            let weight = self.walk(&mut rng, wo).map_or(Rgb::ZERO, |s| s.1);
            sum += weight.as_dvec3();
            moments.add(f64::from(crate::math::mean(weight)));
        }
        ((sum / f64::from(n)).as_vec3(), moments.error())
    }
}
