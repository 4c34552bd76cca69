//! The unit disk and regular polygons inside it: lenses and their apertures.

use crate::math::{FRAC_PI_4, INV_2PI, INV_PI, atan2, sin_cos_2pi, sin_cos_small};
use glam::Vec2;

/// Uniform point of the unit disk: squares about the centre become circles [ShirleyChiu97].
#[inline]
pub fn uniform_disk_concentric(u: Vec2) -> Vec2 {
    concentric(u).0
}

/// The point, and its signed distance from the centre.
#[inline]
pub(super) fn concentric(u: Vec2) -> (Vec2, f32) {
    let x = 2.0 * u.x - 1.0;
    let y = 2.0 * u.y - 1.0;
    if x.abs() > y.abs() {
        let (sin, cos) = sin_cos_small(FRAC_PI_4 * (y / x));
        (Vec2::new(x * cos, x * sin), x)
    } else if y != 0.0 {
        // phi = pi/2 - pi/4 x/y: sine and cosine change places.
        let (sin, cos) = sin_cos_small(FRAC_PI_4 * (x / y));
        (Vec2::new(y * sin, y * cos), y)
    } else {
        (Vec2::ZERO, 0.0)
    }
}

/// Density per area of the unit disk.
#[inline]
pub fn uniform_disk_pdf() -> f32 {
    INV_PI
}

/// Inverse of [`uniform_disk_concentric`].
pub fn uniform_disk_concentric_inverse(p: Vec2) -> Vec2 {
    let r = (p.x * p.x + p.y * p.y).sqrt();
    // The wedge decides which coordinate of the square is the radius.
    let (x, y) = if p.x.abs() > p.y.abs() {
        let r = r.copysign(p.x);
        (r, r * atan2(p.y / p.x, 1.0) / FRAC_PI_4)
    } else if p.y != 0.0 {
        let r = r.copysign(p.y);
        (r * atan2(p.x / p.y, 1.0) / FRAC_PI_4, r)
    } else {
        (0.0, 0.0)
    };
    Vec2::new(0.5 * (x + 1.0), 0.5 * (y + 1.0))
}

/// A regular polygon inscribed in the unit disk: an aperture of straight blades.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RegularPolygon {
    blades: f32,
    /// Angle of the first corner from +x, turns in [0, 1).
    turn: f32,
    pdf: f32,
}

impl RegularPolygon {
    /// With `blades` >= 3 corners, the first at `rotation` degrees from +x counter-clockwise.
    pub fn new(blades: u32, rotation: f32) -> Self {
        let blades = blades.max(3) as f32;
        let turn = rotation / 360.0;
        let turn = turn - turn.floor();
        let turn = if turn < 1.0 { turn } else { 0.0 };
        // Area: n/2 sin(2 pi / n).
        let pdf = 2.0 / (blades * sin_cos_2pi(1.0 / blades).0);
        RegularPolygon { blades, turn, pdf }
    }

    /// Corner number `k`, counted from 0 to the number of blades (which is corner 0 again).
    #[inline]
    fn corner(&self, k: f32) -> Vec2 {
        let t = k / self.blades + self.turn;
        let t = if t >= 1.0 { t - 1.0 } else { t };
        let (sin, cos) = sin_cos_2pi(t.max(0.0));
        Vec2::new(cos, sin)
    }

    /// Uniform point: u.x runs around the edge, u.y from the centre out.
    #[inline]
    pub fn sample(&self, u: Vec2) -> Vec2 {
        let v = u.x * self.blades;
        let k = (v as i32) as f32;
        let k = k.min(self.blades - 1.0);
        let v = v - k;
        (self.corner(k) * (1.0 - v) + self.corner(k + 1.0) * v) * u.y.sqrt()
    }

    /// Density per area, inside.
    #[inline]
    pub fn pdf(&self) -> f32 {
        self.pdf
    }

    /// Inverse of [`RegularPolygon::sample`] for points inside.
    pub fn inverse(&self, p: Vec2) -> Vec2 {
        if p == Vec2::ZERO {
            return Vec2::ZERO;
        }
        let mut t = atan2(p.y, p.x) * INV_2PI - self.turn;
        t -= t.floor();
        let k = (t * self.blades).floor().clamp(0.0, self.blades - 1.0);
        // p = a corner(k) + b corner(k + 1), by Cramer's rule.
        let (c0, c1) = (self.corner(k), self.corner(k + 1.0));
        let det = c0.x * c1.y - c0.y * c1.x;
        let a = (p.x * c1.y - p.y * c1.x) / det;
        let b = (c0.x * p.y - c0.y * p.x) / det;
        let r = a + b;
        Vec2::new((k + b / r) / self.blades, r * r)
    }
}
