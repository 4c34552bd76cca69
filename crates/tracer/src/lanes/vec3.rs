//! Vectors of three, a lane each, with the roundings of `glam` and of [`crate::math`].

use super::{Float, LANES, Row, Wide};
use std::ops::{Add, Mul, Neg, Sub};

/// A vector in each lane.
#[derive(Clone, Copy)]
pub struct V3<W: Wide<N>, const N: usize = LANES> {
    /// First components.
    pub x: W::F,
    /// Second components.
    pub y: W::F,
    /// Third components.
    pub z: W::F,
}

impl<W: Wide<N>, const N: usize> V3<W, N> {
    /// Of components.
    #[inline(always)]
    pub fn new(x: W::F, y: W::F, z: W::F) -> Self {
        V3 { x, y, z }
    }

    /// The same in every lane.
    #[inline(always)]
    pub fn splat(v: glam::Vec3) -> Self {
        V3 {
            x: W::F::splat(v.x),
            y: W::F::splat(v.y),
            z: W::F::splat(v.z),
        }
    }

    /// From three rows of lanes.
    #[inline(always)]
    pub fn load(rows: &[Row<N>; 3]) -> Self {
        V3 {
            x: W::F::load(&rows[0]),
            y: W::F::load(&rows[1]),
            z: W::F::load(&rows[2]),
        }
    }

    /// To three rows of lanes.
    #[inline(always)]
    pub fn store(self, rows: &mut [Row<N>; 3]) {
        self.x.store(&mut rows[0]);
        self.y.store(&mut rows[1]);
        self.z.store(&mut rows[2]);
    }

    /// Scalar product, summed from x to z.
    #[inline(always)]
    pub fn dot(self, b: Self) -> W::F {
        self.x * b.x + self.y * b.y + self.z * b.z
    }

    /// Vector product.
    #[inline(always)]
    pub fn cross(self, b: Self) -> Self {
        V3 {
            x: self.y * b.z - b.y * self.z,
            y: self.z * b.x - b.z * self.x,
            z: self.x * b.y - b.x * self.y,
        }
    }

    /// Euclidean length.
    #[inline(always)]
    pub fn length(self) -> W::F {
        self.dot(self).sqrt()
    }

    /// With another third component.
    #[inline(always)]
    pub fn with_z(self, z: W::F) -> Self {
        V3 { z, ..self }
    }

    /// With length 1.
    #[inline(always)]
    pub fn normalized(self) -> Self {
        self * (W::F::splat(1.0) / self.length())
    }

    /// Component by component.
    #[inline(always)]
    pub fn times(self, b: Self) -> Self {
        V3 {
            x: self.x * b.x,
            y: self.y * b.y,
            z: self.z * b.z,
        }
    }

    /// [`crate::math::luminance`].
    #[inline(always)]
    pub fn luminance(self) -> W::F {
        let [r, g, b] = crate::math::LUMINANCE;
        W::F::splat(r) * self.x + W::F::splat(g) * self.y + W::F::splat(b) * self.z
    }

    /// The largest component.
    #[inline(always)]
    pub fn max_element(self) -> W::F {
        self.x.max(self.y.max(self.z))
    }

    /// The largest magnitude of a component.
    #[inline(always)]
    pub fn largest(self) -> W::F {
        self.x.abs().max(self.y.abs()).max(self.z.abs())
    }

    /// `yes` where `mask`, else `no`.
    #[inline(always)]
    pub fn select(mask: W::M, yes: Self, no: Self) -> Self {
        V3 {
            x: W::F::select(mask, yes.x, no.x),
            y: W::F::select(mask, yes.y, no.y),
            z: W::F::select(mask, yes.z, no.z),
        }
    }

    /// Whether all components are zero.
    #[inline(always)]
    pub fn is_zero(self) -> W::M {
        let zero = W::F::splat(0.0);
        self.x.eq(zero) & self.y.eq(zero) & self.z.eq(zero)
    }
}

impl<W: Wide<N>, const N: usize> Add for V3<W, N> {
    type Output = Self;
    #[inline(always)]
    fn add(self, b: Self) -> Self {
        V3 {
            x: self.x + b.x,
            y: self.y + b.y,
            z: self.z + b.z,
        }
    }
}

impl<W: Wide<N>, const N: usize> Sub for V3<W, N> {
    type Output = Self;
    #[inline(always)]
    fn sub(self, b: Self) -> Self {
        V3 {
            x: self.x - b.x,
            y: self.y - b.y,
            z: self.z - b.z,
        }
    }
}

/// By a number a lane.
impl<W: Wide<N>, const N: usize> Mul<W::F> for V3<W, N> {
    type Output = Self;
    #[inline(always)]
    fn mul(self, b: W::F) -> Self {
        V3 {
            x: self.x * b,
            y: self.y * b,
            z: self.z * b,
        }
    }
}

impl<W: Wide<N>, const N: usize> Neg for V3<W, N> {
    type Output = Self;
    #[inline(always)]
    fn neg(self) -> Self {
        V3 {
            x: -self.x,
            y: -self.y,
            z: -self.z,
        }
    }
}

/// Frames about normals; see [`crate::math::Frame::from_normal`].
#[derive(Clone, Copy)]
pub struct Frame3<W: Wide<N>, const N: usize = LANES> {
    s: V3<W, N>,
    t: V3<W, N>,
    n: V3<W, N>,
}

impl<W: Wide<N>, const N: usize> Frame3<W, N> {
    /// About unit vectors.
    #[inline(always)]
    pub fn from_normal(n: V3<W, N>) -> Self {
        let one = W::F::splat(1.0);
        let sign = one.copysign(n.z);
        let a = W::F::splat(-1.0) / (sign + n.z);
        let b = n.x * n.y * a;
        Frame3 {
            s: V3::new(one + sign * n.x * n.x * a, sign * b, -sign * n.x),
            t: V3::new(b, sign + n.y * n.y * a, -n.y),
            n,
        }
    }

    /// World to local.
    #[inline(always)]
    pub fn to_local(self, v: V3<W, N>) -> V3<W, N> {
        V3::new(v.dot(self.s), v.dot(self.t), v.dot(self.n))
    }

    /// Local to world.
    #[inline(always)]
    pub fn to_world(self, v: V3<W, N>) -> V3<W, N> {
        self.s * v.x + self.t * v.y + self.n * v.z
    }
}
