//! The workers that have registered.

use film::Unit;
use protocol::{RegisterRequest, TimestampMs, WorkerStatus};
use std::collections::BTreeSet;
use uuid::Uuid;

/// A worker.
#[derive(Clone, Debug)]
pub struct Worker {
    /// Id.
    pub id: Uuid,
    /// As it registered.
    pub about: RegisterRequest,
    /// Which token it came with.
    pub token: Option<usize>,
    /// What it holds.
    pub held: BTreeSet<(Uuid, Unit)>,
    /// Jobs whose spec it knows.
    pub knows: BTreeSet<Uuid>,
    /// It said that it leaves.
    pub leaving: bool,
    /// A person drains it.
    pub drained: bool,
    /// Why its results are not taken.
    pub quarantined: Option<String>,
    /// Units merged.
    pub units_merged: u64,
    /// Attempts failed.
    pub failures: u64,
    /// Last sync.
    pub last_seen: TimestampMs,
}

impl Worker {
    /// Newly registered.
    pub fn new(id: Uuid, about: RegisterRequest, token: Option<usize>, now: TimestampMs) -> Self {
        Worker {
            id,
            about,
            token,
            held: BTreeSet::new(),
            knows: BTreeSet::new(),
            leaving: false,
            drained: false,
            quarantined: None,
            units_merged: 0,
            failures: 0,
            last_seen: now,
        }
    }

    /// Whether it may get leases.
    pub fn takes_leases(&self) -> bool {
        !self.leaving && !self.drained && self.quarantined.is_none()
    }

    /// Whether it has been silent for so long that it is taken for lost.
    pub fn is_lost(&self, now: TimestampMs, ttl_ms: u64) -> bool {
        now.saturating_sub(self.last_seen) > ttl_ms
    }

    /// For people.
    pub fn status(&self, now: TimestampMs, ttl_ms: u64) -> WorkerStatus {
        let (state, reason) = if let Some(why) = &self.quarantined {
            ("quarantined", Some(why.clone()))
        } else if self.is_lost(now, ttl_ms) {
            (
                "lost",
                Some(format!("silent for {} s", (now - self.last_seen) / 1000)),
            )
        } else if self.leaving {
            ("draining", Some("it is leaving".into()))
        } else if self.drained {
            ("draining", Some("on request".into()))
        } else if self.held.is_empty() {
            ("idle", None)
        } else {
            ("active", None)
        };
        WorkerStatus {
            id: self.id,
            name: self.about.name.clone(),
            state: state.into(),
            reason,
            threads: self.about.threads,
            version: self.about.version.clone(),
            simd: self.about.simd.clone(),
            leases: self.held.len() as u32,
            units_merged: self.units_merged,
            failures: self.failures,
            last_seen: self.last_seen,
        }
    }
}
