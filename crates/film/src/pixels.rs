//! The sums of a unit, pixel by pixel in memory, plane by plane in a file.

use crate::blocks::{self, BLOCK, Scratch, Values};
use crate::buffer::PixelSums;
use crate::codec::CodecError;
use crate::fixed::Square;
use crate::planes::{self, PLANES, ReadPlanes};
use crate::wide::Wide;
use crate::wire::Reader;

/// Pixels that are taken apart at once: 8 KB, so that they are read from memory once and not once for
/// each plane.
const PART: usize = 32;

/// Writes the blocks of a tile.
pub(crate) fn pack_pixels(pixels: &[PixelSums], out: &mut Vec<u8>) {
    let mut apart = Box::new(Apart {
        pixels: &[],
        start: 0,
        low: [[0; BLOCK]; PLANES],
        high: [[0; BLOCK]; PLANES],
        above_i64: [0; PLANES],
        above_i128: [0; PLANES],
    });
    for block in pixels.chunks(BLOCK) {
        (apart.above_i64, apart.above_i128) = ([0; PLANES], [0; PLANES]);
        for (i, part) in block.chunks(PART).enumerate() {
            (apart.start, apart.pixels) = (i * PART, part);
            planes::read_planes(&mut *apart);
        }
        for plane in 0..PLANES {
            apart.pack(plane, block, out);
        }
    }
}

/// A block taken apart into planes, of each integer the low and the high 64 bits.
struct Apart<'a> {
    pixels: &'a [PixelSums],
    /// Place of the first of them in the block.
    start: usize,
    low: [[i64; BLOCK]; PLANES],
    high: [[i64; BLOCK]; PLANES],
    /// Not zero if an integer of the plane does not fit.
    above_i64: [i64; PLANES],
    above_i128: [u128; PLANES],
}

impl Apart<'_> {
    fn pack(&self, plane: usize, block: &[PixelSums], out: &mut Vec<u8>) {
        let low = &self.low[plane][..block.len()];
        if self.above_i128[plane] != 0 {
            let square = |p: &PixelSums| Wide::from(p.square[plane - planes::SQUARE]);
            let wide: Vec<Wide> = block.iter().map(square).collect();
            return blocks::pack_wide(&wide, out);
        }
        if self.above_i64[plane] == 0 {
            return blocks::pack_i64(low, out);
        }
        let mut mid = [0; BLOCK];
        for (mid, (low, high)) in mid.iter_mut().zip(low.iter().zip(&self.high[plane])) {
            *mid = (*high as i128) << 64 | *low as u64 as i128;
        }
        blocks::pack_i128(&mid[..block.len()], out);
    }

    #[inline(always)]
    fn take(&mut self, plane: usize, halves: impl Fn(&PixelSums) -> (i64, i64)) {
        let low = &mut self.low[plane][self.start..];
        let high = &mut self.high[plane][self.start..];
        let mut above = 0;
        for ((low, high), pixel) in low.iter_mut().zip(high).zip(self.pixels) {
            (*low, *high) = halves(pixel);
            above |= *high ^ (*low >> 63);
        }
        self.above_i64[plane] |= above;
    }
}

impl ReadPlanes for Apart<'_> {
    #[inline(always)]
    fn value(&mut self, plane: usize, get: impl Fn(&PixelSums) -> i128) {
        self.take(plane, |pixel| {
            let value = get(pixel);
            (value as i64, (value >> 64) as i64)
        });
    }

    #[inline(always)]
    fn square(&mut self, plane: usize, get: impl Fn(&PixelSums) -> Square) {
        self.take(plane, |pixel| {
            let square = get(pixel);
            (square.fraction as i64, square.whole as i64)
        });
        for pixel in self.pixels {
            self.above_i128[plane] |= get(pixel).whole >> 63;
        }
    }

    #[inline(always)]
    fn small(&mut self, plane: usize, get: impl Fn(&PixelSums) -> i64) {
        let low = &mut self.low[plane][self.start..];
        for (low, pixel) in low.iter_mut().zip(self.pixels) {
            *low = get(pixel);
        }
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
