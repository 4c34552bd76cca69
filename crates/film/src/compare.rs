//! How far a picture is from another.

use crate::flip;
use crate::output::OutputError;
use crate::output::color::false_color;
use crate::output::png::{Bytes8, encode_png};
use crate::output::read::Picture;

/// Keeps black pixels from counting without bound.
pub const RELMSE_EPS: f64 = 0.01;

/// Pictures of different size.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[error("sizes differ: {}x{} and {}x{}", .a.0, .a.1, .b.0, .b.1)]
pub struct SizesDiffer {
    /// Of the picture.
    pub a: (usize, usize),
    /// Of the reference.
    pub b: (usize, usize),
}

/// Differences between a picture and a reference.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Comparison {
    /// Mean over pixels and channels of (a - b)^2.
    pub mse: f64,
    /// Mean over pixels and channels of (a - b)^2 / (b^2 + 0.01).
    pub relmse: f64,
    /// Mean of the FLIP map (see `flip`), 0 to 1, of both clipped to 0 to 1.
    pub flip: f64,
    /// Mean by channel.
    pub mean_a: [f64; 3],
    /// Mean by channel of the reference.
    pub mean_b: [f64; 3],
    /// Pixels of either picture that are not finite; they count as black.
    pub not_finite: usize,
}

impl Comparison {
    /// Mean over channels of the picture and the reference.
    pub fn means(&self) -> (f64, f64) {
        let mean = |rgb: [f64; 3]| rgb.iter().sum::<f64>() / 3.0;
        (mean(self.mean_a), mean(self.mean_b))
    }

    /// Mean of the picture over that of the reference by channel; None where that is black.
    pub fn ratios(&self) -> [Option<f64>; 3] {
        [0, 1, 2].map(|c| (self.mean_b[c] != 0.0).then(|| self.mean_a[c] / self.mean_b[c]))
    }
}

/// Compares a picture with a reference.
pub fn compare(a: &Picture, b: &Picture) -> Result<Comparison, SizesDiffer> {
    check_sizes(a, b)?;
    let (mut mse, mut relmse) = (0.0, 0.0);
    let (mut mean_a, mut mean_b) = ([0.0; 3], [0.0; 3]);
    let mut not_finite = 0;
    for (a, b) in a.rgb.iter().zip(&b.rgb) {
        not_finite += a.iter().chain(b).any(|x| !x.is_finite()) as usize;
        for c in 0..3 {
            let (a, b) = (finite(a[c]) as f64, finite(b[c]) as f64);
            let square = (a - b) * (a - b);
            mse += square;
            relmse += square / (b * b + RELMSE_EPS);
            mean_a[c] += a;
            mean_b[c] += b;
        }
    }
    let pixels = a.rgb.len().max(1) as f64;
    let map = flip_map(a, b)?;
    Ok(Comparison {
        mse: mse / (3.0 * pixels),
        relmse: relmse / (3.0 * pixels),
        flip: map.iter().map(|&x| x as f64).sum::<f64>() / pixels,
        mean_a: mean_a.map(|sum| sum / pixels),
        mean_b: mean_b.map(|sum| sum / pixels),
        not_finite,
    })
}

fn check_sizes(a: &Picture, b: &Picture) -> Result<(), SizesDiffer> {
    let (a, b) = ((a.width, a.height), (b.width, b.height));
    if a == b {
        Ok(())
    } else {
        Err(SizesDiffer { a, b })
    }
}

fn finite(x: f32) -> f32 {
    if x.is_finite() { x } else { 0.0 }
}

/// FLIP error of each pixel, 0 to 1.
pub fn flip_map(a: &Picture, b: &Picture) -> Result<Vec<f32>, SizesDiffer> {
    check_sizes(a, b)?;
    let clip = |p: &Picture| -> Vec<[f32; 3]> {
        p.rgb
            .iter()
            .map(|rgb| rgb.map(|x| finite(x).clamp(0.0, 1.0)))
            .collect()
    };
    Ok(flip::flip(
        &clip(b),
        &clip(a),
        a.width,
        a.height,
        flip::PIXELS_PER_DEGREE,
    ))
}

/// What a difference picture shows, from dark violet (none) to yellow.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Difference {
    /// FLIP, 0 to 1.
    Flip,
    /// sqrt(mean over channels of (a - b)^2 / (b^2 + 0.01)), three decades up to 1.
    Relative,
}

/// A difference picture in false colour, as PNG.
pub fn difference_png(
    a: &Picture,
    b: &Picture,
    what: Difference,
) -> Result<Result<Vec<u8>, OutputError>, SizesDiffer> {
    check_sizes(a, b)?;
    let shades: Vec<f32> = match what {
        Difference::Flip => flip_map(a, b)?,
        Difference::Relative => a
            .rgb
            .iter()
            .zip(&b.rgb)
            .map(|(a, b)| {
                let mut sum = 0.0;
                for c in 0..3 {
                    let (a, b) = (finite(a[c]) as f64, finite(b[c]) as f64);
                    sum += (a - b) * (a - b) / (b * b + RELMSE_EPS);
                }
                let root = (sum / 3.0).sqrt().max(1e-9);
                1.0 + libm::log10f(root as f32) / 3.0
            })
            .collect(),
    };
    let data = shades.into_iter().flat_map(false_color).collect();
    let (width, height) = (a.width as u32, a.height as u32);
    Ok(encode_png(
        &Bytes8 {
            width,
            height,
            channels: 3,
            data,
        },
        &[],
    ))
}
