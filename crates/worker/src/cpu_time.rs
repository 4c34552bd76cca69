//! Processor time of the calling thread.

use std::time::{Duration, Instant};

/// Runs from [`Stopwatch::start`].
pub struct Stopwatch {
    wall: Instant,
    cpu: Option<Duration>,
}

impl Stopwatch {
    /// Starts now, on this thread.
    pub fn start() -> Self {
        Stopwatch {
            wall: Instant::now(),
            cpu: thread_time(),
        }
    }
    /// Time on the clock.
    pub fn wall_seconds(&self) -> f64 {
        self.wall.elapsed().as_secs_f64()
    }
    /// Time on a processor; where the system does not tell, time on the clock.
    pub fn cpu_seconds(&self) -> f64 {
        match (self.cpu, thread_time()) {
            (Some(begin), Some(end)) => end.saturating_sub(begin).as_secs_f64(),
            _ => self.wall_seconds(),
        }
    }
}

#[cfg(target_os = "linux")]
fn thread_time() -> Option<Duration> {
    use rustix::time::{ClockId, clock_gettime};
    clock_gettime(ClockId::ThreadCPUTime).try_into().ok()
}

#[cfg(not(target_os = "linux"))]
fn thread_time() -> Option<Duration> {
    None
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sleep_takes_no_processor_time() {
        let watch = Stopwatch::start();
        std::thread::sleep(Duration::from_millis(50));
        assert!(watch.wall_seconds() >= 0.05);
        if thread_time().is_some() {
            assert!(watch.cpu_seconds() < 0.04, "{}", watch.cpu_seconds());
            let before = watch.cpu_seconds();
            let mut x = 1u64;
            while std::hint::black_box(x) < 3_000_000 {
                x += 1;
            }
            assert!(watch.cpu_seconds() > before);
        }
    }
}
