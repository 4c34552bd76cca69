//! Errors as `application/problem+json` [RFC 9457]. Every kind is in [`KINDS`], once; the table in
//! `docs/api-design.md` is tested against it.

use axum::http::{HeaderValue, StatusCode, header};
use axum::response::{IntoResponse, Response};
use protocol::{Finding, Limit, Problem};
use std::time::Duration;
use store::StoreError;

/// A kind of error: stable, programs may match on it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Kind {
    /// Last part of `type`.
    pub name: &'static str,
    /// HTTP status.
    pub status: u16,
    /// In words.
    pub title: &'static str,
}

macro_rules! kinds {
    ($($(#[$doc:meta])* $id:ident = $name:literal, $status:literal, $title:literal;)*) => {
        $($(#[$doc])* pub const $id: Kind = Kind { name: $name, status: $status, title: $title };)*
        /// All of them.
        pub const KINDS: &[Kind] = &[$($id),*];
    };
}

kinds! {
    /// Not HTTP, JSON or a number where one is needed.
    BAD_REQUEST = "bad-request", 400, "The request cannot be read";
    /// The bytes are not those that their name says.
    DIGEST_MISMATCH = "digest-mismatch", 400, "The bytes do not have the digest that was given";
    /// No token, or one that nobody knows.
    UNAUTHORIZED = "unauthorized", 401, "A token is needed";
    /// The token does not allow it.
    FORBIDDEN = "forbidden", 403, "The token does not allow this";
    /// Another site's page, or a name that does not belong to this machine.
    FOREIGN_ORIGIN = "foreign-origin", 403, "Requests from other sites are refused";
    /// No such path.
    NO_ROUTE = "no-route", 404, "There is nothing at this address";
    /// No such job.
    NO_JOB = "no-job", 404, "There is no such job";
    /// No such asset.
    NO_ASSET = "no-asset", 404, "There is no such asset";
    /// No such frame.
    NO_FRAME = "no-frame", 404, "The job has no such frame";
    /// The worker has to register (again).
    NO_WORKER = "no-worker", 404, "There is no such worker";
    /// There, but not like this.
    METHOD = "method-not-allowed", 405, "This address does not take this method";
    /// The state of the job does not allow it.
    WRONG_STATE = "wrong-state", 409, "The job's state does not allow this";
    /// Two machines disagree.
    OTHER_BYTES = "other-bytes", 409, "Other bytes are known for this unit";
    /// Somebody else was faster.
    CONFLICT = "conflict", 409, "It was changed by somebody else";
    /// Nothing is rendered yet.
    NO_IMAGE = "no-image-yet", 409, "The job has no picture yet";
    /// The engine moves bits.
    ENGINE_VERSION = "engine-version", 409, "Worker and coordinator have different engine versions";
    /// Its results cannot be trusted.
    QUARANTINED = "worker-quarantined", 409, "The worker is in quarantine";
    /// Nobody wants the result any more.
    GONE = "gone", 410, "The job or unit is no longer wanted";
    /// A condition in a header does not hold.
    PRECONDITION = "precondition-failed", 412, "The picture is another one by now";
    /// A limit, which is named.
    TOO_LARGE = "too-large", 413, "It is larger than the limit";
    /// Not JSON, or compressed.
    MEDIA_TYPE = "unsupported-media-type", 415, "This kind of body is not taken";
    /// Readable, but wrong.
    INVALID = "invalid", 422, "The request is not valid";
    /// Findings say where.
    BAD_SCENE = "bad-scene", 422, "The scene cannot be used";
    /// They have to be uploaded first.
    ASSETS_MISSING = "assets-missing", 422, "Files of the scene are not uploaded";
    /// It would take samples back.
    LOOSER_STOP = "looser-stop", 422, "A stop can only be tightened";
    /// The key belongs to another request.
    KEY_REUSED = "idempotency-key-reused", 422, "The idempotency key was used for another request";
    /// A result that is none.
    BAD_RESULT = "bad-result", 422, "The bytes are not a result of this unit";
    /// A worker could not render the scene.
    SCENE_FAILED = "scene-failed", 422, "A worker could not render the scene";
    /// One unit fails everywhere.
    POISON_UNIT = "poison-unit", 422, "A unit failed on several workers";
    /// A limit on how much at once.
    TOO_MANY = "too-many", 429, "There are too many of these at once";
    /// A mistake of this program.
    INTERNAL = "internal", 500, "Something went wrong inside";
    /// No space left.
    FULL = "storage-full", 503, "There is no room left";
    /// Later.
    UNAVAILABLE = "unavailable", 503, "Not now; try again";
}

/// Where the types of problems are documented.
const PREFIX: &str = "/problems/";

/// An error on its way to the client.
#[derive(Clone, Debug)]
pub struct ApiError {
    kind: Kind,
    // Boxed: errors are rare, and every result would be as large as they are.
    more: Box<More>,
}

#[derive(Clone, Debug)]
struct More {
    detail: Option<String>,
    findings: Vec<Finding>,
    limit: Option<Limit>,
    retry_after: Option<Duration>,
}

impl ApiError {
    /// Of a kind, with what was wrong this time.
    pub fn new(kind: Kind, detail: impl Into<String>) -> Self {
        let more = More {
            detail: Some(detail.into()),
            findings: Vec::new(),
            limit: None,
            retry_after: (kind.status == 503 || kind.status == 429)
                .then_some(Duration::from_secs(2)),
        };
        ApiError {
            kind,
            more: Box::new(more),
        }
    }

    /// A limit that was broken.
    pub fn limit(kind: Kind, name: &str, value: u64, actual: Option<u64>) -> Self {
        let detail = match actual {
            Some(actual) => format!("{name}: {actual}, more than the limit of {value}"),
            None => format!("{name}: more than the limit of {value}"),
        };
        let mut error = ApiError::new(kind, detail);
        error.more.limit = Some(Limit {
            name: name.to_owned(),
            value,
            actual,
        });
        error
    }

    /// With findings in the scene.
    pub fn with_findings(mut self, findings: Vec<Finding>) -> Self {
        self.more.findings = findings;
        self
    }

    /// Which kind.
    pub fn kind(&self) -> Kind {
        self.kind
    }

    /// As it is written.
    pub fn problem(&self) -> Problem {
        Problem {
            kind: format!("{PREFIX}{}", self.kind.name),
            title: self.kind.title.to_owned(),
            status: self.kind.status,
            detail: self.more.detail.clone(),
            findings: self.more.findings.clone(),
            limit: self.more.limit.clone(),
            request_id: crate::routes::request_id().map(|id| id.to_string()),
        }
    }
}

impl std::fmt::Display for ApiError {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match &self.more.detail {
            Some(detail) => write!(f, "{}: {detail}", self.kind.title),
            None => f.write_str(self.kind.title),
        }
    }
}

impl std::error::Error for ApiError {}

impl From<StoreError> for ApiError {
    fn from(error: StoreError) -> Self {
        match &error {
            StoreError::NotFound { what } => ApiError::new(NO_ASSET, format!("{what} is gone")),
            StoreError::Conflict { .. } | StoreError::LeaseLost { .. } => {
                ApiError::new(CONFLICT, error.to_string())
            }
            StoreError::Full { what } => ApiError::new(FULL, format!("no room for {what}")),
            StoreError::Unavailable { .. } | StoreError::Locked { .. } => {
                tracing::error!(%error, "the store failed");
                ApiError::new(UNAVAILABLE, "the store does not answer")
            }
            StoreError::SyncFailed { .. } => {
                ApiError::new(UNAVAILABLE, "the store is broken; the coordinator ends")
            }
            StoreError::Damaged { .. } => {
                tracing::error!(%error, "the store is damaged");
                ApiError::new(
                    UNAVAILABLE,
                    "the store is damaged; see the coordinator's log",
                )
            }
        }
    }
}

impl IntoResponse for ApiError {
    fn into_response(self) -> Response {
        let status =
            StatusCode::from_u16(self.kind.status).unwrap_or(StatusCode::INTERNAL_SERVER_ERROR);
        let mut response = (status, axum::Json(self.problem())).into_response();
        let headers = response.headers_mut();
        headers.insert(
            header::CONTENT_TYPE,
            HeaderValue::from_static("application/problem+json"),
        );
        if let Some(after) = self.more.retry_after {
            headers.insert(header::RETRY_AFTER, HeaderValue::from(after.as_secs()));
        }
        if status == StatusCode::PAYLOAD_TOO_LARGE {
            // The rest of the body is not read as another request.
            headers.insert(header::CONNECTION, HeaderValue::from_static("close"));
        }
        if status == StatusCode::UNAUTHORIZED {
            headers.insert(header::WWW_AUTHENTICATE, HeaderValue::from_static("Bearer"));
        }
        response
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn kinds_are_documented_once() {
        let docs = include_str!("../../../docs/api-design.md");
        for kind in KINDS {
            let row = format!("| `{}` | {} | {} |", kind.name, kind.status, kind.title);
            assert!(docs.contains(&row), "docs/api-design.md lacks\n{row}");
            let same = KINDS.iter().filter(|k| k.name == kind.name).count();
            assert_eq!(same, 1, "{}", kind.name);
        }
    }
}
