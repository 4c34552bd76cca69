//! Files by content.

use super::body::{Json, fits, plain};
use crate::auth::Caller;
use crate::config::Scope;
use crate::error::{
    ApiError, BAD_REQUEST, DIGEST_MISMATCH, FORBIDDEN, INTERNAL, NO_ASSET, TOO_LARGE,
};
use crate::farm::Farm;
use crate::record::{hex, parse_digest};
use crate::submit;
use axum::Extension;
use axum::body::Body;
use axum::extract::{Path, Request, State};
use axum::http::{HeaderMap, StatusCode, header};
use axum::response::{IntoResponse, Response};
use bytes::Bytes;
use futures::StreamExt;
use protocol::{MissingRequest, MissingResponse, Problem};
use std::io::Read;
use std::sync::Arc;
use store::{Digest, StoreError};
use tokio::sync::mpsc;
use tokio_stream::wrappers::ReceiverStream;

/// Pieces that wait between the network and the disk.
const PIECES: usize = 8;
/// Size of a piece that is read.
const PIECE_BYTES: usize = 256 << 10;

fn digest(text: &str) -> Result<Digest, ApiError> {
    let shown: String = text.chars().take(80).collect();
    parse_digest(text).ok_or_else(|| {
        ApiError::new(
            NO_ASSET,
            format!("{shown:?} is not a BLAKE3 digest in lower-case hex"),
        )
    })
}

/// Which of these files have to be uploaded.
#[utoipa::path(post, path = "/v1/assets/missing", tag = "assets", request_body = MissingRequest,
    responses((status = 200, body = MissingResponse), (status = "4XX", body = Problem, content_type = "application/problem+json")))]
pub async fn missing(
    State(farm): State<Arc<Farm>>,
    Json(request): Json<MissingRequest>,
) -> Result<Response, ApiError> {
    let max = farm.config.limits.missing_digests;
    if request.digests.len() > max {
        return Err(ApiError::limit(
            TOO_LARGE,
            "missing_digests",
            max as u64,
            Some(request.digests.len() as u64),
        ));
    }
    let digests: Vec<Digest> = request
        .digests
        .iter()
        .map(|text| {
            parse_digest(text).ok_or_else(|| {
                ApiError::new(
                    crate::error::INVALID,
                    "digests: 64 lower-case hex digits each",
                )
            })
        })
        .collect::<Result<_, _>>()?;
    // Those that are there and nobody's stay for a while, for the job that is coming.
    let now = farm.clock.now();
    let missing = submit::missing(&farm, digests.clone()).await?;
    {
        let mut state = farm.state();
        for digest in &digests {
            if let Some(at) = state.young.get_mut(digest) {
                *at = now;
            }
        }
    }
    let missing = missing.iter().map(hex).collect();
    Ok(axum::Json(MissingResponse { missing }).into_response())
}

/// Uploads a file: its bytes as they are, checked against its name while they come.
#[utoipa::path(put, path = "/v1/assets/{digest}", tag = "assets", params(("digest" = String, Path)),
    request_body(content_type = "application/octet-stream"),
    responses((status = 201, description = "Stored"), (status = 200, description = "It was there already"),
        (status = "4XX", body = Problem, content_type = "application/problem+json"), (status = "5XX", body = Problem, content_type = "application/problem+json")))]
pub async fn put_asset(
    State(farm): State<Arc<Farm>>,
    Path(name): Path<String>,
    request: Request,
) -> Result<Response, ApiError> {
    let digest = digest(&name)?;
    plain(request.headers())?;
    let limit = farm.config.limits.asset_bytes;
    fits(request.headers(), "asset_bytes", limit)?;
    if submit::missing(&farm, vec![digest]).await?.is_empty() {
        return Ok(StatusCode::OK.into_response());
    }
    let now = farm.clock.now();
    farm.state().young.insert(digest, now);
    let (pieces, queue) = mpsc::channel::<Bytes>(PIECES);
    let writing = {
        let farm = farm.clone();
        tokio::task::spawn_blocking(move || write(&farm, &digest, queue))
    };
    let mut body = request.into_body().into_data_stream();
    let mut total = 0u64;
    let mut failed = None;
    while let Some(piece) = body.next().await {
        match piece {
            Ok(piece) => {
                total += piece.len() as u64;
                if total > limit {
                    failed = Some(ApiError::limit(TOO_LARGE, "asset_bytes", limit, None));
                    break;
                }
                if pieces.send(piece).await.is_err() {
                    break; // the writer has failed and says why
                }
            }
            Err(error) => {
                failed = Some(ApiError::new(
                    BAD_REQUEST,
                    format!("the body ended early: {error}"),
                ));
                break;
            }
        }
    }
    if failed.is_some() {
        // An empty piece says that the rest does not come.
        let _ = pieces.send(Bytes::new()).await;
    }
    drop(pieces);
    let written = writing
        .await
        .map_err(|_| ApiError::new(INTERNAL, "writing crashed"))?;
    match (failed, written) {
        (Some(error), _) => Err(error),
        (None, Ok(true)) => Ok(StatusCode::CREATED.into_response()),
        (None, Ok(false)) => Err(ApiError::new(
            DIGEST_MISMATCH,
            format!("the bytes that came are not those of {name}"),
        )),
        (None, Err(error)) => Err(error.into()),
    }
}

/// Writes what comes. False if it is not what its name says.
fn write(
    farm: &Farm,
    digest: &Digest,
    mut queue: mpsc::Receiver<Bytes>,
) -> Result<bool, StoreError> {
    let mut writer = farm.stores.blobs.begin()?;
    let mut hasher = blake3::Hasher::new();
    while let Some(piece) = queue.blocking_recv() {
        if piece.is_empty() {
            return Ok(false);
        }
        hasher.update(&piece);
        writer.write(&piece)?;
    }
    if hasher.finalize().as_bytes() != digest {
        return Ok(false);
    }
    writer.finish(digest)?;
    Ok(true)
}

/// Workers read only files of jobs that they hold a lease of.
fn may_read(farm: &Farm, caller: &Caller, digest: &Digest) -> bool {
    if caller.scope != Scope::Work {
        return true;
    }
    let state = farm.state();
    let name = hex(digest);
    let mut workers = state.workers.values().filter(|w| w.token == caller.token);
    workers.any(|worker| {
        let mut jobs = worker.held.iter().map(|(job, _)| job);
        jobs.any(|id| {
            let job = state.jobs.get(id);
            job.is_some_and(|job| job.record.request.files.values().any(|d| *d == name))
        })
    })
}

/// Downloads a file.
#[utoipa::path(get, path = "/v1/assets/{digest}", tag = "assets", params(("digest" = String, Path)),
    responses((status = 200, content_type = "application/octet-stream"), (status = 304, description = "It never changes"),
        (status = "4XX", body = Problem, content_type = "application/problem+json")))]
pub async fn get_asset(
    State(farm): State<Arc<Farm>>,
    Extension(caller): Extension<Caller>,
    Path(name): Path<String>,
    headers: HeaderMap,
) -> Result<Response, ApiError> {
    asset(farm, caller, name, headers, true).await
}

/// Whether a file is there, and its size.
#[utoipa::path(head, path = "/v1/assets/{digest}", tag = "assets", params(("digest" = String, Path)),
    responses((status = 200), (status = 404)))]
pub async fn head_asset(
    State(farm): State<Arc<Farm>>,
    Extension(caller): Extension<Caller>,
    Path(name): Path<String>,
    headers: HeaderMap,
) -> Result<Response, ApiError> {
    asset(farm, caller, name, headers, false).await
}

async fn asset(
    farm: Arc<Farm>,
    caller: Caller,
    name: String,
    headers: HeaderMap,
    send: bool,
) -> Result<Response, ApiError> {
    let digest = digest(&name)?;
    if !may_read(&farm, &caller, &digest) {
        return Err(ApiError::new(
            FORBIDDEN,
            "no worker of this token holds a lease of a job with this file",
        ));
    }
    let etag = format!("\"{name}\"");
    let blobs = farm.stores.blobs.clone();
    let opened = tokio::task::spawn_blocking(move || blobs.open(&digest))
        .await
        .map_err(|_| ApiError::new(INTERNAL, "reading crashed"))?;
    let mut opened = match opened {
        Ok(opened) => opened,
        Err(StoreError::NotFound { .. }) => return Err(ApiError::new(NO_ASSET, name)),
        Err(error) => return Err(error.into()),
    };
    let fixed = [
        (header::ETAG, etag.clone()),
        (
            header::CACHE_CONTROL,
            "private, max-age=31536000, immutable".into(),
        ),
    ];
    if super::images::matches(&headers, &etag) {
        return Ok((StatusCode::NOT_MODIFIED, fixed).into_response());
    }
    let about = [
        (header::CONTENT_TYPE, "application/octet-stream".to_owned()),
        (header::CONTENT_LENGTH, opened.size_bytes.to_string()),
    ];
    if !send {
        return Ok((fixed, about).into_response());
    }
    let (pieces, queue) = mpsc::channel::<std::io::Result<Bytes>>(PIECES);
    // Ends with the file, an error, or the connection.
    farm.tasks.spawn_blocking(move || {
        loop {
            let mut piece = Vec::with_capacity(PIECE_BYTES);
            let read = opened
                .reader
                .by_ref()
                .take(PIECE_BYTES as u64)
                .read_to_end(&mut piece);
            let piece = match read {
                Ok(0) => return,
                Ok(_) => Ok(Bytes::from(piece)),
                Err(error) => Err(error),
            };
            let last = piece.is_err();
            if pieces.blocking_send(piece).is_err() || last {
                return;
            }
        }
    });
    Ok((fixed, about, Body::from_stream(ReceiverStream::new(queue))).into_response())
}
