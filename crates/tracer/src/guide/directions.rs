//! Densities of directions: quadtrees over a square that stands for the sphere, fine where much light
//! comes from [Mueller17].
//!
//! The square is the octahedron, unfolded: a direction is a point of the octahedron |x| + |y| + |z| = 1
//! over its length, and an area of the square at a point with the length r stands for the solid angle of
//! 4 / r^3 times the area. No equal-area map is needed, as densities adapt; this one takes no more
//! than a division and a square root, in lanes too ([`super::lanes`] does the same with the same roundings).

use super::cells::partition;
use crate::lanes::Row;
use crate::math::ONE_MINUS_EPSILON;
use glam::{Vec2, Vec3};

/// A quadrant is cut again while it has more than this fraction of the light,
const FRACTION: f64 = 0.05;
/// and at least so many estimates,
const ESTIMATES_MIN: usize = 8;
/// but at most so often.
const DEPTH_MAX: u32 = 12;

/// What one path found out about the light that arrives from a direction.
#[derive(Clone, Copy, Debug)]
pub(super) struct Estimate {
    /// Where the light comes from, in the square.
    pub at: Vec2,
    /// Radiance times cosine over the density of the direction: the mean is irradiance.
    pub light: f32,
    /// The square of radiance times cosine over that density.
    pub square: f32,
}

/// Squares cut into four, those of all densities one after another. A row has the fraction of the left half, the
/// fractions of the lower quarters in the left and in the right half, the irradiance if it is a root,
/// and the rows of the quarters (bits; 0 if they are not cut): lower left, lower right, upper left, upper right.
pub(super) struct Quads(pub Vec<Row>);

impl Quads {
    /// No density yet; row 0 is no root.
    pub(super) fn new() -> Quads {
        Quads(vec![Row::ZERO])
    }

    /// Appends a density made from estimates, which are put into another order, of so many paths, some of which may
    /// have ended and found nothing. Its root; 0 if there is no light.
    pub(super) fn add(&mut self, estimates: &mut [Estimate], paths: usize) -> u32 {
        let total = light(estimates);
        if !(total > 0.0 && total.is_finite()) {
            return 0;
        }
        let root = self.0.len();
        let mass = self.cut(estimates, Vec2::ZERO, 1.0, total, 0);
        if !(mass > 0.0 && mass.is_finite()) {
            self.0.truncate(root);
            return 0;
        }
        self.0[root].0[3] = (total / paths as f64) as f32;
        root as u32
    }

    /// Appends the density that another one holds; its root.
    pub(super) fn append(&mut self, other: &Quads) -> u32 {
        // Row 0 of the other one stays behind.
        let before = self.0.len() as u32 - 1;
        for row in &other.0[1..] {
            let mut row = *row;
            for child in &mut row.0[4..] {
                if child.to_bits() != 0 {
                    *child = f32::from_bits(child.to_bits() + before);
                }
            }
            self.0.push(row);
        }
        before + 1
    }

    /// Appends a square and what is within; the mass of all.
    ///
    /// Mass goes by the root of the mean square of the estimates, not by their mean: directions whose
    /// light is uncertain deserve more samples than their share [Rath20].
    fn cut(
        &mut self,
        estimates: &mut [Estimate],
        corner: Vec2,
        size: f32,
        total: f64,
        depth: u32,
    ) -> f64 {
        let index = self.0.len();
        self.0.push(Row::ZERO);
        let half = 0.5 * size;
        let middle = corner + Vec2::splat(half);
        let low = partition(estimates, |e| e.at.y < middle.y);
        let (lower, upper) = estimates.split_at_mut(low);
        let low = partition(lower, |e| e.at.x < middle.x);
        let up = partition(upper, |e| e.at.x < middle.x);
        let (lower, upper) = (lower.split_at_mut(low), upper.split_at_mut(up));
        let parts = [lower.0, lower.1, upper.0, upper.1];
        let mut mass = [0.0; 4];
        for (i, part) in parts.into_iter().enumerate() {
            let goes_on = part.len() >= ESTIMATES_MIN
                && depth + 1 < DEPTH_MAX
                && light(part) > FRACTION * total;
            mass[i] = if goes_on {
                let corner = corner + half * Vec2::new((i & 1) as f32, (i >> 1) as f32);
                self.0[index].0[4 + i] = f32::from_bits(self.0.len() as u32);
                self.cut(part, corner, half, total, depth + 1)
            } else {
                let squares: f64 = part.iter().map(|e| f64::from(e.square)).sum();
                (squares * f64::from(half * half)).sqrt()
            };
        }
        let [ll, lr, ul, ur] = mass;
        let row = &mut self.0[index].0;
        row[0] = fraction(ll + ul, lr + ur);
        row[1] = fraction(ll, ul);
        row[2] = fraction(lr, ur);
        ll + lr + ul + ur
    }
}

/// The first of two masses over both; where there is none, nobody comes.
fn fraction(first: f64, second: f64) -> f32 {
    let both = first + second;
    if both > 0.0 {
        (first / both) as f32
    } else {
        0.5
    }
}

/// The light of estimates.
fn light(estimates: &[Estimate]) -> f64 {
    estimates.iter().map(|e| f64::from(e.light)).sum()
}

/// Density of directions at a place.
#[derive(Clone, Copy)]
pub(crate) struct Directions<'g> {
    pub(super) quads: &'g [Row],
    pub(super) root: u32,
}

impl Directions<'_> {
    /// Irradiance that scattered light is expected to bring.
    #[inline]
    pub(super) fn irradiance(&self) -> f32 {
        self.quads[self.root as usize].0[3]
    }

    /// A direction for a uniform point of the unit square, and its density per solid angle.
    #[inline]
    pub(crate) fn sample(&self, u: Vec2) -> (Vec3, f32) {
        let (at, density) = self.walk(u, true);
        let (w, length) = to_sphere(at);
        (w, density * (length * length * length))
    }

    /// Density of a direction per solid angle.
    #[inline]
    pub(crate) fn pdf(&self, w: Vec3) -> f32 {
        let (at, length) = to_square(w);
        let (_, density) = self.walk(at, false);
        density * (length * length * length)
    }

    /// Goes down a quadtree, to where uniform numbers lead or to where a point lies: the point and a
    /// quarter of the density there.
    #[inline(always)]
    fn walk(&self, from: Vec2, is_drawn: bool) -> (Vec2, f32) {
        let Vec2 { mut x, mut y } = from;
        let (mut left, mut low, mut size) = (0.0f32, 0.0f32, 1.0f32);
        let mut density = 0.25f32;
        let mut row = self.root;
        loop {
            let [q, q_left, q_right, _, children @ ..] = self.quads[row as usize].0;
            let right = divide(&mut x, q, is_drawn);
            density *= 2.0 * right.1;
            let q = if right.0 { q_right } else { q_left };
            let up = divide(&mut y, q, is_drawn);
            density *= 2.0 * up.1;
            size *= 0.5;
            left += if right.0 { size } else { 0.0 };
            low += if up.0 { size } else { 0.0 };
            row = children[usize::from(right.0) + 2 * usize::from(up.0)].to_bits();
            if row == 0 {
                return (Vec2::new(left + size * x, low + size * y), density);
            }
        }
    }
}

/// Takes one of two: by their fractions if a number in [0, 1) is to decide, or else which half it lies in. What is
/// left of the number is another such. Whether it is the second, and the fraction of the one taken.
#[inline(always)]
fn divide(u: &mut f32, first: f32, is_drawn: bool) -> (bool, f32) {
    let border = if is_drawn { first } else { 0.5 };
    let second = *u >= border;
    let (over, width) = if second {
        (*u - border, 1.0 - border)
    } else {
        (*u, border)
    };
    *u = (over / width).min(ONE_MINUS_EPSILON);
    (second, if second { 1.0 - first } else { first })
}

/// Square to sphere: the direction, and the length of the point of the octahedron.
#[inline(always)]
fn to_sphere(at: Vec2) -> (Vec3, f32) {
    let (u, v) = (2.0 * at.x - 1.0, 2.0 * at.y - 1.0);
    let z = 1.0 - (u.abs() + v.abs());
    let (x, y) = if z < 0.0 {
        ((1.0 - v.abs()).copysign(u), (1.0 - u.abs()).copysign(v))
    } else {
        (u, v)
    };
    let p = Vec3::new(x, y, z);
    let length = (p.x * p.x + p.y * p.y + p.z * p.z).sqrt();
    (p * (1.0 / length), length)
}

/// Sphere to square: the point, and the length of that of the octahedron.
#[inline(always)]
pub(super) fn to_square(w: Vec3) -> (Vec2, f32) {
    let length = 1.0 / (w.x.abs() + w.y.abs() + w.z.abs());
    let (x, y) = (w.x * length, w.y * length);
    let (u, v) = if w.z < 0.0 {
        ((1.0 - y.abs()).copysign(x), (1.0 - x.abs()).copysign(y))
    } else {
        (x, y)
    };
    let (u, v) = (0.5 * u + 0.5, 0.5 * v + 0.5);
    (
        Vec2::new(u.min(ONE_MINUS_EPSILON), v.min(ONE_MINUS_EPSILON)),
        length,
    )
}
