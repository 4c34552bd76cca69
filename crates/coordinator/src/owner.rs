//! The merging owner of a job: one thread that merges results into films as they come, decides
//! about tiles at their borders, and writes checkpoints. Integer sums need no order, so it takes
//! results as they arrive.

use crate::checkpoint;
use crate::farm::Farm;
use crate::films::SharedFilm;
use crate::record::{Checkpoint, FrameStats, hex};
use film::{Film, Manifest, MergeError, Merged, Receipt, Unit, UnitResult};
use futures::executor::block_on;
use protocol::{HistoryPoint, JobState};
use std::sync::{Arc, PoisonError, Weak, mpsc};
use std::time::{Duration, Instant};
use store::StoreError;
use tokio::sync::{OwnedSemaphorePermit, oneshot};
use uuid::Uuid;

/// Time between looks at the error of the whole picture.
const ERROR_EVERY: Duration = Duration::from_millis(500);
/// Time after which a failed checkpoint is tried again.
const RETRY_AFTER: Duration = Duration::from_secs(2);

/// What an owner is asked to do, in this order.
pub enum Order {
    /// Merge a result that was accepted.
    Merge(Box<Arrived>),
    /// Clear tiles: their worker is not trusted.
    Clear {
        /// Of which frame.
        frame: u32,
        /// Which.
        tiles: Vec<u32>,
        /// Position of the log noted in the job's record.
        before: u64,
    },
    /// Write what changed.
    Checkpoint(oneshot::Sender<Result<(), StoreError>>),
    /// See whether the job is complete.
    Review,
    /// Forget everything and end.
    Stop,
}

/// A result on its way into the film.
pub struct Arrived {
    /// Decoded.
    pub result: UnitResult,
    /// Of its bytes.
    pub receipt: Receipt,
    /// How many those are.
    pub bytes: usize,
    /// Names it among those in flight.
    pub token: u64,
    /// Room in memory, given back when it is merged.
    pub room: OwnedSemaphorePermit,
}

/// Handle of an owner's thread.
pub struct Owner {
    orders: mpsc::Sender<Order>,
}

impl Owner {
    /// Starts the thread of a job.
    pub fn start(farm: &Arc<Farm>, job: Uuid) -> Result<Owner, StoreError> {
        let (orders, queue) = mpsc::channel();
        let work = Work {
            farm: Arc::downgrade(farm),
            job,
            bytes: 0,
            looked: None,
        };
        let token = farm.owners.token();
        std::thread::Builder::new()
            .name("merge".into())
            .spawn(move || {
                work.run(&queue);
                drop(token);
            })
            .map_err(|e| StoreError::Unavailable {
                reason: format!("no thread for merging: {e}"),
            })?;
        Ok(Owner { orders })
    }

    /// Gives an order. One that has ended needs none.
    pub fn send(&self, order: Order) {
        let _ = self.orders.send(order);
    }
}

struct Work {
    farm: Weak<Farm>,
    job: Uuid,
    /// Merged since the last checkpoint.
    bytes: u64,
    looked: Option<Instant>,
}

impl Work {
    fn run(mut self, queue: &mpsc::Receiver<Order>) {
        let mut due: Option<Instant> = None;
        loop {
            let order = match due {
                None => queue
                    .recv()
                    .map_err(|_| mpsc::RecvTimeoutError::Disconnected),
                Some(due) => queue.recv_timeout(due.saturating_duration_since(Instant::now())),
            };
            let Some(farm) = self.farm.upgrade() else {
                return;
            };
            let every = farm.config.checkpoint_every;
            match order {
                Ok(Order::Merge(arrived)) => {
                    self.bytes += arrived.bytes as u64;
                    self.merge(&farm, *arrived);
                    due = due.or_else(|| Some(Instant::now() + every));
                    if self.bytes >= farm.config.checkpoint_bytes {
                        due = Some(Instant::now());
                    }
                }
                Ok(Order::Clear {
                    frame,
                    tiles,
                    before,
                }) => {
                    self.clear(&farm, frame, &tiles, before);
                    due = Some(Instant::now());
                }
                Ok(Order::Checkpoint(answer)) => {
                    let result = self.checkpoint(&farm);
                    due = result.is_err().then(|| Instant::now() + RETRY_AFTER);
                    let _ = answer.send(result);
                }
                Ok(Order::Review) => self.review(&farm),
                Err(mpsc::RecvTimeoutError::Timeout) => {
                    due = self
                        .checkpoint(&farm)
                        .is_err()
                        .then(|| Instant::now() + RETRY_AFTER);
                }
                Ok(Order::Stop) | Err(mpsc::RecvTimeoutError::Disconnected) => return,
            }
        }
    }

    /// The film of a frame, made when its first result comes.
    fn film(&self, farm: &Farm, frame: u32) -> Option<SharedFilm> {
        if let Some(film) = farm.films.get(self.job, frame) {
            return Some(film);
        }
        let (grid, engine) = {
            let state = farm.state();
            let record = &state.jobs.get(&self.job)?.record;
            (record.grid(), film::EngineVersion(record.engine))
        };
        let film = Film::for_engine(grid, frame, engine);
        Some(farm.films.insert(self.job, frame, film, true))
    }

    fn merge(&mut self, farm: &Arc<Farm>, arrived: Arrived) {
        let unit = arrived.result.unit;
        let Some(film) = self.film(farm, unit.frame) else {
            return;
        };
        let merged = film
            .write()
            .unwrap_or_else(PoisonError::into_inner)
            .merge(&arrived.result, arrived.receipt);
        drop(arrived.room);
        if self.note(farm, unit, &film, &arrived.result, arrived.token, merged) {
            self.review(farm);
        }
    }

    /// Tells the plan what was merged. True if the job may be complete now.
    fn note(
        &mut self,
        farm: &Farm,
        unit: Unit,
        film: &SharedFilm,
        result: &UnitResult,
        token: u64,
        merged: Result<Merged, MergeError>,
    ) -> bool {
        let film = film.read().unwrap_or_else(PoisonError::into_inner);
        let Some(tile) = film.tile(unit.tile) else {
            return false;
        };
        let now = farm.clock.now();
        let spp = tile.spp();
        let decides = {
            let state = farm.state();
            let plan = state
                .jobs
                .get(&self.job)
                .and_then(|j| j.plans.get(&unit.frame));
            plan.is_some_and(|p| p.goal().noise.is_some() && spp >= p.limit(unit.tile).0)
        };
        // Outside of the lock: it looks at every pixel of the tile.
        let error = if decides && tile.samples() == spp {
            tile.errors().map(|e| e.of(film::error::ERROR_KIND))
        } else {
            None
        };
        let look = self.looked.is_none_or(|at| at.elapsed() >= ERROR_EVERY);
        let picture = look.then(|| {
            self.looked = Some(Instant::now());
            film.error().map(|e| e.value)
        });
        let mut state = farm.state();
        let state = &mut *state;
        let Some(job) = state.jobs.get_mut(&self.job) else {
            return false;
        };
        job.in_flight.remove(&token);
        match merged {
            Ok(Merged::Added) => {
                farm.metrics.merged();
                job.record.image_version += 1;
                job.record.first_image_at.get_or_insert(now);
                job.changed.entry(unit.frame).or_default().insert(unit.tile);
                let stats = &mut job.record.begun.entry(unit.frame).or_default().stats;
                let counters = &result.counters;
                stats.samples += u64::from(unit.samples.len()) * tile.tile().pixels() as u64;
                stats.rays += counters.rays + counters.shadow_rays;
                stats.rejected += result.buffer.rejected_count();
                stats.units += 1;
                if let Some(error) = picture {
                    stats.error = error;
                }
                job.dirty = true;
            }
            Ok(Merged::AlreadyMerged) => {}
            Err(error) => {
                // It was checked when it came; what still fails is rendered again.
                tracing::warn!(job.id = %self.job, unit.id = %unit, %error, "a result is not merged");
                job.note(
                    now,
                    "warn",
                    format!("a result is not merged: {error}"),
                    None,
                    None,
                );
                if let Some(plan) = job.plans.get_mut(&unit.frame) {
                    plan.reject(&unit);
                }
                farm.wake.notify_waiters();
                return false;
            }
        }
        if picture.is_some() {
            point(job, now);
        }
        let Some(plan) = job.plans.get_mut(&unit.frame) else {
            return false;
        };
        let offered = plan.has_ready();
        plan.merged(unit.tile, spp, || error);
        let settled = plan.tile_state(unit.tile) == "done";
        let complete = plan.is_complete();
        if plan.has_ready() && !offered {
            farm.wake.notify_waiters();
        }
        if settled {
            // Kept in the tile: the digest of the whole picture is then quickly made.
            tile.digest();
        }
        complete
    }

    fn clear(&mut self, farm: &Arc<Farm>, frame: u32, tiles: &[u32], before: u64) {
        let mut stats = None;
        if let Some(film) = farm.films.get(self.job, frame) {
            let mut film = film.write().unwrap_or_else(PoisonError::into_inner);
            tiles.iter().for_each(|tile| film.clear(*tile));
            stats = Some(stats_of(&film));
        }
        if let Some(job) = farm.state().jobs.get_mut(&self.job) {
            if let Some(at) = job.clearing.iter().position(|b| *b == before) {
                job.clearing.remove(at);
            }
            job.record.image_version += 1;
            job.changed.entry(frame).or_default().extend(tiles);
            if let Some(stats) = stats {
                job.record.begun.entry(frame).or_default().stats = stats;
            }
            job.dirty = true;
        }
    }

    /// Writes what changed of every frame in work, and commits it.
    fn checkpoint(&mut self, farm: &Arc<Farm>) -> Result<(), StoreError> {
        if !farm.stores.durable {
            return Ok(());
        }
        let (frames, log_pos) = {
            let state = farm.state();
            let Some(job) = state.jobs.get(&self.job) else {
                return Ok(());
            };
            let frames: Vec<u32> = job.plans.keys().copied().collect();
            // Results up to here are merged: nothing earlier is on its way.
            let first = job
                .in_flight
                .values()
                .map(|(_, p)| *p)
                .chain(job.clearing.iter().copied())
                .min();
            (frames, first.unwrap_or_else(|| farm.stores.log.end()))
        };
        for frame in frames {
            self.save_frame(farm, frame, log_pos, false)?;
        }
        self.bytes = 0;
        self.commit(farm)
    }

    /// Writes one frame and notes it in the record, which is not saved yet.
    fn save_frame(
        &mut self,
        farm: &Arc<Farm>,
        frame: u32,
        log_pos: u64,
        done: bool,
    ) -> Result<(), StoreError> {
        let Some(film) = farm.films.get(self.job, frame) else {
            return Ok(());
        };
        let old: Option<Manifest> = farm.manifest(self.job, frame);
        let film = film.read().unwrap_or_else(PoisonError::into_inner);
        if !done && old.is_some() && film.changed_since(old.as_ref()).is_empty() {
            return Ok(());
        }
        let (checkpoint, manifest) = checkpoint::write(farm, &film, old.as_ref(), log_pos)?;
        drop(film);
        let dropped = {
            let mut state = farm.state();
            let Some(job) = state.jobs.get_mut(&self.job) else {
                drop(state);
                release(farm, &checkpoint);
                return Ok(());
            };
            let about = job.record.begun.entry(frame).or_default();
            let dropped = std::mem::replace(&mut about.previous, about.current.take());
            let covered = about
                .previous
                .as_ref()
                .map_or(0, |c| c.log_pos)
                .min(log_pos);
            about.voids.retain(|v| v.before >= covered);
            about.current = Some(checkpoint);
            dropped
        };
        farm.set_manifest(self.job, frame, Some(manifest));
        if let Some(dropped) = dropped {
            release(farm, &dropped);
        }
        Ok(())
    }

    /// Saves the record, then trims the log behind the previous checkpoints.
    fn commit(&self, farm: &Arc<Farm>) -> Result<(), StoreError> {
        block_on(farm.save(self.job))?;
        let trim = {
            let state = farm.state();
            let Some(job) = state.jobs.get(&self.job) else {
                return Ok(());
            };
            let open = job.plans.keys().filter_map(|f| job.record.begun.get(f));
            open.map(|f| f.previous.as_ref().map_or(0, |c| c.log_pos))
                .min()
        };
        farm.stores.log.trim(self.job, trim.unwrap_or(0))
    }

    /// Ends frames that are complete, and the job with the last of them.
    fn review(&mut self, farm: &Arc<Farm>) {
        loop {
            let (frame, log_pos, last) = {
                let mut state = farm.state();
                let Some(job) = state.jobs.get_mut(&self.job) else {
                    return;
                };
                if job.record.state == JobState::Paused || job.record.state.is_final() {
                    return;
                }
                let Some(frame) = job
                    .plans
                    .iter()
                    .find(|(f, p)| p.is_complete() && !job.audits.keys().any(|u| u.frame == **f))
                    .map(|(f, _)| *f)
                else {
                    return;
                };
                let first = job
                    .in_flight
                    .values()
                    .map(|(_, p)| *p)
                    .chain(job.clearing.iter().copied())
                    .min();
                if !job.clearing.is_empty() {
                    return; // cleared tiles are not complete; the order is on its way
                }
                let [first_frame, last_frame] = job.record.frames;
                let others = (first_frame..=last_frame)
                    .any(|f| f != frame && !job.record.begun.get(&f).is_some_and(|b| b.done));
                (
                    frame,
                    first.unwrap_or_else(|| farm.stores.log.end()),
                    !others,
                )
            };
            if let Err(error) = self.finish_frame(farm, frame, log_pos, last) {
                tracing::error!(job.id = %self.job, frame, %error, "a finished frame could not be saved; trying again");
                if let Some(job) = farm.state().jobs.get_mut(&self.job) {
                    job.note(
                        farm.clock.now(),
                        "error",
                        format!("frame {frame} could not be saved: {error}"),
                        None,
                        None,
                    );
                }
                farm.review_later(self.job);
                return;
            }
        }
    }

    fn finish_frame(
        &mut self,
        farm: &Arc<Farm>,
        frame: u32,
        log_pos: u64,
        last: bool,
    ) -> Result<(), StoreError> {
        // One frame in memory stays there; of many only the blobs stay.
        let keep = farm.stores.durable
            || farm
                .state()
                .jobs
                .get(&self.job)
                .is_some_and(|j| j.record.frame_count() > 1);
        if keep {
            self.save_frame(farm, frame, log_pos, true)?;
        }
        let (digest, error) = match farm.films.get(self.job, frame) {
            Some(film) => {
                let film = film.read().unwrap_or_else(PoisonError::into_inner);
                (Some(hex(&film.digest())), film.error().map(|e| e.value))
            }
            None => (None, None),
        };
        let now = farm.clock.now();
        {
            let mut state = farm.state();
            let Some(job) = state.jobs.get_mut(&self.job) else {
                return Ok(());
            };
            // Something may have come between: an extension, a cleared tile.
            if !job.plans.get(&frame).is_some_and(|p| p.is_complete()) {
                return Ok(());
            }
            let met = job.record.stop.noise.map(|target| {
                farm.films.get(self.job, frame).is_some_and(|film| {
                    let film = film.read().unwrap_or_else(PoisonError::into_inner);
                    film.tiles().iter().all(|t| {
                        t.errors()
                            .is_some_and(|e| e.of(film::error::ERROR_KIND) <= target)
                    })
                })
            });
            job.plans.remove(&frame);
            let about = job.record.begun.entry(frame).or_default();
            about.done = true;
            about.stats.error = error;
            if let Some(met) = met {
                job.record.target_met = Some(job.record.target_met.unwrap_or(true) && met);
            }
            if frame == job.record.frames[0] {
                job.record.digest = digest;
            }
            if last {
                job.tick(now);
                point(job, now);
                job.record.state = JobState::Done;
                job.record.finished_at = Some(now);
                job.owner = None; // this thread ends with what is in its queue
                let how = match (job.record.timed_out, met) {
                    (true, _) => "done: the time is up",
                    (_, Some(false)) => {
                        "done: the samples are spent, the noise target is not reached"
                    }
                    (_, Some(true)) => "done: the noise target is reached",
                    _ => "done",
                };
                job.note(now, "info", how.into(), None, None);
                tracing::info!(job.id = %self.job, "{how}");
            }
            job.dirty = true;
        }
        farm.set_manifest(self.job, frame, None);
        if keep {
            farm.films.unpin(self.job, frame);
        }
        if last {
            farm.tell_job(self.job);
        }
        farm.wake.notify_waiters();
        block_on(farm.save(self.job))?;
        if last && farm.stores.durable {
            farm.stores.log.purge(self.job)?;
        }
        Ok(())
    }
}

/// What people are told about a film.
pub fn stats_of(film: &Film) -> FrameStats {
    let counters = film.counters();
    FrameStats {
        samples: film.samples(),
        rays: counters.rays + counters.shadow_rays,
        rejected: film.tiles().iter().map(|t| t.rejected_count()).sum(),
        units: film
            .tiles()
            .iter()
            .map(|t| t.merged_units().len() as u64)
            .sum(),
        error: film.error().map(|e| e.value),
    }
}

/// Lets go of the blobs of a checkpoint that nothing names any more.
pub fn release(farm: &Farm, checkpoint: &Checkpoint) {
    match checkpoint::blobs_of(farm, checkpoint) {
        Ok(blobs) => farm.refs.release(blobs),
        // Without the manifest its tiles are not known: the sweep at the next start finds them.
        Err(error) => {
            tracing::warn!(%error, manifest = checkpoint.manifest, "an old checkpoint is not removed")
        }
    }
}

/// Notes error and speed in the history.
fn point(job: &mut crate::job::Job, now: u64) {
    let (samples, ..) = job.totals();
    job.tick(now);
    let seconds = job.record.run_seconds;
    let (samples_before, seconds_before) = job.last_point;
    let span = seconds - seconds_before;
    if span <= 0.0 && !job.record.history.is_empty() {
        return;
    }
    let grid = job.record.grid();
    let pixels =
        f64::from(grid.width) * f64::from(grid.height) * f64::from(job.record.frame_count());
    let error = job
        .record
        .begun
        .values()
        .next_back()
        .and_then(|f| f.stats.error);
    job.last_point = (samples, seconds);
    job.record.point(HistoryPoint {
        at: now,
        seconds,
        spp: samples as f64 / pixels.max(1.0),
        error,
        samples_per_second: if span > 0.0 {
            samples.saturating_sub(samples_before) as f64 / span
        } else {
            0.0
        },
    });
}
