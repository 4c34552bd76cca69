//! Processor time of the calling thread.

use std::time::{Duration, Instant};

/// The system brings its figure up to date only every few milliseconds: below this it says nothing.
const COARSE_SECONDS: f64 = 0.01;

/// Runs from [`Stopwatch::start`].
pub struct Stopwatch {
    wall: Instant,
    cpu: Option<u64>,
}

impl Stopwatch {
    /// Starts now, on this thread.
    pub fn start() -> Self {
        Stopwatch {
            wall: Instant::now(),
            cpu: thread_nanoseconds(),
        }
    }
    /// Time on the clock.
    pub fn wall_seconds(&self) -> f64 {
        self.wall.elapsed().as_secs_f64()
    }
    /// Time on a processor; where the system does not tell, time on the clock.
    pub fn cpu_seconds(&self) -> f64 {
        let wall = self.wall_seconds();
        match (self.cpu, thread_nanoseconds()) {
            (Some(begin), Some(end)) if wall > COARSE_SECONDS => {
                Duration::from_nanos(end.saturating_sub(begin)).as_secs_f64()
            }
            _ => wall,
        }
    }
}

/// Linux tells it in a file, which spares the call into libc and with it unsafe code.
fn thread_nanoseconds() -> Option<u64> {
    let text = std::fs::read_to_string("/proc/thread-self/schedstat").ok()?;
    text.split_whitespace().next()?.parse().ok()
}
