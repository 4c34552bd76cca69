//! Job records.

use crate::Answer;
use uuid::Uuid;

/// A job record as it lies in the store. The store does not look into it.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct StoredJob {
    /// UUIDv7: ids sort by age.
    pub id: Uuid,
    /// Rises with every change.
    pub revision: u64,
    /// The coordinator's bytes.
    pub record: Vec<u8>,
}

/// Makes a repeated submission one job.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct IdempotencyKey {
    /// What the client sent, within its own scope.
    pub key: String,
    /// Digest of the request that it came with.
    pub request: [u8; 32],
}

/// What became of [`JobStore::create`].
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Created {
    /// A new job at this revision.
    New(u64),
    /// The key was used before for the same request: this job.
    Exists(Uuid),
    /// The key was used before for another request.
    KeyReused(Uuid),
}

/// Job records with compare-and-set. A write that was answered survives the process.
pub trait JobStore: Send + Sync {
    /// Adds a job.
    fn create(&self, id: Uuid, key: Option<IdempotencyKey>, record: Vec<u8>)
    -> Answer<'_, Created>;
    /// Reads a job.
    fn get(&self, id: Uuid) -> Answer<'_, StoredJob>;
    /// Replaces the record if it still has `revision`; returns the new revision.
    fn cas(&self, id: Uuid, revision: u64, record: Vec<u8>) -> Answer<'_, u64>;
    /// Removes a job and its idempotency keys. Removing twice is no error.
    fn delete(&self, id: Uuid) -> Answer<'_, ()>;
    /// Jobs from the newest to the oldest, those older than `before`.
    fn list(&self, before: Option<Uuid>, limit: usize) -> Answer<'_, Vec<StoredJob>>;
}
