//! The equal-area map between the unit square and the sphere [Clarberg08]: +Z in the middle, -Z in
//! the corners. Each pixel of a picture covers the same solid angle.

use crate::math;
use glam::{Vec2, Vec3};

/// Square to sphere.
pub fn to_sphere(p: Vec2) -> Vec3 {
    let (u, v) = (2.0 * p.x - 1.0, 2.0 * p.y - 1.0);
    let (au, av) = (u.abs(), v.abs());
    // Signed distance from the diagonal between the octahedron's upper and lower half.
    let d = 1.0 - (au + av);
    let r = 1.0 - d.abs();
    let turn = if r == 0.0 { 1.0 } else { (av - au) / r + 1.0 } * 0.125; // of a whole turn
    let z = (1.0 - r * r).copysign(d);
    let (sin, cos) = math::sin_cos_2pi(turn.clamp(0.0, 0.25));
    let s = r * math::safe_sqrt(2.0 - r * r);
    Vec3::new(cos.copysign(u) * s, sin.copysign(v) * s, z)
}

/// Sphere to square.
pub fn to_square(w: Vec3) -> Vec2 {
    let (x, y, z) = (w.x.abs(), w.y.abs(), w.z.abs());
    let r = math::safe_sqrt(1.0 - z);
    let (big, small) = if x > y { (x, y) } else { (y, x) };
    let angle = if big == 0.0 {
        0.0
    } else {
        math::atan2(small, big) * (2.0 / math::PI)
    };
    let phi = if x < y { 1.0 - angle } else { angle };
    let v = phi * r;
    let u = r - v;
    let (u, v) = if w.z < 0.0 {
        (1.0 - v, 1.0 - u)
    } else {
        (u, v)
    };
    Vec2::new((u.copysign(w.x) + 1.0) * 0.5, (v.copysign(w.y) + 1.0) * 0.5)
}

/// The pixel of a `w` x `h` picture that stands for one outside of it: going over an edge comes back in
/// over the same edge, turned by half a turn about its middle.
pub fn pixel(x: i64, y: i64, w: i64, h: i64) -> (usize, usize) {
    let (i, j) = (x.rem_euclid(w), y.rem_euclid(h));
    if (x.div_euclid(w) + y.div_euclid(h)) & 1 == 0 {
        (i as usize, j as usize)
    } else {
        ((w - 1 - i) as usize, (h - 1 - j) as usize)
    }
}
