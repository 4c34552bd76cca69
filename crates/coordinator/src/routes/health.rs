//! For operators and machines.

use crate::error::{ApiError, UNAVAILABLE};
use crate::farm::Farm;
use axum::extract::State;
use axum::http::header;
use axum::response::{IntoResponse, Response};
use protocol::Problem;
use std::sync::Arc;

/// The process lives.
#[utoipa::path(get, path = "/healthz", tag = "operation", security(()), responses((status = 200, body = String, content_type = "text/plain")))]
pub async fn healthz() -> &'static str {
    "ok\n"
}

/// It takes calls.
#[utoipa::path(get, path = "/readyz", tag = "operation", security(()), responses((status = 200, body = String, content_type = "text/plain"),
    (status = 503, body = Problem, content_type = "application/problem+json")))]
pub async fn readyz(State(farm): State<Arc<Farm>>) -> Result<&'static str, ApiError> {
    if farm.is_ready() {
        Ok("ready\n")
    } else {
        Err(ApiError::new(UNAVAILABLE, "starting or ending"))
    }
}

/// Numbers in the text format of Prometheus.
#[utoipa::path(get, path = "/metrics", tag = "operation", responses((status = 200, body = String, content_type = "text/plain")))]
pub async fn metrics(State(farm): State<Arc<Farm>>) -> Response {
    let kind = [(
        header::CONTENT_TYPE,
        "text/plain; version=0.0.4; charset=utf-8",
    )];
    (kind, crate::metrics::page(&farm)).into_response()
}

/// This description.
#[utoipa::path(get, path = "/openapi.json", tag = "operation", security(()), responses((status = 200, content_type = "application/json")))]
pub async fn openapi() -> Response {
    let kind = [(header::CONTENT_TYPE, "application/json")];
    (kind, crate::openapi::document()).into_response()
}
