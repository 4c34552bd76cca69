//! Finished results on their way to the coordinator. They are kept through its outages: a result is
//! minutes of work, and delivering it late or twice does no harm.

use bytes::Bytes;
use client::{Client, ClientError, Delivery, RetryPolicy, UnitResult};
use protocol::LeaseRef;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use tokio::sync::mpsc::UnboundedSender;
use tokio::sync::{Notify, Semaphore, watch};
use tokio_util::task::TaskTracker;
use uuid::Uuid;

/// Deliveries that run at the same time: enough to hide the round trip, few enough that a
/// coordinator that comes back is not flooded.
const AT_ONCE: usize = 6;

/// What became of a result.
pub enum OutboxEvent {
    /// The coordinator has it, or does not want it any more.
    Settled(LeaseRef, Delivery),
    /// The coordinator refused it.
    Refused(LeaseRef, ClientError),
    /// The coordinator does not know this worker (it restarted).
    UnknownWorker(Uuid),
}

/// Results not yet settled.
pub struct Outbox {
    shared: Arc<Shared>,
    tasks: TaskTracker,
}

struct Shared {
    client: Client,
    /// Changes when the worker registers again.
    worker: watch::Receiver<Uuid>,
    permits: Semaphore,
    /// Wakes deliveries that wait for the coordinator to come back.
    again: Notify,
    bytes: AtomicU64,
    events: UnboundedSender<OutboxEvent>,
}

impl Outbox {
    /// An empty outbox; outcomes go to `events`.
    pub fn new(
        client: Client,
        worker: watch::Receiver<Uuid>,
        events: UnboundedSender<OutboxEvent>,
    ) -> Self {
        Outbox {
            shared: Arc::new(Shared {
                client,
                worker,
                permits: Semaphore::new(AT_ONCE),
                again: Notify::new(),
                bytes: AtomicU64::new(0),
                events,
            }),
            tasks: TaskTracker::new(),
        }
    }

    /// Bytes waiting.
    pub fn bytes(&self) -> u64 {
        self.shared.bytes.load(Ordering::Relaxed)
    }

    /// The coordinator answers again: deliver now what waits for the end of a pause.
    pub fn wake(&self) {
        self.shared.again.notify_waiters();
    }

    /// Takes charge of a result.
    pub fn push(&self, lease: LeaseRef, bytes: Bytes, blake3: String, cpu_seconds: f64) {
        let size = bytes.len() as u64;
        self.shared.bytes.fetch_add(size, Ordering::Relaxed);
        let shared = self.shared.clone();
        self.tasks.spawn(async move {
            let _turn = shared.permits.acquire().await; // never closed
            let result = UnitResult {
                worker: Uuid::nil(),
                lease,
                bytes,
                blake3,
                cpu_seconds,
            };
            let event = shared.deliver(result).await;
            shared.bytes.fetch_sub(size, Ordering::Relaxed);
            // Nobody listens only when the worker is gone.
            let _ = shared.events.send(event);
        });
    }
}

impl Shared {
    async fn deliver(&self, mut result: UnitResult) -> OutboxEvent {
        let mut failures = 0;
        loop {
            result.worker = *self.worker.borrow();
            let error = match self.client.deliver(&result).await {
                Ok(delivery) => return OutboxEvent::Settled(result.lease, delivery),
                Err(error) => error,
            };
            let unknown = error.is("no-worker");
            if unknown {
                let _ = self.events.send(OutboxEvent::UnknownWorker(result.worker));
            }
            // A token may be put right while the worker runs; everything else that is refused stays refused.
            let passes = error.retryable() || unknown || matches!(error.status(), Some(401 | 403));
            if !passes {
                return OutboxEvent::Refused(result.lease, error);
            }
            failures += 1;
            if failures == 1 {
                tracing::info!(unit.id = %result.lease.unit, %error, "keeping a result until the coordinator takes it");
            }
            let pause = RetryPolicy::FOREVER.backoff(failures, error.retry_after());
            tokio::select! {
                () = tokio::time::sleep(pause) => {}
                () = self.again.notified() => {}
            }
        }
    }
}
