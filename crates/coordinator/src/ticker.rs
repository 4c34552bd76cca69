//! What happens because time passes: leases expire, time limits are reached, people are told.

use crate::control;
use crate::farm::Farm;
use crate::job::Job;
use crate::owner::Order;
use crate::roster;
use protocol::{JobState, LeaseRef, TimestampMs};
use std::sync::Arc;
use std::time::Duration;
use uuid::Uuid;

/// How exact time limits and expiries are.
const TICK: Duration = Duration::from_millis(100);
/// Ticks between events of a running job.
const TELL_TICKS: u64 = 5;
/// Ticks between looks for what nobody needs.
const SWEEP_TICKS: u64 = 36_000;
/// How long an upload may wait for its job.
const YOUNG_MS: u64 = 24 * 3600 * 1000;
/// How long an audit waits for a worker that could settle it.
const AUDIT_WAIT_MS: u64 = 60_000;

/// Runs until the end.
pub async fn run(farm: Arc<Farm>) {
    let mut ticks = tokio::time::interval(TICK);
    ticks.set_missed_tick_behavior(tokio::time::MissedTickBehavior::Delay);
    let mut count = 0u64;
    loop {
        tokio::select! {
            _ = ticks.tick() => {}
            () = farm.shutdown.cancelled() => return,
        }
        count += 1;
        tick(&farm, count.is_multiple_of(TELL_TICKS));
        if count.is_multiple_of(SWEEP_TICKS) {
            let farm = farm.clone();
            let sweep = tokio::task::spawn_blocking(move || {
                let now = farm.clock.now();
                let young = {
                    let mut state = farm.state();
                    state
                        .young
                        .retain(|_, at| now.saturating_sub(*at) < YOUNG_MS);
                    state.young.clone()
                };
                farm.refs.sweep(&young)
            });
            match sweep.await {
                Ok(Ok(removed)) if removed > 0 => {
                    tracing::info!(removed, "uploads without a job removed")
                }
                Ok(Err(error)) => tracing::warn!(%error, "the sweep failed"),
                _ => {}
            }
        }
    }
}

fn tick(farm: &Arc<Farm>, tell: bool) {
    let now = farm.clock.now();
    let mut dirty = Vec::new();
    let mut save = Vec::new();
    let mut load = Vec::new();
    {
        let mut state = farm.state();
        let state = &mut *state;
        let mut freed = Vec::new();
        let mut any = false;
        for (id, job) in &mut state.jobs {
            if !job.record.state.is_final() {
                let before = freed.len();
                expire(farm, job, now, &mut freed);
                any |= freed.len() > before;
                job.tick(now);
                if out_of_time(farm, job) {
                    save.push(*id);
                    any = true;
                }
                drop_hopeless_audits(farm, job, &state.workers, now);
                load.extend(
                    std::mem::take(&mut job.to_load)
                        .into_iter()
                        .map(|f| (*id, f)),
                );
            }
            if tell && job.dirty {
                dirty.push(*id);
            }
        }
        for (worker, job, unit) in freed {
            if let Some(worker) = state.workers.get_mut(&worker) {
                worker.held.remove(&(job, unit));
            }
        }
        roster::forget_lost(farm, state, now);
        if any {
            farm.wake.notify_waiters();
        }
    }
    for id in dirty {
        farm.tell_job(id);
    }
    for id in save {
        control::save_later(farm, id);
    }
    for (id, frame) in load {
        let farm = farm.clone();
        farm.clone().tasks.spawn(async move {
            if let Err(error) = farm.load_frame(id, frame).await {
                tracing::error!(job.id = %id, frame, %error, "a frame cannot be taken up again; trying again");
                tokio::time::sleep(Duration::from_secs(2)).await;
                if let Some(job) = farm.state().jobs.get_mut(&id) {
                    job.to_load.insert(frame);
                }
            }
        });
    }
}

/// Ends leases without a heartbeat.
fn expire(farm: &Farm, job: &mut Job, now: TimestampMs, freed: &mut Vec<(Uuid, Uuid, film::Unit)>) {
    let id = job.record.id;
    let audits = job.audits.iter().filter_map(|(u, a)| Some((*u, a.leased?)));
    let expired: Vec<_> = job
        .leases
        .iter()
        .map(|(u, l)| (*u, *l))
        .chain(audits)
        .filter(|(_, lease)| lease.expires_at <= now)
        .collect();
    for (unit, lease) in expired {
        let at = LeaseRef {
            job: id,
            unit,
            attempt: lease.attempt,
        };
        job.end_lease(&at, lease.worker, now);
        farm.metrics.expired();
        tracing::info!(job.id = %id, unit.id = %unit, lease.attempt = lease.attempt, worker.id = %lease.worker, "a lease expired");
        let text = "no heartbeat: the lease expired".to_owned();
        job.note(now, "warn", text, Some(&at), Some(lease.worker));
        if lease.attempt >= farm.config.limits.attempts {
            control::poison(job, now, &unit, "its attempts are spent");
        }
        freed.push((lease.worker, id, unit));
    }
}

/// Ends a job whose time is up, at whole units. True if it was just now.
fn out_of_time(farm: &Arc<Farm>, job: &mut Job) -> bool {
    let Some(limit) = job.record.stop.time else {
        return false;
    };
    if job.record.timed_out
        || job.record.state != JobState::Running
        || job.record.run_seconds < limit
    {
        return false;
    }
    let now = farm.clock.now();
    job.record.timed_out = true;
    let frames: Vec<u32> = job.plans.keys().copied().collect();
    let mut wanted = Vec::new();
    for frame in frames {
        // One that was taken up again for an audit has had its time.
        let about = job.record.begun.get(&frame);
        if about.is_some_and(|f| f.stopped_at.is_some()) {
            continue;
        }
        if let Some(plan) = job.plans.get_mut(&frame) {
            let counts = plan.stop_here();
            wanted
                .extend(plan.leased().filter(|u| {
                    u.samples.end <= counts.get(u.tile as usize).copied().unwrap_or(0)
                }));
            job.record.begun.entry(frame).or_default().stopped_at = Some(counts);
        }
    }
    // What lies beyond the end is not awaited; its workers hear of it at their next sync.
    let beyond: Vec<_> = job
        .leases
        .iter()
        .filter(|(u, _)| !wanted.contains(u))
        .map(|(u, l)| (*u, *l))
        .collect();
    for (unit, lease) in beyond {
        let at = LeaseRef {
            job: job.record.id,
            unit,
            attempt: lease.attempt,
        };
        job.end_lease(&at, lease.worker, now);
    }
    job.note(
        now,
        "info",
        format!("the time of {limit} s is up"),
        None,
        None,
    );
    if job.plans.values().any(|p| p.is_complete())
        && let Err(error) = farm.order(job, Order::Review)
    {
        tracing::error!(job.id = %job.record.id, %error, "no owner");
    }
    true
}

/// An audit that nobody can settle must not hold the job for ever.
fn drop_hopeless_audits(
    farm: &Arc<Farm>,
    job: &mut Job,
    workers: &std::collections::BTreeMap<Uuid, crate::worker::Worker>,
    now: TimestampMs,
) {
    if job.audits.is_empty() {
        return;
    }
    let ttl = farm.config.lease_ttl.as_millis() as u64;
    let hopeless: Vec<film::Unit> = job
        .audits
        .iter()
        .filter(|(_, audit)| {
            audit.leased.is_none()
                && now.saturating_sub(audit.since) > AUDIT_WAIT_MS
                && !workers.values().any(|w| {
                    !w.is_lost(now, ttl)
                        && w.takes_leases()
                        && audit.claims.iter().all(|(_, claimant)| *claimant != w.id)
                })
        })
        .map(|(unit, _)| *unit)
        .collect();
    for unit in hopeless {
        job.audits.remove(&unit);
        let text = format!(
            "unit {unit}: two results differ and no third worker came; the first one stands"
        );
        job.note(now, "error", text.clone(), None, None);
        job.record.warn(text);
        if let Err(error) = farm.order(job, Order::Review) {
            tracing::error!(job.id = %job.record.id, %error, "no owner");
        }
    }
}
