//! Sums over consecutive samples of a pixel, worked out layer by layer.

use crate::buffer::{
    LUMINANCE_SMALL_BITS, LayerSample, PixelSums, in_second_half, luminance_fixed, luminance_small,
};
use crate::fixed::{self, Square};
use std::ops::Range;

/// Samples side by side, a layer at a time.
#[derive(Clone, Debug)]
#[repr(align(32))]
pub struct Columns {
    /// See [`LayerSample::beauty`].
    pub beauty: [[f32; Columns::LONGEST]; 3],
    /// See [`LayerSample::alpha`].
    pub alpha: [f32; Columns::LONGEST],
    /// See [`LayerSample::albedo`].
    pub albedo: [[f32; Columns::LONGEST]; 3],
    /// See [`LayerSample::normal`].
    pub normal: [[f32; Columns::LONGEST]; 3],
    /// See [`LayerSample::depth`].
    pub depth: [f32; Columns::LONGEST],
}

/// Magnitudes of radiance and distance below this take the short way: their fixed-point sums over all
/// samples of columns fit 64 bits, those of their squares 128.
const SMALL: f32 = 2048.0;
const _: () =
    assert!(SMALL as u64 * Columns::LONGEST as u64 <= i64::MAX as u64 >> fixed::VALUE_BITS);

/// Radiances below this have their luminance in 64 bits.
const LUMINANCE_SMALL: f32 = (1u64 << (LUMINANCE_SMALL_BITS - fixed::VALUE_BITS)) as f32;

impl Columns {
    /// Most samples.
    pub const LONGEST: usize = 1024;

    /// All zero.
    pub fn new() -> Columns {
        let zero = [0.0; Columns::LONGEST];
        Columns {
            beauty: [zero; 3],
            alpha: zero,
            albedo: [zero; 3],
            normal: [zero; 3],
            depth: zero,
        }
    }

    /// One of the samples.
    pub fn sample(&self, i: usize) -> LayerSample {
        let [r, g, b] = &self.beauty;
        let [ar, ag, ab] = &self.albedo;
        let [nx, ny, nz] = &self.normal;
        LayerSample {
            beauty: [r[i], g[i], b[i]],
            alpha: self.alpha[i],
            albedo: [ar[i], ag[i], ab[i]],
            normal: [nx[i], ny[i], nz[i]],
            depth: self.depth[i],
        }
    }

    /// Sums over some samples, of which the first has the index `begin`; `None` where one is too large
    /// for the short way. Always inlined, so that it is compiled for the instructions of whoever calls
    /// it.
    #[inline(always)]
    pub(crate) fn sums(&self, begin: u32, of: Range<usize>) -> Option<PixelSums> {
        let alpha = &self.alpha[of.clone()];
        let depth = &self.depth[of.clone()];
        let mut bounded = largest(alpha);
        let mut value = 0;
        for c in 0..3 {
            value = value.max(largest(&self.beauty[c][of.clone()]));
            bounded = bounded.max(largest(&self.albedo[c][of.clone()]));
            bounded = bounded.max(largest(&self.normal[c][of.clone()]));
        }
        if value >= SMALL.to_bits() || bounded > fixed::BOUNDED_MAX.to_bits() {
            return None;
        }
        let mut sums = PixelSums {
            alpha: sum_bounded(alpha),
            ..PixelSums::default()
        };
        for c in 0..3 {
            let column = &self.beauty[c][of.clone()];
            let (mut sum, mut squares) = (0, 0);
            for x in column {
                sum += fixed::to_fixed_small(*x);
            }
            for x in column {
                squares += Square::of_small(*x);
            }
            sums.beauty[c] = sum as i128;
            sums.square[c] = Square {
                whole: squares >> 64,
                fraction: squares as u64,
            };
            sums.albedo[c] = sum_bounded(&self.albedo[c][of.clone()]);
            sums.normal[c] = sum_bounded(&self.normal[c][of.clone()]);
        }
        let is_small = value < LUMINANCE_SMALL.to_bits();
        let (mut half, mut half_wide) = (0, 0);
        let [r, g, b] = &self.beauty;
        for at in of.clone() {
            let index = begin.wrapping_add((at - of.start) as u32);
            if !in_second_half(index) {
                continue;
            }
            let r = fixed::to_fixed_small(r[at]);
            let g = fixed::to_fixed_small(g[at]);
            let b = fixed::to_fixed_small(b[at]);
            if is_small {
                half += luminance_small([r, g, b]);
            } else {
                half_wide += luminance_fixed([r as i128, g as i128, b as i128]);
            }
        }
        sums.half = half as i128 + half_wide;
        let mut distance = 0;
        for x in depth {
            if *x == f32::INFINITY {
                continue;
            }
            let small = *x < SMALL && *x > -SMALL;
            if !small {
                return None;
            }
            distance += fixed::to_fixed_small(*x);
            sums.hits += 1;
        }
        sums.depth = distance as i128;
        Some(sums)
    }
}

impl Default for Columns {
    fn default() -> Self {
        Columns::new()
    }
}

/// Bits of the largest magnitude: whatever is not finite is above all others.
#[inline(always)]
fn largest(column: &[f32]) -> u32 {
    let mut most = 0;
    for x in column {
        most = most.max(x.to_bits() & 0x7FFF_FFFF);
    }
    most
}

#[inline(always)]
fn sum_bounded(column: &[f32]) -> i64 {
    let mut sum = 0;
    for x in column {
        sum += fixed::to_bounded(*x);
    }
    sum
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::buffer::SampleBuffer;
    use crate::unit::{SampleRange, Tile};

    const LENGTH: usize = 64;

    fn buffer() -> SampleBuffer {
        let tile = Tile {
            x: 0,
            y: 0,
            width: 2,
            height: 2,
        };
        SampleBuffer::new(tile, SampleRange { begin: 5, end: 500 })
    }

    /// Runs of all lengths, with numbers from tiny to beyond every bound, NaN and infinity among them.
    #[test]
    fn a_run_adds_what_its_samples_add_one_by_one() {
        let mut state = 1u64;
        let mut next = move || {
            state = state
                .wrapping_mul(6_364_136_223_846_793_005)
                .wrapping_add(1_442_695_040_888_963_407);
            (state >> 33) as u32
        };
        for round in 0..2000 {
            let wild = round % 5 == 0;
            // Between the bounds of the luminance and of the sums in 64 bits, too.
            let radiance = [3.0, 60.0, 70.0, 2000.0][round / 5 % 4];
            let mut number = |scale: f32| {
                let unit = next() as f32 / (1u64 << 31) as f32 * 2.0 - 1.0;
                match next() % if wild { 40 } else { 20 } {
                    0 => 0.0,
                    1 => unit * 1e-12,
                    2 => unit * 1e-30,
                    20 => unit * 1e4,
                    21 => f32::NAN,
                    22 => f32::INFINITY,
                    23 => unit * 1e12,
                    _ => unit * scale,
                }
            };
            let mut columns = Columns::new();
            for i in 0..LENGTH {
                for c in 0..3 {
                    columns.beauty[c][i] = number(radiance);
                    columns.albedo[c][i] = number(1.0);
                    columns.normal[c][i] = number(1.0);
                }
                columns.alpha[i] = number(1.0);
                columns.depth[i] = number(900.0);
                if i % 7 == 3 {
                    columns.depth[i] = f32::INFINITY;
                }
            }
            let from = round / 7 % 20;
            let count = 1 + round % (LENGTH - from);
            let (mut together, mut singly) = (buffer(), buffer());
            let rejected = together.add_run(1, 0, 5, from..from + count, &columns);
            let mut expected = 0;
            for i in 0..count {
                expected += singly
                    .add(1, 0, 5 + i as u32, &columns.sample(from + i))
                    .is_err() as u64;
            }
            assert_eq!(rejected, expected, "round {round}");
            assert_eq!(together, singly, "round {round}");
        }
    }
}
