//! The one task that owns the worker's state: it registers, syncs, hands units to the pool and
//! results to the outbox, and leaves in order.

mod calls;
mod events;
mod leases;
mod leaving;
#[cfg(test)]
mod tests;

use crate::assets::AssetCache;
use crate::held::HeldLeases;
use crate::outbox::{Outbox, OutboxEvent};
use crate::pace::{Pace, Wish};
use crate::pool::Pool;
use crate::scene_cache::{Prepared, SceneCache, SceneKey};
use crate::{WorkerConfig, WorkerError};
use client::{Client, ClientError, RetryPolicy};
use protocol::{JobSpec, LeaseFailure, LeaseRef, RegisterResponse, SyncResponse};
use std::collections::HashMap;
use std::sync::Arc;
use std::time::Duration;
use tokio::sync::mpsc::{self, UnboundedReceiver};
use tokio::sync::{Notify, watch};
use tokio::task::JoinSet;
use tokio::time::Instant;
use tokio_util::sync::CancellationToken;
use uuid::Uuid;

/// Calls that may be open at the same time: one that waits for work, one that waits with nothing to
/// ask for, and reports.
const CALLS_MAX: usize = 4;
/// Settings of jobs that are remembered.
const SPECS_MAX: usize = 256;
/// Shortest time between two calls that have nothing to say, whatever the coordinator answers.
const QUIET: Duration = Duration::from_millis(50);
/// How long the last words to the coordinator may take when the worker leaves.
const GOODBYE: Duration = Duration::from_secs(2);

/// What a sync call carried, to say it again if the call fails.
#[derive(Default)]
struct Reports {
    given_back: Vec<LeaseRef>,
    failed: Vec<LeaseFailure>,
    prepared: Vec<(Uuid, f64)>,
}

impl Reports {
    fn is_empty(&self) -> bool {
        self.given_back.is_empty() && self.failed.is_empty() && self.prepared.is_empty()
    }
    fn add(&mut self, other: Reports) {
        self.given_back.extend(other.given_back);
        self.failed.extend(other.failed);
        self.prepared.extend(other.prepared);
    }
}

enum Call {
    Registered(Result<RegisterResponse, ClientError>),
    Synced {
        number: u64,
        worker: Uuid,
        want: Wish,
        reports: Reports,
        result: Result<SyncResponse, ClientError>,
    },
}

/// Until when not to say the same again.
#[derive(Clone, Copy)]
struct Quiet {
    until: Instant,
    want: Wish,
}

/// A unit whose scene is being prepared.
struct Parked {
    lease: LeaseRef,
    key: SceneKey,
}

pub(crate) struct LeaseLoop {
    config: WorkerConfig,
    client: Client,
    pool: Pool,
    /// The pool has something to report.
    pool_news: Arc<Notify>,
    cache: SceneCache,
    cache_events: UnboundedReceiver<Prepared>,
    outbox: Outbox,
    outbox_events: UnboundedReceiver<OutboxEvent>,
    /// Tells the outbox who we are.
    identity: watch::Sender<Uuid>,
    registered: Option<RegisterResponse>,
    ever_registered: bool,
    registering: bool,
    calls: JoinSet<Call>,
    /// Open sync calls, by number, with what they ask for.
    open: HashMap<u64, Wish>,
    next_number: u64,
    failures: u32,
    not_before: Instant,
    /// The last answer said nothing: no hurry to ask the same again.
    quiet: Option<Quiet>,
    held: HeldLeases,
    parked: Vec<Parked>,
    specs: HashMap<Uuid, Arc<JobSpec>>,
    reports: Reports,
    pace: Pace,
    /// The coordinator wants no more work done here.
    drained: bool,
    /// When units in work are given up; set once we are told to leave.
    leaving: Option<Instant>,
}

impl LeaseLoop {
    pub fn new(config: WorkerConfig) -> Result<Self, WorkerError> {
        let client =
            Client::new(&config.url, config.token.as_deref())?.with_retry(RetryPolicy::PATIENT);
        let pool_news = Arc::new(Notify::new());
        let (cache_sender, cache_events) = mpsc::unbounded_channel();
        let (outbox_sender, outbox_events) = mpsc::unbounded_channel();
        let (identity, worker) = watch::channel(Uuid::nil());
        let pool = Pool::new(config.threads, config.engine_version, pool_news.clone())
            .map_err(WorkerError::Threads)?;
        // A quarter for files as they came, the rest for scenes made from them.
        let assets = AssetCache::new(client.clone(), config.memory_bytes / 4);
        let cache = SceneCache::new(
            assets,
            config.memory_bytes / 4 * 3,
            config.threads,
            cache_sender,
        );
        let outbox = Outbox::new(client.clone(), worker, outbox_sender);
        Ok(LeaseLoop {
            config,
            client,
            pool,
            pool_news,
            cache,
            cache_events,
            outbox,
            outbox_events,
            identity,
            registered: None,
            ever_registered: false,
            registering: false,
            calls: JoinSet::new(),
            open: HashMap::new(),
            next_number: 0,
            failures: 0,
            not_before: Instant::now(),
            quiet: None,
            held: HeldLeases::default(),
            parked: Vec::new(),
            specs: HashMap::new(),
            reports: Reports::default(),
            pace: Pace::default(),
            drained: false,
            leaving: None,
        })
    }

    pub async fn run(mut self, shutdown: CancellationToken) -> Result<(), WorkerError> {
        loop {
            if self.may_leave() {
                self.say_goodbye().await;
                return Ok(());
            }
            let reports_due = self.pool_events();
            self.make_calls();
            let next_call = self.next_call();
            let deadline = self.leaving.unwrap_or_else(Instant::now);
            let stopped_since = self.leaving.is_some_and(|at| Instant::now() >= at);
            tokio::select! {
                () = shutdown.cancelled(), if self.leaving.is_none() => self.begin_leaving(),
                () = tokio::time::sleep_until(deadline), if self.leaving.is_some() && !stopped_since => {
                    tracing::info!("the grace time is over, giving back what is still in work");
                    self.held.stop_all();
                }
                () = self.pool_news.notified() => {}
                () = tokio::time::sleep_until(reports_due.unwrap_or_else(Instant::now)), if reports_due.is_some() => {}
                Some(event) = self.cache_events.recv() => self.prepared(event),
                Some(event) = self.outbox_events.recv() => {
                    self.outbox_event(event);
                    while let Ok(event) = self.outbox_events.try_recv() {
                        self.outbox_event(event);
                    }
                }
                Some(done) = self.calls.join_next(), if !self.calls.is_empty() => match done {
                    Ok(Call::Registered(result)) => self.registered(result)?,
                    Ok(Call::Synced { number, worker, want, reports, result }) => {
                        self.open.remove(&number);
                        self.synced(worker, want, reports, result)?;
                    }
                    Err(error) => tracing::error!(%error, "a call to the coordinator panicked"),
                },
                () = tokio::time::sleep_until(next_call), if self.calls.is_empty() => {}
                () = tokio::time::sleep(GOODBYE), if stopped_since => {}
            }
        }
    }
}
