//! From sums to numbers: the mean of each layer, linear, a channel at a time.

use crate::error::{ERROR_EPS, LUMINANCE};
use crate::film::Film;
use crate::fixed::{BOUNDED_BITS, SQUARE_BITS, VALUE_BITS};
use crate::planes::{ALBEDO, ALPHA, BEAUTY, DEPTH, HITS, NORMAL, SQUARE};
use crate::tile::TileFilm;
use crate::unit::TILE_SIZE;

/// What a picture can show.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum Layer {
    /// Radiance, linear Rec. 709, as seen against black (premultiplied by alpha).
    Beauty,
    /// Coverage.
    Alpha,
    /// Directional albedo of the first surface.
    Albedo,
    /// Shading normal of the first surface, world space.
    Normal,
    /// Distance to the first surface, mean over the samples that hit one; infinite if none did.
    Depth,
    /// Number of samples.
    Samples,
    /// Variance of the mean of the radiance.
    Variance,
    /// Relative standard deviation of a pixel's mean luminance, from its own samples; NaN for less
    /// than two.
    Error,
}

impl Layer {
    /// All of them.
    pub const ALL: [Layer; 8] = [
        Layer::Beauty,
        Layer::Alpha,
        Layer::Albedo,
        Layer::Normal,
        Layer::Depth,
        Layer::Samples,
        Layer::Variance,
        Layer::Error,
    ];

    /// As in addresses and channel names.
    pub fn name(self) -> &'static str {
        match self {
            Layer::Beauty => "beauty",
            Layer::Alpha => "alpha",
            Layer::Albedo => "albedo",
            Layer::Normal => "normal",
            Layer::Depth => "depth",
            Layer::Samples => "samples",
            Layer::Variance => "variance",
            Layer::Error => "error",
        }
    }

    /// Number of channels.
    pub fn channels(self) -> usize {
        match self {
            Layer::Beauty | Layer::Albedo | Layer::Normal | Layer::Variance => 3,
            Layer::Alpha | Layer::Depth | Layer::Samples | Layer::Error => 1,
        }
    }
}

impl std::fmt::Display for Layer {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(self.name())
    }
}

/// A name that is no layer's or no tone map's.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("'{name}' is not one of {known}")]
pub struct UnknownName {
    pub(crate) name: String,
    pub(crate) known: String,
}

impl UnknownName {
    pub(crate) fn new(name: &str, known: &[&str]) -> UnknownName {
        UnknownName {
            name: name.chars().take(64).collect(),
            known: known.join(", "),
        }
    }
}

impl std::str::FromStr for Layer {
    type Err = UnknownName;
    fn from_str(name: &str) -> Result<Layer, UnknownName> {
        Layer::ALL
            .into_iter()
            .find(|layer| layer.name() == name)
            .ok_or_else(|| UnknownName::new(name, &Layer::ALL.map(Layer::name)))
    }
}

/// One channel of a layer, row by row from the top left. Zero where there are no samples yet,
/// but for the error, which is not known there.
pub fn channel(film: &Film, layer: Layer, channel: usize) -> Vec<f32> {
    debug_assert!(channel < layer.channels());
    let width = film.grid().width as usize;
    let unknown = if layer == Layer::Error { f32::NAN } else { 0.0 };
    let mut out = vec![unknown; width * film.grid().height as usize];
    let mut numbers = [0.0; TILE_SIZE as usize];
    for tile in film.tiles().iter().filter(|tile| tile.samples() > 0) {
        let shape = tile.tile();
        let (x, columns) = (shape.x as usize, shape.width as usize);
        let numbers = &mut numbers[..columns];
        for y in 0..shape.height as usize {
            row(tile, layer, channel, y * columns, numbers);
            let start = (shape.y as usize + y) * width + x;
            for (out, number) in out[start..start + columns].iter_mut().zip(&*numbers) {
                *out = *number as f32;
            }
        }
    }
    out
}

/// Numbers of some pixels, up to a row, of a tile that has samples.
fn row(tile: &TileFilm, layer: Layer, channel: usize, start: usize, out: &mut [f64]) {
    let n = tile.samples() as f64;
    match layer {
        Layer::Beauty => means(tile, channel, start, out),
        Layer::Alpha => bounded(tile, ALPHA, start, out),
        Layer::Albedo => bounded(tile, ALBEDO + channel, start, out),
        Layer::Normal => bounded(tile, NORMAL + channel, start, out),
        Layer::Depth => {
            let mut hits = [0.0; TILE_SIZE as usize];
            tile.plane(HITS).numbers(start, &mut hits[..out.len()]);
            tile.plane(DEPTH).numbers(start, out);
            for (out, hits) in out.iter_mut().zip(hits) {
                let sum = *out / (1u64 << VALUE_BITS) as f64;
                *out = if hits > 0.0 {
                    sum / hits
                } else {
                    f64::INFINITY
                };
            }
        }
        Layer::Samples => out.fill(n),
        Layer::Variance => variances(tile, channel, start, out),
        Layer::Error if tile.samples() < 2 => out.fill(f64::NAN),
        Layer::Error => {
            let mut luminance = [0.0; TILE_SIZE as usize];
            let mut deviation = [0.0; TILE_SIZE as usize];
            for (c, weight) in LUMINANCE.into_iter().enumerate() {
                means(tile, c, start, out);
                for (sum, mean) in luminance.iter_mut().zip(&*out) {
                    *sum += weight * mean;
                }
                variances(tile, c, start, out);
                for (sum, variance) in deviation.iter_mut().zip(&*out) {
                    *sum += weight * variance.sqrt();
                }
            }
            for ((out, luminance), deviation) in out.iter_mut().zip(luminance).zip(deviation) {
                *out = deviation / (luminance * luminance + ERROR_EPS).sqrt();
            }
        }
    }
}

fn bounded(tile: &TileFilm, plane: usize, start: usize, out: &mut [f64]) {
    let (step, n) = (1.0 / (1u64 << BOUNDED_BITS) as f64, tile.samples() as f64);
    tile.plane(plane).numbers(start, out);
    for sum in out {
        *sum = *sum * step / n;
    }
}

fn means(tile: &TileFilm, channel: usize, start: usize, out: &mut [f64]) {
    let n = tile.samples() as f64;
    tile.plane(BEAUTY + channel).numbers(start, out);
    for sum in out {
        *sum = *sum / (1u64 << VALUE_BITS) as f64 / n;
    }
}

/// Of the mean; zero for a single sample, which says nothing about it.
fn variances(tile: &TileFilm, channel: usize, start: usize, out: &mut [f64]) {
    let n = tile.samples() as f64;
    let mut mean = [0.0; TILE_SIZE as usize];
    let mean = &mut mean[..out.len()];
    means(tile, channel, start, mean);
    tile.plane(SQUARE + channel).numbers(start, out);
    for (out, mean) in out.iter_mut().zip(mean) {
        let squares = *out / (1u128 << SQUARE_BITS) as f64 / n;
        *out = (squares - *mean * *mean).max(0.0) / (n - 1.0).max(1.0);
    }
}
