//! Workers that a coordinator knows.

use crate::Answer;
use uuid::Uuid;

/// What is kept of workers, so that a restart forgets none that was taken out. A write that was
/// answered survives the process. The store does not look into the records.
pub trait WorkerStore: Send + Sync {
    /// Writes the record of a worker, in the place of the one before.
    fn put(&self, id: Uuid, record: Vec<u8>) -> Answer<'_, ()>;
    /// Removes workers. Removing twice is no error.
    fn remove(&self, ids: Vec<Uuid>) -> Answer<'_, ()>;
    /// All of them, the oldest first.
    fn list(&self) -> Answer<'_, Vec<(Uuid, Vec<u8>)>>;
}
