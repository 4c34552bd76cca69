//! Samplers: the numbers of a sample as a pure function of (seed, frame, pixel, sample index,
//! dimension). No state is kept or sent; the index has no end but 2^32 and no total is needed.

pub(crate) use lattice::{Keys as LatticeKeys, TOGETHER, camera_in_lanes, event_in_lanes};

mod lattice;
pub(crate) mod sobol;

use crate::accel::simd::{self, SimdLevel};
use crate::hash;
use glam::Vec2;
use scene::model::SamplerKind;

/// Pairs that the camera and each scattering event take.
const DIMENSIONS_OF_EVENT: u32 = 4;

/// Events whose keys a pixel keeps: more than most paths have.
const EVENTS_KEPT: usize = 16;

/// What tells the samples of one pixel from those of others: a hash of seed, frame and pixel.
#[derive(Clone, Copy, Debug)]
pub struct PixelKey(u64);

impl PixelKey {
    /// Of a pixel of a frame.
    #[inline]
    pub fn new(seed: u64, frame: u32, pixel: [u32; 2]) -> PixelKey {
        let place = (pixel[0] as u64) << 32 | pixel[1] as u64;
        PixelKey(hash::mix(hash::mix(seed ^ (frame as u64) << 40) ^ place))
    }

    /// Keys of the event that begins at a dimension.
    #[inline(always)]
    pub(crate) fn lattice_keys(self, dimension: u32) -> LatticeKeys {
        LatticeKeys::new(hash::mix(self.0 ^ (dimension as u64) << 32))
    }

    /// [`PixelKey::lattice_keys`] of several pixels.
    #[inline(always)]
    pub(crate) fn lattice_keys_of(
        pixels: [PixelKey; TOGETHER],
        dimension: u32,
    ) -> [LatticeKeys; TOGETHER] {
        let mut keys = [0; TOGETHER];
        for at in 0..TOGETHER {
            keys[at] = hash::mix(pixels[at].0 ^ (dimension as u64) << 32);
        }
        lattice::keys_of(keys)
    }
}

/// First dimension of a scattering event, counted from 0.
#[inline(always)]
pub(crate) fn dimension_of(event: u32) -> u32 {
    (event + 1) * DIMENSIONS_OF_EVENT
}

/// Index of the numbers that a part of a sample's path takes for its events: those of all parts of all
/// samples are the points 0, 1, 2 ... of a sequence, of which the camera takes one in `split`. For the
/// lattice that is a lattice again, whose vector has the camera's components times `split`.
#[inline(always)]
pub(crate) fn index_of_part(index: u32, split: u32, part: u32) -> u32 {
    index.wrapping_mul(split).wrapping_add(part)
}

/// First dimension of the camera.
pub(crate) const CAMERA: u32 = 0;

/// What all samples of one pixel have in common: a pure function of seed, frame and pixel, part of which
/// is worked out when it is first asked for.
#[derive(Clone, Debug)]
pub struct PixelPoints {
    kind: SamplerKind,
    /// Hash of seed, frame and pixel.
    key: u64,
    /// Keys of the first events; the last place is for any event beyond them.
    events: [lattice::Keys; EVENTS_KEPT + 1],
    /// Bit i: keys of event i are there.
    known: u32,
}

impl PixelPoints {
    /// Of a pixel with a key.
    pub fn new(kind: SamplerKind, key: PixelKey) -> PixelPoints {
        PixelPoints {
            kind,
            key: key.0,
            events: [lattice::Keys::default(); EVENTS_KEPT + 1],
            known: 0,
        }
    }

    /// Keys of the event that begins at a dimension.
    #[inline(always)]
    fn event(&mut self, dimension: u32) -> &lattice::Keys {
        let place = (dimension / DIMENSIONS_OF_EVENT) as usize;
        if place < EVENTS_KEPT && dimension.is_multiple_of(DIMENSIONS_OF_EVENT) {
            if self.known & 1 << place == 0 {
                self.fill(place, dimension);
                self.known |= 1 << place;
            }
            &self.events[place]
        } else {
            self.fill(EVENTS_KEPT, dimension);
            &self.events[EVENTS_KEPT]
        }
    }

    #[cold]
    fn fill(&mut self, place: usize, dimension: u32) {
        self.events[place] = PixelKey(self.key).lattice_keys(dimension);
    }
}

/// The numbers of one camera sample, handed out dimension by dimension.
#[derive(Debug)]
pub struct Sampler<'p> {
    pixel: &'p mut PixelPoints,
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

impl Sampler<'_> {
    /// The sampler of one sample of one pixel.
    #[inline]
    pub fn start(pixel: &mut PixelPoints, index: u32) -> Sampler<'_> {
        Sampler {
            pixel,
            index,
            reversed: index.reverse_bits(),
            dimension: 0,
        }
    }

    /// As [`Sampler::start`] leaves it after the camera and so many scattering events.
    #[inline]
    pub(crate) fn at_event(pixel: &mut PixelPoints, index: u32, events: u32) -> Sampler<'_> {
        Sampler {
            dimension: dimension_of(events),
            ..Sampler::start(pixel, index)
        }
    }

    /// The camera's path is going to be split: the numbers from here on are those of its first part.
    #[inline]
    pub(crate) fn split(&mut self, split: u32) {
        self.index = index_of_part(self.index, split, 0);
        self.reversed = self.index.reverse_bits();
    }

    /// The numbers of another part, from the first event on.
    #[inline]
    pub(crate) fn part(&mut self, part: u32) -> Sampler<'_> {
        Sampler::at_event(self.pixel, self.index.wrapping_add(part), 0)
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
        let key = hash::mix(self.pixel.key ^ (dimension as u64) << 32);
        match self.pixel.kind {
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
        if self.pixel.kind == SamplerKind::OwenSobol {
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
        let key = hash::mix(self.pixel.key ^ (self.dimension as u64) << 32);
        self.dimension += DIMENSIONS_OF_EVENT;
        key
    }

    /// All numbers for a camera ray: point of the pixel's neighbourhood, point of the lens, moment.
    #[inline]
    pub fn camera(&mut self, level: SimdLevel) -> (Vec2, Vec2, f32) {
        if self.pixel.kind == SamplerKind::Lattice {
            let [fx, fy, lx, ly, time] =
                lattice::camera(self.reversed, self.pixel.event(self.dimension));
            self.dimension += DIMENSIONS_OF_EVENT;
            return (Vec2::new(fx, fy), Vec2::new(lx, ly), time);
        }
        let [film, lens, time, _] = self.next_four(level);
        (film, lens, time.x)
    }

    /// Numbers for a flight through a medium, of which nobody knows how many it takes: the next dimension
    /// for the first two, hashes of (sample, dimension, count) from then on.
    #[inline]
    pub fn flight(&mut self) -> FlightNumbers {
        let key = hash::mix(self.pixel.key ^ (self.dimension as u64) << 32 ^ 0x666c_6967_6874);
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
        if self.pixel.kind == SamplerKind::Lattice {
            let nth = (self.dimension / DIMENSIONS_OF_EVENT).saturating_sub(1);
            let keys = self.pixel.event(self.dimension);
            self.dimension += DIMENSIONS_OF_EVENT;
            let [lx, ly, bx, by, light_choice, lobe, roulette, mix] =
                lattice::event(self.reversed, keys, nth);
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
