//! Several surfaces in one, each with a share.

use super::{Bsdf, BsdfSample, Reach};
use crate::math::Rgb;
use glam::{Vec2, Vec3};

/// Most surfaces that are mixed exactly.
pub const MIXED_MAX: usize = 4;

/// What every part's albedo counts for at least, in choosing one: albedos are estimates.
const ALBEDO_MIN: f32 = 0.02;

/// A sum of scattering functions, for one view: light is evaluated for all of them, and a direction drawn
/// from one, chosen by its share and albedo. (To choose one by its share alone, for light too, is as
/// correct and noisier.)
#[derive(Clone, Copy, Debug)]
pub struct Mixed<'s> {
    parts: [Part<'s>; MIXED_MAX],
    len: usize,
}

#[derive(Clone, Copy, Debug)]
struct Part<'s> {
    bsdf: Bsdf<'s>,
    /// Share of the surface.
    share: f32,
    /// Probability that directions are drawn from it.
    chance: f32,
}

impl<'s> Mixed<'s> {
    /// At most [`MIXED_MAX`] parts with their shares, which are 1 together, seen from `wo`.
    pub fn new(of: &[(Bsdf<'s>, f32)], wo: Vec3) -> Mixed<'s> {
        let nothing = Part {
            bsdf: Bsdf::Black,
            share: 0.0,
            chance: 0.0,
        };
        let mut mixed = Mixed {
            parts: [nothing; MIXED_MAX],
            len: of.len(),
        };
        for (part, (bsdf, share)) in mixed.parts.iter_mut().zip(of) {
            let reflected = bsdf.albedo(wo).max_element().min(1.0);
            *part = Part {
                bsdf: *bsdf,
                share: *share,
                chance: share * (reflected + ALBEDO_MIN),
            };
        }
        let sum: f32 = mixed.parts().iter().map(|part| part.chance).sum();
        for part in &mut mixed.parts[..of.len()] {
            part.chance /= sum;
        }
        mixed
    }

    fn parts(&self) -> &[Part<'s>] {
        &self.parts[..self.len]
    }

    /// The part with the largest share.
    pub fn largest(&self) -> &Bsdf<'s> {
        let mut largest = &self.parts[0];
        for part in self.parts() {
            if part.share > largest.share {
                largest = part;
            }
        }
        &largest.bsdf
    }

    /// The sum.
    pub fn eval_pdf(&self, wo: Vec3, wi: Vec3) -> (Rgb, f32) {
        self.but(usize::MAX, wo, wi)
    }

    /// The sum of all parts but one.
    fn but(&self, except: usize, wo: Vec3, wi: Vec3) -> (Rgb, f32) {
        let (mut f, mut pdf) = (Rgb::ZERO, 0.0);
        for (i, part) in self.parts().iter().enumerate() {
            if i != except {
                let of = part.bsdf.eval_pdf(wo, wi);
                f += of.0 * part.share;
                pdf += of.1 * part.chance;
            }
        }
        (f, pdf)
    }

    /// Draws from one part.
    pub fn sample(&self, wo: Vec3, u_lobe: f32, u: Vec2) -> Option<BsdfSample> {
        let (mut i, mut below) = (0, 0.0);
        while i + 1 < self.len && u_lobe >= below + self.parts[i].chance {
            below += self.parts[i].chance;
            i += 1;
        }
        let part = &self.parts[i];
        // What the choice leaves of the number chooses among the part's lobes.
        let rest = ((u_lobe - below) / part.chance).clamp(0.0, BELOW_ONE);
        let s = part.bsdf.sample(wo, rest, u)?;
        if s.delta {
            return Some(BsdfSample {
                weight: s.weight * (part.share / part.chance),
                pdf: s.pdf * part.chance,
                ..s
            });
        }
        let (f, pdf) = self.but(i, wo, s.wi);
        let pdf = pdf + s.pdf * part.chance;
        let weight = (f + s.weight * (s.pdf * part.share)) * (1.0 / pdf);
        (pdf > 0.0 && pdf < f32::INFINITY).then_some(BsdfSample { weight, pdf, ..s })
    }

    /// Whether all parts have only delta lobes.
    pub fn is_delta(&self) -> bool {
        self.parts().iter().all(|p| p.bsdf.is_delta())
    }

    /// Lights that matter to any part.
    pub fn reach(&self) -> Reach {
        let mut all = None;
        for part in self.parts().iter().filter(|p| !p.bsdf.is_delta()) {
            let reach = part.bsdf.reach();
            all = Some(match (all, reach) {
                (None, _) => reach,
                (Some(Reach::Anywhere), _) | (_, Reach::Anywhere) => Reach::Anywhere,
                (Some(Reach::Mirrored(a)), Reach::Mirrored(b)) => Reach::Mirrored(a.min(b)),
                _ => Reach::Cosine,
            });
        }
        all.unwrap_or(Reach::Cosine)
    }

    /// The sum of the parts' albedos.
    pub fn albedo(&self, wo: Vec3) -> Rgb {
        let mut sum = Rgb::ZERO;
        for part in self.parts() {
            sum += part.bsdf.albedo(wo) * part.share;
        }
        sum
    }

    /// Whether light passes to the other side of any part.
    pub fn transmits(&self) -> bool {
        self.parts().iter().any(|p| p.bsdf.transmits())
    }
}

/// The largest number below 1.
const BELOW_ONE: f32 = 1.0 - f32::EPSILON / 2.0;
