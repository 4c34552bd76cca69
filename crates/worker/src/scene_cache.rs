//! Prepared scenes, by digest of the job's settings and frame: prepared once, kept while there is
//! memory, shared by all threads.

use crate::assets::{AssetCache, FetchError};
use crate::pool::panic_text;
use protocol::JobSpec;
use std::collections::HashMap;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::Arc;
use std::time::Instant;
use tokio::sync::Semaphore;
use tokio::sync::mpsc::UnboundedSender;
use tokio_util::task::TaskTracker;
use tracer::{PrepareError, PrepareSettings, Scene, StopFlag};
use uuid::Uuid;

/// Preparations that run at the same time: one may wait for its files while another computes.
const PREPARATIONS_AT_ONCE: usize = 2;

/// Names a prepared scene.
#[derive(Clone, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct SceneKey {
    pub spec_digest: String,
    pub frame: u32,
}

/// Why a scene could not be prepared.
#[derive(Clone, Debug)]
pub struct PrepareFailure {
    pub reason: String,
    /// The scene is at fault: no other worker can do better.
    pub scene_error: bool,
    /// This machine or its connection is at fault.
    pub machine_error: bool,
    /// It was asked to stop.
    pub stopped: bool,
}

/// A preparation ended.
pub struct Prepared {
    pub key: SceneKey,
    pub job: Uuid,
    pub seconds: f64,
    pub result: Result<Arc<Scene>, PrepareFailure>,
}

enum Entry {
    Preparing {
        stop: Arc<StopFlag>,
    },
    Ready {
        scene: Arc<Scene>,
        bytes: u64,
        used: u64,
    },
}

/// The cache. Owned by the lease loop, so there are no locks.
pub struct SceneCache {
    assets: AssetCache,
    budget_bytes: u64,
    threads: usize,
    entries: HashMap<SceneKey, Entry>,
    clock: u64,
    gate: Arc<Semaphore>,
    tasks: TaskTracker,
    events: UnboundedSender<Prepared>,
}

impl SceneCache {
    /// An empty cache; ends of preparations are reported to `events`.
    pub fn new(
        assets: AssetCache,
        budget_bytes: u64,
        threads: usize,
        events: UnboundedSender<Prepared>,
    ) -> Self {
        SceneCache {
            assets,
            budget_bytes,
            threads,
            entries: HashMap::new(),
            clock: 0,
            gate: Arc::new(Semaphore::new(PREPARATIONS_AT_ONCE)),
            tasks: TaskTracker::new(),
            events,
        }
    }

    /// The scene, or nothing: then it is being prepared and [`Prepared`] will follow.
    pub fn get(&mut self, key: &SceneKey, job: Uuid, spec: &Arc<JobSpec>) -> Option<Arc<Scene>> {
        self.clock += 1;
        match self.entries.get_mut(key) {
            Some(Entry::Ready { scene, used, .. }) => {
                *used = self.clock;
                return Some(scene.clone());
            }
            Some(Entry::Preparing { .. }) => return None,
            None => {}
        }
        let stop = Arc::new(StopFlag::default());
        self.entries
            .insert(key.clone(), Entry::Preparing { stop: stop.clone() });
        let (assets, gate, events) = (self.assets.clone(), self.gate.clone(), self.events.clone());
        let (key, spec, threads) = (key.clone(), spec.clone(), self.threads);
        let picture_bytes = self.budget_bytes / 2;
        self.tasks.spawn(async move {
            let _turn = gate.acquire_owned().await; // the semaphore is never closed
            let begin = Instant::now();
            let result = prepare(&assets, spec, key.frame, threads, picture_bytes, stop).await;
            let seconds = begin.elapsed().as_secs_f64();
            // Nobody listens only when the worker is gone.
            let _ = events.send(Prepared {
                key,
                job,
                seconds,
                result,
            });
        });
        None
    }

    /// Takes note of the end of a preparation and makes room.
    pub fn prepared(&mut self, key: &SceneKey, result: &Result<Arc<Scene>, PrepareFailure>) {
        let Ok(scene) = result else {
            self.entries.remove(key); // the next lease tries again
            return;
        };
        self.clock += 1;
        let bytes = scene.memory_bytes() as u64;
        self.entries.insert(
            key.clone(),
            Entry::Ready {
                scene: scene.clone(),
                bytes,
                used: self.clock,
            },
        );
        self.make_room(key);
    }

    /// Stops a preparation that nobody waits for.
    pub fn abandon(&mut self, key: &SceneKey) {
        if let Some(Entry::Preparing { stop }) = self.entries.get(key) {
            stop.stop();
        }
    }

    /// Drops scenes, those used longest ago first, until the budget holds; never one that is in use,
    /// since dropping that would free nothing, and never `newest`.
    fn make_room(&mut self, newest: &SceneKey) {
        loop {
            let mut total = 0;
            let mut oldest: Option<(u64, SceneKey)> = None;
            for (key, entry) in &self.entries {
                if let Entry::Ready { scene, bytes, used } = entry {
                    total += bytes;
                    let idle = Arc::strong_count(scene) == 1 && key != newest;
                    if idle && oldest.as_ref().is_none_or(|(age, _)| used < age) {
                        oldest = Some((*used, key.clone()));
                    }
                }
            }
            if total <= self.budget_bytes {
                return;
            }
            let Some((_, key)) = oldest else {
                tracing::warn!(
                    total,
                    budget = self.budget_bytes,
                    "the scenes in use are larger than the memory budget"
                );
                return;
            };
            tracing::debug!(scene = %key.spec_digest, frame = key.frame, "dropping a prepared scene");
            self.entries.remove(&key);
        }
    }
}

async fn prepare(
    assets: &AssetCache,
    spec: Arc<JobSpec>,
    frame: u32,
    threads: usize,
    picture_bytes: u64,
    stop: Arc<StopFlag>,
) -> Result<Arc<Scene>, PrepareFailure> {
    let failure = |reason: String| PrepareFailure {
        reason,
        scene_error: false,
        machine_error: false,
        stopped: false,
    };
    let source = assets.source(&spec).await.map_err(|error| PrepareFailure {
        machine_error: matches!(error, FetchError::Download { .. }),
        scene_error: matches!(error, FetchError::Path(_)),
        ..failure(chain(&error))
    })?;
    if stop.is_stopped() {
        return Err(PrepareFailure {
            stopped: true,
            ..failure("stopped".into())
        });
    }
    let work = move || {
        let (desc, _warnings) =
            scene::load(&spec.scene, &source, &spec.overrides).map_err(|error| PrepareFailure {
                scene_error: true,
                ..failure(error.to_string())
            })?;
        let settings = PrepareSettings {
            seed: spec.seed,
            frame,
            clamp_indirect: spec.overrides.clamp_indirect,
            threads,
            picture_bytes,
        };
        tracer::prepare(&desc, &source, &settings, &stop)
            .map(Arc::new)
            .map_err(|error| PrepareFailure {
                scene_error: !matches!(error, PrepareError::Stopped),
                stopped: matches!(error, PrepareError::Stopped),
                ..failure(chain(&error))
            })
    };
    tokio::task::spawn_blocking(move || catch_unwind(AssertUnwindSafe(work)))
        .await
        .map_err(|error| failure(error.to_string()))?
        .unwrap_or_else(|panic| {
            Err(failure(format!(
                "preparing the scene panicked: {}",
                panic_text(&*panic)
            )))
        })
}

/// An error with its causes, for the job's log.
fn chain(error: &dyn std::error::Error) -> String {
    let mut text = error.to_string();
    let mut source = error.source();
    while let Some(cause) = source {
        text.push_str(": ");
        text.push_str(&cause.to_string());
        source = cause.source();
    }
    text
}
