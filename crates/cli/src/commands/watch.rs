//! `brolly watch`: follow a job to its end.

use super::{jobs, print_json, print_line};
use crate::args::JobArgs;
use crate::job;
use crate::progress::{self, Progress};
use std::io::IsTerminal;
use std::process::ExitCode;

pub async fn run(args: JobArgs) -> anyhow::Result<ExitCode> {
    let client = jobs::connect(&args.remote)?;
    let bar = std::io::stderr().is_terminal() && !args.json;
    let mut shown = Progress::new();
    let mut last = String::new();
    let followed = job::follow(&client, args.id, |status| {
        if bar {
            shown.update(status);
        } else if args.json {
            // One object a line, so that a script can read along.
            let _ = print_json(status);
        } else {
            let line = progress::line(status, 0.0);
            if line != last {
                let _ = print_line(&line);
                last = line;
            }
        }
    })
    .await;
    shown.finish();
    let status = followed?;
    job::require_done(&status)?;
    if !args.json {
        job::print_warnings(&status.warnings);
        eprintln!("done: {}", progress::line(&status, 0.0));
    }
    Ok(ExitCode::SUCCESS)
}
