//! Uniform points of a triangle.

use glam::Vec2;

/// Barycentric coordinates (b1, b2) of a uniform point, b0 = 1 - b1 - b2; the density per area is
/// one over the triangle's area. Folds the square along its diagonal instead of bending it, which
/// distorts less than the square-root map [Heitz19].
#[inline]
pub fn uniform_triangle(u: Vec2) -> Vec2 {
    if u.y > u.x {
        let b1 = 0.5 * u.x;
        Vec2::new(b1, u.y - b1)
    } else {
        let b2 = 0.5 * u.y;
        Vec2::new(u.x - b2, b2)
    }
}

/// Inverse of [`uniform_triangle`].
pub fn uniform_triangle_inverse(b: Vec2) -> Vec2 {
    if b.y > b.x {
        Vec2::new(2.0 * b.x, b.y + b.x)
    } else {
        Vec2::new(b.x + b.y, 2.0 * b.y)
    }
}
