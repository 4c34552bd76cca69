//! Other bytes for a unit of a finished frame: the picture may be wrong, so the frame is taken up
//! again and the two results are audited like those of a frame in work. Its film has everything: if
//! the one who disagrees is wrong, the frame is complete as soon as that is known; if what is in the
//! film is wrong, the touched tiles are rendered again, up to the samples that they had.

use crate::control;
use crate::farm::Farm;
use crate::job::Audit;
use crate::results::Delivery;
use film::Film;
use protocol::JobState;
use std::sync::Arc;
use uuid::Uuid;

/// What a finished film has of a unit.
pub struct Merged {
    /// BLAKE3 of the bytes.
    pub digest: [u8; 32],
    /// Who rendered it.
    pub worker: Uuid,
    /// Samples of every tile: what a time limit came to.
    pub counts: Vec<u32>,
}

impl Merged {
    /// Looks for the unit of a delivery.
    pub fn find(film: &Film, delivery: &Delivery) -> Option<Merged> {
        let tile = film.tile(delivery.unit.tile)?;
        let units = tile.merged_units();
        let unit = units.iter().find(|m| m.samples == delivery.unit.samples)?;
        Some(Merged {
            digest: unit.digest,
            // Names of workers are their ids.
            worker: unit.worker.parse().unwrap_or_default(),
            counts: film.tiles().iter().map(|t| t.spp()).collect(),
        })
    }
}

/// Takes the frame up again and opens an audit. False if it is no longer finished.
pub fn reopen(farm: &Arc<Farm>, delivery: &Delivery, merged: Merged) -> bool {
    let (id, unit) = (delivery.job, delivery.unit);
    {
        let now = farm.clock.now();
        let mut state = farm.state();
        let Some(job) = state.jobs.get_mut(&id) else {
            return false;
        };
        let over = matches!(job.record.state, JobState::Failed | JobState::Cancelled);
        let record = &mut job.record;
        let Some(frame) = record
            .begun
            .get_mut(&unit.frame)
            .filter(|f| f.done && !over)
        else {
            return false;
        };
        frame.done = false;
        if record.stop.time.is_some() {
            // The time is spent: what is rendered again ends where it ended.
            frame.stopped_at.get_or_insert(merged.counts);
        }
        if unit.frame == record.frames[0] {
            record.digest = None;
        }
        if record.frame_count() == 1 {
            record.target_met = None;
        }
        if record.state == JobState::Done {
            record.state = JobState::Queued;
            record.finished_at = None;
            job.waiting_since = now;
        }
        job.to_load.insert(unit.frame);
        job.audits.insert(
            unit,
            Audit {
                claims: vec![
                    (merged.digest, merged.worker),
                    (delivery.digest, delivery.worker),
                ],
                since: now,
                leased: None,
            },
        );
        tracing::error!(job.id = %id, unit.id = %unit, worker.id = %delivery.worker, other = %merged.worker, "two results of a unit of a finished frame differ");
        let text = format!(
            "unit {unit}: another result differs from the finished picture; a third worker renders it again"
        );
        job.note(now, "error", text, None, Some(delivery.worker));
    }
    control::save_later(farm, id);
    farm.tell_job(id);
    true
}
