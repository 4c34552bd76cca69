//! `brolly serve`: a coordinator, and workers beside it if wanted.

use crate::args::{ServeArgs, StoreArg};
use crate::exit::Usage;
use crate::farm::{Crew, Farm};
use anyhow::Context;
use coordinator::{Config, Scope, StoreConfig, Token};
use std::process::ExitCode;
use tokio::net::TcpListener;
use tokio::signal::unix::{SignalKind, signal};

pub async fn run(args: ServeArgs) -> anyhow::Result<ExitCode> {
    let mut tokens = args.tokens.clone();
    let mut token = None;
    if args.workers > 0 && !tokens.is_empty() {
        // Workers in this process need a secret like any other; nobody else learns it.
        let secret = format!(
            "{:032x}{:032x}",
            rand::random::<u128>(),
            rand::random::<u128>()
        );
        tokens.push(Token::new(Scope::Work, &secret).map_err(|e| Usage(e.to_string()))?);
        token = Some(secret);
    }
    let config = Config {
        store: match args.store {
            StoreArg::Embedded => StoreConfig::Embedded(args.data.clone()),
            StoreArg::Memory => StoreConfig::Memory,
        },
        tokens,
        insecure: args.insecure,
        ..Config::default()
    };
    let listener = TcpListener::bind(args.listen)
        .await
        .with_context(|| format!("cannot listen on {}", args.listen))?;
    let crew = Crew {
        workers: args.workers.into(),
        threads: args.threads.map(usize::from),
        token,
    };
    let mut terminate = signal(SignalKind::terminate())?;
    let mut farm = Farm::start(listener, config, &crew).await?;
    tracing::info!(
        address = %farm.address,
        store = ?args.store,
        data = %args.data.display(),
        tokens = args.tokens.len(),
        insecure = args.insecure,
        workers = args.workers,
        version = env!("CARGO_PKG_VERSION"),
        engine_version = %film::ENGINE_VERSION,
        "brolly serves on http://{}",
        farm.address,
    );
    tokio::select! {
        error = farm.failed() => return Err(error),
        _ = terminate.recv() => {}
        _ = tokio::signal::ctrl_c() => {}
    }
    tracing::info!("stopping");
    farm.stop().await?;
    Ok(ExitCode::SUCCESS)
}
