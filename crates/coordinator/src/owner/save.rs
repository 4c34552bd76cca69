//! Checkpoints: what changed of the frames in work, committed by the job's record.

use super::Work;
use crate::checkpoint;
use crate::farm::Farm;
use crate::record::Checkpoint;
use film::Manifest;
use futures::executor::block_on;
use std::sync::{Arc, PoisonError};
use store::StoreError;

impl Work {
    /// Writes what changed of every frame in work, and commits it.
    pub(super) fn checkpoint(&mut self, farm: &Arc<Farm>) -> Result<(), StoreError> {
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
    pub(super) fn save_frame(
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
    pub(super) fn commit(&self, farm: &Arc<Farm>) -> Result<(), StoreError> {
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
