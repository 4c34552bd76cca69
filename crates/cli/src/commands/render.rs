//! `brolly render`: a whole farm in one process on loopback, the job submitted over HTTP.

use super::print_json;
use crate::args::RenderArgs;
use crate::exit::Interrupted;
use crate::farm::{Crew, Farm};
use crate::job::{self, RenderReport};
use crate::output;
use crate::progress::Progress;
use crate::scene_files::{self, LocalScene};
use anyhow::Context;
use client::{Client, ImageQuery};
use coordinator::{Config, StoreConfig};
use protocol::JobStatus;
use std::process::ExitCode;
use tokio::net::TcpListener;
use uuid::Uuid;

pub async fn run(args: RenderArgs) -> anyhow::Result<ExitCode> {
    output::check_writable(&args.output)?;
    let scene = scene_files::open_for_job(&args.scene)?;
    let listener = TcpListener::bind(("127.0.0.1", 0))
        .await
        .context("no port on loopback can be had")?;
    let config = Config {
        store: StoreConfig::Memory,
        crew: Some(args.workers.into()),
        ..Config::default()
    };
    let crew = Crew {
        workers: args.workers.into(),
        threads: args.threads.map(usize::from),
        token: None,
    };
    let mut farm = Farm::start(listener, config, &crew).await?;
    let client = Client::new(&format!("http://{}", farm.address), None)?;
    let mut submitted = None;
    let work = render(&client, &args, scene, &mut submitted);
    let outcome = tokio::select! {
        outcome = work => outcome,
        error = farm.failed() => Err(error),
        _ = tokio::signal::ctrl_c() => Err(Interrupted.into()),
    };
    if let (Err(_), Some(id)) = (&outcome, submitted) {
        // Stops the units in work; whether it is heard in time does not matter, the process ends.
        let _ = tokio::time::timeout(std::time::Duration::from_secs(1), client.cancel(id)).await;
    }
    // Nothing outlives this process, so there is nothing to stop in order.
    let status = outcome?;
    job::print_warnings(&status.warnings);
    if args.json {
        print_json(&RenderReport::new(&status))?;
    }
    Ok(ExitCode::SUCCESS)
}

async fn render(
    client: &Client,
    args: &RenderArgs,
    scene: LocalScene,
    submitted: &mut Option<Uuid>,
) -> anyhow::Result<JobStatus> {
    let request = scene.upload(client, &args.scene).await?;
    drop(scene); // the worker has its own copy
    let id = client.submit(&request).await?.id;
    *submitted = Some(id);
    let mut progress = Progress::new();
    let followed = job::follow(client, id, |status| progress.update(status)).await;
    progress.finish();
    let status = followed?;
    job::require_done(&status)?;
    output::fetch(
        client,
        id,
        status.frames,
        &args.output,
        &ImageQuery::default(),
    )
    .await?;
    Ok(status)
}
