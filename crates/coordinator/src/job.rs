//! A job in memory: its record, the plans of the frames in work, its leases.

use crate::owner::Owner;
use crate::plan::FramePlan;
use crate::record::JobRecord;
use film::Unit;
use protocol::{JobState, LeaseRef, LogLine, Problem, TimestampMs};
use std::collections::{BTreeMap, BTreeSet, HashMap};
use std::sync::Arc;
use uuid::Uuid;

/// Frames that are open at once: the second keeps workers busy while the first drains, and every
/// further one costs memory.
pub const FRAMES_IN_WORK: usize = 2;
/// Different workers that have to fail a unit before its job fails; fewer where fewer will ever be.
pub const POISON_WORKERS: usize = 3;
/// Failures after which a worker gets no more units of a job.
pub const BLOCK_FAILURES: u32 = 3;

/// Who renders a unit now.
#[derive(Clone, Copy, Debug)]
pub struct Lease {
    /// From 1.
    pub attempt: u32,
    /// Who.
    pub worker: Uuid,
    /// When it ends without a heartbeat.
    pub expires_at: TimestampMs,
}

/// Two results of one unit that differ: nobody knows yet which is wrong.
#[derive(Clone, Debug, Default)]
pub struct Audit {
    /// Digest and worker of each result.
    pub claims: Vec<([u8; 32], Uuid)>,
    /// Since when.
    pub since: TimestampMs,
    /// Who renders it again.
    pub leased: Option<Lease>,
}

/// A job in memory.
pub struct Job {
    /// What is kept.
    pub record: JobRecord,
    /// Revision in the store; held while the record is written.
    pub revision: Arc<tokio::sync::Mutex<u64>>,
    /// Frames in work.
    pub plans: BTreeMap<u32, FramePlan>,
    /// Frames that wait to be read from the store.
    pub to_load: BTreeSet<u32>,
    /// Units that are rendered now.
    pub leases: BTreeMap<Unit, Lease>,
    /// Attempts so far.
    pub attempts: HashMap<Unit, u32>,
    /// Who failed a unit.
    pub failed_by: HashMap<Unit, BTreeSet<Uuid>>,
    /// Failures by worker.
    pub failures: HashMap<Uuid, u32>,
    /// Units of which two results differ.
    pub audits: BTreeMap<Unit, Audit>,
    /// Merges; none before the first result.
    pub owner: Option<Owner>,
    /// Results between their arrival and their merge: a token, and the position of the log that
    /// they cannot be before.
    pub in_flight: BTreeMap<u64, (u32, u64)>,
    /// Positions of clearings that the owner has not done yet.
    pub clearing: Vec<u64>,
    /// Since when its clock runs.
    pub running_since: Option<TimestampMs>,
    /// Last lease, or when it was queued: who waits longest.
    pub waiting_since: TimestampMs,
    /// Number of its last lease among all that were given; 0 before the first.
    pub served: u64,
    /// Tiles that changed since the last event, by frame.
    pub changed: BTreeMap<u32, BTreeSet<u32>>,
    /// Something that people see changed since the last event.
    pub dirty: bool,
    /// Samples and time at the last point of the history.
    pub last_point: (u64, f64),
}

impl Job {
    /// From its record.
    pub fn new(record: JobRecord, revision: u64) -> Self {
        Job {
            revision: Arc::new(tokio::sync::Mutex::new(revision)),
            plans: BTreeMap::new(),
            to_load: BTreeSet::new(),
            leases: BTreeMap::new(),
            attempts: HashMap::new(),
            failed_by: HashMap::new(),
            failures: HashMap::new(),
            audits: BTreeMap::new(),
            owner: None,
            in_flight: BTreeMap::new(),
            clearing: Vec::new(),
            running_since: None,
            waiting_since: record.created_at,
            served: 0,
            changed: BTreeMap::new(),
            dirty: true,
            last_point: (0, 0.0),
            record,
        }
    }

    /// Whether units may be leased, as far as its state goes.
    pub fn is_open(&self) -> bool {
        matches!(self.record.state, JobState::Queued | JobState::Running)
    }

    /// Opens frames until there is something to lease or enough is open. A frame that was begun
    /// before has to be read from the store first: those are noted in `to_load`.
    pub fn open_frames(&mut self) {
        let [first, last] = self.record.frames;
        let tiles = self.record.grid().count();
        let mut next = match self.plans.last_key_value() {
            Some((frame, _)) => frame.saturating_add(1),
            None => first,
        };
        while next <= last
            && self.plans.len() + self.to_load.len() < FRAMES_IN_WORK
            && !self.plans.values().any(FramePlan::has_ready)
        {
            match self.record.begun.get(&next) {
                Some(begun) if begun.done => {}
                Some(_) => {
                    self.to_load.insert(next);
                }
                None => {
                    let plan = FramePlan::new(next, tiles, self.record.frame_rule(next));
                    self.plans.insert(next, plan);
                    self.record.begun.entry(next).or_default();
                }
            }
            match next.checked_add(1) {
                Some(n) => next = n,
                None => break,
            }
        }
    }

    /// Whether a frame could be opened for more units.
    pub fn may_open(&self) -> bool {
        let done = self.record.begun.values().filter(|f| f.done).count();
        let open = self.plans.len() + self.to_load.len();
        open < FRAMES_IN_WORK && done + open < self.record.frame_count() as usize
    }

    /// Whether a lease might be had.
    pub fn offers(&self) -> bool {
        self.is_open()
            && self.record.spec.is_some()
            && (self.plans.values().any(FramePlan::has_ready)
                || self.may_open()
                || self.audits.iter().any(|(unit, audit)| {
                    audit.leased.is_none() && self.plans.contains_key(&unit.frame)
                }))
    }

    /// The unit that is due, as far as frames are open.
    pub fn next_unit(&self) -> Option<Unit> {
        self.plans.values().find_map(FramePlan::next_unit)
    }

    /// Camera samples that could be leased without waiting for results; stops counting at `enough`.
    pub fn left(&self, enough: u64) -> u64 {
        if self.may_open() {
            return enough; // a whole frame
        }
        let grid = self.record.grid();
        let mut left = 0;
        for plan in self.plans.values() {
            for (tile, samples) in plan.left() {
                left += u64::from(samples) * grid.tile(tile).pixels() as u64;
                if left >= enough {
                    return enough;
                }
            }
        }
        left
    }

    /// First sample of the unit that would be leased next.
    pub fn next_begin(&self) -> Option<u32> {
        self.plans.values().find_map(FramePlan::next_begin)
    }

    /// Whether a worker may have a unit.
    fn may_have(&self, worker: Uuid, unit: &Unit) -> bool {
        self.failed_by
            .get(unit)
            .is_none_or(|workers| !workers.contains(&worker))
    }

    /// Whether a worker may work on it at all.
    pub fn admits(&self, worker: Uuid) -> bool {
        self.failures
            .get(&worker)
            .is_none_or(|n| *n < BLOCK_FAILURES)
    }

    /// How many workers may not work on it.
    pub fn blocked(&self) -> usize {
        let often = self.failures.values().filter(|n| **n >= BLOCK_FAILURES);
        often.count()
    }

    /// An audit that a worker could settle.
    fn open_audit(&self, worker: Uuid) -> Option<Unit> {
        self.audits
            .iter()
            .find(|(unit, audit)| {
                audit.leased.is_none()
                    // Else its frame is still being read.
                    && self.plans.contains_key(&unit.frame)
                    && audit.claims.iter().all(|(_, w)| *w != worker)
                    && self.may_have(worker, unit)
            })
            .map(|(unit, _)| *unit)
    }

    /// Leases one unit.
    pub fn lease(
        &mut self,
        worker: Uuid,
        now: TimestampMs,
        expires_at: TimestampMs,
    ) -> Option<LeaseRef> {
        if let Some(unit) = self.open_audit(worker) {
            let attempt = self.next_attempt(unit);
            let lease = Lease {
                attempt,
                worker,
                expires_at,
            };
            self.audits.entry(unit).or_default().leased = Some(lease);
            self.started(now);
            return Some(self.name(unit, attempt));
        }
        self.open_frames();
        let failed_by = &self.failed_by;
        let may = |unit: &Unit| {
            failed_by
                .get(unit)
                .is_none_or(|workers| !workers.contains(&worker))
        };
        let unit = self.plans.values_mut().find_map(|plan| plan.lease(may))?;
        let attempt = self.next_attempt(unit);
        self.leases.insert(
            unit,
            Lease {
                attempt,
                worker,
                expires_at,
            },
        );
        self.started(now);
        Some(self.name(unit, attempt))
    }

    fn name(&self, unit: Unit, attempt: u32) -> LeaseRef {
        LeaseRef {
            job: self.record.id,
            unit,
            attempt,
        }
    }

    fn next_attempt(&mut self, unit: Unit) -> u32 {
        let attempt = self.attempts.entry(unit).or_insert(0);
        *attempt += 1;
        *attempt
    }

    fn started(&mut self, now: TimestampMs) {
        self.waiting_since = now;
        self.record.started_at.get_or_insert(now);
        if self.record.state == JobState::Queued {
            self.record.state = JobState::Running;
        }
        self.dirty = true;
        self.tick(now);
    }

    /// Ends a lease if it is this attempt of this worker. A stale report frees nothing.
    pub fn end_lease(&mut self, at: &LeaseRef, worker: Uuid, now: TimestampMs) -> bool {
        let is = |lease: &Lease| lease.attempt == at.attempt && lease.worker == worker;
        if let Some(audit) = self.audits.get_mut(&at.unit)
            && audit.leased.as_ref().is_some_and(is)
        {
            audit.leased = None;
            return true;
        }
        if !self.leases.get(&at.unit).is_some_and(is) {
            return false;
        }
        self.leases.remove(&at.unit);
        if let Some(plan) = self.plans.get_mut(&at.unit.frame) {
            plan.release(&at.unit);
        }
        self.tick(now);
        true
    }

    /// The lease of a worker, if it is this attempt.
    pub fn lease_of(&mut self, at: &LeaseRef, worker: Uuid) -> Option<&mut Lease> {
        let is = |lease: &&mut Lease| lease.attempt == at.attempt && lease.worker == worker;
        self.leases.get_mut(&at.unit).filter(is).or_else(|| {
            let audit = self.audits.get_mut(&at.unit)?;
            audit.leased.as_mut().filter(is)
        })
    }

    /// A worker holds a lease that the coordinator forgot in a restart: takes it as it is.
    pub fn adopt(
        &mut self,
        at: &LeaseRef,
        worker: Uuid,
        now: TimestampMs,
        expires_at: TimestampMs,
    ) -> bool {
        if !self.is_open() || self.leases.contains_key(&at.unit) {
            return false;
        }
        let Some(plan) = self.plans.get_mut(&at.unit.frame) else {
            return false;
        };
        if !plan.adopt(&at.unit) {
            return false;
        }
        let attempts = self.attempts.entry(at.unit).or_insert(0);
        *attempts = (*attempts).max(at.attempt);
        let attempt = at.attempt;
        self.leases.insert(
            at.unit,
            Lease {
                attempt,
                worker,
                expires_at,
            },
        );
        self.started(now);
        true
    }

    /// Frees all leases. The workers hear of it at their next sync.
    pub fn drop_leases(&mut self, now: TimestampMs) {
        for (unit, _) in std::mem::take(&mut self.leases) {
            if let Some(plan) = self.plans.get_mut(&unit.frame) {
                plan.release(&unit);
            }
        }
        for audit in self.audits.values_mut() {
            audit.leased = None;
        }
        self.tick(now);
    }

    /// Brings the running time up to date. The clock runs while units are being rendered.
    pub fn tick(&mut self, now: TimestampMs) {
        if let Some(since) = self.running_since {
            self.record.run_seconds += now.saturating_sub(since) as f64 / 1000.0;
        }
        self.running_since = (!self.leases.is_empty()).then_some(now);
    }

    /// Workers that hold a lease.
    pub fn workers(&self) -> BTreeSet<Uuid> {
        self.leases.values().map(|l| l.worker).collect()
    }

    /// Notes what happened.
    pub fn note(
        &mut self,
        now: TimestampMs,
        level: &str,
        message: String,
        at: Option<&LeaseRef>,
        worker: Option<Uuid>,
    ) {
        self.record.note(LogLine {
            at: now,
            level: level.into(),
            message,
            unit: at.map(|a| a.unit.to_string()),
            attempt: at.map(|a| a.attempt),
            worker: worker.map(|w| w.to_string()),
        });
        self.dirty = true;
    }

    /// Ends it with an error.
    pub fn fail(&mut self, now: TimestampMs, problem: Problem) {
        let why = problem
            .detail
            .clone()
            .unwrap_or_else(|| problem.title.clone());
        self.note(now, "error", why, None, None);
        self.record.problem = Some(problem);
        self.record.state = JobState::Failed;
        self.record.finished_at = Some(now);
        self.drop_leases(now);
        self.audits.clear();
    }

    /// Sums over all frames.
    pub fn totals(&self) -> (u64, u64, u64, u64) {
        self.record.begun.values().fold((0, 0, 0, 0), |sum, frame| {
            let s = &frame.stats;
            (
                sum.0 + s.samples,
                sum.1 + s.rays,
                sum.2 + s.rejected,
                sum.3 + s.units,
            )
        })
    }

    /// Samples that the stop asks for, over all frames, where that is known beforehand.
    pub fn samples_wanted(&self) -> Option<u64> {
        let grid = self.record.grid();
        let of_rule = |rule: &film::StopRule| -> u64 {
            (0..grid.count())
                .map(|t| u64::from(rule.cap(t)) * grid.tile(t).pixels() as u64)
                .sum()
        };
        if self.record.stop.noise.is_some()
            || (self.record.stop.time.is_some() && !self.record.timed_out)
        {
            return None;
        }
        let rule = self.record.rule();
        if rule.samples.is_none() && !self.record.timed_out {
            let pixels = u64::from(grid.width) * u64::from(grid.height);
            return Some(pixels * u64::from(rule.spp) * u64::from(self.record.frame_count()));
        }
        let [first, last] = self.record.frames;
        Some(
            (first..=last)
                .map(|f| of_rule(&self.record.frame_rule(f)))
                .sum(),
        )
    }
}
