//! `brolly submit`: the job's id alone on stdout.

use super::print_line;
use crate::args::SubmitArgs;
use crate::job;
use crate::output;
use crate::progress::Progress;
use crate::scene_files;
use client::{Client, ImageQuery};
use std::process::ExitCode;

pub async fn run(args: SubmitArgs) -> anyhow::Result<ExitCode> {
    output::check_writable(&args.output)?;
    let client = Client::new(&args.remote.to, args.remote.token.as_deref())?;
    let scene = scene_files::open_for_job(&args.scene)?;
    let mut request = scene.upload(&client, &args.scene).await?;
    drop(scene);
    request.name = args.name.or_else(|| {
        let name = args.scene.scene.file_stem()?.to_string_lossy().into_owned();
        Some(name)
    });
    request.priority = args.priority;
    let id = client.submit(&request).await?.id;
    print_line(&id.to_string())?;
    if !args.wait && args.output.is_empty() {
        return Ok(ExitCode::SUCCESS);
    }
    // Ctrl-C ends the waiting, not the job: it was handed over.
    let mut progress = Progress::new();
    let followed = job::follow(&client, id, |status| progress.update(status)).await;
    progress.finish();
    let status = followed?;
    job::require_done(&status)?;
    job::print_warnings(&status.warnings);
    output::fetch(
        &client,
        id,
        status.frames,
        &args.output,
        &ImageQuery::default(),
    )
    .await?;
    Ok(ExitCode::SUCCESS)
}
