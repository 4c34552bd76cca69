//! The command line of Brolly. Data goes to stdout, everything else to stderr. Exit codes: 0 done,
//! 1 the input or the job failed, 2 usage, 3 the service could not be reached, 130 Ctrl-C.
#![forbid(unsafe_code)]

pub mod args;
mod commands;
mod exit;
mod farm;
mod job;
mod logging;
mod output;
mod progress;
mod scene_files;
mod values;

use args::{Cli, Command};
use clap::Parser;
use std::process::ExitCode;

/// All of the program.
pub fn main() -> ExitCode {
    match Cli::try_parse() {
        Ok(cli) => run(cli),
        Err(error) => {
            // Help and version are no errors; clap knows which stream each belongs to.
            let _ = error.print();
            ExitCode::from(error.exit_code() as u8)
        }
    }
}

/// Runs one command and says how it ended.
fn run(cli: Cli) -> ExitCode {
    logging::start(&cli);
    let mut runtime = tokio::runtime::Builder::new_multi_thread();
    if matches!(cli.command, Command::Render(_)) {
        // The cores are for rendering; what a farm in one process has to say to itself is little.
        runtime.worker_threads(1);
    }
    keep_freed_memory();
    let runtime = match runtime.enable_all().build() {
        Ok(runtime) => runtime,
        Err(error) => return exit::report(&error.into()),
    };
    let outcome = runtime.block_on(dispatch(cli.command));
    // Threads that still render must not keep the process.
    runtime.shutdown_background();
    match outcome {
        Ok(code) => code,
        Err(error) => exit::report(&error),
    }
}

/// Results come and go, a few megabytes at a time, and the allocator of glibc would give their memory back to the
/// system each time: every page of the next ones would be asked for and cleared again. It keeps twice as
/// much as the largest piece that it has seen let go. To others this is nothing.
fn keep_freed_memory() {
    drop(std::hint::black_box(Vec::<u8>::with_capacity(8 << 20)));
}

async fn dispatch(command: Command) -> anyhow::Result<ExitCode> {
    match command {
        Command::Render(args) => commands::render::run(*args).await,
        Command::Serve(args) => commands::serve::run(args).await,
        Command::Work(args) => commands::work::run(args).await,
        Command::Submit(args) => commands::submit::run(*args).await,
        Command::Jobs(args) => commands::jobs::list(args).await,
        Command::Show(args) => commands::jobs::show(args).await,
        Command::Watch(args) => commands::watch::run(args).await,
        Command::Pause(args) => commands::jobs::pause(args).await,
        Command::Resume(args) => commands::jobs::resume(args).await,
        Command::Cancel(args) => commands::jobs::cancel(args).await,
        Command::Retry(args) => commands::jobs::retry(args).await,
        Command::Extend(args) => commands::jobs::extend(args).await,
        Command::Fetch(args) => commands::fetch::run(args).await,
        Command::Check(args) => commands::check::run(args),
        Command::Convert(args) => commands::convert::run(args),
        Command::Compare(args) => commands::compare::run(args),
        Command::Info(args) => commands::info::run(args).await,
    }
}
