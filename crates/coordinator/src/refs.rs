//! Which blobs are needed, and by how many: what nobody needs any more is removed.

use protocol::TimestampMs;
use std::collections::{BTreeMap, BTreeSet};
use std::sync::{Arc, Mutex, PoisonError};
use store::{BlobStore, Digest, StoreError};

/// Counts of holders by blob.
pub struct BlobRefs {
    blobs: Arc<dyn BlobStore>,
    counts: Mutex<BTreeMap<Digest, u32>>,
}

impl BlobRefs {
    /// Nothing is held yet.
    pub fn new(blobs: Arc<dyn BlobStore>) -> Self {
        BlobRefs {
            blobs,
            counts: Mutex::default(),
        }
    }

    /// Holds blobs, whether they are there yet or not: hold first, write after, so that no removal
    /// comes between.
    pub fn hold(&self, digests: impl IntoIterator<Item = Digest>) {
        let mut counts = self.counts.lock().unwrap_or_else(PoisonError::into_inner);
        for digest in digests {
            *counts.entry(digest).or_insert(0) += 1;
        }
    }

    /// Lets go of blobs; those that nobody holds any more are removed.
    pub fn release(&self, digests: impl IntoIterator<Item = Digest>) {
        let mut counts = self.counts.lock().unwrap_or_else(PoisonError::into_inner);
        for digest in digests {
            match counts.get_mut(&digest) {
                Some(count) if *count > 1 => *count -= 1,
                _ => {
                    counts.remove(&digest);
                    // Under the lock: whoever holds it anew writes it anew.
                    if let Err(error) = self.blobs.remove(&digest) {
                        tracing::warn!(%error, "a blob that nobody needs could not be removed");
                    }
                }
            }
        }
    }

    /// Lets go of blobs without removing any: uploads whose job was refused may be submitted again.
    pub fn release_kept(&self, digests: impl IntoIterator<Item = Digest>) {
        let mut counts = self.counts.lock().unwrap_or_else(PoisonError::into_inner);
        for digest in digests {
            match counts.get_mut(&digest) {
                Some(count) if *count > 1 => *count -= 1,
                _ => drop(counts.remove(&digest)),
            }
        }
    }

    /// Removes blobs that nobody holds unless they are in `young`: uploads whose job is to come.
    pub fn sweep(&self, young: &BTreeMap<Digest, TimestampMs>) -> Result<usize, StoreError> {
        let all = self.blobs.list()?;
        let counts = self.counts.lock().unwrap_or_else(PoisonError::into_inner);
        let mut removed = 0;
        for digest in all {
            if !counts.contains_key(&digest) && !young.contains_key(&digest) {
                self.blobs.remove(&digest)?;
                removed += 1;
            }
        }
        Ok(removed)
    }

    /// Those that somebody holds.
    pub fn held(&self) -> BTreeSet<Digest> {
        let counts = self.counts.lock().unwrap_or_else(PoisonError::into_inner);
        counts.keys().copied().collect()
    }
}
