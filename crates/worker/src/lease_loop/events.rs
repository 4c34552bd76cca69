//! What the pool, the scene cache and the outbox report.

use super::LeaseLoop;
use crate::held::Phase;
use crate::outbox::OutboxEvent;
use crate::pool::{Finished, PoolEvent, Work};
use crate::scene_cache::Prepared;
use client::Delivery;
use protocol::LeaseFailure;
use tokio::time::Instant;

impl LeaseLoop {
    pub(super) fn prepared(&mut self, event: Prepared) {
        let Prepared {
            key,
            job,
            seconds,
            result,
        } = event;
        self.cache.prepared(&key, &result);
        let (mine, others): (Vec<_>, Vec<_>) = std::mem::take(&mut self.parked)
            .into_iter()
            .partition(|parked| parked.key == key);
        self.parked = others;
        match result {
            Ok(scene) => {
                tracing::info!(job.id = %job, frame = key.frame, seconds, memory_bytes = scene.memory_bytes() as u64, "prepared a scene");
                self.reports.prepared.push((job, seconds));
                let works: Vec<Work> = mine
                    .into_iter()
                    .filter_map(|parked| self.work(parked.lease, scene.clone()))
                    .collect();
                self.pool.push(works);
            }
            Err(failure) if failure.stopped => {
                // Abandoned, but wanted again before it ended.
                for parked in mine {
                    self.held.remove(&parked.lease);
                    self.reports.given_back.push(parked.lease);
                }
            }
            Err(failure) => {
                tracing::warn!(job.id = %job, frame = key.frame, reason = failure.reason, "cannot prepare a scene");
                for parked in mine {
                    self.held.remove(&parked.lease);
                    self.reports.failed.push(LeaseFailure {
                        lease: parked.lease,
                        reason: failure.reason.clone(),
                        scene_error: failure.scene_error,
                        machine_error: failure.machine_error,
                    });
                }
            }
        }
    }

    /// Takes in what the pool has to report, or says when that will be due.
    pub(super) fn pool_events(&mut self) -> Option<Instant> {
        match self.pool.reports(std::time::Instant::now()) {
            Ok(events) => {
                events.into_iter().for_each(|event| self.pool_event(event));
                None
            }
            Err(due) => due.map(Instant::from_std),
        }
    }

    fn pool_event(&mut self, event: PoolEvent) {
        match event {
            PoolEvent::Finished(finished) => {
                let Finished {
                    lease,
                    bytes,
                    blake3,
                    samples,
                    wall_seconds,
                    cpu_seconds,
                } = finished;
                tracing::debug!(job.id = %lease.job, unit.id = %lease.unit, lease.attempt = lease.attempt, seconds = wall_seconds, bytes = bytes.len(), "rendered a unit");
                self.pace.observe(samples, wall_seconds);
                if let Some(held) = self.held.get_mut(&lease) {
                    held.phase = Phase::Delivering;
                }
                self.outbox.push(lease, bytes, blake3, cpu_seconds);
            }
            PoolEvent::Stopped(lease) => {
                self.held.remove(&lease);
                if self.leaving.is_some() {
                    self.reports.given_back.push(lease);
                }
            }
            PoolEvent::Failed { lease, reason } => self.refuse(lease, reason, false),
        }
    }

    pub(super) fn outbox_event(&mut self, event: OutboxEvent) {
        match event {
            OutboxEvent::Settled(lease, delivery) => {
                self.held.remove(&lease);
                if delivery == Delivery::OtherBytes {
                    tracing::error!(job.id = %lease.job, unit.id = %lease.unit, "another worker rendered other bytes for a unit: one of the two machines is wrong");
                }
            }
            OutboxEvent::Refused(lease, error) => {
                let reason = format!("the result was refused: {error}");
                // A job that is gone is no failure.
                if error.status() == Some(404) {
                    self.held.remove(&lease);
                    tracing::info!(job.id = %lease.job, unit.id = %lease.unit, reason);
                } else {
                    self.refuse(lease, reason, true);
                }
            }
            OutboxEvent::UnknownWorker(worker) => self.forgotten(worker),
        }
    }
}
