//! What workers call, and what people do about workers.

use crate::{Client, ClientError};
use bytes::Bytes;
use film::Unit;
use protocol::{
    LeaseRef, RegisterRequest, RegisterResponse, SyncRequest, SyncResponse, WorkerList,
    WorkerPatch, WorkerStatus,
};
use reqwest::Method;
use std::time::Duration;
use uuid::Uuid;

/// Time that an answer may take beyond the wait that was asked for.
const SYNC_GRACE: Duration = Duration::from_secs(10);

/// A finished unit on its way to the coordinator.
#[derive(Clone, Debug)]
pub struct UnitResult {
    /// Which worker rendered it.
    pub worker: Uuid,
    /// Which lease it answers.
    pub lease: LeaseRef,
    /// The encoded sums.
    pub bytes: Bytes,
    /// BLAKE3 of `bytes`, lower-case hex.
    pub blake3: String,
    /// Processor time that it took, seconds.
    pub cpu_seconds: f64,
}

/// What became of a delivered result.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Delivery {
    /// Accepted and durable.
    Accepted,
    /// The same bytes were there already.
    Duplicate,
    /// Other bytes are known for this unit: one of two machines is wrong.
    OtherBytes,
    /// The job is cancelled or deleted.
    Gone,
}

impl Client {
    /// Announces a worker. One call: the worker decides what to do about an error.
    pub async fn register(
        &self,
        request: &RegisterRequest,
    ) -> Result<RegisterResponse, ClientError> {
        let call = self
            .request(Method::POST, "v1/worker/register")
            .timeout(SYNC_GRACE)
            .json(request);
        let response = self.send_once(call).await?;
        self.json(response).await
    }

    /// Heartbeat, progress, leases and cancellations. One call: what has to be said changes with
    /// every try.
    pub async fn sync(&self, request: &SyncRequest) -> Result<SyncResponse, ClientError> {
        let call = self
            .request(Method::POST, "v1/worker/sync")
            .timeout(Duration::from_millis(request.wait_ms) + SYNC_GRACE)
            .json(request);
        let response = self.send_once(call).await?;
        self.json(response).await
    }

    /// Delivers a result. One call; delivering twice does no harm.
    pub async fn deliver(&self, result: &UnitResult) -> Result<Delivery, ClientError> {
        let LeaseRef { job, unit, attempt } = &result.lease;
        let call = self
            .request(Method::PUT, &result_path(*job, unit))
            .timeout(Duration::from_secs(60))
            .header("Content-Type", "application/octet-stream")
            .header("Brolly-Blake3", &result.blake3)
            .header("Brolly-Worker", result.worker.to_string())
            .header("Brolly-Attempt", attempt.to_string())
            .header("Brolly-Cpu-Seconds", format!("{:.6}", result.cpu_seconds))
            .body(result.bytes.clone());
        match self.send_once(call).await {
            Ok(response) if response.status() == reqwest::StatusCode::CREATED => {
                Ok(Delivery::Accepted)
            }
            Ok(_) => Ok(Delivery::Duplicate),
            Err(error) if error.is("other-bytes") => Ok(Delivery::OtherBytes),
            Err(error) if error.status() == Some(410) => Ok(Delivery::Gone),
            Err(error) => Err(error),
        }
    }

    /// All workers.
    pub async fn workers(&self) -> Result<WorkerList, ClientError> {
        self.get("v1/workers").await
    }

    /// Drains or quarantines a worker, or undoes it.
    pub async fn patch_worker(
        &self,
        id: Uuid,
        patch: &WorkerPatch,
    ) -> Result<WorkerStatus, ClientError> {
        self.patch(&format!("v1/workers/{id}"), patch).await
    }
}

fn result_path(job: Uuid, unit: &Unit) -> String {
    format!("v1/worker/results/{job}/{unit}")
}
