//! What workers call.

use super::body::{Json, content_length, fits, header_text, plain};
use crate::auth::Caller;
use crate::error::{ApiError, BAD_REQUEST, BAD_RESULT, INTERNAL, TOO_LARGE};
use crate::farm::Farm;
use crate::record::parse_digest;
use crate::results::{Delivery, Taken};
use axum::Extension;
use axum::extract::{Path, Request, State};
use axum::http::StatusCode;
use axum::response::{IntoResponse, Response};
use bytes::BytesMut;
use film::Unit;
use futures::StreamExt;
use protocol::{
    Problem, RegisterRequest, RegisterResponse, ResultAccepted, SyncRequest, SyncResponse,
};
use std::sync::Arc;
use uuid::Uuid;

/// How many times as much as has come of a body there may be room for.
const CLAIM_MAX: usize = 16;

/// A worker announces itself.
#[utoipa::path(post, path = "/v1/worker/register", tag = "worker", request_body = RegisterRequest,
    responses((status = 200, body = RegisterResponse), (status = "4XX", body = Problem, content_type = "application/problem+json")))]
pub async fn register(
    State(farm): State<Arc<Farm>>,
    Extension(caller): Extension<Caller>,
    Json(request): Json<RegisterRequest>,
) -> Result<axum::Json<RegisterResponse>, ApiError> {
    Ok(axum::Json(farm.register(request, caller.token)?))
}

/// Heartbeat, progress, leases and cancellations in one long poll.
#[utoipa::path(post, path = "/v1/worker/sync", tag = "worker", request_body = SyncRequest,
    responses((status = 200, body = SyncResponse), (status = "4XX", body = Problem, content_type = "application/problem+json")))]
pub async fn sync(
    State(farm): State<Arc<Farm>>,
    Extension(caller): Extension<Caller>,
    Json(request): Json<SyncRequest>,
) -> Result<axum::Json<SyncResponse>, ApiError> {
    Ok(axum::Json(farm.sync(request, caller.token).await?))
}

/// Delivers a result. 201: durable, or merged where nothing is; 200: the same bytes were there.
#[utoipa::path(put, path = "/v1/worker/results/{job}/{unit}", tag = "worker",
    params(("job" = Uuid, Path), ("unit" = String, Path, description = "frame-tile-begin-end"),
        ("Brolly-Worker" = Uuid, Header), ("Brolly-Blake3" = String, Header, description = "BLAKE3 of the body"),
        ("Brolly-Attempt" = Option<u32>, Header), ("Brolly-Cpu-Seconds" = Option<f64>, Header)),
    request_body(content_type = "application/octet-stream"),
    responses((status = 201, body = ResultAccepted), (status = 200, body = ResultAccepted),
        (status = "4XX", body = Problem, content_type = "application/problem+json"), (status = 503, body = Problem, content_type = "application/problem+json")))]
pub async fn result(
    State(farm): State<Arc<Farm>>,
    Extension(caller): Extension<Caller>,
    Path((job, unit)): Path<(String, String)>,
    request: Request,
) -> Result<Response, ApiError> {
    let job = super::body::job_id(&job)?;
    let unit: Unit = unit
        .parse()
        .map_err(|e: film::unit::UnitNameError| ApiError::new(BAD_RESULT, e.to_string()))?;
    let headers = request.headers();
    plain(headers)?;
    let worker = header_text(headers, "brolly-worker")?
        .and_then(|text| text.parse::<Uuid>().ok())
        .ok_or_else(|| {
            ApiError::new(
                BAD_REQUEST,
                "the header Brolly-Worker has to name the worker",
            )
        })?;
    let claimed = match header_text(headers, "brolly-blake3")? {
        Some(text) => Some(parse_digest(text).ok_or_else(|| {
            ApiError::new(BAD_REQUEST, "Brolly-Blake3: 64 lower-case hex digits")
        })?),
        None => None,
    };
    let cpu_seconds = header_text(headers, "brolly-cpu-seconds")?
        .and_then(|t| t.parse().ok())
        .unwrap_or(0.0);
    let limit = film::codec::unit_bytes_max();
    fits(headers, "result_bytes", limit as u64)?;
    let claimed_len = content_length(headers).unwrap_or(0).min(limit as u64) as usize;
    // Hashed while it comes: one pass, and done when the last byte is there.
    let mut hasher = blake3::Hasher::new();
    let mut bytes = BytesMut::new();
    let mut body = request.into_body().into_data_stream();
    while let Some(piece) = body.next().await {
        let piece =
            piece.map_err(|e| ApiError::new(BAD_REQUEST, format!("the body ended early: {e}")))?;
        if bytes.len() + piece.len() > limit {
            return Err(ApiError::limit(
                TOO_LARGE,
                "result_bytes",
                limit as u64,
                None,
            ));
        }
        hasher.update(&piece);
        let there = bytes.len() + piece.len();
        if bytes.capacity() < there {
            // At once what the head claims, but not for a client that has sent next to nothing.
            let room = claimed_len.min(there * CLAIM_MAX).max(there);
            bytes.reserve(room - bytes.len());
        }
        bytes.extend_from_slice(&piece);
    }
    let delivery = Delivery {
        job,
        unit,
        worker,
        token: caller.token,
        digest: *hasher.finalize().as_bytes(),
        claimed,
        bytes: bytes.freeze(),
        cpu_seconds,
    };
    // On its own: a connection that breaks now must not leave it half taken.
    let taking = {
        let farm = farm.clone();
        farm.clone()
            .tasks
            .spawn(async move { farm.take(delivery).await })
    };
    let taken = taking
        .await
        .map_err(|_| ApiError::new(INTERNAL, "taking a result crashed"))?;
    let (status, duplicate) = match taken? {
        Taken::New => (StatusCode::CREATED, false),
        Taken::Same => (StatusCode::OK, true),
    };
    Ok((status, axum::Json(ResultAccepted { duplicate })).into_response())
}
