//! Merging: results into films as they come, and what a tile's new state decides.

use super::stats::{point, stats_of};
use super::{Arrived, Work};
use crate::farm::Farm;
use crate::films::SharedFilm;
use bytes::Bytes;
use film::{Film, MergeError, Merged, PackedUnit, Unit};
use std::sync::{Arc, PoisonError};
use std::time::{Duration, Instant};

/// Time between looks at the error of the whole picture.
const ERROR_EVERY: Duration = Duration::from_millis(500);
impl Work {
    /// The film of a frame, made when its first result comes.
    pub(super) fn film(&self, farm: &Farm, frame: u32) -> Option<SharedFilm> {
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

    pub(super) fn merge(&mut self, farm: &Arc<Farm>, arrived: Arrived) {
        let unit = arrived.result.unit();
        let Some(film) = self.film(farm, unit.frame) else {
            return;
        };
        let merged = film
            .write()
            .unwrap_or_else(PoisonError::into_inner)
            .merge_packed(&arrived.result, arrived.receipt);
        drop(arrived.room);
        if self.note(farm, unit, &film, &arrived.result, arrived.token, merged) {
            self.review(farm);
        }
    }

    /// Tells the plan what was merged. True if the job may be complete now.
    pub(super) fn note(
        &mut self,
        farm: &Farm,
        unit: Unit,
        film: &SharedFilm,
        result: &PackedUnit<Bytes>,
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
            tile.error()
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
                let counters = result.counters();
                stats.samples += u64::from(unit.samples.len()) * tile.tile().pixels() as u64;
                stats.rays += counters.rays + counters.shadow_rays;
                stats.rejected += result.rejected_count();
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

    pub(super) fn clear(&mut self, farm: &Arc<Farm>, frame: u32, tiles: &[u32], before: u64) {
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
}
