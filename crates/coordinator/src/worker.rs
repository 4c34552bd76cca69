//! The workers that have registered.

use film::Unit;
use protocol::{RegisterRequest, TimestampMs, WorkerStatus};
use serde::{Deserialize, Serialize};
use std::collections::BTreeSet;
use uuid::Uuid;

/// What of a worker outlives the process.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct WorkerRecord {
    /// As it registered.
    pub about: RegisterRequest,
    /// A person drains it.
    #[serde(default)]
    pub drained: bool,
    /// Why its results are not taken.
    #[serde(default)]
    pub quarantined: Option<String>,
}

/// A worker.
#[derive(Clone, Debug)]
pub struct Worker {
    /// Id.
    pub id: Uuid,
    /// As it registered.
    pub about: RegisterRequest,
    /// Which token it came with.
    pub token: Option<usize>,
    /// It registered with this process; else it is known from the one before.
    pub registered: bool,
    /// What it holds.
    pub held: BTreeSet<(Uuid, Unit)>,
    /// Jobs whose spec it knows.
    pub knows: BTreeSet<Uuid>,
    /// Whether the last answer told it that it gets no leases.
    pub told_drain: bool,
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
            registered: true,
            held: BTreeSet::new(),
            knows: BTreeSet::new(),
            told_drain: false,
            leaving: false,
            drained: false,
            quarantined: None,
            units_merged: 0,
            failures: 0,
            last_seen: now,
        }
    }

    /// Known from the process before. What is counted begins anew.
    pub fn recovered(id: Uuid, record: WorkerRecord, now: TimestampMs) -> Self {
        Worker {
            registered: false,
            drained: record.drained,
            quarantined: record.quarantined,
            ..Worker::new(id, record.about, None, now)
        }
    }

    /// It registers again.
    pub fn back(&mut self, about: RegisterRequest, token: Option<usize>, now: TimestampMs) {
        self.about = about;
        self.token = token;
        self.registered = true;
        self.last_seen = now;
        self.leaving = false;
        // A process that asks again has forgotten what it was told.
        self.told_drain = false;
        self.knows.clear();
    }

    /// What is kept.
    pub fn record(&self) -> WorkerRecord {
        WorkerRecord {
            about: self.about.clone(),
            drained: self.drained,
            quarantined: self.quarantined.clone(),
        }
    }

    /// Whether it is who calls.
    pub fn is(&self, token: Option<usize>) -> bool {
        self.registered && self.token == token
    }

    /// Whether it is another process of what people see as one worker.
    pub fn same_name(&self, other: &Worker) -> bool {
        self.id != other.id && !self.about.name.is_empty() && self.about.name == other.about.name
    }

    /// Whether it may get leases.
    pub fn takes_leases(&self) -> bool {
        !self.leaving && !self.drained && self.quarantined.is_none()
    }

    /// Whether it has been silent for so long that it is taken for lost.
    pub fn is_lost(&self, now: TimestampMs, ttl_ms: u64) -> bool {
        !self.registered || now.saturating_sub(self.last_seen) > ttl_ms
    }

    /// For people.
    pub fn status(&self, now: TimestampMs, ttl_ms: u64) -> WorkerStatus {
        let (state, reason) = if let Some(why) = &self.quarantined {
            ("quarantined", Some(why.clone()))
        } else if !self.registered {
            (
                "lost",
                Some("not seen since the coordinator started".into()),
            )
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
