//! z-test: is a mean with known variance a known value? For pictures: pixel by pixel against a reference
//! of means and variances.

use crate::{sidak, special};

/// p-value (two-sided) for a difference with this standard deviation.
pub fn p_value(difference: f64, sigma: f64) -> f64 {
    if sigma > 0.0 {
        special::normal_two_sided(difference / sigma)
    } else if difference == 0.0 {
        1.0
    } else {
        0.0
    }
}

/// A number whose mean and variance of the mean are known.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Known {
    /// Mean.
    pub mean: f64,
    /// Variance of that mean.
    pub variance: f64,
}

/// Where two sets of means disagree most.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Worst {
    /// Index of the pair.
    pub index: usize,
    /// Its p-value.
    pub p: f64,
    /// Level that it had to reach.
    pub level: f64,
}

/// Compares pairs of means, `level` for all together; `Err` if one of them disagrees.
pub fn compare(a: &[Known], b: &[Known], level: f64) -> Result<Worst, Worst> {
    assert_eq!(a.len(), b.len(), "two sets of different size");
    let mut worst = Worst {
        index: 0,
        p: 1.0,
        level: sidak(level, a.len()),
    };
    for (index, (x, y)) in a.iter().zip(b).enumerate() {
        let p = p_value(x.mean - y.mean, (x.variance + y.variance).sqrt());
        if p < worst.p || p.is_nan() {
            worst = Worst { index, p, ..worst };
        }
    }
    if worst.p >= worst.level {
        Ok(worst)
    } else {
        Err(worst)
    }
}
