//! The number that is raised whenever bits move.

use serde::{Deserialize, Serialize};

/// Identifies everything that decides the bits of a sample: importers, preparation, sampling,
/// shading, rounding. Two programs with the same engine version render the same bits.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
#[serde(transparent)]
pub struct EngineVersion(pub u32);

/// The engine version of this program.
pub const ENGINE_VERSION: EngineVersion = EngineVersion(7);

impl std::fmt::Display for EngineVersion {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        self.0.fmt(f)
    }
}
