//! Files by content.

use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

/// Body of `POST /v1/assets/missing`: which of these does the coordinator lack?
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct MissingRequest {
    /// BLAKE3 digests, lower-case hex.
    pub digests: Vec<String>,
}

/// Answer to [`MissingRequest`].
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
pub struct MissingResponse {
    /// Those that have to be uploaded, in the order of the request.
    pub missing: Vec<String>,
}
