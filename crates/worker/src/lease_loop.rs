//! The one task that owns the worker's state: it registers, syncs, hands units to the pool and
//! results to the outbox, and leaves in order.

use crate::assets::AssetCache;
use crate::held::{HeldLeases, Phase};
use crate::outbox::{Outbox, OutboxEvent};
use crate::pace::{Load, Pace};
use crate::pool::{Finished, Pool, PoolEvent, Work};
use crate::scene_cache::{Prepared, SceneCache, SceneKey};
use crate::{WorkerConfig, WorkerError};
use client::{Client, ClientError, Delivery, RetryPolicy};
use film::TileGrid;
use protocol::{
    JobSpec, Lease, LeaseFailure, LeaseRef, RegisterRequest, RegisterResponse, SyncRequest,
    SyncResponse,
};
use std::collections::{HashMap, HashSet};
use std::sync::Arc;
use std::time::Duration;
use tokio::sync::mpsc::{self, UnboundedReceiver};
use tokio::sync::watch;
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
        want: u32,
        reports: Reports,
        result: Result<SyncResponse, ClientError>,
    },
}

/// Until when not to ask for `want` leases again.
#[derive(Clone, Copy)]
struct Quiet {
    until: Instant,
    want: u32,
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
    pool_events: UnboundedReceiver<PoolEvent>,
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
    open: HashMap<u64, u32>,
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
    unit_samples: u64,
    /// The coordinator wants no more work done here.
    drained: bool,
    /// When units in work are given up; set once we are told to leave.
    leaving: Option<Instant>,
}

impl LeaseLoop {
    pub fn new(config: WorkerConfig) -> Result<Self, WorkerError> {
        let client =
            Client::new(&config.url, config.token.as_deref())?.with_retry(RetryPolicy::PATIENT);
        let (pool_sender, pool_events) = mpsc::unbounded_channel();
        let (cache_sender, cache_events) = mpsc::unbounded_channel();
        let (outbox_sender, outbox_events) = mpsc::unbounded_channel();
        let (identity, worker) = watch::channel(Uuid::nil());
        let pool = Pool::new(config.threads, config.engine_version, pool_sender)
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
            pool_events,
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
            unit_samples: 1,
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
                Some(event) = self.pool_events.recv() => {
                    self.pool_event(event);
                    while let Ok(event) = self.pool_events.try_recv() {
                        self.pool_event(event);
                    }
                }
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

    // -- talking to the coordinator --

    /// When there may be a call again.
    fn next_call(&self) -> Instant {
        let quiet = self.quiet.map_or(self.not_before, |quiet| quiet.until);
        self.not_before.max(quiet)
    }

    fn make_calls(&mut self) {
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
        let asking = self.open.values().any(|&open| open > 0);
        if self.open.len() >= CALLS_MAX {
            return;
        }
        if !self.reports.is_empty() {
            self.sync(worker, 0, 0);
        }
        let quiet = self
            .quiet
            .is_some_and(|quiet| Instant::now() < quiet.until && (quiet.want > 0 || want == 0));
        if !quiet && (self.open.is_empty() || (want > 0 && !asking)) {
            self.sync(worker, want, heartbeat_ms);
        }
    }

    fn register(&mut self) {
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

    fn sync(&mut self, worker: Uuid, want: u32, wait_ms: u64) {
        let reports = std::mem::take(&mut self.reports);
        let request = SyncRequest {
            worker,
            held: self.held.all(),
            given_back: reports.given_back.clone(),
            failed: reports.failed.clone(),
            want,
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

    fn registered(
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

    fn synced(
        &mut self,
        worker: Uuid,
        want: u32,
        reports: Reports,
        result: Result<SyncResponse, ClientError>,
    ) -> Result<(), WorkerError> {
        match result {
            Ok(response) => {
                self.reachable();
                // Someone who must not work is answered at once, every time.
                let pause = if response.drain { 10 * QUIET } else { QUIET };
                self.quiet = response.leases.is_empty().then(|| Quiet {
                    until: Instant::now() + pause,
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
    fn forgotten(&mut self, worker: Uuid) {
        if self.registered.as_ref().is_some_and(|r| r.worker == worker) {
            tracing::info!(worker.id = %worker, "not known to the coordinator any more, registering again");
            self.registered = None;
        }
    }

    fn reachable(&mut self) {
        if self.failures > 0 {
            tracing::info!("the coordinator answers again");
            self.outbox.wake();
        }
        self.failures = 0;
        self.not_before = Instant::now();
    }

    fn unreachable(&mut self, error: &ClientError) {
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

    // -- leases --

    fn load(&self) -> Load {
        let waiting = self.pool.waiting();
        let parked: u64 = self
            .parked
            .iter()
            .filter_map(|p| Some(self.held.get(&p.lease)?.samples))
            .sum();
        Load {
            threads: self.config.threads.max(1),
            running: self.held.count(Phase::InPool).saturating_sub(waiting.len()),
            waiting: waiting.len() + self.parked.len(),
            waiting_samples: self.held.samples_of(&waiting) + parked,
            unit_samples: self.unit_samples,
        }
    }

    fn want(&self) -> u32 {
        let full = self.outbox.bytes() > self.config.outbox_bytes;
        if full || self.drained || self.leaving.is_some() {
            return 0;
        }
        self.pace.want(&self.load())
    }

    fn take_response(&mut self, response: SyncResponse) {
        let SyncResponse {
            leases,
            specs,
            cancelled,
            give_back_unstarted,
            drain,
        } = response;
        if drain != self.drained {
            self.drained = drain;
            tracing::info!(drain, "the coordinator changed whether it gives us work");
        }
        if self.specs.len() + specs.len() > SPECS_MAX {
            let used: HashSet<Uuid> = self.held.all().iter().map(|lease| lease.job).collect();
            self.specs.retain(|job, _| used.contains(job));
        }
        self.specs
            .extend(specs.into_iter().map(|(job, spec)| (job, Arc::new(spec))));
        self.cancel(cancelled);
        if give_back_unstarted {
            self.give_back_unstarted();
        }
        let mut ready = Vec::new();
        for lease in leases {
            if self.leaving.is_some() {
                self.reports.given_back.push(lease.at);
            } else if let Some(work) = self.take_lease(lease) {
                ready.push(work);
            }
        }
        self.pool.push(ready);
    }

    /// Starts on a lease; returns it if it can be rendered at once.
    fn take_lease(&mut self, lease: Lease) -> Option<Work> {
        let Lease {
            at,
            spec_digest,
            engine_version,
            ..
        } = lease;
        if engine_version != self.config.engine_version {
            self.refuse(
                at,
                format!("the unit needs engine version {engine_version}"),
                true,
            );
            return None;
        }
        let Some(spec) = self.specs.get(&at.job).cloned() else {
            // Forgotten here but known there as sent: registering again makes the coordinator send it.
            self.reports.given_back.push(at);
            self.registered = None;
            return None;
        };
        let [width, height] = spec.size;
        let grid = TileGrid { width, height };
        if at.unit.tile >= grid.count() || at.unit.samples.is_empty() {
            self.refuse(at, "the unit is not part of the picture".into(), false);
            return None;
        }
        let samples = grid.tile(at.unit.tile).pixels() as u64 * u64::from(at.unit.samples.len());
        if !self.held.insert(at.clone(), samples) {
            return None; // the answer to a repeated call
        }
        self.unit_samples = samples;
        let key = SceneKey {
            spec_digest,
            frame: at.unit.frame,
        };
        match self.cache.get(&key, at.job, &spec) {
            Some(scene) => self.work(at, scene),
            None => {
                self.parked.push(Parked { lease: at, key });
                None
            }
        }
    }

    fn work(&mut self, lease: LeaseRef, scene: Arc<tracer::Scene>) -> Option<Work> {
        let held = self.held.get_mut(&lease)?;
        held.phase = Phase::InPool;
        let stop = held.stop.clone();
        Some(Work { lease, scene, stop })
    }

    fn refuse(&mut self, lease: LeaseRef, reason: String, machine_error: bool) {
        tracing::warn!(unit.id = %lease.unit, job.id = %lease.job, reason, "cannot render a unit");
        self.held.remove(&lease);
        self.reports.failed.push(LeaseFailure {
            lease,
            reason,
            scene_error: false,
            machine_error,
        });
    }

    fn cancel(&mut self, cancelled: Vec<LeaseRef>) {
        if cancelled.is_empty() {
            return;
        }
        let cancelled: HashSet<LeaseRef> = cancelled.into_iter().collect();
        for lease in self.pool.remove_waiting(&cancelled) {
            self.held.remove(&lease);
        }
        self.unpark(|lease| cancelled.contains(lease));
        for lease in &cancelled {
            // What is rendered already is delivered all the same: it is work saved if the job still wants it.
            if let Some(held) = self.held.get_mut(lease) {
                held.stop.stop();
            }
        }
    }

    /// Removes parked units and stops preparations that nobody waits for any more.
    fn unpark(&mut self, which: impl Fn(&LeaseRef) -> bool) -> Vec<LeaseRef> {
        let (gone, kept): (Vec<_>, Vec<_>) = std::mem::take(&mut self.parked)
            .into_iter()
            .partition(|parked| which(&parked.lease));
        self.parked = kept;
        for parked in &gone {
            self.held.remove(&parked.lease);
            if !self.parked.iter().any(|other| other.key == parked.key) {
                self.cache.abandon(&parked.key);
            }
        }
        gone.into_iter().map(|parked| parked.lease).collect()
    }

    fn give_back_unstarted(&mut self) {
        let mut back = self.pool.take_waiting();
        for lease in &back {
            self.held.remove(lease);
        }
        back.extend(self.unpark(|_| true));
        if !back.is_empty() {
            tracing::debug!(units = back.len(), "giving back units that have not begun");
        }
        self.reports.given_back.extend(back);
    }

    // -- what the others report --

    fn prepared(&mut self, event: Prepared) {
        let Prepared {
            key,
            job,
            seconds,
            result,
        } = event;
        self.cache.prepared(&key, &result);
        let (mine, others): (Vec<_>, Vec<_>) = std::mem::take(&mut self.parked)
            .into_iter()
            .partition(|parked| parked.key == key);
        self.parked = others;
        match result {
            Ok(scene) => {
                tracing::info!(job.id = %job, frame = key.frame, seconds, memory_bytes = scene.memory_bytes() as u64, "prepared a scene");
                self.reports.prepared.push((job, seconds));
                let works: Vec<Work> = mine
                    .into_iter()
                    .filter_map(|parked| self.work(parked.lease, scene.clone()))
                    .collect();
                self.pool.push(works);
            }
            Err(failure) if failure.stopped => {
                // Abandoned, but wanted again before it ended.
                for parked in mine {
                    self.held.remove(&parked.lease);
                    self.reports.given_back.push(parked.lease);
                }
            }
            Err(failure) => {
                tracing::warn!(job.id = %job, frame = key.frame, reason = failure.reason, "cannot prepare a scene");
                for parked in mine {
                    self.held.remove(&parked.lease);
                    self.reports.failed.push(LeaseFailure {
                        lease: parked.lease,
                        reason: failure.reason.clone(),
                        scene_error: failure.scene_error,
                        machine_error: failure.machine_error,
                    });
                }
            }
        }
    }

    fn pool_event(&mut self, event: PoolEvent) {
        match event {
            PoolEvent::Finished(finished) => {
                let Finished {
                    lease,
                    bytes,
                    blake3,
                    samples,
                    wall_seconds,
                    cpu_seconds,
                } = finished;
                tracing::debug!(job.id = %lease.job, unit.id = %lease.unit, lease.attempt = lease.attempt, seconds = wall_seconds, bytes = bytes.len(), "rendered a unit");
                self.pace.observe(samples, wall_seconds);
                if let Some(held) = self.held.get_mut(&lease) {
                    held.phase = Phase::Delivering;
                }
                self.outbox.push(lease, bytes, blake3, cpu_seconds);
            }
            PoolEvent::Stopped(lease) => {
                self.held.remove(&lease);
                if self.leaving.is_some() {
                    self.reports.given_back.push(lease);
                }
            }
            PoolEvent::Failed { lease, reason } => self.refuse(lease, reason, false),
        }
    }

    fn outbox_event(&mut self, event: OutboxEvent) {
        match event {
            OutboxEvent::Settled(lease, delivery) => {
                self.held.remove(&lease);
                if delivery == Delivery::OtherBytes {
                    tracing::error!(job.id = %lease.job, unit.id = %lease.unit, "another worker rendered other bytes for a unit: one of the two machines is wrong");
                }
            }
            OutboxEvent::Refused(lease, error) => {
                let reason = format!("the result was refused: {error}");
                // A job that is gone is no failure.
                if error.status() == Some(404) {
                    self.held.remove(&lease);
                    tracing::info!(job.id = %lease.job, unit.id = %lease.unit, reason);
                } else {
                    self.refuse(lease, reason, true);
                }
            }
            OutboxEvent::UnknownWorker(worker) => self.forgotten(worker),
        }
    }

    // -- leaving --

    fn begin_leaving(&mut self) {
        tracing::info!(
            in_work = self.held.count(Phase::InPool),
            grace_seconds = self.config.grace.as_secs_f64(),
            "leaving: finishing what is in work"
        );
        self.leaving = Some(Instant::now() + self.config.grace);
        self.give_back_unstarted();
    }

    /// Nothing is left to finish, or the time for it is over.
    fn may_leave(&self) -> bool {
        let Some(deadline) = self.leaving else {
            return false;
        };
        let settled = self.held.is_empty() && self.outbox.bytes() == 0;
        settled || Instant::now() > deadline + GOODBYE
    }

    async fn say_goodbye(&mut self) {
        let lost = self.held.in_phase(Phase::Delivering).len();
        if lost > 0 {
            tracing::warn!(
                results = lost,
                "leaving with results that the coordinator did not take: they will be rendered again"
            );
        }
        let Some(registered) = self.registered.clone() else {
            return;
        };
        // Twice, because an open call may still have brought leases.
        for last in [false, true] {
            if last && self.open.values().all(|&want| want == 0) {
                break;
            }
            let request = SyncRequest {
                worker: registered.worker,
                held: Vec::new(),
                given_back: std::mem::take(&mut self.reports.given_back),
                failed: std::mem::take(&mut self.reports.failed),
                want: 0,
                wait_ms: 0,
                draining: true,
                prepared: std::mem::take(&mut self.reports.prepared),
            };
            match tokio::time::timeout(GOODBYE, self.client.sync(&request)).await {
                Ok(Ok(_)) => tracing::info!("left"),
                _ => {
                    tracing::info!("left without the coordinator knowing");
                    return;
                }
            }
            if !last {
                self.collect_late_leases().await;
            }
        }
    }

    /// Takes the answers that are on their way and gives back what they bring.
    async fn collect_late_leases(&mut self) {
        // A call that is not answered by now is still waiting for work, and dropping it ends that.
        let deadline = Instant::now() + 4 * QUIET;
        while self.open.values().any(|&want| want > 0) {
            match tokio::time::timeout_at(deadline, self.calls.join_next()).await {
                Ok(Some(Ok(Call::Synced { number, result, .. }))) => {
                    self.open.remove(&number);
                    let leases = result.map(|response| response.leases).unwrap_or_default();
                    self.reports
                        .given_back
                        .extend(leases.into_iter().map(|lease| lease.at));
                }
                Ok(Some(_)) => {}
                Ok(None) | Err(_) => return,
            }
        }
    }
}
