//! Fields of our files, little endian, and the checksum at their end.

use crate::blocks::{self, BlockError, Scratch, Values};
use crate::buffer::{REJECTED_KEPT, Reject, Rejected};
use crate::codec::CodecError;
use crate::counters::Counters;
use crate::unit::{SIDE_MAX, SampleRange, TILE_SIZE, Tile};
use crate::wide::Wide;

/// Bytes of the checksum.
pub(crate) const CRC: usize = 4;

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
        blocks::unpack(&mut self.0, count, bounds, scratch)
            .map_err(|error| block_error(error, plane, samples))
    }

    /// A block of one plane over so many samples, checked and left as it is; its smallest and its
    /// largest integer.
    pub fn block_span(
        &mut self,
        plane: usize,
        samples: u32,
        count: usize,
        bounds: (Wide, Wide),
    ) -> Result<(Wide, Wide), CodecError> {
        blocks::check(&mut self.0, count, bounds)
            .map(|checked| (checked.block.base, checked.top))
            .map_err(|error| block_error(error, plane, samples))
    }
}

fn block_error(error: BlockError, plane: usize, samples: u32) -> CodecError {
    match error {
        BlockError::Short => CodecError::Malformed("length"),
        BlockError::Malformed => CodecError::Malformed("plane"),
        BlockError::OutOfRange => CodecError::OutOfRange { plane, samples },
    }
}
