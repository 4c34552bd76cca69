//! The suite that every backend runs. What is kept must survive [`Backend::reopen`].

use crate::{Appended, Created, IdempotencyKey, LogEntry, StoreError, Stores};
use bytes::Bytes;
use film::{SampleRange, Unit};
use futures::executor::block_on;
use std::sync::atomic::{AtomicU64, Ordering};
use uuid::Uuid;

/// A backend under test.
pub struct Backend {
    open: Box<dyn FnMut() -> Stores>,
    stores: Option<Stores>,
    kept: bool,
}

impl Backend {
    /// One that forgets everything when it is closed.
    pub fn volatile(open: impl FnMut() -> Stores + 'static) -> Self {
        Backend {
            open: Box::new(open),
            stores: None,
            kept: false,
        }
    }

    /// One that keeps everything: `open` opens the same place again.
    pub fn kept(open: impl FnMut() -> Stores + 'static) -> Self {
        Backend {
            kept: true,
            ..Backend::volatile(open)
        }
    }

    fn stores(&mut self) -> Stores {
        self.stores.get_or_insert_with(|| (self.open)()).clone()
    }

    /// As if the process had ended and begun again.
    fn reopen(&mut self) -> Stores {
        if self.kept {
            self.stores = None;
        }
        self.stores()
    }
}

/// Name and body.
type Check = (&'static str, fn(&mut Backend));

/// Runs everything.
pub fn run(backend: &mut Backend) {
    let checks: &[Check] = &[
        ("jobs_are_compared_and_set", jobs_are_compared_and_set),
        ("keys_make_one_job", keys_make_one_job),
        ("jobs_are_listed_newest_first", jobs_are_listed_newest_first),
        (
            "many_writers_of_one_job_one_wins",
            many_writers_of_one_job_one_wins,
        ),
        ("workers_are_kept", workers_are_kept),
        ("blobs_are_named_by_content", blobs_are_named_by_content),
        (
            "unfinished_blobs_leave_nothing",
            unfinished_blobs_leave_nothing,
        ),
        ("duplicate_same_bytes_is_noop", duplicate_same_bytes_is_noop),
        (
            "duplicate_in_flight_is_one_entry",
            duplicate_in_flight_is_one_entry,
        ),
        (
            "duplicate_other_bytes_is_told",
            duplicate_other_bytes_is_told,
        ),
        ("results_are_read_in_order", results_are_read_in_order),
        ("trimmed_results_are_gone", trimmed_results_are_gone),
        (
            "forgotten_units_may_come_again",
            forgotten_units_may_come_again,
        ),
    ];
    for (name, check) in checks {
        println!("conformance: {name}");
        check(backend);
    }
}

/// Ids of one suite differ, and sort by age.
fn job_id() -> Uuid {
    static NEXT: AtomicU64 = AtomicU64::new(1);
    Uuid::from_u128(u128::from(NEXT.fetch_add(1, Ordering::Relaxed)) << 64)
}

fn entry(job: Uuid, tile: u32, content: &str) -> LogEntry {
    LogEntry {
        job,
        unit: Unit {
            frame: 1,
            tile,
            samples: SampleRange { begin: 4, end: 8 },
        },
        digest: *blake3::hash(content.as_bytes()).as_bytes(),
        worker: Uuid::from_u128(9),
        bytes: Bytes::copy_from_slice(content.as_bytes()),
    }
}

fn read(stores: &Stores, job: Uuid, from: u64) -> Vec<(u64, LogEntry)> {
    let mut found = Vec::new();
    stores
        .log
        .read(job, from, &mut |p, e| {
            found.push((p, e));
            Ok(())
        })
        .unwrap();
    found
}

fn append(stores: &Stores, entry: LogEntry) -> Appended {
    block_on(stores.log.append(entry)).unwrap()
}

fn jobs_are_compared_and_set(backend: &mut Backend) {
    let stores = backend.stores();
    let id = job_id();
    assert!(matches!(
        block_on(stores.jobs.get(id)),
        Err(StoreError::NotFound { .. })
    ));
    assert!(matches!(
        block_on(stores.jobs.cas(id, 1, vec![])),
        Err(StoreError::NotFound { .. })
    ));
    assert_eq!(
        block_on(stores.jobs.create(id, None, vec![1])).unwrap(),
        Created::New(1)
    );
    assert!(matches!(
        block_on(stores.jobs.create(id, None, vec![2])),
        Err(StoreError::Conflict { .. })
    ));
    assert_eq!(block_on(stores.jobs.cas(id, 1, vec![2])).unwrap(), 2);
    assert!(matches!(
        block_on(stores.jobs.cas(id, 1, vec![3])),
        Err(StoreError::Conflict { .. })
    ));
    drop(stores);
    let stores = backend.reopen();
    let stored = block_on(stores.jobs.get(id)).unwrap();
    assert_eq!((stored.revision, stored.record), (2, vec![2]));
    block_on(stores.jobs.delete(id)).unwrap();
    block_on(stores.jobs.delete(id)).unwrap();
    drop(stores);
    let stores = backend.reopen();
    assert!(block_on(stores.jobs.get(id)).is_err());
}

fn keys_make_one_job(backend: &mut Backend) {
    let stores = backend.stores();
    let (id, other) = (job_id(), job_id());
    let key = |request: u8| {
        Some(IdempotencyKey {
            key: "k".into(),
            request: [request; 32],
        })
    };
    let create = |stores: &Stores, id, key| block_on(stores.jobs.create(id, key, vec![])).unwrap();
    assert_eq!(create(&stores, id, key(1)), Created::New(1));
    drop(stores);
    let stores = backend.reopen();
    assert_eq!(create(&stores, other, key(1)), Created::Exists(id));
    assert_eq!(create(&stores, other, key(2)), Created::KeyReused(id));
    assert!(block_on(stores.jobs.get(other)).is_err());
    block_on(stores.jobs.delete(id)).unwrap();
    assert_eq!(create(&stores, other, key(2)), Created::New(1));
    block_on(stores.jobs.delete(other)).unwrap();
}

fn jobs_are_listed_newest_first(backend: &mut Backend) {
    let stores = backend.stores();
    let ids: Vec<Uuid> = (0..5).map(|_| job_id()).collect();
    for id in &ids {
        block_on(stores.jobs.create(*id, None, vec![])).unwrap();
    }
    let list = |before, limit| -> Vec<Uuid> {
        block_on(stores.jobs.list(before, limit))
            .unwrap()
            .iter()
            .map(|j| j.id)
            .collect()
    };
    assert_eq!(list(None, 2), [ids[4], ids[3]]);
    assert_eq!(list(Some(ids[3]), 2), [ids[2], ids[1]]);
    assert_eq!(list(Some(ids[1]), 9), [ids[0]]);
    for id in ids {
        block_on(stores.jobs.delete(id)).unwrap();
    }
}

fn many_writers_of_one_job_one_wins(backend: &mut Backend) {
    let stores = backend.stores();
    let id = job_id();
    block_on(stores.jobs.create(id, None, vec![])).unwrap();
    let wins: usize = std::thread::scope(|scope| {
        let writers: Vec<_> = (0..8u8)
            .map(|n| {
                let jobs = &stores.jobs;
                scope.spawn(move || usize::from(block_on(jobs.cas(id, 1, vec![n])).is_ok()))
            })
            .collect();
        writers.into_iter().map(|w| w.join().unwrap()).sum()
    });
    assert_eq!(wins, 1);
    block_on(stores.jobs.delete(id)).unwrap();
}

fn workers_are_kept(backend: &mut Backend) {
    let workers = backend.stores().workers;
    let [a, b, c] = [job_id(), job_id(), job_id()];
    for (id, record) in [(c, 1), (a, 2), (b, 3), (a, 4)] {
        block_on(workers.put(id, vec![record])).unwrap();
    }
    block_on(workers.remove(vec![b, job_id()])).unwrap();
    block_on(workers.remove(vec![b])).unwrap();
    drop(workers);
    let workers = backend.reopen().workers;
    let expect = vec![(a, vec![4]), (c, vec![1])];
    assert_eq!(block_on(workers.list()).unwrap(), expect);
}

fn blobs_are_named_by_content(backend: &mut Backend) {
    let stores = backend.stores();
    let many: Vec<Vec<u8>> = (0..20u8).map(|n| vec![n; 10 + n as usize]).collect();
    let slices: Vec<&[u8]> = many.iter().map(Vec::as_slice).collect();
    let digests = stores.blobs.put_many(&slices).unwrap();
    assert_eq!(stores.blobs.put(&many[3]).unwrap(), digests[3]);
    drop(stores);
    let stores = backend.reopen();
    for (digest, bytes) in digests.iter().zip(&many) {
        assert_eq!(digest, blake3::hash(bytes).as_bytes());
        assert_eq!(&stores.blobs.get(digest).unwrap()[..], &bytes[..]);
        assert_eq!(stores.blobs.size(digest).unwrap(), Some(bytes.len() as u64));
        let mut opened = stores.blobs.open(digest).unwrap();
        let mut read = Vec::new();
        std::io::Read::read_to_end(&mut opened.reader, &mut read).unwrap();
        assert_eq!((&read, opened.size_bytes), (bytes, bytes.len() as u64));
    }
    assert!(
        digests
            .iter()
            .all(|d| stores.blobs.list().unwrap().contains(d))
    );
    stores.blobs.remove(&digests[0]).unwrap();
    stores.blobs.remove(&digests[0]).unwrap();
    assert_eq!(stores.blobs.size(&digests[0]).unwrap(), None);
    assert!(matches!(
        stores.blobs.get(&digests[0]),
        Err(StoreError::NotFound { .. })
    ));
}

fn unfinished_blobs_leave_nothing(backend: &mut Backend) {
    let stores = backend.stores();
    let before = stores.blobs.list().unwrap();
    let mut writer = stores.blobs.begin().unwrap();
    writer.write(b"half").unwrap();
    drop(writer);
    assert_eq!(stores.blobs.list().unwrap(), before);
    let digest = *blake3::hash(b"whole").as_bytes();
    let mut writer = stores.blobs.begin().unwrap();
    writer.write(b"who").unwrap();
    assert_eq!(stores.blobs.size(&digest).unwrap(), None);
    writer.write(b"le").unwrap();
    writer.finish(&digest).unwrap();
    drop(stores);
    let stores = backend.reopen();
    assert_eq!(&stores.blobs.get(&digest).unwrap()[..], b"whole");
}

fn duplicate_same_bytes_is_noop(backend: &mut Backend) {
    let stores = backend.stores();
    let job = job_id();
    let Appended::New(position) = append(&stores, entry(job, 0, "a")) else {
        panic!()
    };
    assert_eq!(
        append(&stores, entry(job, 0, "a")),
        Appended::Same(position)
    );
    drop(stores);
    let stores = backend.reopen();
    assert_eq!(
        append(&stores, entry(job, 0, "a")),
        Appended::Same(position)
    );
    assert_eq!(read(&stores, job, 0), [(position, entry(job, 0, "a"))]);
    stores.log.purge(job).unwrap();
}

fn duplicate_in_flight_is_one_entry(backend: &mut Backend) {
    let stores = backend.stores();
    let job = job_id();
    let answers = block_on(futures::future::join_all(
        (0..16).map(|_| stores.log.append(entry(job, 0, "a"))),
    ));
    let new = answers
        .iter()
        .filter(|a| matches!(a, Ok(Appended::New(_))))
        .count();
    assert_eq!((new, read(&stores, job, 0).len()), (1, 1));
    stores.log.purge(job).unwrap();
}

fn duplicate_other_bytes_is_told(backend: &mut Backend) {
    let stores = backend.stores();
    let job = job_id();
    let first = entry(job, 0, "a");
    let Appended::New(position) = append(&stores, first.clone()) else {
        panic!()
    };
    drop(stores);
    let stores = backend.reopen();
    assert_eq!(
        append(&stores, entry(job, 0, "b")),
        Appended::Other {
            position,
            digest: first.digest
        }
    );
    assert_eq!(read(&stores, job, 0), [(position, first)]);
    stores.log.purge(job).unwrap();
}

fn results_are_read_in_order(backend: &mut Backend) {
    let stores = backend.stores();
    let (a, b) = (job_id(), job_id());
    let mut positions = Vec::new();
    for tile in 0..30 {
        let text = format!("{tile}{}", "x".repeat(tile as usize * 20));
        assert!(matches!(
            append(&stores, entry(b, tile, "b")),
            Appended::New(_)
        ));
        match append(&stores, entry(a, tile, &text)) {
            Appended::New(position) => positions.push((position, entry(a, tile, &text))),
            other => panic!("{other:?}"),
        }
    }
    let end = stores.log.end();
    assert!(positions.windows(2).all(|w| w[0].0 < w[1].0));
    drop(stores);
    let stores = backend.reopen();
    assert_eq!(stores.log.end(), end);
    assert_eq!(read(&stores, a, 0), positions);
    assert_eq!(read(&stores, a, positions[11].0), positions[11..]);
    assert_eq!(read(&stores, a, end), []);
    assert!(stores.log.jobs().contains(&a) && stores.log.jobs().contains(&b));
    stores.log.purge(a).unwrap();
    stores.log.purge(b).unwrap();
}

fn trimmed_results_are_gone(backend: &mut Backend) {
    let stores = backend.stores();
    let job = job_id();
    for tile in 0..50 {
        append(&stores, entry(job, tile, &"x".repeat(100)));
    }
    let (size, end) = (stores.log.size_bytes(), stores.log.end());
    stores.log.trim(job, end).unwrap();
    assert!(stores.log.size_bytes() < size);
    // Space is freed in pieces, so some may still be there: no test on what is read before `end`.
    let Appended::New(position) = append(&stores, entry(job, 99, "new")) else {
        panic!()
    };
    assert!(position >= end);
    drop(stores);
    let stores = backend.reopen();
    assert_eq!(read(&stores, job, end), [(position, entry(job, 99, "new"))]);
    stores.log.purge(job).unwrap();
    assert!(!stores.log.jobs().contains(&job) || !backend.kept);
}

fn forgotten_units_may_come_again(backend: &mut Backend) {
    let stores = backend.stores();
    let job = job_id();
    append(&stores, entry(job, 0, "bad"));
    stores.log.forget(job, entry(job, 0, "").unit);
    let Appended::New(position) = append(&stores, entry(job, 0, "good")) else {
        panic!()
    };
    drop(stores);
    let stores = backend.reopen();
    // The later one counts from now on.
    assert_eq!(
        append(&stores, entry(job, 0, "good")),
        Appended::Same(position)
    );
    assert_eq!(read(&stores, job, 0).len(), 2);
    stores.log.forget_all(job);
    assert!(matches!(
        append(&stores, entry(job, 0, "better")),
        Appended::New(_)
    ));
    assert_eq!(read(&stores, job, 0).len(), 3);
    stores.log.purge(job).unwrap();
}
