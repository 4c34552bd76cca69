//! What has to outlive a process, behind small traits: jobs, workers, results, blobs. Each backend runs the
//! same [`conformance`] suite; the rest of the coordinator cannot tell one from another.
//!
//! - [`memory`]: maps, for `brolly render` and tests; nothing survives.
//! - [`embedded`]: SQLite, files named by content and a log of segment files; nothing to install.
//!
//! ```
//! let stores = store::memory::open();
//! let digest = stores.blobs.put(b"a scene").unwrap();
//! assert_eq!(&stores.blobs.get(&digest).unwrap()[..], b"a scene");
//! ```
#![forbid(unsafe_code)]

mod blob;
#[cfg(any(test, feature = "conformance"))]
pub mod conformance;
pub mod embedded;
mod error;
mod job;
mod log;
pub mod memory;
mod worker;

pub use blob::{BlobRead, BlobStore, BlobWriter, Digest};
pub use error::StoreError;
pub use job::{Created, IdempotencyKey, JobStore, StoredJob};
pub use log::{Appended, LogEntry, ResultLog};
pub use worker::WorkerStore;

use std::sync::Arc;

/// An answer that takes time: a commit, a sync to disk, one day a network.
pub type Answer<'a, T> = futures::future::BoxFuture<'a, Result<T, StoreError>>;

/// One backend, ready for use.
#[derive(Clone)]
pub struct Stores {
    /// Jobs.
    pub jobs: Arc<dyn JobStore>,
    /// Workers.
    pub workers: Arc<dyn WorkerStore>,
    /// Acknowledged results that no checkpoint covers yet.
    pub log: Arc<dyn ResultLog>,
    /// Files of scenes, tiles and manifests of checkpoints.
    pub blobs: Arc<dyn BlobStore>,
    /// Whether anything outlives the process. Without it, logging results is a waste.
    pub durable: bool,
}
