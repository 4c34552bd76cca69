//! What a renderer counts while it works.

use serde::{Deserialize, Serialize};

/// Work done for one unit, additive.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Counters {
    /// Camera samples.
    pub samples: u64,
    /// Closest-hit rays.
    pub rays: u64,
    /// Occlusion rays.
    pub shadow_rays: u64,
    /// Scattering events.
    pub bounces: u64,
    /// Samples that were rejected (see [`crate::Reject`]).
    pub rejected: u64,
}

impl std::ops::AddAssign for Counters {
    fn add_assign(&mut self, other: Counters) {
        self.samples += other.samples;
        self.rays += other.rays;
        self.shadow_rays += other.shadow_rays;
        self.bounces += other.bounces;
        self.rejected += other.rejected;
    }
}
