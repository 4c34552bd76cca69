//! Commands that ask about jobs or change them with one call.

use super::{print_json, print_line};
use crate::args::{ExtendArgs, JobArgs, JobsArgs, RemoteArgs};
use crate::exit::Usage;
use crate::job::print_warnings;
use crate::progress;
use client::{Client, ClientError, JobQuery};
use protocol::{JobPatch, JobStatus};
use std::process::ExitCode;

/// A client for commands of people.
pub fn connect(remote: &RemoteArgs) -> Result<Client, ClientError> {
    Client::new(&remote.to, remote.token.as_deref())
}

/// `brolly jobs`: all pages.
pub async fn list(args: JobsArgs) -> anyhow::Result<ExitCode> {
    let client = connect(&args.remote)?;
    let mut jobs = Vec::new();
    let mut query = JobQuery {
        state: args.state,
        ..JobQuery::default()
    };
    loop {
        let page = client.jobs(&query).await?;
        jobs.extend(page.jobs);
        query.cursor = page.next;
        if query.cursor.is_none() {
            break;
        }
    }
    if args.json {
        print_json(&jobs)?;
    } else {
        for job in &jobs {
            print_line(&row(job))?;
        }
        if jobs.is_empty() {
            eprintln!(
                "no jobs; submit one with: brolly submit SCENE --to {}",
                client.base()
            );
        }
    }
    Ok(ExitCode::SUCCESS)
}

fn row(job: &JobStatus) -> String {
    let state = format!("{:?}", job.state).to_lowercase();
    let error = job.error.map_or("-".into(), |e| format!("{e:.4}"));
    format!(
        "{}  {state:<9}  {:>3}  {:>9.1} spp  {error:>8}  {}",
        job.id,
        job.priority,
        job.spp,
        printable(&job.name)
    )
}

/// Names come from others: no control characters on a terminal.
fn printable(text: &str) -> String {
    text.chars()
        .map(|c| if c.is_control() { '?' } else { c })
        .collect()
}

/// `brolly show`.
pub async fn show(args: JobArgs) -> anyhow::Result<ExitCode> {
    let job = connect(&args.remote)?.job(args.id).await?;
    tell(&job, args.json)
}

/// Prints a job's state.
fn tell(job: &JobStatus, json: bool) -> anyhow::Result<ExitCode> {
    if json {
        print_json(job)?;
        return Ok(ExitCode::SUCCESS);
    }
    let state = format!("{:?}", job.state).to_lowercase();
    print_line(&format!("{}  {state}  {}", job.id, printable(&job.name)))?;
    print_line(&format!(
        "  {}x{}, priority {}, seed {}, engine {}",
        job.width, job.height, job.priority, job.seed, job.engine_version
    ))?;
    print_line(&format!("  {}", progress::line(job, 0.0)))?;
    print_line(&format!(
        "  {} samples, {} rays, {:.1} s running, {:.1} s of processors, {} workers",
        job.samples, job.rays, job.render_seconds, job.cpu_seconds, job.workers
    ))?;
    if let Some(reason) = &job.waiting_for {
        print_line(&format!("  waiting for {}", printable(reason)))?;
    }
    if let Some(problem) = &job.problem {
        for finding in &problem.findings {
            eprintln!("{finding}");
        }
        let detail = problem.detail.as_deref().unwrap_or_default();
        print_line(&format!(
            "  failed: {} {}",
            problem.title,
            printable(detail)
        ))?;
    }
    print_warnings(&job.warnings);
    Ok(ExitCode::SUCCESS)
}

/// What a changed job looks like: nothing for people (it worked), the object for scripts.
fn changed(job: &JobStatus, json: bool) -> anyhow::Result<ExitCode> {
    if json {
        print_json(job)?;
    } else {
        eprintln!(
            "{} is {}",
            job.id,
            format!("{:?}", job.state).to_lowercase()
        );
    }
    Ok(ExitCode::SUCCESS)
}

/// `brolly pause`.
pub async fn pause(args: JobArgs) -> anyhow::Result<ExitCode> {
    changed(&connect(&args.remote)?.pause(args.id).await?, args.json)
}

/// `brolly resume`.
pub async fn resume(args: JobArgs) -> anyhow::Result<ExitCode> {
    changed(&connect(&args.remote)?.resume(args.id).await?, args.json)
}

/// `brolly cancel`.
pub async fn cancel(args: JobArgs) -> anyhow::Result<ExitCode> {
    changed(&connect(&args.remote)?.cancel(args.id).await?, args.json)
}

/// `brolly retry`.
pub async fn retry(args: JobArgs) -> anyhow::Result<ExitCode> {
    changed(&connect(&args.remote)?.retry_job(args.id).await?, args.json)
}

/// `brolly extend`.
pub async fn extend(args: ExtendArgs) -> anyhow::Result<ExitCode> {
    if args.stop.is_empty() {
        return Err(Usage("extend needs --spp, --noise or --time: the new total".into()).into());
    }
    let patch = JobPatch {
        stop: Some(args.stop.rule()),
        ..JobPatch::default()
    };
    let job = connect(&args.job.remote)?
        .patch_job(args.job.id, &patch)
        .await?;
    changed(&job, args.job.json)
}
