//! A rectangle that the light of the sky comes in through, sampled in proportion to what is seen of the
//! sky through it [Bitterli15]: the directions are laid out so that a window, seen from anywhere, fills
//! a rectangle of the layout.

use crate::math::{self, Rgb};
use glam::{DVec3, Vec2, Vec3};

/// Cells of the layout along a side: at least and at most.
const CELLS: (u32, u32) = (64, 1024);
/// Share of the mean that every cell has at least, so that nothing is missed that lies between samples.
const FLOOR: f64 = 0.02;

/// A portal ready for use.
pub(super) struct Portal {
    /// A corner and the opposite one.
    corner: Vec3,
    far: Vec3,
    /// Unit vectors along the edges, and towards the sky.
    x: Vec3,
    y: Vec3,
    z: Vec3,
    cells: usize,
    /// Sums of all cells with smaller indices: (cells + 1)^2 entries, row by row.
    sums: Box<[f64]>,
}

/// A part of the layout.
#[derive(Clone, Copy)]
struct Window {
    low: Vec2,
    high: Vec2,
}

impl Portal {
    /// `side` is the resolution of the sky's picture; `sky` its radiance in a direction of the world.
    pub fn new(corners: &[DVec3; 4], side: u32, sky: impl Fn(Vec3) -> Rgb) -> Portal {
        let single = |p: DVec3| Vec3::new(p.x as f32, p.y as f32, p.z as f32);
        let [p0, p1, p2, p3] = *corners;
        let (x, y) = ((p3 - p0).normalize(), (p1 - p0).normalize());
        let cells = side.clamp(CELLS.0, CELLS.1) as usize;
        let mut portal = Portal {
            corner: single(p0),
            far: single(p2),
            x: single(x),
            y: single(y),
            z: single(x.cross(y)),
            cells,
            sums: Box::new([]),
        };
        let mut values = Vec::with_capacity(cells * cells);
        for j in 0..cells {
            for i in 0..cells {
                let at = Vec2::new(i as f32 + 0.5, j as f32 + 0.5) / cells as f32;
                let (w, jacobian) = portal.direction(at);
                // Radiance per area of the layout.
                let value = f64::from(sky(w).max_element().max(0.0)) / f64::from(jacobian);
                values.push(if value.is_finite() { value } else { 0.0 });
            }
        }
        let mean = values.iter().sum::<f64>() / values.len() as f64;
        let floor = if mean > 0.0 { FLOOR * mean } else { 1.0 };
        let mut sums = vec![0.0; (cells + 1) * (cells + 1)];
        for j in 0..cells {
            let mut row = 0.0;
            for i in 0..cells {
                row += values[j * cells + i].max(floor);
                sums[(j + 1) * (cells + 1) + i + 1] = sums[j * (cells + 1) + i + 1] + row;
            }
        }
        portal.sums = sums.into();
        portal
    }

    /// Place in the layout of a direction towards the sky, and area of the layout per solid angle.
    /// `None` for directions the other way.
    #[inline]
    fn place(&self, w: Vec3) -> Option<(Vec2, f32)> {
        let v = Vec3::new(w.dot(self.x), w.dot(self.y), w.dot(self.z));
        if v.z <= 0.0 {
            return None;
        }
        let inv = 1.0 / v.dot(v);
        let (x2, y2) = (v.x * v.x * inv, v.y * v.y * inv);
        let z = v.z * inv.sqrt();
        let jacobian = z / (math::PI * math::PI * (1.0 - x2) * (1.0 - y2));
        // Angles about the two edges, from 0 to pi.
        let turn = |a: f32| (0.5 + math::atan2(a, v.z) * math::INV_PI).clamp(0.0, 1.0);
        Some((Vec2::new(turn(v.x), turn(v.y)), jacobian))
    }

    /// Inverse of [`Portal::place`].
    #[inline]
    fn direction(&self, at: Vec2) -> (Vec3, f32) {
        // Near the rim a tangent is no number any more.
        let limit = |x: f32| x.clamp(1e-5, 1.0 - 1e-5);
        let angle = |x: f32| {
            // The tangent of pi (x - 1/2), half a turn later.
            let (sin, cos) = math::sin_cos_2pi(0.25 + 0.5 * limit(x));
            sin / cos
        };
        let (x, y) = (angle(at.x), angle(at.y));
        let inv = 1.0 / (1.0 + x * x + y * y).sqrt();
        let v = Vec3::new(x * inv, y * inv, inv);
        let rest = (1.0 - v.x * v.x) * (1.0 - v.y * v.y);
        let jacobian = v.z / (math::PI * math::PI * rest);
        (self.x * v.x + self.y * v.y + self.z * v.z, jacobian)
    }

    /// The part of the layout that the portal fills as seen from a point on its inner side.
    #[inline]
    fn window(&self, from: Vec3) -> Option<Window> {
        let (a, _) = self.place(self.corner - from)?;
        let (b, _) = self.place(self.far - from)?;
        let window = Window {
            low: a.min(b),
            high: a.max(b),
        };
        (window.low.x < window.high.x && window.low.y < window.high.y).then_some(window)
    }

    /// Whether a ray leaves through the portal.
    #[inline]
    pub fn shows(&self, from: Vec3, direction: Vec3) -> bool {
        match (self.window(from), self.place(direction)) {
            (Some(window), Some((at, _))) => window.contains(at),
            _ => false,
        }
    }

    /// Sum over all cells up to a place: bilinear between the borders of cells, which is exact for
    /// values that are constant in each.
    #[inline]
    fn below(&self, x: f64, y: f64) -> f64 {
        let n = self.cells;
        let (x, y) = (x * n as f64, y * n as f64);
        let (i, j) = ((x as usize).min(n - 1), (y as usize).min(n - 1));
        let (fx, fy) = (x - i as f64, y - j as f64);
        let at = |i: usize, j: usize| self.sums[j * (n + 1) + i];
        (at(i, j) * (1.0 - fx) + at(i + 1, j) * fx) * (1.0 - fy)
            + (at(i, j + 1) * (1.0 - fx) + at(i + 1, j + 1) * fx) * fy
    }

    /// Sum over a part.
    #[inline]
    fn sum(&self, x0: f64, x1: f64, y0: f64, y1: f64) -> f64 {
        (self.below(x1, y1) - self.below(x0, y1)) - (self.below(x1, y0) - self.below(x0, y0))
    }

    /// Value of the cell at a place, per area of the layout.
    #[inline]
    fn value(&self, at: Vec2) -> f64 {
        let n = self.cells;
        let cell = |x: f32| ((x * n as f32) as usize).min(n - 1);
        let (i, j) = (cell(at.x), cell(at.y));
        let s = |i: usize, j: usize| self.sums[j * (n + 1) + i];
        let value = (s(i + 1, j + 1) - s(i, j + 1)) - (s(i + 1, j) - s(i, j));
        value * (n * n) as f64
    }

    /// A direction to the sky through the portal and its density per solid angle.
    pub fn sample(&self, from: Vec3, u: Vec2) -> Option<(Vec3, f32)> {
        let window = self.window(from)?;
        let (x0, x1) = (f64::from(window.low.x), f64::from(window.high.x));
        let (y0, y1) = (f64::from(window.low.y), f64::from(window.high.y));
        let total = self.sum(x0, x1, y0, y1);
        if total <= 0.0 {
            return None;
        }
        let x = self.invert(x0, x1, f64::from(u.x) * total, |x| self.sum(x0, x, y0, y1));
        // Along y, the column of cells that x lies in.
        let n = self.cells as f64;
        let column = (x * n).floor().min(n - 1.0);
        let (c0, c1) = (column / n, (column + 1.0) / n);
        let column_total = self.sum(c0, c1, y0, y1);
        let y = self.invert(y0, y1, f64::from(u.y) * column_total, |y| {
            self.sum(c0, c1, y0, y)
        });
        let at = Vec2::new(x as f32, y as f32).clamp(window.low, window.high);
        let (w, jacobian) = self.direction(at);
        let pdf = self.density(at, total) * jacobian;
        (pdf > 0.0 && pdf < f32::INFINITY).then_some((w, pdf))
    }

    fn density(&self, at: Vec2, total: f64) -> f32 {
        // `total` sums values of cells, each of which covers a share 1 / n^2 of the layout.
        (self.value(at) / total) as f32
    }

    /// Where a rising sum reaches `wanted`: the cell by bisection over the borders, then linear.
    fn invert(&self, low: f64, high: f64, wanted: f64, sum: impl Fn(f64) -> f64) -> f64 {
        let n = self.cells as f64;
        let (mut first, mut last) = ((low * n).floor() as i64, (high * n).ceil() as i64);
        while last - first > 1 {
            let middle = (first + last) / 2;
            if sum((middle as f64 / n).clamp(low, high)) <= wanted {
                first = middle;
            } else {
                last = middle;
            }
        }
        let (a, b) = (
            (first as f64 / n).clamp(low, high),
            (last as f64 / n).clamp(low, high),
        );
        let (sa, sb) = (sum(a), sum(b));
        if sb > sa {
            a + (b - a) * ((wanted - sa) / (sb - sa)).clamp(0.0, 1.0)
        } else {
            a
        }
    }

    /// Density of [`Portal::sample`] per solid angle.
    pub fn pdf(&self, from: Vec3, direction: Vec3) -> f32 {
        let (Some(window), Some((at, jacobian))) = (self.window(from), self.place(direction))
        else {
            return 0.0;
        };
        if !window.contains(at) {
            return 0.0;
        }
        let total = self.sum(
            f64::from(window.low.x),
            f64::from(window.high.x),
            f64::from(window.low.y),
            f64::from(window.high.y),
        );
        let pdf = self.density(at, total) * jacobian;
        if pdf < f32::INFINITY { pdf } else { 0.0 }
    }
}

impl Window {
    #[inline]
    fn contains(&self, at: Vec2) -> bool {
        at.x >= self.low.x && at.x <= self.high.x && at.y >= self.low.y && at.y <= self.high.y
    }
}
