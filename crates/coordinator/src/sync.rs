//! What workers call to say how they are, and to get units.

use crate::error::{ApiError, NO_WORKER, QUARANTINED, SCENE_FAILED};
use crate::farm::{Farm, State};
use crate::job::{BLOCK_FAILURES, Job, POISON_WORKERS};
use crate::worker::Worker;
use crate::{control, job};
use film::convergence::BORDER_MIN;
use film::{TileGrid, Unit};
use protocol::{JobState, Lease, LeaseFailure, LeaseRef, SyncRequest, SyncResponse, TimestampMs};
use std::cmp::Reverse;
use std::sync::Arc;
use std::time::Duration;
use uuid::Uuid;

/// Of so many leases one goes to the job that waits longest, so that priority starves nobody.
const LONGEST_WAITING_EVERY: u64 = 10;
/// Longest time that a call is held open.
const WAIT_MAX: Duration = Duration::from_secs(60);

impl Farm {
    /// Heartbeat, progress, give-back, wish for work: answers at once if there is something to say,
    /// else when there is, or when the wait is over.
    pub async fn sync(
        self: &Arc<Self>,
        request: SyncRequest,
        token: Option<usize>,
    ) -> Result<SyncResponse, ApiError> {
        let wait = Duration::from_millis(request.wait_ms).min(WAIT_MAX);
        let deadline = tokio::time::Instant::now() + wait;
        let failed = self.hear(&request, token)?;
        for id in failed {
            control::save_later(self, id);
            self.tell_job(id);
        }
        loop {
            let woken = self.wake.notified();
            tokio::pin!(woken);
            // Before looking, so that nothing that comes after the look is missed.
            woken.as_mut().enable();
            let Said {
                response,
                started,
                news,
            } = self.answer(&request)?;
            for id in started {
                self.tell_job(id);
            }
            let idle = response.leases.is_empty()
                && response.cancelled.is_empty()
                && !response.give_back_unstarted
                && !news;
            if !idle || self.shutdown.is_cancelled() {
                return Ok(response);
            }
            tokio::select! {
                () = woken => {}
                () = tokio::time::sleep_until(deadline) => return Ok(response),
                () = self.shutdown.cancelled() => return Ok(response),
            }
        }
    }

    /// Takes in what the worker says. Returns the jobs that failed by it.
    fn hear(
        self: &Arc<Self>,
        request: &SyncRequest,
        token: Option<usize>,
    ) -> Result<Vec<Uuid>, ApiError> {
        let now = self.clock.now();
        let expires_at = now + self.config.lease_ttl.as_millis() as u64;
        let mut state = self.state();
        let state = &mut *state;
        let worker = state
            .workers
            .get_mut(&request.worker)
            .filter(|w| w.is(token))
            .ok_or_else(|| no_worker(request.worker))?;
        worker.last_seen = now;
        worker.leaving |= request.draining;
        let mut freed = false;
        for at in &request.given_back {
            if let Some(job) = state.jobs.get_mut(&at.job) {
                freed |= job.end_lease(at, worker.id, now);
            }
            worker.held.remove(&(at.job, at.unit));
        }
        let mut ended = Vec::new();
        for failure in &request.failed {
            let at = &failure.lease;
            worker.held.remove(&(at.job, at.unit));
            if let Some(job) = state.jobs.get_mut(&at.job)
                && note_failure(self, job, worker, failure, now)
            {
                ended.push(at.job);
            }
            freed = true;
        }
        for (id, seconds) in &request.prepared {
            if let Some(job) = state.jobs.get_mut(id)
                && seconds.is_finite()
            {
                job.record.prepare_seconds = job.record.prepare_seconds.max(*seconds);
                job.dirty = true;
            }
        }
        for at in &request.held {
            let Some(job) = state.jobs.get_mut(&at.job) else {
                continue;
            };
            let id = worker.id;
            if let Some(lease) = job.lease_of(at, id) {
                lease.expires_at = expires_at;
            } else if worker.quarantined.is_none() && job.adopt(at, id, now, expires_at) {
                worker.held.insert((at.job, at.unit));
            }
        }
        if freed {
            self.wake.notify_waiters();
        }
        Ok(ended)
    }

    /// What there is to say.
    fn answer(&self, request: &SyncRequest) -> Result<Said, ApiError> {
        let now = self.clock.now();
        let limits = &self.config.limits;
        let ttl = self.config.lease_ttl.as_millis() as u64;
        let expires_at = now + ttl;
        let mut state = self.state();
        let state = &mut *state;
        let worker = state
            .workers
            .get_mut(&request.worker)
            .ok_or_else(|| no_worker(request.worker))?;
        worker.last_seen = now;
        let takes_leases = worker.takes_leases() && !request.draining;
        let (samples_max, mut next) = match request.want_samples {
            wanted if takes_leases && wanted > 0 => share(state, request.worker, wanted, now, ttl),
            _ => (0, u64::MAX),
        };
        let worker = state
            .workers
            .get_mut(&request.worker)
            .ok_or_else(|| no_worker(request.worker))?;
        let mut response = SyncResponse {
            leases: Vec::new(),
            specs: Vec::new(),
            cancelled: Vec::new(),
            give_back_unstarted: false,
            drain: !worker.takes_leases(),
        };
        for at in &request.held {
            let jobs = &mut state.jobs;
            let lost = jobs
                .get_mut(&at.job)
                .is_none_or(|j| j.lease_of(at, worker.id).is_none());
            if lost {
                worker.held.remove(&(at.job, at.unit));
                response.cancelled.push(at.clone());
            }
        }
        let mut started = Vec::new();
        if takes_leases {
            let room = limits.leases_per_worker.saturating_sub(worker.held.len());
            let most = room.min(limits.leases_per_sync as usize);
            let want = request.want as usize;
            let mut samples = 0u64;
            while response.leases.len() < most
                && (response.leases.len() < want || samples.saturating_add(next) <= samples_max)
            {
                let Some((at, first)) = lease_next(
                    &mut state.jobs,
                    &mut state.leases_given,
                    request.worker,
                    now,
                    expires_at,
                ) else {
                    break;
                };
                if first {
                    started.push(at.job);
                }
                worker.held.insert((at.job, at.unit));
                let Some(job) = state.jobs.get(&at.job) else {
                    continue;
                };
                // Units grow slowly: the next one is most often as long.
                next = samples_of(&job.record.grid(), &at.unit);
                samples += next;
                if worker.knows.insert(at.job)
                    && let Some(spec) = &job.record.spec
                {
                    response.specs.push((at.job, spec.clone()));
                }
                response.leases.push(Lease {
                    at,
                    spec_digest: job.record.spec_digest.clone(),
                    engine_version: film::ENGINE_VERSION,
                    expires_at,
                });
            }
            self.metrics.leased(response.leases.len());
            response.give_back_unstarted =
                response.leases.is_empty() && more_urgent(state, request);
        }
        let news = worker_told(state, request.worker, response.drain);
        Ok(Said {
            response,
            started,
            news,
        })
    }
}

/// An answer, and what follows from it here.
struct Said {
    response: SyncResponse,
    /// Jobs whose first lease is in it.
    started: Vec<Uuid>,
    /// It says something else about draining than the one before. A worker that knows that it gets
    /// nothing waits like any other.
    news: bool,
}

/// Notes what a worker is told about draining. True if that is new to it.
fn worker_told(state: &mut State, worker: Uuid, drain: bool) -> bool {
    state
        .workers
        .get_mut(&worker)
        .is_some_and(|worker| std::mem::replace(&mut worker.told_drain, drain) != drain)
}

/// Camera samples of a unit.
fn samples_of(grid: &TileGrid, unit: &Unit) -> u64 {
    grid.tile(unit.tile).pixels() as u64 * u64::from(unit.samples.len())
}

/// How many of the `wanted` samples a worker may have. As long as there is much to lease, all of them;
/// towards the end half of its threads' share of what is left, so that all workers end together
/// instead of one holding the last units that the others could begin. With it the samples of the
/// shortest unit that is offered.
fn share(
    state: &State,
    worker: Uuid,
    wanted: u64,
    now: TimestampMs,
    ttl: TimestampMs,
) -> (u64, u64) {
    let (mut own, mut all) = (0, 0);
    for other in state.workers.values() {
        let threads = u64::from(other.about.threads.max(1));
        let here = other.takes_leases() && !other.is_lost(now, ttl);
        if other.id == worker {
            own = threads;
            all += threads;
        } else if here {
            all += threads;
        }
    }
    let enough = (wanted.saturating_mul(2).saturating_mul(all) / own.max(1)).max(1);
    let (mut left, mut next) = (0, u64::MAX);
    for job in state.jobs.values() {
        if left < enough && job.offers() && job.admits(worker) {
            left += job.left(enough - left);
            if let Some(unit) = job.next_unit() {
                next = next.min(samples_of(&job.record.grid(), &unit));
            }
        }
    }
    if next == u64::MAX {
        next = 1; // a frame that is opened by its first lease
    }
    if own == all {
        return (wanted, next);
    }
    let part = u128::from(left) * u128::from(own) / u128::from(2 * all);
    (wanted.min(part as u64), next)
}

/// The lease that is due. With it whether it is the first of its job.
fn lease_next(
    jobs: &mut std::collections::BTreeMap<Uuid, Job>,
    given: &mut u64,
    worker: Uuid,
    now: TimestampMs,
    expires_at: TimestampMs,
) -> Option<(LeaseRef, bool)> {
    let mut candidates: Vec<&mut Job> = jobs
        .values_mut()
        .filter(|job| {
            job.offers() && job.admits(worker) && job.record.engine == film::ENGINE_VERSION.0
        })
        .collect();
    if (*given + 1).is_multiple_of(LONGEST_WAITING_EVERY) {
        // Within a millisecond, too, the same one must not always win.
        candidates.sort_by_key(|job| (job.waiting_since, job.served));
    } else {
        // Higher priority, then first passes, then in turn: whoever was served longest ago.
        candidates.sort_by_key(|job| {
            (
                Reverse(job.record.priority),
                !early(job),
                job.served,
                job.record.created_at,
                job.record.id,
            )
        });
    }
    candidates.into_iter().find_map(|job| {
        let first = job.record.started_at.is_none() || job.record.state == JobState::Queued;
        let at = job.lease(worker, now, expires_at)?;
        *given += 1;
        job.served = *given;
        Some((at, first))
    })
}

/// Whether the next unit belongs to the first picture of a job.
fn early(job: &Job) -> bool {
    job.next_begin().is_none_or(|begin| begin < BORDER_MIN)
}

/// Whether something waits that goes before what a worker holds.
fn more_urgent(state: &State, request: &SyncRequest) -> bool {
    let held = request.held.iter().filter_map(|at| {
        let job = state.jobs.get(&at.job)?;
        Some((job.record.priority, at.unit.samples.begin < BORDER_MIN))
    });
    let Some(least) = held.min() else {
        return false;
    };
    state.jobs.values().any(|job| {
        job.is_open()
            && job.admits(request.worker)
            && job.plans.values().any(|p| p.has_ready())
            && (job.record.priority, early(job)) > least
            && request.held.iter().all(|at| at.job != job.record.id)
    })
}

/// An attempt failed. True if the job failed by it.
fn note_failure(
    farm: &Arc<Farm>,
    job: &mut job::Job,
    worker: &mut Worker,
    failure: &LeaseFailure,
    now: TimestampMs,
) -> bool {
    let at = &failure.lease;
    if !job.end_lease(at, worker.id, now) {
        return false; // a stale report: the unit is somebody else's
    }
    worker.failures += 1;
    tracing::warn!(job.id = %at.job, unit.id = %at.unit, lease.attempt = at.attempt, worker.id = %worker.id, reason = failure.reason, "an attempt failed");
    let reason: String = failure.reason.chars().take(2000).collect();
    job.note(now, "warn", reason.clone(), Some(at), Some(worker.id));
    if failure.scene_error {
        job.fail(now, ApiError::new(SCENE_FAILED, reason).problem());
        return true;
    }
    let failures = job.failures.entry(worker.id).or_insert(0);
    *failures += 1;
    if *failures == BLOCK_FAILURES {
        let text = format!(
            "worker {} failed {BLOCK_FAILURES} times: it gets no more units of this job",
            worker.about.name
        );
        job.note(now, "warn", text, None, Some(worker.id));
    }
    let failed_by = job.failed_by.entry(at.unit).or_default();
    if !failure.machine_error {
        failed_by.insert(worker.id);
    }
    let all = farm.config.crew.unwrap_or(usize::MAX);
    if failed_by.len() >= POISON_WORKERS.min(all) || job.blocked() >= all {
        control::poison(job, now, &at.unit, &reason);
        return true;
    }
    if at.attempt >= farm.config.limits.attempts {
        control::poison(job, now, &at.unit, "its attempts are spent");
        return true;
    }
    false
}

/// The worker is not known: it has to register.
pub fn no_worker(id: Uuid) -> ApiError {
    ApiError::new(NO_WORKER, format!("no worker {id}; register first"))
}

/// Its results are not taken.
pub fn in_quarantine(why: &str) -> ApiError {
    ApiError::new(QUARANTINED, why)
}
