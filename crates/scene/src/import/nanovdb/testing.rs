//! Writes small NanoVDB files for tests.

use std::collections::BTreeMap;
use std::io::Write;

/// A grid to write.
#[derive(Clone)]
pub struct Draft {
    pub name: &'static str,
    /// By place; what is not there has the background, and is not active.
    pub voxels: BTreeMap<[i32; 3], f32>,
    /// Blocks of one value, active: origin and side (8, 128 or 4096).
    pub blocks: Vec<([i32; 3], i32, f32)>,
    pub background: f32,
    /// Rows of the matrix, then the translation.
    pub map: [f64; 12],
    pub class: u32,
    /// Type of the values: 1 float, 13 to 16 quantised.
    pub kind: u32,
}

impl Draft {
    pub fn new(name: &'static str) -> Draft {
        Draft {
            name,
            voxels: BTreeMap::new(),
            blocks: Vec::new(),
            background: 0.0,
            map: [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0],
            class: 2,
            kind: 1,
        }
    }

    /// A box of voxels by a function.
    pub fn filled(mut self, low: [i32; 3], high: [i32; 3], f: impl Fn([i32; 3]) -> f32) -> Draft {
        for x in low[0]..=high[0] {
            for y in low[1]..=high[1] {
                for z in low[2]..=high[2] {
                    self.voxels.insert([x, y, z], f([x, y, z]));
                }
            }
        }
        self
    }

    /// The grid as it lies in memory.
    pub fn bytes(&self) -> Vec<u8> {
        let brick_bytes = match self.kind {
            1 => 2048,
            13 => 256,
            14 => 512,
            15 => 1024,
            // Each brick with 8 bits.
            _ => 512,
        };
        let down = |p: [i32; 3], side: i32| p.map(|x| x.div_euclid(side) * side);
        let mut bricks: BTreeMap<[i32; 3], Vec<([i32; 3], f32)>> = BTreeMap::new();
        for (&p, &v) in &self.voxels {
            bricks.entry(down(p, 8)).or_default().push((p, v));
        }
        let small = |side| self.blocks.iter().filter(move |b| b.1 == side);
        let collect = |of: Vec<[i32; 3]>, side| {
            let mut list: Vec<[i32; 3]> = of.into_iter().map(|p| down(p, side)).collect();
            list.sort();
            list.dedup();
            list
        };
        let lower = collect(
            (bricks.keys().copied())
                .chain(small(8).map(|b| b.0))
                .collect(),
            128,
        );
        let upper = collect(
            (lower.iter().copied())
                .chain(small(128).map(|b| b.0))
                .collect(),
            4096,
        );
        let table = upper.len() + small(4096).count();
        let root = 672 + 64;
        let first_upper = root + 64 + 32 * table;
        let first_lower = first_upper + upper.len() * 270_400;
        let first_brick = first_lower + lower.len() * 33_856;
        let end = first_brick + bricks.len() * (96 + brick_bytes);
        let mut out = vec![0u8; end];
        let mut put = |at: usize, bytes: &[u8]| out[at..at + bytes.len()].copy_from_slice(bytes);
        put(0, b"NanoVDB1");
        put(16, &((32u32 << 21) | (6 << 10)).to_le_bytes());
        put(28, &1u32.to_le_bytes());
        put(32, &(end as u64).to_le_bytes());
        put(40, self.name.as_bytes());
        for (i, x) in self.map.iter().enumerate() {
            let at = if i < 9 {
                384 + 8 * i
            } else {
                528 + 8 * (i - 9)
            };
            put(at, &x.to_le_bytes());
        }
        put(632, &self.class.to_le_bytes());
        put(636, &self.kind.to_le_bytes());
        for (i, at) in [first_brick, first_lower, first_upper, root]
            .iter()
            .enumerate()
        {
            put(672 + 8 * i, &(*at as u64 - 672).to_le_bytes());
        }
        put(root + 24, &(table as u32).to_le_bytes());
        put(root + 28, &self.background.to_le_bytes());
        let key = |p: [i32; 3]| {
            let part = |x: i32| u64::from(x as u32 >> 12);
            part(p[2]) | part(p[1]) << 21 | part(p[0]) << 42
        };
        for (i, p) in upper.iter().enumerate() {
            let at = root + 64 + 32 * i;
            put(at, &key(*p).to_le_bytes());
            let child = first_upper + i * 270_400 - root;
            put(at + 8, &(child as i64).to_le_bytes());
        }
        for (i, (p, _, v)) in small(4096).enumerate() {
            let at = root + 64 + 32 * (upper.len() + i);
            put(at, &key(*p).to_le_bytes());
            put(at + 16, &1u32.to_le_bytes());
            put(at + 20, &v.to_le_bytes());
        }
        // Masks, by bits to set.
        let mut bits: Vec<(usize, usize)> = Vec::new();
        let index = |p: [i32; 3], parent: [i32; 3], block: i32, log: u32| {
            let k: [usize; 3] = std::array::from_fn(|i| ((p[i] - parent[i]) / block) as usize);
            (k[0] << (2 * log)) | (k[1] << log) | k[2]
        };
        for (node, (list, size, log, block, mask, table)) in [
            (&upper, 270_400, 5, 128, 4096, 8256),
            (&lower, 33_856, 4, 8, 512, 1088),
        ]
        .into_iter()
        .enumerate()
        {
            let first = [first_upper, first_lower][node];
            for (i, p) in list.iter().enumerate() {
                let at = first + i * size;
                for e in 0..1usize << (3 * log) {
                    put(at + table + 8 * e, &self.background.to_le_bytes());
                }
                let children: Vec<([i32; 3], usize)> = if node == 0 {
                    let at = |(j, q): (usize, &[i32; 3])| (*q, first_lower + j * 33_856);
                    lower.iter().enumerate().map(at).collect()
                } else {
                    let at =
                        |(j, q): (usize, &[i32; 3])| (*q, first_brick + j * (96 + brick_bytes));
                    bricks.keys().enumerate().map(at).collect()
                };
                for (q, child) in children
                    .iter()
                    .filter(|c| down(c.0, block * (1 << log)) == *p)
                {
                    let e = index(*q, *p, block, log);
                    put(
                        at + table + 8 * e,
                        &(*child as i64 - at as i64).to_le_bytes(),
                    );
                    bits.push((at + 32 + mask, e));
                }
                for (q, _, v) in small(block).filter(|b| down(b.0, block * (1 << log)) == *p) {
                    let e = index(*q, *p, block, log);
                    put(at + table + 8 * e, &v.to_le_bytes());
                    bits.push((at + 32, e));
                }
            }
        }
        for (i, (p, voxels)) in bricks.iter().enumerate() {
            let at = first_brick + i * (96 + brick_bytes);
            let mut values = [self.background; 512];
            for (q, v) in voxels {
                let e = index(*q, *p, 1, 3);
                values[e] = *v;
                bits.push((at + 16, e));
            }
            let least = values.iter().copied().fold(f32::INFINITY, f32::min);
            let most = values.iter().copied().fold(f32::NEG_INFINITY, f32::max);
            let width = match self.kind {
                13 => 4,
                15 => 16,
                _ => 8,
            };
            let quantum = (most - least) / ((1 << width) - 1) as f32;
            if self.kind != 1 {
                put(at + 15, &[3 << 5]);
                put(at + 80, &least.to_le_bytes());
                put(at + 84, &quantum.to_le_bytes());
            }
            for (e, v) in values.iter().enumerate() {
                let code = ((v - least) / quantum.max(1e-30) + 0.5) as u32;
                let at = at + 96;
                match self.kind {
                    1 => put(at + 4 * e, &v.to_le_bytes()),
                    15 => put(at + 2 * e, &(code as u16).to_le_bytes()),
                    13 if e % 2 == 0 => {
                        let next = ((values[e + 1] - least) / quantum.max(1e-30) + 0.5) as u32;
                        put(at + e / 2, &[(code | next << 4) as u8]);
                    }
                    13 => (),
                    _ => put(at + e, &[code as u8]),
                }
            }
        }
        for (at, e) in bits {
            out[at + e / 8] |= 1 << (e % 8);
        }
        out
    }
}

/// A file of one segment; codec 0 is unpacked, 1 zlib, 2 is only claimed.
pub fn file(grids: &[Draft], codec: u16) -> Vec<u8> {
    let mut out = b"NanoVDB2".to_vec();
    out.extend(((32u32 << 21) | (6 << 10)).to_le_bytes());
    out.extend((grids.len() as u16).to_le_bytes());
    out.extend(codec.to_le_bytes());
    let mut bodies = Vec::new();
    for grid in grids {
        let raw = grid.bytes();
        let body = if codec == 1 {
            let mut packed =
                flate2::write::ZlibEncoder::new(Vec::new(), flate2::Compression::fast());
            packed.write_all(&raw).unwrap();
            let packed = packed.finish().unwrap();
            let mut body = (packed.len() as u64).to_le_bytes().to_vec();
            body.extend(packed);
            body
        } else {
            raw.clone()
        };
        let mut facts = [0u8; 176];
        facts[..8].copy_from_slice(&(raw.len() as u64).to_le_bytes());
        facts[8..16].copy_from_slice(&(body.len() as u64).to_le_bytes());
        facts[136..140].copy_from_slice(&(grid.name.len() as u32 + 1).to_le_bytes());
        facts[168..170].copy_from_slice(&codec.to_le_bytes());
        out.extend(facts);
        out.extend(grid.name.as_bytes());
        out.push(0);
        bodies.push(body);
    }
    out.extend(bodies.concat());
    out
}
