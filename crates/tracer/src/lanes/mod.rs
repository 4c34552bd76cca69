//! Lanes of numbers for shading many paths at once: traits, a plain version that is the definition, and one
//! of eight lanes for AVX2 and one of sixteen for AVX-512 that give the same bits.
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
                    $of::$wide::<$crate::lanes::Avx2, { $crate::lanes::LANES }>($($arg),*)
                }
                #[target_feature(enable = "avx512f,avx512vl")]
                fn avx512($($arg: $type),*) -> $ret {
                    $of::$wide::<$crate::lanes::Avx512, { $crate::lanes::MOST_LANES }>($($arg),*)
                }
                if level >= $crate::SimdLevel::Avx512 {
                    // SAFETY: `SimdLevel::available` has found the features on this processor.
                    return unsafe { avx512($($arg),*) };
                }
                if level >= $crate::SimdLevel::Avx2 {
                    // SAFETY: as above.
                    return unsafe { avx2($($arg),*) };
                }
            }
            let _ = level;
            $of::$wide::<$crate::lanes::Plain, { $crate::lanes::LANES }>($($arg),*)
        }
    };
}
pub(crate) use entry;

#[cfg(target_arch = "x86_64")]
mod avx2;
#[cfg(target_arch = "x86_64")]
mod avx512;
mod plain;
mod vec3;

#[cfg(target_arch = "x86_64")]
pub use avx2::Avx2;
#[cfg(target_arch = "x86_64")]
pub use avx512::Avx512;
pub use plain::Plain;
pub use vec3::{Frame3, V3};

use std::ops::{Add, BitAnd, BitOr, BitXor, Div, Mul, Neg, Not, Sub};

/// Lanes where nothing else is said, and the quantities that a record holds.
pub const LANES: usize = 8;

/// The most lanes there are.
pub const MOST_LANES: usize = 16;

/// Numbers that belong together, as they lie in memory: a record of eight quantities, or the lanes of one.
#[derive(Clone, Copy, Debug, PartialEq)]
#[repr(C, align(32))]
pub struct Row<const N: usize = LANES>(pub [f32; N]);

impl Row {
    /// Nothing but zeros.
    pub const ZERO: Row = Row([0.0; LANES]);
}

impl<const N: usize> Default for Row<N> {
    fn default() -> Self {
        Row([0.0; N])
    }
}

// SAFETY: an array of eight numbers fills the 32 bytes that it is aligned to.
#[allow(unsafe_code)]
unsafe impl bytemuck::Zeroable for Row {}
// SAFETY: as above; any bits are numbers.
#[allow(unsafe_code)]
unsafe impl bytemuck::Pod for Row {}

/// Instructions for a number of lanes.
pub trait Wide<const N: usize = LANES>: Copy {
    /// Numbers.
    type F: Float<N, I = Self::I, M = Self::M>;
    /// 32-bit integers.
    type I: Int<N, M = Self::M>;
    /// Truth values.
    type M: Mask;
    /// Records to columns: lane j of result i is quantity i of record j.
    fn columns(records: [&Row; N]) -> [Self::F; LANES];
    /// Columns to records, the inverse of [`Wide::columns`].
    fn records(columns: [Self::F; LANES]) -> [Row; N];
    /// [`Wide::columns`] of records that lie side by side.
    #[inline(always)]
    fn turn(records: &[Row; N]) -> [Self::F; LANES] {
        let mut found = [&records[0]; N];
        for lane in 1..N {
            found[lane] = &records[lane];
        }
        Self::columns(found)
    }
    /// [`Wide::columns`] of the records at some places.
    #[inline(always)]
    fn gather(records: &[Row], at: &[u32; N]) -> [Self::F; LANES] {
        let mut found = [&records[at[0] as usize]; N];
        for lane in 1..N {
            found[lane] = &records[at[lane] as usize];
        }
        Self::columns(found)
    }
}

/// Lanes of f32.
pub trait Float<const N: usize = LANES>:
    Copy
    + Add<Output = Self>
    + Sub<Output = Self>
    + Mul<Output = Self>
    + Div<Output = Self>
    + Neg<Output = Self>
{
    /// Integers of as many lanes.
    type I: Int<N, M = Self::M>;
    /// Truth values of as many lanes.
    type M: Mask;
    /// The same in every lane.
    fn splat(x: f32) -> Self;
    /// From memory.
    fn load(from: &Row<N>) -> Self;
    /// To memory.
    fn store(self, to: &mut Row<N>);
    /// Square root.
    fn sqrt(self) -> Self;
    /// The magnitude with the sign of another.
    #[inline(always)]
    fn copysign(self, sign: Self) -> Self {
        let rest = self.bits() & Self::I::splat(!SIGN);
        Self::from_bits(rest | (sign.bits() & Self::I::splat(SIGN)))
    }
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
pub trait Int<const N: usize = LANES>:
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
    fn load(from: &[u32; N]) -> Self;
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

/// The bit of the sign.
const SIGN: u32 = 0x8000_0000;

#[cfg(test)]
mod tests;
