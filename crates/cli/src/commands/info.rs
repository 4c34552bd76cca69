//! `brolly info`: what this program is, and whether a coordinator is well.

use super::{print_json, print_line};
use crate::args::InfoArgs;
use client::{Client, RetryPolicy};
use serde::Serialize;
use std::process::ExitCode;
use std::time::Duration;

#[derive(Serialize)]
struct Info {
    version: &'static str,
    engine_version: u32,
    simd: &'static str,
    threads: usize,
}

pub async fn run(args: InfoArgs) -> anyhow::Result<ExitCode> {
    let info = Info {
        version: env!("CARGO_PKG_VERSION"),
        engine_version: film::ENGINE_VERSION.0,
        simd: tracer::simd_level(),
        threads: std::thread::available_parallelism().map_or(1, usize::from),
    };
    if args.json {
        print_json(&info)?;
    } else {
        print_line(&format!("brolly {}", info.version))?;
        print_line(&format!("engine version {}", info.engine_version))?;
        print_line(&format!("SIMD level {}", info.simd))?;
        print_line(&format!("threads {}", info.threads))?;
    }
    if let Some(url) = args.health {
        // A container's health check: one try, no patience.
        Client::new(&url, None)?
            .with_retry(RetryPolicy::NEVER)
            .with_timeout(Duration::from_secs(3))
            .healthy()
            .await?;
    }
    Ok(ExitCode::SUCCESS)
}
