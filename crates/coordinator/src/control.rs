//! What people do to jobs: pause, resume, cancel, retry, change, delete.

use crate::error::{ApiError, LOOSER_STOP, POISON_UNIT, WRONG_STATE};
use crate::farm::{Farm, no_job, settle};
use crate::job::Job;
use crate::owner::{self, Order};
use crate::record::rule;
use crate::{import, submit};
use film::{StopRule, Unit};
use protocol::{Event, JobPatch, JobState, JobStatus, Stop, TimestampMs};
use std::sync::{Arc, PoisonError};
use uuid::Uuid;

/// Saves a job's record without making the caller wait; ends what a final state leaves over.
pub fn save_later(farm: &Arc<Farm>, id: Uuid) {
    let farm = farm.clone();
    farm.clone().tasks.spawn(async move {
        if let Err(error) = wind_up(&farm, id).await {
            tracing::error!(job.id = %id, %error, "the record is not saved");
        }
    });
}

/// Fails a job for a unit that nobody can render.
pub fn poison(job: &mut Job, now: TimestampMs, unit: &Unit, reason: &str) {
    let text = format!("unit {unit} fails on every worker that tried; last: {reason}");
    job.fail(now, ApiError::new(POISON_UNIT, text).problem());
}

/// Saves; a job that is over is checkpointed and leaves memory.
async fn wind_up(farm: &Arc<Farm>, id: Uuid) -> Result<(), store::StoreError> {
    let over = |job: &Job| matches!(job.record.state, JobState::Cancelled | JobState::Failed);
    if farm.state().jobs.get(&id).is_some_and(over) {
        // An error here costs samples of a job that nobody waits for, no more.
        if let Err(error) = farm.checkpoint(id).await {
            tracing::warn!(job.id = %id, %error, "no checkpoint of a job that ended");
        }
        let mut state = farm.state();
        if let Some(job) = state.jobs.get_mut(&id)
            && over(job)
        {
            for (frame, _) in std::mem::take(&mut job.plans) {
                if farm.stores.durable {
                    farm.films.unpin(id, frame);
                    farm.set_manifest(id, frame, None);
                }
            }
            job.owner = None;
            job.in_flight.clear();
        }
    }
    farm.save(id).await
}

impl Farm {
    /// Holds a job. Units in work finish and are merged.
    pub async fn pause(self: &Arc<Self>, id: Uuid) -> Result<JobStatus, ApiError> {
        self.with_job(id, |job| match job.record.state {
            JobState::Paused => Ok(()),
            JobState::Queued | JobState::Running => {
                job.record.state = JobState::Paused;
                job.note(self.clock.now(), "info", "paused".into(), None, None);
                Ok(())
            }
            state => Err(wrong_state("paused", state)),
        })?;
        self.changed(id).await
    }

    /// Goes on with a paused job.
    pub async fn resume(self: &Arc<Self>, id: Uuid) -> Result<JobStatus, ApiError> {
        self.with_job(id, |job| match job.record.state {
            JobState::Queued | JobState::Running | JobState::Checking => Ok(()),
            JobState::Paused => {
                job.record.state = if job.record.started_at.is_some() {
                    JobState::Running
                } else {
                    JobState::Queued
                };
                job.note(self.clock.now(), "info", "resumed".into(), None, None);
                self.order(job, Order::Review)?;
                Ok(())
            }
            state => Err(wrong_state("resumed", state)),
        })?;
        self.changed(id).await
    }

    /// Ends a job. Its workers hear of it at once.
    pub async fn cancel(self: &Arc<Self>, id: Uuid) -> Result<JobStatus, ApiError> {
        let now = self.clock.now();
        self.with_job(id, |job| match job.record.state {
            JobState::Cancelled => Ok(()),
            JobState::Done | JobState::Failed => Err(wrong_state("cancelled", job.record.state)),
            _ => {
                job.record.state = JobState::Cancelled;
                job.record.finished_at = Some(now);
                job.drop_leases(now);
                job.audits.clear();
                job.note(now, "info", "cancelled".into(), None, None);
                Ok(())
            }
        })?;
        self.changed(id).await
    }

    /// Starts a failed or cancelled job again, from what it has.
    pub async fn retry(self: &Arc<Self>, id: Uuid) -> Result<JobStatus, ApiError> {
        let now = self.clock.now();
        let mut dropped = Vec::new();
        let check = self.with_job(id, |job| {
            let record = &mut job.record;
            let outdated = record.engine != film::ENGINE_VERSION.0;
            match record.state {
                JobState::Failed | JobState::Cancelled => {}
                JobState::Done => return Err(wrong_state("tried again", record.state)),
                _ if outdated => {}
                _ => return Ok(false),
            }
            record.problem = None;
            record.finished_at = None;
            if outdated {
                // Other bits: nothing of what there is can be used.
                for frame in std::mem::take(&mut record.begun).into_values() {
                    dropped.extend([frame.current, frame.previous].into_iter().flatten());
                }
                record.engine = film::ENGINE_VERSION.0;
                record.timed_out = false;
                record.run_seconds = 0.0;
                job.plans.clear();
                job.owner = None;
            }
            job.attempts.clear();
            job.failed_by.clear();
            job.failures.clear();
            job.waiting_since = now;
            let check = job.record.spec.is_none();
            job.record.state = if check {
                JobState::Checking
            } else {
                JobState::Queued
            };
            job.note(now, "info", "tried again".into(), None, None);
            if !dropped.is_empty() {
                self.films.forget(id);
            }
            if !check {
                job.open_frames();
            }
            Ok(check)
        })?;
        if !dropped.is_empty() {
            self.stores.log.purge(id)?;
            for checkpoint in &dropped {
                owner::release(self, checkpoint);
            }
        }
        if check {
            self.tasks.spawn(import::run(self.clone(), id));
        }
        self.changed(id).await
    }

    /// Changes what may be changed.
    pub async fn patch(self: &Arc<Self>, id: Uuid, patch: JobPatch) -> Result<JobStatus, ApiError> {
        patch.priority.map_or(Ok(()), submit::check_priority)?;
        if let Some(name) = &patch.name {
            submit::check_name(self, name)?;
        }
        if let Some(stop) = &patch.stop {
            submit::check_stop(stop)?;
        }
        self.with_job(id, |job| {
            if let Some(stop) = patch.stop {
                self.extend(job, stop)?;
            }
            if let Some(priority) = patch.priority {
                job.record.priority = priority;
            }
            if let Some(name) = patch.name {
                job.record.name = name;
            }
            Ok(())
        })?;
        match patch.paused {
            Some(true) => self.pause(id).await,
            Some(false) => self.resume(id).await,
            None => self.changed(id).await,
        }
    }

    /// Another stop. No sample that is there may be asked back.
    fn extend(self: &Arc<Self>, job: &mut Job, stop: Stop) -> Result<(), ApiError> {
        if stop == job.record.stop && !job.record.timed_out {
            return Ok(());
        }
        if job.record.state == JobState::Checking {
            job.record.stop = stop;
            return Ok(());
        }
        if matches!(job.record.state, JobState::Failed | JobState::Cancelled) {
            return Err(wrong_state("extended (retry it first)", job.record.state));
        }
        let new = rule(&stop, job.record.file_spp);
        tighter(job, &new, &stop)?;
        job.record.stop = Stop {
            spp: stop.spp.or_else(|| {
                let open = stop.noise.is_none() && stop.time.is_none() && stop.samples.is_none();
                open.then_some(new.spp)
            }),
            ..stop
        };
        job.record.timed_out = false;
        for frame in job.record.begun.values_mut() {
            frame.stopped_at = None;
        }
        let now = self.clock.now();
        if job.record.state == JobState::Done {
            for frame in job.record.begun.values_mut() {
                frame.done = false;
            }
            job.record.state = JobState::Queued;
            job.record.finished_at = None;
            job.record.digest = None;
            job.record.target_met = None;
            job.waiting_since = now;
        }
        for (frame, plan) in &mut job.plans {
            plan.set_goal(new.clone());
            if let Some(film) = self.films.get(job.record.id, *frame) {
                settle(plan, &film.read().unwrap_or_else(PoisonError::into_inner));
            }
        }
        job.note(now, "info", "another stop".into(), None, None);
        job.open_frames();
        self.order(job, Order::Review)?;
        Ok(())
    }

    /// Removes a job and what only it needs.
    pub async fn delete(self: &Arc<Self>, id: Uuid) -> Result<(), ApiError> {
        let lock = self.with_job(id, |job| Ok(job.revision.clone()))?;
        let _revision = lock.lock().await;
        self.stores.jobs.delete(id).await?;
        let Some(job) = self.state().jobs.remove(&id) else {
            return Err(no_job(id));
        };
        if let Some(owner) = &job.owner {
            owner.send(Order::Stop);
        }
        self.wake.notify_waiters();
        self.events.send(Event::Deleted {
            job: id,
            at: self.clock.now(),
        });
        tracing::info!(job.id = %id, "deleted");
        let farm = self.clone();
        let freeing = tokio::task::spawn_blocking(move || {
            for (frame, about) in &job.record.begun {
                farm.set_manifest(id, *frame, None);
                for checkpoint in [&about.current, &about.previous].into_iter().flatten() {
                    owner::release(&farm, checkpoint);
                }
            }
            farm.refs.release(job.record.file_blobs());
            farm.films.forget(id);
            farm.stores.log.purge(id)
        });
        freeing.await.unwrap_or(Ok(()))?;
        Ok(())
    }

    /// Saves a changed job and tells everyone.
    async fn changed(self: &Arc<Self>, id: Uuid) -> Result<JobStatus, ApiError> {
        self.wake.notify_waiters();
        self.tell_job(id);
        wind_up(self, id).await?;
        self.status(id)
    }
}

/// Refuses a stop under which a tile could end with less than it has or was promised.
fn tighter(job: &Job, new: &StopRule, stop: &Stop) -> Result<(), ApiError> {
    let record = &job.record;
    let tiles = record.grid().count();
    if let Some(counts) = &new.samples
        && counts.len() != tiles as usize
    {
        return Err(ApiError::new(
            crate::error::INVALID,
            format!(
                "stop.samples has {} counts, the picture has {tiles} tiles",
                counts.len()
            ),
        ));
    }
    let looser = |text: &str| Err(ApiError::new(LOOSER_STOP, text));
    let old = record.rule();
    // A job that time ended, or may end, promised no samples but those that it has.
    let promised = if record.stop.time.is_some() {
        StopRule {
            spp: 0,
            ..old.clone()
        }
    } else {
        old
    };
    if !new.extends(&promised, tiles) {
        return looser(
            "some tile could end with fewer samples or more noise than under the stop in force",
        );
    }
    for frame in record.begun.values() {
        let counts = frame.stopped_at.iter().flatten().zip(0..);
        if counts.into_iter().any(|(have, tile)| *have > new.cap(tile)) {
            return looser("some tile has more samples already");
        }
    }
    for plan in job.plans.values() {
        if (0..tiles).any(|tile| {
            plan.accepted(tile)
                .last()
                .is_some_and(|u| u.samples.end > new.cap(tile))
        }) {
            return looser("some tile has more samples already");
        }
    }
    match (record.stop.time, stop.time) {
        (Some(old), Some(new)) if new < old => looser("the time is the new total, not an addition"),
        _ => Ok(()),
    }
}

fn wrong_state(what: &str, state: JobState) -> ApiError {
    let state = crate::metrics::state_name(state);
    ApiError::new(
        WRONG_STATE,
        format!("a job that is {state} cannot be {what}"),
    )
}
