//! Lanes as AVX2 registers.

#![allow(unsafe_code)]

use super::{Float, Int, LANES, Mask, Row, Wide};
use std::arch::x86_64::*;
use std::ops::{Add, BitAnd, BitOr, BitXor, Div, Mul, Neg, Not, Sub};

// SAFETY, for every block in this module: the types are only used inside functions with the
// `target_feature` AVX2, which are only entered after `SimdLevel::available` has found it on this
// processor. Loads and stores are unaligned ones on arrays of eight.

/// Eight lanes a register.
#[derive(Clone, Copy)]
pub struct Avx2;

/// Eight numbers.
#[derive(Clone, Copy)]
pub struct F(__m256);
/// Eight integers.
#[derive(Clone, Copy)]
pub struct I(__m256i);
/// All bits of a lane are set where it is true.
#[derive(Clone, Copy)]
pub struct M(__m256);

impl Wide for Avx2 {
    type F = F;
    type I = I;
    type M = M;
    #[inline(always)]
    fn columns(records: [&Row; LANES]) -> [F; LANES] {
        let mut rows = [F::load(records[0]); LANES];
        for lane in 1..LANES {
            rows[lane] = F::load(records[lane]);
        }
        transpose(rows)
    }
    #[inline(always)]
    fn records(columns: [F; LANES]) -> [Row; LANES] {
        let columns = transpose(columns);
        let mut rows = [Row::default(); LANES];
        for lane in 0..LANES {
            columns[lane].store(&mut rows[lane]);
        }
        rows
    }
}

/// Lane j of result i is lane i of operand j.
#[inline(always)]
fn transpose(r: [F; LANES]) -> [F; LANES] {
    // SAFETY: see the head of the module.
    unsafe {
        // Pairs of rows, then fours, then the halves of the registers.
        let a = _mm256_unpacklo_ps(r[0].0, r[1].0);
        let b = _mm256_unpackhi_ps(r[0].0, r[1].0);
        let c = _mm256_unpacklo_ps(r[2].0, r[3].0);
        let d = _mm256_unpackhi_ps(r[2].0, r[3].0);
        let e = _mm256_unpacklo_ps(r[4].0, r[5].0);
        let f = _mm256_unpackhi_ps(r[4].0, r[5].0);
        let g = _mm256_unpacklo_ps(r[6].0, r[7].0);
        let h = _mm256_unpackhi_ps(r[6].0, r[7].0);
        let ac = _mm256_shuffle_ps::<0x44>(a, c);
        let ca = _mm256_shuffle_ps::<0xEE>(a, c);
        let bd = _mm256_shuffle_ps::<0x44>(b, d);
        let db = _mm256_shuffle_ps::<0xEE>(b, d);
        let eg = _mm256_shuffle_ps::<0x44>(e, g);
        let ge = _mm256_shuffle_ps::<0xEE>(e, g);
        let fh = _mm256_shuffle_ps::<0x44>(f, h);
        let hf = _mm256_shuffle_ps::<0xEE>(f, h);
        [
            F(_mm256_permute2f128_ps::<0x20>(ac, eg)),
            F(_mm256_permute2f128_ps::<0x20>(ca, ge)),
            F(_mm256_permute2f128_ps::<0x20>(bd, fh)),
            F(_mm256_permute2f128_ps::<0x20>(db, hf)),
            F(_mm256_permute2f128_ps::<0x31>(ac, eg)),
            F(_mm256_permute2f128_ps::<0x31>(ca, ge)),
            F(_mm256_permute2f128_ps::<0x31>(bd, fh)),
            F(_mm256_permute2f128_ps::<0x31>(db, hf)),
        ]
    }
}

/// An operator that is one instruction.
macro_rules! instruction {
    ($type:ident, $trait:ident, $name:ident, $instruction:ident) => {
        impl $trait for $type {
            type Output = Self;
            #[inline(always)]
            fn $name(self, b: Self) -> Self {
                // SAFETY: see the head of the module.
                $type(unsafe { $instruction(self.0, b.0) })
            }
        }
    };
}

instruction!(F, Add, add, _mm256_add_ps);
instruction!(F, Sub, sub, _mm256_sub_ps);
instruction!(F, Mul, mul, _mm256_mul_ps);
instruction!(F, Div, div, _mm256_div_ps);
instruction!(I, Add, add, _mm256_add_epi32);
instruction!(I, Mul, mul, _mm256_mullo_epi32);
instruction!(I, BitAnd, bitand, _mm256_and_si256);
instruction!(I, BitOr, bitor, _mm256_or_si256);
instruction!(I, BitXor, bitxor, _mm256_xor_si256);
instruction!(M, BitAnd, bitand, _mm256_and_ps);
instruction!(M, BitOr, bitor, _mm256_or_ps);

impl Neg for F {
    type Output = Self;
    #[inline(always)]
    fn neg(self) -> Self {
        // SAFETY: see the head of the module.
        F(unsafe { _mm256_xor_ps(self.0, _mm256_set1_ps(-0.0)) })
    }
}

impl Not for M {
    type Output = Self;
    #[inline(always)]
    fn not(self) -> Self {
        // SAFETY: see the head of the module.
        M(unsafe { _mm256_xor_ps(self.0, _mm256_castsi256_ps(_mm256_set1_epi32(-1))) })
    }
}

impl Float for F {
    type I = I;
    type M = M;
    #[inline(always)]
    fn splat(x: f32) -> Self {
        // SAFETY: see the head of the module.
        F(unsafe { _mm256_set1_ps(x) })
    }
    #[inline(always)]
    fn load(from: &Row) -> Self {
        // SAFETY: see the head of the module.
        F(unsafe { _mm256_loadu_ps(from.0.as_ptr()) })
    }
    #[inline(always)]
    fn store(self, to: &mut Row) {
        // SAFETY: see the head of the module.
        unsafe { _mm256_storeu_ps(to.0.as_mut_ptr(), self.0) }
    }
    #[inline(always)]
    fn sqrt(self) -> Self {
        // SAFETY: see the head of the module.
        F(unsafe { _mm256_sqrt_ps(self.0) })
    }
    #[inline(always)]
    fn abs(self) -> Self {
        // SAFETY: see the head of the module.
        F(unsafe { _mm256_andnot_ps(_mm256_set1_ps(-0.0), self.0) })
    }
    #[inline(always)]
    fn min(self, b: Self) -> Self {
        // SAFETY: see the head of the module.
        F(unsafe { _mm256_min_ps(self.0, b.0) })
    }
    #[inline(always)]
    fn max(self, b: Self) -> Self {
        // SAFETY: see the head of the module.
        F(unsafe { _mm256_max_ps(self.0, b.0) })
    }
    #[inline(always)]
    fn lt(self, b: Self) -> M {
        // SAFETY: see the head of the module.
        M(unsafe { _mm256_cmp_ps::<_CMP_LT_OQ>(self.0, b.0) })
    }
    #[inline(always)]
    fn le(self, b: Self) -> M {
        // SAFETY: see the head of the module.
        M(unsafe { _mm256_cmp_ps::<_CMP_LE_OQ>(self.0, b.0) })
    }
    #[inline(always)]
    fn eq(self, b: Self) -> M {
        // SAFETY: see the head of the module.
        M(unsafe { _mm256_cmp_ps::<_CMP_EQ_OQ>(self.0, b.0) })
    }
    #[inline(always)]
    fn select(mask: M, yes: Self, no: Self) -> Self {
        // SAFETY: see the head of the module.
        F(unsafe { _mm256_blendv_ps(no.0, yes.0, mask.0) })
    }
    #[inline(always)]
    fn bits(self) -> I {
        // SAFETY: see the head of the module.
        I(unsafe { _mm256_castps_si256(self.0) })
    }
    #[inline(always)]
    fn from_bits(bits: I) -> Self {
        // SAFETY: see the head of the module.
        F(unsafe { _mm256_castsi256_ps(bits.0) })
    }
    #[inline(always)]
    fn from_int(x: I) -> Self {
        // SAFETY: see the head of the module.
        F(unsafe { _mm256_cvtepi32_ps(x.0) })
    }
    #[inline(always)]
    fn to_int(self) -> I {
        // SAFETY: see the head of the module.
        I(unsafe { _mm256_cvttps_epi32(self.0) })
    }
}

impl Int for I {
    type M = M;
    #[inline(always)]
    fn splat(x: u32) -> Self {
        // SAFETY: see the head of the module.
        I(unsafe { _mm256_set1_epi32(x as i32) })
    }
    #[inline(always)]
    fn load(from: &[u32; LANES]) -> Self {
        // SAFETY: see the head of the module.
        I(unsafe { _mm256_loadu_si256(from.as_ptr().cast()) })
    }
    #[inline(always)]
    fn shr<const BY: i32>(self) -> Self {
        // SAFETY: see the head of the module.
        I(unsafe { _mm256_srli_epi32::<BY>(self.0) })
    }
    #[inline(always)]
    fn eq(self, b: Self) -> M {
        // SAFETY: see the head of the module.
        M(unsafe { _mm256_castsi256_ps(_mm256_cmpeq_epi32(self.0, b.0)) })
    }
}

impl Mask for M {
    #[inline(always)]
    fn to_bits(self) -> u32 {
        // SAFETY: see the head of the module.
        unsafe { _mm256_movemask_ps(self.0) as u32 }
    }
    #[inline(always)]
    fn from_bits(bits: u32) -> Self {
        // SAFETY: see the head of the module.
        unsafe {
            let lane = _mm256_setr_epi32(1, 2, 4, 8, 16, 32, 64, 128);
            let set = _mm256_and_si256(_mm256_set1_epi32(bits as i32), lane);
            M(_mm256_castsi256_ps(_mm256_cmpeq_epi32(set, lane)))
        }
    }
}
