//! Events: numbered, broadcast, never waited for. Who reads too slowly gets a snapshot instead.

use protocol::Event;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use tokio::sync::broadcast;
use uuid::Uuid;

/// Events that a slow reader may be behind.
const BEHIND_MAX: usize = 1024;

/// An event and its number.
#[derive(Clone, Debug)]
pub struct Numbered {
    /// Rises.
    pub id: u64,
    /// What happened.
    pub event: Arc<Event>,
}

impl Numbered {
    /// Which job it is about.
    pub fn job(&self) -> Uuid {
        match &*self.event {
            Event::Job { job } => job.id,
            Event::Image { job, .. } | Event::Deleted { job, .. } => *job,
        }
    }
}

/// Where events go.
pub struct Events {
    next: AtomicU64,
    sender: broadcast::Sender<Numbered>,
}

impl Default for Events {
    fn default() -> Self {
        Events {
            next: AtomicU64::new(1),
            sender: broadcast::Sender::new(BEHIND_MAX),
        }
    }
}

impl Events {
    /// Tells everyone.
    pub fn send(&self, event: Event) {
        let id = self.next.fetch_add(1, Ordering::Relaxed);
        // No reader is no error.
        let _ = self.sender.send(Numbered {
            id,
            event: Arc::new(event),
        });
    }

    /// From now on.
    pub fn subscribe(&self) -> broadcast::Receiver<Numbered> {
        self.sender.subscribe()
    }

    /// Number for a snapshot: of the last event before it.
    pub fn last(&self) -> u64 {
        self.next.load(Ordering::Relaxed) - 1
    }

    /// How many listen.
    pub fn readers(&self) -> usize {
        self.sender.receiver_count()
    }

    /// Whether anybody listens.
    pub fn is_heard(&self) -> bool {
        self.sender.receiver_count() > 0
    }
}
