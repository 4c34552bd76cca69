//! How many paths the samples of each part of a picture are split into at their first vertex.
//!
//! All paths that begin at one vertex share the camera ray: where most of the noise comes from what
//! happens behind the vertex, several are worth more than several samples; where it comes from lens,
//! motion or edges, they are not. Which it is, a few samples tell ([`pilot`]): the variance and the
//! rays that an estimate with each number of paths has. The numbers chosen minimise the product of both
//! over the whole picture, which is what efficiency-aware splitting strives for [Rath22], here at the
//! first vertex only and once and for all: a function of the scene and the frame, so that the bits stay
//! the same wherever a sample is rendered.
//!
//! [`pilot`]: crate::integrator::stream

use crate::hash;
use crate::integrator::stream::{PILOT_PIXELS, Pilot};
use crate::scene::Scene;
use crate::{PrepareError, StopFlag};
use ::scene::model::Integrator;
use rayon::prelude::*;

/// Most paths that a sample is split into.
pub(crate) const SPLIT_MAX: u32 = 4;

/// Numbers of paths to choose from.
const CHOICES: [u32; 3] = [1, 2, SPLIT_MAX];

/// Side of the smallest parts, and how many there may be in a row.
const SIDE_MIN: u32 = 32;
const PARTS_IN_A_ROW: u32 = 32;

/// Seed of the pilot's samples: those of the picture must not depend on them, nor they on its seed, so that
/// pictures with different seeds are split alike.
const PILOT: u64 = 0xb65f_70a1_7e3c_5d00;

/// A rectangle of the whole picture whose samples are split alike.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Part {
    /// First pixel.
    pub begin: [u32; 2],
    /// The pixel after the last, in both directions.
    pub end: [u32; 2],
    /// Into how many paths.
    pub split: u32,
}

/// The number of paths for each part.
#[derive(Clone, Debug, Default)]
pub(crate) struct Splits {
    side: u32,
    columns: u32,
    /// Row by row; none: samples are not split at all.
    of: Vec<u8>,
}

impl Splits {
    /// The same number everywhere.
    pub(crate) fn all(split: u32) -> Splits {
        Splits {
            side: u32::MAX,
            columns: 1,
            of: vec![split as u8],
        }
    }

    /// The parts of a rectangle of the whole picture.
    pub(crate) fn parts(&self, begin: [u32; 2], end: [u32; 2]) -> Vec<Part> {
        if self.of.is_empty() {
            return vec![Part {
                begin,
                end,
                split: 1,
            }];
        }
        let first = begin.map(|x| x / self.side);
        let last = end.map(|x| (x - 1) / self.side);
        let mut parts = Vec::new();
        for y in first[1]..=last[1] {
            for x in first[0]..=last[0] {
                parts.push(Part {
                    begin: [(x * self.side).max(begin[0]), (y * self.side).max(begin[1])],
                    end: [
                        (x + 1).saturating_mul(self.side).min(end[0]),
                        (y + 1).saturating_mul(self.side).min(end[1]),
                    ],
                    split: u32::from(self.of[(y * self.columns + x) as usize]),
                });
            }
        }
        parts
    }

    /// Tries and chooses for a scene.
    pub(crate) fn choose(scene: &Scene, stop: &StopFlag) -> Result<Splits, PrepareError> {
        let Integrator::Path { max_depth } = scene.integrator else {
            return Ok(Splits::default());
        };
        // A bound on what a path carries would bound less of the parts of a path.
        if scene.is_foggy || max_depth == 0 || scene.clamp_indirect < f32::INFINITY {
            return Ok(Splits::default());
        }
        let size = scene.full_size;
        let mut side = SIDE_MIN;
        while size[0].max(size[1]).div_ceil(side) > PARTS_IN_A_ROW {
            side *= 2;
        }
        let [columns, rows] = size.map(|s| s.div_ceil(side));
        let trials: Vec<Option<Trial>> = (0..columns * rows)
            .into_par_iter()
            .map_init(
                || Pilot::new(scene),
                |pilot, at| {
                    let begin = [at % columns * side, at / columns * side];
                    let end = [0, 1].map(|i| (begin[i] + side).min(size[i]));
                    Trial::of(pilot, max_depth, begin, end, stop)
                },
            )
            .collect();
        let trials: Option<Vec<_>> = trials.into_iter().collect();
        let trials = trials.ok_or(PrepareError::Stopped)?;
        let trials = smoothed(&trials, columns as usize);
        let of = best(&trials).iter().map(|c| CHOICES[*c] as u8).collect();
        Ok(Splits { side, columns, of })
    }
}

/// What a part's samples have and cost with few and with many paths.
#[derive(Clone, Copy, Debug, Default)]
struct Trial {
    /// Variance over squared mean, with one path and with [`SPLIT_MAX`].
    variance: [f64; 2],
    /// Rays a sample.
    rays: [f64; 2],
}

impl Trial {
    fn of(
        pilot: &mut Pilot,
        max_depth: u32,
        begin: [u32; 2],
        end: [u32; 2],
        stop: &StopFlag,
    ) -> Option<Trial> {
        // One pixel in each cell of a grid.
        const GRID: u32 = 4;
        const { assert!(PILOT_PIXELS == (GRID * GRID) as usize) };
        let mut pixels = [[0; 2]; PILOT_PIXELS];
        for (i, pixel) in pixels.iter_mut().enumerate() {
            let cell = [i as u32 % GRID, i as u32 / GRID];
            let place = u64::from(begin[0]) << 32 | u64::from(begin[1]);
            let bits = hash::mix(hash::mix(place ^ PILOT) ^ i as u64);
            for axis in 0..2 {
                let within = hash::to_unit(bits << (24 * axis));
                let width = (end[axis] - begin[axis]) as f32;
                let at = ((cell[axis] as f32 + within) / GRID as f32 * width) as u32;
                pixel[axis] = (begin[axis] + at).min(end[axis] - 1);
            }
        }
        let mut trial = Trial::default();
        for (i, split) in [1, SPLIT_MAX].into_iter().enumerate() {
            let mut means = [[0.0; PILOT_PIXELS]; 2];
            for (turn, means) in means.iter_mut().enumerate() {
                let seed = PILOT ^ turn as u64;
                let (found, rays) = pilot.render(max_depth, split, seed, &pixels, stop)?;
                *means = found;
                trial.rays[i] += rays;
            }
            for (a, b) in means[0].iter().zip(means[1]) {
                let (mean, half) = (0.5 * (a + b), 0.5 * (a - b));
                let variance = half * half / (mean * mean + 0.01);
                if variance.is_finite() {
                    trial.variance[i] += variance;
                }
            }
        }
        Some(trial)
    }

    fn add(&mut self, other: &Trial, weight: f64) {
        for i in 0..2 {
            self.variance[i] += weight * other.variance[i];
            self.rays[i] += weight * other.rays[i];
        }
    }

    /// Variance and rays with each of [`CHOICES`]: a part of the variance falls with the number of paths.
    fn of_choices(&self) -> [(f64, f64); CHOICES.len()] {
        let most = f64::from(SPLIT_MAX);
        let [one, many] = self.variance;
        let falls = ((one - many) * most / (most - 1.0)).clamp(0.0, one);
        let more = (self.rays[1] - self.rays[0]) / (most - 1.0);
        CHOICES.map(|n| {
            let n = f64::from(n);
            (one - falls + falls / n, self.rays[0] + more * (n - 1.0))
        })
    }
}

/// Every trial with its neighbours: a few pixels alone tell little.
fn smoothed(trials: &[Trial], columns: usize) -> Vec<Trial> {
    let rows = trials.len() / columns;
    let around = |i: usize, n: usize| i.saturating_sub(1)..(i + 2).min(n);
    let mut all = Vec::with_capacity(trials.len());
    for y in 0..rows {
        for x in 0..columns {
            let mut sum = Trial::default();
            for v in around(y, rows) {
                for u in around(x, columns) {
                    let weight = (2 - u.abs_diff(x)) * (2 - v.abs_diff(y));
                    sum.add(&trials[v * columns + u], weight as f64);
                }
            }
            all.push(sum);
        }
    }
    all
}

/// The choices that make the sum of variances times the sum of rays least: with each of them every part
/// minimises its own variance plus its rays times what a ray is worth, so only that worth is looked for.
fn best(trials: &[Trial]) -> Vec<usize> {
    let all: Vec<_> = trials.iter().map(Trial::of_choices).collect();
    let total = |chosen: &[usize]| {
        let (mut variance, mut rays) = (0.0, 0.0);
        for (of, c) in all.iter().zip(chosen) {
            variance += of[*c].0;
            rays += of[*c].1;
        }
        (variance, rays)
    };
    let mut best = vec![0; all.len()];
    let (variance, rays) = total(&best);
    let mut least = variance * rays;
    // From where everything is worth splitting to where nothing is.
    let mut worth = variance / rays.max(1.0) / 64.0;
    for _ in 0..48 {
        let price = |of: &[(f64, f64)], c: usize| of[c].0 + worth * of[c].1;
        let chosen: Vec<usize> = (all.iter())
            .map(|of| {
                let mut least = 0;
                for c in 1..of.len() {
                    if price(of, c) < price(of, least) {
                        least = c;
                    }
                }
                least
            })
            .collect();
        let (variance, rays) = total(&chosen);
        if variance * rays < least {
            least = variance * rays;
            best = chosen;
        }
        worth *= 1.25;
    }
    best
}

#[cfg(test)]
mod tests;
