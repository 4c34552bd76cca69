//! The worker: leases units from a coordinator, renders them on its own threads, delivers the
//! results, for ever.
//!
//! One task, the `lease_loop`, owns all state and reacts to what the others report: the CPU
//! `pool` (plain threads, one unit each), the `scene_cache` (fetches files, prepares scenes) and
//! the `outbox` (delivers results and keeps them through an outage). Nothing here decides what is rendered;
//! losing any of it costs time, never samples.
#![forbid(unsafe_code)]

mod assets;
mod config;
mod cpu_time;
mod error;
mod gathered;
mod held;
mod lease_loop;
mod outbox;
mod pace;
mod pool;
mod scene_cache;

pub use config::WorkerConfig;
pub use error::WorkerError;

use tokio_util::sync::CancellationToken;

/// Works until `shutdown` is cancelled, then finishes what fits into the grace time, gives back the
/// rest and returns. Fails only for reasons that no retry cures.
pub async fn run(config: WorkerConfig, shutdown: CancellationToken) -> Result<(), WorkerError> {
    lease_loop::LeaseLoop::new(config)?.run(shutdown).await
}
