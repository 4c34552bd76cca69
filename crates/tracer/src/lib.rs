//! The light-transport core: a prepared [`Scene`] and [`render_unit`], which turns one unit of work
//! into exact sums. Pure: no I/O but the [`::scene::AssetSource`] given to [`prepare`], no clock, no
//! OS randomness, no mutable globals. A sample is a function of (engine version, prepared scene,
//! seed, frame, pixel, sample index, dimension) and nothing else.

pub mod accel;
pub mod bsdf;
pub mod camera;
pub mod geometry;
mod guide;
mod hash;
pub mod integrator;
mod lanes;
pub mod light;
pub mod material;
pub mod math;
pub mod medium;
mod prepare;
pub mod ray;
mod render;
pub mod sampler;
pub mod sampling;
pub mod scene;
mod split;
pub mod texture;

pub use accel::SimdLevel;
pub use prepare::prepare;
pub use render::{Workspace, render_singly, render_unit};
pub use scene::Scene;

use std::sync::OnceLock;
use std::sync::atomic::{AtomicBool, Ordering};

/// Why a scene could not be prepared.
#[derive(Debug, thiserror::Error)]
pub enum PrepareError {
    /// A file of the scene could not be read.
    #[error(transparent)]
    Asset(#[from] ::scene::AssetError),
    /// A file of the scene does not decode.
    #[error("{path}: {reason}")]
    Decode {
        /// Path inside the scene.
        path: String,
        /// What the decoder said.
        reason: String,
    },
    /// The scene cannot be rendered.
    #[error("{0}")]
    Scene(String),
    /// Preparation was asked to stop.
    #[error("stopped")]
    Stopped,
}

/// Asks running work to end early; cheap to poll.
#[derive(Debug, Default)]
pub struct StopFlag(AtomicBool);

impl StopFlag {
    /// Ends the work within milliseconds.
    pub fn stop(&self) {
        self.0.store(true, Ordering::Relaxed);
    }
    /// Whether [`StopFlag::stop`] was called.
    pub fn is_stopped(&self) -> bool {
        self.0.load(Ordering::Relaxed)
    }
}

/// Settings that are not in the scene but decide its samples, and how many threads may prepare it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PrepareSettings {
    /// Seed of the sampler.
    pub seed: u64,
    /// Frame number.
    pub frame: u32,
    /// Upper bound on the radiance of one indirect path; biased.
    pub clamp_indirect: Option<f32>,
    /// Threads for the preparation; never changes a bit of the result.
    pub threads: usize,
    /// Memory that decoded pictures may take; those used longest ago are dropped and decoded again when
    /// they are needed, which never changes a bit.
    pub picture_bytes: u64,
}

/// The SIMD level in use: the best that the processor has, or the lower one that `BROLLY_SIMD` names
/// (`scalar`, `sse2`, `avx2`, `avx512`). It never changes a bit.
fn simd() -> SimdLevel {
    static LEVEL: OnceLock<SimdLevel> = OnceLock::new();
    *LEVEL.get_or_init(|| {
        let wanted = std::env::var("BROLLY_SIMD")
            .ok()
            .and_then(|name| SimdLevel::from_name(&name));
        wanted.map_or_else(SimdLevel::best, SimdLevel::available)
    })
}

/// Name of the SIMD level in use.
pub fn simd_level() -> &'static str {
    simd().name()
}
