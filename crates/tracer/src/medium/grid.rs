//! Media that vary: values on a regular grid, and a coarser grid of upper bounds over it.

use super::{Coefficients, DENSE};
use crate::geometry::transform::Affine;
use crate::math::{Rgb, length};
use glam::Vec3;
use scene::model::{Grid, GridValues, MediumGrid};
use std::sync::Arc;

/// Blocks of bounds along an axis, at most.
const BLOCKS_MAX: u32 = 48;
/// Cells of the finest grid along a side of a block.
const BLOCK: u32 = 4;

/// A grid of factors in its box; see [`MediumGrid`].
pub struct GridMedium {
    from_world: Affine,
    min: Vec3,
    inv_size: Vec3,
    absorption: Arc<Grid>,
    scattering: Arc<Grid>,
    emission: Option<Arc<Grid>>,
    /// Blocks by axis, and the largest extinction of any channel in each, x fastest.
    blocks: [u32; 3],
    bounds: Vec<f32>,
}

/// A stretch of a ray with an upper bound on the extinction.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Stretch {
    /// Distance along the ray where it begins.
    pub from: f32,
    /// Where it ends.
    pub to: f32,
    /// No channel's extinction exceeds this.
    pub bound: f32,
}

impl GridMedium {
    /// Finds the bounds. What is negative or not a number counts as zero.
    pub fn new(desc: &MediumGrid, sigma_a: Rgb, sigma_s: Rgb) -> GridMedium {
        let (a, b) = (Vec3::from(desc.bounds[0]), Vec3::from(desc.bounds[1]));
        let min = a.min(b);
        let size = a.max(b) - min;
        let finest = |axis: usize| desc.absorption.size[axis].max(desc.scattering.size[axis]);
        let blocks = [0, 1, 2].map(|axis| finest(axis).div_ceil(BLOCK).clamp(1, BLOCKS_MAX));
        let same = Arc::ptr_eq(&desc.absorption, &desc.scattering);
        let mut bounds = Vec::with_capacity(blocks.iter().map(|b| *b as usize).product());
        for z in 0..blocks[2] {
            for y in 0..blocks[1] {
                for x in 0..blocks[0] {
                    let scattering = largest(&desc.scattering, [x, y, z], blocks);
                    // Where one density drives both, so does its largest value.
                    let extinction = if same {
                        (sigma_a + sigma_s) * scattering
                    } else {
                        let absorption = largest(&desc.absorption, [x, y, z], blocks);
                        sigma_a * absorption + sigma_s * scattering
                    };
                    // Interpolated values may exceed all corners by rounding.
                    bounds.push(extinction.max_element() * 1.000_01);
                }
            }
        }
        GridMedium {
            from_world: Affine::new(&desc.transform.inverse()),
            min,
            inv_size: Vec3::ONE / size.max(Vec3::splat(1e-20)),
            absorption: desc.absorption.clone(),
            scattering: desc.scattering.clone(),
            emission: desc.emission.clone(),
            blocks,
            bounds,
        }
    }

    /// A world point in the unit cube of the grid.
    #[inline]
    fn place(&self, p: Vec3) -> Vec3 {
        (self.from_world.point(p) - self.min) * self.inv_size
    }

    /// Coefficients at a world point inside the box, from those of the medium.
    #[inline]
    pub fn at(&self, p: Vec3, whole: &Coefficients) -> Coefficients {
        let q = self.place(p);
        let s = lookup(&self.scattering, q);
        let a = if Arc::ptr_eq(&self.absorption, &self.scattering) {
            s
        } else {
            lookup(&self.absorption, q)
        };
        let emission = match &self.emission {
            Some(grid) if whole.emission != Rgb::ZERO => whole.emission * lookup(grid, q),
            _ => whole.emission,
        };
        Coefficients {
            a: whole.a * a,
            s: whole.s * s,
            emission,
        }
    }

    /// The stretches of a ray through the blocks, in order, up to a distance. Distances are lengths in
    /// the world; `d` has unit length.
    #[inline]
    pub fn walk(&self, o: Vec3, d: Vec3, end: f32) -> Walk<'_> {
        let scale = Vec3::new(
            self.blocks[0] as f32,
            self.blocks[1] as f32,
            self.blocks[2] as f32,
        );
        let origin = self.place(o) * scale;
        let step = self.from_world.vector(d) * self.inv_size * scale;
        let mut walk = Walk {
            grid: self,
            t: 0.0,
            far: end,
            cell: [0; 3],
            next: [f32::INFINITY; 3],
            delta: [f32::INFINITY; 3],
            step,
            // A ray crosses each plane between blocks once.
            left: self.blocks.iter().sum::<u32>() + 3,
        };
        if !(length(step) > 0.0 && origin.is_finite()) {
            walk.left = 0;
            return walk;
        }
        // Where the ray is in the box.
        for axis in 0..3 {
            if step[axis] == 0.0 {
                if origin[axis] < 0.0 || origin[axis] > scale[axis] {
                    walk.left = 0;
                }
                continue;
            }
            let a = -origin[axis] / step[axis];
            let b = (scale[axis] - origin[axis]) / step[axis];
            walk.t = walk.t.max(a.min(b));
            walk.far = walk.far.min(a.max(b));
        }
        if walk.t.is_nan() || walk.far.is_nan() || walk.t >= walk.far {
            walk.left = 0;
            return walk;
        }
        let inside = origin + step * walk.t;
        for axis in 0..3 {
            let cell = (inside[axis] as i32).clamp(0, self.blocks[axis] as i32 - 1);
            walk.cell[axis] = cell;
            if step[axis] != 0.0 {
                let border = cell as f32 + if step[axis] > 0.0 { 1.0 } else { 0.0 };
                walk.next[axis] = (border - origin[axis]) / step[axis];
                walk.delta[axis] = 1.0 / step[axis].abs();
            }
        }
        walk
    }

    /// Memory held: the grids, and their bounds.
    pub fn memory_bytes(&self) -> usize {
        let bytes = |g: &Grid| match &g.values {
            GridValues::Scalar(v) => v.len() * 4,
            GridValues::Rgb(v) => v.len() * 12,
        };
        let mut sum = self.bounds.len() * 4 + bytes(&self.scattering);
        if !Arc::ptr_eq(&self.absorption, &self.scattering) {
            sum += bytes(&self.absorption);
        }
        sum + self.emission.as_deref().map_or(0, bytes)
    }
}

/// See [`GridMedium::walk`].
pub struct Walk<'g> {
    grid: &'g GridMedium,
    t: f32,
    far: f32,
    cell: [i32; 3],
    /// Distances of the next border by axis, and between borders.
    next: [f32; 3],
    delta: [f32; 3],
    step: Vec3,
    /// Stretches that may still come.
    left: u32,
}

impl Iterator for Walk<'_> {
    type Item = Stretch;

    #[inline]
    fn next(&mut self) -> Option<Stretch> {
        while self.left > 0 {
            self.left -= 1;
            let axis = if self.next[0] <= self.next[1] && self.next[0] <= self.next[2] {
                0
            } else if self.next[1] <= self.next[2] {
                1
            } else {
                2
            };
            let border = self.next[axis];
            let (from, to) = (self.t, border.min(self.far));
            let [x, y, z] = self.cell.map(|c| c as usize);
            let [w, h, _] = self.grid.blocks.map(|b| b as usize);
            let bound = self.grid.bounds[(z * h + y) * w + x];
            self.t = from.max(to);
            self.next[axis] += self.delta[axis];
            self.cell[axis] += if self.step[axis] > 0.0 { 1 } else { -1 };
            let size = self.grid.blocks[axis] as i32;
            if border >= self.far || self.cell[axis] < 0 || self.cell[axis] >= size {
                self.left = 0;
            }
            if to > from {
                return Some(Stretch { from, to, bound });
            }
        }
        None
    }
}

#[inline]
fn value(grid: &Grid, index: usize) -> Rgb {
    let rgb = match &grid.values {
        GridValues::Scalar(v) => Rgb::splat(v[index]),
        GridValues::Rgb(v) => Rgb::from_array(v[index]),
    };
    // max(0) also turns NaN into 0.
    rgb.max(Rgb::ZERO).min(Rgb::splat(DENSE))
}

/// Trilinear between the centres of cells; beyond the outermost centres as there.
#[inline]
fn lookup(grid: &Grid, q: Vec3) -> Rgb {
    let mut low = [0usize; 3];
    let mut high = [0usize; 3];
    let mut f = [0.0f32; 3];
    for axis in 0..3 {
        let n = grid.size[axis];
        let x = (q[axis] * n as f32 - 0.5).clamp(0.0, (n - 1) as f32);
        low[axis] = (x as usize).min(n as usize - 1);
        high[axis] = (low[axis] + 1).min(n as usize - 1);
        f[axis] = x - low[axis] as f32;
    }
    let (w, h) = (grid.size[0] as usize, grid.size[1] as usize);
    let row = |y: usize, z: usize| {
        let at = (z * h + y) * w;
        let (a, b) = (value(grid, at + low[0]), value(grid, at + high[0]));
        a + (b - a) * f[0]
    };
    let plane = |z: usize| {
        let (a, b) = (row(low[1], z), row(high[1], z));
        a + (b - a) * f[1]
    };
    let (a, b) = (plane(low[2]), plane(high[2]));
    a + (b - a) * f[2]
}

/// Largest value by channel that a lookup in a block can give.
fn largest(grid: &Grid, block: [u32; 3], blocks: [u32; 3]) -> Rgb {
    let range = |axis: usize| {
        let n = grid.size[axis] as f32;
        let scale = n / blocks[axis] as f32;
        // The cells whose centres are within one of the block.
        let from = (block[axis] as f32 * scale - 0.5).floor().max(0.0) as usize;
        let to = ((block[axis] + 1) as f32 * scale - 0.5).ceil() as usize;
        (
            from.saturating_sub(1),
            (to + 1).min(grid.size[axis] as usize - 1),
        )
    };
    let (x, y, z) = (range(0), range(1), range(2));
    let mut most = Rgb::ZERO;
    for k in z.0..=z.1 {
        for j in y.0..=y.1 {
            for i in x.0..=x.1 {
                let index = (k * grid.size[1] as usize + j) * grid.size[0] as usize + i;
                most = most.max(value(grid, index));
            }
        }
    }
    most
}
