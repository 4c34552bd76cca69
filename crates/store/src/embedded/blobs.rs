//! Blobs as files named by BLAKE3: written aside, synced, renamed, folder synced.

use super::{FolderLock, sync_folder};
use crate::{BlobRead, BlobStore, BlobWriter, Digest, StoreError};
use bytes::Bytes;
use std::fs::File;
use std::io::{Read, Write};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, AtomicUsize, Ordering};

/// Syncs that are under way at once: the disk merges them, so that a checkpoint of hundreds of
/// tiles does not wait for each in turn.
const SYNCS_AT_ONCE: usize = 8;

/// Blobs in a folder.
pub(super) struct FileBlobs {
    folder: PathBuf,
    aside: PathBuf,
    next: AtomicU64,
    _lock: Arc<FolderLock>,
}

fn name(digest: &Digest) -> String {
    blake3::Hash::from_bytes(*digest).to_hex().to_string()
}

fn what(digest: &Digest) -> String {
    format!("blob {}", name(digest))
}

impl FileBlobs {
    pub fn open(folder: &Path, lock: Arc<FolderLock>) -> Result<Self, StoreError> {
        let aside = folder.join("aside");
        let io = |e: std::io::Error| StoreError::io(&folder.display().to_string(), &e);
        // What lies aside was never finished.
        match std::fs::remove_dir_all(&aside) {
            Err(e) if e.kind() != std::io::ErrorKind::NotFound => return Err(io(e)),
            _ => {}
        }
        std::fs::create_dir_all(&aside).map_err(io)?;
        sync_folder(folder)?;
        Ok(FileBlobs {
            folder: folder.to_owned(),
            aside,
            next: AtomicU64::new(0),
            _lock: lock,
        })
    }

    fn path(&self, digest: &Digest) -> PathBuf {
        self.folder.join(name(digest))
    }

    fn writer(&self) -> Result<FileWriter, StoreError> {
        let number = self.next.fetch_add(1, Ordering::Relaxed);
        let path = self.aside.join(number.to_string());
        let file = File::create_new(&path).map_err(|e| StoreError::io("a blob", &e))?;
        Ok(FileWriter {
            file,
            aside: Some(path),
            folder: self.folder.clone(),
        })
    }

    /// Everything but syncing the folder.
    fn put_unsynced(&self, bytes: &[u8]) -> Result<Digest, StoreError> {
        let digest = *blake3::hash(bytes).as_bytes();
        if self.size(&digest)? != Some(bytes.len() as u64) {
            let mut writer = self.writer()?;
            writer.write(bytes)?;
            writer.place(&digest)?;
        }
        Ok(digest)
    }
}

struct FileWriter {
    file: File,
    /// None once it has its final name.
    aside: Option<PathBuf>,
    folder: PathBuf,
}

impl FileWriter {
    fn place(&mut self, digest: &Digest) -> Result<(), StoreError> {
        let io = |e: std::io::Error| StoreError::io(&what(digest), &e);
        self.file.sync_all().map_err(io)?;
        if let Some(aside) = self.aside.take() {
            std::fs::rename(&aside, self.folder.join(name(digest))).map_err(|e| {
                self.aside = Some(aside.clone());
                io(e)
            })?;
        }
        Ok(())
    }
}

impl BlobWriter for FileWriter {
    fn write(&mut self, bytes: &[u8]) -> Result<(), StoreError> {
        self.file
            .write_all(bytes)
            .map_err(|e| StoreError::io("a blob", &e))
    }

    fn finish(mut self: Box<Self>, digest: &Digest) -> Result<(), StoreError> {
        self.place(digest)?;
        sync_folder(&self.folder)
    }
}

impl Drop for FileWriter {
    fn drop(&mut self) {
        if let Some(aside) = &self.aside {
            // Best effort: the next start clears the folder anyway.
            let _ = std::fs::remove_file(aside);
        }
    }
}

impl BlobStore for FileBlobs {
    fn put_many(&self, blobs: &[&[u8]]) -> Result<Vec<Digest>, StoreError> {
        let mut results: Vec<Option<Result<Digest, StoreError>>> = vec![None; blobs.len()];
        if blobs.len() <= 1 {
            for (result, bytes) in results.iter_mut().zip(blobs) {
                *result = Some(self.put_unsynced(bytes));
            }
        } else {
            let next = AtomicUsize::new(0);
            let done = std::sync::Mutex::new(&mut results);
            std::thread::scope(|scope| {
                for _ in 0..SYNCS_AT_ONCE.min(blobs.len()) {
                    scope.spawn(|| {
                        loop {
                            let index = next.fetch_add(1, Ordering::Relaxed);
                            let Some(bytes) = blobs.get(index) else {
                                break;
                            };
                            let result = self.put_unsynced(bytes);
                            if let Ok(mut done) = done.lock() {
                                done[index] = Some(result);
                            }
                        }
                    });
                }
            });
        }
        sync_folder(&self.folder)?;
        results
            .into_iter()
            .map(|r| {
                r.unwrap_or(Err(StoreError::Unavailable {
                    reason: "a blob was not written".into(),
                }))
            })
            .collect()
    }

    fn begin(&self) -> Result<Box<dyn BlobWriter>, StoreError> {
        Ok(Box::new(self.writer()?))
    }

    fn get(&self, digest: &Digest) -> Result<Bytes, StoreError> {
        let bytes =
            std::fs::read(self.path(digest)).map_err(|e| StoreError::io(&what(digest), &e))?;
        if blake3::hash(&bytes).as_bytes() != digest {
            return Err(StoreError::Damaged { what: what(digest) });
        }
        Ok(bytes.into())
    }

    fn open(&self, digest: &Digest) -> Result<BlobRead, StoreError> {
        let io = |e: std::io::Error| StoreError::io(&what(digest), &e);
        let file = File::open(self.path(digest)).map_err(io)?;
        let size_bytes = file.metadata().map_err(io)?.len();
        Ok(BlobRead {
            size_bytes,
            reader: Box::new(file.take(size_bytes)),
        })
    }

    fn size(&self, digest: &Digest) -> Result<Option<u64>, StoreError> {
        match std::fs::metadata(self.path(digest)) {
            Ok(about) => Ok(Some(about.len())),
            Err(e) if e.kind() == std::io::ErrorKind::NotFound => Ok(None),
            Err(e) => Err(StoreError::io(&what(digest), &e)),
        }
    }

    fn list(&self) -> Result<Vec<Digest>, StoreError> {
        let io = |e: std::io::Error| StoreError::io("the folder of blobs", &e);
        let mut digests = Vec::new();
        for entry in std::fs::read_dir(&self.folder).map_err(io)? {
            let name = entry.map_err(io)?.file_name();
            if let Some(hash) = name
                .to_str()
                .and_then(|n| blake3::Hash::from_hex(n.as_bytes()).ok())
            {
                digests.push(*hash.as_bytes());
            }
        }
        digests.sort_unstable();
        Ok(digests)
    }

    fn remove(&self, digest: &Digest) -> Result<(), StoreError> {
        match std::fs::remove_file(self.path(digest)) {
            Err(e) if e.kind() != std::io::ErrorKind::NotFound => {
                Err(StoreError::io(&what(digest), &e))
            }
            _ => Ok(()),
        }
    }
}
