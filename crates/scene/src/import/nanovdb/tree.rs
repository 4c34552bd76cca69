//! The tree of a grid: a root with a table of blocks of 4096 voxels along a side, below it nodes of
//! 32 x 32 x 32 blocks of 128 voxels, then of 16 x 16 x 16 blocks of 8 voxels, then bricks of voxels. A
//! block is a node or one value for all of it.

use super::{Bytes, IndexBox, Voxels};
use std::borrow::Cow;

/// Facts of the grid, before the tree.
pub const GRID_BYTES: usize = 672;
const ROOT_BYTES: usize = 64;
const ROOT_ENTRY_BYTES: usize = 32;
/// Of a brick, before its values.
const BRICK_HEAD_BYTES: usize = 96;
const BRICK_SIDE: i64 = 8;
const BRICK_VOXELS: usize = 512;

/// A level of nodes between the root and the bricks.
struct Level {
    /// Blocks along a side, as a power of two.
    log_blocks: u32,
    /// Voxels along the side of a block.
    block: i64,
    /// Where its masks begin, their length, and where the table begins.
    mask: usize,
    mask_bytes: usize,
    table: usize,
}

const UPPER: Level = Level {
    log_blocks: 5,
    block: 128,
    mask: 32,
    mask_bytes: 4096,
    table: 8256,
};
const LOWER: Level = Level {
    log_blocks: 4,
    block: BRICK_SIDE,
    mask: 32,
    mask_bytes: 512,
    table: 1088,
};

impl Level {
    fn entries(&self) -> usize {
        1 << (3 * self.log_blocks)
    }
    fn bytes(&self) -> usize {
        self.table + 8 * self.entries()
    }
}

/// What a walk meets.
pub enum Part<'v> {
    /// One value for a box of voxels, both corners included.
    Block {
        range: IndexBox,
        value: f32,
        active: bool,
    },
    Brick {
        /// Its least voxel.
        origin: [i64; 3],
        brick: Brick<'v>,
    },
}

/// 8 x 8 x 8 voxels.
pub struct Brick<'v> {
    /// A bit for each active voxel, z fastest.
    mask: &'v [u8],
    codes: &'v [u8],
    /// Bits of a code; 32 stands for the values themselves.
    bits: u32,
    least: f32,
    quantum: f32,
}

impl Brick<'_> {
    /// A voxel by its number, z fastest.
    #[inline]
    pub fn value(&self, i: usize) -> f32 {
        if self.bits == 32 {
            let at = 4 * i;
            return f32::from_le_bytes(std::array::from_fn(|k| self.codes[at + k]));
        }
        let code = if self.bits == 16 {
            u32::from(self.codes[2 * i]) | u32::from(self.codes[2 * i + 1]) << 8
        } else {
            let bit = i * self.bits as usize;
            u32::from(self.codes[bit / 8]) >> (bit % 8) & ((1 << self.bits) - 1)
        };
        code as f32 * self.quantum + self.least
    }
}

#[derive(Debug)]
pub struct Tree<'a> {
    data: Cow<'a, [u8]>,
    voxels: Voxels,
    root: usize,
    entries: usize,
    /// The value where there is nothing.
    pub background: f32,
}

/// Nodes that may still be visited by level: more do not fit into the bytes, so that a file whose nodes
/// are their own children ends.
struct Left {
    upper: usize,
    lower: usize,
    bricks: usize,
}

fn take(left: &mut usize) -> Result<(), String> {
    *left = left
        .checked_sub(1)
        .ok_or("nodes that are the children of several others")?;
    Ok(())
}

fn bit(mask: &[u8], i: usize) -> bool {
    mask[i / 8] >> (i % 8) & 1 == 1
}

impl<'a> Tree<'a> {
    pub fn new(data: Cow<'a, [u8]>, voxels: Voxels) -> Result<Tree<'a>, String> {
        let bytes = Bytes(&data);
        let root = GRID_BYTES
            .checked_add(bytes.index(GRID_BYTES + 24)?)
            .ok_or("a root beyond all bytes")?;
        bytes.get(root, ROOT_BYTES)?;
        let entries = bytes.u32(root + 24)? as usize;
        bytes.get(root + ROOT_BYTES, entries.saturating_mul(ROOT_ENTRY_BYTES))?;
        let background = bytes.f32(root + 28)?;
        if !background.is_finite() {
            return Err(format!("a background of {background}"));
        }
        // Blocks that are there twice would be painted twice; nothing but a damaged file has them.
        let mut keys = Vec::with_capacity(entries);
        for i in 0..entries {
            keys.push(bytes.u64(root + ROOT_BYTES + i * ROOT_ENTRY_BYTES)?);
        }
        keys.sort_unstable();
        if keys.windows(2).any(|pair| pair[0] == pair[1]) {
            return Err("a root with the same block twice".into());
        }
        Ok(Tree {
            data,
            voxels,
            root,
            entries,
            background,
        })
    }

    /// Visits everything that differs from the background, in the order of the file's tables.
    pub fn walk(&self, visit: &mut dyn FnMut(Part<'_>)) -> Result<(), String> {
        let bytes = Bytes(&self.data);
        let mut left = Left {
            upper: self.data.len() / UPPER.bytes(),
            lower: self.data.len() / LOWER.bytes(),
            bricks: self.data.len() / (BRICK_HEAD_BYTES + 64),
        };
        for i in 0..self.entries {
            let at = self.root + ROOT_BYTES + i * ROOT_ENTRY_BYTES;
            let key = bytes.u64(at)?;
            // Three coordinates of 20 bits, z lowest; what is 2^31 and more is negative.
            let part = |shift: u32| {
                let high = (key >> shift) as u32 & 0x1f_ffff;
                i64::from((high << 12) as i32)
            };
            let origin = [part(42), part(21), part(0)];
            let child = bytes.u64(at + 8)? as i64;
            if child == 0 {
                visit(Part::Block {
                    range: [origin, origin.map(|x| x + 4095)],
                    value: bytes.f32(at + 20)?,
                    active: bytes.u32(at + 16)? & 1 == 1,
                });
            } else {
                take(&mut left.upper)?;
                let node = follow(self.root, child)?;
                self.node(&UPPER, node, origin, &mut left, visit)?;
            }
        }
        Ok(())
    }

    fn node(
        &self,
        level: &Level,
        at: usize,
        origin: [i64; 3],
        left: &mut Left,
        visit: &mut dyn FnMut(Part<'_>),
    ) -> Result<(), String> {
        let bytes = Bytes(&self.data);
        let node = Bytes(bytes.get(at, level.bytes())?);
        let active = node.get(level.mask, level.mask_bytes)?;
        let children = node.get(level.mask + level.mask_bytes, level.mask_bytes)?;
        let side = (1usize << level.log_blocks) - 1;
        for i in 0..level.entries() {
            let place = [
                i >> (2 * level.log_blocks),
                (i >> level.log_blocks) & side,
                i & side,
            ];
            let own = std::array::from_fn(|k| origin[k] + place[k] as i64 * level.block);
            let entry = level.table + 8 * i;
            if !bit(children, i) {
                let value = node.f32(entry)?;
                let active = bit(active, i);
                if active || value != self.background {
                    let range = [own, own.map(|x: i64| x + level.block - 1)];
                    visit(Part::Block {
                        range,
                        value,
                        active,
                    });
                }
                continue;
            }
            let child = follow(at, node.u64(entry)? as i64)?;
            if level.block == BRICK_SIDE {
                take(&mut left.bricks)?;
                let brick = self.brick(child)?;
                visit(Part::Brick { origin: own, brick });
            } else {
                take(&mut left.lower)?;
                self.node(&LOWER, child, own, left, visit)?;
            }
        }
        Ok(())
    }

    fn brick(&self, at: usize) -> Result<Brick<'_>, String> {
        let bytes = Bytes(&self.data);
        let head = bytes.get(at, BRICK_HEAD_BYTES)?;
        let bits = match self.voxels {
            Voxels::Float => 32,
            Voxels::Bits(bits) => bits,
            Voxels::Varying => match head[15] >> 5 {
                log @ 0..=4 => 1 << log,
                log => return Err(format!("values of 2^{log} bits in the brick at byte {at}")),
            },
        };
        Ok(Brick {
            mask: &head[16..80],
            codes: bytes.get(at + BRICK_HEAD_BYTES, BRICK_VOXELS / 8 * bits as usize)?,
            bits,
            least: bytes.f32(at + 80)?,
            quantum: bytes.f32(at + 84)?,
        })
    }

    /// The box of all active voxels.
    pub fn active(&self) -> Result<Option<IndexBox>, String> {
        let mut all: Option<IndexBox> = None;
        let mut grow = |low: [i64; 3], high: [i64; 3]| {
            let [a, b] = all.get_or_insert([low, high]);
            *a = std::array::from_fn(|i| a[i].min(low[i]));
            *b = std::array::from_fn(|i| b[i].max(high[i]));
        };
        self.walk(&mut |part| match part {
            Part::Block {
                range,
                active: true,
                ..
            } => grow(range[0], range[1]),
            Part::Block { .. } => (),
            Part::Brick { origin, brick } => {
                let (mut low, mut high) = ([8usize; 3], [0usize; 3]);
                for i in (0..BRICK_VOXELS).filter(|&i| bit(brick.mask, i)) {
                    let place = [i >> 6, (i >> 3) & 7, i & 7];
                    low = std::array::from_fn(|k| low[k].min(place[k]));
                    high = std::array::from_fn(|k| high[k].max(place[k]));
                }
                if low[0] < 8 {
                    let corner = |p: [usize; 3]| std::array::from_fn(|k| origin[k] + p[k] as i64);
                    grow(corner(low), corner(high));
                }
            }
        })?;
        Ok(all)
    }
}

fn follow(from: usize, distance: i64) -> Result<usize, String> {
    isize::try_from(distance)
        .ok()
        .and_then(|d| from.checked_add_signed(d))
        .ok_or_else(|| format!("a node {distance} bytes from byte {from}"))
}
