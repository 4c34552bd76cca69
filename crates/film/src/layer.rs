//! From sums to numbers: the mean of each layer, linear, a channel at a time.

use crate::error::{ERROR_EPS, LUMINANCE};
use crate::film::Film;
use crate::fixed::{BOUNDED_BITS, SQUARE_BITS, VALUE_BITS};
use crate::planes::{ALBEDO, ALPHA, BEAUTY, DEPTH, HITS, NORMAL, SQUARE};
use crate::tile::TileFilm;

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
    for tile in film.tiles().iter().filter(|tile| tile.samples() > 0) {
        let shape = tile.tile();
        let (x, columns) = (shape.x as usize, shape.width as usize);
        for row in 0..shape.height as usize {
            let start = (shape.y as usize + row) * width + x;
            for (column, out) in out[start..start + columns].iter_mut().enumerate() {
                *out = pixel(tile, layer, channel, row * columns + column) as f32;
            }
        }
    }
    out
}

/// One number of a pixel of a tile that has samples.
fn pixel(tile: &TileFilm, layer: Layer, channel: usize, i: usize) -> f64 {
    let n = tile.samples() as f64;
    let bounded = 1.0 / (1u64 << BOUNDED_BITS) as f64;
    match layer {
        Layer::Beauty => mean(tile, channel, i),
        Layer::Alpha => tile.plane(ALPHA).number(i) * bounded / n,
        Layer::Albedo => tile.plane(ALBEDO + channel).number(i) * bounded / n,
        Layer::Normal => tile.plane(NORMAL + channel).number(i) * bounded / n,
        Layer::Depth => {
            let hits = tile.plane(HITS).number(i);
            let sum = tile.plane(DEPTH).number(i) / (1u64 << VALUE_BITS) as f64;
            if hits > 0.0 {
                sum / hits
            } else {
                f64::INFINITY
            }
        }
        Layer::Samples => n,
        Layer::Variance => variance(tile, channel, i),
        Layer::Error if tile.samples() < 2 => f64::NAN,
        Layer::Error => {
            let (mut luminance, mut deviation) = (0.0, 0.0);
            for (c, weight) in LUMINANCE.into_iter().enumerate() {
                luminance += weight * mean(tile, c, i);
                deviation += weight * variance(tile, c, i).sqrt();
            }
            deviation / (luminance * luminance + ERROR_EPS).sqrt()
        }
    }
}

fn mean(tile: &TileFilm, channel: usize, i: usize) -> f64 {
    let sum = tile.plane(BEAUTY + channel).number(i);
    sum / (1u64 << VALUE_BITS) as f64 / tile.samples() as f64
}

/// Of the mean; zero for a single sample, which says nothing about it.
fn variance(tile: &TileFilm, channel: usize, i: usize) -> f64 {
    let n = tile.samples() as f64;
    let squares = tile.plane(SQUARE + channel).number(i) / (1u128 << SQUARE_BITS) as f64 / n;
    let mean = mean(tile, channel, i);
    (squares - mean * mean).max(0.0) / (n - 1.0).max(1.0)
}
