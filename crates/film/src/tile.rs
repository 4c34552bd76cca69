//! The merged state of one tile: exact sums, and which units they are made of.

use crate::blocks::BLOCK;
use crate::buffer::{PixelSums, REJECTED_KEPT, Rejected, SampleBuffer};
use crate::counters::Counters;
use crate::error::{self, TileErrors};
use crate::fixed::Square;
use crate::packed::PackedUnit;
use crate::plane::Plane;
use crate::planes::{self, PLANES, ReadPlanes};
use crate::unit::{SampleRange, Tile, pass_end};
use crate::wide::Wide;
use crate::wire::put_u32s;
use std::sync::{Arc, OnceLock};

/// A unit that was merged: what came, and from whom. Kept so that the same bytes again are known
/// from other bytes, and so that what a bad worker touched can be rendered again.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct MergedUnit {
    /// Its samples.
    pub samples: SampleRange,
    /// BLAKE3 of its encoded bytes.
    pub digest: [u8; 32],
    /// Who rendered it.
    pub worker: Arc<str>,
}

/// The merged state of one tile.
#[derive(Clone, Debug)]
pub struct TileFilm {
    tile: Tile,
    /// Empty as long as nothing is merged.
    planes: Vec<Plane>,
    /// By first sample.
    ledger: Vec<MergedUnit>,
    samples: u32,
    counters: Counters,
    rejected: Vec<Rejected>,
    rejected_count: u64,
    version: u64,
    digest: OnceLock<[u8; 32]>,
    error: OnceLock<Option<f64>>,
}

impl TileFilm {
    /// Nothing merged.
    pub(crate) fn new(tile: Tile) -> TileFilm {
        TileFilm {
            tile,
            planes: Vec::new(),
            ledger: Vec::new(),
            samples: 0,
            counters: Counters::default(),
            rejected: Vec::new(),
            rejected_count: 0,
            version: 0,
            digest: OnceLock::new(),
            error: OnceLock::new(),
        }
    }

    /// A tile as it was saved.
    pub(crate) fn restored(
        tile: Tile,
        planes: Vec<Plane>,
        ledger: Vec<MergedUnit>,
        counters: Counters,
        rejected: (u64, Vec<Rejected>),
    ) -> TileFilm {
        let samples = ledger.iter().map(|unit| unit.samples.len()).sum();
        TileFilm {
            planes,
            ledger,
            samples,
            counters,
            rejected_count: rejected.0,
            rejected: rejected.1,
            ..TileFilm::new(tile)
        }
    }

    /// The rectangle.
    pub fn tile(&self) -> Tile {
        self.tile
    }

    /// Rises with every change and never falls, so that whoever remembers a version knows whether
    /// it is still current. Zero: nothing was ever merged.
    pub fn version(&self) -> u64 {
        self.version
    }

    pub(crate) fn set_version(&mut self, version: u64) {
        self.version = version;
    }

    /// Samples of each pixel, whatever their indices.
    pub fn samples(&self) -> u32 {
        self.samples
    }

    /// The merged units, by first sample.
    pub fn merged_units(&self) -> &[MergedUnit] {
        &self.ledger
    }

    /// The merged samples, adjacent ranges joined.
    pub fn ranges(&self) -> Vec<SampleRange> {
        let mut ranges: Vec<SampleRange> = Vec::new();
        for SampleRange { begin, end } in self.ledger.iter().map(|unit| unit.samples) {
            match ranges.last_mut() {
                Some(last) if last.end == begin => last.end = end,
                _ => ranges.push(SampleRange { begin, end }),
            }
        }
        ranges
    }

    /// Samples without a gap from index 0 on.
    pub fn spp(&self) -> u32 {
        let mut spp = 0;
        for unit in &self.ledger {
            if unit.samples.begin != spp {
                break;
            }
            spp = unit.samples.end;
        }
        spp
    }

    /// Whether all samples of a range are merged.
    pub fn contains(&self, range: SampleRange) -> bool {
        range.is_empty()
            || self
                .ranges()
                .iter()
                .any(|have| have.begin <= range.begin && range.end <= have.end)
    }

    /// What is missing of the samples up to `upto`, cut at the pass borders: the units to render.
    pub fn missing(&self, upto: u32) -> Vec<SampleRange> {
        let mut missing = Vec::new();
        let mut fill = |mut begin: u32, end: u32| {
            while begin < end {
                let border = pass_end(begin).min(end);
                missing.push(SampleRange { begin, end: border });
                begin = border;
            }
        };
        let mut at = 0;
        for have in self.ranges() {
            fill(at, have.begin.min(upto));
            at = have.end;
        }
        fill(at, upto);
        missing
    }

    /// What the merged units took.
    pub fn counters(&self) -> Counters {
        self.counters
    }

    /// How many samples were rejected.
    pub fn rejected_count(&self) -> u64 {
        self.rejected_count
    }

    /// Places of rejected samples, lowest sample indices first.
    pub fn rejected(&self) -> &[Rejected] {
        &self.rejected
    }

    /// Forgets everything but the version, which rises: the tile is rendered again.
    pub fn clear(&mut self) {
        let version = self.version + 1;
        *self = TileFilm {
            version,
            ..TileFilm::new(self.tile)
        };
    }

    /// Error of the tile that is published and decides, as far as its samples show it (see `error`).
    /// Worked out once for each state of the tile.
    pub fn error(&self) -> Option<f64> {
        *self.error.get_or_init(|| error::tile_error(self))
    }

    /// Error of the tile by both estimators.
    pub fn errors(&self) -> Option<TileErrors> {
        error::tile_errors(self)
    }

    /// Memory in bytes, without the struct itself.
    pub fn bytes(&self) -> usize {
        let ledger = self.ledger.capacity() * size_of::<MergedUnit>();
        self.planes
            .iter()
            .map(|plane| plane.bytes() + size_of::<Plane>())
            .sum::<usize>()
            + ledger
    }

    /// A plane of sums; all zero if nothing is merged.
    pub(crate) fn plane(&self, plane: usize) -> &Plane {
        self.planes.get(plane).unwrap_or(&Plane::ZERO)
    }

    /// Whether the ledger has room for a range: Ok(place to insert), or the first unit in the way.
    pub(crate) fn place(&self, samples: SampleRange) -> Result<usize, &MergedUnit> {
        let at = self
            .ledger
            .partition_point(|unit| unit.samples.end <= samples.begin);
        match self.ledger.get(at) {
            Some(unit) if unit.samples.overlaps(samples) => Err(unit),
            _ => Ok(at),
        }
    }

    /// Adds the sums of a unit whose place is known to be free. Refuses sums that so many samples
    /// cannot have, and changes nothing then; the error is the plane.
    pub(crate) fn add(
        &mut self,
        at: usize,
        unit: MergedUnit,
        buffer: &SampleBuffer,
        counters: &Counters,
    ) -> Result<(), usize> {
        let done = self.prepare(&spans(buffer)?);
        let mut adder = Adder {
            planes: &mut self.planes,
            done,
            start: 0,
            pixels: &[],
        };
        for (i, block) in buffer.pixels().chunks(BLOCK_PIXELS).enumerate() {
            adder.start = i * BLOCK_PIXELS;
            adder.pixels = block;
            planes::read_planes(&mut adder);
        }
        let rejected = (buffer.rejected_count(), buffer.rejected());
        self.note(at, unit, *counters, rejected);
        Ok(())
    }

    /// The same for a unit that is still packed. Its sums have been checked.
    pub(crate) fn add_packed<B: AsRef<[u8]>>(
        &mut self,
        at: usize,
        unit: MergedUnit,
        packed: &PackedUnit<B>,
    ) {
        let done = self.prepare(packed.spans());
        packed.add_to(&mut self.planes, &done);
        let head = packed.head();
        let rejected = (head.rejected_count, &head.rejected[..]);
        self.note(at, unit, head.counters, rejected);
    }

    /// Makes room for sums; which planes need no more than that.
    fn prepare(&mut self, spans: &[(Wide, Wide); PLANES]) -> [bool; PLANES] {
        if self.planes.is_empty() {
            self.planes = vec![Plane::ZERO; PLANES];
        }
        let pixels = self.tile.pixels();
        std::array::from_fn(|plane| {
            let (low, high) = spans[plane];
            self.planes[plane].prepare(pixels, low, high)
        })
    }

    /// Notes what was added.
    fn note(
        &mut self,
        at: usize,
        unit: MergedUnit,
        counters: Counters,
        (count, places): (u64, &[Rejected]),
    ) {
        self.samples += unit.samples.len();
        self.ledger.insert(at, unit);
        self.counters += counters;
        self.rejected_count += count;
        self.rejected.extend_from_slice(places);
        // Those with the lowest indices, which do not depend on the order of arrival.
        self.rejected
            .sort_by_key(|place| (place.index, place.y, place.x));
        self.rejected.truncate(REJECTED_KEPT);
        self.changed();
    }

    fn changed(&mut self) {
        self.version += 1;
        self.digest = OnceLock::new();
        self.error = OnceLock::new();
    }

    /// Writes the sums, the same bytes for the same sums.
    pub(crate) fn pack(&self, out: &mut Vec<u8>) {
        let pixels = self.tile.pixels();
        for start in (0..pixels).step_by(BLOCK) {
            for plane in 0..PLANES {
                self.plane(plane)
                    .pack(start, (start + BLOCK).min(pixels), out);
            }
        }
    }

    /// BLAKE3 of the sums and the merged ranges: the same however the samples arrived, and whoever
    /// rendered them.
    pub fn digest(&self) -> [u8; 32] {
        *self.digest.get_or_init(|| {
            let Tile {
                x,
                y,
                width,
                height,
            } = self.tile;
            let ranges = self.ranges();
            let mut bytes = Vec::with_capacity(64 + self.bytes());
            put_u32s(&mut bytes, &[x, y, width, height, ranges.len() as u32]);
            for range in ranges {
                put_u32s(&mut bytes, &[range.begin, range.end]);
            }
            self.pack(&mut bytes);
            *blake3::hash(&bytes).as_bytes()
        })
    }
}

/// Pixels that are added before the next plane: 30 KB, so that they stay in the first cache.
const BLOCK_PIXELS: usize = 128;

/// The smallest and the largest sum of every plane, if all are inside the bounds; else the plane.
fn spans(buffer: &SampleBuffer) -> Result<[(Wide, Wide); PLANES], usize> {
    let none = (Wide::scaled(1, 190), Wide::scaled(1, 190).neg());
    let mut spans = Spans {
        pixels: &[],
        spans: [none; PLANES],
    };
    for block in buffer.pixels().chunks(BLOCK_PIXELS) {
        spans.pixels = block;
        planes::read_planes(&mut spans);
    }
    for (plane, &(low, high)) in spans.spans.iter().enumerate() {
        let bounds = planes::bounds(plane, buffer.samples().len());
        if low < bounds.0 || high > bounds.1 {
            return Err(plane);
        }
    }
    Ok(spans.spans)
}

struct Spans<'a> {
    pixels: &'a [PixelSums],
    spans: [(Wide, Wide); PLANES],
}

impl Spans<'_> {
    fn widen(&mut self, plane: usize, low: Wide, high: Wide) {
        let span = &mut self.spans[plane];
        *span = (span.0.min(low), span.1.max(high));
    }
}

impl ReadPlanes for Spans<'_> {
    #[inline(always)]
    fn value(&mut self, plane: usize, get: impl Fn(&PixelSums) -> i128) {
        let (mut low, mut high) = (i128::MAX, i128::MIN);
        for value in self.pixels.iter().map(get) {
            low = low.min(value);
            high = high.max(value);
        }
        self.widen(plane, low.into(), high.into());
    }

    #[inline(always)]
    fn square(&mut self, plane: usize, get: impl Fn(&PixelSums) -> Square) {
        let (mut low, mut high, mut above) = (u128::MAX, 0, 0);
        for square in self.pixels.iter().map(&get) {
            let value = square.whole << 64 | square.fraction as u128;
            low = low.min(value);
            high = high.max(value);
            above |= square.whole >> 63;
        }
        if above == 0 {
            return self.widen(plane, (low as i128).into(), (high as i128).into());
        }
        for pixel in self.pixels {
            let value = Wide::from(get(pixel));
            self.widen(plane, value, value);
        }
    }

    #[inline(always)]
    fn small(&mut self, plane: usize, get: impl Fn(&PixelSums) -> i64) {
        let (mut low, mut high) = (i64::MAX, i64::MIN);
        for value in self.pixels.iter().map(get) {
            low = low.min(value);
            high = high.max(value);
        }
        self.widen(plane, low.into(), high.into());
    }
}

struct Adder<'a> {
    planes: &'a mut [Plane],
    done: [bool; PLANES],
    start: usize,
    pixels: &'a [PixelSums],
}

impl ReadPlanes for Adder<'_> {
    #[inline(always)]
    fn value(&mut self, plane: usize, get: impl Fn(&PixelSums) -> i128) {
        if !self.done[plane] {
            self.planes[plane].add(self.start, self.pixels.iter().map(get));
        }
    }
    #[inline(always)]
    fn square(&mut self, plane: usize, get: impl Fn(&PixelSums) -> Square) {
        if !self.done[plane] {
            self.planes[plane].add(self.start, self.pixels.iter().map(get));
        }
    }
    #[inline(always)]
    fn small(&mut self, plane: usize, get: impl Fn(&PixelSums) -> i64) {
        if !self.done[plane] {
            self.planes[plane].add(self.start, self.pixels.iter().map(get));
        }
    }
}
