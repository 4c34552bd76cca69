//! What people are told while a job is merged: sums, error and speed. The film has the truth.

use crate::job::Job;
use crate::record::FrameStats;
use film::Film;
use protocol::HistoryPoint;

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

/// Notes error and speed in the history.
pub(super) fn point(job: &mut Job, now: u64) {
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
