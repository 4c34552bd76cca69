//! Jobs.

use super::body::{Json, header_text, job_id, query};
use crate::auth::Caller;
use crate::error::{ApiError, BAD_REQUEST, INTERNAL, NO_FRAME};
use crate::farm::{Farm, no_job};
use crate::{checkpoint, status, submit as submitting};
use axum::Extension;
use axum::extract::{Path, State};
use axum::http::{HeaderMap, StatusCode, Uri, header};
use axum::response::{IntoResponse, Response};
use protocol::{
    HistoryPoint, JobList, JobPatch, JobRequest, JobState, JobStatus, LogLine, Problem, TileList,
    TileStatus,
};
use serde::Deserialize;
use std::collections::BTreeMap;
use std::sync::{Arc, PoisonError};
use uuid::Uuid;

/// Jobs on a page unless asked otherwise, and at most.
const PAGE: usize = 50;
const PAGE_MAX: usize = 500;

/// Submits a job.
#[utoipa::path(post, path = "/v1/jobs", tag = "jobs", request_body = JobRequest,
    params(("Idempotency-Key" = Option<String>, Header, description = "Makes a repeated submission one job")),
    responses((status = 201, body = JobStatus, headers(("Location" = String))), (status = "4XX", body = Problem, content_type = "application/problem+json"),
        (status = "5XX", body = Problem, content_type = "application/problem+json")))]
pub async fn submit(
    State(farm): State<Arc<Farm>>,
    Extension(caller): Extension<Caller>,
    headers: HeaderMap,
    Json(request): Json<JobRequest>,
) -> Result<Response, ApiError> {
    // A key is one token's own: nobody meets another's job by guessing.
    let key = header_text(&headers, "idempotency-key")?.map(|key| match caller.token {
        _ if key.len() > submitting::KEY_BYTES_MAX || key.is_empty() => key.to_owned(),
        Some(token) => format!(
            "{}/{key}",
            farm.config
                .tokens
                .get(token)
                .map_or_else(String::new, |t| t.secret.to_hex()[..16].to_owned())
        ),
        None => format!("-/{key}"),
    });
    // On its own: a connection that breaks now must not leave half a job.
    let submitting = {
        let farm = farm.clone();
        farm.clone()
            .tasks
            .spawn(async move { submitting::submit(&farm, request, key).await })
    };
    let job = submitting
        .await
        .map_err(|_| ApiError::new(INTERNAL, "submitting crashed"))??;
    let location = format!("/v1/jobs/{}", job.id);
    Ok((
        StatusCode::CREATED,
        [(header::LOCATION, location)],
        axum::Json(job),
    )
        .into_response())
}

#[derive(Deserialize, utoipa::IntoParams)]
#[into_params(parameter_in = Query)]
#[serde(deny_unknown_fields)]
pub struct ListQuery {
    /// Only those in this state.
    state: Option<JobState>,
    /// Where the page before ended.
    cursor: Option<String>,
    /// At most so many, up to 500.
    limit: Option<usize>,
}

/// Jobs, newest first.
#[utoipa::path(get, path = "/v1/jobs", tag = "jobs", params(ListQuery),
    responses((status = 200, body = JobList), (status = "4XX", body = Problem, content_type = "application/problem+json")))]
pub async fn list(
    State(farm): State<Arc<Farm>>,
    uri: Uri,
) -> Result<axum::Json<JobList>, ApiError> {
    let query: ListQuery = query(&uri)?;
    let limit = query.limit.unwrap_or(PAGE).clamp(1, PAGE_MAX);
    let before = match &query.cursor {
        None => Uuid::max(),
        Some(text) => Uuid::try_parse(text)
            .map_err(|_| ApiError::new(BAD_REQUEST, "the cursor is none that was given out"))?,
    };
    let now = farm.clock.now();
    let state = farm.state();
    let older = state.jobs.range(..before).rev();
    let mut found = older.filter(|(_, job)| query.state.is_none_or(|s| s == job.record.state));
    let jobs: Vec<JobStatus> = found
        .by_ref()
        .take(limit)
        .map(|(_, job)| status::of(job, &state.workers, now, &farm.config))
        .collect();
    let more = found.next().is_some();
    let next = jobs
        .last()
        .filter(|_| more)
        .map(|job| job.id.simple().to_string());
    Ok(axum::Json(JobList { jobs, next }))
}

/// How a job stands.
#[utoipa::path(get, path = "/v1/jobs/{id}", tag = "jobs", params(("id" = Uuid, Path)),
    responses((status = 200, body = JobStatus), (status = "4XX", body = Problem, content_type = "application/problem+json")))]
pub async fn get_job(
    State(farm): State<Arc<Farm>>,
    Path(id): Path<String>,
) -> Result<axum::Json<JobStatus>, ApiError> {
    Ok(axum::Json(farm.status(job_id(&id)?)?))
}

/// Changes priority, name, stop or pause.
#[utoipa::path(patch, path = "/v1/jobs/{id}", tag = "jobs", params(("id" = Uuid, Path)), request_body = JobPatch,
    responses((status = 200, body = JobStatus), (status = "4XX", body = Problem, content_type = "application/problem+json")))]
pub async fn patch_job(
    State(farm): State<Arc<Farm>>,
    Path(id): Path<String>,
    Json(patch): Json<JobPatch>,
) -> Result<axum::Json<JobStatus>, ApiError> {
    Ok(axum::Json(farm.patch(job_id(&id)?, patch).await?))
}

/// Removes a job and what only it needs.
#[utoipa::path(delete, path = "/v1/jobs/{id}", tag = "jobs", params(("id" = Uuid, Path)),
    responses((status = 204), (status = "4XX", body = Problem, content_type = "application/problem+json")))]
pub async fn delete_job(
    State(farm): State<Arc<Farm>>,
    Path(id): Path<String>,
) -> Result<StatusCode, ApiError> {
    let id = job_id(&id)?;
    let deleting = {
        let farm = farm.clone();
        farm.clone()
            .tasks
            .spawn(async move { farm.delete(id).await })
    };
    deleting
        .await
        .map_err(|_| ApiError::new(INTERNAL, "deleting crashed"))??;
    Ok(StatusCode::NO_CONTENT)
}

/// Holds a job: units in work finish and are merged.
#[utoipa::path(post, path = "/v1/jobs/{id}/pause", tag = "jobs", params(("id" = Uuid, Path)),
    responses((status = 200, body = JobStatus), (status = "4XX", body = Problem, content_type = "application/problem+json")))]
pub async fn pause(
    State(farm): State<Arc<Farm>>,
    Path(id): Path<String>,
) -> Result<axum::Json<JobStatus>, ApiError> {
    Ok(axum::Json(farm.pause(job_id(&id)?).await?))
}

/// Goes on with a paused job.
#[utoipa::path(post, path = "/v1/jobs/{id}/resume", tag = "jobs", params(("id" = Uuid, Path)),
    responses((status = 200, body = JobStatus), (status = "4XX", body = Problem, content_type = "application/problem+json")))]
pub async fn resume(
    State(farm): State<Arc<Farm>>,
    Path(id): Path<String>,
) -> Result<axum::Json<JobStatus>, ApiError> {
    Ok(axum::Json(farm.resume(job_id(&id)?).await?))
}

/// Ends a job.
#[utoipa::path(post, path = "/v1/jobs/{id}/cancel", tag = "jobs", params(("id" = Uuid, Path)),
    responses((status = 200, body = JobStatus), (status = "4XX", body = Problem, content_type = "application/problem+json")))]
pub async fn cancel(
    State(farm): State<Arc<Farm>>,
    Path(id): Path<String>,
) -> Result<axum::Json<JobStatus>, ApiError> {
    Ok(axum::Json(farm.cancel(job_id(&id)?).await?))
}

/// Starts a failed or cancelled job again, from what it has.
#[utoipa::path(post, path = "/v1/jobs/{id}/retry", tag = "jobs", params(("id" = Uuid, Path)),
    responses((status = 200, body = JobStatus), (status = "4XX", body = Problem, content_type = "application/problem+json")))]
pub async fn retry(
    State(farm): State<Arc<Farm>>,
    Path(id): Path<String>,
) -> Result<axum::Json<JobStatus>, ApiError> {
    Ok(axum::Json(farm.retry(job_id(&id)?).await?))
}

#[derive(Deserialize, utoipa::IntoParams)]
#[into_params(parameter_in = Query)]
#[serde(deny_unknown_fields)]
pub struct FrameQuery {
    /// Frame number; the first unless said otherwise.
    frame: Option<u32>,
}

/// How the tiles of a frame stand.
#[utoipa::path(get, path = "/v1/jobs/{id}/tiles", tag = "jobs", params(("id" = Uuid, Path), FrameQuery),
    responses((status = 200, body = TileList), (status = "4XX", body = Problem, content_type = "application/problem+json")))]
pub async fn tiles(
    State(farm): State<Arc<Farm>>,
    Path(id): Path<String>,
    uri: Uri,
) -> Result<axum::Json<TileList>, ApiError> {
    let id = job_id(&id)?;
    let query: FrameQuery = query(&uri)?;
    let (frame, grid) = farm.with_job(id, |job| {
        Ok((
            query.frame.unwrap_or(job.record.frames[0]),
            job.record.grid(),
        ))
    })?;
    check_frame(&farm, id, frame)?;
    let list = tokio::task::spawn_blocking(move || -> Result<TileList, ApiError> {
        let film = checkpoint::look(&farm, id, frame)?;
        let mut tiles: Vec<TileStatus> = (0..grid.count())
            .map(|index| {
                let tile = grid.tile(index);
                TileStatus {
                    x: tile.x,
                    y: tile.y,
                    width: tile.width,
                    height: tile.height,
                    spp: 0,
                    error: None,
                    state: "queued".into(),
                    worker: None,
                }
            })
            .collect();
        if let Some(film) = film {
            let film = film.read().unwrap_or_else(PoisonError::into_inner);
            for (status, tile) in tiles.iter_mut().zip(film.tiles()) {
                status.spp = tile.spp();
                status.error = tile.error();
                status.worker = tile.merged_units().last().map(|u| u.worker.to_string());
            }
        }
        let state = farm.state();
        let job = state.jobs.get(&id).ok_or_else(|| no_job(id))?;
        let done = job.record.begun.get(&frame).is_some_and(|f| f.done);
        for (status, index) in tiles.iter_mut().zip(0..) {
            match job.plans.get(&frame) {
                Some(plan) => status.state = plan.tile_state(index).into(),
                None if done => status.state = "done".into(),
                None => {}
            }
            let name = status.worker.take().map(|id| {
                let known = id.parse().ok().and_then(|id: Uuid| state.workers.get(&id));
                known.map_or(id, |w| w.about.name.clone())
            });
            status.worker = name;
        }
        let samples = tiles.iter().map(|t| t.spp).collect();
        Ok(TileList {
            frame,
            tiles,
            samples,
        })
    });
    let list = list
        .await
        .map_err(|_| ApiError::new(INTERNAL, "looking at tiles crashed"))??;
    Ok(axum::Json(list))
}

/// A frame that the job has.
pub fn check_frame(farm: &Farm, id: Uuid, frame: u32) -> Result<(), ApiError> {
    farm.with_job(id, |job| {
        let [first, last] = job.record.frames;
        if (first..=last).contains(&frame) {
            Ok(())
        } else {
            Err(ApiError::new(
                NO_FRAME,
                format!("the job has frames {first} to {last}"),
            ))
        }
    })
}

/// Error and speed over time.
#[utoipa::path(get, path = "/v1/jobs/{id}/history", tag = "jobs", params(("id" = Uuid, Path)),
    responses((status = 200, body = Vec<HistoryPoint>), (status = "4XX", body = Problem, content_type = "application/problem+json")))]
pub async fn history(
    State(farm): State<Arc<Farm>>,
    Path(id): Path<String>,
) -> Result<axum::Json<Vec<HistoryPoint>>, ApiError> {
    farm.with_job(job_id(&id)?, |job| {
        Ok(axum::Json(job.record.history.clone()))
    })
}

/// What happened to a job.
#[utoipa::path(get, path = "/v1/jobs/{id}/log", tag = "jobs", params(("id" = Uuid, Path)),
    responses((status = 200, body = Vec<LogLine>), (status = "4XX", body = Problem, content_type = "application/problem+json")))]
pub async fn log(
    State(farm): State<Arc<Farm>>,
    Path(id): Path<String>,
) -> Result<axum::Json<Vec<LogLine>>, ApiError> {
    let (mut lines, names) = {
        let state = farm.state();
        let id = job_id(&id)?;
        let job = state.jobs.get(&id).ok_or_else(|| no_job(id))?;
        let names: BTreeMap<String, String> = state
            .workers
            .values()
            .map(|w| (w.id.to_string(), w.about.name.clone()))
            .collect();
        (job.record.log.clone(), names)
    };
    for line in &mut lines {
        if let Some(name) = line.worker.as_ref().and_then(|id| names.get(id)) {
            line.worker = Some(name.clone());
        }
    }
    Ok(axum::Json(lines))
}
