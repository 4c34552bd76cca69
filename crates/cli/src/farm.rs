//! A coordinator and workers in this process.

use anyhow::Context;
use coordinator::{Config, Coordinator};
use std::net::SocketAddr;
use tokio::net::TcpListener;
use tokio::task::JoinHandle;
use tokio_util::sync::CancellationToken;
use worker::WorkerConfig;

/// Running parts; dropped, they are told to stop.
pub struct Farm {
    /// Where the coordinator listens.
    pub address: SocketAddr,
    shutdown: CancellationToken,
    coordinator: JoinHandle<anyhow::Result<()>>,
    workers: Vec<JoinHandle<anyhow::Result<()>>>,
    worker_shutdown: CancellationToken,
}

/// Workers to start beside a coordinator.
#[derive(Clone, Debug, Default)]
pub struct Crew {
    /// How many.
    pub workers: usize,
    /// Threads of each; all cores are shared out where that is not said.
    pub threads: Option<usize>,
    /// Secret with the scope `work`.
    pub token: Option<String>,
}

impl Farm {
    /// Starts all parts.
    pub async fn start(listener: TcpListener, config: Config, crew: &Crew) -> anyhow::Result<Farm> {
        // Takes up what is in the store first: whoever reads the address can use it.
        let bound = Coordinator::on(listener, config)
            .await
            .context("the coordinator cannot start")?;
        let address = bound.local_addr();
        let (shutdown, worker_shutdown) = (CancellationToken::new(), CancellationToken::new());
        let stop = shutdown.clone();
        let coordinator =
            tokio::spawn(async move { bound.run(stop).await.context("the coordinator stopped") });
        let cores = std::thread::available_parallelism().map_or(1, usize::from);
        let threads = crew
            .threads
            .unwrap_or_else(|| (cores / crew.workers.max(1)).max(1));
        let workers = (0..crew.workers)
            .map(|index| {
                let mut config = WorkerConfig::new(format!("http://{}", reachable(address)));
                config.name = format!("{}-{}", config.name, index + 1);
                config.token = crew.token.clone();
                config.threads = threads;
                config.memory_bytes /= crew.workers as u64;
                let stop = worker_shutdown.clone();
                tokio::spawn(async move {
                    worker::run(config, stop)
                        .await
                        .context("the worker stopped")
                })
            })
            .collect();
        Ok(Farm {
            address,
            shutdown,
            coordinator,
            workers,
            worker_shutdown,
        })
    }

    /// Returns when a part ends by itself, which it should not.
    pub async fn failed(&mut self) -> anyhow::Error {
        let coordinator = &mut self.coordinator;
        let ended = if self.workers.is_empty() {
            coordinator.await
        } else {
            let workers = futures::future::select_all(self.workers.iter_mut());
            tokio::select! {
                ended = coordinator => ended,
                (ended, _, _) = workers => ended,
            }
        };
        match ended {
            Ok(Ok(())) => anyhow::anyhow!("a part of the farm ended"),
            Ok(Err(error)) => error,
            Err(error) => error.into(),
        }
    }

    /// Stops the workers, which give back what they hold, then the coordinator, which writes its
    /// state down.
    pub async fn stop(self) -> anyhow::Result<()> {
        self.worker_shutdown.cancel();
        for worker in self.workers {
            worker.await??;
        }
        self.shutdown.cancel();
        self.coordinator.await?
    }
}

/// An address that this machine can connect to.
fn reachable(address: SocketAddr) -> SocketAddr {
    match address {
        SocketAddr::V4(v4) if v4.ip().is_unspecified() => {
            SocketAddr::from(([127, 0, 0, 1], v4.port()))
        }
        SocketAddr::V6(v6) if v6.ip().is_unspecified() => {
            SocketAddr::from((std::net::Ipv6Addr::LOCALHOST, v6.port()))
        }
        other => other,
    }
}
