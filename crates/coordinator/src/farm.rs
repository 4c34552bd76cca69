//! The whole coordinator without HTTP: jobs, workers, what runs in the background.
//!
//! One lock holds everything that is in memory and is never held while something waits. Films are
//! outside of it, behind locks of their own.

use crate::clock::Clock;
use crate::config::{Config, StoreConfig};
use crate::error::{ApiError, NO_JOB};
use crate::events::Events;
use crate::films::Films;
use crate::job::Job;
use crate::metrics::Metrics;
use crate::owner::{Order, Owner, stats_of};
use crate::plan::FramePlan;
use crate::record::JobRecord;
use crate::refs::BlobRefs;
use crate::worker::Worker;
use crate::{ServeError, audit, checkpoint, status};
use film::{Manifest, Unit};
use protocol::{Event, JobState, TimestampMs};
use std::collections::{BTreeMap, HashMap};
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use store::{Digest, StoreError, Stores};
use tokio::sync::{Notify, Semaphore, oneshot, watch};
use tokio_util::sync::CancellationToken;
use tokio_util::task::TaskTracker;
use uuid::Uuid;

/// Checked results that wait for their merge; each may take a megabyte.
const RESULTS_IN_FLIGHT: usize = 64;
/// The version of a picture rises with every merge, and the record is not saved with every merge:
/// after a restart it goes on above anything that was shown. What the log brings back counts one by
/// one, and this covers clearings.
const VERSION_GAP: u64 = 1024;
/// Jobs that are read from the store at once.
const PAGE: usize = 1000;

/// What is in memory.
#[derive(Default)]
pub struct State {
    /// By id, which is by age.
    pub jobs: BTreeMap<Uuid, Job>,
    /// By id.
    pub workers: BTreeMap<Uuid, Worker>,
    /// Leases given so far.
    pub leases_given: u64,
    /// Uploads that no job names yet.
    pub young: BTreeMap<Digest, TimestampMs>,
}

/// The coordinator.
pub struct Farm {
    /// As it was told.
    pub config: Config,
    /// What time it is.
    pub clock: Clock,
    /// What is kept.
    pub stores: Stores,
    /// Which blobs are needed.
    pub refs: BlobRefs,
    /// Films in memory.
    pub films: Films,
    /// What happens.
    pub events: Events,
    /// Numbers for operators.
    pub metrics: Metrics,
    /// Wakes workers that wait for something to do.
    pub wake: Notify,
    /// Imports that may run.
    pub imports: Semaphore,
    /// Room for results that wait for their merge.
    pub room: Arc<Semaphore>,
    /// Threads of owners.
    pub owners: TaskTracker,
    /// Everything else in the background.
    pub tasks: TaskTracker,
    /// Ends everything.
    pub shutdown: CancellationToken,
    /// Whoever holds it writes a worker's record.
    pub saving_workers: tokio::sync::Mutex<()>,
    state: Mutex<State>,
    manifests: Mutex<HashMap<(Uuid, u32), Manifest>>,
    tokens: AtomicU64,
    ready: AtomicBool,
    broken: watch::Sender<Option<StoreError>>,
}

impl Farm {
    /// Opens the store and takes up what is in it.
    pub async fn start(config: Config) -> Result<Arc<Self>, ServeError> {
        let stores = match config.store.clone() {
            StoreConfig::Memory => store::memory::open(),
            StoreConfig::Embedded(folder) => tokio::task::spawn_blocking(move || {
                store::embedded::open(&folder, store::embedded::Options::default())
            })
            .await
            .map_err(|_| ServeError::Panicked)??,
        };
        Self::with_stores(config, stores).await
    }

    /// The same, with stores that are open already.
    pub async fn with_stores(config: Config, stores: Stores) -> Result<Arc<Self>, ServeError> {
        let farm = Arc::new(Farm {
            clock: Clock::start(),
            refs: BlobRefs::new(stores.blobs.clone()),
            films: Films::default(),
            events: Events::default(),
            metrics: Metrics::default(),
            wake: Notify::new(),
            imports: Semaphore::new(config.limits.imports),
            room: Arc::new(Semaphore::new(RESULTS_IN_FLIGHT)),
            owners: TaskTracker::new(),
            tasks: TaskTracker::new(),
            shutdown: CancellationToken::new(),
            saving_workers: tokio::sync::Mutex::default(),
            state: Mutex::default(),
            manifests: Mutex::default(),
            tokens: AtomicU64::new(1),
            ready: AtomicBool::new(false),
            broken: watch::Sender::new(None),
            config,
            stores,
        });
        // Before frames are read: whoever is in quarantine is taken out of them.
        farm.recover_workers().await?;
        farm.recover().await?;
        farm.ready.store(true, Ordering::Release);
        farm.tasks.spawn(crate::ticker::run(farm.clone()));
        Ok(farm)
    }

    /// Whether it takes calls.
    pub fn is_ready(&self) -> bool {
        self.ready.load(Ordering::Acquire) && !self.shutdown.is_cancelled()
    }

    /// Notes an error after which only a restart helps; the first one counts.
    pub fn give_up(&self, error: &StoreError) {
        self.broken.send_if_modified(|broken| {
            let first = broken.is_none();
            if first {
                *broken = Some(error.clone());
            }
            first
        });
    }

    /// Waits for such an error.
    pub async fn broken(&self) -> StoreError {
        let mut broken = self.broken.subscribe();
        let found = broken.wait_for(Option::is_some).await;
        match found.ok().and_then(|error| error.clone()) {
            Some(error) => error,
            // The sender lives as long as this farm.
            None => std::future::pending().await,
        }
    }

    /// What is in memory. Nobody waits for anything while holding it.
    pub fn state(&self) -> MutexGuard<'_, State> {
        // A panic under the lock leaves at worst a lease or a count that is off; results are
        // checked against the film when they are merged.
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Does something with a job.
    pub fn with_job<T>(
        &self,
        id: Uuid,
        f: impl FnOnce(&mut Job) -> Result<T, ApiError>,
    ) -> Result<T, ApiError> {
        match self.state().jobs.get_mut(&id) {
            Some(job) => f(job),
            None => Err(no_job(id)),
        }
    }

    /// A number that was not given before.
    pub fn next_token(&self) -> u64 {
        self.tokens.fetch_add(1, Ordering::Relaxed)
    }

    /// What is in the store of a frame in work.
    pub fn manifest(&self, job: Uuid, frame: u32) -> Option<Manifest> {
        let manifests = self
            .manifests
            .lock()
            .unwrap_or_else(PoisonError::into_inner);
        manifests.get(&(job, frame)).cloned()
    }

    /// Notes what is in the store of a frame in work.
    pub fn set_manifest(&self, job: Uuid, frame: u32, manifest: Option<Manifest>) {
        let mut manifests = self
            .manifests
            .lock()
            .unwrap_or_else(PoisonError::into_inner);
        match manifest {
            Some(manifest) => manifests.insert((job, frame), manifest),
            None => manifests.remove(&(job, frame)),
        };
    }

    /// Writes a job's record. Whoever comes later writes what is later.
    pub async fn save(&self, id: Uuid) -> Result<(), StoreError> {
        let Some(lock) = self.state().jobs.get(&id).map(|j| j.revision.clone()) else {
            return Ok(());
        };
        let mut revision = lock.lock().await;
        let encoded = match self.state().jobs.get_mut(&id) {
            Some(job) => {
                job.tick(self.clock.now());
                job.record.encode()
            }
            None => return Ok(()),
        };
        let bytes = encoded.map_err(|e| StoreError::Unavailable {
            reason: format!("the record of job {id} cannot be written: {e}"),
        })?;
        match self.stores.jobs.cas(id, *revision, bytes).await {
            Ok(next) => {
                *revision = next;
                Ok(())
            }
            // Deleted meanwhile.
            Err(StoreError::NotFound { .. }) => Ok(()),
            Err(error) => Err(error),
        }
    }

    /// Tells everyone how a job stands.
    pub fn tell_job(&self, id: Uuid) {
        let event = {
            let mut state = self.state();
            let now = self.clock.now();
            let state = &mut *state;
            let Some(job) = state.jobs.get_mut(&id) else {
                return;
            };
            job.dirty = false;
            let changed = std::mem::take(&mut job.changed);
            if !self.events.is_heard() {
                return;
            }
            let version = job.record.image_version;
            let job = Box::new(status::of(job, &state.workers, now, &self.config));
            (Event::Job { job }, changed, version)
        };
        let (job, changed, image_version) = event;
        for (frame, tiles) in changed {
            self.events.send(Event::Image {
                job: id,
                frame,
                image_version,
                tiles: tiles.into_iter().collect(),
            });
        }
        self.events.send(job);
    }

    /// Starts the owner of a job unless it runs.
    pub fn order(self: &Arc<Self>, job: &mut Job, order: Order) -> Result<(), StoreError> {
        if job.owner.is_none() {
            job.owner = Some(Owner::start(self, job.record.id)?);
        }
        if let Some(owner) = &job.owner {
            owner.send(order);
        }
        Ok(())
    }

    /// Asks the owner of a job to see again, a little later, whether it is complete.
    pub fn review_later(self: &Arc<Self>, id: Uuid) {
        let farm = Arc::downgrade(self);
        let shutdown = self.shutdown.clone();
        self.tasks.spawn(async move {
            tokio::select! {
                () = tokio::time::sleep(std::time::Duration::from_secs(1)) => {}
                () = shutdown.cancelled() => return,
            }
            if let Some(farm) = farm.upgrade()
                && let Some(job) = farm.state().jobs.get_mut(&id)
                && let Err(error) = farm.order(job, Order::Review)
            {
                tracing::error!(job.id = %id, %error, "no owner");
            }
        });
    }

    /// Writes a checkpoint now; returns when it is committed.
    pub async fn checkpoint(self: &Arc<Self>, id: Uuid) -> Result<(), StoreError> {
        let (answer, wait) = oneshot::channel();
        {
            let state = self.state();
            match state.jobs.get(&id).and_then(|j| j.owner.as_ref()) {
                Some(owner) => owner.send(Order::Checkpoint(answer)),
                None => return Ok(()),
            }
        }
        wait.await.unwrap_or(Ok(()))
    }

    /// Reads what is in the store.
    async fn recover(self: &Arc<Self>) -> Result<(), ServeError> {
        let mut before = None;
        loop {
            let page = self.stores.jobs.list(before, PAGE).await?;
            let Some(last) = page.last() else {
                break;
            };
            before = Some(last.id);
            for stored in page {
                let record = JobRecord::decode(&stored.record).map_err(|why| {
                    ServeError::Store(StoreError::Damaged {
                        what: format!("the record of job {}: {why}", stored.id),
                    })
                })?;
                self.refs.hold(record.file_blobs());
                for frame in record.begun.values() {
                    for kept in [&frame.current, &frame.previous].into_iter().flatten() {
                        match checkpoint::blobs_of(self, kept) {
                            Ok(blobs) => self.refs.hold(blobs),
                            Err(error) => {
                                tracing::error!(job.id = %stored.id, %error, "a checkpoint is damaged")
                            }
                        }
                    }
                }
                let job = Job::new(record, stored.revision);
                self.state().jobs.insert(stored.id, job);
            }
        }
        let mut reload = Vec::new();
        let mut recheck = Vec::new();
        let mut over = Vec::new();
        for (id, job) in &mut self.state().jobs {
            match job.record.state {
                JobState::Checking => recheck.push(*id),
                state if state.is_final() => over.push(*id),
                _ => {
                    job.open_frames();
                    reload.extend(
                        std::mem::take(&mut job.to_load)
                            .into_iter()
                            .map(|f| (*id, f)),
                    );
                }
            }
        }
        for id in self.stores.log.jobs() {
            if !self.state().jobs.contains_key(&id) || over.contains(&id) {
                self.stores.log.purge(id)?;
            }
        }
        for (id, frame) in reload {
            self.load_frame(id, frame).await?;
        }
        let now = self.clock.now();
        let held = self.refs.held();
        let farm = self.clone();
        let young = tokio::task::spawn_blocking(move || farm.stores.blobs.list())
            .await
            .map_err(|_| ServeError::Panicked)??;
        self.state().young = young
            .into_iter()
            .filter(|d| !held.contains(d))
            .map(|d| (d, now))
            .collect();
        for id in recheck {
            self.tasks.spawn(crate::import::run(self.clone(), id));
        }
        Ok(())
    }

    /// Reads a frame that was begun before, and plans what is missing of it.
    pub async fn load_frame(self: &Arc<Self>, id: Uuid, frame: u32) -> Result<(), StoreError> {
        let farm = self.clone();
        let loading = tokio::task::spawn_blocking(move || farm.load_frame_now(id, frame));
        loading.await.unwrap_or_else(|_| {
            Err(StoreError::Damaged {
                what: format!("frame {frame} of job {id} cannot be read"),
            })
        })?;
        // The gap in the versions counts from what is saved: the next restart needs another one.
        self.save(id).await
    }

    fn load_frame_now(self: &Arc<Self>, id: Uuid, frame: u32) -> Result<(), StoreError> {
        let Some(record) = self.state().jobs.get(&id).map(|j| j.record.clone()) else {
            return Ok(());
        };
        let mut newer = 0;
        let film = match self.films.pinned(id, frame) {
            Some(film) => film,
            None => {
                let restored = checkpoint::restore(self, &record, frame)?;
                tracing::info!(job.id = %id, frame, replayed = restored.replayed, "frame taken up again");
                newer = restored.replayed + VERSION_GAP;
                self.set_manifest(id, frame, restored.manifest);
                self.films.replace(id, frame, restored.film)
            }
        };
        let film = film.read().unwrap_or_else(PoisonError::into_inner);
        let mut plan = FramePlan::new(frame, record.grid().count(), record.frame_rule(frame));
        for (tile, index) in film.tiles().iter().zip(0..) {
            for merged in tile.merged_units() {
                let unit = Unit {
                    frame,
                    tile: index,
                    samples: merged.samples,
                };
                // Names of workers are their ids.
                let worker = merged.worker.parse().unwrap_or_default();
                plan.accept(&unit, merged.digest, worker);
            }
        }
        settle(&mut plan, &film);
        let mut state = self.state();
        let state = &mut *state;
        let Some(job) = state.jobs.get_mut(&id) else {
            return Ok(());
        };
        job.to_load.remove(&frame);
        let about = job.record.begun.entry(frame).or_default();
        job.record.image_version += newer;
        about.done = false;
        about.stats = stats_of(&film);
        job.last_point = (job.totals().0, job.record.run_seconds);
        job.plans.insert(frame, plan);
        job.dirty = true;
        // Who was taken out while the frame was not in memory.
        let untrusted = state.workers.values().filter(|w| w.quarantined.is_some());
        for worker in untrusted {
            audit::clear_touched(self, job, worker.id, self.clock.now());
        }
        let complete = job.plans.get(&frame).is_some_and(FramePlan::is_complete);
        if complete {
            self.order(job, Order::Review)?;
        }
        self.wake.notify_waiters();
        Ok(())
    }

    /// Checkpoints everything and ends the owners.
    pub async fn close(self: &Arc<Self>) {
        self.shutdown.cancel();
        self.wake.notify_waiters();
        self.tasks.close();
        self.tasks.wait().await;
        let owned: Vec<Uuid> = {
            let state = self.state();
            state
                .jobs
                .iter()
                .filter(|(_, j)| j.owner.is_some())
                .map(|(id, _)| *id)
                .collect()
        };
        for id in owned {
            if let Err(error) = self.checkpoint(id).await {
                tracing::error!(job.id = %id, %error, "no last checkpoint; the log has what it lacks");
            }
        }
        for job in self.state().jobs.values_mut() {
            if let Some(owner) = job.owner.take() {
                owner.send(Order::Stop);
            }
        }
        self.owners.close();
        self.owners.wait().await;
    }
}

/// Tells a plan what a film has, until no tile has anything more to decide.
pub fn settle(plan: &mut FramePlan, film: &film::Film) {
    for (tile, index) in film.tiles().iter().zip(0..) {
        let spp = tile.spp();
        let error = || {
            let whole = tile.samples() == spp;
            tile.error().filter(|_| whole)
        };
        plan.merged(index, spp, error);
    }
}

/// There is no such job.
pub fn no_job(id: Uuid) -> ApiError {
    ApiError::new(NO_JOB, format!("no job {id}"))
}
