//! The exact sums of one unit.

use crate::columns::Columns;
use crate::fixed::{self, Square};
use crate::unit::{SampleRange, Tile};
use std::ops::Range;

/// What one camera sample brings.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LayerSample {
    /// Radiance, linear Rec. 709.
    pub beauty: [f32; 3],
    /// Coverage, 0 to 1.
    pub alpha: f32,
    /// Directional albedo of the first surface.
    pub albedo: [f32; 3],
    /// Shading normal of the first surface, world space; zero where there is none.
    pub normal: [f32; 3],
    /// Distance to the first surface along the ray, or infinity.
    pub depth: f32,
}

impl LayerSample {
    /// Nothing at all.
    pub const EMPTY: LayerSample = LayerSample {
        beauty: [0.0; 3],
        alpha: 0.0,
        albedo: [0.0; 3],
        normal: [0.0; 3],
        depth: f32::INFINITY,
    };
}

/// Sums over the samples of one pixel.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct PixelSums {
    /// Radiance by channel, in steps of 2^-40.
    pub beauty: [i128; 3],
    /// Squares of radiance by channel.
    pub square: [Square; 3],
    /// Luminance of the samples in the second half (see [`in_second_half`]), in steps of 2^-40.
    pub half: i128,
    /// Coverage, in steps of 2^-20.
    pub alpha: i64,
    /// Albedo, in steps of 2^-20.
    pub albedo: [i64; 3],
    /// Normal, in steps of 2^-20.
    pub normal: [i64; 3],
    /// Distance over the samples that hit something, in steps of 2^-40.
    pub depth: i128,
    /// Samples that hit something.
    pub hits: u32,
}

impl PixelSums {
    /// No samples.
    const ZERO: PixelSums = PixelSums {
        beauty: [0; 3],
        square: [Square {
            whole: 0,
            fraction: 0,
        }; 3],
        half: 0,
        alpha: 0,
        albedo: [0; 3],
        normal: [0; 3],
        depth: 0,
        hits: 0,
    };

    /// Adds the sums of other samples.
    #[inline]
    pub(crate) fn add_assign(&mut self, other: &PixelSums) {
        for c in 0..3 {
            self.beauty[c] += other.beauty[c];
            self.square[c] += other.square[c];
            self.albedo[c] += other.albedo[c];
            self.normal[c] += other.normal[c];
        }
        self.half += other.half;
        self.alpha += other.alpha;
        self.depth += other.depth;
        self.hits += other.hits;
    }
}

/// Luminance of linear Rec. 709, in the fixed-point steps of the channels. The weights are integers
/// over 2^16 that add to 2^16, so that the luminance of a sum is the sum of the luminances up to one
/// rounding for each sample.
#[inline(always)]
pub fn luminance_fixed(rgb: [i128; 3]) -> i128 {
    (rgb[0] * 13_933 + rgb[1] * 46_871 + rgb[2] * 4_732) >> 16
}

/// Magnitudes below this, in fixed-point steps, have their luminance in 64 bits.
const LUMINANCE_SMALL: u128 = 1 << LUMINANCE_SMALL_BITS;
/// Binary logarithm of the bound of [`luminance_small`]: the weights have 16 bits more, the sign one.
pub(crate) const LUMINANCE_SMALL_BITS: u32 = 46;

/// [`luminance_fixed`] of magnitudes below 2^46.
#[inline(always)]
pub(crate) fn luminance_small(rgb: [i64; 3]) -> i64 {
    (rgb[0] * 13_933 + rgb[1] * 46_871 + rgb[2] * 4_732) >> 16
}

/// Which half of a pixel's samples an index belongs to, for the error estimate. Both halves of any
/// aligned block of 2^m samples have 2^(m-1) of them. The mask is the first row of the third Sobol
/// generator matrix (bits 1, 1, 0 repeated) [Joe08, dimension 3], which would make each half a digital
/// net if the sampler did not shuffle the index for every dimension; as it does, the halves see little
/// of what quasi-random points gain (measured in `docs/error-estimate.md`).
#[inline(always)]
pub fn in_second_half(index: u32) -> bool {
    (index & 0xDB6D_B6DB).count_ones() & 1 == 1
}

/// Why a sample contributes nothing although it stays in the count.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Reject {
    /// NaN or infinity.
    NotFinite,
    /// Larger than the sums can hold.
    OutOfRange,
}

/// A rejected sample and its place.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Rejected {
    /// Pixel, relative to the tile.
    pub x: u16,
    /// Pixel, relative to the tile.
    pub y: u16,
    /// Sample index.
    pub index: u32,
    /// Why.
    pub reason: Reject,
}

/// Places of rejected samples that a buffer remembers; all are counted.
pub const REJECTED_KEPT: usize = 16;

/// The sums of one unit: every pixel of a tile over one range of samples.
#[derive(Clone, Debug, PartialEq)]
pub struct SampleBuffer {
    tile: Tile,
    samples: SampleRange,
    pixels: Vec<PixelSums>,
    rejected: Vec<Rejected>,
    rejected_count: u64,
}

impl SampleBuffer {
    /// All sums zero.
    pub fn new(tile: Tile, samples: SampleRange) -> Self {
        let mut buffer = SampleBuffer {
            tile,
            samples,
            pixels: Vec::new(),
            rejected: Vec::new(),
            rejected_count: 0,
        };
        buffer.reset(tile, samples);
        buffer
    }

    /// All sums zero again, for another unit, in the same memory.
    pub fn reset(&mut self, tile: Tile, samples: SampleRange) {
        // Many at a time: one by one each of so large an element is a copy of its own.
        static ZERO: [PixelSums; 64] = [PixelSums::ZERO; 64];
        (self.tile, self.samples) = (tile, samples);
        let mut left = tile.pixels();
        self.pixels.clear();
        self.pixels.reserve_exact(left);
        while left > 0 {
            let some = left.min(ZERO.len());
            self.pixels.extend_from_slice(&ZERO[..some]);
            left -= some;
        }
        self.rejected.clear();
        self.rejected_count = 0;
    }

    /// The tile.
    pub fn tile(&self) -> Tile {
        self.tile
    }
    /// The samples.
    pub fn samples(&self) -> SampleRange {
        self.samples
    }
    /// Row by row from the top left of the tile.
    pub fn pixels(&self) -> &[PixelSums] {
        &self.pixels
    }
    /// For decoding.
    pub fn pixels_mut(&mut self) -> &mut [PixelSums] {
        &mut self.pixels
    }
    /// Places of the first rejected samples.
    pub fn rejected(&self) -> &[Rejected] {
        &self.rejected
    }
    /// How many samples were rejected.
    pub fn rejected_count(&self) -> u64 {
        self.rejected_count
    }

    /// For decoding.
    pub(crate) fn set_rejected(&mut self, rejected: Vec<Rejected>, count: u64) {
        self.rejected = rejected;
        self.rejected_count = count;
    }

    /// Rounds a sample once and adds it to the pixel at (x, y) of the tile. A value that is not
    /// finite or out of range adds nothing in any layer, stays in the count and is reported.
    #[inline]
    pub fn add(&mut self, x: u32, y: u32, index: u32, sample: &LayerSample) -> Result<(), Reject> {
        if let Err(reason) = check(sample) {
            self.rejected_count += 1;
            if self.rejected.len() < REJECTED_KEPT {
                self.rejected.push(Rejected {
                    x: x as u16,
                    y: y as u16,
                    index,
                    reason,
                });
            }
            return Err(reason);
        }
        debug_assert!(x < self.tile.width && y < self.tile.height);
        let sums = &mut self.pixels[(y * self.tile.width + x) as usize];
        let beauty = sample.beauty.map(fixed::to_fixed);
        for (c, value) in beauty.into_iter().enumerate() {
            sums.beauty[c] += value;
            sums.square[c] += Square::of(sample.beauty[c]);
            sums.albedo[c] += fixed::to_bounded(sample.albedo[c]);
            sums.normal[c] += fixed::to_bounded(sample.normal[c]);
        }
        if in_second_half(index) {
            sums.half += if beauty.iter().all(|v| v.unsigned_abs() < LUMINANCE_SMALL) {
                luminance_small(beauty.map(|v| v as i64)) as i128
            } else {
                luminance_fixed(beauty)
            };
        }
        sums.alpha += fixed::to_bounded(sample.alpha);
        if sample.depth < f32::INFINITY {
            sums.depth += fixed::to_fixed(sample.depth);
            sums.hits += 1;
        }
        Ok(())
    }

    /// [`SampleBuffer::add`] for some samples of one pixel, of which the first has the index `begin`; how
    /// many were rejected.
    #[inline(always)]
    pub fn add_run(
        &mut self,
        x: u32,
        y: u32,
        begin: u32,
        of: Range<usize>,
        columns: &Columns,
    ) -> u64 {
        if of.len() == 1 {
            // Faster as it is.
            return self.add(x, y, begin, &columns.sample(of.start)).is_err() as u64;
        }
        let Some(sums) = columns.sums(begin, of.clone()) else {
            return (begin..)
                .zip(of)
                .filter(|(index, at)| self.add(x, y, *index, &columns.sample(*at)).is_err())
                .count() as u64;
        };
        self.pixels[(y * self.tile.width + x) as usize].add_assign(&sums);
        0
    }
}

/// Whether every layer of a sample can be added.
#[inline(always)]
fn check(sample: &LayerSample) -> Result<(), Reject> {
    // Magnitudes compare as integers, and whatever is not finite is above all others.
    let bits = |x: f32| x.to_bits() & 0x7FFF_FFFF;
    let [r, g, b] = sample.beauty.map(bits);
    let [ar, ag, ab] = sample.albedo.map(bits);
    let [nx, ny, nz] = sample.normal.map(bits);
    let value = r.max(g).max(b);
    let bounded = ar.max(ag).max(ab).max(nx).max(ny).max(nz);
    let fine = value <= fixed::VALUE_MAX.to_bits()
        && bounded.max(bits(sample.alpha)) <= fixed::BOUNDED_MAX.to_bits()
        && (bits(sample.depth) <= fixed::VALUE_MAX.to_bits() || sample.depth == f32::INFINITY);
    if fine { Ok(()) } else { Err(reason(sample)) }
}

/// What is wrong with a sample that cannot be added.
#[cold]
fn reason(sample: &LayerSample) -> Reject {
    let layers = [sample.beauty, sample.albedo, sample.normal];
    let finite = layers.iter().flatten().all(|x| x.is_finite());
    if finite && sample.alpha.is_finite() && !sample.depth.is_nan() {
        Reject::OutOfRange
    } else {
        Reject::NotFinite
    }
}
