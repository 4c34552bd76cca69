//! Lanes as AVX-512 registers.

#![allow(unsafe_code)]

use super::{Float, Int, LANES, MOST_LANES as N, Mask, Row, Wide};
use std::arch::x86_64::*;
use std::ops::{Add, BitAnd, BitOr, BitXor, Div, Mul, Neg, Not, Sub};

// SAFETY, for every block in this module: the types are only used inside functions with the
// `target_feature` AVX-512F, which are only entered after `SimdLevel::available` has found it on this
// processor. Loads and stores are unaligned ones on arrays of eight or sixteen.

/// Sixteen lanes a register.
#[derive(Clone, Copy)]
pub struct Avx512;

/// Sixteen numbers.
#[derive(Clone, Copy)]
pub struct F(__m512);
/// Sixteen integers.
#[derive(Clone, Copy)]
pub struct I(__m512i);
/// A bit a lane.
#[derive(Clone, Copy)]
pub struct M(__mmask16);

impl Wide<N> for Avx512 {
    type F = F;
    type I = I;
    type M = M;
    #[inline(always)]
    fn columns(r: [&Row; N]) -> [F; LANES] {
        // A register holds two records: such that their quarters come out in order.
        let (a, b) = (pair(r[0], r[4]), pair(r[1], r[5]));
        let (c, d) = (pair(r[2], r[6]), pair(r[3], r[7]));
        let (e, f) = (pair(r[8], r[12]), pair(r[9], r[13]));
        let (g, h) = (pair(r[10], r[14]), pair(r[11], r[15]));
        let [a, b, c, d] = transpose([a, b, c, d]);
        let [e, f, g, h] = transpose([e, f, g, h]);
        // SAFETY: see the head of the module.
        unsafe {
            [
                F(_mm512_shuffle_f32x4::<0x88>(a, e)),
                F(_mm512_shuffle_f32x4::<0x88>(b, f)),
                F(_mm512_shuffle_f32x4::<0x88>(c, g)),
                F(_mm512_shuffle_f32x4::<0x88>(d, h)),
                F(_mm512_shuffle_f32x4::<0xDD>(a, e)),
                F(_mm512_shuffle_f32x4::<0xDD>(b, f)),
                F(_mm512_shuffle_f32x4::<0xDD>(c, g)),
                F(_mm512_shuffle_f32x4::<0xDD>(d, h)),
            ]
        }
    }
    #[inline(always)]
    fn records(c: [F; LANES]) -> [Row; N] {
        let front = transpose([c[0].0, c[1].0, c[2].0, c[3].0]);
        let back = transpose([c[4].0, c[5].0, c[6].0, c[7].0]);
        let mut records = [Row::default(); N];
        // SAFETY: see the head of the module.
        unsafe {
            let first = _mm512_setr_epi64(0, 1, 8, 9, 2, 3, 10, 11);
            let last = _mm512_setr_epi64(4, 5, 12, 13, 6, 7, 14, 15);
            for i in 0..4 {
                let (a, b) = (_mm512_castps_pd(front[i]), _mm512_castps_pd(back[i]));
                let low = _mm512_permutex2var_pd(a, first, b);
                let high = _mm512_permutex2var_pd(a, last, b);
                halves(low, &mut records, i, i + 4);
                halves(high, &mut records, i + 8, i + 12);
            }
        }
        records
    }
}

/// Two records.
#[inline(always)]
fn pair(a: &Row, b: &Row) -> __m512 {
    // SAFETY: see the head of the module.
    unsafe {
        let a = _mm256_castps_pd(_mm256_loadu_ps(a.0.as_ptr()));
        let b = _mm256_castps_pd(_mm256_loadu_ps(b.0.as_ptr()));
        _mm512_castpd_ps(_mm512_insertf64x4::<1>(_mm512_castpd256_pd512(a), b))
    }
}

/// Puts the halves of a register where they belong.
#[inline(always)]
fn halves(x: __m512d, records: &mut [Row; N], low: usize, high: usize) {
    // SAFETY: see the head of the module.
    unsafe {
        let (a, b) = (_mm512_castpd512_pd256(x), _mm512_extractf64x4_pd::<1>(x));
        _mm256_storeu_ps(records[low].0.as_mut_ptr(), _mm256_castpd_ps(a));
        _mm256_storeu_ps(records[high].0.as_mut_ptr(), _mm256_castpd_ps(b));
    }
}

/// Transposes four by four numbers in each quarter.
#[inline(always)]
fn transpose([a, b, c, d]: [__m512; 4]) -> [__m512; 4] {
    // SAFETY: see the head of the module.
    unsafe {
        let ab = _mm512_unpacklo_ps(a, b);
        let ba = _mm512_unpackhi_ps(a, b);
        let cd = _mm512_unpacklo_ps(c, d);
        let dc = _mm512_unpackhi_ps(c, d);
        [
            _mm512_shuffle_ps::<0x44>(ab, cd),
            _mm512_shuffle_ps::<0xEE>(ab, cd),
            _mm512_shuffle_ps::<0x44>(ba, dc),
            _mm512_shuffle_ps::<0xEE>(ba, dc),
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

instruction!(F, Add, add, _mm512_add_ps);
instruction!(F, Sub, sub, _mm512_sub_ps);
instruction!(F, Mul, mul, _mm512_mul_ps);
instruction!(F, Div, div, _mm512_div_ps);
instruction!(I, Add, add, _mm512_add_epi32);
instruction!(I, Mul, mul, _mm512_mullo_epi32);
instruction!(I, BitAnd, bitand, _mm512_and_si512);
instruction!(I, BitOr, bitor, _mm512_or_si512);
instruction!(I, BitXor, bitxor, _mm512_xor_si512);

impl BitAnd for M {
    type Output = Self;
    #[inline(always)]
    fn bitand(self, b: Self) -> Self {
        M(self.0 & b.0)
    }
}

impl BitOr for M {
    type Output = Self;
    #[inline(always)]
    fn bitor(self, b: Self) -> Self {
        M(self.0 | b.0)
    }
}

impl Not for M {
    type Output = Self;
    #[inline(always)]
    fn not(self) -> Self {
        M(!self.0)
    }
}

impl Neg for F {
    type Output = Self;
    #[inline(always)]
    fn neg(self) -> Self {
        Self::from_bits(self.bits() ^ I::splat(super::SIGN))
    }
}

impl Float<N> for F {
    type I = I;
    type M = M;
    #[inline(always)]
    fn splat(x: f32) -> Self {
        // SAFETY: see the head of the module.
        F(unsafe { _mm512_set1_ps(x) })
    }
    #[inline(always)]
    fn load(from: &Row<N>) -> Self {
        // SAFETY: see the head of the module.
        F(unsafe { _mm512_loadu_ps(from.0.as_ptr()) })
    }
    #[inline(always)]
    fn store(self, to: &mut Row<N>) {
        // SAFETY: see the head of the module.
        unsafe { _mm512_storeu_ps(to.0.as_mut_ptr(), self.0) }
    }
    #[inline(always)]
    fn sqrt(self) -> Self {
        // SAFETY: see the head of the module.
        F(unsafe { _mm512_sqrt_ps(self.0) })
    }
    #[inline(always)]
    fn abs(self) -> Self {
        Self::from_bits(self.bits() & I::splat(!super::SIGN))
    }
    #[inline(always)]
    fn min(self, b: Self) -> Self {
        // SAFETY: see the head of the module.
        F(unsafe { _mm512_min_ps(self.0, b.0) })
    }
    #[inline(always)]
    fn max(self, b: Self) -> Self {
        // SAFETY: see the head of the module.
        F(unsafe { _mm512_max_ps(self.0, b.0) })
    }
    #[inline(always)]
    fn lt(self, b: Self) -> M {
        // SAFETY: see the head of the module.
        M(unsafe { _mm512_cmp_ps_mask::<_CMP_LT_OQ>(self.0, b.0) })
    }
    #[inline(always)]
    fn le(self, b: Self) -> M {
        // SAFETY: see the head of the module.
        M(unsafe { _mm512_cmp_ps_mask::<_CMP_LE_OQ>(self.0, b.0) })
    }
    #[inline(always)]
    fn eq(self, b: Self) -> M {
        // SAFETY: see the head of the module.
        M(unsafe { _mm512_cmp_ps_mask::<_CMP_EQ_OQ>(self.0, b.0) })
    }
    #[inline(always)]
    fn select(mask: M, yes: Self, no: Self) -> Self {
        // SAFETY: see the head of the module.
        F(unsafe { _mm512_mask_blend_ps(mask.0, no.0, yes.0) })
    }
    #[inline(always)]
    fn bits(self) -> I {
        // SAFETY: see the head of the module.
        I(unsafe { _mm512_castps_si512(self.0) })
    }
    #[inline(always)]
    fn from_bits(bits: I) -> Self {
        // SAFETY: see the head of the module.
        F(unsafe { _mm512_castsi512_ps(bits.0) })
    }
    #[inline(always)]
    fn from_int(x: I) -> Self {
        // SAFETY: see the head of the module.
        F(unsafe { _mm512_cvtepi32_ps(x.0) })
    }
    #[inline(always)]
    fn to_int(self) -> I {
        // SAFETY: see the head of the module.
        I(unsafe { _mm512_cvttps_epi32(self.0) })
    }
}

impl Int<N> for I {
    type M = M;
    #[inline(always)]
    fn splat(x: u32) -> Self {
        // SAFETY: see the head of the module.
        I(unsafe { _mm512_set1_epi32(x as i32) })
    }
    #[inline(always)]
    fn load(from: &[u32; N]) -> Self {
        // SAFETY: see the head of the module.
        I(unsafe { _mm512_loadu_si512(from.as_ptr().cast()) })
    }
    #[inline(always)]
    fn shr<const BY: i32>(self) -> Self {
        // The count as a register: the intrinsic's constant is unsigned.
        // SAFETY: see the head of the module.
        I(unsafe { _mm512_srl_epi32(self.0, _mm_cvtsi32_si128(BY)) })
    }
    #[inline(always)]
    fn eq(self, b: Self) -> M {
        // SAFETY: see the head of the module.
        M(unsafe { _mm512_cmpeq_epi32_mask(self.0, b.0) })
    }
}

impl Mask for M {
    #[inline(always)]
    fn to_bits(self) -> u32 {
        self.0 as u32
    }
    #[inline(always)]
    fn from_bits(bits: u32) -> Self {
        M(bits as __mmask16)
    }
}
