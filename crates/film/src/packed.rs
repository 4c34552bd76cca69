//! A result that is checked and stays packed until it is merged.

use crate::blocks::{self, BLOCK};
use crate::codec::{CodecError, Head, read_head};
use crate::counters::Counters;
use crate::plane::Plane;
use crate::planes::{self, PLANES};
use crate::unit::{Tile, Unit};
use crate::version::EngineVersion;
use crate::wide::Wide;
use std::ops::Range;

/// A result as a worker sends it, known to be whole and sound. Merging adds the blocks of its bytes to
/// the planes of a film one by one, so that the sums of a tile, a megabyte, are never written out.
///
/// `B` holds the bytes and has to show the same ones whenever it is asked.
#[derive(Clone, Debug)]
pub struct PackedUnit<B> {
    head: Head,
    /// Smallest and largest sum of each plane.
    spans: [(Wide, Wide); PLANES],
    bytes: B,
    blocks: Range<usize>,
}

impl<B: AsRef<[u8]>> PackedUnit<B> {
    /// Checks a result. Takes and refuses the same bytes as [`decode_unit`](crate::decode_unit), with
    /// the same errors.
    pub fn read(bytes: B) -> Result<PackedUnit<B>, CodecError> {
        let all = bytes.as_ref();
        let (head, mut input) = read_head(all)?;
        let start = all.len() - crate::wire::CRC - input.0.len();
        let blocks = start..start + input.0.len();
        let samples = head.unit.samples.len();
        let bounds: [_; PLANES] = std::array::from_fn(|plane| planes::bounds(plane, samples));
        let mut spans: Option<[(Wide, Wide); PLANES]> = None;
        for (_, count) in blocks_of(head.tile) {
            let mut found = [(Wide::ZERO, Wide::ZERO); PLANES];
            for (plane, span) in found.iter_mut().enumerate() {
                *span = input.block_span(plane, samples, count, bounds[plane])?;
            }
            match &mut spans {
                None => spans = Some(found),
                Some(spans) => {
                    for (span, (low, high)) in spans.iter_mut().zip(found) {
                        *span = (span.0.min(low), span.1.max(high));
                    }
                }
            }
        }
        if !input.0.is_empty() {
            return Err(CodecError::Malformed("end"));
        }
        Ok(PackedUnit {
            head,
            spans: spans.unwrap_or([(Wide::ZERO, Wide::ZERO); PLANES]),
            bytes,
            blocks,
        })
    }

    /// What was rendered.
    pub fn unit(&self) -> Unit {
        self.head.unit
    }
    /// By which engine.
    pub fn engine(&self) -> EngineVersion {
        self.head.engine
    }
    /// Where the tile lies in the picture.
    pub fn tile(&self) -> Tile {
        self.head.tile
    }
    /// What it took.
    pub fn counters(&self) -> &Counters {
        &self.head.counters
    }
    /// How many samples were rejected.
    pub fn rejected_count(&self) -> u64 {
        self.head.rejected_count
    }
    /// The bytes as they came.
    pub fn bytes(&self) -> &B {
        &self.bytes
    }

    pub(crate) fn head(&self) -> &Head {
        &self.head
    }
    pub(crate) fn spans(&self) -> &[(Wide, Wide); PLANES] {
        &self.spans
    }

    /// Adds the sums to planes that have room for them, but for those that are `done`.
    pub(crate) fn add_to(&self, planes: &mut [Plane], done: &[bool; PLANES]) {
        let mut input = self.bytes.as_ref().get(self.blocks.clone()).unwrap_or(&[]);
        for (start, count) in blocks_of(self.head.tile) {
            for (plane, done) in planes.iter_mut().zip(done) {
                // Cannot fail: it was read before.
                let Ok(block) = blocks::split(&mut input, count) else {
                    return;
                };
                if !done {
                    plane.add_packed(start, count, &block);
                }
            }
        }
    }
}

/// First pixel and number of pixels of each row of blocks.
fn blocks_of(tile: Tile) -> impl Iterator<Item = (usize, usize)> {
    let pixels = tile.pixels();
    let starts = (0..pixels).step_by(BLOCK);
    starts.map(move |start| (start, BLOCK.min(pixels - start)))
}
