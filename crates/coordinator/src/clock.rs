//! The only place that asks what time it is. Time runs with tokio's clock from the wall time at the
//! start: it never jumps, and tests that pause tokio's time move it by hand.

use protocol::TimestampMs;
use std::time::{SystemTime, UNIX_EPOCH};
use tokio::time::Instant;

/// Milliseconds since the epoch that only rise.
#[derive(Clone, Copy, Debug)]
pub struct Clock {
    start: Instant,
    wall_ms: TimestampMs,
}

impl Clock {
    /// Begins at the wall time of now.
    pub fn start() -> Self {
        let wall = SystemTime::now()
            .duration_since(UNIX_EPOCH)
            .unwrap_or_default();
        Clock {
            start: Instant::now(),
            wall_ms: wall.as_millis() as TimestampMs,
        }
    }

    /// Now. A wall clock that is set while the process runs changes nothing.
    pub fn now(&self) -> TimestampMs {
        self.wall_ms + self.start.elapsed().as_millis() as TimestampMs
    }
}
