//! Adding packed blocks to sums without unpacking them first: one pass over the bytes and the sums.

use crate::blocks::{Packed, load, load_u128};
use crate::wide::Wide;

impl Packed<'_> {
    /// Adds each integer to one of the sums, modulo two to the number of their bits: what is in between
    /// may wrap where the sums in the end fit.
    pub fn add_to<S: Sum>(&self, sums: &mut [S]) {
        let base = S::of(self.base);
        if self.width == 0 {
            for sum in sums {
                *sum = sum.plus(base);
            }
            return;
        }
        // Sums that fit have such distances. What is shifted out of 64 bits is none of them.
        let fast = self.width <= S::BYTES && self.shift < 8 * S::BYTES as u32;
        match self.width {
            1 if fast => self.add_all::<S, 1>(base, sums),
            2 if fast => self.add_all::<S, 2>(base, sums),
            3 if fast => self.add_all::<S, 3>(base, sums),
            4 if fast => self.add_all::<S, 4>(base, sums),
            5 if fast => self.add_all::<S, 5>(base, sums),
            6 if fast => self.add_all::<S, 6>(base, sums),
            7 if fast => self.add_all::<S, 7>(base, sums),
            8 if fast => self.add_all::<S, 8>(base, sums),
            9 if fast => self.add_all::<S, 9>(base, sums),
            10 if fast => self.add_all::<S, 10>(base, sums),
            11 if fast => self.add_all::<S, 11>(base, sums),
            12 if fast => self.add_all::<S, 12>(base, sums),
            width => {
                for (sum, chunk) in sums.iter_mut().zip(self.bytes.chunks_exact(width)) {
                    *sum = sum.plus(S::of(self.base.add(load(chunk).shl(self.shift))));
                }
            }
        }
    }

    #[inline(always)]
    fn add_all<S: Sum, const W: usize>(&self, base: S, sums: &mut [S]) {
        for (sum, chunk) in sums.iter_mut().zip(self.bytes.chunks_exact(W)) {
            *sum = sum.plus(base).plus(S::distance::<W>(chunk, self.shift));
        }
    }
}

/// An integer of a fixed number of bits that blocks are added to.
pub(crate) trait Sum: Copy {
    /// Its size.
    const BYTES: usize;
    /// The low bits of an integer.
    fn of(value: Wide) -> Self;
    /// A distance of at most so many bytes, shifted by less than its bits.
    fn distance<const W: usize>(chunk: &[u8], shift: u32) -> Self;
    /// The low bits of a sum.
    fn plus(self, other: Self) -> Self;
}

impl Sum for i32 {
    const BYTES: usize = 4;
    #[inline(always)]
    fn of(value: Wide) -> i32 {
        value.0[0] as i32
    }
    #[inline(always)]
    fn distance<const W: usize>(chunk: &[u8], shift: u32) -> i32 {
        ((load_u128::<W>(chunk) as u32) as i32) << shift
    }
    #[inline(always)]
    fn plus(self, other: i32) -> i32 {
        self.wrapping_add(other)
    }
}

impl Sum for i64 {
    const BYTES: usize = 8;
    #[inline(always)]
    fn of(value: Wide) -> i64 {
        value.0[0] as i64
    }
    #[inline(always)]
    fn distance<const W: usize>(chunk: &[u8], shift: u32) -> i64 {
        (load_u128::<W>(chunk) as i64) << shift
    }
    #[inline(always)]
    fn plus(self, other: i64) -> i64 {
        self.wrapping_add(other)
    }
}

impl Sum for i128 {
    const BYTES: usize = 16;
    #[inline(always)]
    fn of(value: Wide) -> i128 {
        ((value.0[1] as u128) << 64 | value.0[0] as u128) as i128
    }
    #[inline(always)]
    fn distance<const W: usize>(chunk: &[u8], shift: u32) -> i128 {
        (load_u128::<W>(chunk) as i128) << shift
    }
    #[inline(always)]
    fn plus(self, other: i128) -> i128 {
        self.wrapping_add(other)
    }
}

impl Sum for Wide {
    // Rare, so always the plain way.
    const BYTES: usize = 0;
    fn of(value: Wide) -> Wide {
        value
    }
    fn distance<const W: usize>(chunk: &[u8], shift: u32) -> Wide {
        load(&chunk[..W]).shl(shift)
    }
    fn plus(self, other: Wide) -> Wide {
        self.add(other)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::blocks::{pack_wide, split};
    use proptest::prelude::*;

    /// What the sums are if the integers are added to them one by one.
    fn plain<S: Sum>(before: &[S], values: &[Wide]) -> Vec<S> {
        let pairs = before.iter().zip(values);
        pairs.map(|(&sum, &v)| sum.plus(S::of(v))).collect()
    }

    fn check<S: Sum + std::fmt::Debug + PartialEq>(start: S, values: &[Wide]) {
        let mut bytes = vec![];
        pack_wide(values, &mut bytes);
        let block = split(&mut &bytes[..], values.len()).unwrap();
        let before = vec![start; values.len()];
        let mut sums = before.clone();
        block.add_to(&mut sums);
        assert_eq!(sums, plain(&before, values));
    }

    proptest! {
        #[test]
        fn adds_what_unpacking_would(
            parts in proptest::collection::vec(any::<(u64, u64, u64)>(), 1..40),
            bits in 0u32..152, shift in 0u32..24, negative in any::<bool>(), start in any::<i32>(),
        ) {
            let values: Vec<Wide> = parts.iter().map(|&(a, b, c)| {
                let value = Wide([a, b, c]).shr(192 - bits).shl(shift);
                if negative && a & 1 == 1 { value.neg() } else { value }
            }).collect();
            // Where the sums do not fit, their low bits are right all the same.
            check(start, &values);
            check(start as i64, &values);
            check(start as i128, &values);
            check(Wide::from(start), &values);
        }
    }
}
