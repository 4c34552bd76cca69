//! The phase function of Henyey and Greenstein [HenyeyGreenstein41]:
//! p = (1 - g^2) / (4 pi (1 + g^2 - 2 g cos)^(3/2)), cos between the ways of travel before and after.
//! It integrates to 1, so that a density is a value.

use crate::math::{Frame, INV_4PI, safe_sqrt, sin_cos_2pi};
use glam::{Vec2, Vec3};

/// Value and density per solid angle for light that travelled along `d` and goes on along `wi`.
#[inline]
pub fn value(g: f32, d: Vec3, wi: Vec3) -> f32 {
    let b = 1.0 + g * g - 2.0 * g * d.dot(wi).clamp(-1.0, 1.0);
    INV_4PI * (1.0 - g * g) / (b * b.sqrt()).max(1e-20)
}

/// A direction after `d`, and its density.
#[inline]
pub fn sample(g: f32, d: Vec3, u: Vec2) -> (Vec3, f32) {
    let cos = if g.abs() < 1e-3 {
        // The inverse below loses its digits; first order in g keeps them.
        let x = 1.0 - 2.0 * u.x;
        x + 1.5 * g * (1.0 - x * x)
    } else {
        let s = (1.0 - g * g) / (1.0 + g - 2.0 * g * u.x);
        (1.0 + g * g - s * s) / (2.0 * g)
    };
    let cos = cos.clamp(-1.0, 1.0);
    let sin = safe_sqrt(1.0 - cos * cos);
    let (y, x) = sin_cos_2pi(u.y);
    let frame = Frame::from_normal(d);
    let wi = frame.to_world(Vec3::new(sin * x, sin * y, cos));
    (wi, value(g, d, wi))
}
