//! The quantities of a pixel as planes, and what each may hold.

use crate::buffer::PixelSums;
use crate::fixed::{BOUNDED_BITS, SQUARE_BITS, Square, VALUE_BITS};
use crate::wide::Wide;

/// Number of planes.
pub(crate) const PLANES: usize = 16;

/// First plane of each quantity.
pub(crate) const BEAUTY: usize = 0;
pub(crate) const SQUARE: usize = 3;
pub(crate) const HALF: usize = 6;
pub(crate) const ALPHA: usize = 7;
pub(crate) const ALBEDO: usize = 8;
pub(crate) const NORMAL: usize = 11;
pub(crate) const DEPTH: usize = 14;
pub(crate) const HITS: usize = 15;

/// Smallest and largest value of a plane over so many samples. What lies outside was not summed
/// from samples, and cannot overflow a film if it is refused.
pub(crate) fn bounds(plane: usize, samples: u32) -> (Wide, Wide) {
    let symmetric = |bits| {
        let top = Wide::scaled(samples, bits);
        (top.neg(), top)
    };
    match plane {
        BEAUTY..SQUARE | HALF | DEPTH => symmetric(VALUE_BITS + 32),
        SQUARE..HALF => (Wide::ZERO, Wide::scaled(samples, SQUARE_BITS + 64)),
        HITS => (Wide::ZERO, Wide::scaled(samples, 0)),
        _ => symmetric(BOUNDED_BITS + 10),
    }
}

/// Does something with every plane; called once a plane, in order.
pub(crate) trait ReadPlanes {
    /// A plane of i128.
    fn value(&mut self, plane: usize, get: impl Fn(&PixelSums) -> i128);
    /// A plane of squares.
    fn square(&mut self, plane: usize, get: impl Fn(&PixelSums) -> Square);
    /// A plane of at most 64 bits.
    fn small(&mut self, plane: usize, get: impl Fn(&PixelSums) -> i64);
}

/// Shows every plane to a reader.
pub(crate) fn read_planes(reader: &mut impl ReadPlanes) {
    for c in 0..3 {
        reader.value(BEAUTY + c, |p| p.beauty[c]);
    }
    for c in 0..3 {
        reader.square(SQUARE + c, |p| p.square[c]);
    }
    reader.value(HALF, |p| p.half);
    reader.small(ALPHA, |p| p.alpha);
    for c in 0..3 {
        reader.small(ALBEDO + c, |p| p.albedo[c]);
    }
    for c in 0..3 {
        reader.small(NORMAL + c, |p| p.normal[c]);
    }
    reader.value(DEPTH, |p| p.depth);
    reader.small(HITS, |p| p.hits as i64);
}

/// Writes one value, known to be inside the [`bounds`] of its plane.
#[inline(always)]
pub(crate) fn write_narrow(pixel: &mut PixelSums, plane: usize, value: i64) {
    match plane {
        BEAUTY..SQUARE => pixel.beauty[plane - BEAUTY] = value as i128,
        SQUARE..HALF => {
            pixel.square[plane - SQUARE] = Square {
                whole: 0,
                fraction: value as u64,
            }
        }
        ALBEDO..NORMAL => pixel.albedo[plane - ALBEDO] = value,
        NORMAL..DEPTH => pixel.normal[plane - NORMAL] = value,
        HALF => pixel.half = value as i128,
        ALPHA => pixel.alpha = value,
        DEPTH => pixel.depth = value as i128,
        _ => pixel.hits = value as u32,
    }
}

/// Writes one value, known to be inside the [`bounds`] of its plane.
#[inline(always)]
pub(crate) fn write_mid(pixel: &mut PixelSums, plane: usize, value: i128) {
    match plane {
        BEAUTY..SQUARE => pixel.beauty[plane - BEAUTY] = value,
        SQUARE..HALF => {
            pixel.square[plane - SQUARE] = Square {
                whole: (value >> 64) as u128,
                fraction: value as u64,
            }
        }
        HALF => pixel.half = value,
        DEPTH => pixel.depth = value,
        _ => write_narrow(pixel, plane, value as i64),
    }
}

/// Writes one value, known to be inside the [`bounds`] of its plane.
pub(crate) fn write_wide(pixel: &mut PixelSums, plane: usize, value: Wide) {
    if (SQUARE..HALF).contains(&plane) {
        pixel.square[plane - SQUARE] = value.to_square();
    } else if let Some(value) = value.to_i128() {
        write_mid(pixel, plane, value);
    }
}
