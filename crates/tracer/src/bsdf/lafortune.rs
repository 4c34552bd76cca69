//! Generalised cosine lobes [Lafortune97, eq. 6]: sums of (cx wo.x wi.x + cy wo.y wi.y + cz wo.z wi.z)^n.
//!
//! For a fixed `wo` such a lobe is a cosine lobe about the direction (cx wo.x, cy wo.y, cz wo.z), scaled
//! by that vector's length to the power n; so it is sampled exactly but for the cosine of `wi`.

use super::{BsdfSample, above, to_side_of};
use crate::math::{Frame, INV_2PI, INV_PI, Rgb, dot, length, luminance, powf};
use crate::sampling::{cosine_hemisphere, power_cosine};
use glam::{Vec2, Vec3};

/// One lobe.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LobeParam {
    /// Factor.
    pub albedo: Rgb,
    /// (-1, -1, 1) is a cosine lobe about the mirror direction, (1, 1, 1) one that sends light back
    /// where it came from.
    pub c: Vec3,
    /// Exponent, >= 0.
    pub n: f32,
}

/// f = kd / pi + sum of lobes. Whether it conserves energy is up to the numbers.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Lafortune<'s> {
    kd: Rgb,
    lobes: &'s [LobeParam],
}

/// A lobe for one `wo`.
struct Turned {
    /// Unit axis.
    axis: Vec3,
    /// Length of the transformed `wo`, to the power n.
    gain: f32,
    /// Weight of the choice between lobes: about the albedo.
    weight: f32,
}

impl LobeParam {
    #[inline]
    fn turned(&self, wo: Vec3) -> Option<Turned> {
        let d = Vec3::new(self.c.x * wo.x, self.c.y * wo.y, self.c.z * wo.z);
        let l = length(d);
        if l <= 1e-6 {
            return None;
        }
        let axis = d * (1.0 / l);
        let gain = powf(l, self.n);
        // The lobe's integral is 2 pi / (n + 1); the cosine of wi is about that of the axis, but some
        // of a lobe that points below still shows.
        let weight = luminance(self.albedo) * gain / (INV_2PI * (self.n + 1.0)) * axis.z.max(0.05);
        Some(Turned { axis, gain, weight })
    }
}

impl<'s> Lafortune<'s> {
    /// With the diffuse albedo and the lobes.
    #[inline]
    pub fn new(kd: Rgb, lobes: &'s [LobeParam]) -> Self {
        Lafortune { kd, lobes }
    }

    /// f |cos| and the density for `wo` above and `wi` anywhere.
    #[inline]
    fn eval_above(&self, wo: Vec3, wi: Vec3) -> (Rgb, f32) {
        let cos = wi.z.max(0.0);
        let mut f = self.kd * INV_PI;
        let mut weights = luminance(self.kd);
        let mut pdf = weights * cos * INV_PI;
        for lobe in self.lobes {
            let Some(t) = lobe.turned(wo) else { continue };
            weights += t.weight;
            let c = dot(t.axis, wi);
            if c > 0.0 {
                let shape = powf(c.min(1.0), lobe.n);
                f += lobe.albedo * (t.gain * shape);
                pdf += t.weight * (lobe.n + 1.0) * INV_2PI * shape;
            }
        }
        if weights > 0.0 {
            (f * cos, pdf / weights)
        } else {
            (f * cos, cos * INV_PI)
        }
    }

    #[inline]
    pub(super) fn eval_pdf(&self, wo: Vec3, wi: Vec3) -> (Rgb, f32) {
        if wo.z == 0.0 {
            return (Rgb::ZERO, 0.0);
        }
        self.eval_above(to_side_of(wo, wo), to_side_of(wo, wi))
    }

    #[inline]
    pub(super) fn sample(&self, wo: Vec3, u_lobe: f32, u: Vec2) -> Option<BsdfSample> {
        let wo_up = wo.with_z(wo.z.abs());
        let weights = self
            .lobes
            .iter()
            .filter_map(|l| l.turned(wo_up))
            .fold(luminance(self.kd), |sum, t| sum + t.weight);
        let mut left = u_lobe * weights - luminance(self.kd);
        // The diffuse part, unless a lobe is chosen; rounding may leave the last lobe.
        let mut chosen = None;
        if left >= 0.0 && weights > 0.0 {
            for lobe in self.lobes {
                let Some(t) = lobe.turned(wo_up) else {
                    continue;
                };
                left -= t.weight;
                if t.weight > 0.0 {
                    chosen = Some((t.axis, lobe.n));
                }
                if left < 0.0 {
                    break;
                }
            }
        }
        let wi = match chosen {
            Some((axis, n)) => Frame::from_normal(axis).to_world(power_cosine(u, n)),
            None => cosine_hemisphere(u),
        };
        above(wo_up, wi)?;
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

    /// Takes the cosine of `wi` at the axis of each lobe, and nothing from lobes that point below.
    pub(super) fn albedo(&self, wo: Vec3) -> Rgb {
        let wo = wo.with_z(wo.z.abs());
        self.lobes.iter().fold(self.kd, |sum, lobe| {
            lobe.turned(wo).map_or(sum, |t| {
                sum + lobe.albedo * (t.gain * t.axis.z.max(0.0) / (INV_2PI * (lobe.n + 1.0)))
            })
        })
    }
}
