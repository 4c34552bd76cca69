//! Checking scenes without a job.

use super::body::Json;
use crate::error::{ASSETS_MISSING, ApiError, BAD_SCENE};
use crate::farm::Farm;
use crate::record::parse_digest;
use crate::{import, submit};
use axum::extract::State;
use protocol::{CheckReport, JobRequest, Problem};
use std::sync::Arc;

/// What there is to say about a scene. The files have to be uploaded.
#[utoipa::path(post, path = "/v1/scenes/check", tag = "scenes", request_body = JobRequest,
    responses((status = 200, body = CheckReport), (status = "4XX", body = Problem, content_type = "application/problem+json")))]
pub async fn check(
    State(farm): State<Arc<Farm>>,
    Json(mut request): Json<JobRequest>,
) -> Result<axum::Json<CheckReport>, ApiError> {
    submit::check(&farm, &mut request)?;
    let digests = request
        .files
        .values()
        .filter_map(|d| parse_digest(d))
        .collect();
    let missing = submit::missing(&farm, digests).await?;
    if !missing.is_empty() {
        return Err(ApiError::new(
            ASSETS_MISSING,
            format!("{} files are not uploaded", missing.len()),
        ));
    }
    let report = match import::import_on_thread(&farm, request).await {
        Ok(imported) => CheckReport {
            ok: true,
            findings: imported.findings,
        },
        Err(error) if error.kind() == BAD_SCENE && !error.problem().findings.is_empty() => {
            CheckReport {
                ok: false,
                findings: error.problem().findings,
            }
        }
        Err(error) => return Err(error),
    };
    Ok(axum::Json(report))
}
