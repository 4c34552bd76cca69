//! Reading bodies, queries and ids, with errors of our own.

use crate::error::{ApiError, BAD_REQUEST, INVALID, MEDIA_TYPE, NO_JOB, TOO_LARGE};
use crate::farm::Farm;
use axum::body::Body;
use axum::extract::{FromRequest, Query, Request};
use axum::http::{HeaderMap, Uri, header};
use http_body_util::{BodyExt, LengthLimitError, Limited};
use serde::de::DeserializeOwned;
use std::sync::Arc;
use uuid::Uuid;

/// A JSON body.
pub struct Json<T>(pub T);

impl<T: DeserializeOwned> FromRequest<Arc<Farm>> for Json<T> {
    type Rejection = ApiError;

    async fn from_request(request: Request, farm: &Arc<Farm>) -> Result<Self, ApiError> {
        plain(request.headers())?;
        let kind = request.headers().get(header::CONTENT_TYPE);
        let kind = kind.and_then(|v| v.to_str().ok()).unwrap_or("");
        let kind = kind.split(';').next().unwrap_or("").trim();
        if !kind.eq_ignore_ascii_case("application/json") {
            return Err(ApiError::new(
                MEDIA_TYPE,
                format!("a body of type application/json is needed, not {kind:?}"),
            ));
        }
        let limit = farm.config.limits.json_bytes;
        fits(request.headers(), "json_bytes", limit as u64)?;
        let bytes = whole(request.into_body(), "json_bytes", limit).await?;
        let mut reader = serde_json::Deserializer::from_slice(&bytes);
        let value = T::deserialize(&mut reader).and_then(|value| reader.end().map(|()| value));
        value.map(Json).map_err(|error| {
            let kind = if error.is_data() {
                INVALID
            } else {
                BAD_REQUEST
            };
            ApiError::new(kind, error.to_string())
        })
    }
}

/// Bodies come as they are: what unpacks to something else has no size that could be checked.
pub fn plain(headers: &HeaderMap) -> Result<(), ApiError> {
    match headers.get(header::CONTENT_ENCODING) {
        Some(encoding) if encoding.as_bytes() != b"identity" => Err(ApiError::new(
            MEDIA_TYPE,
            "bodies are taken without Content-Encoding",
        )),
        _ => Ok(()),
    }
}

/// How long the body is, as the head says.
pub fn content_length(headers: &HeaderMap) -> Option<u64> {
    let value = headers.get(header::CONTENT_LENGTH)?;
    value.to_str().ok()?.parse().ok()
}

/// Refuses by what the head says, before a byte of the body is asked for.
pub fn fits(headers: &HeaderMap, name: &str, limit: u64) -> Result<(), ApiError> {
    match content_length(headers).filter(|length| *length > limit) {
        Some(length) => Err(ApiError::limit(TOO_LARGE, name, limit, Some(length))),
        None => Ok(()),
    }
}

/// A body of limited size.
pub async fn whole(body: Body, name: &str, limit: usize) -> Result<bytes::Bytes, ApiError> {
    match Limited::new(body, limit).collect().await {
        Ok(collected) => Ok(collected.to_bytes()),
        Err(error) if error.downcast_ref::<LengthLimitError>().is_some() => {
            Err(ApiError::limit(TOO_LARGE, name, limit as u64, None))
        }
        Err(error) => Err(ApiError::new(
            BAD_REQUEST,
            format!("the body ended early: {error}"),
        )),
    }
}

/// A query string.
pub fn query<T: DeserializeOwned>(uri: &Uri) -> Result<T, ApiError> {
    Query::<T>::try_from_uri(uri)
        .map(|Query(value)| value)
        .map_err(|e| ApiError::new(BAD_REQUEST, e.body_text()))
}

/// The id of a job.
pub fn job_id(text: &str) -> Result<Uuid, ApiError> {
    let shown: String = text.chars().take(64).collect();
    text.parse()
        .map_err(|_| ApiError::new(NO_JOB, format!("{shown:?} is no job's id")))
}

/// A header as text.
pub fn header_text<'a>(headers: &'a HeaderMap, name: &str) -> Result<Option<&'a str>, ApiError> {
    match headers.get(name) {
        None => Ok(None),
        Some(value) => match value.to_str() {
            Ok(text) => Ok(Some(text)),
            Err(_) => Err(ApiError::new(
                BAD_REQUEST,
                format!("the header {name} is not plain text"),
            )),
        },
    }
}
