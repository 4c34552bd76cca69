//! One line on stderr that tells how a job comes on.

use indicatif::{HumanDuration, ProgressBar, ProgressDrawTarget, ProgressStyle};
use protocol::{JobState, JobStatus};
use std::time::{Duration, Instant};

/// Parts that the bar is cut into.
const STEPS: u64 = 1000;

/// Shown only where stderr is a terminal.
pub struct Progress {
    bar: ProgressBar,
    /// When the rate was last measured, the rays then, and the rate.
    rate: Option<(Instant, u64, f64)>,
}

impl Progress {
    /// An empty bar.
    pub fn new() -> Self {
        let bar = ProgressBar::with_draw_target(Some(STEPS), ProgressDrawTarget::stderr());
        if let Ok(style) = ProgressStyle::with_template("{bar:30} {msg}") {
            bar.set_style(style);
        }
        Progress { bar, rate: None }
    }

    /// Shows a new state.
    pub fn update(&mut self, job: &JobStatus) {
        let rate = self.rays_per_second(job.rays);
        self.bar
            .set_position((job.progress.unwrap_or(0.0).clamp(0.0, 1.0) * STEPS as f64) as u64);
        self.bar.set_message(line(job, rate));
    }

    /// Removes the bar.
    pub fn finish(&self) {
        self.bar.finish_and_clear();
    }

    fn rays_per_second(&mut self, rays: u64) -> f64 {
        let now = Instant::now();
        match self.rate {
            None => {
                self.rate = Some((now, rays, 0.0));
                0.0
            }
            Some((then, before, rate)) => {
                let seconds = (now - then).as_secs_f64();
                if seconds < 0.25 {
                    return rate;
                }
                let newest = rays.saturating_sub(before) as f64 / seconds;
                let rate = if rate == 0.0 {
                    newest
                } else {
                    rate + 0.4 * (newest - rate)
                };
                self.rate = Some((now, rays, rate));
                rate
            }
        }
    }
}

/// The words beside the bar; `watch` prints the same.
pub fn line(job: &JobStatus, rays_per_second: f64) -> String {
    let mut parts = Vec::new();
    match job.state {
        JobState::Running | JobState::Done => {}
        JobState::Checking => parts.push("checking the scene".to_owned()),
        other => parts.push(format!("{other:?}").to_lowercase()),
    }
    if job.state != JobState::Checking {
        match job.stop.spp {
            Some(target) => parts.push(format!("{:.1}/{target} spp", job.spp)),
            None => parts.push(format!("{:.1} spp", job.spp)),
        }
    }
    if let Some(error) = job.error {
        let relation = if job.error_kind == "bound" { "<" } else { "" };
        parts.push(format!("error {relation}{error:.4}"));
    }
    if rays_per_second > 0.0 {
        parts.push(format!("{:.2} Mrays/s", rays_per_second / 1e6));
    }
    if !job.state.is_final() {
        if let Some(seconds) = job.eta_seconds.filter(|s| s.is_finite() && *s >= 0.0) {
            let eta = Duration::from_secs_f64(seconds.min(1e9));
            parts.push(format!("{} left", HumanDuration(eta)));
        } else if let Some(reason) = &job.waiting_for {
            parts.push(format!("waiting for {reason}"));
        }
    }
    parts.join(", ")
}
