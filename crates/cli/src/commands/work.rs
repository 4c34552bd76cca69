//! `brolly work`: one worker, until it is told to leave.

use crate::args::WorkArgs;
use crate::exit::INTERRUPTED;
use std::process::ExitCode;
use tokio::signal::unix::{SignalKind, signal};
use tokio_util::sync::CancellationToken;
use worker::WorkerConfig;

pub async fn run(args: WorkArgs) -> anyhow::Result<ExitCode> {
    let mut config = WorkerConfig::new(args.url);
    config.token = args.token;
    if let Some(threads) = args.threads {
        config.threads = threads.into();
    }
    if let Some(memory) = args.memory {
        config.memory_bytes = memory;
    }
    if let Some(name) = args.name {
        config.name = name;
    }
    tracing::info!(
        coordinator = config.url,
        name = config.name,
        threads = config.threads,
        memory_bytes = config.memory_bytes,
        simd = tracer::simd_level(),
        version = env!("CARGO_PKG_VERSION"),
        engine_version = %film::ENGINE_VERSION,
        "brolly works"
    );
    let shutdown = CancellationToken::new();
    let mut terminate = signal(SignalKind::terminate())?;
    let mut worker = tokio::spawn(worker::run(config, shutdown.clone()));
    tokio::select! {
        ended = &mut worker => {
            ended??;
            return Ok(ExitCode::SUCCESS);
        }
        _ = terminate.recv() => {}
        _ = tokio::signal::ctrl_c() => {}
    }
    // Asked once it finishes what fits into the grace time, asked twice it goes.
    shutdown.cancel();
    tokio::select! {
        ended = worker => {
            ended??;
            Ok(ExitCode::SUCCESS)
        }
        _ = terminate.recv() => Ok(ExitCode::from(INTERRUPTED)),
        _ = tokio::signal::ctrl_c() => Ok(ExitCode::from(INTERRUPTED)),
    }
}
