//! How much noise is left: sqrt(mean over pixels of variance_of_the_mean / (mean^2 + 0.01)), on
//! luminance.
//!
//! Two estimators of the variance of a pixel's mean:
//!
//! - **halves** (an *estimate*): the samples are two halves by a bit of their index, each a
//!   well-distributed point set of its own. With `na`, `nb` samples and means A, B,
//!   `(A - B)^2 na nb / n^2` has the variance of the mean as its expectation if the halves are
//!   independent: Var(A - B) = s^2 (1/na + 1/nb) and s^2/n = Var(A - B) na nb / n^2. One degree of
//!   freedom a pixel, which the 4,096 pixels of a tile make good.
//! - **squares** (a *bound*): the spread of single samples over n. Quasi-random points do better
//!   than that. Only squares by channel are kept; the standard deviation of a weighted sum is at
//!   most the weighted sum of the standard deviations (equal if the channels vary together, as
//!   they nearly do under white light).
//!
//! The estimate divides by the product of the two means, whose expectation is the square of the
//! mean: where rare bright samples carry a pixel, its own measured mean rises with the very samples
//! that are the noise, and would hide them. (A product below zero counts as zero.)
//!
//! All of it is addition, multiplication, division and square root of f64 in a fixed order, so that
//! decisions made from it are the same on every machine.

use crate::blocks::BLOCK;
use crate::buffer::{in_second_half, luminance_fixed};
use crate::film::Film;
use crate::fixed::{SQUARE_BITS, VALUE_BITS};
use crate::plane::number;
use crate::planes::{BEAUTY, HALF, SQUARE};
use crate::tile::TileFilm;
use crate::unit::SampleRange;
use serde::{Deserialize, Serialize};

/// Keeps black pixels from counting without bound.
pub const ERROR_EPS: f64 = 0.01;

/// Rec. 709 luminance weights, those of [`luminance_fixed`].
pub const LUMINANCE: [f64; 3] = [13_933.0 / 65_536.0, 46_871.0 / 65_536.0, 4_732.0 / 65_536.0];

/// What an error number claims.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum ErrorKind {
    /// An estimate, right on average.
    Estimate,
    /// An upper bound.
    Bound,
}

impl ErrorKind {
    /// `estimate` or `bound`.
    pub fn name(self) -> &'static str {
        match self {
            ErrorKind::Estimate => "estimate",
            ErrorKind::Bound => "bound",
        }
    }
}

impl std::fmt::Display for ErrorKind {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(self.name())
    }
}

/// Which estimator stands behind published errors and noise targets.
pub const ERROR_KIND: ErrorKind = ErrorKind::Estimate;

/// Error of a tile by both estimators.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TileErrors {
    /// From the two halves.
    pub halves: f64,
    /// From the squares of single samples.
    pub squares: f64,
}

impl TileErrors {
    /// The one of a kind.
    pub fn of(self, kind: ErrorKind) -> f64 {
        match kind {
            ErrorKind::Estimate => self.halves,
            ErrorKind::Bound => self.squares,
        }
    }
}

/// How many indices of a range are in the second half.
pub fn second_half_of(range: SampleRange) -> u32 {
    // Of every pair (2k, 2k + 1) exactly one is.
    let below = |end: u32| end / 2 + (end % 2 == 1 && in_second_half(end - 1)) as u32;
    below(range.end) - below(range.begin)
}

/// Both errors of a tile; None before each half has a sample.
pub fn tile_errors(tile: &TileFilm) -> Option<TileErrors> {
    errors_of::<true>(tile)
}

/// The error of a tile that is published and decides, [`ERROR_KIND`]; None before each half has a
/// sample.
pub fn tile_error(tile: &TileFilm) -> Option<f64> {
    // The estimate does not look at the squares, which take most of the time.
    let errors = match ERROR_KIND {
        ErrorKind::Estimate => errors_of::<false>(tile),
        ErrorKind::Bound => errors_of::<true>(tile),
    };
    errors.map(|errors| errors.of(ERROR_KIND))
}

/// Both errors, or the one from the halves and a zero.
fn errors_of<const SQUARES: bool>(tile: &TileFilm) -> Option<TileErrors> {
    let second: u32 = tile.ranges().into_iter().map(second_half_of).sum();
    let first = tile.samples() - second;
    if first == 0 || second == 0 {
        return None;
    }
    let (n, na, nb) = (tile.samples() as f64, first as f64, second as f64);
    let value = 1.0 / (1u64 << VALUE_BITS) as f64;
    let square = 1.0 / (1u128 << SQUARE_BITS) as f64;
    let half_weight = na * nb / (n * n);
    let (mut halves, mut squares) = (0.0, 0.0);
    let pixels = tile.tile().pixels();
    let (mut rgb, mut second) = ([[0; BLOCK]; 3], [0; BLOCK]);
    let mut mean_squares = [[0.0; BLOCK]; 3];
    for start in (0..pixels).step_by(BLOCK) {
        let count = BLOCK.min(pixels - start);
        for c in 0..3 {
            tile.plane(BEAUTY + c).values(start, &mut rgb[c][..count]);
            if SQUARES {
                tile.plane(SQUARE + c)
                    .numbers(start, &mut mean_squares[c][..count]);
            }
        }
        tile.plane(HALF).values(start, &mut second[..count]);
        for i in 0..count {
            let rgb = [rgb[0][i], rgb[1][i], rgb[2][i]];
            let (all, half) = (luminance_fixed(rgb), second[i]);
            let (a, b) = (number(all - half) * value / na, number(half) * value / nb);
            let half_product = (a * b).max(0.0) + ERROR_EPS;
            halves += (a - b) * (a - b) * half_weight / half_product;
            if !SQUARES {
                continue;
            }
            let mean = number(all) * value / n;
            let weight = 1.0 / (mean * mean + ERROR_EPS);
            let mut deviation = 0.0;
            for c in 0..3 {
                let mean = number(rgb[c]) * value / n;
                let mean_square = mean_squares[c][i] * square / n;
                deviation += LUMINANCE[c] * (mean_square - mean * mean).max(0.0).sqrt();
            }
            squares += deviation * deviation / (n - 1.0) * weight;
        }
    }
    let root = |sum: f64| (sum / pixels as f64).sqrt();
    Some(TileErrors {
        halves: root(halves),
        squares: root(squares),
    })
}

/// Error of a picture.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PictureError {
    /// The number.
    pub value: f64,
    /// What it claims.
    pub kind: ErrorKind,
}

impl PictureError {
    /// Of a film by the default estimator; None as long as a tile cannot say.
    pub fn of(film: &Film) -> Option<PictureError> {
        PictureError::by(film, ERROR_KIND)
    }

    /// Of a film by one estimator. Squared errors of tiles are means over pixels, so that they
    /// combine by number of pixels.
    pub fn by(film: &Film, kind: ErrorKind) -> Option<PictureError> {
        let (mut sum, mut pixels) = (0.0, 0.0);
        for tile in film.tiles() {
            let error = match kind {
                ERROR_KIND => tile.error()?,
                other => tile.errors()?.of(other),
            };
            let count = tile.tile().pixels() as f64;
            sum += error * error * count;
            pixels += count;
        }
        Some(PictureError {
            value: (sum / pixels).sqrt(),
            kind,
        })
    }
}
