//! Killed between any two steps; storage that fails.

use super::support::*;
use crate::config::StoreConfig;
use crate::error::{FULL, UNAVAILABLE};
use crate::results::Taken;
use crate::{Coordinator, ServeError};
use protocol::JobState;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use store::{
    Answer, Appended, Created, IdempotencyKey, JobStore, LogEntry, ResultLog, StoreError,
    StoredJob, Stores,
};
use tokio_util::sync::CancellationToken;
use uuid::Uuid;

#[tokio::test]
async fn coordinator_killed_after_log_before_merge() {
    let mut rig = Rig::embedded().await;
    let id = rig.submit(spp(32)).await;
    let mut total = 0;
    for round in 1..=4 {
        let worker = rig.worker("a");
        for lease in rig.lease(worker, 5).await {
            assert_eq!(rig.deliver(worker, &lease.at).await.unwrap(), Taken::New);
            total += 1;
        }
        if round == 2 {
            rig.farm.checkpoint(id).await.unwrap();
        }
        let version = rig.status(id).image_version;
        rig = rig.restart().await;
        let status = rig.status(id);
        assert_eq!(status.units_merged, total, "what was acknowledged is there");
        assert!(
            status.image_version > version,
            "a picture's version never goes back"
        );
    }
    let worker = rig.worker("b");
    let status = rig.work(worker, id).await;
    assert_eq!(status.digest, hex(&oracle(0, |_| 32)));
    assert_eq!(status.units_merged, 24);
}

#[tokio::test]
async fn a_graceful_end_leaves_nothing_to_replay() {
    let rig = Rig::embedded().await;
    let id = rig.submit(spp(32)).await;
    let worker = rig.worker("a");
    for lease in rig.lease(worker, 9).await {
        rig.deliver(worker, &lease.at).await.unwrap();
    }
    let rig = rig.restart_gracefully().await;
    let worker = rig.worker("a");
    assert_eq!(rig.status(id).units_merged, 9);
    assert_eq!(rig.work(worker, id).await.digest, hex(&oracle(0, |_| 32)));
}

#[tokio::test]
async fn corrupt_checkpoint_falls_back() {
    let rig = Rig::embedded().await;
    let id = rig.submit(spp(32)).await;
    let worker = rig.worker("a");
    for _ in 0..2 {
        for lease in rig.lease(worker, 6).await {
            rig.deliver(worker, &lease.at).await.unwrap();
        }
        rig.merged(id, 6).await;
        rig.farm.checkpoint(id).await.unwrap();
    }
    let newest = rig.farm.state().jobs[&id].record.begun[&0]
        .current
        .clone()
        .unwrap();
    let path = rig.path().join("blobs").join(&newest.manifest);
    let folder = rig.crash().await;
    let mut bytes = std::fs::read(&path).unwrap();
    bytes[20] ^= 1;
    std::fs::write(&path, bytes).unwrap();
    let rig = Rig::open(folder).await;
    assert_eq!(
        rig.status(id).units_merged,
        12,
        "the one before and the log have all"
    );
    let worker = rig.worker("b");
    assert_eq!(rig.work(worker, id).await.digest, hex(&oracle(0, |_| 32)));
}

#[tokio::test]
async fn result_log_lost() {
    let rig = Rig::embedded().await;
    let id = rig.submit(spp(16)).await;
    let worker = rig.worker("a");
    for lease in rig.lease(worker, 9).await {
        rig.deliver(worker, &lease.at).await.unwrap();
    }
    let folder = rig.crash().await;
    std::fs::remove_dir_all(folder.path().join("log")).unwrap();
    let rig = Rig::open(folder).await;
    let worker = rig.worker("a");
    let status = rig.work(worker, id).await;
    assert_eq!(status.digest, hex(&oracle(0, |_| 16)), "rendered again");
}

#[tokio::test]
async fn a_worker_keeps_its_lease_through_a_restart() {
    let rig = Rig::embedded().await;
    let id = rig.submit(spp(1)).await;
    let worker = rig.worker("a");
    let leases = rig.lease(worker, 4).await;
    let rig = rig.restart().await;
    // It is unknown, registers as who it was, and says what it holds.
    let error = rig.farm.sync(asking(worker, 1), None).await.unwrap_err();
    assert_eq!(error.kind().name, "no-worker");
    let mut again = about("a");
    again.previous_id = Some(worker);
    assert_eq!(rig.farm.register(again, None).unwrap().worker, worker);
    let mut request = asking(worker, 9);
    request.held = leases.iter().map(|l| l.at.clone()).collect();
    let answer = rig.sync(request).await;
    assert_eq!((answer.leases, answer.cancelled), (vec![], vec![]));
    assert_eq!(rig.status(id).units_leased, 4);
    for lease in &leases {
        assert_eq!(rig.deliver(worker, &lease.at).await.unwrap(), Taken::New);
    }
    assert_eq!(rig.done(id).await.digest, hex(&oracle(0, |_| 1)));
}

/// A store whose parts fail when told to.
struct Faulty {
    inner: Stores,
    full: AtomicBool,
    no_sync: AtomicBool,
    no_cas: AtomicBool,
}

impl ResultLog for Faulty {
    fn append(&self, entry: LogEntry) -> Answer<'_, Appended> {
        if self.full.load(Ordering::Relaxed) {
            let what = "the result log".into();
            return Box::pin(std::future::ready(Err(StoreError::Full { what })));
        }
        if self.no_sync.load(Ordering::Relaxed) {
            let (what, reason) = ("the result log".into(), "told to fail".into());
            let error = StoreError::SyncFailed { what, reason };
            return Box::pin(std::future::ready(Err(error)));
        }
        self.inner.log.append(entry)
    }
    fn read(
        &self,
        job: Uuid,
        position: u64,
        each: &mut dyn FnMut(u64, LogEntry) -> Result<(), StoreError>,
    ) -> Result<(), StoreError> {
        self.inner.log.read(job, position, each)
    }
    fn end(&self) -> u64 {
        self.inner.log.end()
    }
    fn forget(&self, job: Uuid, unit: film::Unit) {
        self.inner.log.forget(job, unit);
    }
    fn forget_all(&self, job: Uuid) {
        self.inner.log.forget_all(job);
    }
    fn trim(&self, job: Uuid, position: u64) -> Result<(), StoreError> {
        self.inner.log.trim(job, position)
    }
    fn jobs(&self) -> Vec<Uuid> {
        self.inner.log.jobs()
    }
    fn size_bytes(&self) -> u64 {
        self.inner.log.size_bytes()
    }
}

impl JobStore for Faulty {
    fn create(
        &self,
        id: Uuid,
        key: Option<IdempotencyKey>,
        record: Vec<u8>,
    ) -> Answer<'_, Created> {
        self.inner.jobs.create(id, key, record)
    }
    fn get(&self, id: Uuid) -> Answer<'_, StoredJob> {
        self.inner.jobs.get(id)
    }
    fn cas(&self, id: Uuid, revision: u64, record: Vec<u8>) -> Answer<'_, u64> {
        if self.no_cas.load(Ordering::Relaxed) {
            let reason = "told to fail".into();
            return Box::pin(std::future::ready(Err(StoreError::Unavailable { reason })));
        }
        self.inner.jobs.cas(id, revision, record)
    }
    fn delete(&self, id: Uuid) -> Answer<'_, ()> {
        self.inner.jobs.delete(id)
    }
    fn list(&self, before: Option<Uuid>, limit: usize) -> Answer<'_, Vec<StoredJob>> {
        self.inner.jobs.list(before, limit)
    }
}

fn faulty_stores(folder: &Arc<tempfile::TempDir>) -> (Stores, Arc<Faulty>) {
    let inner = store::embedded::open(folder.path(), store::embedded::Options::default()).unwrap();
    let faulty = Arc::new(Faulty {
        inner: inner.clone(),
        full: AtomicBool::new(false),
        no_sync: AtomicBool::new(false),
        no_cas: AtomicBool::new(false),
    });
    let stores = Stores {
        jobs: faulty.clone(),
        log: faulty.clone(),
        ..inner
    };
    (stores, faulty)
}

async fn faulty(folder: &Arc<tempfile::TempDir>) -> (Rig, Arc<Faulty>) {
    let (stores, faulty) = faulty_stores(folder);
    let mut rig = Rig::with_stores(stores).await;
    rig.folder = Some(folder.clone());
    (rig, faulty)
}

#[tokio::test]
async fn coordinator_killed_around_checkpoint_cas() {
    let folder = Arc::new(tempfile::tempdir().unwrap());
    let (rig, faults) = faulty(&folder).await;
    let id = rig.submit(spp(16)).await;
    let worker = rig.worker("a");
    for round in 0..3 {
        for lease in rig.lease(worker, 5).await {
            rig.deliver(worker, &lease.at).await.unwrap();
        }
        rig.merged(id, 5 * (round + 1)).await;
        // Blobs and manifest are written; the record is not, but for the first time.
        faults.no_cas.store(round > 0, Ordering::Relaxed);
        assert_eq!(rig.farm.checkpoint(id).await.is_ok(), round == 0);
    }
    drop(faults);
    let folder = rig.crash().await;
    let rig = Rig::open(folder).await;
    let status = rig.status(id);
    assert_eq!(status.units_merged, 15);
    let worker = rig.worker("b");
    assert_eq!(rig.work(worker, id).await.digest, hex(&oracle(0, |_| 16)));
}

#[tokio::test]
async fn disk_full_refuses_then_recovers() {
    let folder = Arc::new(tempfile::tempdir().unwrap());
    let (rig, faults) = faulty(&folder).await;
    let id = rig.submit(spp(4)).await;
    let worker = rig.worker("a");
    let leases = rig.lease(worker, 99).await;
    rig.deliver(worker, &leases[0].at).await.unwrap();
    faults.full.store(true, Ordering::Relaxed);
    for lease in &leases[1..3] {
        let error = rig.deliver(worker, &lease.at).await.unwrap_err();
        assert_eq!((error.kind(), error.problem().status), (FULL, 503));
    }
    // What is there is still seen, and nothing was merged that is not kept.
    assert_eq!(rig.merged(id, 1).await.units_merged, 1);
    faults.full.store(false, Ordering::Relaxed);
    for lease in &leases[1..] {
        assert_eq!(rig.deliver(worker, &lease.at).await.unwrap(), Taken::New);
    }
    assert_eq!(rig.done(id).await.digest, hex(&oracle(0, |_| 4)));
}

/// After a failed sync nobody knows what the disk holds: the process ends, and says why.
#[tokio::test]
async fn a_failed_sync_ends_the_process() {
    let folder = Arc::new(tempfile::tempdir().unwrap());
    let (stores, faults) = faulty_stores(&folder);
    let listener = tokio::net::TcpListener::bind("127.0.0.1:0").await.unwrap();
    let coordinator = Coordinator::with_stores(listener, config(StoreConfig::Memory), stores)
        .await
        .unwrap();
    let rig = Rig {
        farm: coordinator.farm.clone(),
        folder: Some(folder),
    };
    let running = tokio::spawn(coordinator.run(CancellationToken::new()));
    let id = rig.submit(spp(4)).await;
    let worker = rig.worker("a");
    let leases = rig.lease(worker, 3).await;
    rig.deliver(worker, &leases[0].at).await.unwrap();
    faults.no_sync.store(true, Ordering::Relaxed);
    let error = rig.deliver(worker, &leases[1].at).await.unwrap_err();
    assert_eq!(error.kind(), UNAVAILABLE);
    let ended = running.await.unwrap().unwrap_err();
    assert!(
        matches!(&ended, ServeError::Store(StoreError::SyncFailed { .. })),
        "{ended:?}"
    );
    assert!(ended.to_string().contains("told to fail"), "{ended}");
    // What was acknowledged is there for the process that follows, no more.
    rig.merged(id, 1).await;
    drop(faults);
    let rig = Rig::open(rig.crash().await).await;
    assert_eq!(rig.status(id).units_merged, 1);
    let worker = rig.worker("b");
    assert_eq!(rig.work(worker, id).await.digest, hex(&oracle(0, |_| 4)));
}

#[tokio::test]
async fn a_finished_job_that_cannot_be_saved_is_saved_later() {
    let folder = Arc::new(tempfile::tempdir().unwrap());
    let (rig, faults) = faulty(&folder).await;
    let id = rig.submit(spp(1)).await;
    faults.no_cas.store(true, Ordering::Relaxed);
    let worker = rig.worker("a");
    for lease in rig.lease(worker, 4).await {
        rig.deliver(worker, &lease.at).await.unwrap();
    }
    rig.merged(id, 4).await;
    let error = rig.farm.pause(id).await;
    assert!(error.is_err_and(|e| e.kind() == UNAVAILABLE || e.kind().status == 409));
    drop(faults);
    // Killed before it ever worked: the log has the results.
    let rig = Rig::open(rig.crash().await).await;
    let status = rig.done(id).await;
    assert_eq!(
        (status.state, status.digest),
        (JobState::Done, hex(&oracle(0, |_| 1)))
    );
}
