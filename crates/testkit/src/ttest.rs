//! Student's t-test: is the mean of samples with unknown variance a known value?

use crate::{Moments, special};

/// p-value (two-sided) that the mean of what `samples` were drawn from is `expected`.
pub fn p_value(samples: &Moments, expected: f64) -> f64 {
    if samples.count() < 2 {
        return 1.0;
    }
    let difference = samples.mean() - expected;
    if samples.variance() == 0.0 {
        // No spread: equal, but for rounding, or not.
        return if difference.abs() <= 1e-6 * expected.abs().max(1e-6) {
            1.0
        } else {
            0.0
        };
    }
    special::student_two_sided(difference / samples.error(), (samples.count() - 1) as f64)
}

/// Panics, saying what it saw, if the p-value lies below `level`.
#[track_caller]
pub fn assert_mean(what: &str, samples: &Moments, expected: f64, level: f64) {
    let p = p_value(samples, expected);
    assert!(
        p >= level,
        "{what}: mean {:.6} +- {:.6} over {} samples, expected {expected:.6} (p = {p:.2e} < {level:.2e})",
        samples.mean(),
        samples.error(),
        samples.count(),
    );
}
