//! Directions: sphere, hemispheres, cones. The axis is +z; densities are per solid angle.

use super::disk::{concentric, uniform_disk_concentric_inverse};
use crate::math::{
    INV_2PI, INV_4PI, INV_PI, TWO_PI, atan2, pow_wide, powf, safe_sqrt, sin_cos_2pi,
};
use glam::{Vec2, Vec3};

/// Cosine-weighted direction of the upper hemisphere: the concentric disk lifted up [Malley].
#[inline]
pub fn cosine_hemisphere(u: Vec2) -> Vec3 {
    let (p, r) = concentric(u);
    Vec3::new(p.x, p.y, safe_sqrt((1.0 - r) * (1.0 + r)))
}

/// The same distribution from polar coordinates: u.x is the squared sine of the polar angle, u.y the
/// azimuth. Cheaper where a square root beats a division; stretches cells near the axis.
#[inline]
pub fn cosine_hemisphere_polar(u: Vec2) -> Vec3 {
    let (sin, cos) = sin_cos_2pi(u.y);
    let r = u.x.sqrt();
    Vec3::new(r * cos, r * sin, (1.0 - u.x).sqrt())
}

/// Density of [`cosine_hemisphere`] for a direction with this cosine.
#[inline]
pub fn cosine_hemisphere_pdf(cos: f32) -> f32 {
    cos.max(0.0) * INV_PI
}

/// Inverse of [`cosine_hemisphere`].
pub fn cosine_hemisphere_inverse(w: Vec3) -> Vec2 {
    uniform_disk_concentric_inverse(Vec2::new(w.x, w.y))
}

/// Direction with height z and azimuth 2 pi turn.
#[inline]
fn around(z: f32, sin: f32, turn: f32) -> Vec3 {
    let (s, c) = sin_cos_2pi(turn);
    Vec3::new(sin * c, sin * s, z)
}

/// Azimuth as a fraction of a turn in [0, 1).
#[inline]
fn turn_of(w: Vec3) -> f32 {
    let t = atan2(w.y, w.x) * INV_2PI;
    let t = if t < 0.0 { t + 1.0 } else { t };
    if t < 1.0 { t } else { 0.0 }
}

/// Uniform direction of the upper hemisphere.
#[inline]
pub fn uniform_hemisphere(u: Vec2) -> Vec3 {
    let z = 1.0 - u.x;
    around(z, safe_sqrt(u.x * (2.0 - u.x)), u.y)
}

/// Density of [`uniform_hemisphere`].
#[inline]
pub fn uniform_hemisphere_pdf() -> f32 {
    INV_2PI
}

/// Inverse of [`uniform_hemisphere`].
pub fn uniform_hemisphere_inverse(w: Vec3) -> Vec2 {
    Vec2::new(1.0 - w.z, turn_of(w))
}

/// Uniform direction of the sphere; u.x = 0 is +z.
#[inline]
pub fn uniform_sphere(u: Vec2) -> Vec3 {
    let z = 1.0 - 2.0 * u.x;
    around(z, 2.0 * safe_sqrt(u.x * (1.0 - u.x)), u.y)
}

/// Density of [`uniform_sphere`].
#[inline]
pub fn uniform_sphere_pdf() -> f32 {
    INV_4PI
}

/// Inverse of [`uniform_sphere`].
pub fn uniform_sphere_inverse(w: Vec3) -> Vec2 {
    Vec2::new(0.5 * (1.0 - w.z), turn_of(w))
}

/// Uniform direction of the cone with the half angle t about +z, given 1 - cos t: of a narrow cone
/// the cosine would keep too few digits.
#[inline]
pub fn uniform_cone(u: Vec2, one_minus_cos: f32) -> Vec3 {
    let h = u.x * one_minus_cos;
    around(1.0 - h, safe_sqrt(h * (2.0 - h)), u.y)
}

/// Density of [`uniform_cone`], inside.
#[inline]
pub fn uniform_cone_pdf(one_minus_cos: f32) -> f32 {
    1.0 / (TWO_PI * one_minus_cos)
}

/// Inverse of [`uniform_cone`].
pub fn uniform_cone_inverse(w: Vec3, one_minus_cos: f32) -> Vec2 {
    // 1 - cos = sin^2 / (1 + cos), again for the digits.
    let h = if w.z > 0.5 {
        (w.x * w.x + w.y * w.y) / (1.0 + w.z)
    } else {
        1.0 - w.z
    };
    Vec2::new(h / one_minus_cos, turn_of(w))
}

/// Direction with a density proportional to cos^n, n >= 0: a Phong lobe about +z.
#[inline]
pub fn power_cosine(u: Vec2, n: f32) -> Vec3 {
    // The cdf over the cosine is z^(n+1); 1 - u.x keeps z > 0. For sharp lobes 1 - z^2 needs more
    // digits than z has.
    let z = pow_wide(1.0 - u.x, 1.0 / (n + 1.0));
    let sin = ((1.0 - z * z).max(0.0) as f32).sqrt();
    around(z as f32, sin, u.y)
}

/// Density of [`power_cosine`] for a direction with this cosine: (n + 1) / (2 pi) cos^n.
#[inline]
pub fn power_cosine_pdf(cos: f32, n: f32) -> f32 {
    if cos > 0.0 {
        (n + 1.0) * INV_2PI * powf(cos, n)
    } else {
        0.0
    }
}

/// Inverse of [`power_cosine`].
pub fn power_cosine_inverse(w: Vec3, n: f32) -> Vec2 {
    Vec2::new(1.0 - powf(w.z, n + 1.0), turn_of(w))
}
