//! Numbers for operators, in the text format of Prometheus.

use crate::farm::Farm;
use protocol::JobState;
use std::collections::BTreeMap;
use std::fmt::Write;
use std::sync::atomic::{AtomicU64, Ordering};

/// Counters since the start.
#[derive(Debug, Default)]
pub struct Metrics {
    merged: AtomicU64,
    accepted: AtomicU64,
    accepted_bytes: AtomicU64,
    duplicates: AtomicU64,
    differing: AtomicU64,
    refused: AtomicU64,
    leases: AtomicU64,
    expired: AtomicU64,
}

impl Metrics {
    /// A result is in the film.
    pub fn merged(&self) {
        self.merged.fetch_add(1, Ordering::Relaxed);
    }
    /// A result is durable.
    pub fn accepted(&self, bytes: usize) {
        self.accepted.fetch_add(1, Ordering::Relaxed);
        self.accepted_bytes
            .fetch_add(bytes as u64, Ordering::Relaxed);
    }
    /// The same bytes came again.
    pub fn duplicate(&self) {
        self.duplicates.fetch_add(1, Ordering::Relaxed);
    }
    /// Other bytes came.
    pub fn differing(&self) {
        self.differing.fetch_add(1, Ordering::Relaxed);
    }
    /// A result was not taken.
    pub fn refused(&self) {
        self.refused.fetch_add(1, Ordering::Relaxed);
    }
    /// Leases were given.
    pub fn leased(&self, count: usize) {
        self.leases.fetch_add(count as u64, Ordering::Relaxed);
    }
    /// A lease expired.
    pub fn expired(&self) {
        self.expired.fetch_add(1, Ordering::Relaxed);
    }
}

/// The page.
pub fn page(farm: &Farm) -> String {
    let mut out = String::new();
    let mut put = |name: &str, kind: &str, help: &str, values: &[(String, u64)]| {
        let _ = writeln!(out, "# HELP {name} {help}\n# TYPE {name} {kind}");
        for (labels, value) in values {
            let _ = writeln!(out, "{name}{labels} {value}");
        }
    };
    let m = &farm.metrics;
    let counter = |c: &AtomicU64| vec![(String::new(), c.load(Ordering::Relaxed))];
    put(
        "brolly_results_accepted_total",
        "counter",
        "Results accepted.",
        &counter(&m.accepted),
    );
    put(
        "brolly_result_bytes_total",
        "counter",
        "Bytes of accepted results.",
        &counter(&m.accepted_bytes),
    );
    put(
        "brolly_results_duplicate_total",
        "counter",
        "Results that were known already.",
        &counter(&m.duplicates),
    );
    put(
        "brolly_results_differing_total",
        "counter",
        "Results with other bytes than known ones.",
        &counter(&m.differing),
    );
    put(
        "brolly_results_refused_total",
        "counter",
        "Results that were not taken.",
        &counter(&m.refused),
    );
    put(
        "brolly_units_merged_total",
        "counter",
        "Units merged into films.",
        &counter(&m.merged),
    );
    put(
        "brolly_leases_total",
        "counter",
        "Leases given.",
        &counter(&m.leases),
    );
    put(
        "brolly_leases_expired_total",
        "counter",
        "Leases that expired.",
        &counter(&m.expired),
    );
    let now = farm.clock.now();
    let ttl = farm.config.lease_ttl.as_millis() as u64;
    let mut jobs: BTreeMap<&str, u64> = JOB_STATES.iter().map(|s| (state_name(*s), 0)).collect();
    let mut workers: BTreeMap<String, u64> = BTreeMap::new();
    let mut leased = 0;
    {
        let state = farm.state();
        for job in state.jobs.values() {
            *jobs.entry(state_name(job.record.state)).or_insert(0) += 1;
            leased += job.leases.len() as u64;
        }
        for worker in state.workers.values() {
            *workers.entry(worker.status(now, ttl).state).or_insert(0) += 1;
        }
    }
    let label = |name: &str| format!("{{state=\"{name}\"}}");
    let jobs: Vec<_> = jobs.into_iter().map(|(s, n)| (label(s), n)).collect();
    put("brolly_jobs", "gauge", "Jobs by state.", &jobs);
    let workers: Vec<_> = workers.iter().map(|(s, n)| (label(s), *n)).collect();
    put("brolly_workers", "gauge", "Workers by state.", &workers);
    put(
        "brolly_units_leased",
        "gauge",
        "Units being rendered.",
        &[(String::new(), leased)],
    );
    put(
        "brolly_result_log_bytes",
        "gauge",
        "Size of the result log.",
        &[(String::new(), farm.stores.log.size_bytes())],
    );
    out
}

const JOB_STATES: [JobState; 7] = [
    JobState::Checking,
    JobState::Queued,
    JobState::Running,
    JobState::Paused,
    JobState::Done,
    JobState::Failed,
    JobState::Cancelled,
];

/// As in JSON.
pub fn state_name(state: JobState) -> &'static str {
    match state {
        JobState::Checking => "checking",
        JobState::Queued => "queued",
        JobState::Running => "running",
        JobState::Paused => "paused",
        JobState::Done => "done",
        JobState::Failed => "failed",
        JobState::Cancelled => "cancelled",
    }
}
