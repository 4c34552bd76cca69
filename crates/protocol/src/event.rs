//! Server-sent events.

use crate::TimestampMs;
use crate::job::JobStatus;
use serde::{Deserialize, Serialize};
use utoipa::ToSchema;
use uuid::Uuid;

/// Data of one event of `GET /v1/events` and `GET /v1/jobs/{id}/events`; `event:` has the tag.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(tag = "event", rename_all = "snake_case")]
pub enum Event {
    /// The job as it stands: first after every connect, then whenever its state changes and about
    /// twice a second while it runs.
    Job {
        /// As from `GET /v1/jobs/{id}`.
        job: Box<JobStatus>,
    },
    /// The merged picture changed.
    Image {
        /// Which job.
        job: Uuid,
        /// Frame number.
        frame: u32,
        /// Only rises.
        image_version: u64,
        /// Tiles that changed since the last such event.
        tiles: Vec<u32>,
    },
    /// The job is gone.
    Deleted {
        /// Which job.
        job: Uuid,
        /// When.
        at: TimestampMs,
    },
}
