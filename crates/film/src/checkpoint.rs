//! A film on disk: one immutable blob a tile, named by its BLAKE3, and a manifest of the names.
//! Only tiles that changed since the last manifest are written again.
//!
//! ```text
//! tile: magic "BRLT"  version u16  engine u32  frame u32  x u32  y u32  width u16  height u16
//!       counters 5 x u64  rejected u64  kept u8  kept x (x u16, y u16, index u32, reason u8)
//!       workers u32  workers x (length u16, UTF-8)
//!       units u32  units x (begin u32, end u32, worker u32, digest 32)
//!       blocks as in `codec.rs`  crc32 u32
//! manifest: magic "BRLM"  version u16  engine u32  frame u32  width u32  height u32
//!       log position u64  tiles u32  tiles x (tile version u64, digest 32 unless that is 0)  crc32 u32
//! ```

use crate::blocks::{BLOCK, Scratch};
use crate::codec::CodecError;
use crate::film::{Film, intern};
use crate::plane::Plane;
use crate::planes::{self, PLANES};
use crate::tile::{MergedUnit, TileFilm};
use crate::unit::{PIXELS_MAX, SIDE_MAX, SPP_MAX, SampleRange, Tile, TileGrid, pass_end};
use crate::version::EngineVersion;
use crate::wire::{self, Reader, put_u32s};
use std::collections::BTreeSet;
use std::sync::Arc;

const TILE_MAGIC: [u8; 4] = *b"BRLT";
const MANIFEST_MAGIC: [u8; 4] = *b"BRLM";
/// Version of both formats.
pub const CHECKPOINT_FORMAT: u16 = 1;

/// Why a checkpoint cannot be read.
#[derive(Debug, thiserror::Error)]
pub enum CheckpointError {
    /// Another kind of file.
    #[error("not a {0}")]
    NotOne(&'static str),
    /// A format that this program does not read.
    #[error("{what} format {found} is not known (this program reads {CHECKPOINT_FORMAT})")]
    Version {
        /// Which file.
        what: &'static str,
        /// Its version.
        found: u16,
    },
    /// Its bytes are wrong.
    #[error("the {what} cannot be read")]
    Bytes {
        /// Which file.
        what: &'static str,
        /// What is wrong with them.
        #[source]
        source: CodecError,
    },
    /// The blob is not the one that the manifest names.
    #[error("the blob of tile {tile} has another digest than its name")]
    Digest {
        /// Index of the tile.
        tile: u32,
    },
    /// A tile of another picture.
    #[error("the blob of tile {tile} is of another frame, engine version or rectangle")]
    Foreign {
        /// Index of the tile.
        tile: u32,
    },
    /// The blob could not be had.
    #[error("the blob of tile {tile} could not be fetched")]
    Fetch {
        /// Index of the tile.
        tile: u32,
        /// Why.
        #[source]
        source: Box<dyn std::error::Error + Send + Sync>,
    },
}

/// The blob of a tile.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct TileEntry {
    /// BLAKE3 of the blob.
    pub digest: [u8; 32],
    /// [`TileFilm::version`] that it holds.
    pub version: u64,
}

/// What a checkpoint of a frame consists of.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Manifest {
    /// Engine version of the results.
    pub engine: EngineVersion,
    /// Frame number.
    pub frame: u32,
    /// How the picture is cut.
    pub grid: TileGrid,
    /// Results in the log before this position are merged.
    pub log_pos: u64,
    /// A blob for each tile that ever changed.
    pub tiles: Vec<Option<TileEntry>>,
}

impl Manifest {
    /// As bytes.
    pub fn encode(&self) -> Vec<u8> {
        let mut out = MANIFEST_MAGIC.to_vec();
        out.extend_from_slice(&CHECKPOINT_FORMAT.to_le_bytes());
        let TileGrid { width, height } = self.grid;
        put_u32s(&mut out, &[self.engine.0, self.frame, width, height]);
        out.extend_from_slice(&self.log_pos.to_le_bytes());
        put_u32s(&mut out, &[self.tiles.len() as u32]);
        for entry in &self.tiles {
            let version = entry.map_or(0, |entry| entry.version);
            out.extend_from_slice(&version.to_le_bytes());
            if let Some(entry) = entry {
                out.extend_from_slice(&entry.digest);
            }
        }
        seal(out)
    }

    /// Back from bytes.
    pub fn decode(bytes: &[u8]) -> Result<Manifest, CheckpointError> {
        const WHAT: &str = "checkpoint manifest";
        let mut input = open(bytes, MANIFEST_MAGIC, WHAT)?;
        Manifest::fields(&mut input).map_err(|source| CheckpointError::Bytes { what: WHAT, source })
    }

    fn fields(input: &mut Reader) -> Result<Manifest, CodecError> {
        let (engine, frame) = (EngineVersion(input.u32()?), input.u32()?);
        let grid = TileGrid {
            width: input.u32()?,
            height: input.u32()?,
        };
        let sides = [grid.width, grid.height]
            .iter()
            .all(|side| (1..=SIDE_MAX).contains(side));
        if !sides || grid.width as u64 * grid.height as u64 > PIXELS_MAX {
            return Err(CodecError::Malformed("size"));
        }
        let (log_pos, count) = (input.u64()?, input.u32()?);
        if count != grid.count() {
            return Err(CodecError::Malformed("number of tiles"));
        }
        let mut tiles = Vec::new();
        for _ in 0..count {
            tiles.push(match input.u64()? {
                0 => None,
                version => Some(TileEntry {
                    digest: input.bytes()?,
                    version,
                }),
            });
        }
        end(input)?;
        Ok(Manifest {
            engine,
            frame,
            grid,
            log_pos,
            tiles,
        })
    }

    /// Name for the manifest: BLAKE3 of its bytes.
    pub fn digest(&self) -> [u8; 32] {
        *blake3::hash(&self.encode()).as_bytes()
    }
}

fn seal(mut out: Vec<u8>) -> Vec<u8> {
    let crc = crc32fast::hash(&out);
    out.extend_from_slice(&crc.to_le_bytes());
    out
}

/// Checks magic, version and checksum, and leaves the fields.
fn open<'a>(
    bytes: &'a [u8],
    magic: [u8; 4],
    what: &'static str,
) -> Result<Reader<'a>, CheckpointError> {
    let bad = |source| CheckpointError::Bytes { what, source };
    if !bytes.starts_with(&magic) {
        return Err(CheckpointError::NotOne(what));
    }
    let found = Reader(&bytes[4..]).u16().map_err(bad)?;
    if found != CHECKPOINT_FORMAT {
        return Err(CheckpointError::Version { what, found });
    }
    let body = wire::check_crc(bytes).map_err(bad)?;
    body.get(6..)
        .map(Reader)
        .ok_or(bad(CodecError::Malformed("length")))
}

fn end(input: &Reader) -> Result<(), CodecError> {
    if input.0.is_empty() {
        Ok(())
    } else {
        Err(CodecError::Malformed("end"))
    }
}

/// The blob of a tile. The same state, ledger included, is the same bytes.
pub fn encode_tile(tile: &TileFilm, frame: u32, engine: EngineVersion) -> Vec<u8> {
    let Tile {
        x,
        y,
        width,
        height,
    } = tile.tile();
    let mut out = Vec::with_capacity(256 + tile.bytes());
    out.extend_from_slice(&TILE_MAGIC);
    out.extend_from_slice(&CHECKPOINT_FORMAT.to_le_bytes());
    put_u32s(&mut out, &[engine.0, frame, x, y]);
    out.extend_from_slice(&(width as u16).to_le_bytes());
    out.extend_from_slice(&(height as u16).to_le_bytes());
    wire::put_counters(&mut out, &tile.counters());
    wire::put_rejected(&mut out, tile.rejected_count(), tile.rejected());
    let units = tile.merged_units();
    let names: BTreeSet<&str> = units.iter().map(|unit| &*unit.worker).collect();
    let names: Vec<&str> = names.into_iter().collect();
    put_u32s(&mut out, &[names.len() as u32]);
    for name in &names {
        let name = cut_name(name);
        out.extend_from_slice(&(name.len() as u16).to_le_bytes());
        out.extend_from_slice(name.as_bytes());
    }
    put_u32s(&mut out, &[units.len() as u32]);
    for unit in units {
        let worker = names.partition_point(|&name| name < &*unit.worker) as u32;
        put_u32s(&mut out, &[unit.samples.begin, unit.samples.end, worker]);
        out.extend_from_slice(&unit.digest);
    }
    tile.pack(&mut out);
    seal(out)
}

/// At most as much of a name as its length field can say.
fn cut_name(name: &str) -> &str {
    let mut end = name.len().min(u16::MAX as usize);
    while !name.is_char_boundary(end) {
        end -= 1;
    }
    &name[..end]
}

/// A tile as it was saved.
#[derive(Debug)]
pub struct SavedTile {
    /// Engine version of the results.
    pub engine: EngineVersion,
    /// Frame number.
    pub frame: u32,
    /// The state; its version is zero.
    pub tile: TileFilm,
}

/// Reads the blob of a tile back.
pub fn decode_tile(bytes: &[u8]) -> Result<SavedTile, CheckpointError> {
    decode_tile_with(bytes, &mut BTreeSet::new())
}

fn decode_tile_with(
    bytes: &[u8],
    names: &mut BTreeSet<Arc<str>>,
) -> Result<SavedTile, CheckpointError> {
    const WHAT: &str = "checkpoint of a tile";
    let mut input = open(bytes, TILE_MAGIC, WHAT)?;
    tile_fields(&mut input, names).map_err(|source| CheckpointError::Bytes { what: WHAT, source })
}

fn tile_fields(
    input: &mut Reader,
    names: &mut BTreeSet<Arc<str>>,
) -> Result<SavedTile, CodecError> {
    let (engine, frame) = (EngineVersion(input.u32()?), input.u32()?);
    let rectangle = input.tile()?;
    let counters = input.counters()?;
    let rejected = input.rejected(
        rectangle,
        SampleRange {
            begin: 0,
            end: SPP_MAX,
        },
    )?;
    let mut workers = Vec::new();
    for _ in 0..input.u32()? {
        let length = input.u16()? as usize;
        let name = str::from_utf8(input.slice(length)?)
            .map_err(|_| CodecError::Malformed("name of a worker"))?;
        workers.push(intern(names, name));
    }
    let mut ledger: Vec<MergedUnit> = Vec::new();
    for _ in 0..input.u32()? {
        let samples = SampleRange {
            begin: input.u32()?,
            end: input.u32()?,
        };
        let after = ledger
            .last()
            .is_none_or(|last| last.samples.end <= samples.begin);
        if !after || samples.is_empty() || samples.end > SPP_MAX.min(pass_end(samples.begin)) {
            return Err(CodecError::Malformed("merged range"));
        }
        let worker = workers.get(input.u32()? as usize).cloned();
        let worker = worker.ok_or(CodecError::Malformed("number of a worker"))?;
        ledger.push(MergedUnit {
            samples,
            worker,
            digest: input.bytes()?,
        });
    }
    let samples = ledger.iter().map(|unit| unit.samples.len()).sum();
    let planes = tile_planes(input, samples, rectangle.pixels())?;
    end(input)?;
    let tile = TileFilm::restored(rectangle, planes, ledger, counters, rejected);
    Ok(SavedTile {
        engine,
        frame,
        tile,
    })
}

fn tile_planes(input: &mut Reader, samples: u32, pixels: usize) -> Result<Vec<Plane>, CodecError> {
    let mut scratch = Scratch::new();
    let mut done = vec![Plane::ZERO; PLANES];
    let bounds: [_; PLANES] = std::array::from_fn(|plane| planes::bounds(plane, samples));
    for start in (0..pixels).step_by(BLOCK) {
        let count = BLOCK.min(pixels - start);
        for (plane, sums) in done.iter_mut().enumerate() {
            let values = input.block(plane, samples, count, bounds[plane], &mut scratch)?;
            let before = std::mem::replace(sums, Plane::ZERO);
            *sums = before.collect(start, values, count, pixels);
        }
    }
    Ok(done)
}

impl Film {
    /// Indices of the tiles whose blobs a manifest does not have.
    pub fn changed_since(&self, manifest: Option<&Manifest>) -> Vec<u32> {
        let saved = |index: usize| {
            manifest
                .and_then(|m| m.tiles.get(index))
                .and_then(|e| e.as_ref())
                .map_or(0, |e| e.version)
        };
        (0..self.tiles().len())
            .filter(|&index| self.tiles()[index].version() != saved(index))
            .map(|index| index as u32)
            .collect()
    }

    /// Writes the tiles that changed since the previous manifest and returns the next one, to be
    /// stored and committed after the blobs.
    pub fn checkpoint<E>(
        &self,
        previous: Option<&Manifest>,
        log_pos: u64,
        mut put: impl FnMut([u8; 32], Vec<u8>) -> Result<(), E>,
    ) -> Result<Manifest, E> {
        let mut tiles = match previous {
            Some(manifest) => manifest.tiles.clone(),
            None => Vec::new(),
        };
        tiles.resize(self.tiles().len(), None);
        for index in self.changed_since(previous) {
            let (entry, bytes) = self.save_tile(index as usize);
            put(entry.digest, bytes)?;
            tiles[index as usize] = Some(entry);
        }
        let (engine, frame, grid) = (self.engine(), self.frame(), self.grid());
        Ok(Manifest {
            engine,
            frame,
            grid,
            log_pos,
            tiles,
        })
    }

    /// The blob of one tile and its entry in a manifest.
    fn save_tile(&self, index: usize) -> (TileEntry, Vec<u8>) {
        let tile = &self.tiles()[index];
        let bytes = encode_tile(tile, self.frame(), self.engine());
        let digest = *blake3::hash(&bytes).as_bytes();
        (
            TileEntry {
                digest,
                version: tile.version(),
            },
            bytes,
        )
    }

    /// A film as it was saved. `fetch` gets a digest and returns the blob of that name.
    pub fn from_checkpoint<E>(
        manifest: &Manifest,
        mut fetch: impl FnMut([u8; 32]) -> Result<Vec<u8>, E>,
    ) -> Result<Film, CheckpointError>
    where
        E: Into<Box<dyn std::error::Error + Send + Sync>>,
    {
        let mut film = Film::for_engine(manifest.grid, manifest.frame, manifest.engine);
        for (index, entry) in (0..).zip(&manifest.tiles) {
            if let Some(entry) = entry {
                let bytes = fetch(entry.digest).map_err(|e| CheckpointError::Fetch {
                    tile: index,
                    source: e.into(),
                })?;
                film.restore_tile(index, *entry, &bytes)?;
            }
        }
        Ok(film)
    }

    /// Puts one saved tile in its place: for callers that fetch blobs their own way. Begin with
    /// [`Film::for_engine`].
    pub fn restore_tile(
        &mut self,
        index: u32,
        entry: TileEntry,
        bytes: &[u8],
    ) -> Result<(), CheckpointError> {
        if *blake3::hash(bytes).as_bytes() != entry.digest {
            return Err(CheckpointError::Digest { tile: index });
        }
        let mut saved = decode_tile_with(bytes, self.worker_names())?;
        let rectangle = self.tile(index).map(TileFilm::tile);
        let here = (self.frame(), self.engine(), rectangle);
        if (saved.frame, saved.engine, Some(saved.tile.tile())) != here {
            return Err(CheckpointError::Foreign { tile: index });
        }
        saved.tile.set_version(entry.version);
        self.put_tile(index as usize, saved.tile);
        Ok(())
    }
}
