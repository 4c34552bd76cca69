//! Pictures: how their pixels are kept, and lookup.
//!
//! Pixels stay as the file has them (8 or 16 bits with a table to linear, or floats) with as many
//! channels as it has, and pictures with the same bytes share them.

use super::decode::{self, Pixels, Raw};
use super::mapping::pixel;
use super::mip::Pyramid;
use glam::Vec2;
use scene::model::{Encoding, MipFilter, Wrap};
use std::sync::Arc;

/// A picture ready for lookup, top row first.
#[derive(Clone)]
pub struct Image {
    /// Pixels.
    pub width: u32,
    /// Pixels.
    pub height: u32,
    raw: Arc<Raw>,
    table: Table,
    pyramid: Option<Arc<Pyramid>>,
}

/// From stored to linear.
#[derive(Clone)]
enum Table {
    Bytes(Arc<[f32; 256]>),
    /// One entry for each of 65,536 numbers.
    Words(Arc<[f32]>),
    /// The numbers are linear.
    None,
}

/// Alpha of 8 bits; linear in every encoding.
const BYTE: f32 = 1.0 / 255.0;
/// Alpha of 16 bits.
const WORD: f32 = 1.0 / 65_535.0;

/// The four numbers of a pixel with `n` stored ones: grey is spread, missing alpha is opaque.
#[inline(always)]
fn spread<T: Copy>(
    data: &[T],
    at: usize,
    n: usize,
    color: impl Fn(T) -> f32,
    alpha: impl Fn(T) -> f32,
    opaque: f32,
) -> [f32; 4] {
    let t = &data[at * n..at * n + n];
    match n {
        1 => {
            let v = color(t[0]);
            [v, v, v, opaque]
        }
        2 => {
            let v = color(t[0]);
            [v, v, v, alpha(t[1])]
        }
        3 => [color(t[0]), color(t[1]), color(t[2]), opaque],
        _ => [color(t[0]), color(t[1]), color(t[2]), alpha(t[3])],
    }
}

impl Image {
    /// A stand-in that nobody overlooks.
    pub fn stand_in() -> Image {
        let (on, off) = ([255, 0, 255], [20, 20, 20]);
        let squares = (0..64).map(|i| if (i % 8 + i / 8) % 2 == 0 { on } else { off });
        let raw = Raw {
            width: 8,
            height: 8,
            channels: 3,
            pixels: Pixels::Bytes(squares.flatten().collect()),
        };
        Image::new(Arc::new(raw), Encoding::Srgb)
    }

    /// A pixel that no sample survives.
    pub(super) fn not_a_number() -> Image {
        let raw = Raw {
            width: 1,
            height: 1,
            channels: 1,
            pixels: Pixels::Floats(Box::new([f32::NAN])),
        };
        Image::new(Arc::new(raw), Encoding::Linear)
    }

    /// From what was decoded.
    pub(super) fn new(raw: Arc<Raw>, encoding: Encoding) -> Image {
        let (raw, table) = match &raw.pixels {
            Pixels::Bytes(_) => {
                let apply = transfer(encoding, false);
                let table = std::array::from_fn(|i| apply(i as f32 / 255.0));
                (raw, Table::Bytes(Arc::new(table)))
            }
            Pixels::Words(_) => {
                let apply = transfer(encoding, false);
                let table = (0..=u16::MAX).map(|v| apply(v as f32 * WORD)).collect();
                (raw, Table::Words(table))
            }
            Pixels::Floats(data) => {
                if matches!(encoding, Encoding::Auto | Encoding::Linear) {
                    (raw, Table::None)
                } else {
                    let apply = transfer(encoding, true);
                    let n = raw.channels as usize;
                    let color = |c: usize| n > 2 && c < 3 || c == 0;
                    let data = data
                        .iter()
                        .enumerate()
                        .map(|(i, v)| if color(i % n) { apply(*v) } else { *v })
                        .collect();
                    let pixels = Pixels::Floats(data);
                    (Arc::new(Raw { pixels, ..*raw }), Table::None)
                }
            }
        };
        Image {
            width: raw.width,
            height: raw.height,
            raw,
            table,
            pyramid: None,
        }
    }

    /// Decodes a picture from memory; the ending of `name` decides only what its content leaves open.
    pub fn decode(name: &str, bytes: &[u8], encoding: Encoding) -> Result<Image, String> {
        Ok(Image::new(Arc::new(decode::decode(name, bytes)?), encoding))
    }

    /// The pixels as they were decoded, for another picture of the same file; floats may be others.
    pub(super) fn raw_as_decoded(&self) -> Option<Arc<Raw>> {
        self.is_unit().then(|| self.raw.clone())
    }

    /// Builds the pyramid that filtered lookups need.
    pub(super) fn with_pyramid(mut self) -> Image {
        self.pyramid = Some(Arc::new(Pyramid::new(&self)));
        self
    }

    /// The texel at a pixel.
    #[inline]
    pub fn texel(&self, x: usize, y: usize) -> [f32; 4] {
        self.at(y * self.width as usize + x)
    }

    #[inline(always)]
    fn at(&self, i: usize) -> [f32; 4] {
        let n = self.raw.channels as usize;
        match (&self.raw.pixels, &self.table) {
            (Pixels::Bytes(data), Table::Bytes(table)) => spread(
                data,
                i,
                n,
                |v| table[v as usize],
                |a| a as f32 * BYTE,
                255.0 * BYTE,
            ),
            (Pixels::Words(data), Table::Words(table)) => spread(
                data,
                i,
                n,
                |v| table[v as usize],
                |a| a as f32 * WORD,
                65_535.0 * WORD,
            ),
            (Pixels::Floats(data), _) => spread(data, i, n, |v| v, |a| a, 1.0),
            // Tables are made for the pixels that they belong to.
            _ => [0.0; 4],
        }
    }

    /// At texture coordinates: (0, 0) is the bottom left.
    pub fn lookup(&self, st: Vec2, wrap: (Wrap, Wrap), nearest: bool) -> [f32; 4] {
        let (w, h) = (self.width as i64, self.height as i64);
        let get = |x: i64, y: i64| match pixel(x, y, w, h, wrap) {
            Some((x, y)) => self.texel(x, y),
            None => [0.0; 4],
        };
        if nearest {
            let (x, y) = (st.x * w as f32, (1.0 - st.y) * h as f32);
            if !(x.abs() < 1e9 && y.abs() < 1e9) {
                return get(0, 0);
            }
            return get(x.floor() as i64, y.floor() as i64);
        }
        bilinear(st, w, h, get)
    }

    /// At texture coordinates, over the ellipse that two offsets span.
    pub fn filtered(
        &self,
        st: Vec2,
        axes: [Vec2; 2],
        wrap: (Wrap, Wrap),
        filter: MipFilter,
    ) -> [f32; 4] {
        match &self.pyramid {
            Some(pyramid) => pyramid.lookup(self, st, axes, wrap, filter),
            None => self.lookup(st, wrap, false),
        }
    }

    /// Whether all of its numbers lie in [0, 1], as those of 8- and 16-bit files do.
    pub(super) fn is_unit(&self) -> bool {
        !matches!(self.raw.pixels, Pixels::Floats(_))
    }

    /// Whether no pixel is transparent.
    pub fn is_opaque(&self) -> bool {
        let n = self.raw.channels as usize;
        if n != 2 && n != 4 {
            return true;
        }
        match &self.raw.pixels {
            Pixels::Bytes(data) => data.iter().skip(n - 1).step_by(n).all(|a| *a == u8::MAX),
            Pixels::Words(data) => data.iter().skip(n - 1).step_by(n).all(|a| *a == u16::MAX),
            Pixels::Floats(data) => data.iter().skip(n - 1).step_by(n).all(|a| *a == 1.0),
        }
    }

    /// Mean over all pixels of the luminance of linear Rec. 709.
    pub fn mean_luminance(&self) -> f64 {
        let count = self.width as usize * self.height as usize;
        let sum: f64 = (0..count).map(|i| luminance(self.at(i))).sum();
        sum / count as f64
    }

    /// Pieces of memory held: an address that tells them apart, and their size.
    pub(super) fn parts(&self) -> Vec<(usize, usize)> {
        let mut parts = vec![(Arc::as_ptr(&self.raw) as usize, self.raw.memory_bytes())];
        if let Some(pyramid) = &self.pyramid {
            parts.push((Arc::as_ptr(pyramid) as usize, pyramid.memory_bytes()));
        }
        parts
    }
}

/// Luminance of a texel.
pub(crate) fn luminance(t: [f32; 4]) -> f64 {
    let [r, g, b] = [t[0] as f64, t[1] as f64, t[2] as f64];
    0.2126 * r + 0.7152 * g + 0.0722 * b
}

/// Between the four texels about a place; (0, 0) is the bottom left.
#[inline(always)]
pub(super) fn bilinear(st: Vec2, w: i64, h: i64, get: impl Fn(i64, i64) -> [f32; 4]) -> [f32; 4] {
    let (x, y) = (st.x * w as f32, (1.0 - st.y) * h as f32);
    if !(x.abs() < 1e9 && y.abs() < 1e9) {
        return get(0, 0);
    }
    let (x, y) = (x - 0.5, y - 0.5);
    let (x0, y0) = (x.floor(), y.floor());
    let (fx, fy) = (x - x0, y - y0);
    let (x0, y0) = (x0 as i64, y0 as i64);
    let (a, b, c, d) = (
        get(x0, y0),
        get(x0 + 1, y0),
        get(x0, y0 + 1),
        get(x0 + 1, y0 + 1),
    );
    std::array::from_fn(|i| {
        (a[i] * (1.0 - fx) + b[i] * fx) * (1.0 - fy) + (c[i] * (1.0 - fx) + d[i] * fx) * fy
    })
}

/// From stored to linear.
fn transfer(encoding: Encoding, float: bool) -> impl Fn(f32) -> f32 {
    move |x| match encoding {
        Encoding::Linear => x,
        Encoding::Auto if float => x,
        Encoding::Auto | Encoding::Srgb => from_srgb(x),
        Encoding::GammaMicros(g) => libm::pow(x.max(0.0) as f64, g as f64 * 1e-6) as f32,
    }
}

/// sRGB transfer function [IEC 61966-2-1].
fn from_srgb(x: f32) -> f32 {
    let x = x as f64;
    let y = if x <= 0.04045 {
        x / 12.92
    } else {
        libm::pow((x + 0.055) / 1.055, 2.4)
    };
    y as f32
}
