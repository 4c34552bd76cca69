//! The leases that a worker holds and how far each has come.

use protocol::LeaseRef;
use std::collections::HashMap;
use std::sync::Arc;
use tracer::StopFlag;

/// How far a unit has come.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Phase {
    /// Its scene is being prepared.
    Preparing,
    /// In the pool, waiting or in work.
    InPool,
    /// Rendered; on its way to the coordinator.
    Delivering,
}

/// One lease.
#[derive(Debug)]
pub struct Held {
    pub phase: Phase,
    /// Camera samples of the unit.
    pub samples: u64,
    /// Stops the unit.
    pub stop: Arc<StopFlag>,
}

/// All leases.
#[derive(Debug, Default)]
pub struct HeldLeases {
    map: HashMap<LeaseRef, Held>,
}

impl HeldLeases {
    /// Adds one; false if it is held already.
    pub fn insert(&mut self, lease: LeaseRef, samples: u64) -> bool {
        let held = Held {
            phase: Phase::Preparing,
            samples,
            stop: Arc::new(StopFlag::default()),
        };
        match self.map.entry(lease) {
            std::collections::hash_map::Entry::Occupied(_) => false,
            std::collections::hash_map::Entry::Vacant(slot) => {
                slot.insert(held);
                true
            }
        }
    }
    /// One of them.
    pub fn get(&self, lease: &LeaseRef) -> Option<&Held> {
        self.map.get(lease)
    }
    /// One of them, to change.
    pub fn get_mut(&mut self, lease: &LeaseRef) -> Option<&mut Held> {
        self.map.get_mut(lease)
    }
    /// Forgets one.
    pub fn remove(&mut self, lease: &LeaseRef) -> Option<Held> {
        self.map.remove(lease)
    }
    /// Whether there are none.
    pub fn is_empty(&self) -> bool {
        self.map.is_empty()
    }
    /// All of them, in an order that does not depend on the map's.
    pub fn all(&self) -> Vec<LeaseRef> {
        let mut all: Vec<LeaseRef> = self.map.keys().cloned().collect();
        all.sort_by_key(|lease| (lease.job, lease.unit, lease.attempt));
        all
    }
    /// Those in one phase.
    pub fn in_phase(&self, phase: Phase) -> Vec<LeaseRef> {
        let mut found: Vec<LeaseRef> = self
            .map
            .iter()
            .filter(|(_, held)| held.phase == phase)
            .map(|(lease, _)| lease.clone())
            .collect();
        found.sort_by_key(|lease| (lease.job, lease.unit, lease.attempt));
        found
    }
    /// How many are in one phase.
    pub fn count(&self, phase: Phase) -> usize {
        self.map.values().filter(|held| held.phase == phase).count()
    }
    /// Camera samples of some of them.
    pub fn samples_of(&self, leases: &[LeaseRef]) -> u64 {
        leases
            .iter()
            .filter_map(|lease| self.map.get(lease))
            .map(|held| held.samples)
            .sum()
    }
    /// Stops everything in work.
    pub fn stop_all(&self) {
        self.map.values().for_each(|held| held.stop.stop());
    }
}
