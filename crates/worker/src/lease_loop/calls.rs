//! Talking to the coordinator: registering, syncing, and going on after an outage.

use super::{CALLS_MAX, Call, LeaseLoop, QUIET, Quiet, Reports};
use crate::WorkerError;
use crate::pace::Wish;
use client::{ClientError, RetryPolicy};
use protocol::{RegisterRequest, RegisterResponse, SyncRequest, SyncResponse};
use tokio::time::Instant;
use uuid::Uuid;

impl LeaseLoop {
    /// When there may be a call again.
    pub(super) fn next_call(&self) -> Instant {
        let quiet = self.quiet.map_or(self.not_before, |quiet| quiet.until);
        self.not_before.max(quiet)
    }

    pub(super) fn make_calls(&mut self) {
        if Instant::now() < self.not_before {
            return;
        }
        let Some(registered) = &self.registered else {
            if !self.registering {
                self.register();
            }
            return;
        };
        let (worker, heartbeat_ms) = (registered.worker, registered.heartbeat_ms.max(100));
        let want = self.want();
        // Whoever asks only for more samples may be left without; a thread without work may not.
        let asking = self
            .open
            .values()
            .any(|open| open.units > 0 || (open.is_some() && want.units == 0));
        if self.open.len() >= CALLS_MAX {
            return;
        }
        if !self.reports.is_empty() {
            self.sync(worker, Wish::NONE, 0);
        }
        let quiet = self.quiet.is_some_and(|quiet| {
            Instant::now() < quiet.until && (quiet.want.units > 0 || want.units == 0)
        });
        if !quiet && (self.open.is_empty() || (want.is_some() && !asking)) {
            self.sync(worker, want, heartbeat_ms);
        }
    }

    pub(super) fn register(&mut self) {
        let request = RegisterRequest {
            name: self.config.name.clone(),
            threads: self.config.threads as u32,
            engine_version: self.config.engine_version,
            version: env!("CARGO_PKG_VERSION").into(),
            simd: tracer::simd_level().into(),
            memory_bytes: self.config.memory_bytes,
            previous_id: Some(*self.identity.borrow()).filter(|id| !id.is_nil()),
        };
        let client = self.client.clone();
        self.registering = true;
        self.calls
            .spawn(async move { Call::Registered(client.register(&request).await) });
    }

    pub(super) fn sync(&mut self, worker: Uuid, want: Wish, wait_ms: u64) {
        let reports = std::mem::take(&mut self.reports);
        let request = SyncRequest {
            worker,
            held: self.held.all(),
            given_back: reports.given_back.clone(),
            failed: reports.failed.clone(),
            want: want.units,
            want_samples: want.samples,
            wait_ms,
            draining: self.leaving.is_some(),
            prepared: reports.prepared.clone(),
        };
        let number = self.next_number;
        self.next_number += 1;
        self.open.insert(number, want);
        let client = self.client.clone();
        self.calls.spawn(async move {
            let result = client.sync(&request).await;
            Call::Synced {
                number,
                worker,
                want,
                reports,
                result,
            }
        });
    }

    pub(super) fn registered(
        &mut self,
        result: Result<RegisterResponse, ClientError>,
    ) -> Result<(), WorkerError> {
        self.registering = false;
        match result {
            Ok(registered) => {
                tracing::info!(worker.id = %registered.worker, coordinator = %self.client.base(), "registered");
                self.identity.send_replace(registered.worker);
                self.registered = Some(registered);
                self.ever_registered = true;
                self.reachable();
                Ok(())
            }
            Err(source) if source.is("engine-version") => Err(WorkerError::EngineVersion {
                ours: self.config.engine_version,
                source,
            }),
            // A wrong token at the start is a mistake to be told; later it is being changed.
            Err(source) if matches!(source.status(), Some(401 | 403)) && !self.ever_registered => {
                Err(WorkerError::Unauthorised(source))
            }
            Err(error) => {
                self.unreachable(&error);
                Ok(())
            }
        }
    }

    pub(super) fn synced(
        &mut self,
        worker: Uuid,
        want: Wish,
        reports: Reports,
        result: Result<SyncResponse, ClientError>,
    ) -> Result<(), WorkerError> {
        match result {
            Ok(response) => {
                self.reachable();
                self.quiet = response.leases.is_empty().then(|| Quiet {
                    until: Instant::now() + QUIET,
                    want,
                });
                self.take_response(response);
            }
            Err(source) if source.is("engine-version") => {
                return Err(WorkerError::EngineVersion {
                    ours: self.config.engine_version,
                    source,
                });
            }
            Err(error) if error.is("no-worker") => {
                self.reports.add(reports);
                self.forgotten(worker);
            }
            Err(error) => {
                self.reports.add(reports);
                self.unreachable(&error);
            }
        }
        Ok(())
    }

    /// The coordinator does not know `worker`: it restarted, or we were silent for too long.
    pub(super) fn forgotten(&mut self, worker: Uuid) {
        if self.registered.as_ref().is_some_and(|r| r.worker == worker) {
            tracing::info!(worker.id = %worker, "not known to the coordinator any more, registering again");
            self.registered = None;
        }
    }

    pub(super) fn reachable(&mut self) {
        if self.failures > 0 {
            tracing::info!("the coordinator answers again");
            self.outbox.wake();
        }
        self.failures = 0;
        self.not_before = Instant::now();
    }

    pub(super) fn unreachable(&mut self, error: &ClientError) {
        if Instant::now() < self.not_before {
            return; // another call of the same outage
        }
        self.failures += 1;
        let pause = RetryPolicy::FOREVER.backoff(self.failures, error.retry_after());
        self.not_before = Instant::now() + pause;
        let cause = std::error::Error::source(error).map(|e| e.to_string());
        if self.failures == 1 {
            tracing::warn!(%error, cause, "the coordinator does not answer, trying again for ever");
        } else {
            tracing::debug!(%error, cause, failures = self.failures, "still no answer");
        }
    }
}
