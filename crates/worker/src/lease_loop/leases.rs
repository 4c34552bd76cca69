//! Leases: how many to ask for, what becomes of them, how they are given back.

use super::{LeaseLoop, Parked, SPECS_MAX};
use crate::held::Phase;
use crate::pace::{Load, Wish};
use crate::pool::Work;
use crate::scene_cache::SceneKey;
use film::TileGrid;
use protocol::{Lease, LeaseFailure, LeaseRef, SyncResponse};
use std::collections::HashSet;
use std::sync::Arc;
use uuid::Uuid;

impl LeaseLoop {
    pub(super) fn load(&self) -> Load {
        let waiting = self.pool.waiting();
        let parked: u64 = self
            .parked
            .iter()
            .filter_map(|p| Some(self.held.get(&p.lease)?.samples))
            .sum();
        Load {
            threads: self.config.threads.max(1),
            running: self.held.count(Phase::InPool).saturating_sub(waiting.len()),
            waiting: waiting.len() + self.parked.len(),
            waiting_samples: self.held.samples_of(&waiting) + parked,
        }
    }

    pub(super) fn want(&self) -> Wish {
        let full = self.outbox.bytes() > self.config.outbox_bytes;
        if full || self.drained || self.leaving.is_some() {
            return Wish::NONE;
        }
        self.pace.want(&self.load())
    }

    pub(super) fn take_response(&mut self, response: SyncResponse) {
        let SyncResponse {
            leases,
            specs,
            cancelled,
            give_back_unstarted,
            drain,
        } = response;
        if drain != self.drained {
            self.drained = drain;
            tracing::info!(drain, "the coordinator changed whether it gives us work");
        }
        if self.specs.len() + specs.len() > SPECS_MAX {
            let used: HashSet<Uuid> = self.held.all().iter().map(|lease| lease.job).collect();
            self.specs.retain(|job, _| used.contains(job));
        }
        self.specs
            .extend(specs.into_iter().map(|(job, spec)| (job, Arc::new(spec))));
        self.cancel(cancelled);
        if give_back_unstarted {
            self.give_back_unstarted();
        }
        let mut ready = Vec::new();
        let mut load = self.load();
        for lease in leases {
            // The answer to a repeated call must not give back what is in work here.
            if self.held.get(&lease.at).is_some() {
                continue;
            }
            // Speed may have been misjudged, and others would have nothing to do at the end.
            if self.leaving.is_some() || self.pace.is_plenty(&load) {
                self.reports.given_back.push(lease.at);
                continue;
            }
            let at = lease.at.clone();
            if let Some(work) = self.take_lease(lease) {
                ready.push(work);
            }
            if let Some(held) = self.held.get(&at) {
                load.waiting += 1;
                load.waiting_samples += held.samples;
            }
        }
        self.pool.push(ready);
    }

    /// Starts on a lease; returns it if it can be rendered at once.
    pub(super) fn take_lease(&mut self, lease: Lease) -> Option<Work> {
        let Lease {
            at,
            spec_digest,
            engine_version,
            ..
        } = lease;
        if engine_version != self.config.engine_version {
            self.refuse(
                at,
                format!("the unit needs engine version {engine_version}"),
                true,
            );
            return None;
        }
        let Some(spec) = self.specs.get(&at.job).cloned() else {
            // Forgotten here but known there as sent: registering again makes the coordinator send it.
            self.reports.given_back.push(at);
            self.registered = None;
            return None;
        };
        let [width, height] = spec.size;
        let grid = TileGrid { width, height };
        if at.unit.tile >= grid.count() || at.unit.samples.is_empty() {
            self.refuse(at, "the unit is not part of the picture".into(), false);
            return None;
        }
        let samples = grid.tile(at.unit.tile).pixels() as u64 * u64::from(at.unit.samples.len());
        if !self.held.insert(at.clone(), samples) {
            return None; // the answer to a repeated call
        }
        let key = SceneKey {
            spec_digest,
            frame: at.unit.frame,
        };
        match self.cache.get(&key, at.job, &spec) {
            Some(scene) => self.work(at, scene),
            None => {
                self.parked.push(Parked { lease: at, key });
                None
            }
        }
    }

    pub(super) fn work(&mut self, lease: LeaseRef, scene: Arc<tracer::Scene>) -> Option<Work> {
        let held = self.held.get_mut(&lease)?;
        held.phase = Phase::InPool;
        let stop = held.stop.clone();
        Some(Work { lease, scene, stop })
    }

    pub(super) fn refuse(&mut self, lease: LeaseRef, reason: String, machine_error: bool) {
        tracing::warn!(unit.id = %lease.unit, job.id = %lease.job, reason, "cannot render a unit");
        self.held.remove(&lease);
        self.reports.failed.push(LeaseFailure {
            lease,
            reason,
            scene_error: false,
            machine_error,
        });
    }

    pub(super) fn cancel(&mut self, cancelled: Vec<LeaseRef>) {
        if cancelled.is_empty() {
            return;
        }
        let cancelled: HashSet<LeaseRef> = cancelled.into_iter().collect();
        for lease in self.pool.remove_waiting(&cancelled) {
            self.held.remove(&lease);
        }
        self.unpark(|lease| cancelled.contains(lease));
        for lease in &cancelled {
            // What is rendered already is delivered all the same: it is work saved if the job still wants it.
            if let Some(held) = self.held.get_mut(lease) {
                held.stop.stop();
            }
        }
    }

    /// Removes parked units and stops preparations that nobody waits for any more.
    pub(super) fn unpark(&mut self, which: impl Fn(&LeaseRef) -> bool) -> Vec<LeaseRef> {
        let (gone, kept): (Vec<_>, Vec<_>) = std::mem::take(&mut self.parked)
            .into_iter()
            .partition(|parked| which(&parked.lease));
        self.parked = kept;
        for parked in &gone {
            self.held.remove(&parked.lease);
            if !self.parked.iter().any(|other| other.key == parked.key) {
                self.cache.abandon(&parked.key);
            }
        }
        gone.into_iter().map(|parked| parked.lease).collect()
    }

    pub(super) fn give_back_unstarted(&mut self) {
        let mut back = self.pool.take_waiting();
        for lease in &back {
            self.held.remove(lease);
        }
        back.extend(self.unpark(|_| true));
        if !back.is_empty() {
            tracing::debug!(units = back.len(), "giving back units that have not begun");
        }
        self.reports.given_back.extend(back);
    }
}
