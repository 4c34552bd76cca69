//! Samplers: the numbers of a sample as a pure function of (seed, frame, pixel, sample index,
//! dimension). No state is kept or sent; the index has no end but 2^32 and no total is needed.

mod lattice;
pub(crate) mod sobol;

use crate::accel::simd::{self, SimdLevel};
use crate::hash;
use glam::Vec2;
use scene::model::SamplerKind;

/// Pairs that the camera and each scattering event take.
const DIMENSIONS_OF_EVENT: u32 = 4;

/// The numbers of one camera sample, handed out dimension by dimension.
#[derive(Clone, Copy, Debug)]
pub struct Sampler {
    kind: SamplerKind,
    /// Hash of seed, frame and pixel.
    key: u64,
    index: u32,
    /// Bits of the index reversed: what Owen scrambling works on.
    reversed: u32,
    dimension: u32,
}

/// Numbers for one scattering event.
#[derive(Clone, Copy, Debug)]
pub struct BounceNumbers {
    /// Point on a light.
    pub light: Vec2,
    /// Direction of scattering.
    pub bsdf: Vec2,
    /// Which light.
    pub light_choice: f32,
    /// Which lobe.
    pub lobe: f32,
    /// Whether the path goes on.
    pub roulette: f32,
    /// Which of mixed materials.
    pub mix: f32,
}

/// Numbers for a flight through a medium.
#[derive(Clone, Copy, Debug)]
pub struct FlightNumbers {
    first: Vec2,
    key: u64,
    count: u64,
}

impl FlightNumbers {
    /// A uniform number in [0, 1).
    #[inline]
    pub fn next_number(&mut self) -> f32 {
        self.count += 1;
        match self.count {
            1 => self.first.x,
            2 => self.first.y,
            n => hash::to_unit(hash::mix(self.key ^ n << 32)),
        }
    }
}

impl Sampler {
    /// The sampler of one sample of one pixel.
    #[inline]
    pub fn start(kind: SamplerKind, seed: u64, frame: u32, pixel: [u32; 2], index: u32) -> Sampler {
        let place = (pixel[0] as u64) << 32 | pixel[1] as u64;
        let key = hash::mix(hash::mix(seed ^ (frame as u64) << 40) ^ place);
        Sampler {
            kind,
            key,
            index,
            reversed: index.reverse_bits(),
            dimension: 0,
        }
    }

    /// A uniform number in [0, 1).
    #[inline]
    pub fn next_1d(&mut self) -> f32 {
        self.next_2d().x
    }

    /// A uniform point of the unit square.
    #[inline]
    pub fn next_2d(&mut self) -> Vec2 {
        let dimension = self.dimension;
        self.dimension += 1;
        let key = hash::mix(self.key ^ (dimension as u64) << 32);
        match self.kind {
            // Single pairs beside the lattice are rare (debug views).
            SamplerKind::Lattice | SamplerKind::OwenSobol => sobol::pair(self.reversed, key),
            SamplerKind::Stratified => stratified(self.index, key),
            SamplerKind::Independent => {
                let bits = hash::mix(key ^ self.index as u64);
                Vec2::new(to_unit(bits as u32), to_unit((bits >> 32) as u32))
            }
        }
    }

    /// Four points of the unit square at once: the next four dimensions.
    #[inline]
    fn next_four(&mut self, level: SimdLevel) -> [Vec2; 4] {
        if self.kind == SamplerKind::OwenSobol {
            let key = self.event_key();
            simd::four_pairs(level, self.reversed, key)
        } else {
            [
                self.next_2d(),
                self.next_2d(),
                self.next_2d(),
                self.next_2d(),
            ]
        }
    }

    /// Key of an event, past which the dimensions move on.
    #[inline(always)]
    fn event_key(&mut self) -> u64 {
        let key = hash::mix(self.key ^ (self.dimension as u64) << 32);
        self.dimension += DIMENSIONS_OF_EVENT;
        key
    }

    /// All numbers for a camera ray: point of the pixel's neighbourhood, point of the lens, moment.
    #[inline]
    pub fn camera(&mut self, level: SimdLevel) -> (Vec2, Vec2, f32) {
        if self.kind == SamplerKind::Lattice {
            let [fx, fy, lx, ly, time] = lattice::camera(self.reversed, self.event_key());
            return (Vec2::new(fx, fy), Vec2::new(lx, ly), time);
        }
        let [film, lens, time, _] = self.next_four(level);
        (film, lens, time.x)
    }

    /// Numbers for a flight through a medium, of which nobody knows how many it takes: the next dimension
    /// for the first two, hashes of (sample, dimension, count) from then on.
    #[inline]
    pub fn flight(&mut self) -> FlightNumbers {
        let key = hash::mix(self.key ^ (self.dimension as u64) << 32 ^ 0x666c_6967_6874);
        let first = self.next_2d();
        FlightNumbers {
            first,
            key: hash::mix(key ^ (self.index as u64)),
            count: 0,
        }
    }

    /// All numbers for a scattering event.
    #[inline]
    pub fn bounce(&mut self, level: SimdLevel) -> BounceNumbers {
        if self.kind == SamplerKind::Lattice {
            let joint = self.dimension <= DIMENSIONS_OF_EVENT;
            let key = self.event_key();
            let [lx, ly, bx, by, light_choice, lobe, roulette, mix] =
                lattice::event(self.reversed, key, joint);
            return BounceNumbers {
                light: Vec2::new(lx, ly),
                bsdf: Vec2::new(bx, by),
                light_choice,
                lobe,
                roulette,
                mix,
            };
        }
        let [light, bsdf, a, b] = self.next_four(level);
        BounceNumbers {
            light,
            bsdf,
            light_choice: a.x,
            roulette: a.y,
            lobe: b.x,
            mix: b.y,
        }
    }
}

/// The top 24 bits as a number in [0, 1).
#[inline(always)]
pub(crate) fn to_unit(bits: u32) -> f32 {
    (bits >> 8) as f32 * (1.0 / 16_777_216.0)
}

/// One point in each cell of a 4 x 4 grid for every block of 16 samples, in an order shuffled for
/// each block, jittered in the cell.
fn stratified(index: u32, key: u64) -> Vec2 {
    let (block, within) = (index / 16, index % 16);
    let block_key = hash::mix(key ^ (block as u64) << 8);
    let cell = permute16(within, block_key as u32);
    let jitter = hash::mix(block_key ^ (within as u64) << 40 ^ 0x5bd1);
    let (x, y) = (to_unit(jitter as u32), to_unit((jitter >> 32) as u32));
    // The largest number below 1 in a cell may round up to the next cell's border, never to 1.
    Vec2::new(
        ((cell % 4) as f32 + x) * 0.25,
        ((cell / 4) as f32 + y) * 0.25,
    )
    .min(Vec2::splat(0.999_999_94))
}

/// A permutation of 0..16 chosen by a key: four rounds of an invertible mix of four bits [Kensler13].
fn permute16(i: u32, key: u32) -> u32 {
    let mut x = i;
    for round in 0..4 {
        let k = hash::mix32(key.wrapping_add(0x9E37_79B9u32.wrapping_mul(round)));
        x = (x ^ (k & 15)) & 15;
        x = x.wrapping_mul((k >> 4) & 14 | 1) & 15;
        x ^= x >> 2;
        x = (x.wrapping_add(k >> 8)) & 15;
        x ^= (x >> 1) & 7;
    }
    x & 15
}

#[cfg(test)]
mod tests;
