//! Jobs (and, in `workers.rs`, workers) in SQLite: WAL, `synchronous=FULL`, foreign keys, and one thread that puts whatever waits
//! into one transaction, so that a busy farm pays for one sync and not for each write.

use super::FolderLock;
use crate::{Answer, Created, IdempotencyKey, JobStore, StoreError, StoredJob};
use rusqlite::{Connection, OptionalExtension, params};
use std::path::Path;
use std::sync::{Arc, mpsc};
use tokio::sync::oneshot;
use uuid::Uuid;

/// Most writes in one transaction.
const GROUP_MAX: usize = 256;
/// Version of the tables.
const SCHEMA: i64 = 1;

/// Runs inside the transaction; what it returns runs after the commit, with its error if it failed.
type Work = Box<dyn FnOnce(&Connection) -> Reply + Send>;
type Reply = Box<dyn FnOnce(Option<StoreError>) + Send>;

/// Jobs in a database.
pub(super) struct SqliteJobs {
    // Taken on drop: closing the channel ends the thread.
    work: Option<mpsc::Sender<Work>>,
    thread: Option<std::thread::JoinHandle<()>>,
    _lock: Arc<FolderLock>,
}

pub(super) fn sql(error: rusqlite::Error) -> StoreError {
    match error.sqlite_error_code() {
        Some(rusqlite::ErrorCode::DiskFull) => StoreError::Full {
            what: "the job database".into(),
        },
        Some(rusqlite::ErrorCode::DatabaseCorrupt | rusqlite::ErrorCode::NotADatabase) => {
            StoreError::Damaged {
                what: format!("the job database: {error}"),
            }
        }
        _ => StoreError::Unavailable {
            reason: format!("the job database: {error}"),
        },
    }
}

fn gone() -> StoreError {
    StoreError::Unavailable {
        reason: "the job database is closed".into(),
    }
}

impl SqliteJobs {
    pub fn open(path: &Path, lock: Arc<FolderLock>) -> Result<Self, StoreError> {
        let db = Connection::open(path).map_err(sql)?;
        db.pragma_update(None, "journal_mode", "WAL").map_err(sql)?;
        db.pragma_update(None, "synchronous", "FULL").map_err(sql)?;
        // Off by default in SQLite; without it deleting a job would leave its keys behind.
        db.pragma_update(None, "foreign_keys", "ON").map_err(sql)?;
        // Keeps the WAL file from staying as large as the largest burst.
        db.pragma_update(None, "journal_size_limit", 64i64 << 20)
            .map_err(sql)?;
        let found: i64 = db
            .pragma_query_value(None, "user_version", |row| row.get(0))
            .map_err(sql)?;
        if found > SCHEMA {
            return Err(StoreError::Damaged {
                what: format!(
                    "the job database has version {found}; this program reads up to {SCHEMA}"
                ),
            });
        }
        db.execute_batch(
            "BEGIN;
             CREATE TABLE IF NOT EXISTS job (
                 id BLOB PRIMARY KEY NOT NULL,
                 revision INTEGER NOT NULL,
                 record BLOB NOT NULL
             ) WITHOUT ROWID;
             CREATE TABLE IF NOT EXISTS idempotency (
                 key TEXT PRIMARY KEY NOT NULL,
                 request BLOB NOT NULL,
                 job BLOB NOT NULL REFERENCES job (id) ON DELETE CASCADE
             ) WITHOUT ROWID;
             CREATE TABLE IF NOT EXISTS worker (
                 id BLOB PRIMARY KEY NOT NULL,
                 record BLOB NOT NULL
             ) WITHOUT ROWID;
             CREATE INDEX IF NOT EXISTS idempotency_job ON idempotency (job);
             PRAGMA user_version = 1;
             COMMIT;",
        )
        .map_err(sql)?;
        let (work, queue) = mpsc::channel();
        let thread = std::thread::Builder::new()
            .name("job-store".into())
            .spawn(move || run(db, queue))
            .map_err(|e| StoreError::io("the thread of the job database", &e))?;
        Ok(SqliteJobs {
            work: Some(work),
            thread: Some(thread),
            _lock: lock,
        })
    }

    pub(super) fn call<T: Send + 'static>(
        &self,
        f: impl FnOnce(&Connection) -> Result<T, StoreError> + Send + 'static,
    ) -> Answer<'_, T> {
        let (answer, wait) = oneshot::channel();
        let work: Work = Box::new(move |db| {
            let result = f(db);
            Box::new(move |commit_error| {
                let _ = answer.send(match commit_error {
                    Some(error) => Err(error),
                    None => result,
                });
            })
        });
        let sent = self.work.as_ref().is_some_and(|w| w.send(work).is_ok());
        Box::pin(async move {
            if !sent {
                return Err(gone());
            }
            wait.await.unwrap_or_else(|_| Err(gone()))
        })
    }
}

impl Drop for SqliteJobs {
    fn drop(&mut self) {
        self.work = None;
        if let Some(thread) = self.thread.take() {
            let _ = thread.join();
        }
    }
}

/// The one writer.
fn run(mut db: Connection, queue: mpsc::Receiver<Work>) {
    while let Ok(first) = queue.recv() {
        let waiting = std::iter::once(first).chain(queue.try_iter().take(GROUP_MAX - 1));
        let mut replies = Vec::new();
        let outcome = match db.transaction_with_behavior(rusqlite::TransactionBehavior::Immediate) {
            Ok(transaction) => {
                replies.extend(waiting.map(|work| work(&transaction)));
                transaction.commit().map_err(sql)
            }
            // Dropping the work closes its channels: the callers see the store as closed.
            Err(error) => Err(sql(error)),
        };
        let error = outcome.err();
        if let Some(error) = &error {
            tracing::error!(%error, "a transaction on the job database failed");
        }
        for reply in replies {
            reply(error.clone());
        }
    }
}

fn read(db: &Connection, id: Uuid) -> Result<Option<StoredJob>, StoreError> {
    db.prepare_cached("SELECT revision, record FROM job WHERE id = ?1")
        .and_then(|mut q| {
            q.query_row(params![id.as_bytes().as_slice()], |row| {
                Ok(StoredJob {
                    id,
                    revision: row.get::<_, i64>(0)? as u64,
                    record: row.get(1)?,
                })
            })
            .optional()
        })
        .map_err(sql)
}

fn no_job(id: Uuid) -> StoreError {
    StoreError::NotFound {
        what: format!("job {id}"),
    }
}

fn conflict(id: Uuid) -> StoreError {
    StoreError::Conflict {
        what: format!("job {id}"),
    }
}

impl JobStore for SqliteJobs {
    fn create(
        &self,
        id: Uuid,
        key: Option<IdempotencyKey>,
        record: Vec<u8>,
    ) -> Answer<'_, Created> {
        self.call(move |db| {
            if let Some(key) = &key {
                let known: Option<([u8; 32], [u8; 16])> = db
                    .query_row(
                        "SELECT request, job FROM idempotency WHERE key = ?1",
                        params![key.key],
                        |row| Ok((row.get(0)?, row.get(1)?)),
                    )
                    .optional()
                    .map_err(sql)?;
                if let Some((request, job)) = known {
                    let job = Uuid::from_bytes(job);
                    return Ok(if request == key.request {
                        Created::Exists(job)
                    } else {
                        Created::KeyReused(job)
                    });
                }
            }
            if read(db, id)?.is_some() {
                return Err(conflict(id));
            }
            let id = id.as_bytes().as_slice();
            db.execute("INSERT INTO job VALUES (?1, 1, ?2)", params![id, record])
                .map_err(sql)?;
            if let Some(key) = key {
                db.execute(
                    "INSERT INTO idempotency VALUES (?1, ?2, ?3)",
                    params![key.key, key.request.as_slice(), id],
                )
                .map_err(sql)?;
            }
            Ok(Created::New(1))
        })
    }

    fn get(&self, id: Uuid) -> Answer<'_, StoredJob> {
        self.call(move |db| read(db, id)?.ok_or_else(|| no_job(id)))
    }

    fn cas(&self, id: Uuid, revision: u64, record: Vec<u8>) -> Answer<'_, u64> {
        self.call(move |db| {
            let changed = db
                .prepare_cached(
                    "UPDATE job SET revision = revision + 1, record = ?3
                     WHERE id = ?1 AND revision = ?2",
                )
                .and_then(|mut q| {
                    q.execute(params![id.as_bytes().as_slice(), revision as i64, record])
                })
                .map_err(sql)?;
            match (changed, read(db, id)?) {
                (1, _) => Ok(revision + 1),
                (_, Some(_)) => Err(conflict(id)),
                (_, None) => Err(no_job(id)),
            }
        })
    }

    fn delete(&self, id: Uuid) -> Answer<'_, ()> {
        self.call(move |db| {
            db.execute(
                "DELETE FROM job WHERE id = ?1",
                params![id.as_bytes().as_slice()],
            )
            .map_err(sql)
            .map(drop)
        })
    }

    fn list(&self, before: Option<Uuid>, limit: usize) -> Answer<'_, Vec<StoredJob>> {
        self.call(move |db| {
            let before = before.unwrap_or(Uuid::max());
            let limit = i64::try_from(limit).unwrap_or(i64::MAX);
            db.prepare_cached(
                "SELECT id, revision, record FROM job WHERE id < ?1 ORDER BY id DESC LIMIT ?2",
            )
            .and_then(|mut q| {
                q.query_map(params![before.as_bytes().as_slice(), limit], |row| {
                    Ok(StoredJob {
                        id: Uuid::from_bytes(row.get::<_, [u8; 16]>(0)?),
                        revision: row.get::<_, i64>(1)? as u64,
                        record: row.get(2)?,
                    })
                })?
                .collect()
            })
            .map_err(sql)
        })
    }
}
