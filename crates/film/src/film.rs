//! The film of one frame: units come in, in any order and more than once; every sample counts once.

use crate::codec::UnitResult;
use crate::counters::Counters;
use crate::error::PictureError;
use crate::packed::PackedUnit;
use crate::tile::{MergedUnit, TileFilm};
use crate::unit::{SPP_MAX, SampleRange, Tile, TileGrid, Unit, pass_end};
use crate::version::{ENGINE_VERSION, EngineVersion};
use crate::wire::put_u32s;
use std::collections::BTreeSet;
use std::sync::Arc;

/// Where a result came from.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Receipt {
    /// BLAKE3 of the encoded bytes.
    pub digest: [u8; 32],
    /// Name of the worker.
    pub worker: String,
}

impl Receipt {
    /// For bytes as they arrived.
    pub fn of(bytes: &[u8], worker: impl Into<String>) -> Receipt {
        Receipt {
            digest: *blake3::hash(bytes).as_bytes(),
            worker: worker.into(),
        }
    }
}

/// What merging did. A duplicate is normal: leases expire, answers get lost.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Merged {
    /// The sums are in the film now.
    Added,
    /// They were already, from the same bytes.
    AlreadyMerged,
}

/// Why a result was not merged. The film is as it was.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum MergeError {
    /// One of two workers is broken: samples are functions, so bytes cannot differ.
    #[error("unit {unit} was merged with other bytes, from worker '{worker}'")]
    OtherBytes {
        /// What came.
        unit: Unit,
        /// Who rendered what is in the film.
        worker: Arc<str>,
    },
    /// Cut differently from what is merged.
    #[error("unit {unit} overlaps the merged samples {} to {}", .merged.begin, .merged.end)]
    Overlap {
        /// What came.
        unit: Unit,
        /// What is in the way.
        merged: SampleRange,
    },
    /// Samples or sums beyond what a unit can have.
    #[error("unit {unit} is out of range: {what}")]
    OutOfRange {
        /// What came.
        unit: Unit,
        /// What is wrong.
        what: &'static str,
    },
    /// Of another frame, or of a tile that the picture does not have.
    #[error("unit {unit} is not of frame {frame} with {tiles} tiles")]
    Foreign {
        /// What came.
        unit: Unit,
        /// Frame of the film.
        frame: u32,
        /// Tiles of the film.
        tiles: u32,
    },
    /// Rendered by another engine version.
    #[error("unit {unit} comes from engine version {found}, the film holds version {expected}")]
    EngineVersion {
        /// What came.
        unit: Unit,
        /// Of the film.
        expected: EngineVersion,
        /// Of the result.
        found: EngineVersion,
    },
    /// Its rectangle is not that of the tile.
    #[error("unit {unit} has another rectangle than its tile")]
    BadShape {
        /// What came.
        unit: Unit,
    },
}

/// Exact sums of one frame, tile by tile, and which units they are made of.
#[derive(Clone, Debug)]
pub struct Film {
    grid: TileGrid,
    frame: u32,
    engine: EngineVersion,
    tiles: Vec<TileFilm>,
    /// Names are shared: a ledger has many entries and a farm few workers.
    workers: BTreeSet<Arc<str>>,
}

impl Film {
    /// An empty film for results of this program's engine version.
    pub fn new(grid: TileGrid, frame: u32) -> Film {
        Film::for_engine(grid, frame, ENGINE_VERSION)
    }

    /// An empty film for results of another engine version: after an upgrade an unfinished job
    /// goes on with workers of the version that it began with.
    pub fn for_engine(grid: TileGrid, frame: u32, engine: EngineVersion) -> Film {
        let tiles = (0..grid.count())
            .map(|index| TileFilm::new(grid.tile(index)))
            .collect();
        Film {
            grid,
            frame,
            engine,
            tiles,
            workers: BTreeSet::new(),
        }
    }

    /// How the picture is cut.
    pub fn grid(&self) -> TileGrid {
        self.grid
    }
    /// Frame number.
    pub fn frame(&self) -> u32 {
        self.frame
    }
    /// Whose results it takes.
    pub fn engine(&self) -> EngineVersion {
        self.engine
    }
    /// All tiles in the order of the grid.
    pub fn tiles(&self) -> &[TileFilm] {
        &self.tiles
    }
    /// One tile.
    pub fn tile(&self, index: u32) -> Option<&TileFilm> {
        self.tiles.get(index as usize)
    }

    /// Adds a result, once. On an error the film is as it was.
    pub fn merge(&mut self, result: &UnitResult, receipt: Receipt) -> Result<Merged, MergeError> {
        let unit = result.unit;
        let whole = result.buffer.tile() == result.tile && result.buffer.samples() == unit.samples;
        let Some((at, merged)) = self.admit(unit, result.engine, result.tile, whole, receipt)?
        else {
            return Ok(Merged::AlreadyMerged);
        };
        self.tiles[unit.tile as usize]
            .add(at, merged, &result.buffer, &result.counters)
            .map_err(|_| MergeError::OutOfRange {
                unit,
                what: "sums that so many samples cannot have",
            })?;
        Ok(Merged::Added)
    }

    /// Adds a result that is still packed, once: the same as [`Film::merge`] of what it decodes to,
    /// in less time. On an error the film is as it was.
    pub fn merge_packed<B: AsRef<[u8]>>(
        &mut self,
        result: &PackedUnit<B>,
        receipt: Receipt,
    ) -> Result<Merged, MergeError> {
        let (unit, tile) = (result.unit(), result.tile());
        let Some((at, merged)) = self.admit(unit, result.engine(), tile, true, receipt)? else {
            return Ok(Merged::AlreadyMerged);
        };
        self.tiles[unit.tile as usize].add_packed(at, merged, result);
        Ok(Merged::Added)
    }

    /// Whether a unit belongs here and is not there yet: its place in the ledger and its entry. None if
    /// the same bytes are merged.
    fn admit(
        &mut self,
        unit: Unit,
        engine: EngineVersion,
        shape: Tile,
        whole: bool,
        receipt: Receipt,
    ) -> Result<Option<(usize, MergedUnit)>, MergeError> {
        let (frame, tiles) = (self.frame, self.grid.count());
        if unit.frame != frame || unit.tile >= tiles {
            return Err(MergeError::Foreign { unit, frame, tiles });
        }
        if engine != self.engine {
            return Err(MergeError::EngineVersion {
                unit,
                expected: self.engine,
                found: engine,
            });
        }
        let SampleRange { begin, end } = unit.samples;
        if begin >= end || end > SPP_MAX || end > pass_end(begin) {
            return Err(MergeError::OutOfRange {
                unit,
                what: "samples outside one pass",
            });
        }
        let tile = &self.tiles[unit.tile as usize];
        if !whole || shape != tile.tile() {
            return Err(MergeError::BadShape { unit });
        }
        let at = match tile.place(unit.samples) {
            Ok(at) => at,
            Err(merged) if merged.samples != unit.samples => {
                return Err(MergeError::Overlap {
                    unit,
                    merged: merged.samples,
                });
            }
            Err(merged) if merged.digest != receipt.digest => {
                return Err(MergeError::OtherBytes {
                    unit,
                    worker: merged.worker.clone(),
                });
            }
            Err(_) => return Ok(None),
        };
        let merged = MergedUnit {
            samples: unit.samples,
            digest: receipt.digest,
            worker: intern(&mut self.workers, &receipt.worker),
        };
        Ok(Some((at, merged)))
    }

    /// Empties one tile, so that it is rendered again.
    pub fn clear(&mut self, tile: u32) {
        if let Some(tile) = self.tiles.get_mut(tile as usize) {
            tile.clear();
        }
    }

    /// Empties every tile that a worker's results went into, and returns their indices.
    pub fn clear_worker(&mut self, worker: &str) -> Vec<u32> {
        let touched: Vec<u32> = (0..)
            .zip(&self.tiles)
            .filter(|(_, tile)| {
                tile.merged_units()
                    .iter()
                    .any(|unit| &*unit.worker == worker)
            })
            .map(|(index, _)| index)
            .collect();
        for &tile in &touched {
            self.clear(tile);
        }
        touched
    }

    /// Fewest and most samples of a pixel.
    pub fn spp_span(&self) -> (u32, u32) {
        let counts = || self.tiles.iter().map(TileFilm::samples);
        (counts().min().unwrap_or(0), counts().max().unwrap_or(0))
    }

    /// Samples of the whole picture.
    pub fn samples(&self) -> u64 {
        self.tiles
            .iter()
            .map(|tile| tile.samples() as u64 * tile.tile().pixels() as u64)
            .sum()
    }

    /// Samples of a pixel on average.
    pub fn spp_mean(&self) -> f64 {
        self.samples() as f64 / (self.grid.width as f64 * self.grid.height as f64)
    }

    /// What all merged units took.
    pub fn counters(&self) -> Counters {
        let mut sum = Counters::default();
        for tile in &self.tiles {
            sum += tile.counters();
        }
        sum
    }

    /// Error of the picture; None as long as a tile has too few samples to say.
    pub fn error(&self) -> Option<PictureError> {
        PictureError::of(self)
    }

    /// BLAKE3 of the merged state: engine, frame, size, sums and ranges. Independent of the order
    /// and grouping in which the samples arrived and of who rendered them.
    pub fn digest(&self) -> [u8; 32] {
        let mut bytes = b"brolly film 1".to_vec();
        put_u32s(
            &mut bytes,
            &[self.engine.0, self.frame, self.grid.width, self.grid.height],
        );
        for tile in &self.tiles {
            bytes.extend_from_slice(&tile.digest());
        }
        *blake3::hash(&bytes).as_bytes()
    }

    /// Memory in bytes.
    pub fn bytes(&self) -> usize {
        self.tiles
            .iter()
            .map(|tile| tile.bytes() + size_of::<TileFilm>())
            .sum()
    }

    /// Puts a restored tile in its place. Its worker names become shared ones.
    pub(crate) fn put_tile(&mut self, index: usize, tile: TileFilm) {
        self.tiles[index] = tile;
    }

    pub(crate) fn worker_names(&mut self) -> &mut BTreeSet<Arc<str>> {
        &mut self.workers
    }
}

/// The shared copy of a name.
pub(crate) fn intern(names: &mut BTreeSet<Arc<str>>, name: &str) -> Arc<str> {
    if let Some(known) = names.get(name) {
        return known.clone();
    }
    let new: Arc<str> = name.into();
    names.insert(new.clone());
    new
}
