//! The image plane: which samples a unit of work covers, the exact sums they are added into, the
//! film that units are merged into, its files, and the pictures made from it.
//!
//! Everything from the rounding of a sample to the merged film is integer addition, so that any
//! order, cut or grouping of the samples gives the same bits.
#![forbid(unsafe_code)]

pub mod buffer;
pub mod counters;
pub mod fixed;
pub mod unit;
pub mod version;

pub use buffer::{LayerSample, PixelSums, Reject, Rejected, SampleBuffer};
pub use counters::Counters;
pub use unit::{SampleRange, TILE_SIZE, Tile, TileGrid, Unit};
pub use version::{ENGINE_VERSION, EngineVersion};
