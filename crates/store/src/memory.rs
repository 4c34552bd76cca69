//! Maps: for `brolly render` and tests. Nothing survives the process.

use crate::{
    Answer, Appended, BlobRead, BlobStore, BlobWriter, Created, Digest, IdempotencyKey, JobStore,
    LogEntry, ResultLog, StoreError, StoredJob, Stores, WorkerStore,
};
use bytes::Bytes;
use film::Unit;
use std::collections::{BTreeMap, HashMap};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use uuid::Uuid;

/// A new, empty backend.
pub fn open() -> Stores {
    Stores {
        jobs: Arc::new(MemoryJobs::default()),
        workers: Arc::new(MemoryWorkers::default()),
        log: Arc::new(MemoryLog::default()),
        blobs: Arc::new(MemoryBlobs::default()),
        durable: false,
    }
}

/// No invariant spans a panic here: every change is one insertion or removal.
fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

fn ready<'a, T: Send + 'a>(result: Result<T, StoreError>) -> Answer<'a, T> {
    Box::pin(std::future::ready(result))
}

/// Workers in a map.
#[derive(Default)]
pub struct MemoryWorkers(Mutex<BTreeMap<Uuid, Vec<u8>>>);

impl WorkerStore for MemoryWorkers {
    fn put(&self, id: Uuid, record: Vec<u8>) -> Answer<'_, ()> {
        lock(&self.0).insert(id, record);
        ready(Ok(()))
    }

    fn remove(&self, ids: Vec<Uuid>) -> Answer<'_, ()> {
        lock(&self.0).retain(|id, _| !ids.contains(id));
        ready(Ok(()))
    }

    fn list(&self) -> Answer<'_, Vec<(Uuid, Vec<u8>)>> {
        let workers = lock(&self.0);
        ready(Ok(workers.iter().map(|(id, r)| (*id, r.clone())).collect()))
    }
}

/// Jobs in a map.
#[derive(Default)]
pub struct MemoryJobs(Mutex<Jobs>);

#[derive(Default)]
struct Jobs {
    records: BTreeMap<Uuid, (u64, Vec<u8>)>,
    keys: HashMap<String, ([u8; 32], Uuid)>,
}

fn no_job(id: Uuid) -> StoreError {
    StoreError::NotFound {
        what: format!("job {id}"),
    }
}

impl JobStore for MemoryJobs {
    fn create(
        &self,
        id: Uuid,
        key: Option<IdempotencyKey>,
        record: Vec<u8>,
    ) -> Answer<'_, Created> {
        let mut jobs = lock(&self.0);
        if let Some(key) = key {
            if let Some(&(request, existing)) = jobs.keys.get(&key.key) {
                return ready(Ok(if request == key.request {
                    Created::Exists(existing)
                } else {
                    Created::KeyReused(existing)
                }));
            }
            jobs.keys.insert(key.key, (key.request, id));
        }
        if jobs.records.contains_key(&id) {
            return ready(Err(StoreError::Conflict {
                what: format!("job {id}"),
            }));
        }
        jobs.records.insert(id, (1, record));
        ready(Ok(Created::New(1)))
    }

    fn get(&self, id: Uuid) -> Answer<'_, StoredJob> {
        ready(match lock(&self.0).records.get(&id) {
            Some((revision, record)) => Ok(StoredJob {
                id,
                revision: *revision,
                record: record.clone(),
            }),
            None => Err(no_job(id)),
        })
    }

    fn cas(&self, id: Uuid, revision: u64, record: Vec<u8>) -> Answer<'_, u64> {
        ready(match lock(&self.0).records.get_mut(&id) {
            Some(stored) if stored.0 == revision => {
                *stored = (revision + 1, record);
                Ok(revision + 1)
            }
            Some(_) => Err(StoreError::Conflict {
                what: format!("job {id}"),
            }),
            None => Err(no_job(id)),
        })
    }

    fn delete(&self, id: Uuid) -> Answer<'_, ()> {
        let mut jobs = lock(&self.0);
        jobs.records.remove(&id);
        jobs.keys.retain(|_, (_, job)| *job != id);
        ready(Ok(()))
    }

    fn list(&self, before: Option<Uuid>, limit: usize) -> Answer<'_, Vec<StoredJob>> {
        let jobs = lock(&self.0);
        let page = jobs
            .records
            .iter()
            .rev()
            .filter(|(id, _)| before.is_none_or(|b| **id < b))
            .take(limit)
            .map(|(id, (revision, record))| StoredJob {
                id: *id,
                revision: *revision,
                record: record.clone(),
            })
            .collect();
        ready(Ok(page))
    }
}

/// Results in a map.
#[derive(Default)]
pub struct MemoryLog(Mutex<Log>);

#[derive(Default)]
struct Log {
    end: u64,
    entries: BTreeMap<u64, LogEntry>,
    index: HashMap<(Uuid, Unit), u64>,
}

impl ResultLog for MemoryLog {
    fn append(&self, entry: LogEntry) -> Answer<'_, Appended> {
        let mut log = lock(&self.0);
        if let Some(&position) = log.index.get(&(entry.job, entry.unit))
            && let Some(known) = log.entries.get(&position)
        {
            return ready(Ok(if known.digest == entry.digest {
                Appended::Same(position)
            } else {
                Appended::Other {
                    position,
                    digest: known.digest,
                }
            }));
        }
        let position = log.end;
        log.end += 1;
        log.index.insert((entry.job, entry.unit), position);
        log.entries.insert(position, entry);
        ready(Ok(Appended::New(position)))
    }

    fn read(
        &self,
        job: Uuid,
        position: u64,
        each: &mut dyn FnMut(u64, LogEntry) -> Result<(), StoreError>,
    ) -> Result<(), StoreError> {
        let entries: Vec<(u64, LogEntry)> = lock(&self.0)
            .entries
            .range(position..)
            .filter(|(_, e)| e.job == job)
            .map(|(p, e)| (*p, e.clone()))
            .collect();
        entries.into_iter().try_for_each(|(p, e)| each(p, e))
    }

    fn end(&self) -> u64 {
        lock(&self.0).end
    }

    fn forget(&self, job: Uuid, unit: Unit) {
        lock(&self.0).index.remove(&(job, unit));
    }

    fn forget_all(&self, job: Uuid) {
        lock(&self.0).index.retain(|(j, _), _| *j != job);
    }

    fn trim(&self, job: Uuid, position: u64) -> Result<(), StoreError> {
        let mut log = lock(&self.0);
        log.entries.retain(|p, e| e.job != job || *p >= position);
        log.index.retain(|(j, _), p| *j != job || *p >= position);
        Ok(())
    }

    fn jobs(&self) -> Vec<Uuid> {
        let mut jobs: Vec<Uuid> = lock(&self.0).entries.values().map(|e| e.job).collect();
        jobs.sort_unstable();
        jobs.dedup();
        jobs
    }

    fn size_bytes(&self) -> u64 {
        lock(&self.0)
            .entries
            .values()
            .map(|e| e.bytes.len() as u64)
            .sum()
    }
}

type Blobs = Arc<Mutex<BTreeMap<Digest, Bytes>>>;

/// Blobs in a map.
#[derive(Default)]
pub struct MemoryBlobs(Blobs);

fn no_blob(digest: &Digest) -> StoreError {
    StoreError::NotFound {
        what: format!("blob {}", blake3::Hash::from_bytes(*digest)),
    }
}

struct MemoryWriter {
    bytes: Vec<u8>,
    blobs: Blobs,
}

impl BlobWriter for MemoryWriter {
    fn write(&mut self, bytes: &[u8]) -> Result<(), StoreError> {
        self.bytes
            .try_reserve(bytes.len())
            .map_err(|_| StoreError::Full {
                what: "a blob in memory".into(),
            })?;
        self.bytes.extend_from_slice(bytes);
        Ok(())
    }

    fn finish(self: Box<Self>, digest: &Digest) -> Result<(), StoreError> {
        lock(&self.blobs).insert(*digest, self.bytes.into());
        Ok(())
    }
}

impl BlobStore for MemoryBlobs {
    fn put_many(&self, blobs: &[&[u8]]) -> Result<Vec<Digest>, StoreError> {
        Ok(blobs
            .iter()
            .map(|bytes| {
                let digest = *blake3::hash(bytes).as_bytes();
                lock(&self.0)
                    .entry(digest)
                    .or_insert_with(|| Bytes::copy_from_slice(bytes));
                digest
            })
            .collect())
    }

    fn begin(&self) -> Result<Box<dyn BlobWriter>, StoreError> {
        Ok(Box::new(MemoryWriter {
            bytes: Vec::new(),
            blobs: self.0.clone(),
        }))
    }

    fn get(&self, digest: &Digest) -> Result<Bytes, StoreError> {
        lock(&self.0)
            .get(digest)
            .cloned()
            .ok_or_else(|| no_blob(digest))
    }

    fn open(&self, digest: &Digest) -> Result<BlobRead, StoreError> {
        let bytes = self.get(digest)?;
        Ok(BlobRead {
            size_bytes: bytes.len() as u64,
            reader: Box::new(std::io::Cursor::new(bytes)),
        })
    }

    fn size(&self, digest: &Digest) -> Result<Option<u64>, StoreError> {
        Ok(lock(&self.0).get(digest).map(|b| b.len() as u64))
    }

    fn list(&self) -> Result<Vec<Digest>, StoreError> {
        Ok(lock(&self.0).keys().copied().collect())
    }

    fn remove(&self, digest: &Digest) -> Result<(), StoreError> {
        lock(&self.0).remove(digest);
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use crate::conformance::{self, Backend};

    #[test]
    fn conforms() {
        conformance::run(&mut Backend::volatile(super::open));
    }
}
