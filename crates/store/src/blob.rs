//! Bytes by content. These calls block: make them from a thread that may.

use crate::StoreError;
use bytes::Bytes;
use std::io::Read;

/// BLAKE3 of the bytes.
pub type Digest = [u8; 32];

/// A blob opened for reading.
pub struct BlobRead {
    /// Its size.
    pub size_bytes: u64,
    /// Its bytes, unchecked: whoever needs certainty hashes them.
    pub reader: Box<dyn Read + Send>,
}

/// A blob that is being written. Dropped without [`BlobWriter::finish`] it leaves nothing behind.
pub trait BlobWriter: Send {
    /// Adds bytes.
    fn write(&mut self, bytes: &[u8]) -> Result<(), StoreError>;
    /// Ends it: it is durable on return. `digest` must be that of all bytes written; the caller
    /// computed it on the way.
    fn finish(self: Box<Self>, digest: &Digest) -> Result<(), StoreError>;
}

/// Immutable bytes, named by BLAKE3.
pub trait BlobStore: Send + Sync {
    /// Stores bytes; durable on return.
    fn put(&self, bytes: &[u8]) -> Result<Digest, StoreError> {
        Ok(self.put_many(&[bytes])?.remove(0))
    }
    /// Stores several at once, which costs less than one by one; all durable on return.
    fn put_many(&self, blobs: &[&[u8]]) -> Result<Vec<Digest>, StoreError>;
    /// Begins to write a blob in pieces.
    fn begin(&self) -> Result<Box<dyn BlobWriter>, StoreError>;
    /// The bytes, checked against their name.
    fn get(&self, digest: &Digest) -> Result<Bytes, StoreError>;
    /// Opens it for streaming.
    fn open(&self, digest: &Digest) -> Result<BlobRead, StoreError>;
    /// Its size, if it is there.
    fn size(&self, digest: &Digest) -> Result<Option<u64>, StoreError>;
    /// All blobs.
    fn list(&self) -> Result<Vec<Digest>, StoreError>;
    /// Removes one. Removing twice is no error.
    fn remove(&self, digest: &Digest) -> Result<(), StoreError>;
}
