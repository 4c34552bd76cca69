//! Sums over consecutive samples of one pixel, worked out layer by layer.

use crate::buffer::{
    LUMINANCE_SMALL_BITS, LayerSample, PixelSums, in_second_half, luminance_fixed, luminance_small,
};
use crate::fixed::{self, Square};

/// Samples of one pixel, a layer at a time.
#[derive(Clone, Debug)]
#[repr(align(32))]
pub struct Run {
    /// See [`LayerSample::beauty`].
    pub beauty: [[f32; Run::LONGEST]; 3],
    /// See [`LayerSample::alpha`].
    pub alpha: [f32; Run::LONGEST],
    /// See [`LayerSample::albedo`].
    pub albedo: [[f32; Run::LONGEST]; 3],
    /// See [`LayerSample::normal`].
    pub normal: [[f32; Run::LONGEST]; 3],
    /// See [`LayerSample::depth`].
    pub depth: [f32; Run::LONGEST],
}

/// Magnitudes of radiance and distance below this take the short way: their fixed-point sums over a run
/// fit 64 bits, those of their squares 128.
const SMALL: f32 = 2048.0;

/// Radiances below this have their luminance in 64 bits.
const LUMINANCE_SMALL: f32 = (1u64 << (LUMINANCE_SMALL_BITS - fixed::VALUE_BITS)) as f32;

impl Run {
    /// Most samples.
    pub const LONGEST: usize = 64;

    /// All zero.
    pub fn new() -> Run {
        let zero = [0.0; Run::LONGEST];
        Run {
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

    /// Sums over the first `count` samples, of which the first has the index `begin`; `None` where one
    /// is too large for the short way. Always inlined, so that it is compiled for the instructions of
    /// whoever calls it.
    #[inline(always)]
    pub(crate) fn sums(&self, begin: u32, count: usize) -> Option<PixelSums> {
        let mut bounded = largest(&self.alpha[..count]);
        let mut value = 0;
        for c in 0..3 {
            value = value.max(largest(&self.beauty[c][..count]));
            bounded = bounded.max(largest(&self.albedo[c][..count]));
            bounded = bounded.max(largest(&self.normal[c][..count]));
        }
        if value >= SMALL.to_bits() || bounded > fixed::BOUNDED_MAX.to_bits() {
            return None;
        }
        let mut sums = PixelSums {
            alpha: sum_bounded(&self.alpha[..count]),
            ..PixelSums::default()
        };
        let mut beauty = [[0i64; Run::LONGEST]; 3];
        for (c, fixed) in beauty.iter_mut().enumerate() {
            let mut sum = 0;
            for (to, x) in fixed.iter_mut().zip(&self.beauty[c][..count]) {
                *to = fixed::to_fixed_small(*x);
                sum += *to;
            }
            sums.beauty[c] = sum as i128;
            let mut squares = 0;
            for x in &self.beauty[c][..count] {
                squares += Square::of_small(*x);
            }
            sums.square[c] = Square {
                whole: squares >> 64,
                fraction: squares as u64,
            };
            sums.albedo[c] = sum_bounded(&self.albedo[c][..count]);
            sums.normal[c] = sum_bounded(&self.normal[c][..count]);
        }
        let [r, g, b] = &beauty;
        let second = r[..count].iter().zip(g).zip(b).enumerate();
        let second = second.filter(|(i, _)| in_second_half(begin.wrapping_add(*i as u32)));
        sums.half = if value < LUMINANCE_SMALL.to_bits() {
            let mut half = 0;
            for (_, ((r, g), b)) in second {
                half += luminance_small([*r, *g, *b]);
            }
            half as i128
        } else {
            let wide = second.map(|(_, ((r, g), b))| [*r, *g, *b].map(i128::from));
            wide.map(luminance_fixed).sum()
        };
        let mut depth = 0;
        for x in &self.depth[..count] {
            if *x == f32::INFINITY {
                continue;
            }
            let small = *x < SMALL && *x > -SMALL;
            if !small {
                return None;
            }
            depth += fixed::to_fixed_small(*x);
            sums.hits += 1;
        }
        sums.depth = depth as i128;
        Some(sums)
    }
}

impl Default for Run {
    fn default() -> Self {
        Run::new()
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
            let mut run = Run::new();
            for i in 0..Run::LONGEST {
                for c in 0..3 {
                    run.beauty[c][i] = number(radiance);
                    run.albedo[c][i] = number(1.0);
                    run.normal[c][i] = number(1.0);
                }
                run.alpha[i] = number(1.0);
                run.depth[i] = number(900.0);
                if i % 7 == 3 {
                    run.depth[i] = f32::INFINITY;
                }
            }
            let count = 1 + round % Run::LONGEST;
            let (mut together, mut singly) = (buffer(), buffer());
            let rejected = together.add_run(1, 0, 5, count, &run);
            let mut expected = 0;
            for i in 0..count {
                expected += singly.add(1, 0, 5 + i as u32, &run.sample(i)).is_err() as u64;
            }
            assert_eq!(rejected, expected, "round {round}");
            assert_eq!(together, singly, "round {round}");
        }
    }
}
