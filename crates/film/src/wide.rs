//! Signed 192-bit integers, wide enough for every sum.

use crate::fixed::Square;
use std::cmp::Ordering;

/// Two's complement, least significant limb first. Additions wrap; whoever adds checks bounds first.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) struct Wide(pub [u64; 3]);

/// Length of a [`Wide`] in bytes.
pub(crate) const WIDE_BYTES: usize = 24;

impl Wide {
    pub const ZERO: Wide = Wide([0; 3]);

    /// 2^bits times a count.
    pub fn scaled(count: u32, bits: u32) -> Wide {
        Wide([count as u64, 0, 0]).shl(bits)
    }

    #[inline]
    pub fn add(self, other: Wide) -> Wide {
        let (a, b) = (self.0, other.0);
        let (low, carry) = a[0].overflowing_add(b[0]);
        let (mid, first) = a[1].overflowing_add(b[1]);
        let (mid, second) = mid.overflowing_add(carry as u64);
        let high = a[2]
            .wrapping_add(b[2])
            .wrapping_add(first as u64 | second as u64);
        Wide([low, mid, high])
    }

    pub fn neg(self) -> Wide {
        Wide(self.0.map(|limb| !limb)).add(Wide([1, 0, 0]))
    }

    #[inline]
    pub fn sub(self, other: Wide) -> Wide {
        self.add(other.neg())
    }

    pub fn shl(self, bits: u32) -> Wide {
        let (limbs, bits) = ((bits / 64) as usize, bits % 64);
        let at = |i: usize| if i >= limbs { self.0[i - limbs] } else { 0 };
        let mut out = [0; 3];
        for (i, limb) in out.iter_mut().enumerate() {
            *limb = at(i) << bits;
            if bits > 0 && i > 0 {
                *limb |= at(i - 1) >> (64 - bits);
            }
        }
        Wide(out)
    }

    /// Shifts zeros in from the top.
    pub fn shr(self, bits: u32) -> Wide {
        let (limbs, bits) = ((bits / 64) as usize, bits % 64);
        let at = |i: usize| if i + limbs < 3 { self.0[i + limbs] } else { 0 };
        let mut out = [0; 3];
        for (i, limb) in out.iter_mut().enumerate() {
            *limb = at(i) >> bits;
            if bits > 0 {
                *limb |= at(i + 1) << (64 - bits);
            }
        }
        Wide(out)
    }

    /// Bits of the number read as unsigned.
    pub fn bits(self) -> u32 {
        match self.0 {
            [low, 0, 0] => 64 - low.leading_zeros(),
            [_, mid, 0] => 128 - mid.leading_zeros(),
            [_, _, high] => 192 - high.leading_zeros(),
        }
    }

    pub fn trailing_zeros(self) -> u32 {
        match self.0 {
            [0, 0, high] => 128 + high.trailing_zeros(),
            [0, mid, _] => 64 + mid.trailing_zeros(),
            [low, _, _] => low.trailing_zeros(),
        }
    }

    pub fn to_bytes(self) -> [u8; WIDE_BYTES] {
        let mut out = [0; WIDE_BYTES];
        for (bytes, limb) in out.chunks_exact_mut(8).zip(self.0) {
            bytes.copy_from_slice(&limb.to_le_bytes());
        }
        out
    }

    pub fn from_bytes(bytes: [u8; WIDE_BYTES]) -> Wide {
        let mut limbs = [0; 3];
        for (limb, bytes) in limbs.iter_mut().zip(bytes.chunks_exact(8)) {
            let mut eight = [0; 8];
            eight.copy_from_slice(bytes);
            *limb = u64::from_le_bytes(eight);
        }
        Wide(limbs)
    }

    pub fn to_i128(self) -> Option<i128> {
        let value = (self.0[1] as u128) << 64 | self.0[0] as u128;
        let sign = (value as i128 >> 127) as u64;
        (self.0[2] == sign).then_some(value as i128)
    }

    pub fn to_i64(self) -> Option<i64> {
        let sign = (self.0[0] as i64 >> 63) as u64;
        (self.0[1] == sign && self.0[2] == sign).then_some(self.0[0] as i64)
    }

    pub fn to_i32(self) -> Option<i32> {
        self.to_i64()?.try_into().ok()
    }

    /// The nearest number up to a few roundings, for pictures and errors.
    pub fn to_f64(self) -> f64 {
        if let Some(value) = self.to_i128() {
            return value as f64;
        }
        const LIMB: f64 = 18_446_744_073_709_551_616.0;
        (self.0[2] as i64 as f64 * LIMB + self.0[1] as f64) * LIMB + self.0[0] as f64
    }

    /// The bits as a sum of squares.
    pub fn to_square(self) -> Square {
        Square {
            whole: (self.0[2] as u128) << 64 | self.0[1] as u128,
            fraction: self.0[0],
        }
    }
}

impl From<i64> for Wide {
    #[inline]
    fn from(value: i64) -> Wide {
        let sign = (value >> 63) as u64;
        Wide([value as u64, sign, sign])
    }
}

impl From<i32> for Wide {
    #[inline]
    fn from(value: i32) -> Wide {
        Wide::from(value as i64)
    }
}

impl From<i128> for Wide {
    #[inline]
    fn from(value: i128) -> Wide {
        Wide([value as u64, (value >> 64) as u64, (value >> 127) as u64])
    }
}

impl From<Square> for Wide {
    #[inline]
    fn from(value: Square) -> Wide {
        Wide([
            value.fraction,
            value.whole as u64,
            (value.whole >> 64) as u64,
        ])
    }
}

impl Ord for Wide {
    #[inline]
    fn cmp(&self, other: &Wide) -> Ordering {
        let key = |w: &Wide| (w.0[2] as i64, w.0[1], w.0[0]);
        key(self).cmp(&key(other))
    }
}

impl PartialOrd for Wide {
    #[inline]
    fn partial_cmp(&self, other: &Wide) -> Option<Ordering> {
        Some(self.cmp(other))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn agrees_with_i128(a in any::<i64>(), b in any::<i128>(), shift in 0u32..60) {
            let b = b >> 2;
            let (x, y) = (Wide::from(a as i128), Wide::from(b));
            prop_assert_eq!(x.add(y).to_i128(), Some(a as i128 + b));
            prop_assert_eq!(x.sub(y).to_i128(), Some(a as i128 - b));
            prop_assert_eq!(x.cmp(&y), (a as i128).cmp(&b));
            prop_assert_eq!(x.to_i64(), Some(a));
            prop_assert_eq!(x.shl(shift).to_i128(), Some((a as i128) << shift));
            prop_assert_eq!(Wide::from_bytes(y.to_bytes()), y);
        }
    }

    #[test]
    fn bits_and_zeros() {
        for bit in 0..191 {
            let one = Wide::scaled(1, bit);
            assert_eq!((one.bits(), one.trailing_zeros()), (bit + 1, bit));
            assert_eq!(one.shr(bit), Wide([1, 0, 0]));
            assert_eq!(one.to_f64(), 2f64.powi(bit as i32));
        }
        assert_eq!(Wide::ZERO.bits(), 0);
    }
}
