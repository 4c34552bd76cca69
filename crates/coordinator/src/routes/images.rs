//! Pictures of films as they stand.

use super::body::{job_id, query};
use super::jobs::check_frame;
use crate::checkpoint;
use crate::error::{ApiError, BAD_REQUEST, INTERNAL, NO_IMAGE, PRECONDITION};
use crate::farm::Farm;
use axum::extract::{Path, State};
use axum::http::{HeaderMap, StatusCode, Uri, header};
use axum::response::{IntoResponse, Response};
use film::{Layer, Look, PictureInfo, ToneMap};
use protocol::Problem;
use serde::Deserialize;
use std::sync::{Arc, PoisonError};

#[derive(Clone, Debug, Deserialize, utoipa::IntoParams)]
#[into_params(parameter_in = Query)]
#[serde(deny_unknown_fields)]
pub struct ImageQuery {
    /// `beauty`, `alpha`, `albedo`, `normal`, `depth`, `samples`, `variance` or `error`; PNG only.
    layer: Option<String>,
    /// Stops; PNG only.
    exposure: Option<f32>,
    /// `none`, `filmic`, `aces` or `reinhard`; PNG only.
    tonemap: Option<String>,
    /// Frame number; the first unless said otherwise.
    frame: Option<u32>,
}

#[derive(Clone, Copy, PartialEq, Eq)]
enum Format {
    Png,
    Exr,
}

/// The picture in display colours.
#[utoipa::path(get, path = "/v1/jobs/{id}/image.png", tag = "pictures", params(("id" = uuid::Uuid, Path), ImageQuery),
    responses((status = 200, content_type = "image/png"), (status = 304, description = "Still the picture of If-None-Match"),
        (status = "4XX", body = Problem, content_type = "application/problem+json")))]
pub async fn png(
    State(farm): State<Arc<Farm>>,
    Path(id): Path<String>,
    uri: Uri,
    headers: HeaderMap,
) -> Result<Response, ApiError> {
    image(farm, &id, &uri, &headers, Format::Png).await
}

/// The picture with all layers, linear.
#[utoipa::path(get, path = "/v1/jobs/{id}/image.exr", tag = "pictures", params(("id" = uuid::Uuid, Path), ImageQuery),
    responses((status = 200, content_type = "image/x-exr"), (status = 304, description = "Still the picture of If-None-Match"),
        (status = "4XX", body = Problem, content_type = "application/problem+json")))]
pub async fn exr(
    State(farm): State<Arc<Farm>>,
    Path(id): Path<String>,
    uri: Uri,
    headers: HeaderMap,
) -> Result<Response, ApiError> {
    image(farm, &id, &uri, &headers, Format::Exr).await
}

async fn image(
    farm: Arc<Farm>,
    id: &str,
    uri: &Uri,
    headers: &HeaderMap,
    format: Format,
) -> Result<Response, ApiError> {
    let id = job_id(id)?;
    let asked: ImageQuery = query(uri)?;
    let bad = |e: film::layer::UnknownName| ApiError::new(BAD_REQUEST, e.to_string());
    let layer: Layer = asked
        .layer
        .as_deref()
        .map_or(Ok(Layer::Beauty), str::parse)
        .map_err(bad)?;
    let tonemap: ToneMap = asked
        .tonemap
        .as_deref()
        .map_or(Ok(ToneMap::default()), str::parse)
        .map_err(bad)?;
    let exposure = asked.exposure.unwrap_or(0.0);
    if !(-100.0..=100.0).contains(&exposure) {
        return Err(ApiError::new(
            BAD_REQUEST,
            "exposure: between -100 and 100 stops",
        ));
    }
    let (frame, version, seed, biased) = farm.with_job(id, |job| {
        let record = &job.record;
        let frame = asked.frame.unwrap_or(record.frames[0]);
        let biased = record.request.clamp_indirect.is_some();
        Ok((frame, record.image_version, record.request.seed, biased))
    })?;
    check_frame(&farm, id, frame)?;
    let etag = match format {
        Format::Png => format!("\"{version}-{frame}-{layer}-{tonemap:?}-{exposure}\""),
        Format::Exr => format!("\"{version}-{frame}\""),
    };
    let about = [
        (header::ETAG, etag.clone()),
        // Ask each time; the answer is short while nothing changed.
        (header::CACHE_CONTROL, "private, no-cache".to_owned()),
    ];
    if matches(headers, &etag) {
        return Ok((StatusCode::NOT_MODIFIED, about).into_response());
    }
    if let Some(wanted) = headers.get(header::IF_MATCH)
        && wanted.as_bytes() != b"*"
        && wanted.as_bytes() != etag.as_bytes()
    {
        return Err(ApiError::new(PRECONDITION, format!("it is {etag} now")));
    }
    let drawn = tokio::task::spawn_blocking(move || -> Result<Vec<u8>, ApiError> {
        let film = checkpoint::look(&farm, id, frame)?.ok_or_else(|| {
            ApiError::new(
                NO_IMAGE,
                format!("nothing of frame {frame} is rendered yet"),
            )
        })?;
        let film = film.read().unwrap_or_else(PoisonError::into_inner);
        let info = PictureInfo::of(&film, seed, env!("CARGO_PKG_VERSION"), biased);
        // Merging waits while the film is read: only values are taken out of it, and packed after.
        let packed = match format {
            Format::Png => {
                let look = Look {
                    layer,
                    exposure,
                    tonemap,
                };
                let picture = film::shown(&film, look);
                drop(film);
                film::encode_png(&picture, &info.fields())
            }
            Format::Exr => {
                let channels = film::Channels::of(&film);
                drop(film);
                film::encode_exr(&channels, &info)
            }
        };
        packed.map_err(|error| {
            tracing::error!(job.id = %id, %error, "no picture");
            ApiError::new(INTERNAL, "the picture could not be written")
        })
    });
    let bytes = drawn
        .await
        .map_err(|_| ApiError::new(INTERNAL, "drawing crashed"))??;
    let kind = match format {
        Format::Png => "image/png",
        Format::Exr => "image/x-exr",
    };
    Ok((about, [(header::CONTENT_TYPE, kind)], bytes).into_response())
}

/// Whether `If-None-Match` names a picture.
pub fn matches(headers: &HeaderMap, etag: &str) -> bool {
    let named = headers.get_all(header::IF_NONE_MATCH).iter();
    named
        .filter_map(|v| v.to_str().ok())
        .flat_map(|v| v.split(','))
        .any(|v| {
            let v = v.trim();
            v == "*" || v.strip_prefix("W/").unwrap_or(v) == etag
        })
}
