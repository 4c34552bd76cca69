//! HTTP: one file a resource.

mod assets;
mod body;
mod events;
mod health;
mod images;
mod jobs;
mod scenes;
mod web;
mod worker;
mod workers;

pub(crate) use assets::{__path_get_asset, __path_head_asset, __path_missing, __path_put_asset};
pub(crate) use events::{__path_all_events, __path_job_events};
pub(crate) use health::{__path_healthz, __path_metrics, __path_openapi, __path_readyz};
pub(crate) use images::{__path_exr, __path_png};
pub(crate) use jobs::{
    __path_cancel, __path_delete_job, __path_get_job, __path_history, __path_list, __path_log,
    __path_patch_job, __path_pause, __path_resume, __path_retry, __path_submit, __path_tiles,
};
pub(crate) use scenes::__path_check;
pub(crate) use web::__path_index;
pub(crate) use worker::{__path_register, __path_result, __path_sync};
pub(crate) use workers::{__path_list_workers, __path_patch_worker};

use crate::auth::{self, Guard};
use crate::error::{ApiError, METHOD, NO_ROUTE};
use crate::farm::Farm;
use axum::Router;
use axum::extract::Request;
use axum::http::{HeaderValue, Uri, header};
use axum::middleware::{self, Next};
use axum::response::Response;
use axum::routing::{get, patch, post, put};
use std::sync::Arc;
use uuid::Uuid;

/// All routes.
pub fn router(farm: Arc<Farm>, loopback: bool) -> Router {
    let guard = Arc::new(Guard {
        config: farm.config.clone(),
        loopback,
    });
    Router::new()
        .route("/", get(web::index))
        .route("/web/{file}", get(web::file))
        .route("/healthz", get(health::healthz))
        .route("/readyz", get(health::readyz))
        .route("/metrics", get(health::metrics))
        .route("/openapi.json", get(health::openapi))
        .route("/v1/assets/missing", post(assets::missing))
        .route(
            "/v1/assets/{digest}",
            put(assets::put_asset)
                .get(assets::get_asset)
                .head(assets::head_asset),
        )
        .route("/v1/scenes/check", post(scenes::check))
        .route("/v1/jobs", post(jobs::submit).get(jobs::list))
        .route(
            "/v1/jobs/{id}",
            get(jobs::get_job)
                .patch(jobs::patch_job)
                .delete(jobs::delete_job),
        )
        .route("/v1/jobs/{id}/pause", post(jobs::pause))
        .route("/v1/jobs/{id}/resume", post(jobs::resume))
        .route("/v1/jobs/{id}/cancel", post(jobs::cancel))
        .route("/v1/jobs/{id}/retry", post(jobs::retry))
        .route("/v1/jobs/{id}/tiles", get(jobs::tiles))
        .route("/v1/jobs/{id}/history", get(jobs::history))
        .route("/v1/jobs/{id}/log", get(jobs::log))
        .route("/v1/jobs/{id}/events", get(events::job_events))
        .route("/v1/events", get(events::all_events))
        .route("/v1/jobs/{id}/image.png", get(images::png))
        .route("/v1/jobs/{id}/image.exr", get(images::exr))
        .route("/v1/workers", get(workers::list_workers))
        .route("/v1/workers/{id}", patch(workers::patch_worker))
        .route("/v1/worker/register", post(worker::register))
        .route("/v1/worker/sync", post(worker::sync))
        .route("/v1/worker/results/{job}/{unit}", put(worker::result))
        .fallback(no_route)
        .method_not_allowed_fallback(wrong_method)
        .with_state(farm)
        .layer(middleware::from_fn_with_state(guard, auth::guard))
        .layer(middleware::from_fn(finish))
}

async fn no_route(uri: Uri) -> ApiError {
    let path: String = uri.path().chars().take(200).collect();
    ApiError::new(NO_ROUTE, path)
}

async fn wrong_method(request: Request) -> ApiError {
    let path: String = request.uri().path().chars().take(200).collect();
    ApiError::new(METHOD, format!("{} {path}", request.method()))
}

tokio::task_local! {
    static REQUEST_ID: Uuid;
}

/// Id of the request that is being answered.
pub fn request_id() -> Option<Uuid> {
    REQUEST_ID.try_with(|id| *id).ok()
}

/// Around everything: an id, a line in the log, headers that every answer has.
async fn finish(request: Request, next: Next) -> Response {
    let id = Uuid::now_v7();
    let (method, path) = (request.method().clone(), request.uri().path().to_owned());
    let mut response = REQUEST_ID.scope(id, next.run(request)).await;
    let status = response.status().as_u16();
    if status >= 500 {
        tracing::warn!(request.id = %id, %method, path, status, "an answer that should not be");
    } else {
        tracing::debug!(request.id = %id, %method, path, status, "answered");
    }
    let headers = response.headers_mut();
    if let Ok(value) = HeaderValue::from_str(&id.to_string()) {
        headers.insert("brolly-request-id", value);
    }
    headers.insert(
        header::X_CONTENT_TYPE_OPTIONS,
        HeaderValue::from_static("nosniff"),
    );
    if !headers.contains_key(header::CACHE_CONTROL) {
        headers.insert(header::CACHE_CONTROL, HeaderValue::from_static("no-store"));
    }
    response
}
