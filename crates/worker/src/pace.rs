//! How much work to hold: pure arithmetic, so that it can be tested.

/// Most units asked for at once, whatever their size.
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
}

/// How much more to ask for. The coordinator gives `units`, however long they are, and goes on up to
/// about `samples` in all: nobody here knows how long the next units will be.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Wish {
    /// Units.
    pub units: u32,
    /// Camera samples.
    pub samples: u64,
}

impl Wish {
    /// Nothing.
    pub const NONE: Wish = Wish {
        units: 0,
        samples: 0,
    };

    /// Whether it asks for anything.
    pub fn is_some(self) -> bool {
        self != Wish::NONE
    }
}

impl Load {
    /// Units that wait where they are long: enough for every idle thread, and to hide the way to the
    /// coordinator. One thread ends one unit at a time, so that one is enough; a second would keep it
    /// from others at the end.
    fn units(&self) -> usize {
        let idle = self.threads.saturating_sub(self.running);
        idle + AHEAD_UNITS.min(self.threads)
    }
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

    /// How much more to ask for: enough for idle threads, and ahead of need by two units or, where
    /// units are shorter than that, by a second. Asks for nothing while more than half of that is at
    /// hand, so that tiny units come many at a time.
    pub fn want(&self, load: &Load) -> Wish {
        let units = load.units().saturating_sub(load.waiting) as u32;
        let mut wish = Wish {
            units: units.min(WANT_MAX),
            samples: 0,
        };
        if let Some(seconds) = self.seconds_per_sample {
            let ahead = (AHEAD_SECONDS * load.threads as f64 / seconds.max(1e-12)) as u64;
            if units == 0 && load.waiting_samples > ahead / 2 {
                return Wish::NONE;
            }
            wish.samples = ahead.saturating_sub(load.waiting_samples);
        }
        wish
    }

    /// Whether so much waits that more is better left to others: twice as long as is asked for, and
    /// more units than are held where they are long.
    pub fn is_plenty(&self, load: &Load) -> bool {
        let Some(seconds) = self.seconds_per_sample else {
            return false;
        };
        let waiting_seconds = seconds * load.waiting_samples as f64 / load.threads as f64;
        load.waiting >= load.units() && waiting_seconds > 2.0 * AHEAD_SECONDS
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
        }
    }

    fn wish(units: u32, samples: u64) -> Wish {
        Wish { units, samples }
    }

    #[test]
    fn a_new_worker_fills_its_threads_and_two_more() {
        let pace = Pace::default();
        assert_eq!(pace.want(&load(0, 0)), wish(6, 0));
        assert_eq!(pace.want(&load(0, 4)), wish(2, 0));
        assert_eq!(pace.want(&load(4, 2)), Wish::NONE);
        let one_thread = Load {
            threads: 1,
            ..Load::default()
        };
        assert_eq!(pace.want(&one_thread), wish(2, 0), "one and one more");
    }

    #[test]
    fn long_units_wait_in_twos_and_short_ones_by_the_second() {
        let mut long = Pace::default();
        long.observe(4096, 16.0);
        assert_eq!(long.want(&load(4, 0)), wish(2, 1024));
        assert_eq!(long.want(&load(4, 1)), wish(1, 0));
        assert_eq!(long.want(&load(4, 2)), Wish::NONE);
        assert_eq!(long.want(&load(2, 0)).units, 4);

        let mut short = Pace::default();
        short.observe(4096, 1.0 / 64.0);
        let second = 4 * 64 * 4096;
        assert_eq!(short.want(&load(4, 0)), wish(2, second));
        let less = short.want(&load(4, 75));
        assert_eq!(less, wish(0, second - 75 * 4096), "less than half a second");
        assert_eq!(short.want(&load(4, 129)), Wish::NONE, "more than that");
        let idle = short.want(&load(0, 5));
        assert_eq!(idle, wish(1, second - 5 * 4096), "idle threads");
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
        assert_eq!(pace.want(&load(0, 0)), wish(6, 0));
        pace.observe(5, 0.0);
        assert_eq!(pace.want(&load(0, 0)).units, 6, "infinitely fast");
    }
}
