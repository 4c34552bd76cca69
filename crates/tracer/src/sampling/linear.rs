//! Linear densities in one dimension.

use crate::math::{lerp, safe_sqrt};

/// Point of [0, 1] with a density proportional to (1 - x) a + x b; a, b >= 0, not both 0.
#[inline]
pub fn linear(u: f32, a: f32, b: f32) -> f32 {
    if u == 0.0 && a == 0.0 {
        return 0.0;
    }
    // The root of the quadratic cdf in the form that does not cancel.
    let x = u * (a + b) / (a + safe_sqrt(lerp(a * a, b * b, u)));
    x.min(crate::math::ONE_MINUS_EPSILON)
}

/// Density of [`linear`].
#[inline]
pub fn linear_pdf(x: f32, a: f32, b: f32) -> f32 {
    if (0.0..=1.0).contains(&x) {
        2.0 * lerp(a, b, x) / (a + b)
    } else {
        0.0
    }
}

/// Inverse of [`linear`].
pub fn linear_inverse(x: f32, a: f32, b: f32) -> f32 {
    x * (a * (2.0 - x) + b * x) / (a + b)
}

/// Point of [-r, r] with a density falling linearly from the middle to the ends.
#[inline]
pub fn tent(u: f32, r: f32) -> f32 {
    if u < 0.5 {
        r * ((2.0 * u).sqrt() - 1.0)
    } else {
        r * (1.0 - safe_sqrt(2.0 * (1.0 - u)))
    }
}

/// Density of [`tent`].
#[inline]
pub fn tent_pdf(x: f32, r: f32) -> f32 {
    (1.0 - x.abs() / r).max(0.0) / r
}

/// Inverse of [`tent`].
pub fn tent_inverse(x: f32, r: f32) -> f32 {
    let t = 1.0 - x.abs() / r;
    if x < 0.0 {
        0.5 * t * t
    } else {
        1.0 - 0.5 * t * t
    }
}
