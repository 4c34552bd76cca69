//! How many units to hold: pure arithmetic, so that it can be tested.

/// Most leases asked for at once.
const WANT_MAX: u32 = 256;
/// Work that may wait where units are short, seconds.
const AHEAD_SECONDS: f64 = 1.0;
/// Units that may wait where they are long.
const AHEAD_UNITS: usize = 2;
/// Weight of the newest measurement.
const NEWEST: f64 = 0.3;

/// What the worker knows about its own speed.
#[derive(Clone, Copy, Debug, Default)]
pub struct Pace {
    /// Of one thread.
    seconds_per_sample: Option<f64>,
}

/// What is at hand.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Load {
    /// Threads.
    pub threads: usize,
    /// Units that have begun.
    pub running: usize,
    /// Units that have not.
    pub waiting: usize,
    /// Camera samples of those.
    pub waiting_samples: u64,
    /// Camera samples of a unit as they come now.
    pub unit_samples: u64,
}

impl Pace {
    /// Learns from a finished unit.
    pub fn observe(&mut self, samples: u64, seconds: f64) {
        if samples == 0 || !seconds.is_finite() || seconds < 0.0 {
            return;
        }
        let newest = seconds / samples as f64;
        self.seconds_per_sample = Some(match self.seconds_per_sample {
            Some(old) => old + NEWEST * (newest - old),
            None => newest,
        });
    }

    /// How many more leases to ask for: enough for idle threads, and ahead of need by two units
    /// or, where units are shorter than that, by a second. Asks for nothing while more than half of that
    /// is at hand, so that tiny units come many at a time.
    pub fn want(&self, load: &Load) -> u32 {
        let idle = load.threads.saturating_sub(load.running);
        let ahead = match self.seconds_per_sample {
            Some(seconds) => {
                let unit_seconds = (seconds * load.unit_samples.max(1) as f64).max(1e-6);
                let waiting_seconds = seconds * load.waiting_samples as f64 / load.threads as f64;
                let short = AHEAD_SECONDS * load.threads as f64 / unit_seconds;
                let enough =
                    load.waiting >= AHEAD_UNITS + idle && waiting_seconds > AHEAD_SECONDS / 2.0;
                if enough {
                    return 0;
                }
                AHEAD_UNITS.max(short.min(f64::from(WANT_MAX)) as usize)
            }
            None => AHEAD_UNITS,
        };
        let want = (idle + ahead).saturating_sub(load.waiting);
        (want as u32).min(WANT_MAX)
    }

    /// Whether so much waits that more is better left to others: twice as long as is asked for, and
    /// more units than are held where they are long.
    pub fn is_plenty(&self, load: &Load) -> bool {
        let Some(seconds) = self.seconds_per_sample else {
            return false;
        };
        let idle = load.threads.saturating_sub(load.running);
        let waiting_seconds = seconds * load.waiting_samples as f64 / load.threads as f64;
        load.waiting >= AHEAD_UNITS + idle && waiting_seconds > 2.0 * AHEAD_SECONDS
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn load(running: usize, waiting: usize) -> Load {
        Load {
            threads: 4,
            running,
            waiting,
            waiting_samples: waiting as u64 * 4096,
            unit_samples: 4096,
        }
    }

    #[test]
    fn a_new_worker_fills_its_threads_and_two_more() {
        let pace = Pace::default();
        assert_eq!(pace.want(&load(0, 0)), 6);
        assert_eq!(pace.want(&load(0, 4)), 2);
        assert_eq!(pace.want(&load(4, 2)), 0);
    }

    #[test]
    fn long_units_wait_in_twos_and_short_ones_by_the_second() {
        let mut long = Pace::default();
        long.observe(4096, 10.0);
        assert_eq!(long.want(&load(4, 0)), 2);
        assert_eq!(long.want(&load(4, 1)), 1);
        assert_eq!(long.want(&load(4, 2)), 0);
        assert_eq!(long.want(&load(2, 0)), 4);

        let mut short = Pace::default();
        short.observe(4096, 0.02);
        assert_eq!(short.want(&load(4, 0)), 200);
        assert_eq!(short.want(&load(4, 75)), 125, "less than half a second");
        assert_eq!(short.want(&load(4, 125)), 0, "more than half a second");
        short = Pace::default();
        short.observe(4096, 1e-9);
        assert_eq!(short.want(&load(4, 0)), WANT_MAX);
    }

    #[test]
    fn units_that_have_grown_are_left_to_others() {
        let mut pace = Pace::default();
        assert!(!pace.is_plenty(&load(4, 1000)), "nothing is known yet");
        pace.observe(4096, 0.1);
        assert!(!pace.is_plenty(&load(4, 80)), "two seconds of four threads");
        assert!(pace.is_plenty(&load(4, 81)));
        pace = Pace::default();
        pace.observe(4096, 10.0);
        assert!(!pace.is_plenty(&load(4, 1)));
        assert!(!pace.is_plenty(&load(2, 3)), "two threads are idle");
        assert!(pace.is_plenty(&load(4, 2)));
    }

    #[test]
    fn nonsense_is_not_learned() {
        let mut pace = Pace::default();
        pace.observe(0, 1.0);
        pace.observe(5, f64::NAN);
        pace.observe(5, -1.0);
        assert_eq!(pace.want(&load(0, 0)), 6);
    }
}
