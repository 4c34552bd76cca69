//! The coordinator: takes scenes and jobs over HTTP, leases units to workers, merges what they
//! send into films, and shows them while they converge. It never traces a ray.
//!
//! ```no_run
//! # async fn example() -> Result<(), coordinator::ServeError> {
//! use tokio_util::sync::CancellationToken;
//! let config = coordinator::Config::default(); // in memory
//! let coordinator = coordinator::Coordinator::bind("127.0.0.1:0", config).await?;
//! println!("http://{}", coordinator.local_addr());
//! let shutdown = CancellationToken::new();
//! coordinator.run(shutdown).await
//! # }
//! ```
#![forbid(unsafe_code)]

mod audit;
mod auth;
mod checkpoint;
mod clock;
pub mod config;
mod control;
pub mod error;
mod events;
mod farm;
mod films;
mod import;
mod job;
mod linger;
mod metrics;
mod openapi;
mod owner;
mod plan;
mod record;
mod refs;
mod reopen;
mod results;
mod roster;
mod routes;
mod server;
mod status;
mod submit;
mod sync;
mod ticker;
mod worker;

#[cfg(test)]
mod tests;

pub use config::{Config, ConfigError, Limits, Scope, StoreConfig, Token};
pub use openapi::document as openapi_document;

use farm::Farm;
use std::net::SocketAddr;
use std::sync::Arc;
use std::time::Duration;
use store::{StoreError, Stores};
use tokio::net::{TcpListener, ToSocketAddrs};
use tokio_util::sync::CancellationToken;

/// How long open connections may go on after the end was asked for.
const GRACE: Duration = Duration::from_secs(5);

/// Why the coordinator cannot serve.
#[derive(Debug, thiserror::Error)]
pub enum ServeError {
    /// The address cannot be listened on.
    #[error("cannot listen on the address")]
    Listen(#[source] std::io::Error),
    /// It is told things that do not go together.
    #[error(transparent)]
    Config(#[from] ConfigError),
    /// The store cannot be used.
    #[error(transparent)]
    Store(#[from] StoreError),
    /// A mistake of this program.
    #[error("the start crashed")]
    Panicked,
}

/// A coordinator that listens and has taken up what is in its store.
pub struct Coordinator {
    listener: TcpListener,
    address: SocketAddr,
    farm: Arc<Farm>,
}

impl Coordinator {
    /// Listens on an address; port 0 takes a free one.
    pub async fn bind(address: impl ToSocketAddrs, config: Config) -> Result<Self, ServeError> {
        let listener = TcpListener::bind(address)
            .await
            .map_err(ServeError::Listen)?;
        Self::on(listener, config).await
    }

    /// The same on a listener that is there already.
    pub async fn on(listener: TcpListener, config: Config) -> Result<Self, ServeError> {
        let address = check_address(&listener, &config)?;
        let farm = Farm::start(config).await?;
        Ok(Coordinator {
            listener,
            address,
            farm,
        })
    }

    /// The same with stores that are open already: for tests that make storage fail.
    pub async fn with_stores(
        listener: TcpListener,
        config: Config,
        stores: Stores,
    ) -> Result<Self, ServeError> {
        let address = check_address(&listener, &config)?;
        let farm = Farm::with_stores(config, stores).await?;
        Ok(Coordinator {
            listener,
            address,
            farm,
        })
    }

    /// Where it listens.
    pub fn local_addr(&self) -> SocketAddr {
        self.address
    }

    /// Serves until `shutdown`, then writes last checkpoints.
    pub async fn run(self, shutdown: CancellationToken) -> Result<(), ServeError> {
        let router = routes::router(self.farm.clone(), self.address.ip().is_loopback());
        let stop = shutdown.child_token();
        let serving = server::serve(self.listener, router, &self.farm.config, stop.clone());
        tokio::select! {
            () = serving => {}
            error = self.farm.broken() => {
                // No last checkpoints: what the disk holds is unknown, and the next start reads it.
                tracing::error!(%error, "the store is broken: this process ends");
                stop.cancel();
                self.farm.shutdown.cancel();
                return Err(ServeError::Store(error));
            }
            () = async {
                shutdown.cancelled().await;
                // Long polls and event streams end by it.
                self.farm.shutdown.cancel();
                tokio::time::sleep(GRACE).await;
            } => {}
        }
        self.farm.close().await;
        Ok(())
    }
}

/// Serves on a listener until `shutdown`.
pub async fn serve(
    listener: TcpListener,
    config: Config,
    shutdown: CancellationToken,
) -> Result<(), ServeError> {
    Coordinator::on(listener, config).await?.run(shutdown).await
}

fn check_address(listener: &TcpListener, config: &Config) -> Result<SocketAddr, ServeError> {
    let address = listener.local_addr().map_err(ServeError::Listen)?;
    check_open(&address, config)?;
    Ok(address)
}

/// Off loopback somebody has to say who may do what.
fn check_open(address: &SocketAddr, config: &Config) -> Result<(), ConfigError> {
    let open = config.tokens.is_empty() && !config.insecure;
    if open && !address.ip().is_loopback() {
        return Err(ConfigError::OpenToAll);
    }
    Ok(())
}
