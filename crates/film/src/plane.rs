//! One quantity of a tile, as narrow as its sums allow.

use crate::blocks::{self, BLOCK, Packed, Values};
use crate::wide::Wide;

/// The integers of a plane. Most fit i64, bounded ones i32, and many tiles are covered evenly;
/// holding everything as 192 bits would take four times the memory of a film.
#[derive(Clone, Debug)]
enum Data {
    /// All equal.
    Same(Wide),
    I32(Vec<i32>),
    I64(Vec<i64>),
    I128(Vec<i128>),
    Wide(Vec<Wide>),
}

/// Sums of one quantity over the pixels of a tile.
#[derive(Clone, Debug)]
pub(crate) struct Plane {
    data: Data,
    /// No sum is below or above. Not always reached: additions add the bounds.
    low: Wide,
    high: Wide,
}

impl Plane {
    pub const ZERO: Plane = Plane {
        data: Data::Same(Wide::ZERO),
        low: Wide::ZERO,
        high: Wide::ZERO,
    };

    /// Makes room for adding integers between `low` and `high`. If they are all equal, adds them
    /// where that needs no room, and says so.
    pub fn prepare(&mut self, pixels: usize, low: Wide, high: Wide) -> bool {
        self.low = self.low.add(low);
        self.high = self.high.add(high);
        if let (Data::Same(value), true) = (&mut self.data, low == high) {
            *value = value.add(low);
            return true;
        }
        let fits = |limits: (Wide, Wide)| self.low >= limits.0 && self.high <= limits.1;
        let wider = match &self.data {
            Data::I32(_) => !fits((i32::MIN.into(), i32::MAX.into())),
            Data::I64(_) => !fits((i64::MIN.into(), i64::MAX.into())),
            Data::I128(_) => !fits((i128::MIN.into(), i128::MAX.into())),
            Data::Wide(_) => false,
            Data::Same(_) => true,
        };
        if wider {
            let (low, high) = (self.low, self.high);
            self.data = Data::with(low, high, pixels, (0..pixels).map(|i| self.at(i)));
        }
        false
    }

    /// Adds an integer to each pixel from `start` on. [`Plane::prepare`] has been told their bounds.
    #[inline(always)]
    pub fn add<T, I>(&mut self, start: usize, values: I)
    where
        T: Into<Wide> + Narrow,
        I: Iterator<Item = T>,
    {
        match &mut self.data {
            Data::Same(_) => {}
            Data::I32(sums) => each(&mut sums[start..], values, |s, v| *s += v.low() as i32),
            Data::I64(sums) => each(&mut sums[start..], values, |s, v| *s += v.low()),
            Data::I128(sums) => each(&mut sums[start..], values, |s, v| *s += v.mid()),
            Data::Wide(sums) => each(&mut sums[start..], values, |s, v| *s = s.add(v.into())),
        }
    }

    /// Adds a block to `count` pixels from `start` on. [`Plane::prepare`] has been told its bounds.
    pub fn add_packed(&mut self, start: usize, count: usize, block: &Packed) {
        let end = start + count;
        match &mut self.data {
            Data::Same(_) => {}
            Data::I32(sums) => block.add_to(&mut sums[start..end]),
            Data::I64(sums) => block.add_to(&mut sums[start..end]),
            Data::I128(sums) => block.add_to(&mut sums[start..end]),
            Data::Wide(sums) => block.add_to(&mut sums[start..end]),
        }
    }

    /// The sum of a pixel.
    #[inline]
    pub fn at(&self, i: usize) -> Wide {
        match &self.data {
            Data::Same(value) => *value,
            Data::I32(sums) => sums[i].into(),
            Data::I64(sums) => sums[i].into(),
            Data::I128(sums) => sums[i].into(),
            Data::Wide(sums) => sums[i],
        }
    }

    /// The sums from a pixel on, of a plane that is no plane of squares, so that they fit.
    pub fn values(&self, start: usize, out: &mut [i128]) {
        let end = start + out.len();
        match &self.data {
            Data::I32(sums) => copy(&sums[start..end], out, |sum| sum as i128),
            Data::I64(sums) => copy(&sums[start..end], out, |sum| sum as i128),
            Data::I128(sums) => out.copy_from_slice(&sums[start..end]),
            Data::Same(value) => out.fill(value.to_i128().unwrap_or(0)),
            Data::Wide(sums) => copy(&sums[start..end], out, |sum| sum.to_i128().unwrap_or(0)),
        }
    }

    /// The sums from a pixel on as numbers.
    pub fn numbers(&self, start: usize, out: &mut [f64]) {
        let end = start + out.len();
        match &self.data {
            Data::I32(sums) => copy(&sums[start..end], out, |sum| sum as f64),
            Data::I64(sums) => copy(&sums[start..end], out, |sum| sum as f64),
            Data::I128(sums) => copy(&sums[start..end], out, number),
            Data::Same(value) => out.fill(value.to_f64()),
            Data::Wide(sums) => copy(&sums[start..end], out, Wide::to_f64),
        }
    }

    /// Writes the block of pixels `start..end`. The bytes depend on nothing but the sums.
    pub fn pack(&self, start: usize, end: usize, out: &mut Vec<u8>) {
        let mut narrow = [0; BLOCK];
        let narrow = &mut narrow[..end - start];
        match &self.data {
            Data::Same(value) => blocks::pack_wide(&[*value], out),
            Data::I32(sums) => {
                for (out, &sum) in narrow.iter_mut().zip(&sums[start..end]) {
                    *out = sum as i64;
                }
                blocks::pack_i64(narrow, out);
            }
            Data::I64(sums) => blocks::pack_i64(&sums[start..end], out),
            Data::I128(sums) => {
                let sums = &sums[start..end];
                let mut spill = 0;
                for (out, &sum) in narrow.iter_mut().zip(sums) {
                    *out = sum as i64;
                    spill |= (sum >> 64) as i64 ^ (sum as i64 >> 63);
                }
                match spill {
                    0 => blocks::pack_i64(narrow, out),
                    _ => blocks::pack_i128(sums, out),
                }
            }
            Data::Wide(sums) => blocks::pack_wide(&sums[start..end], out),
        }
    }

    /// Takes the blocks of a plane as they are decoded, one after the other.
    pub fn collect(self, decoded: usize, values: Values, count: usize, pixels: usize) -> Plane {
        let (low, high) = values.span();
        let (low, high) = match decoded {
            0 => (low, high),
            _ => (self.low.min(low), self.high.max(high)),
        };
        if let (Values::Same(value), true) = (&values, low == high) {
            return Plane {
                data: Data::Same(*value),
                low,
                high,
            };
        }
        let old = (0..decoded).map(|i| self.at(i));
        let fits = matches!(
            (Data::class(low, high), &self.data),
            (0, Data::I32(_)) | (1, Data::I64(_)) | (2, Data::I128(_)) | (3, Data::Wide(_))
        );
        let mut data = if fits && decoded > 0 {
            self.data
        } else {
            Data::with(low, high, pixels, old)
        };
        data.extend(values, count);
        Plane { data, low, high }
    }

    /// Memory of the sums in bytes.
    pub fn bytes(&self) -> usize {
        match &self.data {
            Data::Same(_) => 0,
            Data::I32(sums) => sums.len() * 4,
            Data::I64(sums) => sums.len() * 8,
            Data::I128(sums) => sums.len() * 16,
            Data::Wide(sums) => sums.len() * 24,
        }
    }
}

impl Data {
    /// The narrowest type for a span: 0 i32, 1 i64, 2 i128, 3 all 192 bits.
    fn class(low: Wide, high: Wide) -> u8 {
        if low.to_i32().is_some() && high.to_i32().is_some() {
            0
        } else if low.to_i64().is_some() && high.to_i64().is_some() {
            1
        } else if low.to_i128().is_some() && high.to_i128().is_some() {
            2
        } else {
            3
        }
    }

    /// Integers in the narrowest type for a span that holds them.
    fn with(low: Wide, high: Wide, pixels: usize, values: impl Iterator<Item = Wide>) -> Data {
        fn all<T>(pixels: usize, values: impl Iterator<Item = T>) -> Vec<T> {
            let mut sums = Vec::with_capacity(pixels);
            sums.extend(values);
            sums
        }
        match Data::class(low, high) {
            0 => Data::I32(all(pixels, values.map(|v| v.low() as i32))),
            1 => Data::I64(all(pixels, values.map(|v| v.low()))),
            2 => Data::I128(all(pixels, values.map(|v| v.mid()))),
            _ => Data::Wide(all(pixels, values)),
        }
    }

    fn extend(&mut self, values: Values, count: usize) {
        fn push<T: Narrow + Into<Wide>>(data: &mut Data, values: impl Iterator<Item = T>) {
            match data {
                Data::Same(_) => {}
                Data::I32(sums) => sums.extend(values.map(|v| v.low() as i32)),
                Data::I64(sums) => sums.extend(values.map(|v| v.low())),
                Data::I128(sums) => sums.extend(values.map(|v| v.mid())),
                Data::Wide(sums) => sums.extend(values.map(Into::into)),
            }
        }
        match values {
            Values::Same(value) => push(self, std::iter::repeat_n(value, count)),
            Values::Narrow(values) => push(self, values.iter().copied()),
            Values::Mid(values) => push(self, values.iter().copied()),
            Values::Wide(values) => push(self, values.iter().copied()),
        }
    }
}

/// The nearest number to an integer. Most fit 64 bits, where the processor does it; of the others the
/// 64 highest bits decide, and whether anything is below them.
#[inline(always)]
pub(crate) fn number(sum: i128) -> f64 {
    if let Ok(sum) = i64::try_from(sum) {
        return sum as f64;
    }
    let magnitude = sum.unsigned_abs();
    let places = (magnitude >> 64 != 0) as u32 * (64 - magnitude.leading_zeros().min(64));
    let high = (magnitude >> places) as u64;
    let rest = (high as u128) << places != magnitude;
    // The last of 64 bits only breaks ties between numbers of 53, so that it can stand for the rest.
    let nearest = (high | rest as u64) as f64 * f64::from_bits((1023 + places as u64) << 52);
    if sum < 0 { -nearest } else { nearest }
}

#[inline(always)]
fn copy<S: Copy, T>(sums: &[S], out: &mut [T], to: impl Fn(S) -> T) {
    for (out, &sum) in out.iter_mut().zip(sums) {
        *out = to(sum);
    }
}

#[inline(always)]
fn each<S, T>(sums: &mut [S], values: impl Iterator<Item = T>, add: impl Fn(&mut S, T)) {
    for (sum, value) in sums.iter_mut().zip(values) {
        add(sum, value);
    }
}

/// The low bits of an integer that is known to fit.
pub(crate) trait Narrow: Copy {
    fn low(self) -> i64;
    fn mid(self) -> i128;
}

impl Narrow for i64 {
    #[inline(always)]
    fn low(self) -> i64 {
        self
    }
    #[inline(always)]
    fn mid(self) -> i128 {
        self as i128
    }
}

impl Narrow for i128 {
    #[inline(always)]
    fn low(self) -> i64 {
        self as i64
    }
    #[inline(always)]
    fn mid(self) -> i128 {
        self
    }
}

impl Narrow for Wide {
    #[inline(always)]
    fn low(self) -> i64 {
        self.0[0] as i64
    }
    #[inline(always)]
    fn mid(self) -> i128 {
        ((self.0[1] as u128) << 64 | self.0[0] as u128) as i128
    }
}

impl Narrow for crate::fixed::Square {
    #[inline(always)]
    fn low(self) -> i64 {
        self.fraction as i64
    }
    #[inline(always)]
    fn mid(self) -> i128 {
        (self.whole << 64 | self.fraction as u128) as i128
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn numbers_are_the_nearest(any in any::<i128>(), bits in 0u32..127, off in -3i128..4) {
            for sum in [any >> bits, (1 << bits) + off, (any >> bits & !0xFFF) + 0x800 + off] {
                prop_assert_eq!(number(sum).to_bits(), (sum as f64).to_bits(), "{}", sum);
            }
        }
    }

    #[test]
    fn numbers_at_the_ends() {
        for sum in [
            0,
            1,
            -1,
            i128::MAX,
            i128::MIN,
            i128::MIN + 1,
            i64::MIN.into(),
            1 << 64,
        ] {
            assert_eq!(number(sum).to_bits(), (sum as f64).to_bits(), "{sum}");
        }
    }
}
