//! The image plane: which samples a unit of work covers, the exact sums they are added into, the
//! film that units are merged into, its files, and the pictures made from it.
//!
//! Everything from the rounding of a sample to the merged film is integer addition, so that any
//! order, cut or grouping of the samples gives the same bits.
#![forbid(unsafe_code)]

mod blocks;
pub mod buffer;
pub mod codec;
pub mod counters;
pub mod fixed;
mod planes;
pub mod unit;
pub mod version;
mod wide;

pub use buffer::{LayerSample, PixelSums, Reject, Rejected, SampleBuffer};
pub use codec::{CodecError, UnitResult, decode_unit, encode_unit};
pub use counters::Counters;
pub use fixed::Square;
pub use unit::{SampleRange, TILE_SIZE, Tile, TileGrid, Unit};
pub use version::{ENGINE_VERSION, EngineVersion};
