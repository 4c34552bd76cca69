//! The log of results: what makes 201 mean durable before a checkpoint covers it.

use crate::{Answer, Digest, StoreError};
use bytes::Bytes;
use film::Unit;
use uuid::Uuid;

/// A result as it arrived.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct LogEntry {
    /// Of which job.
    pub job: Uuid,
    /// Which unit.
    pub unit: Unit,
    /// BLAKE3 of the bytes.
    pub digest: Digest,
    /// Who rendered it.
    pub worker: Uuid,
    /// The encoded sums.
    pub bytes: Bytes,
}

/// What became of an append.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Appended {
    /// Durable at this position.
    New(u64),
    /// The same bytes are durable at this position.
    Same(u64),
    /// Other bytes of the same unit are there; nothing was written.
    Other {
        /// Their position.
        position: u64,
        /// Their digest.
        digest: Digest,
    },
}

/// An append-only log. Positions only rise, over all jobs.
pub trait ResultLog: Send + Sync {
    /// Adds a result, unless one of the same unit is there. Durable on return.
    fn append(&self, entry: LogEntry) -> Answer<'_, Appended>;
    /// Calls `each` with the results of a job from `position` on, in their order. Blocks.
    fn read(
        &self,
        job: Uuid,
        position: u64,
        each: &mut dyn FnMut(u64, LogEntry) -> Result<(), StoreError>,
    ) -> Result<(), StoreError>;
    /// Everything appended from now on gets this position or a later one.
    fn end(&self) -> u64;
    /// The bytes of a unit are void: others may be appended. What was written is still read.
    fn forget(&self, job: Uuid, unit: Unit);
    /// Whatever is there of a job, its units may be appended again: whoever read it knows what
    /// counts. What was written is still read.
    fn forget_all(&self, job: Uuid);
    /// The results of a job before `position` are no longer needed.
    fn trim(&self, job: Uuid, position: u64) -> Result<(), StoreError>;
    /// Nothing of a job is needed any more.
    fn purge(&self, job: Uuid) -> Result<(), StoreError> {
        self.trim(job, u64::MAX)
    }
    /// Jobs that have results here.
    fn jobs(&self) -> Vec<Uuid>;
    /// Bytes in use.
    fn size_bytes(&self) -> u64;
}
