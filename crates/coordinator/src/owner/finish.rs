//! The end of a frame, and of its job with the last one.

use super::Work;
use super::stats::point;
use crate::farm::Farm;
use crate::record::{hex, is_open};
use futures::executor::block_on;
use protocol::JobState;
use std::sync::{Arc, PoisonError};
use store::StoreError;

/// How a job ends that has a time limit and no other, where 65,536 samples come first.
const SPENT_BEFORE_TIME: &str = "done: 65536 samples per pixel are spent before the time is up; \
                                 for more say a number of samples, too";

impl Work {
    /// Ends frames that are complete, and the job with the last of them.
    pub(super) fn review(&mut self, farm: &Arc<Farm>) {
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

    pub(super) fn finish_frame(
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
                    film.tiles()
                        .iter()
                        .all(|t| t.error().is_some_and(|error| error <= target))
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
                let only_time = is_open(&job.record.stop) && job.record.stop.noise.is_none();
                let how = match (job.record.timed_out, met) {
                    (true, _) => "done: the time is up",
                    _ if only_time => SPENT_BEFORE_TIME,
                    (_, Some(false)) => {
                        "done: the samples are spent, the noise target is not reached"
                    }
                    (_, Some(true)) => "done: the noise target is reached",
                    _ => "done",
                };
                if how == SPENT_BEFORE_TIME {
                    job.record.warn(how.to_owned());
                }
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
