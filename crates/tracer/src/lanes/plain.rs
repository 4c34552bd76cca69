//! Lanes as plain arrays: the definition, and what processors without AVX2 run.

use super::{Float, Int, LANES, Mask, Row, Wide};
use std::ops::{Add, BitAnd, BitOr, BitXor, Div, Mul, Neg, Not, Sub};

/// Plain arrays.
#[derive(Clone, Copy)]
pub struct Plain;

/// Numbers.
#[derive(Clone, Copy)]
pub struct F<const N: usize>([f32; N]);
/// Integers.
#[derive(Clone, Copy)]
pub struct I<const N: usize>([u32; N]);
/// Truth values.
#[derive(Clone, Copy)]
pub struct M<const N: usize>([bool; N]);

impl<const N: usize> Wide<N> for Plain {
    type F = F<N>;
    type I = I<N>;
    type M = M<N>;
    #[inline(always)]
    fn columns(records: [&Row; N]) -> [F<N>; LANES] {
        std::array::from_fn(|i| F(std::array::from_fn(|j| records[j].0[i])))
    }
    #[inline(always)]
    fn records(columns: [F<N>; LANES]) -> [Row; N] {
        std::array::from_fn(|i| Row(std::array::from_fn(|j| columns[j].0[i])))
    }
}

/// An operator that works lane by lane.
macro_rules! lane_by_lane {
    ($type:ident, $trait:ident, $name:ident, |$a:ident, $b:ident| $of:expr) => {
        impl<const N: usize> $trait for $type<N> {
            type Output = Self;
            #[inline(always)]
            fn $name(self, other: Self) -> Self {
                $type(std::array::from_fn(|i| {
                    let ($a, $b) = (self.0[i], other.0[i]);
                    $of
                }))
            }
        }
    };
}

lane_by_lane!(F, Add, add, |a, b| a + b);
lane_by_lane!(F, Sub, sub, |a, b| a - b);
lane_by_lane!(F, Mul, mul, |a, b| a * b);
lane_by_lane!(F, Div, div, |a, b| a / b);
lane_by_lane!(I, Add, add, |a, b| a.wrapping_add(b));
lane_by_lane!(I, Mul, mul, |a, b| a.wrapping_mul(b));
lane_by_lane!(I, BitAnd, bitand, |a, b| a & b);
lane_by_lane!(I, BitOr, bitor, |a, b| a | b);
lane_by_lane!(I, BitXor, bitxor, |a, b| a ^ b);
lane_by_lane!(M, BitAnd, bitand, |a, b| a & b);
lane_by_lane!(M, BitOr, bitor, |a, b| a | b);

impl<const N: usize> Neg for F<N> {
    type Output = Self;
    #[inline(always)]
    fn neg(self) -> Self {
        F(self.0.map(|x| -x))
    }
}

impl<const N: usize> Not for M<N> {
    type Output = Self;
    #[inline(always)]
    fn not(self) -> Self {
        M(self.0.map(|x| !x))
    }
}

impl<const N: usize> Float<N> for F<N> {
    type I = I<N>;
    type M = M<N>;
    #[inline(always)]
    fn splat(x: f32) -> Self {
        F([x; N])
    }
    #[inline(always)]
    fn load(from: &Row<N>) -> Self {
        F(from.0)
    }
    #[inline(always)]
    fn store(self, to: &mut Row<N>) {
        to.0 = self.0;
    }
    #[inline(always)]
    fn sqrt(self) -> Self {
        F(self.0.map(f32::sqrt))
    }
    #[inline(always)]
    fn abs(self) -> Self {
        F(self.0.map(f32::abs))
    }
    #[inline(always)]
    fn min(self, b: Self) -> Self {
        Self::select(self.lt(b), self, b)
    }
    #[inline(always)]
    fn max(self, b: Self) -> Self {
        Self::select(b.lt(self), self, b)
    }
    #[inline(always)]
    fn lt(self, b: Self) -> M<N> {
        M(std::array::from_fn(|i| self.0[i] < b.0[i]))
    }
    #[inline(always)]
    fn le(self, b: Self) -> M<N> {
        M(std::array::from_fn(|i| self.0[i] <= b.0[i]))
    }
    #[inline(always)]
    fn eq(self, b: Self) -> M<N> {
        M(std::array::from_fn(|i| self.0[i] == b.0[i]))
    }
    #[inline(always)]
    fn select(mask: M<N>, yes: Self, no: Self) -> Self {
        F(std::array::from_fn(|i| {
            if mask.0[i] { yes.0[i] } else { no.0[i] }
        }))
    }
    #[inline(always)]
    fn bits(self) -> I<N> {
        I(self.0.map(f32::to_bits))
    }
    #[inline(always)]
    fn from_bits(bits: I<N>) -> Self {
        F(bits.0.map(f32::from_bits))
    }
    #[inline(always)]
    fn from_int(x: I<N>) -> Self {
        F(x.0.map(|x| x as i32 as f32))
    }
    #[inline(always)]
    fn to_int(self) -> I<N> {
        I(self.0.map(|x| x as i32 as u32))
    }
}

impl<const N: usize> Int<N> for I<N> {
    type M = M<N>;
    #[inline(always)]
    fn splat(x: u32) -> Self {
        I([x; N])
    }
    #[inline(always)]
    fn load(from: &[u32; N]) -> Self {
        I(*from)
    }
    #[inline(always)]
    fn shr<const BY: i32>(self) -> Self {
        I(self.0.map(|x| x >> BY))
    }
    #[inline(always)]
    fn eq(self, b: Self) -> M<N> {
        M(std::array::from_fn(|i| self.0[i] == b.0[i]))
    }
}

impl<const N: usize> Mask for M<N> {
    #[inline(always)]
    fn to_bits(self) -> u32 {
        (0..N).fold(0, |bits, i| bits | (self.0[i] as u32) << i)
    }
    #[inline(always)]
    fn from_bits(bits: u32) -> Self {
        M(std::array::from_fn(|i| bits >> i & 1 == 1))
    }
}
