//! The default backend: one folder, nothing to install. SQLite for jobs, files named by BLAKE3 for
//! blobs, segment files for the result log. One process at a time holds the folder.

mod blobs;
mod jobs;
mod log;
mod segment;
mod workers;

use crate::{StoreError, Stores};
use std::fs::{File, OpenOptions};
use std::io::{Read, Seek, Write};
use std::path::Path;
use std::sync::Arc;

/// Bounds of the backend.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Options {
    /// A segment of the log ends at the first result past this size.
    pub segment_bytes: u64,
    /// Results are refused as [`StoreError::Full`] when the log would grow past this.
    pub log_bytes_max: u64,
}

impl Default for Options {
    fn default() -> Self {
        Options {
            // Large enough that creating one is rare, small enough that trimming frees space soon.
            segment_bytes: 64 << 20,
            log_bytes_max: 256 << 30,
        }
    }
}

/// Opens the folder, or creates it. Blocks: the log is read once from end to end.
pub fn open(folder: &Path, options: Options) -> Result<Stores, StoreError> {
    let io = |e: std::io::Error| StoreError::io(&folder.display().to_string(), &e);
    std::fs::create_dir_all(folder).map_err(io)?;
    let lock = Arc::new(lock(folder)?);
    let database = Arc::new(jobs::SqliteJobs::open(
        &folder.join("jobs.sqlite"),
        lock.clone(),
    )?);
    Ok(Stores {
        jobs: database.clone(),
        workers: database,
        log: Arc::new(log::SegmentLog::open(
            &folder.join("log"),
            options,
            lock.clone(),
        )?),
        blobs: Arc::new(blobs::FileBlobs::open(&folder.join("blobs"), lock)?),
        durable: true,
    })
}

/// Holds the folder for as long as it lives. The system frees it when the process ends, however.
pub(crate) struct FolderLock(#[allow(dead_code)] File);

fn lock(folder: &Path) -> Result<FolderLock, StoreError> {
    let path = folder.join("lock");
    let io = |e: std::io::Error| StoreError::io(&path.display().to_string(), &e);
    let mut file = OpenOptions::new()
        .create(true)
        .truncate(false)
        .read(true)
        .write(true)
        .open(&path)
        .map_err(io)?;
    match file.try_lock() {
        Ok(()) => {}
        Err(std::fs::TryLockError::WouldBlock) => {
            let mut who = String::new();
            let _ = Read::by_ref(&mut file).take(200).read_to_string(&mut who);
            return Err(StoreError::Locked {
                what: folder.display().to_string(),
                who: if who.trim().is_empty() {
                    "another process".into()
                } else {
                    who.trim().into()
                },
            });
        }
        Err(std::fs::TryLockError::Error(e)) => return Err(io(e)),
    }
    file.set_len(0).map_err(io)?;
    file.rewind().map_err(io)?;
    writeln!(file, "process {}", std::process::id()).map_err(io)?;
    file.sync_all().map_err(io)?;
    Ok(FolderLock(file))
}

/// Makes what was created, renamed or removed in a folder durable.
pub(crate) fn sync_folder(folder: &Path) -> Result<(), StoreError> {
    File::open(folder)
        .and_then(|f| f.sync_all())
        .map_err(|e| StoreError::io(&folder.display().to_string(), &e))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::conformance::{self, Backend};

    #[test]
    fn conforms() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().to_owned();
        let options = Options {
            segment_bytes: 4000,
            ..Options::default()
        };
        conformance::run(&mut Backend::kept(move || open(&path, options).unwrap()));
    }

    #[test]
    fn one_process_holds_the_folder() {
        let folder = tempfile::tempdir().unwrap();
        let first = open(folder.path(), Options::default()).unwrap();
        match open(folder.path(), Options::default()).map(|_| ()) {
            Err(StoreError::Locked { who, .. }) => {
                assert_eq!(who, format!("process {}", std::process::id()));
            }
            other => panic!("{other:?}"),
        }
        drop(first);
        assert!(open(folder.path(), Options::default()).is_ok());
    }
}
