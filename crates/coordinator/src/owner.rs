//! The merging owner of a job: one thread that merges results into films as they come, decides
//! about tiles at their borders, and writes checkpoints. Integer sums need no order, so it takes
//! results as they arrive.

mod finish;
mod merge;
mod save;
mod stats;

pub use save::release;
pub use stats::stats_of;

use crate::farm::Farm;
use bytes::Bytes;
use film::{PackedUnit, Receipt};
use std::sync::{Arc, Weak, mpsc};
use std::time::{Duration, Instant};
use store::StoreError;
use tokio::sync::{OwnedSemaphorePermit, oneshot};
use uuid::Uuid;

/// Time after which a failed checkpoint is tried again.
const RETRY_AFTER: Duration = Duration::from_secs(2);

/// What an owner is asked to do, in this order.
pub enum Order {
    /// Merge a result that was accepted.
    Merge(Box<Arrived>),
    /// Clear tiles: their worker is not trusted.
    Clear {
        /// Of which frame.
        frame: u32,
        /// Which.
        tiles: Vec<u32>,
        /// Position of the log noted in the job's record.
        before: u64,
    },
    /// Write what changed.
    Checkpoint(oneshot::Sender<Result<(), StoreError>>),
    /// See whether the job is complete.
    Review,
    /// Forget everything and end.
    Stop,
}

/// A result on its way into the film.
pub struct Arrived {
    /// Checked, and still packed.
    pub result: PackedUnit<Bytes>,
    /// Of its bytes.
    pub receipt: Receipt,
    /// Names it among those in flight.
    pub token: u64,
    /// Room in memory, given back when it is merged.
    pub room: OwnedSemaphorePermit,
}

/// Handle of an owner's thread.
pub struct Owner {
    orders: mpsc::Sender<Order>,
}

impl Owner {
    /// Starts the thread of a job.
    pub fn start(farm: &Arc<Farm>, job: Uuid) -> Result<Owner, StoreError> {
        let (orders, queue) = mpsc::channel();
        let work = Work {
            farm: Arc::downgrade(farm),
            job,
            bytes: 0,
            looked: None,
        };
        let token = farm.owners.token();
        std::thread::Builder::new()
            .name("merge".into())
            .spawn(move || {
                work.run(&queue);
                drop(token);
            })
            .map_err(|e| StoreError::Unavailable {
                reason: format!("no thread for merging: {e}"),
            })?;
        Ok(Owner { orders })
    }

    /// Gives an order. One that has ended needs none.
    pub fn send(&self, order: Order) {
        let _ = self.orders.send(order);
    }
}

struct Work {
    farm: Weak<Farm>,
    job: Uuid,
    /// Merged since the last checkpoint.
    bytes: u64,
    looked: Option<Instant>,
}

impl Work {
    fn run(mut self, queue: &mpsc::Receiver<Order>) {
        let mut due: Option<Instant> = None;
        loop {
            let order = match due {
                None => queue
                    .recv()
                    .map_err(|_| mpsc::RecvTimeoutError::Disconnected),
                Some(due) => queue.recv_timeout(due.saturating_duration_since(Instant::now())),
            };
            let Some(farm) = self.farm.upgrade() else {
                return;
            };
            let every = farm.config.checkpoint_every;
            match order {
                Ok(Order::Merge(arrived)) => {
                    self.bytes += arrived.result.bytes().len() as u64;
                    self.merge(&farm, *arrived);
                    due = due.or_else(|| Some(Instant::now() + every));
                    if self.bytes >= farm.config.checkpoint_bytes {
                        due = Some(Instant::now());
                    }
                }
                Ok(Order::Clear {
                    frame,
                    tiles,
                    before,
                }) => {
                    self.clear(&farm, frame, &tiles, before);
                    due = Some(Instant::now());
                }
                Ok(Order::Checkpoint(answer)) => {
                    let result = self.checkpoint(&farm);
                    due = result.is_err().then(|| Instant::now() + RETRY_AFTER);
                    let _ = answer.send(result);
                }
                Ok(Order::Review) => self.review(&farm),
                Err(mpsc::RecvTimeoutError::Timeout) => {
                    due = self
                        .checkpoint(&farm)
                        .is_err()
                        .then(|| Instant::now() + RETRY_AFTER);
                }
                Ok(Order::Stop) | Err(mpsc::RecvTimeoutError::Disconnected) => return,
            }
        }
    }
}
