//! What can go wrong between a client and a coordinator.

use protocol::Problem;
use std::path::PathBuf;
use std::time::Duration;

/// Why a call failed.
#[derive(Debug, thiserror::Error)]
pub enum ClientError {
    /// The address of the coordinator is no `http://` URL.
    #[error("'{url}' is no address of a coordinator: {reason}")]
    Address {
        /// What was given.
        url: String,
        /// What is wrong with it.
        reason: String,
    },
    /// No answer: nothing listens, the connection broke, or it took too long.
    #[error("{url} cannot be reached")]
    Unreachable {
        /// Which address.
        url: String,
        /// What the connection said.
        #[source]
        source: reqwest::Error,
    },
    /// The coordinator refused, and said why.
    #[error("{}", describe(.problem))]
    Problem {
        /// What it said.
        problem: Box<Problem>,
        /// When to come back, if it said so.
        retry_after: Option<Duration>,
    },
    /// An answer that is neither a success nor a problem: something else listens there.
    #[error("{url} answered with status {status}: {body}")]
    Status {
        /// Which address.
        url: String,
        /// HTTP status.
        status: u16,
        /// The beginning of its body.
        body: String,
        /// When to come back, if it said so.
        retry_after: Option<Duration>,
    },
    /// An answer that does not have the expected form.
    #[error("{url} answered with something unexpected")]
    Decode {
        /// Which address.
        url: String,
        /// What did not fit.
        #[source]
        source: serde_json::Error,
    },
    /// A local file could not be read.
    #[error("{} cannot be read", .path.display())]
    File {
        /// Which file.
        path: PathBuf,
        /// What the system said.
        #[source]
        source: std::io::Error,
    },
    /// A downloaded file does not have the digest that it is named by.
    #[error("asset {expected} arrived with digest {actual}")]
    Digest {
        /// The name.
        expected: String,
        /// What the bytes hash to.
        actual: String,
    },
}

fn describe(problem: &Problem) -> String {
    let mut text = match &problem.detail {
        Some(detail) => format!("{}: {detail}", problem.title),
        None => problem.title.clone(),
    };
    if let Some(limit) = &problem.limit {
        text.push_str(&format!(" (limit {}: {}", limit.name, limit.value));
        if let Some(actual) = limit.actual {
            text.push_str(&format!(", here {actual}"));
        }
        text.push(')');
    }
    text
}

impl ClientError {
    /// Whether the same call may succeed later: no answer, 429, 503, and what proxies say while the
    /// coordinator restarts.
    pub fn retryable(&self) -> bool {
        match self {
            ClientError::Unreachable { .. } => true,
            ClientError::Problem { .. } | ClientError::Status { .. } => {
                matches!(self.status(), Some(429 | 502 | 503 | 504))
            }
            _ => false,
        }
    }

    /// HTTP status of the answer, if there was one.
    pub fn status(&self) -> Option<u16> {
        match self {
            ClientError::Problem { problem, .. } => Some(problem.status),
            ClientError::Status { status, .. } => Some(*status),
            _ => None,
        }
    }

    /// When the coordinator asked to come back.
    pub fn retry_after(&self) -> Option<Duration> {
        match self {
            ClientError::Problem { retry_after, .. } | ClientError::Status { retry_after, .. } => {
                *retry_after
            }
            _ => None,
        }
    }

    /// What the coordinator said, if it refused.
    pub fn problem(&self) -> Option<&Problem> {
        match self {
            ClientError::Problem { problem, .. } => Some(problem),
            _ => None,
        }
    }

    /// Whether it is a problem of type `/problems/<name>`.
    pub fn is(&self, name: &str) -> bool {
        self.problem()
            .is_some_and(|p| p.kind.rsplit('/').next() == Some(name))
    }
}
