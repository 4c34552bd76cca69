//! Workers: registration, the sync call, results.

use crate::TimestampMs;
use crate::job::JobSpec;
use film::{EngineVersion, Unit};
use serde::{Deserialize, Serialize};
use utoipa::ToSchema;
use uuid::Uuid;

/// Body of `POST /v1/worker/register`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct RegisterRequest {
    /// For people; made unique by the id.
    pub name: String,
    /// Threads it renders with.
    pub threads: u32,
    /// Must be the coordinator's.
    #[schema(value_type = u32)]
    pub engine_version: EngineVersion,
    /// Program version, for people.
    pub version: String,
    /// SIMD level in use, for people.
    pub simd: String,
    /// Memory budget for prepared scenes, bytes.
    pub memory_bytes: u64,
    /// Identity kept over reconnects of the same process; absent on the first call.
    #[serde(skip_serializing_if = "Option::is_none", default)]
    pub previous_id: Option<Uuid>,
}

/// Answer to [`RegisterRequest`].
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct RegisterResponse {
    /// Names the worker in every later call.
    pub worker: Uuid,
    /// How long a lease lives without a heartbeat, milliseconds.
    pub lease_ttl_ms: u64,
    /// How often to sync while busy, milliseconds.
    pub heartbeat_ms: u64,
}

/// Which lease: a unit of a job and the attempt number.
#[derive(Clone, Debug, PartialEq, Eq, Hash, Serialize, Deserialize, ToSchema)]
pub struct LeaseRef {
    /// Job.
    pub job: Uuid,
    /// Unit.
    #[schema(value_type = Object)]
    pub unit: Unit,
    /// 1 for the first lease of a unit.
    pub attempt: u32,
}

/// A failed attempt, reported in a sync.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct LeaseFailure {
    /// Which.
    pub lease: LeaseRef,
    /// Why, for the job's log.
    pub reason: String,
    /// The scene itself cannot be rendered (a picture that does not decode): no retry helps.
    pub scene_error: bool,
    /// The machine is at fault (memory, disk): does not count against the unit.
    pub machine_error: bool,
}

/// Body of `POST /v1/worker/sync`: heartbeat, progress, give-back, wish for work; a long poll.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct SyncRequest {
    /// From registration.
    pub worker: Uuid,
    /// Leases in work or waiting, all of them; each is extended.
    pub held: Vec<LeaseRef>,
    /// Leases given back unrendered.
    #[serde(default)]
    pub given_back: Vec<LeaseRef>,
    /// Attempts that failed.
    #[serde(default)]
    pub failed: Vec<LeaseFailure>,
    /// How many more leases are wanted now, however long their units are.
    pub want: u32,
    /// Camera samples that are wanted now: after `want` leases more are given as long as the units of
    /// all of them together have about so many samples at most. Where little is left to lease for several
    /// workers, each gets less.
    #[serde(default)]
    pub want_samples: u64,
    /// Hold the call open up to this long if there is nothing to say, milliseconds.
    pub wait_ms: u64,
    /// The worker is leaving: no more leases.
    #[serde(default)]
    pub draining: bool,
    /// Seconds it took to prepare scenes since the last sync, by job.
    #[serde(default)]
    pub prepared: Vec<(Uuid, f64)>,
}

/// A unit to render.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct Lease {
    /// Which unit, which attempt.
    pub at: LeaseRef,
    /// Digest of the job's [`JobSpec`]: names the prepared scene in the worker's cache.
    pub spec_digest: String,
    /// Must be the worker's.
    #[schema(value_type = u32)]
    pub engine_version: EngineVersion,
    /// When it expires without a heartbeat.
    pub expires_at: TimestampMs,
}

/// Answer to [`SyncRequest`].
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct SyncResponse {
    /// New leases.
    pub leases: Vec<Lease>,
    /// Specs of jobs named in `leases` that the worker has not been sent since it registered.
    pub specs: Vec<(Uuid, JobSpec)>,
    /// Held leases that are no longer wanted (job cancelled, deleted, or lease lost): stop within a
    /// second.
    pub cancelled: Vec<LeaseRef>,
    /// Give back units that have not begun: something more urgent waits.
    pub give_back_unstarted: bool,
    /// Finish what is held, take no more.
    pub drain: bool,
}

/// Answer to `PUT /v1/worker/results/{job}/{unit}`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct ResultAccepted {
    /// True when the same bytes were there already.
    pub duplicate: bool,
}

/// A worker in the answer to `GET /v1/workers`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct WorkerStatus {
    /// Id.
    pub id: Uuid,
    /// For people.
    pub name: String,
    /// `active`, `idle`, `draining`, `quarantined` or `lost`.
    pub state: String,
    /// Why, where a reason is needed.
    #[serde(skip_serializing_if = "Option::is_none", default)]
    pub reason: Option<String>,
    /// Threads.
    pub threads: u32,
    /// Program version.
    pub version: String,
    /// SIMD level.
    pub simd: String,
    /// Leases held.
    pub leases: u32,
    /// Units delivered and merged.
    pub units_merged: u64,
    /// Attempts failed.
    pub failures: u64,
    /// Last sync.
    pub last_seen: TimestampMs,
}

/// Answer to `GET /v1/workers`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct WorkerList {
    /// By registration.
    pub workers: Vec<WorkerStatus>,
}

/// Body of `PATCH /v1/workers/{id}`.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields, default)]
pub struct WorkerPatch {
    /// No more leases; what is held is finished.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub drain: Option<bool>,
    /// No more leases; the tiles that it touched in unfinished jobs are rendered again.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub quarantine: Option<bool>,
}
