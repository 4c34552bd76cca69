//! Reports of the pool on their way to the async side. Where units are short, results are handed over
//! several at a time: each hand-over takes a core from rendering and finds its code and data gone from the
//! caches, which cost as much again as the work itself.

use crate::pool::PoolEvent;
use std::time::{Duration, Instant};

/// How long a result may wait for others. Units that take longer are handed over at once.
const HOLD: Duration = Duration::from_millis(100);
/// Results that are handed over together at most.
const RESULTS_MAX: usize = 16;
/// Bytes of results that wait at most.
const BYTES_MAX: usize = 4 << 20;

/// What has been reported and not read.
#[derive(Debug, Default)]
pub struct Gathered {
    events: Vec<PoolEvent>,
    /// Of results.
    bytes: usize,
    /// When the oldest came.
    since: Option<Instant>,
    /// Not to wait.
    urgent: bool,
}

impl Gathered {
    /// Adds a report; true if the reader has to be told. A pool that runs dry makes everything urgent:
    /// what comes next may hang on it, and the end of a job does.
    pub fn add(&mut self, event: PoolEvent, now: Instant, runs_dry: bool) -> bool {
        let was_quiet = self.since.is_none();
        self.since.get_or_insert(now);
        let was_urgent = self.urgent;
        self.urgent |= runs_dry
            || match &event {
                PoolEvent::Finished(finished) => {
                    self.bytes += finished.bytes.len();
                    finished.wall_seconds >= HOLD.as_secs_f64()
                }
                PoolEvent::Stopped(_) | PoolEvent::Failed { .. } => true,
            };
        self.events.push(event);
        self.urgent |= self.events.len() >= RESULTS_MAX || self.bytes >= BYTES_MAX;
        was_quiet || (self.urgent && !was_urgent)
    }

    /// Everything, if it is due by `now`; else when it will be, if there is anything.
    pub fn take(&mut self, now: Instant) -> Result<Vec<PoolEvent>, Option<Instant>> {
        let due = self.since.map(|since| since + HOLD);
        if !self.urgent && due.is_none_or(|due| now < due) {
            return Err(due);
        }
        Ok(std::mem::take(self).events)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::pool::Finished;
    use bytes::Bytes;
    use film::{SampleRange, Unit};
    use protocol::LeaseRef;
    use uuid::Uuid;

    fn lease() -> LeaseRef {
        LeaseRef {
            job: Uuid::nil(),
            unit: Unit {
                frame: 0,
                tile: 0,
                samples: SampleRange { begin: 0, end: 1 },
            },
            attempt: 1,
        }
    }

    fn result(wall_seconds: f64, bytes: usize) -> PoolEvent {
        PoolEvent::Finished(Finished {
            lease: lease(),
            bytes: Bytes::from(vec![0; bytes]),
            blake3: String::new(),
            samples: 1,
            wall_seconds,
            cpu_seconds: wall_seconds,
        })
    }

    #[test]
    fn short_units_wait_for_each_other_but_not_for_long() {
        let (mut gathered, begin) = (Gathered::default(), Instant::now());
        assert_eq!(gathered.take(begin).err(), Some(None), "there is nothing");
        assert!(
            gathered.add(result(0.01, 9), begin, false),
            "sets the clock"
        );
        let later = begin + HOLD / 2;
        assert!(!gathered.add(result(0.01, 9), later, false));
        assert_eq!(gathered.take(later).err(), Some(Some(begin + HOLD)));
        assert_eq!(gathered.take(begin + HOLD).unwrap().len(), 2);
        assert_eq!(gathered.take(begin + HOLD).err(), Some(None));
    }

    #[test]
    fn nothing_waits_that_others_wait_for() {
        let now = Instant::now();
        for (event, runs_dry) in [
            (result(0.2, 9), false),
            (result(0.01, 9), true),
            (result(0.01, BYTES_MAX), false),
            (PoolEvent::Stopped(lease()), false),
        ] {
            let mut gathered = Gathered::default();
            gathered.add(result(0.01, 9), now, false);
            assert!(gathered.add(event, now, runs_dry));
            assert!(!gathered.add(result(0.01, 9), now, true), "told already");
            assert_eq!(gathered.take(now).unwrap().len(), 3);
        }
        let mut gathered = Gathered::default();
        let told = (0..RESULTS_MAX).map(|_| gathered.add(result(0.01, 9), now, false));
        let told: Vec<bool> = told.collect();
        assert!(told[0] && told[RESULTS_MAX - 1]);
        assert_eq!(told.iter().filter(|told| **told).count(), 2);
    }
}
