//! Following a job to its end, and what is said about it then.

use crate::exit::{Interrupted, JobFailed};
use client::{Client, EventStream};
use protocol::{Event, Finding, JobState, JobStatus, Problem};
use serde::Serialize;
use std::collections::BTreeMap;
use uuid::Uuid;

/// Follows a job until it ends; every state on the way goes to `seen`. Ctrl-C ends the following
/// with [`Interrupted`].
pub async fn follow(
    client: &Client,
    id: Uuid,
    mut seen: impl FnMut(&JobStatus),
) -> anyhow::Result<JobStatus> {
    let mut events = client.events(Some(id));
    let interrupted = tokio::signal::ctrl_c();
    tokio::pin!(interrupted);
    loop {
        let event = tokio::select! {
            event = next_status(&mut events, id) => event?,
            _ = &mut interrupted => return Err(Interrupted.into()),
        };
        match event {
            Some(status) => {
                seen(&status);
                if status.state.is_final() {
                    return Ok(status);
                }
            }
            None => return Err(JobFailed::Deleted.into()),
        }
    }
}

/// The next state of the job, or nothing if it is gone.
async fn next_status(events: &mut EventStream, id: Uuid) -> anyhow::Result<Option<JobStatus>> {
    loop {
        match events.next().await {
            Ok(Event::Job { job }) if job.id == id => return Ok(Some(*job)),
            Ok(Event::Deleted { job, .. }) if job == id => return Ok(None),
            Ok(_) => {}
            Err(error) if error.status() == Some(404) => return Ok(None),
            Err(error) => return Err(error.into()),
        }
    }
}

/// An error unless the job is done. A noise target that was not reached is done, but said.
pub fn require_done(status: &JobStatus) -> Result<(), JobFailed> {
    match status.state {
        JobState::Failed => Err(JobFailed::Failed(Box::new(
            status.problem.clone().unwrap_or_else(|| Problem {
                kind: "about:blank".into(),
                title: "no reason was given".into(),
                status: 500,
                detail: None,
                findings: Vec::new(),
                limit: None,
                request_id: None,
            }),
        ))),
        JobState::Cancelled => Err(JobFailed::Cancelled),
        _ => {
            if status.target_met == Some(false) {
                eprintln!(
                    "the noise target was not reached: error {} at {:.0} spp",
                    status.error.map_or("unknown".into(), |e| format!("{e:.4}")),
                    status.spp
                );
            }
            Ok(())
        }
    }
}

/// What `--json` prints at the end of a render: scripts rely on these fields.
#[derive(Serialize)]
pub struct RenderReport<'a> {
    job: Uuid,
    width: u32,
    height: u32,
    spp: f64,
    samples: u64,
    rays: u64,
    prepare_seconds: f64,
    render_seconds: f64,
    cpu_seconds: f64,
    error: Option<f64>,
    error_kind: &'a str,
    warnings: &'a [Finding],
}

impl<'a> RenderReport<'a> {
    /// About a job.
    pub fn new(job: &'a JobStatus) -> Self {
        RenderReport {
            job: job.id,
            width: job.width,
            height: job.height,
            spp: job.spp,
            samples: job.samples,
            rays: job.rays,
            prepare_seconds: job.prepare_seconds,
            render_seconds: job.render_seconds,
            cpu_seconds: job.cpu_seconds,
            error: job.error,
            error_kind: &job.error_kind,
            warnings: &job.warnings,
        }
    }
}

/// Warnings on stderr, one a line, those that repeat once with their number.
pub fn print_warnings(warnings: &[Finding]) {
    let mut counts: BTreeMap<String, usize> = BTreeMap::new();
    let lines: Vec<String> = warnings.iter().map(ToString::to_string).collect();
    for line in &lines {
        *counts.entry(line.clone()).or_default() += 1;
    }
    for line in &lines {
        match counts.remove(line) {
            Some(1) => eprintln!("{line}"),
            Some(times) => eprintln!("{line} ({times} times)"),
            None => {}
        }
    }
}
