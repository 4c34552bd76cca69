//! Eight lanes of numbers for shading many paths at once: traits, a plain version that is the
//! definition, and one for AVX2 that gives the same bits.
//!
//! As in the traversal kernel every operation is one IEEE operation a lane: no fused multiply-add, no
//! estimates of reciprocals. `min` and `max` return the second operand where a lane is NaN.
//!
//! Code that uses lanes is generic over [`Wide`], is `#[inline(always)]` all the way up to an entry
//! point of a level, and has no closures and no `map` over arrays: those are compiled without the
//! instructions of the level and then called.

#![allow(
    clippy::needless_range_loop,
    reason = "a lane is a place in several arrays at once"
)]

/// Makes an entry point that picks a level out of a function that is generic over [`Wide`].
macro_rules! entry {
    (
        $(#[$doc:meta])*
        $vis:vis fn $name:ident($($arg:ident: $type:ty),* $(,)?) -> $ret:ty = $of:ident :: $wide:ident;
    ) => {
        $(#[$doc])*
        #[allow(unsafe_code)]
        $vis fn $name(level: $crate::SimdLevel, $($arg: $type),*) -> $ret {
            #[cfg(target_arch = "x86_64")]
            {
                #[target_feature(enable = "avx2")]
                fn avx2($($arg: $type),*) -> $ret {
                    $of::$wide::<$crate::lanes::Avx2>($($arg),*)
                }
                // AVX-512 would bring nothing but its wider copies, which slow the clock down.
                if level >= $crate::SimdLevel::Avx2 {
                    // SAFETY: `SimdLevel::available` has found the feature on this processor.
                    return unsafe { avx2($($arg),*) };
                }
            }
            let _ = level;
            $of::$wide::<$crate::lanes::Plain>($($arg),*)
        }
    };
}
pub(crate) use entry;

#[cfg(target_arch = "x86_64")]
mod avx2;
mod plain;
mod vec3;

#[cfg(target_arch = "x86_64")]
pub use avx2::Avx2;
pub use plain::Plain;
pub use vec3::{Frame3, V3};

use std::ops::{Add, BitAnd, BitOr, BitXor, Div, Mul, Neg, Not, Sub};

/// Lanes of everything in this module.
pub const LANES: usize = 8;

/// Eight numbers that belong together, as they lie in memory: a lane's worth of eight quantities, or
/// eight lanes of one.
#[derive(Clone, Copy, Debug, Default, PartialEq, bytemuck::Pod, bytemuck::Zeroable)]
#[repr(C, align(32))]
pub struct Row(pub [f32; LANES]);

/// Instructions for eight lanes.
pub trait Wide: Copy {
    /// Numbers.
    type F: Float<I = Self::I, M = Self::M>;
    /// 32-bit integers.
    type I: Int<M = Self::M>;
    /// Truth values.
    type M: Mask;
    /// Rows to columns: lane j of result i is lane i of operand j.
    fn transpose(rows: [Self::F; LANES]) -> [Self::F; LANES];
}

/// Lanes of f32.
pub trait Float:
    Copy
    + Add<Output = Self>
    + Sub<Output = Self>
    + Mul<Output = Self>
    + Div<Output = Self>
    + Neg<Output = Self>
{
    /// Integers of as many lanes.
    type I;
    /// Truth values of as many lanes.
    type M;
    /// The same in every lane.
    fn splat(x: f32) -> Self;
    /// From memory.
    fn load(from: &Row) -> Self;
    /// To memory.
    fn store(self, to: &mut Row);
    /// Square root.
    fn sqrt(self) -> Self;
    /// Sign cleared.
    fn abs(self) -> Self;
    /// a < b ? a : b
    fn min(self, b: Self) -> Self;
    /// a > b ? a : b
    fn max(self, b: Self) -> Self;
    /// a < b
    fn lt(self, b: Self) -> Self::M;
    /// a <= b
    fn le(self, b: Self) -> Self::M;
    /// a == b
    fn eq(self, b: Self) -> Self::M;
    /// `yes` where `mask`, else `no`.
    fn select(mask: Self::M, yes: Self, no: Self) -> Self;
    /// The bits as integers.
    fn bits(self) -> Self::I;
    /// Integers as bits.
    fn from_bits(bits: Self::I) -> Self;
    /// From signed integers, rounded to nearest.
    fn from_int(x: Self::I) -> Self;
    /// To signed integers, cut off; the value must fit.
    fn to_int(self) -> Self::I;
}

/// Lanes of 32-bit integers; arithmetic wraps.
pub trait Int:
    Copy
    + Add<Output = Self>
    + Mul<Output = Self>
    + BitAnd<Output = Self>
    + BitOr<Output = Self>
    + BitXor<Output = Self>
{
    /// Truth values of as many lanes.
    type M;
    /// The same in every lane.
    fn splat(x: u32) -> Self;
    /// From memory.
    fn load(from: &[u32; LANES]) -> Self;
    /// Shifted right, zeros coming in.
    fn shr<const BY: i32>(self) -> Self;
    /// a == b
    fn eq(self, b: Self) -> Self::M;
}

/// Lanes of truth values.
pub trait Mask: Copy + BitAnd<Output = Self> + BitOr<Output = Self> + Not<Output = Self> {
    /// Bit i of the result is lane i.
    fn to_bits(self) -> u32;
    /// Lane i is bit i.
    fn from_bits(bits: u32) -> Self;
}

/// Columns of the rows at eight places.
#[inline(always)]
pub fn gather<W: Wide>(rows: &[Row], at: &[u32; LANES]) -> [W::F; LANES] {
    W::transpose([
        W::F::load(&rows[at[0] as usize]),
        W::F::load(&rows[at[1] as usize]),
        W::F::load(&rows[at[2] as usize]),
        W::F::load(&rows[at[3] as usize]),
        W::F::load(&rows[at[4] as usize]),
        W::F::load(&rows[at[5] as usize]),
        W::F::load(&rows[at[6] as usize]),
        W::F::load(&rows[at[7] as usize]),
    ])
}

/// The bit of the sign.
const SIGN: u32 = 0x8000_0000;

/// `magnitude` with the sign of `sign`.
#[inline(always)]
pub fn copysign<W: Wide>(magnitude: W::F, sign: W::F) -> W::F {
    let bit = W::I::splat(SIGN);
    let rest = W::I::splat(!SIGN);
    W::F::from_bits((magnitude.bits() & rest) | (sign.bits() & bit))
}

#[cfg(test)]
mod tests;
