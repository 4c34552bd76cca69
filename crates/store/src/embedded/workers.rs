//! Workers, in a table of the job database: an older program does not see it and loses nothing.

use super::jobs::{SqliteJobs, sql};
use crate::{Answer, WorkerStore};
use rusqlite::params;
use uuid::Uuid;

impl WorkerStore for SqliteJobs {
    fn put(&self, id: Uuid, record: Vec<u8>) -> Answer<'_, ()> {
        self.call(move |db| {
            db.prepare_cached("INSERT OR REPLACE INTO worker VALUES (?1, ?2)")
                .and_then(|mut q| q.execute(params![id.as_bytes().as_slice(), record]))
                .map_err(sql)
                .map(drop)
        })
    }

    fn remove(&self, ids: Vec<Uuid>) -> Answer<'_, ()> {
        self.call(move |db| {
            let mut remove = db
                .prepare_cached("DELETE FROM worker WHERE id = ?1")
                .map_err(sql)?;
            for id in ids {
                let id = id.as_bytes().as_slice();
                remove.execute(params![id]).map_err(sql)?;
            }
            Ok(())
        })
    }

    fn list(&self) -> Answer<'_, Vec<(Uuid, Vec<u8>)>> {
        self.call(move |db| {
            db.prepare_cached("SELECT id, record FROM worker ORDER BY id")
                .and_then(|mut q| {
                    q.query_map([], |row| {
                        Ok((Uuid::from_bytes(row.get::<_, [u8; 16]>(0)?), row.get(1)?))
                    })?
                    .collect()
                })
                .map_err(sql)
        })
    }
}
