//! Training of a guide: passes of paths, each with twice as many as the one before and guided by what that
//! one has found [Mueller17].
//!
//! A single path says little about the light that arrives at its vertices: mostly that there is none. So what
//! leaves surfaces is averaged over spots first, and the light that arrives from a direction is what
//! the spot there sends on average, as learning from the value of the next state does
//! [Dahm17]. An average over directions and a small neighbourhood will do, since a guide only says where to look.

use super::cells::{Cells, Order, Visit};
use super::directions::{Estimate, Quads, to_square};
use super::{Guide, WAYS};
use crate::hash;
use crate::integrator::stream::Trainer;
use crate::scene::Scene;
use crate::{PrepareError, StopFlag};
use glam::Vec3;
use rayon::prelude::*;
use std::ops::Range;
use std::sync::Arc;

/// Passes of training.
const PASSES: u32 = 4;
/// Paths of the last pass at most,
const PATHS_MAX: u64 = 1 << 20;
/// and for each pixel, if the picture is small.
const PATHS_OF_PIXEL: u64 = 64;
/// Estimates that a density is made from at least.
const ESTIMATES_MIN: usize = 64;
/// Steps of a pass, about: it ends early where paths are long, so that memory stays within bounds.
const STEPS_MAX: usize = 8_000_000;
/// Lots of paths that are followed before the steps are counted.
const LOTS_AT_ONCE: u32 = 64;
/// The golden section of 2^32: its multiples lie evenly.
const GOLDEN: u32 = 0x9E37_79B9;
/// How often light is handed on from spot to spot.
const BOUNCES: u32 = 12;

/// Seed of the training's samples: those of the picture must not depend on them, nor they on its seed.
pub(crate) const TRAINING: u64 = 0x5c1e_90d4_a6b3_2700;

/// What one path found out at a surface. Light is luminance.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Step {
    /// Where.
    pub p: Vec3,
    /// Which way the surface faces.
    pub way: u32,
    /// What the surface sends along the path, but for what arrives from where the path goes on to.
    pub direct: f32,
    /// How much it sends of what arrives from there; 0 if the path ends.
    pub share: f32,
    /// The direction in which the path goes on,
    pub w: Vec3,
    /// its cosine to the normal,
    pub cos: f32,
    /// and the density that it was drawn with, roulette included.
    pub drawn: f32,
    /// Light that what is met there gives off, weighted against light sampling.
    pub emitted: f32,
    /// All the light that the path has found there, if it does not say where `to`.
    pub arrived: f32,
    /// Which step of the same lot is made there; [`Step::NOWHERE`] if none is.
    pub to: u32,
}

impl Step {
    /// See [`Step::to`].
    pub(crate) const NOWHERE: u32 = u32::MAX;
}

impl Guide {
    /// Trains a guide for a scene whose paths have so many scattering events at most.
    pub(crate) fn train(
        scene: &mut Scene,
        max_depth: u32,
        stop: &StopFlag,
    ) -> Result<(), PrepareError> {
        scene.guide = Some(Arc::new(Guide::new()));
        for pass in 0..PASSES {
            let steps = walk(scene, max_depth, pass, stop)?;
            let mut guide = Guide::of(&steps);
            guide.learns = pass + 1 < PASSES;
            scene.guide = Some(Arc::new(guide));
        }
        Ok(())
    }

    /// From what paths have found out.
    fn of(steps: &[Step]) -> Guide {
        let places: Vec<Vec3> = steps.iter().map(|step| step.p).collect();
        let (cells, order) = Cells::new(&places);
        let spots = Spots::new(steps, &order);
        let sent = spots.sent();
        let of_cell = |range: &Range<usize>| {
            let mut estimates = [const { Vec::new() }; WAYS as usize];
            // Those that ended count, too: the others make up for them.
            let mut counts = [0; WAYS as usize];
            for visit in &order.visits[range.clone()] {
                let step = &steps[visit.index as usize];
                counts[step.way as usize] += 1;
                if step.share > 0.0 {
                    let radiance = match step.to {
                        Step::NOWHERE => step.arrived,
                        to => step.emitted + sent[spots.of_step[to as usize] as usize],
                    };
                    let light = radiance * step.cos / step.drawn;
                    estimates[step.way as usize].push(Estimate {
                        at: to_square(step.w).0,
                        light,
                        square: light * (radiance * step.cos),
                    });
                }
            }
            let mut known = [const { None }; WAYS as usize];
            for (known, (mut of_way, count)) in
                known.iter_mut().zip(estimates.into_iter().zip(counts))
            {
                let mut quads = Quads::new();
                if of_way.len() >= ESTIMATES_MIN && quads.add(&mut of_way, count) != 0 {
                    *known = Some(quads);
                }
            }
            known
        };
        let all: Vec<_> = order.cells.par_iter().map(of_cell).collect();
        let mut quads = Quads::new();
        let roots = (all.iter().flatten())
            .map(|of_way| of_way.as_ref().map_or(0, |of_way| quads.append(of_way)))
            .collect();
        Guide {
            cells,
            roots,
            quads,
            sent,
            learns: false,
        }
    }
}

/// Steps by spots and ways, in the order of spots.
struct Spots<'a> {
    order: &'a Order,
    /// By step: spot times [`WAYS`] plus way.
    of_step: Vec<u32>,
    /// What steps say about what is sent.
    sendings: Vec<Sending>,
}

/// What a surface sends along a path: a certain light, and a share of what is sent elsewhere.
#[derive(Clone, Copy)]
struct Sending {
    way: u32,
    light: f32,
    share: f32,
    /// Spot and way of the latter, if the share is not zero.
    to: u32,
}

impl Spots<'_> {
    fn new<'a>(steps: &[Step], order: &'a Order) -> Spots<'a> {
        let mut of_step = vec![0; steps.len()];
        for (spot, range) in order.spots.iter().enumerate() {
            for visit in &order.visits[range.clone()] {
                let step = visit.index as usize;
                of_step[step] = WAYS * spot as u32 + steps[step].way;
            }
        }
        let sending = |visit: &Visit| {
            let step = &steps[visit.index as usize];
            let (light, share, to) = match step.to {
                Step::NOWHERE => (step.direct + step.share * step.arrived, 0.0, 0),
                to => (
                    step.direct + step.share * step.emitted,
                    step.share,
                    of_step[to as usize],
                ),
            };
            Sending {
                way: step.way,
                light,
                share,
                to,
            }
        };
        let sendings = order.visits.par_iter().map(sending).collect();
        Spots {
            order,
            of_step,
            sendings,
        }
    }

    /// What is sent on average, for each way in each spot: light is handed on from spot to spot.
    fn sent(&self) -> Vec<f32> {
        let spots = &self.order.spots;
        let mut sent = vec![0.0f32; WAYS as usize * spots.len()];
        for _ in 0..BOUNCES {
            let next: Vec<[f32; WAYS as usize]> = (spots.par_iter())
                .with_min_len(64)
                .map(|range| {
                    let (mut sums, mut counts) = ([0.0f64; WAYS as usize], [0u32; WAYS as usize]);
                    for s in &self.sendings[range.clone()] {
                        let handed_on = s.share * sent[s.to as usize];
                        sums[s.way as usize] += f64::from(s.light) + f64::from(handed_on);
                        counts[s.way as usize] += 1;
                    }
                    let mut means = [0.0; WAYS as usize];
                    for (mean, (sum, count)) in means.iter_mut().zip(sums.iter().zip(counts)) {
                        *mean = (sum / f64::from(count.max(1))) as f32;
                    }
                    means
                })
                .collect();
            sent.clear();
            sent.extend(next.iter().flatten());
        }
        sent
    }
}

/// Follows the paths of a pass.
fn walk(
    scene: &Scene,
    max_depth: u32,
    pass: u32,
    stop: &StopFlag,
) -> Result<Vec<Step>, PrepareError> {
    let size = scene.full_size;
    let pixels = u64::from(size[0]) * u64::from(size[1]);
    let paths = PATHS_MAX.min(pixels * PATHS_OF_PIXEL) >> (PASSES - 1 - pass);
    let lots = paths.div_ceil(Trainer::PATHS as u64).max(1) as u32;
    let seed = hash::mix(TRAINING ^ u64::from(pass));
    // However many there are, they lie all over the picture.
    let visit = |n: u32| {
        let across = n.reverse_bits() as f32 * (1.0 / 4_294_967_296.0);
        let down = n.wrapping_mul(GOLDEN) as f32 * (1.0 / 4_294_967_296.0);
        let at = [across, down];
        let pixel = [0, 1].map(|i| ((at[i] * size[i] as f32) as u32).min(size[i] - 1));
        (pixel, hash::mix(seed ^ u64::from(n)))
    };
    let walk_lot = |trainer: &mut Trainer, lot: u32| {
        let mut of_lot = [([0; 2], 0); Trainer::PIXELS];
        for (i, of) in of_lot.iter_mut().enumerate() {
            *of = visit(lot * Trainer::PIXELS as u32 + i as u32);
        }
        trainer.walk(max_depth, &of_lot, stop)
    };
    let mut steps: Vec<Step> = Vec::new();
    let mut next = 0;
    while next < lots && steps.len() < STEPS_MAX {
        let end = lots.min(next + LOTS_AT_ONCE);
        let found: Option<Vec<Vec<Step>>> = (next..end)
            .into_par_iter()
            .map_init(|| Trainer::new(scene), walk_lot)
            .collect();
        for lot in found.ok_or(PrepareError::Stopped)? {
            let before = steps.len() as u32;
            steps.extend(lot.into_iter().map(|mut step| {
                if step.to != Step::NOWHERE {
                    step.to += before;
                }
                step
            }));
        }
        next = end;
    }
    Ok(steps)
}
