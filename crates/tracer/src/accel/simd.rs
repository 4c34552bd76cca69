//! Lanes of f32 for the traversal kernel: one trait, a scalar twin that is the definition, and x86
//! versions that give the same bits. The only module with unsafe code.
//!
//! No fused multiply-add, no reciprocal estimates: every operation here is one IEEE operation per
//! lane. `min` and `max` return the second operand when a lane is NaN, as the SSE instructions do.

#![allow(unsafe_code)]

use super::node::{Node, TriBlock};
use super::{kernel, packet};
use crate::light::cluster;

/// N lanes of f32.
pub trait Lanes<const N: usize>: Copy {
    /// From memory.
    fn load(from: &[f32; N]) -> Self;
    /// The same in every lane.
    fn splat(x: f32) -> Self;
    /// To memory.
    fn store(self) -> [f32; N];
    /// a + b
    fn add(self, b: Self) -> Self;
    /// a - b
    fn sub(self, b: Self) -> Self;
    /// a * b
    fn mul(self, b: Self) -> Self;
    /// a / b
    fn div(self, b: Self) -> Self;
    /// a < b ? a : b
    fn min(self, b: Self) -> Self;
    /// a > b ? a : b
    fn max(self, b: Self) -> Self;
    /// Bit i is set where a <= b in lane i.
    fn le(self, b: Self) -> u32;
    /// Sign bit cleared.
    fn abs(self) -> Self;
    /// With the sign bit of another.
    fn copysign(self, sign: Self) -> Self;
    /// Square root.
    fn sqrt(self) -> Self;
    /// self <= b ? yes : no
    fn select_le(self, b: Self, yes: Self, no: Self) -> Self;
}

/// A choice of instructions.
pub trait Simd: Copy {
    /// Eight lanes: the children of a node.
    type F8: Lanes<8>;
    /// Four lanes: the triangles of a block.
    type F4: Lanes<4>;
    /// Asks the cache for what will be read soon; nothing where there is no such instruction.
    #[inline(always)]
    fn prefetch<T>(_from: *const T) {}
    /// Packs the children in a mask, in order, and their keys; what follows them in the outputs is unspecified.
    /// Keys are distances, not negative; those outside of the mask have all bits set. Returns which of the packed
    /// is nearest, but for the last three bits of its distance and only if `NEAREST`.
    #[inline(always)]
    fn pack<const NEAREST: bool>(
        keys: Self::F8,
        mask: u32,
        children: &[u32; 8],
        words: &mut [u32; 8],
        ts: &mut [f32; 8],
    ) -> usize {
        let mut mask = mask;
        let keys = keys.store();
        let (mut count, mut nearest, mut least) = (0, 0, f32::INFINITY);
        while mask != 0 {
            let lane = mask.trailing_zeros() as usize & 7;
            mask &= mask - 1;
            words[count & 7] = children[lane];
            ts[count & 7] = keys[lane];
            if NEAREST && keys[lane] < least {
                (nearest, least) = (count, keys[lane]);
            }
            count += 1;
        }
        nearest
    }
}

/// Plain arrays: the definition, and what other processors run.
#[derive(Clone, Copy)]
pub struct Scalar;
impl Simd for Scalar {
    type F8 = [f32; 8];
    type F4 = [f32; 4];
}

impl<const N: usize> Lanes<N> for [f32; N] {
    #[inline(always)]
    fn load(from: &[f32; N]) -> Self {
        *from
    }
    #[inline(always)]
    fn splat(x: f32) -> Self {
        [x; N]
    }
    #[inline(always)]
    fn store(self) -> [f32; N] {
        self
    }
    #[inline(always)]
    fn add(self, b: Self) -> Self {
        std::array::from_fn(|i| self[i] + b[i])
    }
    #[inline(always)]
    fn sub(self, b: Self) -> Self {
        std::array::from_fn(|i| self[i] - b[i])
    }
    #[inline(always)]
    fn mul(self, b: Self) -> Self {
        std::array::from_fn(|i| self[i] * b[i])
    }
    #[inline(always)]
    fn div(self, b: Self) -> Self {
        std::array::from_fn(|i| self[i] / b[i])
    }
    #[inline(always)]
    fn min(self, b: Self) -> Self {
        std::array::from_fn(|i| if self[i] < b[i] { self[i] } else { b[i] })
    }
    #[inline(always)]
    fn max(self, b: Self) -> Self {
        std::array::from_fn(|i| if self[i] > b[i] { self[i] } else { b[i] })
    }
    #[inline(always)]
    fn le(self, b: Self) -> u32 {
        (0..N).fold(0, |m, i| m | ((self[i] <= b[i]) as u32) << i)
    }
    #[inline(always)]
    fn abs(self) -> Self {
        self.map(f32::abs)
    }
    #[inline(always)]
    fn copysign(self, sign: Self) -> Self {
        std::array::from_fn(|i| self[i].copysign(sign[i]))
    }
    #[inline(always)]
    fn sqrt(self) -> Self {
        self.map(f32::sqrt)
    }
    #[inline(always)]
    fn select_le(self, b: Self, yes: Self, no: Self) -> Self {
        std::array::from_fn(|i| if self[i] <= b[i] { yes[i] } else { no[i] })
    }
}

/// Which instructions the kernels use. Chosen once, passed down.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum SimdLevel {
    /// Plain arrays.
    Scalar,
    /// Two halves of four lanes; every x86-64 has it.
    Sse2,
    /// Eight lanes.
    Avx2,
    /// Eight lanes with the AVX-512VL encodings and registers.
    Avx512,
}

impl SimdLevel {
    /// As it is written in `BROLLY_SIMD` and in logs.
    pub fn name(self) -> &'static str {
        match self {
            SimdLevel::Scalar => "scalar",
            SimdLevel::Sse2 => "sse2",
            SimdLevel::Avx2 => "avx2",
            SimdLevel::Avx512 => "avx512",
        }
    }

    /// By name.
    pub fn from_name(name: &str) -> Option<SimdLevel> {
        [
            SimdLevel::Scalar,
            SimdLevel::Sse2,
            SimdLevel::Avx2,
            SimdLevel::Avx512,
        ]
        .into_iter()
        .find(|l| l.name() == name)
    }

    /// The best that this processor runs.
    pub fn best() -> SimdLevel {
        #[cfg(target_arch = "x86_64")]
        {
            // Every processor with AVX2 has the others as well, but a virtual one may hide them.
            if std::arch::is_x86_feature_detected!("avx2")
                && std::arch::is_x86_feature_detected!("popcnt")
                && std::arch::is_x86_feature_detected!("bmi1")
                && std::arch::is_x86_feature_detected!("bmi2")
            {
                if std::arch::is_x86_feature_detected!("avx512vl")
                    && std::arch::is_x86_feature_detected!("avx512f")
                {
                    return SimdLevel::Avx512;
                }
                return SimdLevel::Avx2;
            }
            SimdLevel::Sse2
        }
        #[cfg(not(target_arch = "x86_64"))]
        SimdLevel::Scalar
    }

    /// This level, or the best that this processor runs if that is lower. Levels above are never
    /// returned, so a kernel entered by level is always one that the processor has.
    pub fn available(self) -> SimdLevel {
        self.min(SimdLevel::best())
    }
}

#[cfg(target_arch = "x86_64")]
mod x86 {
    use super::{Lanes, Simd};
    use std::arch::x86_64::*;

    // SAFETY, for every block in this module: the types are only used inside functions with the
    // matching `target_feature` (SSE2 is part of x86-64), which are only entered after
    // `SimdLevel::available` has found the feature on this processor. Loads and stores are unaligned
    // ones on arrays of the right length.

    #[derive(Clone, Copy)]
    pub struct X4(__m128);
    impl Lanes<4> for X4 {
        #[inline(always)]
        fn load(from: &[f32; 4]) -> Self {
            // SAFETY: see the head of the module.
            X4(unsafe { _mm_loadu_ps(from.as_ptr()) })
        }
        #[inline(always)]
        fn splat(x: f32) -> Self {
            // SAFETY: see the head of the module.
            X4(unsafe { _mm_set1_ps(x) })
        }
        #[inline(always)]
        fn store(self) -> [f32; 4] {
            let mut to = [0.0; 4];
            // SAFETY: see the head of the module.
            unsafe { _mm_storeu_ps(to.as_mut_ptr(), self.0) };
            to
        }
        #[inline(always)]
        fn add(self, b: Self) -> Self {
            // SAFETY: see the head of the module.
            X4(unsafe { _mm_add_ps(self.0, b.0) })
        }
        #[inline(always)]
        fn sub(self, b: Self) -> Self {
            // SAFETY: see the head of the module.
            X4(unsafe { _mm_sub_ps(self.0, b.0) })
        }
        #[inline(always)]
        fn mul(self, b: Self) -> Self {
            // SAFETY: see the head of the module.
            X4(unsafe { _mm_mul_ps(self.0, b.0) })
        }
        #[inline(always)]
        fn div(self, b: Self) -> Self {
            // SAFETY: see the head of the module.
            X4(unsafe { _mm_div_ps(self.0, b.0) })
        }
        #[inline(always)]
        fn min(self, b: Self) -> Self {
            // SAFETY: see the head of the module.
            X4(unsafe { _mm_min_ps(self.0, b.0) })
        }
        #[inline(always)]
        fn max(self, b: Self) -> Self {
            // SAFETY: see the head of the module.
            X4(unsafe { _mm_max_ps(self.0, b.0) })
        }
        #[inline(always)]
        fn le(self, b: Self) -> u32 {
            // SAFETY: see the head of the module.
            unsafe { _mm_movemask_ps(_mm_cmple_ps(self.0, b.0)) as u32 }
        }
        #[inline(always)]
        fn abs(self) -> Self {
            // SAFETY: see the head of the module.
            X4(unsafe { _mm_andnot_ps(_mm_set1_ps(-0.0), self.0) })
        }
        #[inline(always)]
        fn copysign(self, sign: Self) -> Self {
            // SAFETY: see the head of the module.
            unsafe {
                let bit = _mm_set1_ps(-0.0);
                X4(_mm_or_ps(
                    _mm_andnot_ps(bit, self.0),
                    _mm_and_ps(bit, sign.0),
                ))
            }
        }
        #[inline(always)]
        fn sqrt(self) -> Self {
            // SAFETY: see the head of the module.
            X4(unsafe { _mm_sqrt_ps(self.0) })
        }
        #[inline(always)]
        fn select_le(self, b: Self, yes: Self, no: Self) -> Self {
            // SAFETY: see the head of the module.
            unsafe {
                let mask = _mm_cmple_ps(self.0, b.0);
                X4(_mm_or_ps(
                    _mm_and_ps(mask, yes.0),
                    _mm_andnot_ps(mask, no.0),
                ))
            }
        }
    }

    /// Two halves of four lanes.
    #[derive(Clone, Copy)]
    pub struct X44(X4, X4);
    fn halves(from: &[f32; 8]) -> (&[f32; 4], &[f32; 4]) {
        let (a, b) = from.split_at(4);
        match (a.try_into(), b.try_into()) {
            (Ok(a), Ok(b)) => (a, b),
            _ => unreachable!("eight is twice four"),
        }
    }
    impl Lanes<8> for X44 {
        #[inline(always)]
        fn load(from: &[f32; 8]) -> Self {
            let (a, b) = halves(from);
            X44(X4::load(a), X4::load(b))
        }
        #[inline(always)]
        fn splat(x: f32) -> Self {
            X44(X4::splat(x), X4::splat(x))
        }
        #[inline(always)]
        fn store(self) -> [f32; 8] {
            let (a, b) = (self.0.store(), self.1.store());
            [a[0], a[1], a[2], a[3], b[0], b[1], b[2], b[3]]
        }
        #[inline(always)]
        fn add(self, b: Self) -> Self {
            X44(self.0.add(b.0), self.1.add(b.1))
        }
        #[inline(always)]
        fn sub(self, b: Self) -> Self {
            X44(self.0.sub(b.0), self.1.sub(b.1))
        }
        #[inline(always)]
        fn mul(self, b: Self) -> Self {
            X44(self.0.mul(b.0), self.1.mul(b.1))
        }
        #[inline(always)]
        fn div(self, b: Self) -> Self {
            X44(self.0.div(b.0), self.1.div(b.1))
        }
        #[inline(always)]
        fn min(self, b: Self) -> Self {
            X44(self.0.min(b.0), self.1.min(b.1))
        }
        #[inline(always)]
        fn max(self, b: Self) -> Self {
            X44(self.0.max(b.0), self.1.max(b.1))
        }
        #[inline(always)]
        fn le(self, b: Self) -> u32 {
            self.0.le(b.0) | self.1.le(b.1) << 4
        }
        #[inline(always)]
        fn abs(self) -> Self {
            X44(self.0.abs(), self.1.abs())
        }
        #[inline(always)]
        fn copysign(self, sign: Self) -> Self {
            X44(self.0.copysign(sign.0), self.1.copysign(sign.1))
        }
        #[inline(always)]
        fn sqrt(self) -> Self {
            X44(self.0.sqrt(), self.1.sqrt())
        }
        #[inline(always)]
        fn select_le(self, b: Self, yes: Self, no: Self) -> Self {
            X44(
                self.0.select_le(b.0, yes.0, no.0),
                self.1.select_le(b.1, yes.1, no.1),
            )
        }
    }

    #[derive(Clone, Copy)]
    pub struct X8(__m256);
    impl Lanes<8> for X8 {
        #[inline(always)]
        fn load(from: &[f32; 8]) -> Self {
            // SAFETY: see the head of the module.
            X8(unsafe { _mm256_loadu_ps(from.as_ptr()) })
        }
        #[inline(always)]
        fn splat(x: f32) -> Self {
            // SAFETY: see the head of the module.
            X8(unsafe { _mm256_set1_ps(x) })
        }
        #[inline(always)]
        fn store(self) -> [f32; 8] {
            let mut to = [0.0; 8];
            // SAFETY: see the head of the module.
            unsafe { _mm256_storeu_ps(to.as_mut_ptr(), self.0) };
            to
        }
        #[inline(always)]
        fn add(self, b: Self) -> Self {
            // SAFETY: see the head of the module.
            X8(unsafe { _mm256_add_ps(self.0, b.0) })
        }
        #[inline(always)]
        fn sub(self, b: Self) -> Self {
            // SAFETY: see the head of the module.
            X8(unsafe { _mm256_sub_ps(self.0, b.0) })
        }
        #[inline(always)]
        fn mul(self, b: Self) -> Self {
            // SAFETY: see the head of the module.
            X8(unsafe { _mm256_mul_ps(self.0, b.0) })
        }
        #[inline(always)]
        fn div(self, b: Self) -> Self {
            // SAFETY: see the head of the module.
            X8(unsafe { _mm256_div_ps(self.0, b.0) })
        }
        #[inline(always)]
        fn min(self, b: Self) -> Self {
            // SAFETY: see the head of the module.
            X8(unsafe { _mm256_min_ps(self.0, b.0) })
        }
        #[inline(always)]
        fn max(self, b: Self) -> Self {
            // SAFETY: see the head of the module.
            X8(unsafe { _mm256_max_ps(self.0, b.0) })
        }
        #[inline(always)]
        fn le(self, b: Self) -> u32 {
            // SAFETY: see the head of the module.
            unsafe { _mm256_movemask_ps(_mm256_cmp_ps::<_CMP_LE_OQ>(self.0, b.0)) as u32 }
        }
        #[inline(always)]
        fn abs(self) -> Self {
            // SAFETY: see the head of the module.
            X8(unsafe { _mm256_andnot_ps(_mm256_set1_ps(-0.0), self.0) })
        }
        #[inline(always)]
        fn copysign(self, sign: Self) -> Self {
            // SAFETY: see the head of the module.
            unsafe {
                let bit = _mm256_set1_ps(-0.0);
                X8(_mm256_or_ps(
                    _mm256_andnot_ps(bit, self.0),
                    _mm256_and_ps(bit, sign.0),
                ))
            }
        }
        #[inline(always)]
        fn sqrt(self) -> Self {
            // SAFETY: see the head of the module.
            X8(unsafe { _mm256_sqrt_ps(self.0) })
        }
        #[inline(always)]
        fn select_le(self, b: Self, yes: Self, no: Self) -> Self {
            // SAFETY: see the head of the module.
            unsafe {
                let mask = _mm256_cmp_ps::<_CMP_LE_OQ>(self.0, b.0);
                X8(_mm256_blendv_ps(no.0, yes.0, mask))
            }
        }
    }

    /// Prefetches all cache lines of a value.
    #[inline(always)]
    fn lines<T>(from: *const T) {
        let mut at = 0;
        while at < size_of::<T>() {
            // SAFETY: a prefetch has no effect but on the cache, whatever the address.
            unsafe { _mm_prefetch::<_MM_HINT_T0>(from.cast::<i8>().wrapping_add(at)) };
            at += 64;
        }
    }

    /// Four and four lanes.
    #[derive(Clone, Copy)]
    pub struct Sse2;
    impl Simd for Sse2 {
        type F8 = X44;
        type F4 = X4;
        #[inline(always)]
        fn prefetch<T>(from: *const T) {
            lines(from);
        }
    }

    /// For each mask of lanes, the set ones in order, a byte each.
    static PACKED: [u64; 256] = {
        let mut table = [0u64; 256];
        let mut mask = 0;
        while mask < 256 {
            let (mut lane, mut count) = (0, 0);
            while lane < 8 {
                if mask >> lane & 1 != 0 {
                    table[mask] |= lane << (8 * count);
                    count += 1;
                }
                lane += 1;
            }
            mask += 1;
        }
        table
    };

    /// Which of the lanes of a mask is least, as a number among them. The lane itself takes the place of the last
    /// three bits, so that it comes out of the minimum; distances are not negative, so their bits are in order.
    #[inline(always)]
    fn nearest(keys: __m256, mask: u32) -> usize {
        // SAFETY: see the head of the module.
        let lane = unsafe {
            let lanes = _mm256_setr_epi32(0, 1, 2, 3, 4, 5, 6, 7);
            let low = _mm256_set1_epi32(7);
            let keys = _mm256_or_si256(_mm256_andnot_si256(low, _mm256_castps_si256(keys)), lanes);
            let least = _mm_min_epu32(
                _mm256_castsi256_si128(keys),
                _mm256_extracti128_si256::<1>(keys),
            );
            let least = _mm_min_epu32(least, _mm_shuffle_epi32::<0b01_00_11_10>(least));
            let least = _mm_min_epu32(least, _mm_shuffle_epi32::<0b10_11_00_01>(least));
            _mm_cvtsi128_si32(least) as u32 & 7
        };
        (mask & ((1 << lane) - 1)).count_ones() as usize
    }

    /// Eight lanes.
    #[derive(Clone, Copy)]
    pub struct Avx;
    impl Simd for Avx {
        type F8 = X8;
        type F4 = X4;
        #[inline(always)]
        fn prefetch<T>(from: *const T) {
            lines(from);
        }
        #[inline(always)]
        fn pack<const NEAREST: bool>(
            keys: X8,
            mask: u32,
            children: &[u32; 8],
            words: &mut [u32; 8],
            ts: &mut [f32; 8],
        ) -> usize {
            // SAFETY: see the head of the module.
            unsafe {
                let keys = keys.0;
                let children = _mm256_loadu_si256(children.as_ptr().cast());
                let lanes = _mm_cvtsi64_si128(PACKED[mask as usize & 255] as i64);
                let lanes = _mm256_cvtepu8_epi32(lanes);
                let packed = _mm256_permutevar8x32_epi32(children, lanes);
                _mm256_storeu_si256(words.as_mut_ptr().cast(), packed);
                _mm256_storeu_ps(ts.as_mut_ptr(), _mm256_permutevar8x32_ps(keys, lanes));
                if NEAREST { nearest(keys, mask) } else { 0 }
            }
        }
    }

    /// Eight lanes, and instructions that pack them.
    #[derive(Clone, Copy)]
    pub struct Avx512;
    impl Simd for Avx512 {
        type F8 = X8;
        type F4 = X4;
        #[inline(always)]
        fn prefetch<T>(from: *const T) {
            lines(from);
        }
        #[inline(always)]
        fn pack<const NEAREST: bool>(
            keys: X8,
            mask: u32,
            children: &[u32; 8],
            words: &mut [u32; 8],
            ts: &mut [f32; 8],
        ) -> usize {
            // SAFETY: see the head of the module.
            unsafe {
                let keys = keys.0;
                let children = _mm256_loadu_si256(children.as_ptr().cast());
                let lanes = mask as __mmask8;
                let packed = _mm256_maskz_compress_epi32(lanes, children);
                _mm256_storeu_si256(words.as_mut_ptr().cast(), packed);
                _mm256_storeu_ps(ts.as_mut_ptr(), _mm256_maskz_compress_ps(lanes, keys));
                if NEAREST { nearest(keys, mask) } else { 0 }
            }
        }
    }
}

/// One of the rows of eight numbers that a node consists of, by its offset in bytes: a bound, which is below 192.
/// Spares the kernel a comparison.
#[inline(always)]
pub fn row(node: &Node, offset: u32) -> &[f32; 8] {
    const _: () = assert!(size_of::<Node>() == 256);
    // SAFETY: a node is 256 bytes without padding between or behind its fields, the offset is one of 0, 32, ...,
    // 224, and all bits are f32.
    unsafe {
        let at = std::ptr::from_ref(node).cast::<[f32; 8]>();
        &*at.byte_add((offset & 0xe0) as usize)
    }
}

/// One coordinate of one corner of a block, by its offset in bytes among the coordinates: 0, 16 or 32.
#[inline(always)]
pub fn coordinate(block: &TriBlock, corner: usize, offset: u32) -> &[f32; 4] {
    const _: () = assert!(size_of::<TriBlock>() == 160);
    // SAFETY: a block is 160 bytes without padding; the highest offset is 2 * 48 + 48, where its primitives are, and
    // all bits are f32.
    unsafe {
        let at = std::ptr::from_ref(block).cast::<[f32; 4]>();
        &*at.byte_add(corner.min(2) * 48 + (offset & 0x30) as usize)
    }
}

/// Makes an entry point for each level out of a generic kernel and picks one.
macro_rules! entry {
    ($(#[$doc:meta])* $name:ident, $module:ident :: $kernel:ident, ($($arg:ident : $type:ty),*) -> $ret:ty) => {
        $(#[$doc])*
        #[inline]
        pub fn $name(level: SimdLevel, $($arg: $type),*) -> $ret {
            #[cfg(target_arch = "x86_64")]
            {
                #[target_feature(enable = "avx2,popcnt,bmi1,bmi2")]
                fn avx2($($arg: $type),*) -> $ret { $module::$kernel::<x86::Avx>($($arg),*) }
                #[target_feature(enable = "avx2,popcnt,bmi1,bmi2,avx512f,avx512vl")]
                fn avx512($($arg: $type),*) -> $ret { $module::$kernel::<x86::Avx512>($($arg),*) }
                #[inline(never)]
                fn sse2($($arg: $type),*) -> $ret { $module::$kernel::<x86::Sse2>($($arg),*) }
                match level {
                    // SAFETY: `SimdLevel::available` has found the features on this processor.
                    SimdLevel::Avx512 => return unsafe { avx512($($arg),*) },
                    // SAFETY: as above.
                    SimdLevel::Avx2 => return unsafe { avx2($($arg),*) },
                    SimdLevel::Sse2 => return sse2($($arg),*),
                    SimdLevel::Scalar => {}
                }
            }
            let _ = level;
            $module::$kernel::<Scalar>($($arg),*)
        }
    };
}

entry! {
    /// Numbers of a scattering event; see [`crate::sampler`].
    four_pairs, kernel::four_pairs, (reversed: u32, key: u64) -> [glam::Vec2; 4]
}
entry! {
    /// Closest hit; see [`kernel::closest`].
    closest, kernel::closest, (geometry: &super::Geometry, ray: &crate::ray::Ray, hit: &mut crate::ray::Hit) -> ()
}
entry! {
    /// Closest hits; see [`kernel::closest_many`].
    closest_many, kernel::closest_many, (geometry: &super::Geometry, rays: &[crate::ray::Ray], hits: &mut [crate::ray::Hit], in_flight: bool) -> ()
}
entry! {
    /// Any hits; see [`kernel::occluded_many`].
    occluded_many, kernel::occluded_many, (geometry: &super::Geometry, rays: &[crate::ray::Ray], blocked: &mut [bool], in_flight: bool) -> ()
}
entry! {
    /// Closest hit in a group; see [`kernel::closest_in_group`].
    closest_in_group, kernel::closest_in_group, (group: &kernel::Walk, hit: &mut crate::ray::Hit) -> bool
}
entry! {
    /// Any hit in a group; see [`kernel::occluded_in_group`].
    occluded_in_group, kernel::occluded_in_group, (group: &kernel::Walk, hit: &mut crate::ray::Hit) -> bool
}
entry! {
    /// Closest hit below a word; see [`kernel::closest_below`].
    closest_below, kernel::closest_below, (at: &kernel::Walk, aim: &kernel::Aim, word: u32, hit: &mut crate::ray::Hit) -> ()
}
entry! {
    /// Closest hits by packets; see [`packet::closest`].
    closest_coherent, packet::closest, (geometry: &super::Geometry, rays: &[crate::ray::Ray], hits: &mut [crate::ray::Hit], in_flight: bool) -> ()
}
entry! {
    /// Closest hits of a packet in a group; see [`packet::closest_in_group`].
    closest_packet_in_group, packet::closest_in_group, (group: &packet::Place, rays: u32, hits: &mut [crate::ray::Hit; packet::RAYS]) -> bool
}
entry! {
    /// Any hit; see [`kernel::occluded`].
    occluded, kernel::occluded, (geometry: &super::Geometry, ray: &crate::ray::Ray) -> bool
}

entry! {
    /// Bounds on what eight clusters of lights can send (`light/cluster.rs`).
    importances, cluster::importances, (cluster: &cluster::Cluster, p: glam::Vec3, aim: cluster::Aim) -> [f32; 8]
}

/// Memory of a [`Stack`].
pub type StackItems = [std::mem::MaybeUninit<u64>; STACK_SIZE];

/// Entries of a [`Stack`].
pub const STACK_SIZE: usize = 320;

/// Nodes that a traversal still has to visit, with the distance at which a ray enters them; see [`entry`]. The
/// builders bound the depth of a tree so that this is always enough.
pub struct Stack<'a> {
    // Memory apart from the length, which then lives in a register.
    items: &'a mut StackItems,
    len: usize,
}

/// Memory that nothing has been written to.
#[inline(always)]
pub fn stack_items() -> StackItems {
    [const { std::mem::MaybeUninit::uninit() }; STACK_SIZE]
}

/// An entry of a stack: the bits of t, which is not negative, so that they are in order, above the word.
#[inline(always)]
pub fn entry(word: u32, t: f32) -> u64 {
    (t.to_bits() as u64) << 32 | word as u64
}

impl<'a> Stack<'a> {
    /// Empty; the memory is not touched.
    #[inline(always)]
    pub fn new(items: &'a mut StackItems) -> Self {
        Stack { items, len: 0 }
    }
    /// On top. A full stack means that a builder broke its bound: the process must not go on.
    #[inline(always)]
    pub fn push(&mut self, entry: u64) {
        self.items[self.len].write(entry);
        self.len += 1;
    }
    /// From the top.
    #[inline(always)]
    pub fn pop(&mut self) -> Option<u64> {
        if self.len == 0 {
            return None;
        }
        self.len -= 1;
        // SAFETY: every entry below the old length was written by `push`, which does not let the length
        // exceed the memory.
        Some(unsafe { self.items.get_unchecked(self.len).assume_init() })
    }
    /// Number of entries.
    #[inline(always)]
    pub fn height(&self) -> usize {
        self.len
    }
    /// Sorts the entries from `from` up so that the nearest is on top; equal distances are in the order of their
    /// words, whatever order they were pushed in.
    #[inline(always)]
    pub fn sort_from(&mut self, from: usize) {
        for i in from + 1..self.len {
            // SAFETY: every entry below the length was written by `push`.
            let key = unsafe { self.items[i].assume_init() };
            let mut j = i;
            while j > from {
                // SAFETY: as above.
                let below = unsafe { self.items[j - 1].assume_init() };
                if below >= key {
                    break;
                }
                self.items[j].write(below);
                j -= 1;
            }
            self.items[j].write(key);
        }
    }
}
