//! What a worker has to be told.

use film::EngineVersion;
use std::time::Duration;

/// Settings of one worker.
#[derive(Clone, Debug)]
pub struct WorkerConfig {
    /// Address of the coordinator.
    pub url: String,
    /// Secret of a token with the scope `work`.
    pub token: Option<String>,
    /// For people.
    pub name: String,
    /// Threads that render.
    pub threads: usize,
    /// Budget for prepared scenes and their files, bytes.
    pub memory_bytes: u64,
    /// Finished results that are kept while the coordinator cannot be reached, bytes; beyond it no
    /// more work is asked for.
    pub outbox_bytes: u64,
    /// How long units in work may go on after the order to leave.
    pub grace: Duration,
    /// The engine version announced; tests change it.
    pub engine_version: EngineVersion,
}

impl WorkerConfig {
    /// Defaults for a worker of the coordinator at `url`: all cores, half of the memory.
    pub fn new(url: impl Into<String>) -> Self {
        WorkerConfig {
            url: url.into(),
            token: None,
            name: default_name(),
            threads: std::thread::available_parallelism().map_or(1, usize::from),
            memory_bytes: memory_of_machine().unwrap_or(8 << 30) / 2,
            outbox_bytes: 1 << 30,
            // Docker kills ten seconds after it asks.
            grace: Duration::from_secs(8),
            engine_version: film::ENGINE_VERSION,
        }
    }
}

/// The machine's name.
fn default_name() -> String {
    let read = |path| std::fs::read_to_string(path).ok();
    std::env::var("HOSTNAME")
        .ok()
        .or_else(|| read("/proc/sys/kernel/hostname"))
        .map(|name| name.trim().to_owned())
        .filter(|name| !name.is_empty())
        .unwrap_or_else(|| "worker".into())
}

/// Physical memory, or the limit of the container where that is less.
fn memory_of_machine() -> Option<u64> {
    let info = std::fs::read_to_string("/proc/meminfo").ok()?;
    let line = info.lines().find(|line| line.starts_with("MemTotal:"))?;
    let kib: u64 = line.split_whitespace().nth(1)?.parse().ok()?;
    let limit = std::fs::read_to_string("/sys/fs/cgroup/memory.max")
        .ok()
        .and_then(|text| text.trim().parse().ok())
        .unwrap_or(u64::MAX);
    Some((kib << 10).min(limit))
}
