//! NanoVDB files (`.nvdb`): sparse volumes, linearised trees of bricks of 8 x 8 x 8 voxels. Grids of
//! single precision and their quantised forms are read, uncompressed or packed with zlib. Other types
//! of values and Blosc are refused by name.
//!
//! The layout is that of version 32 of the format (all files since 2021): segments of a header, the
//! facts and names of some grids, then their bytes. A grid is a block in which every node states how
//! far off its children lie; each of those distances is held against the bytes that are there, and no
//! node is visited more often than its bytes would fit into the file.

mod tree;

use crate::limits::{MAX_GRID_SIDE, MAX_IMPORT_BYTES};
use glam::{DAffine3, DMat3, DVec3};
use std::borrow::Cow;
use std::io::Read;
use tree::{Part, Tree};

/// The first seven bytes of files and of grids; a digit follows.
const MAGIC: &[u8] = b"NanoVDB";
const HEADER_BYTES: usize = 16;
const FACTS_BYTES: usize = 176;
/// Longest name of a grid.
const NAME_MAX: usize = 4096;
/// Most grids of a file.
const GRIDS_MAX: usize = 1024;

/// How the voxels of a grid are kept.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Voxels {
    Float,
    /// So many bits each, a power of two; within the range of the brick.
    Bits(u32),
    /// As [`Voxels::Bits`], each brick with its own number of bits.
    Varying,
}

impl Voxels {
    fn named(kind: u32) -> Result<Voxels, String> {
        const NAMES: [&str; 19] = [
            "unknown", "float", "double", "int16", "int32", "int64", "vec3f", "vec3d", "mask",
            "half", "uint32", "bool", "rgba8", "fp4", "fp8", "fp16", "fpN", "vec4f", "vec4d",
        ];
        match kind {
            1 => Ok(Voxels::Float),
            13 => Ok(Voxels::Bits(4)),
            14 => Ok(Voxels::Bits(8)),
            15 => Ok(Voxels::Bits(16)),
            16 => Ok(Voxels::Varying),
            _ => {
                let name = NAMES.get(kind as usize).copied().unwrap_or("a later kind");
                Err(format!(
                    "values of type {kind} ({name}); float, fp4, fp8, fp16 and fpN are read"
                ))
            }
        }
    }
}

/// A grid as it lies in the file.
#[derive(Debug)]
pub struct Stored<'a> {
    /// What the scene asks for it by.
    pub name: String,
    /// Bytes when unpacked, as the file claims.
    unpacked_bytes: u64,
    packed: bool,
    bytes: &'a [u8],
}

/// Where things lie in bytes that may be damaged.
#[derive(Clone, Copy)]
struct Bytes<'a>(&'a [u8]);

impl<'a> Bytes<'a> {
    fn get(self, at: usize, count: usize) -> Result<&'a [u8], String> {
        at.checked_add(count)
            .and_then(|end| self.0.get(at..end))
            .ok_or_else(|| {
                format!(
                    "{count} bytes at byte {at} of {}: the file is cut off or damaged",
                    self.0.len()
                )
            })
    }
    fn array<const N: usize>(self, at: usize) -> Result<[u8; N], String> {
        let bytes = self.get(at, N)?;
        Ok(std::array::from_fn(|i| bytes[i]))
    }
    fn u16(self, at: usize) -> Result<u16, String> {
        self.array(at).map(u16::from_le_bytes)
    }
    fn u32(self, at: usize) -> Result<u32, String> {
        self.array(at).map(u32::from_le_bytes)
    }
    fn u64(self, at: usize) -> Result<u64, String> {
        self.array(at).map(u64::from_le_bytes)
    }
    fn f32(self, at: usize) -> Result<f32, String> {
        self.array(at).map(f32::from_le_bytes)
    }
    fn f64(self, at: usize) -> Result<f64, String> {
        self.array(at).map(f64::from_le_bytes)
    }
    /// A size or distance as an index.
    fn index(self, at: usize) -> Result<usize, String> {
        let value = self.u64(at)?;
        usize::try_from(value).map_err(|_| format!("a size of {value} at byte {at}"))
    }
}

fn check_version(version: u32) -> Result<(), String> {
    let (major, minor) = (version >> 21, (version >> 10) & 0x7ff);
    if major == 32 {
        return Ok(());
    }
    Err(format!(
        "version {major}.{minor} of NanoVDB; 32 is read: write the file again with a present \
         nanovdb_convert"
    ))
}

fn text(bytes: &[u8]) -> String {
    let end = bytes.iter().position(|&b| b == 0).unwrap_or(bytes.len());
    String::from_utf8_lossy(&bytes[..end]).into_owned()
}

/// The grids of a file, without looking into them.
pub fn grids(file: &[u8]) -> Result<Vec<Stored<'_>>, String> {
    let bytes = Bytes(file);
    let start = bytes.get(0, 8)?;
    if !start.starts_with(MAGIC) {
        let reason = if start[0] == b' ' && start[1..4] == *b"BDV" {
            "an OpenVDB file; nanovdb_convert makes a NanoVDB file of it"
        } else if start[1..].iter().rev().eq(MAGIC) {
            "a file written on a big-endian machine"
        } else {
            "not a NanoVDB file"
        };
        return Err(reason.into());
    }
    if start[7] == b'1' {
        return raw_grids(bytes);
    }
    let mut out = Vec::new();
    let mut at = 0;
    while at < file.len() {
        let head = bytes.get(at, HEADER_BYTES)?;
        if !head.starts_with(MAGIC) {
            return Err(format!("no segment begins at byte {at}"));
        }
        check_version(bytes.u32(at + 8)?)?;
        let count = usize::from(bytes.u16(at + 12)?);
        let codec = bytes.u16(at + 14)?;
        at += HEADER_BYTES;
        let mut listed = Vec::new();
        for _ in 0..count {
            bytes.get(at, FACTS_BYTES)?;
            let length = bytes.u32(at + 136)? as usize;
            if length > NAME_MAX || out.len() + listed.len() >= GRIDS_MAX {
                return Err(format!(
                    "a name of {length} bytes at byte {at}, or more than {GRIDS_MAX} grids"
                ));
            }
            let name = text(bytes.get(at + FACTS_BYTES, length)?);
            listed.push((name, bytes.u64(at)?, bytes.index(at + 8)?));
            at += FACTS_BYTES + length;
        }
        for (name, unpacked_bytes, size) in listed {
            let stored = bytes.get(at, size)?;
            let packed = match codec {
                0 => false,
                1 => true,
                2 => {
                    return Err(
                        "packed with Blosc, which is not read (nor by pbrt): write it again with \
                         nanovdb_convert --zip or without packing"
                            .into(),
                    );
                }
                other => return Err(format!("packed in an unknown way ({other})")),
            };
            out.push(Stored {
                name,
                unpacked_bytes,
                packed,
                bytes: stored,
            });
            at += size;
        }
    }
    Ok(out)
}

/// Grids that were written as they lie in memory, one after the other.
fn raw_grids(bytes: Bytes<'_>) -> Result<Vec<Stored<'_>>, String> {
    let mut out = Vec::new();
    let mut at = 0;
    while at < bytes.0.len() && out.len() < GRIDS_MAX {
        let size = bytes.index(at + 32)?;
        let stored = bytes.get(at, size.max(tree::GRID_BYTES))?;
        out.push(Stored {
            name: text(&stored[40..296]),
            unpacked_bytes: stored.len() as u64,
            packed: false,
            bytes: stored,
        });
        at += stored.len();
    }
    Ok(out)
}

/// A box of voxels, both corners included.
pub type IndexBox = [[i64; 3]; 2];

/// A grid that was looked into.
#[derive(Debug)]
pub struct Volume<'a> {
    tree: Tree<'a>,
    /// From indices of voxels to the space of the medium.
    pub to_medium: DAffine3,
    /// Whether it is declared as the distance to a surface, or another thing that is no density.
    pub no_density: bool,
    /// The active voxels; none if there are none.
    pub active: Option<IndexBox>,
}

impl<'a> Stored<'a> {
    /// Memory that [`Stored::open`] takes at most.
    pub fn memory_bytes(&self) -> u64 {
        if self.packed {
            self.unpacked_bytes.min(MAX_IMPORT_BYTES)
        } else {
            0
        }
    }

    /// Unpacks and checks a grid.
    pub fn open(&self) -> Result<Volume<'a>, String> {
        let data: Cow<'a, [u8]> = if self.packed {
            // The size is only claimed: what comes out is counted.
            let limit = self.unpacked_bytes.min(MAX_IMPORT_BYTES);
            let size = Bytes(self.bytes).index(0)?;
            let packed = Bytes(self.bytes).get(8, size)?;
            let mut out = Vec::new();
            flate2::read::ZlibDecoder::new(packed)
                .take(limit.saturating_add(1))
                .read_to_end(&mut out)
                .map_err(|e| format!("damaged zlib data: {e}"))?;
            if out.len() as u64 != self.unpacked_bytes {
                return Err(format!(
                    "unpacks to {} bytes or more instead of {}",
                    out.len(),
                    self.unpacked_bytes
                ));
            }
            Cow::Owned(out)
        } else {
            Cow::Borrowed(self.bytes)
        };
        let bytes = Bytes(&data);
        bytes.get(0, tree::GRID_BYTES)?;
        if !data.starts_with(MAGIC) {
            return Err("the grid does not begin as one".into());
        }
        check_version(bytes.u32(16)?)?;
        let (class, kind) = (bytes.u32(632)?, bytes.u32(636)?);
        let voxels = Voxels::named(kind)?;
        let mut numbers = [0.0; 12];
        for (i, number) in numbers[..9].iter_mut().enumerate() {
            *number = bytes.f64(384 + 8 * i)?;
        }
        for (i, number) in numbers[9..].iter_mut().enumerate() {
            *number = bytes.f64(528 + 8 * i)?;
        }
        let to_medium = DAffine3 {
            // Written row by row.
            matrix3: DMat3::from_cols_slice(&numbers[..9]).transpose(),
            translation: DVec3::from_slice(&numbers[9..]),
        };
        if !(to_medium.is_finite() && to_medium.matrix3.determinant().abs() > 1e-200) {
            return Err("a singular transform from voxels to the scene".into());
        }
        let tree = Tree::new(data, voxels)?;
        let active = tree.active()?;
        Ok(Volume {
            tree,
            to_medium,
            // Unknown and fog, as pbrt takes them.
            no_density: !matches!(class, 0 | 2),
            active,
        })
    }
}

/// Cells of a box at a step: so many voxels along each side of a cell.
pub fn cells(space: &IndexBox, step: i64) -> [u64; 3] {
    std::array::from_fn(|i| {
        let side = (space[1][i] - space[0][i] + 1).max(1);
        (side + step - 1).div_euclid(step) as u64
    })
}

impl Volume<'_> {
    /// The value beyond all voxels.
    pub fn background(&self) -> f32 {
        self.tree.background
    }

    /// The values of a box, x fastest, each the mean of `step` voxels along every side. The caller has
    /// seen to it that they fit into memory.
    pub fn dense(&self, space: &IndexBox, step: i64) -> Result<([u32; 3], Vec<f32>), String> {
        let size = cells(space, step);
        if size.iter().any(|&n| n > u64::from(MAX_GRID_SIDE)) {
            return Err(format!(
                "{} x {} x {} cells; the limit is {MAX_GRID_SIDE} along a side",
                size[0], size[1], size[2]
            ));
        }
        let size = size.map(|n| n as usize);
        let background = self.tree.background;
        let mut out = vec![background; size[0] * size[1] * size[2]];
        let share = 1.0 / (step * step * step) as f32;
        let low = space[0];
        let mut put = |at: usize, value: f32, voxels: i64| {
            if step == 1 {
                out[at] = value;
            } else {
                out[at] += (value - background) * (voxels as f32 * share);
            }
        };
        self.tree.walk(&mut |part| match part {
            Part::Block { range, value, .. } => {
                let inside: IndexBox = [
                    std::array::from_fn(|i| range[0][i].max(low[i]) - low[i]),
                    std::array::from_fn(|i| range[1][i].min(space[1][i]) - low[i]),
                ];
                if value == background || (0..3).any(|i| inside[0][i] > inside[1][i]) {
                    return;
                }
                let [a, b] = inside.map(|corner| corner.map(|x| x / step));
                let overlap = |axis: usize, cell: i64| {
                    let from = (cell * step).max(inside[0][axis]);
                    ((cell + 1) * step).min(inside[1][axis] + 1) - from
                };
                for z in a[2]..=b[2] {
                    for y in a[1]..=b[1] {
                        let row = (z as usize * size[1] + y as usize) * size[0];
                        let face = overlap(2, z) * overlap(1, y);
                        for x in a[0]..=b[0] {
                            put(row + x as usize, value, face * overlap(0, x));
                        }
                    }
                }
            }
            Part::Brick { origin, brick } => {
                let ranges: [(i64, i64); 3] = std::array::from_fn(|i| {
                    let from = (low[i] - origin[i]).clamp(0, 8);
                    (from, (space[1][i] + 1 - origin[i]).clamp(0, 8))
                });
                for z in ranges[2].0..ranges[2].1 {
                    let k = ((origin[2] + z - low[2]) / step) as usize;
                    for y in ranges[1].0..ranges[1].1 {
                        let j = ((origin[1] + y - low[1]) / step) as usize;
                        let row = (k * size[1] + j) * size[0];
                        for x in ranges[0].0..ranges[0].1 {
                            let i = ((origin[0] + x - low[0]) / step) as usize;
                            let value = brick.value((x * 64 + y * 8 + z) as usize);
                            put(row + i, value, 1);
                        }
                    }
                }
            }
        })?;
        Ok((size.map(|n| n as u32), out))
    }
}

#[cfg(test)]
pub(crate) mod testing;
#[cfg(test)]
mod tests;
