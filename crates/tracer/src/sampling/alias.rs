//! Discrete choice in constant time [Walker77], [Vose91].

use crate::math::ONE_MINUS_EPSILON;

/// A drawn index.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct AliasSample {
    /// Which.
    pub index: u32,
    /// Its probability.
    pub pmf: f32,
    /// A fresh uniform number in [0, 1), made of what the choice left over.
    pub u: f32,
}

#[derive(Clone, Copy, Debug, PartialEq)]
struct Bin {
    /// Part of the bin that belongs to its own index.
    own: f32,
    /// Owner of the rest.
    alias: u32,
    /// Probability of the bin's own index.
    pmf: f32,
}

/// Draws an index with a probability proportional to its weight. Not monotone in the uniform
/// number: where neighbours should stay neighbours use [`super::Piecewise1d`].
#[derive(Clone, Debug, PartialEq)]
pub struct AliasTable {
    bins: Box<[Bin]>,
    sum: f64,
}

impl AliasTable {
    /// What is negative or not a number counts as zero; uniform if nothing is left. Bins are
    /// paired in the order of their indices, so equal weights give equal tables everywhere.
    pub fn new(weights: &[f32]) -> Self {
        let n = weights.len();
        let clean = |w: f32| {
            if w > 0.0 && w.is_finite() {
                f64::from(w)
            } else {
                0.0
            }
        };
        let sum: f64 = weights.iter().fold(0.0, |sum, &w| sum + clean(w));
        let share = |w: f32| {
            if sum > 0.0 {
                clean(w) / sum
            } else {
                1.0 / n as f64
            }
        };
        let mut bins: Vec<Bin> = weights
            .iter()
            .enumerate()
            .map(|(i, &w)| Bin {
                own: 1.0,
                alias: i as u32,
                pmf: share(w) as f32,
            })
            .collect();
        let mut height: Vec<f64> = weights.iter().map(|&w| share(w) * n as f64).collect();
        let mut small: Vec<usize> = (0..n).filter(|&i| height[i] < 1.0).collect();
        let mut large: Vec<usize> = (0..n).filter(|&i| height[i] >= 1.0).collect();
        // A low bin is filled up from a high one.
        while let (Some(&lo), Some(&hi)) = (small.last(), large.last()) {
            small.pop();
            bins[lo].own = height[lo] as f32;
            bins[lo].alias = hi as u32;
            height[hi] -= 1.0 - height[lo];
            if height[hi] < 1.0 {
                large.pop();
                small.push(hi);
            }
        }
        // What is left differs from 1 by rounding only, but nothing may draw a weight of zero.
        if let Some(heaviest) =
            (0..n).max_by(|&a, &b| share(weights[a]).total_cmp(&share(weights[b])))
        {
            for i in small {
                if bins[i].pmf == 0.0 {
                    bins[i].own = 0.0;
                    bins[i].alias = heaviest as u32;
                }
            }
        }
        AliasTable {
            bins: bins.into(),
            sum,
        }
    }

    /// Number of indices.
    pub fn len(&self) -> usize {
        self.bins.len()
    }

    /// Whether there is nothing to choose from.
    pub fn is_empty(&self) -> bool {
        self.bins.is_empty()
    }

    /// Sum of the weights.
    pub fn sum(&self) -> f64 {
        self.sum
    }

    /// Probability of an index.
    #[inline]
    pub fn pmf(&self, index: usize) -> f32 {
        self.bins[index].pmf
    }

    /// Index for a uniform number; the table must not be empty.
    #[inline]
    pub fn sample(&self, u: f32) -> AliasSample {
        let n = self.bins.len();
        let scaled = u * n as f32;
        let i = (scaled as usize).min(n - 1);
        let rest = (scaled - i as f32).min(ONE_MINUS_EPSILON);
        let bin = self.bins[i];
        if rest < bin.own {
            AliasSample {
                index: i as u32,
                pmf: bin.pmf,
                u: (rest / bin.own).min(ONE_MINUS_EPSILON),
            }
        } else {
            AliasSample {
                index: bin.alias,
                pmf: self.bins[bin.alias as usize].pmf,
                u: ((rest - bin.own) / (1.0 - bin.own)).min(ONE_MINUS_EPSILON),
            }
        }
    }
}
