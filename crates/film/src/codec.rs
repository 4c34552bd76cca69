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

use crate::blocks::{self, BLOCK, BlockError, HEAD_MAX, Scratch, Values};
use crate::buffer::{PixelSums, REJECTED_KEPT, Reject, Rejected, SampleBuffer};
use crate::counters::Counters;
use crate::fixed::Square;
use crate::planes::{self, PLANES, ReadPlanes};
use crate::unit::{SIDE_MAX, SPP_MAX, SampleRange, TILE_SIZE, Tile, Unit, pass_end};
use crate::version::EngineVersion;
use crate::wide::Wide;

const MAGIC: [u8; 4] = *b"BRLU";
/// Version of the format.
pub const UNIT_FORMAT: u16 = 1;
/// Bytes before the counters.
const HEAD: usize = 4 + 2 + 4 + 4 + 16 + 12;
const COUNTERS: usize = 5 * 8;
const REJECTED: usize = 9;
const CRC: usize = 4;

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

/// Reads a result back. Every changed, missing or added byte is refused, and so is anything that
/// [`encode_unit`] would not have written; no more memory is used than a tile's sums need.
pub fn decode_unit(bytes: &[u8]) -> Result<UnitResult, CodecError> {
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
    let mut buffer = SampleBuffer::new(tile, samples);
    unpack_pixels(&mut input, samples.len(), buffer.pixels_mut())?;
    if !input.0.is_empty() {
        return Err(CodecError::Malformed("end"));
    }
    buffer.set_rejected(rejected, rejected_count);
    let unit = Unit {
        frame,
        tile: index,
        samples,
    };
    Ok(UnitResult {
        unit,
        engine,
        tile,
        counters,
        buffer,
    })
}

/// Fewest bytes that the blocks of a tile take.
fn block_bytes_min(tile: Tile) -> usize {
    tile.pixels().div_ceil(BLOCK) * PLANES * 3
}

/// Everything before the checksum, if that is right.
pub(crate) fn check_crc(bytes: &[u8]) -> Result<&[u8], CodecError> {
    let (body, crc) = bytes.split_last_chunk::<CRC>().ok_or(CodecError::Length {
        expected: CRC as u64,
        found: bytes.len() as u64,
    })?;
    let (expected, found) = (u32::from_le_bytes(*crc), crc32fast::hash(body));
    if expected != found {
        return Err(CodecError::Damaged { expected, found });
    }
    Ok(body)
}

pub(crate) fn put_u32s(out: &mut Vec<u8>, values: &[u32]) {
    for value in values {
        out.extend_from_slice(&value.to_le_bytes());
    }
}

pub(crate) fn put_counters(out: &mut Vec<u8>, counters: &Counters) {
    let Counters {
        samples,
        rays,
        shadow_rays,
        bounces,
        rejected,
    } = *counters;
    for value in [samples, rays, shadow_rays, bounces, rejected] {
        out.extend_from_slice(&value.to_le_bytes());
    }
}

pub(crate) fn put_rejected(out: &mut Vec<u8>, count: u64, kept: &[Rejected]) {
    out.extend_from_slice(&count.to_le_bytes());
    out.push(kept.len() as u8);
    for place in kept {
        out.extend_from_slice(&place.x.to_le_bytes());
        out.extend_from_slice(&place.y.to_le_bytes());
        out.extend_from_slice(&place.index.to_le_bytes());
        out.push(match place.reason {
            Reject::NotFinite => 0,
            Reject::OutOfRange => 1,
        });
    }
}

/// Writes the blocks of a tile.
fn pack_pixels(pixels: &[PixelSums], out: &mut Vec<u8>) {
    let mut packer = Packer {
        pixels,
        out,
        narrow: [0; BLOCK],
        mid: [0; BLOCK],
    };
    for block in pixels.chunks(BLOCK) {
        packer.pixels = block;
        planes::read_planes(&mut packer);
    }
}

struct Packer<'a> {
    pixels: &'a [PixelSums],
    out: &'a mut Vec<u8>,
    narrow: [i64; BLOCK],
    mid: [i128; BLOCK],
}

impl ReadPlanes for Packer<'_> {
    #[inline(always)]
    fn value(&mut self, _: usize, get: impl Fn(&PixelSums) -> i128) {
        let n = self.pixels.len();
        let mut spill = 0;
        for (out, pixel) in self.narrow.iter_mut().zip(self.pixels) {
            let value = get(pixel);
            *out = value as i64;
            spill |= (value >> 64) as i64 ^ (value as i64 >> 63);
        }
        if spill == 0 {
            return blocks::pack_i64(&self.narrow[..n], self.out);
        }
        for (out, pixel) in self.mid.iter_mut().zip(self.pixels) {
            *out = get(pixel);
        }
        blocks::pack_i128(&self.mid[..n], self.out);
    }

    #[inline(always)]
    fn square(&mut self, _: usize, get: impl Fn(&PixelSums) -> Square) {
        let n = self.pixels.len();
        let (mut above_i64, mut above_i128) = (0, 0);
        for (out, pixel) in self.mid.iter_mut().zip(self.pixels) {
            let square = get(pixel);
            *out = (square.whole << 64 | square.fraction as u128) as i128;
            above_i64 |= square.whole | (square.fraction >> 63) as u128;
            above_i128 |= square.whole >> 63;
        }
        if above_i128 != 0 {
            let wide: Vec<Wide> = self.pixels.iter().map(|p| Wide::from(get(p))).collect();
            blocks::pack_wide(&wide, self.out);
        } else if above_i64 != 0 {
            blocks::pack_i128(&self.mid[..n], self.out);
        } else {
            for (out, &value) in self.narrow.iter_mut().zip(&self.mid) {
                *out = value as i64;
            }
            blocks::pack_i64(&self.narrow[..n], self.out);
        }
    }

    #[inline(always)]
    fn small(&mut self, _: usize, get: impl Fn(&PixelSums) -> i64) {
        for (out, pixel) in self.narrow.iter_mut().zip(self.pixels) {
            *out = get(pixel);
        }
        blocks::pack_i64(&self.narrow[..self.pixels.len()], self.out);
    }
}

/// Reads the blocks of a tile.
fn unpack_pixels(
    input: &mut Reader,
    samples: u32,
    pixels: &mut [PixelSums],
) -> Result<(), CodecError> {
    let mut scratch = Scratch::new();
    let bounds: [_; PLANES] = std::array::from_fn(|plane| planes::bounds(plane, samples));
    for block in pixels.chunks_mut(BLOCK) {
        for (plane, &bounds) in bounds.iter().enumerate() {
            let values = input.block(plane, samples, block.len(), bounds, &mut scratch)?;
            scatter(plane, values, block);
        }
    }
    Ok(())
}

/// Writes a block into its plane of the pixels.
fn scatter(plane: usize, values: Values, pixels: &mut [PixelSums]) {
    match values {
        // The sums begin at zero.
        Values::Same(Wide::ZERO) => {}
        Values::Same(value) => {
            for pixel in pixels {
                planes::write_wide(pixel, plane, value);
            }
        }
        Values::Narrow(values) => scatter_narrow(plane, values, pixels),
        Values::Mid(values) => scatter_mid(plane, values, pixels),
        Values::Wide(values) => {
            for (pixel, &value) in pixels.iter_mut().zip(values) {
                planes::write_wide(pixel, plane, value);
            }
        }
    }
}

/// One loop for each plane, so that the choice of the field is outside of it.
fn scatter_narrow(plane: usize, values: &[i64], pixels: &mut [PixelSums]) {
    #[inline(always)]
    fn each<const PLANE: usize>(values: &[i64], pixels: &mut [PixelSums]) {
        for (pixel, &value) in pixels.iter_mut().zip(values) {
            planes::write_narrow(pixel, PLANE, value);
        }
    }
    match plane {
        0 => each::<0>(values, pixels),
        1 => each::<1>(values, pixels),
        2 => each::<2>(values, pixels),
        6 => each::<6>(values, pixels),
        7 => each::<7>(values, pixels),
        8 => each::<8>(values, pixels),
        9 => each::<9>(values, pixels),
        10 => each::<10>(values, pixels),
        11 => each::<11>(values, pixels),
        12 => each::<12>(values, pixels),
        13 => each::<13>(values, pixels),
        14 => each::<14>(values, pixels),
        15 => each::<15>(values, pixels),
        _ => values
            .iter()
            .zip(pixels)
            .for_each(|(&value, pixel)| planes::write_narrow(pixel, plane, value)),
    }
}

/// The same for planes that can be wider.
fn scatter_mid(plane: usize, values: &[i128], pixels: &mut [PixelSums]) {
    #[inline(always)]
    fn each<const PLANE: usize>(values: &[i128], pixels: &mut [PixelSums]) {
        for (pixel, &value) in pixels.iter_mut().zip(values) {
            planes::write_mid(pixel, PLANE, value);
        }
    }
    match plane {
        3 => each::<3>(values, pixels),
        4 => each::<4>(values, pixels),
        5 => each::<5>(values, pixels),
        _ => values
            .iter()
            .zip(pixels)
            .for_each(|(&value, pixel)| planes::write_mid(pixel, plane, value)),
    }
}

/// Takes fields off the front of a file.
pub(crate) struct Reader<'a>(pub &'a [u8]);

impl<'a> Reader<'a> {
    pub fn bytes<const N: usize>(&mut self) -> Result<[u8; N], CodecError> {
        let (head, rest) = self
            .0
            .split_first_chunk()
            .ok_or(CodecError::Malformed("length"))?;
        self.0 = rest;
        Ok(*head)
    }

    pub fn slice(&mut self, n: usize) -> Result<&'a [u8], CodecError> {
        blocks::take(&mut self.0, n).ok_or(CodecError::Malformed("length"))
    }

    pub fn u8(&mut self) -> Result<u8, CodecError> {
        Ok(self.bytes::<1>()?[0])
    }
    pub fn u16(&mut self) -> Result<u16, CodecError> {
        Ok(u16::from_le_bytes(self.bytes()?))
    }
    pub fn u32(&mut self) -> Result<u32, CodecError> {
        Ok(u32::from_le_bytes(self.bytes()?))
    }
    pub fn u64(&mut self) -> Result<u64, CodecError> {
        Ok(u64::from_le_bytes(self.bytes()?))
    }

    pub fn tile(&mut self) -> Result<Tile, CodecError> {
        let (x, y) = (self.u32()?, self.u32()?);
        let (width, height) = (self.u16()? as u32, self.u16()? as u32);
        let side = |at: u32, length: u32| {
            at < SIDE_MAX && at.is_multiple_of(TILE_SIZE) && (1..=TILE_SIZE).contains(&length)
        };
        if !side(x, width) || !side(y, height) {
            return Err(CodecError::Malformed("tile"));
        }
        Ok(Tile {
            x,
            y,
            width,
            height,
        })
    }

    pub fn counters(&mut self) -> Result<Counters, CodecError> {
        Ok(Counters {
            samples: self.u64()?,
            rays: self.u64()?,
            shadow_rays: self.u64()?,
            bounces: self.u64()?,
            rejected: self.u64()?,
        })
    }

    pub fn rejected(
        &mut self,
        tile: Tile,
        samples: SampleRange,
    ) -> Result<(u64, Vec<Rejected>), CodecError> {
        let (count, kept) = (self.u64()?, self.u8()? as usize);
        let all = tile.pixels() as u64 * samples.len() as u64;
        if count > all || kept as u64 != count.min(REJECTED_KEPT as u64) {
            return Err(CodecError::Malformed("number of rejected samples"));
        }
        let mut places = Vec::with_capacity(kept);
        for _ in 0..kept {
            let (x, y, index) = (self.u16()?, self.u16()?, self.u32()?);
            let reason = match self.u8()? {
                0 => Reject::NotFinite,
                1 => Reject::OutOfRange,
                _ => return Err(CodecError::Malformed("rejected sample")),
            };
            let inside = (x as u32) < tile.width && (y as u32) < tile.height;
            if !inside || !(samples.begin..samples.end).contains(&index) {
                return Err(CodecError::Malformed("rejected sample"));
            }
            places.push(Rejected {
                x,
                y,
                index,
                reason,
            });
        }
        Ok((count, places))
    }

    /// A block of one plane over so many samples.
    pub fn block<'s>(
        &mut self,
        plane: usize,
        samples: u32,
        count: usize,
        bounds: (Wide, Wide),
        scratch: &'s mut Scratch,
    ) -> Result<Values<'s>, CodecError> {
        blocks::unpack(&mut self.0, count, bounds, scratch).map_err(|error| match error {
            BlockError::Short => CodecError::Malformed("length"),
            BlockError::Malformed => CodecError::Malformed("plane"),
            BlockError::OutOfRange => CodecError::OutOfRange { plane, samples },
        })
    }
}
