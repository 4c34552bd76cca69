//! The sheen of cloth: fibres that stand up [EstevezKulla17].
//!
//! f = D G / (4 cos cos), D(m) = (2 + 1/alpha) sin^(1/alpha) / 2 pi, G = 1 / (1 + L(o) + L(i)) with the
//! paper's fitted L. It is what glTF's KHR_materials_sheen prescribes.

use crate::math::{INV_2PI, exp, lerp, powf, safe_sqrt, sqr};
use glam::Vec3;

/// Below this roughness the lobe is too thin to be told from the horizon.
const ROUGHNESS_MIN: f32 = 0.07;

/// Width from roughness.
#[inline]
pub fn width(roughness: f32) -> f32 {
    sqr(roughness.clamp(ROUGHNESS_MIN, 1.0))
}

/// The fit of section 2 of the paper for one width, interpolated with weight (1 - alpha)^2.
#[inline]
fn fit(x: f32, alpha: f32) -> f32 {
    let t = sqr(1.0 - alpha);
    let a = lerp(21.5473, 25.3245, t);
    let b = lerp(3.82987, 3.32435, t);
    let c = lerp(0.19823, 0.16801, t);
    let d = lerp(-1.97760, -1.27393, t);
    let e = lerp(-4.32054, -4.85967, t);
    a / (1.0 + b * powf(x, c)) + d * x + e
}

/// L(cos): odd about cos = 1/2 in its logarithm.
#[inline]
fn lambda(cos: f32, alpha: f32) -> f32 {
    exp(if cos < 0.5 {
        fit(cos, alpha)
    } else {
        2.0 * fit(0.5, alpha) - fit(1.0 - cos, alpha)
    })
}

/// f cos wi for two directions above.
#[inline]
pub fn eval(wo: Vec3, wi: Vec3, alpha: f32) -> f32 {
    let h = wo + wi;
    let length2 = h.dot(h);
    if length2 <= 0.0 || wo.z < 1e-6 {
        return 0.0;
    }
    let sin2 = 1.0 - h.z * h.z / length2;
    let inverse = 1.0 / alpha;
    let d = (2.0 + inverse) * powf(safe_sqrt(sin2), inverse) * INV_2PI;
    let g = 1.0 / (1.0 + lambda(wo.z.min(1.0), alpha) + lambda(wi.z.min(1.0), alpha));
    0.25 * d * g / wo.z
}

/// Albedo for a cosine and a roughness, by a fixed rule over the hemisphere.
pub fn albedo(cos: f32, roughness: f32) -> f32 {
    const N: u32 = 16;
    let alpha = width(roughness);
    let wo = super::super::coat::at_cosine(cos.max(1e-3));
    let mut sum = 0.0;
    for i in 0..N {
        // Cosines squared, as much lies at the horizon: dz = 2 x dx.
        let x = (i as f32 + 0.5) / N as f32;
        let z = x * x;
        let sin = safe_sqrt(1.0 - z * z);
        for j in 0..N {
            let (s, c) = crate::math::sin_cos_2pi((j as f32 + 0.5) * 0.5 / N as f32);
            sum += 2.0 * x * eval(wo, Vec3::new(sin * c, sin * s, z), alpha);
        }
    }
    (sum * crate::math::TWO_PI / (N * N) as f32).min(1.0)
}
