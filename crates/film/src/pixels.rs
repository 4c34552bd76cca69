//! The sums of a unit, pixel by pixel in memory, plane by plane in a file.

use crate::blocks::{self, BLOCK, Scratch, Values};
use crate::buffer::PixelSums;
use crate::codec::CodecError;
use crate::fixed::Square;
use crate::planes::{self, PLANES, ReadPlanes};
use crate::wide::Wide;
use crate::wire::Reader;

/// Writes the blocks of a tile.
pub(crate) fn pack_pixels(pixels: &[PixelSums], out: &mut Vec<u8>) {
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
pub(crate) fn unpack_pixels(
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
