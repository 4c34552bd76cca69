//! Jobs: what is asked for and how it stands.

use crate::TimestampMs;
use crate::problem::{Finding, Problem};
use scene::Look;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use utoipa::ToSchema;
use uuid::Uuid;

/// When a job is done: whichever comes first. Nothing set: the file's spp, else 64.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Stop {
    /// Samples per pixel.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub spp: Option<u32>,
    /// Error as the design defines it; alone it is capped at 65,536 spp.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub noise: Option<f64>,
    /// Accumulated running time, seconds.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub time: Option<f64>,
    /// Samples by tile, as `/tiles` gives them: repeats a picture that ended by time.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub samples: Option<Vec<u32>>,
}

/// Body of `POST /v1/jobs`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct JobRequest {
    /// Path of the main file among `files`.
    pub scene: String,
    /// Every file of the scene: path to BLAKE3 digest in lower-case hex.
    pub files: BTreeMap<String, String>,
    /// For people.
    #[serde(skip_serializing_if = "Option::is_none", default)]
    pub name: Option<String>,
    /// 0 to 100, higher first; default 50.
    #[serde(skip_serializing_if = "Option::is_none", default)]
    pub priority: Option<u8>,
    /// Default 0.
    #[serde(default)]
    pub seed: u64,
    /// Width and height in pixels.
    #[serde(skip_serializing_if = "Option::is_none", default)]
    pub size: Option<[u32; 2]>,
    /// By name.
    #[serde(skip_serializing_if = "Option::is_none", default)]
    pub integrator: Option<String>,
    /// When it is done.
    #[serde(default)]
    pub stop: Stop,
    /// Camera, variant and environment from outside.
    #[serde(default)]
    #[schema(value_type = Object)]
    pub look: Look,
    /// First and last frame, inclusive; default: frame 0 alone.
    #[serde(skip_serializing_if = "Option::is_none", default)]
    pub frames: Option<[u32; 2]>,
    /// Missing files become warnings.
    #[serde(default)]
    pub allow_missing: bool,
    /// Biased upper bound on indirect radiance.
    #[serde(skip_serializing_if = "Option::is_none", default)]
    pub clamp_indirect: Option<f32>,
}

/// What a worker needs to know about a job to render its units: the same for all of them. Together
/// with the files it determines every sample.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct JobSpec {
    /// Path of the main file among `files`.
    pub scene: String,
    /// Every file of the scene: path to BLAKE3 digest.
    pub files: BTreeMap<String, String>,
    /// Seed of the sampler.
    pub seed: u64,
    /// What the job changes about the scene.
    #[schema(value_type = Object)]
    pub overrides: scene::Overrides,
    /// Picture size after all overrides and crops.
    pub size: [u32; 2],
}

/// Life of a job.
#[derive(
    Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize, ToSchema,
)]
#[serde(rename_all = "lowercase")]
pub enum JobState {
    /// The scene is being imported and checked.
    Checking,
    /// Nothing is leased yet.
    Queued,
    /// Units are being rendered.
    Running,
    /// Held by a person.
    Paused,
    /// The stop rule is met.
    Done,
    /// Ended by an error.
    Failed,
    /// Ended by a person.
    Cancelled,
}

impl JobState {
    /// Whether nothing more happens without a person.
    pub fn is_final(self) -> bool {
        matches!(
            self,
            JobState::Done | JobState::Failed | JobState::Cancelled
        )
    }
}

/// Answer to `GET /v1/jobs/{id}`, and an element of lists.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct JobStatus {
    /// UUIDv7.
    pub id: Uuid,
    /// For people.
    pub name: String,
    /// Life.
    pub state: JobState,
    /// 0 to 100.
    pub priority: u8,
    /// Seed.
    pub seed: u64,
    /// Picture width in pixels; 0 while checking.
    pub width: u32,
    /// Picture height in pixels; 0 while checking.
    pub height: u32,
    /// First and last frame, inclusive.
    pub frames: [u32; 2],
    /// Mean samples per pixel merged so far.
    pub spp: f64,
    /// Stop rule in force.
    pub stop: Stop,
    /// Remaining error as the design defines it; absent below 2 spp.
    #[serde(skip_serializing_if = "Option::is_none", default)]
    pub error: Option<f64>,
    /// `estimate` or `bound`.
    pub error_kind: String,
    /// Whether a noise target was reached (done jobs with a target).
    #[serde(skip_serializing_if = "Option::is_none", default)]
    pub target_met: Option<bool>,
    /// Share of the work done, 0 to 1, where it can be known.
    #[serde(skip_serializing_if = "Option::is_none", default)]
    pub progress: Option<f64>,
    /// Seconds left, where that can be told.
    #[serde(skip_serializing_if = "Option::is_none", default)]
    pub eta_seconds: Option<f64>,
    /// Camera samples merged.
    pub samples: u64,
    /// Rays traced for them, all kinds.
    pub rays: u64,
    /// Samples that were not finite or out of range.
    pub rejected_samples: u64,
    /// Longest preparation of the scene by a worker, seconds.
    pub prepare_seconds: f64,
    /// Accumulated running time from the first to the last unit, seconds.
    pub render_seconds: f64,
    /// Processor time of the units, seconds.
    pub cpu_seconds: f64,
    /// Units merged and units handed out now.
    pub units_merged: u64,
    /// Units handed out now.
    pub units_leased: u32,
    /// Workers that hold a lease of it.
    pub workers: u32,
    /// Rises with every change of the merged picture; never falls.
    pub image_version: u64,
    /// BLAKE3 of the merged state of a finished job's first frame.
    #[serde(skip_serializing_if = "Option::is_none", default)]
    pub digest: Option<String>,
    /// Engine version that renders it.
    pub engine_version: u32,
    /// What the checks found.
    pub warnings: Vec<Finding>,
    /// Why it failed.
    #[serde(skip_serializing_if = "Option::is_none", default)]
    pub problem: Option<Problem>,
    /// Why nothing happens, if nothing does (no worker, paused, other engine version).
    #[serde(skip_serializing_if = "Option::is_none", default)]
    pub waiting_for: Option<String>,
    /// When it was submitted.
    pub created_at: TimestampMs,
    /// When its first unit was leased.
    #[serde(skip_serializing_if = "Option::is_none", default)]
    pub started_at: Option<TimestampMs>,
    /// When the first result was merged.
    #[serde(skip_serializing_if = "Option::is_none", default)]
    pub first_image_at: Option<TimestampMs>,
    /// When it ended.
    #[serde(skip_serializing_if = "Option::is_none", default)]
    pub finished_at: Option<TimestampMs>,
}

/// Answer to `GET /v1/jobs`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct JobList {
    /// Newest first.
    pub jobs: Vec<JobStatus>,
    /// Cursor of the next page.
    #[serde(skip_serializing_if = "Option::is_none", default)]
    pub next: Option<String>,
}

/// Body of `PATCH /v1/jobs/{id}`.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields, default)]
pub struct JobPatch {
    /// 0 to 100.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub priority: Option<u8>,
    /// For people.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub name: Option<String>,
    /// The new total, not an addition; a looser one is refused.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub stop: Option<Stop>,
    /// Hold or go on.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub paused: Option<bool>,
}

/// Answer to `POST /v1/scenes/check`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct CheckReport {
    /// No finding is an error.
    pub ok: bool,
    /// In the order of the input.
    pub findings: Vec<Finding>,
}

/// One tile in the answer to `GET /v1/jobs/{id}/tiles`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct TileStatus {
    /// Left edge in pixels.
    pub x: u32,
    /// Top edge in pixels.
    pub y: u32,
    /// Pixels.
    pub width: u32,
    /// Pixels.
    pub height: u32,
    /// Samples per pixel merged without a gap.
    pub spp: u32,
    /// Its own error.
    #[serde(skip_serializing_if = "Option::is_none", default)]
    pub error: Option<f64>,
    /// `queued`, `leased`, `merged` (more to come) or `done`.
    pub state: String,
    /// Who rendered it last.
    #[serde(skip_serializing_if = "Option::is_none", default)]
    pub worker: Option<String>,
}

/// Answer to `GET /v1/jobs/{id}/tiles`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct TileList {
    /// Frame number.
    pub frame: u32,
    /// Row by row from the top left.
    pub tiles: Vec<TileStatus>,
    /// Sample counts alone, ready for `stop.samples`.
    pub samples: Vec<u32>,
}

/// One point of `GET /v1/jobs/{id}/history`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct HistoryPoint {
    /// When.
    pub at: TimestampMs,
    /// Accumulated running time, seconds.
    pub seconds: f64,
    /// Mean samples per pixel.
    pub spp: f64,
    /// Error then.
    #[serde(skip_serializing_if = "Option::is_none", default)]
    pub error: Option<f64>,
    /// Camera samples a second since the last point.
    pub samples_per_second: f64,
}

/// One line of `GET /v1/jobs/{id}/log`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct LogLine {
    /// When.
    pub at: TimestampMs,
    /// `info`, `warn` or `error`.
    pub level: String,
    /// What happened.
    pub message: String,
    /// Which unit.
    #[serde(skip_serializing_if = "Option::is_none", default)]
    pub unit: Option<String>,
    /// Which attempt.
    #[serde(skip_serializing_if = "Option::is_none", default)]
    pub attempt: Option<u32>,
    /// Which worker.
    #[serde(skip_serializing_if = "Option::is_none", default)]
    pub worker: Option<String>,
}
