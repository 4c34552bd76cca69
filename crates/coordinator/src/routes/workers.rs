//! Workers, for people.

use super::body::Json;
use crate::audit;
use crate::error::{ApiError, NO_WORKER};
use crate::farm::Farm;
use axum::extract::{Path, State};
use protocol::{Problem, WorkerList, WorkerPatch, WorkerStatus};
use std::sync::Arc;
use uuid::Uuid;

/// All workers, by registration.
#[utoipa::path(get, path = "/v1/workers", tag = "workers", responses((status = 200, body = WorkerList)))]
pub async fn list_workers(State(farm): State<Arc<Farm>>) -> axum::Json<WorkerList> {
    let now = farm.clock.now();
    let ttl = farm.config.lease_ttl.as_millis() as u64;
    let state = farm.state();
    let workers = state.workers.values().map(|w| w.status(now, ttl)).collect();
    axum::Json(WorkerList { workers })
}

/// Drains or quarantines a worker, or undoes it.
#[utoipa::path(patch, path = "/v1/workers/{id}", tag = "workers", params(("id" = Uuid, Path)), request_body = WorkerPatch,
    responses((status = 200, body = WorkerStatus), (status = "4XX", body = Problem, content_type = "application/problem+json")))]
pub async fn patch_worker(
    State(farm): State<Arc<Farm>>,
    Path(id): Path<String>,
    Json(patch): Json<WorkerPatch>,
) -> Result<axum::Json<WorkerStatus>, ApiError> {
    let unknown = || ApiError::new(NO_WORKER, "there is no such worker");
    let id: Uuid = id.parse().map_err(|_| unknown())?;
    if patch.quarantine == Some(true) {
        audit::quarantine(&farm, id, "on request");
    }
    let mut changed = farm.pardon(
        id,
        patch.quarantine == Some(false),
        patch.drain == Some(false),
    );
    let status = {
        let now = farm.clock.now();
        let mut state = farm.state();
        let worker = state.workers.get_mut(&id).ok_or_else(unknown)?;
        worker.drained |= patch.drain == Some(true);
        worker.status(now, farm.config.lease_ttl.as_millis() as u64)
    };
    // The answer says that it is so: also after a restart.
    changed.retain(|other| *other != id);
    for worker in changed.into_iter().chain([id]) {
        farm.save_worker(worker).await?;
    }
    farm.wake.notify_waiters();
    Ok(axum::Json(status))
}
