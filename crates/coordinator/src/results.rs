//! Results: checked, made durable, handed to the owner of the job.

use crate::error::{
    ApiError, BAD_RESULT, DIGEST_MISMATCH, ENGINE_VERSION as ENGINE, GONE, INTERNAL, NO_JOB,
    OTHER_BYTES, UNAVAILABLE,
};
use crate::farm::Farm;
use crate::job::Job;
use crate::owner::{Arrived, Order};
use crate::plan::Fit;
use crate::reopen::{Merged, reopen};
use crate::{audit, sync};
use bytes::Bytes;
use film::{PackedUnit, Receipt, Unit};
use protocol::JobState;
use std::sync::Arc;
use store::{Appended, Digest, LogEntry, StoreError};
use uuid::Uuid;

/// A result as it came.
#[derive(Clone, Debug)]
pub struct Delivery {
    /// Of which job.
    pub job: Uuid,
    /// Which unit.
    pub unit: Unit,
    /// Who rendered it.
    pub worker: Uuid,
    /// Which token it came with.
    pub token: Option<usize>,
    /// BLAKE3 of the bytes, computed here.
    pub digest: Digest,
    /// What the worker said it is.
    pub claimed: Option<Digest>,
    /// Encoded sums.
    pub bytes: Bytes,
    /// Processor time, seconds.
    pub cpu_seconds: f64,
}

/// What became of it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Taken {
    /// New, and durable.
    New,
    /// The same bytes were there.
    Same,
}

fn gone(why: &str) -> ApiError {
    ApiError::new(GONE, why)
}

impl Farm {
    /// Takes a result. Whatever the outcome, asking again is harmless.
    pub async fn take(self: &Arc<Self>, delivery: Delivery) -> Result<Taken, ApiError> {
        let (worker, held) = (delivery.worker, (delivery.job, delivery.unit));
        let result = self.take_inner(delivery).await;
        let settled = match &result {
            Ok(Taken::Same) => {
                self.metrics.duplicate();
                true
            }
            Ok(Taken::New) => false, // seen to together with the lease
            Err(error) => {
                self.metrics.refused();
                [GONE, NO_JOB, OTHER_BYTES].contains(&error.kind())
            }
        };
        // The worker lets go of the unit and never names it again.
        if settled && let Some(worker) = self.state().workers.get_mut(&worker) {
            worker.held.remove(&held);
        }
        result
    }

    async fn take_inner(self: &Arc<Self>, delivery: Delivery) -> Result<Taken, ApiError> {
        if delivery
            .claimed
            .is_some_and(|claimed| claimed != delivery.digest)
        {
            return Err(ApiError::new(
                DIGEST_MISMATCH,
                "the result was damaged on its way; send it again",
            ));
        }
        // Cheap answers first: most duplicates end here.
        if let Some(taken) = self.known(&delivery).await? {
            return Ok(taken);
        }
        let room = self
            .room
            .clone()
            .acquire_owned()
            .await
            .map_err(|_| ApiError::new(INTERNAL, "closing"))?;
        let result = decode(delivery.bytes.clone())?;
        self.check(&delivery, &result)?;
        // From here on no checkpoint may claim a later position of the log than this one.
        let token = self.next_token();
        self.with_job(delivery.job, |job| {
            let bound = self.stores.log.end();
            job.in_flight.insert(token, (delivery.unit.frame, bound));
            Ok(())
        })?;
        let appended = self.append(&delivery).await;
        let appended_new = appended
            .as_ref()
            .ok()
            .map(|a| matches!(a, Appended::New(_)));
        let accepted = match appended {
            Ok(Appended::New(_) | Appended::Same(_)) => self.accept(&delivery, result, token, room),
            Ok(Appended::Other { .. }) => Err(ApiError::new(
                OTHER_BYTES,
                "other bytes of this unit are in the log",
            )),
            Err(error) => Err(error),
        };
        if !matches!(accepted, Ok(Taken::New)) {
            // The owner frees the token of what it merges.
            if let Some(job) = self.state().jobs.get_mut(&delivery.job) {
                job.in_flight.remove(&token);
            }
        }
        match accepted {
            Err(error) if error.kind() == OTHER_BYTES => {
                // It was accepted between the first look and now, or is about to be.
                match self.known(&delivery).await? {
                    Some(taken) => Ok(taken),
                    None => Err(ApiError::new(UNAVAILABLE, error.to_string())),
                }
            }
            Err(error) if matches!(appended_new, Some(true)) => {
                // Logged and not wanted: it must not keep another result of the unit out.
                self.stores.log.forget(delivery.job, delivery.unit);
                Err(error)
            }
            other => other,
        }
    }

    async fn append(&self, delivery: &Delivery) -> Result<Appended, ApiError> {
        if !self.stores.durable {
            return Ok(Appended::New(0)); // the process and the film end together
        }
        let entry = LogEntry {
            job: delivery.job,
            unit: delivery.unit,
            digest: delivery.digest,
            worker: delivery.worker,
            bytes: delivery.bytes.clone(),
        };
        let appended = self.stores.log.append(entry).await;
        if let Err(error @ StoreError::SyncFailed { .. }) = &appended {
            self.give_up(error);
        }
        Ok(appended?)
    }

    /// The answer to a unit that needs no second look: known, unwanted, or of a job that is over.
    async fn known(self: &Arc<Self>, delivery: &Delivery) -> Result<Option<Taken>, ApiError> {
        let load = {
            let now = self.clock.now();
            let mut state = self.state();
            let state = &mut *state;
            let worker = state
                .workers
                .get_mut(&delivery.worker)
                .filter(|w| w.is(delivery.token))
                .ok_or_else(|| sync::no_worker(delivery.worker))?;
            worker.last_seen = now;
            if let Some(why) = &worker.quarantined {
                return Err(sync::in_quarantine(why));
            }
            let Some(job) = state.jobs.get_mut(&delivery.job) else {
                return Err(gone("the job is deleted"));
            };
            match job.record.state {
                JobState::Cancelled => return Err(gone("the job is cancelled")),
                JobState::Failed => return Err(gone("the job has failed")),
                _ => {}
            }
            if job.record.engine != film::ENGINE_VERSION.0 {
                return Err(ApiError::new(
                    ENGINE,
                    "the job was begun with another engine version",
                ));
            }
            match fit(job, &delivery.unit) {
                Some(Fit::Known(known)) => {
                    let compared = audit::compare(job, delivery, &known, now);
                    return self.conclude(compared, delivery).map(Some);
                }
                Some(Fit::Wanted) => return Ok(None),
                Some(Fit::Unwanted) => {
                    if let Some(lease) = job.leases.get(&delivery.unit).copied() {
                        let at = protocol::LeaseRef {
                            job: delivery.job,
                            unit: delivery.unit,
                            attempt: lease.attempt,
                        };
                        job.end_lease(&at, lease.worker, now);
                    }
                    return Err(gone("these samples are there already, or beyond the stop"));
                }
                Some(Fit::Foreign) => {
                    return Err(ApiError::new(
                        BAD_RESULT,
                        format!("the job has no unit {}", delivery.unit),
                    ));
                }
                None => job
                    .record
                    .begun
                    .get(&delivery.unit.frame)
                    .is_some_and(|f| f.done),
            }
        };
        if !load {
            return Err(gone("the frame is not in work"));
        }
        // A finished frame: its film knows.
        let (farm, of) = (self.clone(), delivery.clone());
        let found = tokio::task::spawn_blocking(move || {
            let Some(film) = crate::checkpoint::look(&farm, of.job, of.unit.frame)? else {
                return Ok::<_, StoreError>(None);
            };
            let film = film
                .read()
                .unwrap_or_else(std::sync::PoisonError::into_inner);
            Ok(Merged::find(&film, &of))
        })
        .await
        .map_err(|_| ApiError::new(INTERNAL, "reading a film crashed"))??;
        let Some(merged) = found else {
            return Err(gone("the job is done without this unit"));
        };
        if merged.digest == delivery.digest {
            return Ok(Some(Taken::Same));
        }
        // Only a result opens a finished picture again, not what was damaged on its way.
        let result = decode(delivery.bytes.clone())?;
        self.check(delivery, &result)?;
        self.metrics.differing();
        let audited = reopen(self, delivery, merged);
        Err(ApiError::new(
            OTHER_BYTES,
            if audited {
                "other bytes of this unit are in the finished picture; a third worker will tell which are right"
            } else {
                "other bytes of this unit are known"
            },
        ))
    }

    /// What a comparison with known bytes amounts to.
    fn conclude(
        self: &Arc<Self>,
        compared: audit::Compared,
        delivery: &Delivery,
    ) -> Result<Taken, ApiError> {
        match compared {
            audit::Compared::Same => Ok(Taken::Same),
            audit::Compared::SameAndGuilty(guilty) => {
                audit::conclude_later(self, delivery.job, delivery.unit, guilty);
                Ok(Taken::Same)
            }
            audit::Compared::Other => {
                self.metrics.differing();
                self.wake.notify_waiters();
                Err(ApiError::new(
                    OTHER_BYTES,
                    format!(
                        "other bytes of unit {} are known; a third worker will tell which are right",
                        delivery.unit
                    ),
                ))
            }
            audit::Compared::OtherAndGuilty(guilty) => {
                self.metrics.differing();
                audit::conclude_later(self, delivery.job, delivery.unit, guilty);
                Err(ApiError::new(
                    OTHER_BYTES,
                    "other bytes of this unit are known; the audit is settled",
                ))
            }
        }
    }

    /// A decoded result has to be what its address says.
    fn check(&self, delivery: &Delivery, result: &PackedUnit<Bytes>) -> Result<(), ApiError> {
        if result.engine() != film::ENGINE_VERSION {
            return Err(ApiError::new(
                ENGINE,
                format!(
                    "the result is of engine version {}, the coordinator has {}",
                    result.engine(),
                    film::ENGINE_VERSION
                ),
            ));
        }
        let grid = self.with_job(delivery.job, |job| Ok(job.record.grid()))?;
        let rectangle = (delivery.unit.tile < grid.count()).then(|| grid.tile(delivery.unit.tile));
        if result.unit() != delivery.unit || Some(result.tile()) != rectangle {
            return Err(ApiError::new(
                BAD_RESULT,
                format!(
                    "the bytes are of unit {} with another rectangle or address",
                    result.unit()
                ),
            ));
        }
        Ok(())
    }

    /// Notes a durable result and hands it to the owner.
    fn accept(
        self: &Arc<Self>,
        delivery: &Delivery,
        result: PackedUnit<Bytes>,
        token: u64,
        room: tokio::sync::OwnedSemaphorePermit,
    ) -> Result<Taken, ApiError> {
        let now = self.clock.now();
        let unit = delivery.unit;
        let mut state = self.state();
        let state = &mut *state;
        if let Some(why) = state
            .workers
            .get(&delivery.worker)
            .and_then(|w| w.quarantined.as_ref())
        {
            return Err(sync::in_quarantine(why));
        }
        let Some(job) = state.jobs.get_mut(&delivery.job) else {
            return Err(gone("the job is deleted"));
        };
        if matches!(job.record.state, JobState::Cancelled | JobState::Failed) {
            return Err(gone("the job is over"));
        }
        match fit(job, &unit) {
            Some(Fit::Wanted) => {}
            Some(Fit::Known(known)) if known.digest == delivery.digest => return Ok(Taken::Same),
            Some(Fit::Known(_)) => {
                return Err(ApiError::new(OTHER_BYTES, "other bytes were faster"));
            }
            _ => return Err(gone("these samples are no longer wanted")),
        }
        let holder = job.leases.remove(&unit).map(|lease| lease.worker);
        if let Some(plan) = job.plans.get_mut(&unit.frame) {
            plan.accept(&unit, delivery.digest, delivery.worker);
        }
        job.tick(now);
        if delivery.cpu_seconds.is_finite() && delivery.cpu_seconds >= 0.0 {
            job.record.cpu_seconds += delivery.cpu_seconds;
        }
        for worker in holder.into_iter().chain([delivery.worker]) {
            if let Some(worker) = state.workers.get_mut(&worker) {
                worker.held.remove(&(delivery.job, unit));
            }
        }
        if let Some(worker) = state.workers.get_mut(&delivery.worker) {
            worker.units_merged += 1;
        }
        self.metrics.accepted(delivery.bytes.len());
        let arrived = Arrived {
            result,
            receipt: Receipt {
                digest: delivery.digest,
                worker: delivery.worker.to_string(),
            },
            token,
            room,
        };
        self.order(job, Order::Merge(Box::new(arrived)))?;
        Ok(Taken::New)
    }
}

/// Checks the bytes; they stay packed until they are merged. Takes about 50 us, less than the way to
/// another thread and back.
fn decode(bytes: Bytes) -> Result<PackedUnit<Bytes>, ApiError> {
    PackedUnit::read(bytes).map_err(|e| ApiError::new(BAD_RESULT, e.to_string()))
}

fn fit(job: &Job, unit: &Unit) -> Option<Fit> {
    let [first, last] = job.record.frames;
    if !(first..=last).contains(&unit.frame) {
        return Some(Fit::Foreign);
    }
    job.plans.get(&unit.frame).map(|plan| plan.fit(unit))
}
