//! When to try again.

use crate::ClientError;
use rand::Rng;
use std::time::Duration;

/// How often and how patiently a call is repeated. Only errors that [`ClientError::retryable`] says
/// may pass are repeated at all.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RetryPolicy {
    /// Calls in all; `None`: for ever.
    pub attempts: Option<u32>,
    /// Upper bound of the first pause; each later one doubles.
    pub first: Duration,
    /// Upper bound of every pause.
    pub longest: Duration,
}

impl RetryPolicy {
    /// One call.
    pub const NEVER: RetryPolicy = RetryPolicy {
        attempts: Some(1),
        first: Duration::ZERO,
        longest: Duration::ZERO,
    };
    /// For people who wait at a terminal: gives up after some five seconds.
    pub const PATIENT: RetryPolicy = RetryPolicy {
        attempts: Some(6),
        first: Duration::from_millis(200),
        longest: Duration::from_secs(3),
    };
    /// For workers.
    pub const FOREVER: RetryPolicy = RetryPolicy {
        attempts: None,
        first: Duration::from_millis(100),
        longest: Duration::from_secs(5),
    };

    /// How long to pause after failure number `failures` (from 1), or `None` to give up.
    pub fn pause(&self, failures: u32, error: &ClientError) -> Option<Duration> {
        if !error.retryable() || self.attempts.is_some_and(|n| failures >= n) {
            return None;
        }
        Some(self.backoff(failures, error.retry_after()))
    }

    /// The pause alone: between half and all of the exponential bound at random, so that a farm does
    /// not come back in one wave; never less than the coordinator `asked` for.
    pub fn backoff(&self, failures: u32, asked: Option<Duration>) -> Duration {
        let bound = self
            .first
            .saturating_mul(1 << failures.saturating_sub(1).min(16))
            .min(self.longest);
        let pause = bound.mul_f64(rand::rng().random_range(0.5..=1.0));
        // A limit on what is asked for: a wrong header must not stop a worker for a day.
        pause.max(asked.unwrap_or_default().min(Duration::from_secs(60)))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn busy(status: u16, retry_after: Option<u64>) -> ClientError {
        ClientError::Status {
            url: String::new(),
            status,
            body: String::new(),
            retry_after: retry_after.map(Duration::from_secs),
        }
    }

    #[test]
    fn pauses_grow_are_bounded_and_honour_the_server() {
        let policy = RetryPolicy::FOREVER;
        for failures in [1, 2, 5, 40, u32::MAX] {
            let pause = policy.pause(failures, &busy(503, None)).unwrap();
            assert!(pause >= Duration::from_millis(50) && pause <= policy.longest);
        }
        assert!(policy.pause(1, &busy(429, Some(7))).unwrap() >= Duration::from_secs(7));
        assert_eq!(
            policy.pause(1, &busy(429, Some(86_400))).unwrap(),
            Duration::from_secs(60)
        );
        assert_eq!(policy.pause(1, &busy(404, None)), None);
        assert_eq!(RetryPolicy::PATIENT.pause(6, &busy(503, None)), None);
        assert_eq!(RetryPolicy::NEVER.pause(1, &busy(503, None)), None);
    }
}
