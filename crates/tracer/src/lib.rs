//! The light-transport core: a prepared [`Scene`] and [`render_unit`], which turns one unit of work
//! into exact sums. Pure: no I/O but the [`scene::AssetSource`] given to [`prepare`], no clock, no
//! OS randomness, no globals. A sample is a function of (engine version, prepared scene, seed, frame,
//! pixel, sample index, dimension) and nothing else.

use film::{Counters, LayerSample, SampleBuffer, TileGrid, Unit};
use scene::{AssetSource, SceneDesc};
use std::sync::atomic::{AtomicBool, Ordering};

/// Why a scene could not be prepared.
#[derive(Debug, thiserror::Error)]
pub enum PrepareError {
    /// A file of the scene could not be read.
    #[error(transparent)]
    Asset(#[from] scene::AssetError),
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
}

/// A scene ready to be rendered: immutable and shared between threads.
pub struct Scene {
    grid: TileGrid,
}

impl Scene {
    /// How the picture is cut into tiles.
    pub fn grid(&self) -> TileGrid {
        self.grid
    }
    /// Memory held, for the worker's budget.
    pub fn memory_bytes(&self) -> usize {
        0
    }
}

/// Compiles a description into a [`Scene`].
pub fn prepare(
    desc: &SceneDesc,
    _assets: &dyn AssetSource,
    _settings: &PrepareSettings,
    _stop: &StopFlag,
) -> Result<Scene, PrepareError> {
    Ok(Scene {
        grid: TileGrid {
            width: desc.film.width,
            height: desc.film.height,
        },
    })
}

/// Renders one unit on the calling thread; `None` if it was stopped.
pub fn render_unit(
    scene: &Scene,
    unit: &Unit,
    stop: &StopFlag,
) -> Option<(SampleBuffer, Counters)> {
    let tile = scene.grid.tile(unit.tile);
    let mut buffer = SampleBuffer::new(tile, unit.samples);
    for y in 0..tile.height {
        for x in 0..tile.width {
            if stop.is_stopped() {
                return None;
            }
            for index in unit.samples.begin..unit.samples.end {
                let _ = buffer.add(
                    x,
                    y,
                    index,
                    &LayerSample {
                        alpha: 1.0,
                        ..LayerSample::EMPTY
                    },
                );
            }
        }
    }
    Some((
        buffer,
        Counters {
            samples: tile.pixels() as u64 * unit.samples.len() as u64,
            ..Counters::default()
        },
    ))
}

/// The SIMD level in use: `sse2`, `avx2`, `avx512` or `scalar`; `BROLLY_SIMD` forces a lower one.
pub fn simd_level() -> &'static str {
    "scalar"
}
