//! The image plane: which samples a unit of work covers, the exact sums they are added into, the
//! film that units are merged into, its files, and the pictures made from it.
//!
//! Everything from the rounding of a sample to the merged film is integer addition, so that any
//! order, cut or grouping of the samples gives the same bits.
//!
//! ```
//! use film::{Film, LayerSample, Merged, Receipt, SampleBuffer, SampleRange, TileGrid, Unit};
//! use film::{ENGINE_VERSION, decode_unit, encode_unit};
//!
//! let grid = TileGrid { width: 2, height: 1 };
//! let unit = Unit { frame: 0, tile: 0, samples: SampleRange { begin: 0, end: 1 } };
//! // A worker adds samples and sends the sums ...
//! let mut sums = SampleBuffer::new(grid.tile(0), unit.samples);
//! let sample = LayerSample { beauty: [0.25, 0.5, 1.0], alpha: 1.0, ..LayerSample::EMPTY };
//! sums.add(1, 0, 0, &sample).unwrap();
//! let bytes = encode_unit(unit, &sums, &Default::default(), ENGINE_VERSION);
//! // ... and the coordinator merges them, once.
//! let mut film = Film::new(grid, 0);
//! let result = decode_unit(&bytes).unwrap();
//! let receipt = Receipt::of(&bytes, "worker-1");
//! assert_eq!(film.merge(&result, receipt.clone()), Ok(Merged::Added));
//! assert_eq!(film.merge(&result, receipt), Ok(Merged::AlreadyMerged));
//! ```
#![forbid(unsafe_code)]

mod blocks;
pub mod buffer;
pub mod checkpoint;
pub mod codec;
mod columns;
pub mod compare;
pub mod convergence;
pub mod counters;
pub mod error;
pub mod film;
pub mod fixed;
pub mod flip;
pub mod layer;
pub mod output;
mod packed;
mod pixels;
mod plane;
mod planes;
mod sum;
pub mod tile;
pub mod unit;
pub mod version;
mod wide;
mod wire;

pub use buffer::{LayerSample, PixelSums, Reject, Rejected, SampleBuffer};
pub use checkpoint::{CheckpointError, Manifest, TileEntry, decode_tile, encode_tile};
pub use codec::{CodecError, UnitResult, decode_unit, encode_unit};
pub use columns::Columns;
pub use compare::{Comparison, compare, difference_png};
pub use convergence::{Next, StopRule, next_unit};
pub use counters::Counters;
pub use error::{ErrorKind, PictureError};
pub use film::{Film, MergeError, Merged, Receipt};
pub use fixed::Square;
pub use layer::Layer;
pub use output::PictureInfo;
pub use output::exr::{Channels, encode_exr, write_exr};
pub use output::png::{Look, encode_png, shown, write_png};
pub use output::read::{Picture, read_picture};
pub use output::tonemap::ToneMap;
pub use packed::PackedUnit;
pub use tile::{MergedUnit, TileFilm};
pub use unit::{SampleRange, TILE_SIZE, Tile, TileGrid, Unit};
pub use version::{ENGINE_VERSION, EngineVersion};
