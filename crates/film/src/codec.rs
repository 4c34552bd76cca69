//! The bytes of one unit's result, as a worker sends them.
//!
//! ```text
//! magic "BRLU"  version u16  engine u32  length of the whole u32
//! frame u32  tile u32  begin u32  end u32            the unit
//! x u32  y u32  width u16  height u16                the tile's rectangle
//! counters 5 x u64
//! rejected u64  kept u8  kept x (x u16, y u16, index u32, reason u8)
//! for every 256 pixels: a block for each of the 16 planes (`blocks.rs`)
//! crc32 u32 of everything before
//! ```
//! All little endian. The same sums are the same bytes on every machine, and decoding accepts no
//! other bytes for them, so that results can be compared by digest.

use crate::blocks::{BLOCK, HEAD_MAX};
use crate::buffer::{REJECTED_KEPT, Rejected, SampleBuffer};
use crate::counters::Counters;
use crate::pixels::{pack_pixels, unpack_pixels};
use crate::planes::PLANES;
use crate::unit::{SPP_MAX, SampleRange, TILE_SIZE, Tile, Unit, pass_end};
use crate::version::EngineVersion;
use crate::wire::{CRC, Reader, check_crc, put_counters, put_rejected, put_u32s};

const MAGIC: [u8; 4] = *b"BRLU";
/// Version of the format.
pub const UNIT_FORMAT: u16 = 1;
/// Bytes before the counters.
const HEAD: usize = 4 + 2 + 4 + 4 + 16 + 12;
const COUNTERS: usize = 5 * 8;
const REJECTED: usize = 9;

/// A decoded result.
#[derive(Clone, Debug, PartialEq)]
pub struct UnitResult {
    /// What was rendered.
    pub unit: Unit,
    /// By which engine.
    pub engine: EngineVersion,
    /// Where the tile lies in the picture.
    pub tile: Tile,
    /// What it took.
    pub counters: Counters,
    /// The sums.
    pub buffer: SampleBuffer,
}

/// Why bytes are no result.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum CodecError {
    /// Another kind of file.
    #[error("not a unit result (it does not begin with BRLU)")]
    NotAUnit,
    /// A format that this program does not know.
    #[error("unit result format {0} is not known (this program reads {UNIT_FORMAT})")]
    Version(u16),
    /// Cut short, or with bytes left over.
    #[error("a unit result of {expected} bytes arrived as {found} bytes")]
    Length {
        /// What the head says, or the least there can be.
        expected: u64,
        /// What there is.
        found: u64,
    },
    /// Longer than any result of its tile.
    #[error("a unit result of {found} bytes is above the limit of {limit} bytes")]
    TooLong {
        /// The most for a tile.
        limit: usize,
        /// What there is.
        found: usize,
    },
    /// The checksum differs.
    #[error("damaged: the checksum is {found:08x}, not {expected:08x}")]
    Damaged {
        /// In the file.
        expected: u32,
        /// Of the bytes.
        found: u32,
    },
    /// Fields that contradict each other.
    #[error("malformed {0}")]
    Malformed(&'static str),
    /// Sums that so many samples cannot have.
    #[error("plane {plane} holds values that {samples} samples cannot add up to")]
    OutOfRange {
        /// Which plane.
        plane: usize,
        /// How many samples.
        samples: u32,
    },
}

/// Most bytes that the result of a tile can have.
pub fn encoded_len_max(tile: Tile) -> usize {
    let pixels = tile.pixels();
    let blocks = pixels.div_ceil(BLOCK);
    // Of the 16 planes 5 hold i128, 3 squares of 192 bits, 7 i64, one counts.
    HEAD + COUNTERS
        + 9
        + REJECTED_KEPT * REJECTED
        + blocks * PLANES * HEAD_MAX
        + pixels * (5 * 16 + 3 * 24 + 8 * 8)
        + CRC
}

/// Most bytes that any result can have.
pub fn unit_bytes_max() -> usize {
    encoded_len_max(Tile {
        x: 0,
        y: 0,
        width: TILE_SIZE,
        height: TILE_SIZE,
    })
}

/// The bytes of a result. `unit.samples` must be the samples of the buffer.
pub fn encode_unit(
    unit: Unit,
    buffer: &SampleBuffer,
    counters: &Counters,
    engine: EngineVersion,
) -> Vec<u8> {
    debug_assert_eq!(unit.samples, buffer.samples());
    let tile = buffer.tile();
    let mut out = Vec::with_capacity(256 + tile.pixels() * 100);
    out.extend_from_slice(&MAGIC);
    out.extend_from_slice(&UNIT_FORMAT.to_le_bytes());
    put_u32s(&mut out, &[engine.0, 0, unit.frame, unit.tile]);
    put_u32s(
        &mut out,
        &[unit.samples.begin, unit.samples.end, tile.x, tile.y],
    );
    out.extend_from_slice(&(tile.width as u16).to_le_bytes());
    out.extend_from_slice(&(tile.height as u16).to_le_bytes());
    put_counters(&mut out, counters);
    put_rejected(&mut out, buffer.rejected_count(), buffer.rejected());
    pack_pixels(buffer.pixels(), &mut out);
    let length = (out.len() + CRC) as u32;
    out[10..14].copy_from_slice(&length.to_le_bytes());
    let crc = crc32fast::hash(&out);
    out.extend_from_slice(&crc.to_le_bytes());
    out
}

/// Everything before the blocks.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Head {
    pub unit: Unit,
    pub engine: EngineVersion,
    pub tile: Tile,
    pub counters: Counters,
    pub rejected: Vec<Rejected>,
    pub rejected_count: u64,
}

/// Reads what is before the blocks, and the checksum; with it the blocks, which are not looked at.
pub(crate) fn read_head(bytes: &[u8]) -> Result<(Head, Reader<'_>), CodecError> {
    let length = |expected: usize| CodecError::Length {
        expected: expected as u64,
        found: bytes.len() as u64,
    };
    let least = HEAD + COUNTERS + 9 + CRC;
    if !bytes.starts_with(&MAGIC) {
        return Err(CodecError::NotAUnit);
    }
    if bytes.len() < least {
        return Err(length(least));
    }
    let mut input = Reader(&bytes[4..]);
    let version = input.u16()?;
    if version != UNIT_FORMAT {
        return Err(CodecError::Version(version));
    }
    let engine = EngineVersion(input.u32()?);
    let said = input.u32()? as usize;
    if said != bytes.len() {
        return Err(length(said));
    }
    if bytes.len() > unit_bytes_max() {
        return Err(CodecError::TooLong {
            limit: unit_bytes_max(),
            found: bytes.len(),
        });
    }
    let body = check_crc(bytes)?;
    input = Reader(&body[14..]);
    let (frame, index) = (input.u32()?, input.u32()?);
    let samples = SampleRange {
        begin: input.u32()?,
        end: input.u32()?,
    };
    let tile = input.tile()?;
    if bytes.len() > encoded_len_max(tile) {
        return Err(CodecError::TooLong {
            limit: encoded_len_max(tile),
            found: bytes.len(),
        });
    }
    if samples.is_empty() || samples.end > SPP_MAX || samples.end > pass_end(samples.begin) {
        return Err(CodecError::Malformed("sample range"));
    }
    let counters = input.counters()?;
    let (rejected_count, rejected) = input.rejected(tile, samples)?;
    if bytes.len() < least + rejected.len() * REJECTED + block_bytes_min(tile) {
        return Err(CodecError::Malformed("length"));
    }
    let unit = Unit {
        frame,
        tile: index,
        samples,
    };
    let head = Head {
        unit,
        engine,
        tile,
        counters,
        rejected,
        rejected_count,
    };
    Ok((head, input))
}

/// Reads a result back. Every changed, missing or added byte is refused, and so is anything that
/// [`encode_unit`] would not have written; no more memory is used than a tile's sums need.
///
/// What only has to be merged is cheaper as a [`PackedUnit`](crate::PackedUnit).
pub fn decode_unit(bytes: &[u8]) -> Result<UnitResult, CodecError> {
    let (head, mut input) = read_head(bytes)?;
    let samples = head.unit.samples;
    let mut buffer = SampleBuffer::new(head.tile, samples);
    unpack_pixels(&mut input, samples.len(), buffer.pixels_mut())?;
    if !input.0.is_empty() {
        return Err(CodecError::Malformed("end"));
    }
    buffer.set_rejected(head.rejected, head.rejected_count);
    Ok(UnitResult {
        unit: head.unit,
        engine: head.engine,
        tile: head.tile,
        counters: head.counters,
        buffer,
    })
}

/// Fewest bytes that the blocks of a tile take.
fn block_bytes_min(tile: Tile) -> usize {
    tile.pixels().div_ceil(BLOCK) * PLANES * 3
}
