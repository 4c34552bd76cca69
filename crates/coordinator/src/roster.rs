//! The list of workers: who registers, and what of it outlives the process. A worker that was
//! quarantined or drained stays so over a restart of the coordinator, and over one of its own: a new
//! process has a new id, so the name counts, too.

use crate::error::{ApiError, ENGINE_VERSION as ENGINE, INVALID, TOO_MANY};
use crate::farm::{Farm, State};
use crate::worker::{Worker, WorkerRecord};
use protocol::{RegisterRequest, RegisterResponse, TimestampMs};
use std::sync::Arc;
use store::StoreError;
use uuid::Uuid;

/// How long a silent worker without leases stays on the list.
const LOST_KEPT_MS: u64 = 3600 * 1000;

impl Farm {
    /// A worker announces itself, for the first time or again.
    pub fn register(
        self: &Arc<Self>,
        request: RegisterRequest,
        token: Option<usize>,
    ) -> Result<RegisterResponse, ApiError> {
        let limits = &self.config.limits;
        if request.engine_version != film::ENGINE_VERSION {
            return Err(ApiError::new(
                ENGINE,
                format!(
                    "the worker has engine version {}, the coordinator {}: their pictures would differ; install the same release",
                    request.engine_version,
                    film::ENGINE_VERSION
                ),
            ));
        }
        if request.name.len() > limits.name_bytes {
            return Err(ApiError::limit(
                INVALID,
                "name_bytes",
                limits.name_bytes as u64,
                Some(request.name.len() as u64),
            ));
        }
        let now = self.clock.now();
        let mut state = self.state();
        // A worker keeps its identity over reconnects, unless it is taken by another token. Tokens
        // have no names that outlive a process, so after a restart the first who asks is believed.
        let free = |w: &Worker| w.token == token || !w.registered;
        let id = request
            .previous_id
            .filter(|id| state.workers.get(id).is_none_or(free))
            .unwrap_or_else(Uuid::now_v7);
        if state.workers.len() >= limits.workers && !state.workers.contains_key(&id) {
            return Err(ApiError::limit(
                TOO_MANY,
                "workers",
                limits.workers as u64,
                None,
            ));
        }
        match state.workers.get_mut(&id) {
            Some(known) => known.back(request, token, now),
            None => {
                tracing::info!(worker.id = %id, worker.name = request.name, threads = request.threads, "a worker registers");
                let mut worker = Worker::new(id, request, token, now);
                let all = state.workers.values();
                let same: Vec<&Worker> = all.filter(|w| w.same_name(&worker)).collect();
                worker.drained = same.iter().any(|w| w.drained);
                worker.quarantined = same.iter().find_map(|w| w.quarantined.clone());
                if let Some(reason) = &worker.quarantined {
                    tracing::warn!(worker.id = %id, worker.name = worker.about.name, reason, "a worker comes back into quarantine");
                }
                state.workers.insert(id, worker);
            }
        }
        drop(state);
        self.save_worker_later(id);
        Ok(RegisterResponse {
            worker: id,
            lease_ttl_ms: self.config.lease_ttl.as_millis() as u64,
            heartbeat_ms: self.config.heartbeat.as_millis() as u64,
        })
    }

    /// Writes what is kept of a worker. Whoever comes later writes what is later.
    pub async fn save_worker(&self, id: Uuid) -> Result<(), StoreError> {
        let _turn = self.saving_workers.lock().await;
        let record = self.state().workers.get(&id).map(Worker::record);
        let Some(record) = record else {
            return Ok(());
        };
        let bytes = serde_json::to_vec(&record).map_err(|e| StoreError::Unavailable {
            reason: format!("the record of worker {id} cannot be written: {e}"),
        })?;
        self.stores.workers.put(id, bytes).await
    }

    /// The same without making the caller wait.
    pub fn save_worker_later(self: &Arc<Self>, id: Uuid) {
        let farm = self.clone();
        self.tasks.spawn(async move {
            if let Err(error) = farm.save_worker(id).await {
                tracing::error!(worker.id = %id, %error, "a worker's record is not saved");
            }
        });
    }

    /// Reads the workers of the process before. They count as lost until they register again.
    pub async fn recover_workers(&self) -> Result<(), StoreError> {
        let stored = self.stores.workers.list().await?;
        let now = self.clock.now();
        let mut state = self.state();
        for (id, bytes) in stored {
            match serde_json::from_slice::<WorkerRecord>(&bytes) {
                Ok(record) => {
                    state.workers.insert(id, Worker::recovered(id, record, now));
                }
                // Not worth refusing to start: it has to register again anyway.
                Err(error) => {
                    tracing::error!(worker.id = %id, %error, "the record of a worker cannot be read")
                }
            }
        }
        Ok(())
    }

    /// Ends quarantine or draining of a worker and of all that have its name: else it would be back
    /// with its next process. Returns whom it changed.
    pub fn pardon(&self, id: Uuid, quarantine: bool, drain: bool) -> Vec<Uuid> {
        let mut state = self.state();
        let Some(pardoned) = state.workers.get(&id).cloned() else {
            return Vec::new();
        };
        let all = state.workers.values_mut();
        let same = all.filter(|w| w.id == id || w.same_name(&pardoned));
        same.map(|worker| {
            if quarantine {
                worker.quarantined = None;
            }
            worker.drained &= !drain;
            worker.id
        })
        .collect()
    }
}

/// Takes workers off the list that have been silent for long. Who is quarantined or drained stays
/// as long as it is the only one of its name that says so.
pub fn forget_lost(farm: &Arc<Farm>, state: &mut State, now: TimestampMs) {
    let stale = |w: &Worker| w.held.is_empty() && now.saturating_sub(w.last_seen) >= LOST_KEPT_MS;
    let flags = |w: &Worker| (w.quarantined.is_some(), w.drained);
    let gone: Vec<Uuid> = state
        .workers
        .values()
        .filter(|worker| {
            stale(worker)
                && (flags(worker) == (false, false)
                    || state.workers.values().any(|other| {
                        other.id > worker.id
                            && other.same_name(worker)
                            && flags(other) == flags(worker)
                    }))
        })
        .map(|worker| worker.id)
        .collect();
    if gone.is_empty() {
        return;
    }
    state.workers.retain(|id, _| !gone.contains(id));
    let workers = farm.stores.workers.clone();
    farm.tasks.spawn(async move {
        if let Err(error) = workers.remove(gone).await {
            tracing::warn!(%error, "lost workers stay in the store until the next start");
        }
    });
}
