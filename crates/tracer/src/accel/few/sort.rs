//! Rays in an order in which neighbours run alike.

#![allow(
    clippy::needless_range_loop,
    reason = "a lane is a place in several arrays at once"
)]

use crate::accel::aim::pick;
use crate::lanes::{Float, Row, Wide};

/// Rays that are sorted at a time.
pub const MOST_RAYS: usize = 1024;

/// Rays by the axis along which their directions are longest, as the kernel picks it, and those of an axis by where
/// they run, so that neighbours run alike.
pub struct Sorted {
    at: [u32; MOST_RAYS],
    /// Where those of an axis begin.
    begins: [usize; 4],
}

/// Kinds of directions that are told apart along an axis.
const KINDS: usize = 32;

impl Sorted {
    /// Nothing.
    #[inline(always)]
    pub fn new() -> Sorted {
        Sorted {
            at: [0; MOST_RAYS],
            begins: [0; 4],
        }
    }

    /// Sorts rays by their axes, and those of an axis by their directions if `KIND`.
    #[inline(always)]
    pub fn sort<W: Wide<N>, const N: usize, const KIND: bool>(&mut self, rays: &[Row]) {
        let mut kinds = [0u8; MOST_RAYS];
        for (rays, kinds) in rays.chunks(N).zip(kinds.chunks_mut(N)) {
            let mut at = [rays.len() as u32 - 1; N];
            for lane in 0..rays.len() {
                at[lane] = lane as u32;
            }
            let [_, _, _, dx, dy, dz, _, _] = W::gather(rays, &at);
            let mut of = Row::<N>::default();
            kind::<W, N, KIND>(dx, dy, dz).store(&mut of);
            for lane in 0..N {
                kinds[lane] = of.0[lane] as u8;
            }
        }
        let kinds = &kinds[..rays.len()];
        let mut begins = [0u32; 3 * KINDS + 1];
        for kind in kinds {
            begins[*kind as usize % (3 * KINDS) + 1] += 1;
        }
        for kind in 0..3 * KINDS {
            begins[kind + 1] += begins[kind];
        }
        self.begins = [0, KINDS, 2 * KINDS, 3 * KINDS].map(|kind| begins[kind] as usize);
        for (ray, kind) in kinds.iter().enumerate() {
            let to = &mut begins[*kind as usize % (3 * KINDS)];
            self.at[*to as usize % MOST_RAYS] = ray as u32;
            *to += 1;
        }
    }

    /// Those of an axis.
    #[inline(always)]
    pub fn along(&self, axis: usize) -> &[u32] {
        &self.at[self.begins[axis]..self.begins[axis + 1]]
    }
}

/// Which axis, and where along it.
#[inline(always)]
fn kind<W: Wide<N>, const N: usize, const KIND: bool>(dx: W::F, dy: W::F, dz: W::F) -> W::F {
    let (x, y, z) = (dx.abs(), dy.abs(), dz.abs());
    let along = (y.lt(x) & z.lt(x), z.lt(y));
    let zero = W::F::splat(0.0);
    let (second, third) = (W::F::splat(KINDS as f32), W::F::splat((2 * KINDS) as f32));
    let axis = pick::<W, N>(along, [zero, second, third]);
    if !KIND {
        return axis;
    }
    let main = pick::<W, N>(along, [dx, dy, dz]);
    let a = pick::<W, N>(along, [dy, dz, dx]);
    let b = pick::<W, N>(along, [dz, dx, dy]);
    let half = main.abs() * W::F::splat(0.5);
    axis + W::F::select(main.lt(zero), W::F::splat(16.0), zero)
        + W::F::select(a.lt(zero), W::F::splat(8.0), zero)
        + W::F::select(half.lt(a.abs()), W::F::splat(4.0), zero)
        + W::F::select(b.lt(zero), W::F::splat(2.0), zero)
        + W::F::select(half.lt(b.abs()), W::F::splat(1.0), zero)
}

/// Rays that are too few for lanes: they are left to the tree.
#[derive(Default)]
pub struct Rest {
    at: [u32; 3 * (WORTH - 1)],
    count: usize,
}

/// Rays of a group from which on the lanes are worth it.
pub const WORTH: usize = 4;

impl Rest {
    #[inline(always)]
    pub fn add(&mut self, rays: &[u32]) {
        for &ray in rays {
            self.at[self.count] = ray;
            self.count += 1;
        }
    }

    /// Which rays.
    pub fn rays(&self) -> &[u32] {
        &self.at[..self.count]
    }
}
