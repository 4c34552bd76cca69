//! How a job stands, for people and programs.

use crate::config::Config;
use crate::job::Job;
use crate::worker::Worker;
use protocol::{JobState, JobStatus, TimestampMs};
use std::collections::BTreeMap;
use uuid::Uuid;

/// Answer to `GET /v1/jobs/{id}`.
pub fn of(
    job: &Job,
    workers: &BTreeMap<Uuid, Worker>,
    now: TimestampMs,
    config: &Config,
) -> JobStatus {
    let record = &job.record;
    let grid = record.grid();
    let (samples, rays, rejected, units) = job.totals();
    let pixels = f64::from(grid.width) * f64::from(grid.height) * f64::from(record.frame_count());
    let running = job
        .running_since
        .map_or(0.0, |s| now.saturating_sub(s) as f64 / 1000.0);
    let seconds = record.run_seconds + running;
    let (progress, eta_seconds) = progress(job, samples, seconds);
    let errors = record.begun.values().map(|f| f.stats.error);
    // The worst frame speaks for the job; one that cannot tell yet silences it.
    let error = errors.reduce(|a, b| Some(a?.max(b?))).flatten();
    JobStatus {
        id: record.id,
        name: record.name.clone(),
        state: record.state,
        priority: record.priority,
        seed: record.request.seed,
        width: grid.width,
        height: grid.height,
        frames: record.frames,
        spp: samples as f64 / pixels.max(1.0),
        stop: record.stop.clone(),
        error,
        error_kind: film::error::ERROR_KIND.name().into(),
        target_met: record.target_met,
        progress,
        eta_seconds,
        samples,
        rays,
        rejected_samples: rejected,
        prepare_seconds: record.prepare_seconds,
        render_seconds: seconds,
        cpu_seconds: record.cpu_seconds,
        units_merged: units,
        units_leased: job.leases.len() as u32,
        workers: job.workers().len() as u32,
        image_version: record.image_version,
        digest: record.digest.clone(),
        engine_version: record.engine,
        warnings: record.warnings.clone(),
        problem: record.problem.clone(),
        waiting_for: waiting_for(job, workers, now, config),
        created_at: record.created_at,
        started_at: record.started_at,
        first_image_at: record.first_image_at,
        finished_at: record.finished_at,
    }
}

/// Share done and seconds left, where they can be told.
fn progress(job: &Job, samples: u64, seconds: f64) -> (Option<f64>, Option<f64>) {
    let record = &job.record;
    match record.state {
        JobState::Done => return (Some(1.0), None),
        JobState::Running => {}
        _ => return (None, None),
    }
    let mut share: f64 = 0.0;
    let mut left = f64::INFINITY;
    let mut consider = |done: f64| {
        share = share.max(done.clamp(0.0, 1.0));
        if done > 0.02 && seconds > 0.0 {
            left = left.min(seconds * (1.0 / done - 1.0).max(0.0));
        }
    };
    if let Some(wanted) = job.samples_wanted() {
        consider(samples as f64 / (wanted as f64).max(1.0));
    }
    if let Some(limit) = record.stop.time {
        consider(seconds / limit.max(1e-3));
    }
    let error = record
        .begun
        .values()
        .next_back()
        .and_then(|f| f.stats.error);
    if let (Some(target), Some(error)) = (record.stop.noise, error)
        && record.frame_count() == 1
        && target > 0.0
    {
        // Error falls with the square root of the samples.
        consider((target / error.max(target)).powi(2));
    }
    (
        (share > 0.0).then_some(share),
        left.is_finite().then_some(left),
    )
}

/// Why nothing happens, if nothing does.
fn waiting_for(
    job: &Job,
    workers: &BTreeMap<Uuid, Worker>,
    now: TimestampMs,
    config: &Config,
) -> Option<String> {
    let record = &job.record;
    match record.state {
        JobState::Checking => return Some("the scene is being checked".into()),
        JobState::Paused => return Some("paused".into()),
        state if state.is_final() => return None,
        _ => {}
    }
    if record.engine != film::ENGINE_VERSION.0 {
        return Some(format!(
            "begun with engine version {}, this is {}: only a retry from the start can go on",
            record.engine,
            film::ENGINE_VERSION
        ));
    }
    if !job.leases.is_empty() || !job.in_flight.is_empty() {
        return None;
    }
    let ttl = config.lease_ttl.as_millis() as u64;
    let live: Vec<&Worker> = workers.values().filter(|w| !w.is_lost(now, ttl)).collect();
    let why = if live.is_empty() {
        "a worker: none is connected".to_owned()
    } else if live.iter().all(|w| !w.takes_leases()) {
        "a worker: all are draining or in quarantine".into()
    } else if live.iter().all(|w| !w.takes_leases() || !job.admits(w.id)) {
        "a worker: all that are connected have failed this job too often".into()
    } else if !job.audits.is_empty() {
        "a third worker: two results of one unit differ".into()
    } else {
        "its turn: workers are busy with other jobs".into()
    };
    Some(why)
}
