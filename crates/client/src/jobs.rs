//! Jobs: submit, look, change, fetch pictures.

use crate::{Client, ClientError};
use bytes::Bytes;
use protocol::{
    CheckReport, HistoryPoint, JobList, JobPatch, JobRequest, JobState, JobStatus, LogLine,
    TileList,
};
use reqwest::Method;
use reqwest::header::{ETAG, IF_NONE_MATCH};
use uuid::Uuid;

/// Which jobs to list.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct JobQuery {
    /// Only those in this state.
    pub state: Option<JobState>,
    /// Where the page before ended.
    pub cursor: Option<String>,
    /// At most so many.
    pub limit: Option<u32>,
}

/// Which picture of a job.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct ImageQuery {
    /// Layer by name; default: the picture itself.
    pub layer: Option<String>,
    /// Stops of exposure, for PNG.
    pub exposure: Option<f64>,
    /// Tone map by name, for PNG.
    pub tonemap: Option<String>,
    /// Frame number; default: the first.
    pub frame: Option<u32>,
}

/// A picture as the coordinator made it.
#[derive(Clone, Debug)]
pub struct Picture {
    /// PNG or EXR.
    pub bytes: Bytes,
    /// Names exactly this picture.
    pub etag: Option<String>,
}

impl Client {
    /// What the coordinator thinks of a scene, without a job.
    pub async fn check(&self, request: &JobRequest) -> Result<CheckReport, ClientError> {
        self.post("v1/scenes/check", request).await
    }

    /// Submits a job. An idempotency key makes the retries of this call one submission.
    pub async fn submit(&self, request: &JobRequest) -> Result<JobStatus, ClientError> {
        let key = Uuid::now_v7().to_string();
        let response = self
            .send(|| {
                self.request(Method::POST, "v1/jobs")
                    .header("Idempotency-Key", &key)
                    .json(request)
            })
            .await?;
        self.json(response).await
    }

    /// One page of the list of jobs, newest first.
    pub async fn jobs(&self, query: &JobQuery) -> Result<JobList, ClientError> {
        let mut pairs: Vec<(&str, String)> = Vec::new();
        if let Some(state) = query.state {
            pairs.push(("state", format!("{state:?}").to_lowercase()));
        }
        if let Some(cursor) = &query.cursor {
            pairs.push(("cursor", cursor.clone()));
        }
        if let Some(limit) = query.limit {
            pairs.push(("limit", limit.to_string()));
        }
        let response = self
            .send(|| self.request(Method::GET, "v1/jobs").query(&pairs))
            .await?;
        self.json(response).await
    }

    /// How a job stands.
    pub async fn job(&self, id: Uuid) -> Result<JobStatus, ClientError> {
        self.get(&format!("v1/jobs/{id}")).await
    }

    /// Changes priority, name, stop rule or pause.
    pub async fn patch_job(&self, id: Uuid, patch: &JobPatch) -> Result<JobStatus, ClientError> {
        self.patch(&format!("v1/jobs/{id}"), patch).await
    }

    /// Deletes a job and what only it needed.
    pub async fn delete_job(&self, id: Uuid) -> Result<(), ClientError> {
        self.send(|| self.request(Method::DELETE, &format!("v1/jobs/{id}")))
            .await
            .map(drop)
    }

    /// Ends a job.
    pub async fn cancel(&self, id: Uuid) -> Result<JobStatus, ClientError> {
        self.act(id, "cancel").await
    }
    /// Holds a job; units in work finish and are merged.
    pub async fn pause(&self, id: Uuid) -> Result<JobStatus, ClientError> {
        self.act(id, "pause").await
    }
    /// Goes on with a paused job.
    pub async fn resume(&self, id: Uuid) -> Result<JobStatus, ClientError> {
        self.act(id, "resume").await
    }
    /// Starts a failed or cancelled job again.
    pub async fn retry_job(&self, id: Uuid) -> Result<JobStatus, ClientError> {
        self.act(id, "retry").await
    }

    async fn act(&self, id: Uuid, action: &str) -> Result<JobStatus, ClientError> {
        let path = format!("v1/jobs/{id}/{action}");
        let response = self.send(|| self.request(Method::POST, &path)).await?;
        self.json(response).await
    }

    /// The picture as it stands, as `png` or `exr`; `None` if it is still the one named by `etag`.
    pub async fn image(
        &self,
        id: Uuid,
        format: &str,
        query: &ImageQuery,
        etag: Option<&str>,
    ) -> Result<Option<Picture>, ClientError> {
        let mut pairs: Vec<(&str, String)> = Vec::new();
        if let Some(layer) = &query.layer {
            pairs.push(("layer", layer.clone()));
        }
        if let Some(exposure) = query.exposure {
            pairs.push(("exposure", exposure.to_string()));
        }
        if let Some(tonemap) = &query.tonemap {
            pairs.push(("tonemap", tonemap.clone()));
        }
        if let Some(frame) = query.frame {
            pairs.push(("frame", frame.to_string()));
        }
        let path = format!("v1/jobs/{id}/image.{format}");
        let response = self
            .send(|| {
                let request = self.request(Method::GET, &path).query(&pairs);
                match etag {
                    Some(etag) => request.header(IF_NONE_MATCH, etag),
                    None => request,
                }
            })
            .await?;
        if response.status() == reqwest::StatusCode::NOT_MODIFIED {
            return Ok(None);
        }
        let etag = response
            .headers()
            .get(ETAG)
            .and_then(|value| value.to_str().ok())
            .map(str::to_owned);
        let bytes = response.bytes().await.map_err(|e| self.unreachable(e))?;
        Ok(Some(Picture { bytes, etag }))
    }

    /// How the tiles of a frame stand.
    pub async fn tiles(&self, id: Uuid, frame: Option<u32>) -> Result<TileList, ClientError> {
        let query = frame.map_or(String::new(), |f| format!("?frame={f}"));
        self.get(&format!("v1/jobs/{id}/tiles{query}")).await
    }

    /// How error and spp went over time.
    pub async fn history(&self, id: Uuid) -> Result<Vec<HistoryPoint>, ClientError> {
        self.get(&format!("v1/jobs/{id}/history")).await
    }

    /// What happened.
    pub async fn log(&self, id: Uuid) -> Result<Vec<LogLine>, ClientError> {
        self.get(&format!("v1/jobs/{id}/log")).await
    }
}
