//! `brolly fetch`: the picture as it stands.

use super::{jobs, print_json};
use crate::args::FetchArgs;
use crate::output;
use client::ImageQuery;
use std::process::ExitCode;

pub async fn run(args: FetchArgs) -> anyhow::Result<ExitCode> {
    output::check_writable(&args.output)?;
    let client = jobs::connect(&args.job.remote)?;
    let status = client.job(args.job.id).await?;
    let query = ImageQuery {
        layer: args.layer,
        exposure: args.exposure,
        ..ImageQuery::default()
    };
    let frames = args.frame.map_or(status.frames, |frame| [frame, frame]);
    output::fetch(&client, args.job.id, frames, &args.output, &query).await?;
    if args.job.json {
        print_json(&status)?;
    }
    Ok(ExitCode::SUCCESS)
}
