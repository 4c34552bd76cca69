//! Large trees in parts: the items are divided from the top by binned surface area until each part is
//! small, a tree is built over each part, and a small tree joins them.
//!
//! What a builder needs beside its result is then bounded by the size of a part instead of that of the
//! scene, parts are built at the same time, and each fits into a cache. Where the items are divided
//! depends on nothing but the items, so that the number of threads changes no bit of the tree.

use super::build::{Bounds, Item};
use crate::hash;
use std::ops::Range;

/// Items that a part may have.
pub const PART_MAX: usize = 1 << 16;
/// Cells along each axis that cuts are tried between.
const BINS: usize = 16;
/// Items that a cut is chosen by: it need not be the very best.
const SAMPLES: usize = 1 << 13;
/// Below this depth items are halved, so that the whole tree stays shallow whatever the items are.
pub const FREE_DEPTH: usize = 10;

/// A binary tree over parts.
pub enum Division {
    /// Items with their common box.
    Part(Range<usize>, Bounds),
    /// Two of them.
    Pair(Box<[Division; 2]>),
}

/// Divides items into parts of at most `max`, each a run of the reordered items.
pub fn divide(items: &mut [Item], max: usize) -> Division {
    descend(items, 0, max.max(1), 0)
}

fn descend(items: &mut [Item], first: usize, max: usize, depth: usize) -> Division {
    if items.len() <= max {
        let bounds = items
            .iter()
            .fold(Bounds::default(), |b, i| b.union(i.bounds));
        return Division::Part(first..first + items.len(), bounds);
    }
    let cut = if depth < FREE_DEPTH {
        Cut::choose(items)
    } else {
        None
    };
    let middle = cut.map_or(items.len() / 2, |cut| cut.partition(items));
    let (left, right) = items.split_at_mut(middle);
    let (left, right) = rayon::join(
        || descend(left, first, max, depth + 1),
        || descend(right, first + middle, max, depth + 1),
    );
    Division::Pair(Box::new([left, right]))
}

/// A plane between the cells along an axis.
struct Cut {
    axis: usize,
    low: f32,
    scale: f32,
    at: usize,
}

impl Cut {
    /// The cheapest cut of a sample of the items, and so one with items on both sides; `None` where no
    /// cut divides them.
    fn choose(items: &[Item]) -> Option<Cut> {
        let sample = sample(items);
        let centers = Bounds::of(sample.iter().map(Bounds::center));
        let mut best: Option<(f64, Cut)> = None;
        for axis in 0..3 {
            let low = centers.min[axis];
            let size = centers.max[axis] - low;
            if size.is_nan() || size <= 0.0 {
                continue;
            }
            let scale = BINS as f32 / size;
            let mut bins = [(0u32, Bounds::default()); BINS];
            for bounds in &sample {
                let (count, all) = &mut bins[cell(bounds.center()[axis], low, scale)];
                *count += 1;
                *all = all.union(*bounds);
            }
            // What lies right of each cut.
            let mut right = bins;
            for i in (0..BINS - 1).rev() {
                let (count, bounds) = right[i + 1];
                right[i] = (right[i].0 + count, right[i].1.union(bounds));
            }
            let mut left = (0, Bounds::default());
            for at in 1..BINS {
                let (count, bounds) = bins[at - 1];
                left = (left.0 + count, left.1.union(bounds));
                if left.0 == 0 || right[at].0 == 0 {
                    continue;
                }
                let cost = |(count, bounds): (u32, Bounds)| f64::from(count) * area(&bounds);
                let cost = cost(left) + cost(right[at]);
                if best.as_ref().is_none_or(|(least, _)| cost < *least) {
                    let cut = Cut {
                        axis,
                        low,
                        scale,
                        at,
                    };
                    best = Some((cost, cut));
                }
            }
        }
        best.map(|(_, cut)| cut)
    }

    /// Reorders items so that those left of the cut come first and says how many they are.
    fn partition(&self, items: &mut [Item]) -> usize {
        let (mut left, mut right) = (0, items.len());
        while left < right {
            let center = items[left].bounds.center()[self.axis];
            if cell(center, self.low, self.scale) < self.at {
                left += 1;
            } else {
                right -= 1;
                items.swap(left, right);
            }
        }
        left
    }
}

/// Boxes of all items, or of some from everywhere among them: the places are scattered, because meshes
/// come in rows.
fn sample(items: &[Item]) -> Vec<Bounds> {
    if items.len() <= SAMPLES {
        return items.iter().map(|i| i.bounds).collect();
    }
    let step = items.len() / SAMPLES;
    (0..SAMPLES)
        .map(|i| items[i * step + hash::mix(i as u64) as usize % step].bounds)
        .collect()
}

fn cell(x: f32, low: f32, scale: f32) -> usize {
    (((x - low) * scale) as usize).min(BINS - 1)
}

fn area(b: &Bounds) -> f64 {
    let d = b.max - b.min;
    f64::from(d.x * d.y + d.y * d.z + d.z * d.x)
}
