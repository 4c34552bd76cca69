//! The threads that render: one unit each at a time, from one queue. Rendering, encoding and hashing
//! happen here, so that the async side only moves bytes.

use crate::cpu_time::Stopwatch;
use crate::gathered::Gathered;
use bytes::Bytes;
use film::EngineVersion;
use protocol::LeaseRef;
use std::collections::{HashSet, VecDeque};
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::time::Instant;
use tokio::sync::Notify;
use tracer::{Scene, StopFlag, Workspace};

/// A unit that can start at once.
pub struct Work {
    pub lease: LeaseRef,
    pub scene: Arc<Scene>,
    pub stop: Arc<StopFlag>,
}

/// A rendered unit.
#[derive(Debug)]
pub struct Finished {
    pub lease: LeaseRef,
    pub bytes: Bytes,
    pub blake3: String,
    pub samples: u64,
    pub wall_seconds: f64,
    pub cpu_seconds: f64,
}

/// What the threads report.
#[derive(Debug)]
pub enum PoolEvent {
    Finished(Finished),
    /// Its flag was raised; nothing came of it.
    Stopped(LeaseRef),
    Failed {
        lease: LeaseRef,
        reason: String,
    },
}

/// Runs units until it is dropped.
pub struct Pool {
    shared: Arc<Shared>,
}

struct Shared {
    state: Mutex<State>,
    more: Condvar,
    /// Wakes the side that reads the reports.
    news: Arc<Notify>,
}

#[derive(Default)]
struct State {
    queue: VecDeque<Work>,
    reports: Gathered,
    closed: bool,
}

impl Shared {
    /// No code that can panic runs under this lock, so a poisoned state is still a good one.
    fn lock(&self) -> MutexGuard<'_, State> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl Pool {
    /// Starts the threads; `news` is told when to look at [`Pool::reports`].
    pub fn new(threads: usize, engine: EngineVersion, news: Arc<Notify>) -> std::io::Result<Self> {
        let pool = Pool {
            shared: Arc::new(Shared {
                state: Mutex::default(),
                more: Condvar::new(),
                news,
            }),
        };
        for index in 0..threads.max(1) {
            let shared = pool.shared.clone();
            std::thread::Builder::new()
                .name(format!("render-{index}"))
                .stack_size(8 << 20)
                .spawn(move || serve(&shared, engine))?;
        }
        Ok(pool)
    }

    /// What the threads have reported, if it is due by `now`; else when it will be, if there is anything.
    pub fn reports(&self, now: Instant) -> Result<Vec<PoolEvent>, Option<Instant>> {
        self.shared.lock().reports.take(now)
    }

    /// Adds units behind those that wait.
    pub fn push(&self, works: impl IntoIterator<Item = Work>) {
        let mut state = self.shared.lock();
        state.queue.extend(works);
        drop(state);
        self.shared.more.notify_all();
    }

    /// Units that have not begun.
    pub fn waiting(&self) -> Vec<LeaseRef> {
        self.shared
            .lock()
            .queue
            .iter()
            .map(|w| w.lease.clone())
            .collect()
    }

    /// Takes back all units that have not begun.
    pub fn take_waiting(&self) -> Vec<LeaseRef> {
        self.shared
            .lock()
            .queue
            .drain(..)
            .map(|w| w.lease)
            .collect()
    }

    /// Takes back those of `leases` that have not begun.
    pub fn remove_waiting(&self, leases: &HashSet<LeaseRef>) -> Vec<LeaseRef> {
        let mut removed = Vec::new();
        self.shared.lock().queue.retain(|work| {
            let keep = !leases.contains(&work.lease);
            if !keep {
                removed.push(work.lease.clone());
            }
            keep
        });
        removed
    }
}

impl Drop for Pool {
    fn drop(&mut self) {
        let mut state = self.shared.lock();
        state.closed = true;
        state.queue.clear();
        drop(state);
        self.shared.more.notify_all();
    }
}

fn serve(shared: &Shared, engine: EngineVersion) {
    let mut workspace = Workspace::default();
    loop {
        let mut state = shared.lock();
        let work = loop {
            if state.closed {
                return;
            }
            if let Some(work) = state.queue.pop_front() {
                break work;
            }
            state = shared
                .more
                .wait(state)
                .unwrap_or_else(PoisonError::into_inner);
        };
        drop(state);
        let lease = work.lease.clone();
        // A bug in the tracer costs this attempt, not the worker and its other units.
        let event = catch_unwind(AssertUnwindSafe(|| render(work, engine, &mut workspace)))
            .unwrap_or_else(|panic| {
                workspace = Workspace::default();
                PoolEvent::Failed {
                    lease,
                    reason: format!("the renderer panicked: {}", panic_text(&*panic)),
                }
            });
        let mut state = shared.lock();
        let runs_dry = state.queue.is_empty();
        let tell = state.reports.add(event, Instant::now(), runs_dry);
        drop(state);
        if tell {
            shared.news.notify_one();
        }
    }
}

fn render(work: Work, engine: EngineVersion, workspace: &mut Workspace) -> PoolEvent {
    let Work { lease, scene, stop } = work;
    if stop.is_stopped() {
        return PoolEvent::Stopped(lease);
    }
    let watch = Stopwatch::start();
    let Some((buffer, counters)) = workspace.render(&scene, &lease.unit, &stop) else {
        return PoolEvent::Stopped(lease);
    };
    let bytes = film::codec::encode_unit(lease.unit, buffer, &counters, engine);
    let blake3 = blake3::hash(&bytes).to_hex().to_string();
    PoolEvent::Finished(Finished {
        samples: counters.samples,
        wall_seconds: watch.wall_seconds(),
        cpu_seconds: watch.cpu_seconds(),
        bytes: bytes.into(),
        blake3,
        lease,
    })
}

/// What a panic said.
pub fn panic_text(panic: &(dyn std::any::Any + Send)) -> &str {
    panic
        .downcast_ref::<&str>()
        .copied()
        .or_else(|| panic.downcast_ref::<String>().map(String::as_str))
        .unwrap_or("no message")
}
