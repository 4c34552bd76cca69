//! The result log: segment files, one writer that syncs once for everything that waits.
//!
//! A failed sync poisons the log: what the system then holds is unknown, and asking again would
//! report success for bytes that are lost. A full disk does not: the tail is cut back and the
//! results are refused.

use super::segment::{self, SEGMENT_HEAD};
use super::{FolderLock, Options, sync_folder};
use crate::{Answer, Appended, Digest, LogEntry, ResultLog, StoreError};
use film::Unit;
use std::collections::{BTreeMap, HashMap};
use std::fs::{File, OpenOptions};
use std::io::{Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError, mpsc};
use tokio::sync::oneshot;
use uuid::Uuid;

/// Most results behind one sync.
const GROUP_MAX: usize = 256;
/// Most bytes behind one sync: what waits longer than a few milliseconds gains nothing.
const GROUP_BYTES_MAX: u64 = 32 << 20;

type Waiting = (LogEntry, oneshot::Sender<Result<Appended, StoreError>>);

/// A log in a folder.
pub(super) struct SegmentLog {
    index: Arc<Mutex<Index>>,
    work: Option<mpsc::Sender<Waiting>>,
    thread: Option<std::thread::JoinHandle<()>>,
    _lock: Arc<FolderLock>,
}

/// Where everything is.
struct Index {
    folder: PathBuf,
    /// By position of their first frame. The last one is being written.
    segments: BTreeMap<u64, Segment>,
    jobs: HashMap<Uuid, HashMap<Unit, (u64, Digest)>>,
    /// Position behind the last durable frame.
    end: u64,
}

struct Segment {
    path: PathBuf,
    file: Arc<File>,
    /// Offset behind the last durable frame.
    end: u64,
    /// The last position of each job that still needs this segment.
    needed: HashMap<Uuid, u64>,
}

impl Index {
    fn note(&mut self, base: u64, position: u64, entry: &LogEntry) {
        if let Some(segment) = self.segments.get_mut(&base) {
            segment.needed.insert(entry.job, position);
        }
        self.jobs
            .entry(entry.job)
            .or_default()
            .insert(entry.unit, (position, entry.digest));
    }

    fn size_bytes(&self) -> u64 {
        self.segments.values().map(|s| s.end).sum()
    }
}

fn lock(index: &Mutex<Index>) -> MutexGuard<'_, Index> {
    index.lock().unwrap_or_else(PoisonError::into_inner)
}

fn io(error: std::io::Error) -> StoreError {
    StoreError::io("the result log", &error)
}

fn closed() -> StoreError {
    StoreError::Unavailable {
        reason: "the result log is closed".into(),
    }
}

impl SegmentLog {
    pub fn open(
        folder: &Path,
        options: Options,
        folder_lock: Arc<FolderLock>,
    ) -> Result<Self, StoreError> {
        std::fs::create_dir_all(folder).map_err(io)?;
        let index = Arc::new(Mutex::new(load(folder)?));
        let (work, queue) = mpsc::channel();
        let writer = Writer {
            index: index.clone(),
            options,
            current: None,
            poisoned: None,
        };
        let thread = std::thread::Builder::new()
            .name("result-log".into())
            .spawn(move || writer.run(queue))
            .map_err(io)?;
        Ok(SegmentLog {
            index,
            work: Some(work),
            thread: Some(thread),
            _lock: folder_lock,
        })
    }
}

impl Drop for SegmentLog {
    fn drop(&mut self) {
        self.work = None;
        if let Some(thread) = self.thread.take() {
            let _ = thread.join();
        }
    }
}

/// Reads all segments. A torn tail of the last one is cut; anything else unreadable is an error.
fn load(folder: &Path) -> Result<Index, StoreError> {
    let mut paths: Vec<PathBuf> = Vec::new();
    for entry in std::fs::read_dir(folder).map_err(io)? {
        let path = entry.map_err(io)?.path();
        if path.extension().is_some_and(|e| e == "segment") {
            paths.push(path);
        }
    }
    paths.sort(); // names are positions with leading zeros
    let mut index = Index {
        folder: folder.to_owned(),
        segments: BTreeMap::new(),
        jobs: HashMap::new(),
        end: 0,
    };
    for (number, path) in paths.iter().enumerate() {
        let last = number + 1 == paths.len();
        let file = OpenOptions::new()
            .read(true)
            .write(true)
            .open(path)
            .map_err(io)?;
        let mut found = Vec::new();
        let scanned = segment::scan(path, &file, last, &mut |position, mut entry| {
            entry.bytes = bytes::Bytes::new(); // only its name is kept
            found.push((position, entry));
        })?;
        let Some(scanned) = scanned else {
            std::fs::remove_file(path).map_err(io)?;
            sync_folder(folder)?;
            continue;
        };
        if scanned.torn {
            tracing::warn!(
                file = %path.display(),
                at = scanned.end,
                "the result log has a torn tail; cut: nothing acknowledged was in it"
            );
            file.set_len(scanned.end).map_err(io)?;
            file.sync_all().map_err(io)?;
        }
        let base = scanned.base;
        index.end = base + scanned.end - SEGMENT_HEAD;
        index.segments.insert(
            base,
            Segment {
                path: path.clone(),
                file: Arc::new(file),
                end: scanned.end,
                needed: HashMap::new(),
            },
        );
        for (position, entry) in &found {
            index.note(base, *position, entry);
        }
    }
    Ok(index)
}

/// The one thread that writes.
struct Writer {
    index: Arc<Mutex<Index>>,
    options: Options,
    /// Base and file of the segment that grows; none until the first append, so that a start never
    /// appends to what an older process wrote.
    current: Option<(u64, Arc<File>)>,
    poisoned: Option<StoreError>,
}

impl Writer {
    fn run(mut self, queue: mpsc::Receiver<Waiting>) {
        while let Ok(first) = queue.recv() {
            let mut bytes = segment::frame_len(&first.0);
            let mut group = vec![first];
            while group.len() < GROUP_MAX && bytes < GROUP_BYTES_MAX {
                match queue.try_recv() {
                    Ok(next) => {
                        bytes += segment::frame_len(&next.0);
                        group.push(next);
                    }
                    Err(_) => break,
                }
            }
            self.commit(group);
        }
    }

    fn commit(&mut self, group: Vec<Waiting>) {
        // Units in this very group are known, too, but not durable before the sync.
        let mut fresh: HashMap<(Uuid, Unit), (u64, Digest)> = HashMap::new();
        let mut answers = Vec::with_capacity(group.len());
        let mut write = Vec::new();
        {
            let index = lock(&self.index);
            let mut end = index.end;
            for (entry, answer) in group {
                let key = (entry.job, entry.unit);
                let known = fresh.get(&key).copied().or_else(|| {
                    index
                        .jobs
                        .get(&entry.job)
                        .and_then(|units| units.get(&entry.unit))
                        .copied()
                });
                let result = match known {
                    Some((position, digest)) if digest == entry.digest => Appended::Same(position),
                    Some((position, digest)) => Appended::Other { position, digest },
                    None => {
                        fresh.insert(key, (end, entry.digest));
                        let position = end;
                        end += segment::frame_len(&entry);
                        write.push((position, entry));
                        Appended::New(position)
                    }
                };
                answers.push((answer, result));
            }
        }
        let error = if write.is_empty() {
            None
        } else {
            self.write(&write).err()
        };
        for (answer, result) in answers {
            let _ = answer.send(match &error {
                Some(error) => Err(error.clone()),
                None => Ok(result),
            });
        }
    }

    fn write(&mut self, entries: &[(u64, LogEntry)]) -> Result<(), StoreError> {
        if let Some(error) = &self.poisoned {
            return Err(error.clone());
        }
        let bytes: u64 = entries.iter().map(|(_, e)| segment::frame_len(e)).sum();
        let (synced, used) = {
            let index = lock(&self.index);
            (index.end, index.size_bytes())
        };
        if used + bytes > self.options.log_bytes_max {
            return Err(StoreError::Full {
                what: "the result log".into(),
            });
        }
        let (base, file) = self.segment(synced)?;
        let from = synced - base + SEGMENT_HEAD;
        let mut out = &*file;
        let written = out.seek(SeekFrom::Start(from)).and_then(|_| {
            entries.iter().try_for_each(|(_, entry)| {
                out.write_all(&segment::frame_head(entry, synced))?;
                out.write_all(&entry.bytes)
            })
        });
        if let Err(error) = written {
            // Nothing of this group was acknowledged: take it back.
            if let Err(error) = file.set_len(from) {
                return Err(self.poison(error));
            }
            return Err(io(error));
        }
        if let Err(error) = file.sync_data() {
            return Err(self.poison(error));
        }
        let mut index = lock(&self.index);
        for (position, entry) in entries {
            index.note(base, *position, entry);
        }
        index.end = synced + bytes;
        if let Some(segment) = index.segments.get_mut(&base) {
            segment.end = from + bytes;
        }
        Ok(())
    }

    /// The segment to write to.
    fn segment(&mut self, end: u64) -> Result<(u64, Arc<File>), StoreError> {
        if let Some((base, file)) = &self.current
            && end - base < self.options.segment_bytes
        {
            return Ok((*base, file.clone()));
        }
        let folder = lock(&self.index).folder.clone();
        let path = folder.join(format!("{end:020}.segment"));
        // A segment that an older process created and never filled has the same name and is empty.
        let file = OpenOptions::new()
            .create(true)
            .truncate(true)
            .read(true)
            .write(true)
            .open(&path)
            .map_err(io)?;
        let created = (&file)
            .write_all(&segment::segment_head(end))
            .and_then(|()| file.sync_all());
        if let Err(error) = created {
            let _ = std::fs::remove_file(&path);
            return Err(io(error));
        }
        sync_folder(&folder)?;
        let file = Arc::new(file);
        lock(&self.index).segments.insert(
            end,
            Segment {
                path,
                file: file.clone(),
                end: SEGMENT_HEAD,
                needed: HashMap::new(),
            },
        );
        self.current = Some((end, file.clone()));
        Ok((end, file))
    }

    fn poison(&mut self, error: std::io::Error) -> StoreError {
        let error = StoreError::SyncFailed {
            what: "the result log".into(),
            reason: error.to_string(),
        };
        tracing::error!(%error, "no more results are accepted");
        self.poisoned = Some(error.clone());
        error
    }
}

impl ResultLog for SegmentLog {
    fn append(&self, entry: LogEntry) -> Answer<'_, Appended> {
        let (answer, wait) = oneshot::channel();
        let sent = self
            .work
            .as_ref()
            .is_some_and(|w| w.send((entry, answer)).is_ok());
        Box::pin(async move {
            if !sent {
                return Err(closed());
            }
            wait.await.unwrap_or_else(|_| Err(closed()))
        })
    }

    fn read(
        &self,
        job: Uuid,
        position: u64,
        each: &mut dyn FnMut(u64, LogEntry) -> Result<(), StoreError>,
    ) -> Result<(), StoreError> {
        let segments: Vec<(u64, Arc<File>, u64, PathBuf)> = lock(&self.index)
            .segments
            .iter()
            .filter(|(_, s)| s.needed.get(&job).is_some_and(|last| *last >= position))
            .map(|(base, s)| (*base, s.file.clone(), s.end, s.path.clone()))
            .collect();
        for (base, file, end, path) in segments {
            let mut at = SEGMENT_HEAD;
            while at < end {
                let Some((entry, length)) = segment::read_frame(&file, at, end)? else {
                    return Err(StoreError::Damaged {
                        what: format!("{} at byte {at}", path.display()),
                    });
                };
                let here = base + at - SEGMENT_HEAD;
                if entry.job == job && here >= position {
                    each(here, entry)?;
                }
                at += length;
            }
        }
        Ok(())
    }

    fn end(&self) -> u64 {
        lock(&self.index).end
    }

    fn forget(&self, job: Uuid, unit: Unit) {
        if let Some(units) = lock(&self.index).jobs.get_mut(&job) {
            units.remove(&unit);
        }
    }

    fn forget_all(&self, job: Uuid) {
        lock(&self.index).jobs.remove(&job);
    }

    fn trim(&self, job: Uuid, position: u64) -> Result<(), StoreError> {
        let mut index = lock(&self.index);
        if let Some(units) = index.jobs.get_mut(&job) {
            units.retain(|_, (p, _)| *p >= position);
            if units.is_empty() {
                index.jobs.remove(&job);
            }
        }
        for segment in index.segments.values_mut() {
            if segment.needed.get(&job).is_some_and(|p| *p < position) {
                segment.needed.remove(&job);
            }
        }
        // The last segment stays: it keeps the positions rising over a restart.
        let last = index.segments.keys().next_back().copied();
        let free: Vec<u64> = index
            .segments
            .iter()
            .filter(|(base, s)| s.needed.is_empty() && Some(**base) != last)
            .map(|(base, _)| *base)
            .collect();
        for base in free {
            if let Some(segment) = index.segments.remove(&base) {
                std::fs::remove_file(&segment.path).map_err(io)?;
            }
        }
        Ok(())
    }

    fn jobs(&self) -> Vec<Uuid> {
        let mut jobs: Vec<Uuid> = lock(&self.index)
            .segments
            .values()
            .flat_map(|s| s.needed.keys().copied())
            .collect();
        jobs.sort_unstable();
        jobs.dedup();
        jobs
    }

    fn size_bytes(&self) -> u64 {
        lock(&self.index).size_bytes()
    }
}

#[cfg(test)]
#[path = "log_tests.rs"]
mod tests;
