//! Packets: eight rays that run much the same way go down the tree together.
//!
//! The boxes of a node are met by all rays of a packet at once, by intervals: `Bundle::boxes` bounds where any of
//! them enters and leaves. What passes is tested against each ray with the very operations of the single
//! kernel, so a leaf is visited for the rays that visit it alone, and for no others. In leaves a triangle is tested
//! against eight rays, with the roundings of the kernel's test. Where hardly a ray of a packet is left, it goes
//! on alone.

#![allow(
    clippy::needless_range_loop,
    reason = "a lane is a place in several arrays at once"
)]

use super::Geometry;
use super::kernel::{self, Aim, FAR_SLACK, OTHERS, Walk};
use super::node::{EMPTY, INDEX_MASK, LEAF, LeafKind, Node, Tree, TriBlock, leaf_kind};
use super::simd::{self, Lanes, Simd, Stack};
use crate::ray::{Hit, NONE, Ray};

/// Rays of a packet.
pub const RAYS: usize = 8;

/// Rays from which on a part of a packet is worth its lanes.
const WORTH: u32 = 2;

/// The same where a block of triangles is tested.
const WORTH_LEAF: u32 = 4;

/// Parts that go on alone from which on a packet has fallen apart.
const APART: u32 = 12;

/// Eights that are no packets after one that fell apart: their neighbours would, too.
const REST: u32 = 7;

/// All rays of a packet, a bit each.
const ALL: u32 = 0xff;

/// Whose rays a packet consists of, and where they are traced.
#[derive(Clone, Copy)]
pub struct Place<'a> {
    /// The scene.
    pub geometry: &'a Geometry,
    /// World or group.
    pub tree: &'a Tree,
    /// Of the group, or [`NONE`].
    pub instance: u32,
    /// The rays in the space of the tree.
    pub rays: &'a [Ray; RAYS],
    /// The rays in the world.
    pub world: &'a [Ray; RAYS],
}

impl<'a> Place<'a> {
    /// What one of the rays is about.
    #[inline(always)]
    fn walk(&self, lane: usize) -> Walk<'a> {
        Walk {
            geometry: self.geometry,
            tree: self.tree,
            instance: self.instance,
            origin: self.rays[lane].origin,
            direction: self.rays[lane].direction,
            ray: &self.world[lane],
        }
    }
}

/// [`kernel::closest_many`], by packets where rays run alike.
#[inline(always)]
pub fn closest<S: Simd>(geometry: &Geometry, rays: &[Ray], hits: &mut [Hit], in_flight: bool) {
    let hits = &mut hits[..rays.len()];
    // Rays that are in no packet go together: the longer an array, the better.
    let mut begin = 0;
    let mut resting = 0;
    let mut at = 0;
    while let (Some(eight), Some(found)) = (rays[at..].first_chunk(), hits[at..].first_chunk_mut())
    {
        if resting > 0 {
            resting -= 1;
        } else if let Some(mut bundle) = Bundle::<S>::new(eight, ALL) {
            for lane in 0..RAYS {
                found[lane] = Hit::none(eight[lane].t_max);
            }
            let place = Place {
                geometry,
                tree: &geometry.world,
                instance: NONE,
                rays: eight,
                world: eight,
            };
            // A ray alone waits for memory, those in flight do not.
            let alone = walk(&place, &mut bundle, ALL, found);
            if in_flight && alone >= APART {
                resting = REST;
            }
            if begin < at {
                let (rays, hits) = (&rays[begin..at], &mut hits[begin..at]);
                simd::closest_many(geometry.level, geometry, rays, hits, in_flight);
            }
            begin = at + RAYS;
        }
        at += RAYS;
    }
    if begin < rays.len() {
        let (rays, hits) = (&rays[begin..], &mut hits[begin..]);
        simd::closest_many(geometry.level, geometry, rays, hits, in_flight);
    }
}

/// The rays of a mask through a group, if they are a packet there; whether they are.
#[inline(always)]
pub fn closest_in_group<S: Simd>(group: &Place, mask: u32, hits: &mut [Hit; RAYS]) -> bool {
    let Some(mut bundle) = Bundle::<S>::new(group.rays, mask) else {
        return false;
    };
    walk(group, &mut bundle, mask, hits);
    true
}

/// Rays whose directions have the same signs and are longest along the same axis, as lanes.
struct Bundle<S: Simd> {
    /// See [`Aim`]; rows over the rays.
    origin: [[f32; RAYS]; 3],
    inverse: [[f32; RAYS]; 3],
    far: [[f32; RAYS]; 3],
    near: [u32; 3],
    axes: [u32; 3],
    start: [[f32; RAYS]; 3],
    shear: [[f32; RAYS]; 3],
    /// The closest hits so far; that of a ray which takes no part is behind it.
    t: [f32; RAYS],
    /// The same times [`FAR_SLACK`].
    end: S::F8,
    /// The latest of those.
    last: f32,
    /// What the rays' numbers lie between, by axis.
    span: [Span<S>; 3],
}

/// Bounds along an axis, in every lane.
#[derive(Clone, Copy)]
struct Span<S: Simd> {
    /// The origin from which a near bound is entered first.
    first: S::F8,
    /// The origin from which a far bound is left last.
    last: S::F8,
    /// Least and greatest inverse.
    inverse: [S::F8; 2],
    /// The same with the slack.
    far: [S::F8; 2],
}

impl<S: Simd> Bundle<S> {
    /// Of the rays of a mask (the others have to be there, but take no part), unless they run too differently.
    #[inline(always)]
    fn new(rays: &[Ray; RAYS], mask: u32) -> Option<Bundle<S>> {
        let rows: &[[f32; 8]; RAYS] = bytemuck::cast_ref(rays);
        // Rays have eight numbers: least and greatest of all kinds at a time.
        let (mut least, mut most) = (S::F8::load(&rows[0]), S::F8::load(&rows[0]));
        let limits = S::F8::load(&[
            f32::MAX,
            f32::MAX,
            f32::MAX,
            f32::MAX,
            f32::MAX,
            f32::MAX,
            f32::INFINITY,
            f32::INFINITY,
        ]);
        // Infinities and NaN are left to the single kernel: bounds mean nothing there.
        let mut sound = least.abs().le(limits);
        for lane in 1..RAYS {
            let row = S::F8::load(&rows[lane]);
            least = least.min(row);
            most = most.max(row);
            sound &= row.abs().le(limits);
        }
        if sound != ALL {
            return None;
        }
        let (least, most) = (least.store(), most.store());
        let mut origin = [[0.0; RAYS]; 3];
        let mut direction = [[0.0; RAYS]; 3];
        let mut t = [0.0; RAYS];
        for lane in 0..RAYS {
            let row = &rows[lane];
            for axis in 0..3 {
                origin[axis][lane] = row[axis];
                direction[axis][lane] = row[3 + axis];
            }
            t[lane] = row[6];
        }
        if mask != ALL {
            for lane in 0..RAYS {
                if mask >> lane & 1 == 0 {
                    t[lane] = f32::NEG_INFINITY;
                }
            }
        }
        let x = S::F8::load(&direction[0]).abs();
        let y = S::F8::load(&direction[1]).abs();
        let z = S::F8::load(&direction[2]).abs();
        let along_x = !(x.le(y) | x.le(z)) & ALL;
        let along_y = !(y.le(z) | along_x) & ALL;
        let kz = if along_x == ALL {
            0
        } else if along_y == ALL {
            1
        } else if along_x | along_y == 0 {
            2
        } else {
            return None;
        };
        let [kx, ky] = OTHERS[kz];
        let (zero, one, slack) = (
            S::F8::splat(0.0),
            S::F8::splat(1.0),
            S::F8::splat(FAR_SLACK),
        );
        let tiny = S::F8::splat(kernel::TINY);
        let along = S::F8::load(&direction[kz]);
        let shear = [
            S::F8::load(&direction[kx]).div(along).store(),
            S::F8::load(&direction[ky]).div(along).store(),
            one.div(along).store(),
        ];
        let mut near = [0; 3];
        let mut inverse = [[0.0; RAYS]; 3];
        let mut far = [[0.0; RAYS]; 3];
        let mut span = [Span {
            first: zero,
            last: zero,
            inverse: [zero; 2],
            far: [zero; 2],
        }; 3];
        for axis in 0..3 {
            let mut d = S::F8::load(&direction[axis]);
            if tiny.le(d.abs()) != ALL {
                for lane in 0..RAYS {
                    direction[axis][lane] = kernel::safe(direction[axis][lane]);
                }
                d = S::F8::load(&direction[axis]);
            }
            let negative = d.le(zero);
            if negative != 0 && negative != ALL {
                return None;
            }
            near[axis] = 64 * axis as u32 + 32 * (negative & 1);
            let i = one.div(d);
            inverse[axis] = i.store();
            far[axis] = i.mul(slack).store();
            // What is rounded stays in order: these are the least and the greatest of the rows.
            let least_inverse = S::F8::splat(1.0 / kernel::safe(most[3 + axis]));
            let most_inverse = S::F8::splat(1.0 / kernel::safe(least[3 + axis]));
            let (first, last) = if negative == 0 {
                (most[axis], least[axis])
            } else {
                (least[axis], most[axis])
            };
            span[axis] = Span {
                first: S::F8::splat(first),
                last: S::F8::splat(last),
                inverse: [least_inverse, most_inverse],
                far: [least_inverse.mul(slack), most_inverse.mul(slack)],
            };
        }
        let mut bundle = Bundle {
            start: [origin[kx], origin[ky], origin[kz]],
            origin,
            inverse,
            far,
            near,
            axes: [16 * kx as u32, 16 * ky as u32, 16 * kz as u32],
            shear,
            t,
            end: zero,
            last: 0.0,
            span,
        };
        bundle.shorten();
        Some(bundle)
    }

    /// After a change of `t`.
    #[inline(always)]
    fn shorten(&mut self) {
        self.end = S::F8::load(&self.t).mul(S::F8::splat(FAR_SLACK));
        let mut last = self.t[0];
        for lane in 1..RAYS {
            last = if last < self.t[lane] {
                self.t[lane]
            } else {
                last
            };
        }
        self.last = last * FAR_SLACK;
    }

    /// Where at the earliest a ray enters the boxes of a node's children, and where at the latest one leaves them.
    ///
    /// No ray enters earlier: let o be its origin along an axis and i its inverse, both within the span. With i > 0
    /// the difference to the greatest origin is at most the one to o, with i < 0 that to the least is at least the
    /// one to o; either way that difference a gives a i <= (bound - o) i, and a i is at least the less of the
    /// products of a with both ends of the inverses. All of it also holds of the rounded numbers, as rounding
    /// keeps order, and as well of maxima over the axes. Leaving is its mirror image.
    #[inline(always)]
    fn boxes(&self, node: &Node) -> (S::F8, S::F8) {
        let [nx, ny, nz] = self.near;
        let [x, y, z] = &self.span;
        let enter = x
            .enter(node, nx)
            .max(y.enter(node, ny))
            .max(z.enter(node, nz).max(S::F8::splat(0.0)));
        let leave = x
            .leave(node, nx ^ 32)
            .min(y.leave(node, ny ^ 32))
            .min(z.leave(node, nz ^ 32).min(S::F8::splat(self.last)));
        (enter, leave)
    }

    /// Which rays meet the box of a child, by the operations of [`kernel::boxes`].
    #[inline(always)]
    fn meet(&self, node: &Node, child: usize) -> u32 {
        let [nx, ny, nz] = self.near;
        let enter = self
            .slab(node, nx, child, 0, &self.inverse)
            .max(self.slab(node, ny, child, 1, &self.inverse))
            .max(
                self.slab(node, nz, child, 2, &self.inverse)
                    .max(S::F8::splat(0.0)),
            );
        let leave = self
            .slab(node, nx ^ 32, child, 0, &self.far)
            .min(self.slab(node, ny ^ 32, child, 1, &self.far))
            .min(self.slab(node, nz ^ 32, child, 2, &self.far).min(self.end));
        enter.le(leave)
    }

    #[inline(always)]
    fn slab(
        &self,
        node: &Node,
        bound: u32,
        child: usize,
        axis: usize,
        inverse: &[[f32; RAYS]; 3],
    ) -> S::F8 {
        S::F8::splat(simd::row(node, bound)[child & 7])
            .sub(S::F8::load(&self.origin[axis]))
            .mul(S::F8::load(&inverse[axis]))
    }

    /// One of the rays.
    #[inline(always)]
    fn aim(&self, lane: usize) -> Aim {
        Aim {
            rest: [0; 3],
            origin: column(&self.origin, lane),
            inverse: column(&self.inverse, lane),
            far: column(&self.far, lane),
            near: self.near,
            axes: self.axes,
            start: column(&self.start, lane),
            shear: column(&self.shear, lane),
        }
    }

    #[inline(always)]
    fn corner(&self, block: &TriBlock, corner: usize, lane: usize) -> (S::F8, S::F8, S::F8) {
        let [kx, ky, kz] = self.axes;
        let lane = lane & 3;
        let z = S::F8::splat(simd::coordinate(block, corner, kz)[lane]);
        let x = S::F8::splat(simd::coordinate(block, corner, kx)[lane]);
        let y = S::F8::splat(simd::coordinate(block, corner, ky)[lane]);
        let z = z.sub(S::F8::load(&self.start[2]));
        let x = x.sub(S::F8::load(&self.start[0]));
        let y = y.sub(S::F8::load(&self.start[1]));
        (
            x.sub(S::F8::load(&self.shear[0]).mul(z)),
            y.sub(S::F8::load(&self.shear[1]).mul(z)),
            z,
        )
    }

    /// Tests the triangles of a block, one after the other, against the rays of a mask. The operations are those of
    /// the kernel, a ray in each lane instead of a triangle.
    #[inline(always)]
    fn triangles(&mut self, at: &Place, block: &TriBlock, rays: u32, hits: &mut [Hit; RAYS]) {
        for lane in 0..4 {
            let prim = block.prims[lane];
            if prim == NONE {
                continue;
            }
            let (ax, ay, az) = self.corner(block, 0, lane);
            let (bx, by, bz) = self.corner(block, 1, lane);
            let (cx, cy, cz) = self.corner(block, 2, lane);
            let u = cx.mul(by).sub(cy.mul(bx));
            let v = ax.mul(cy).sub(ay.mul(cx));
            let w = bx.mul(ay).sub(by.mul(ax));
            let zero = S::F8::splat(0.0);
            let inside = rays & (zero.le(u.min(v).min(w)) | u.max(v).max(w).le(zero));
            if inside == 0 {
                continue;
            }
            let det = u.add(v).add(w);
            let t = u
                .mul(az)
                .add(v.mul(bz))
                .add(w.mul(cz))
                .mul(S::F8::load(&self.shear[2]))
                .div(det);
            let mut mask = inside & t.le(S::F8::load(&self.t)) & !t.le(zero);
            if mask == 0 {
                continue;
            }
            let (t, u, v) = (t.store(), v.div(det).store(), w.div(det).store());
            while mask != 0 {
                let ray = kernel::lowest(&mut mask);
                let hit = &mut hits[ray];
                kernel::offer::<false>(&at.walk(ray), prim, t[ray], u[ray], v[ray], hit);
                self.t[ray] = hit.t;
            }
        }
    }
}

#[inline(always)]
fn column(rows: &[[f32; RAYS]; 3], lane: usize) -> [f32; 3] {
    let lane = lane & 7;
    [rows[0][lane], rows[1][lane], rows[2][lane]]
}

impl<S: Simd> Span<S> {
    #[inline(always)]
    fn enter(&self, node: &Node, bound: u32) -> S::F8 {
        let a = S::F8::load(simd::row(node, bound)).sub(self.first);
        a.mul(self.inverse[0]).min(a.mul(self.inverse[1]))
    }
    #[inline(always)]
    fn leave(&self, node: &Node, bound: u32) -> S::F8 {
        let a = S::F8::load(simd::row(node, bound)).sub(self.last);
        a.mul(self.far[0]).max(a.mul(self.far[1]))
    }
}

/// An entry of the stack: which rays meet a box takes the place of the last bits of where it is entered, which
/// makes that only earlier.
#[inline(always)]
fn entry(word: u32, t: f32, rays: u32) -> u64 {
    simd::entry(word, t) & !((ALL as u64) << 32) | (rays as u64) << 32
}

/// Through a tree; how often a ray went on alone.
#[inline(always)]
fn walk<S: Simd>(at: &Place, bundle: &mut Bundle<S>, rays: u32, hits: &mut [Hit; RAYS]) -> u32 {
    let tree = at.tree;
    let mut alone = 0;
    if tree.root == EMPTY {
        return alone;
    }
    let is_large = kernel::is_large(tree);
    let mut items = simd::stack_items();
    let mut stack = Stack::new(&mut items);
    let (mut word, mut rays) = (tree.root, rays);
    let mut limit = u64::MAX;
    loop {
        if word & LEAF == 0 && rays.count_ones() >= WORTH {
            let node = &tree.nodes[word as usize];
            let (enter, leave) = bundle.boxes(node);
            let mut mask = enter.le(leave);
            let t = enter.store();
            // The nearest child so far is kept at hand: often it is the only one.
            let from = stack.height();
            let mut nearest = u64::MAX;
            while mask != 0 {
                let child = kernel::lowest(&mut mask);
                let some = bundle.meet(node, child) & rays;
                if some == 0 {
                    continue;
                }
                let next = node.children[child];
                kernel::prefetch::<S>(tree, is_large, next);
                let next = entry(next, t[child], some);
                if nearest != u64::MAX {
                    stack.push(nearest.max(next));
                }
                nearest = nearest.min(next);
            }
            if nearest != u64::MAX {
                stack.sort_from(from);
                word = nearest as u32;
                rays = (nearest >> 32) as u32 & ALL;
                continue;
            }
        } else {
            alone += (word & LEAF == 0) as u32;
            visit(at, bundle, word, rays, hits);
            bundle.shorten();
            // What begins behind the farthest of the closest hits cannot hold a closer one.
            limit = entry(u32::MAX, bundle.last, 0) | (ALL as u64) << 32;
        }
        loop {
            match stack.pop() {
                None => return alone,
                Some(next) => {
                    if next <= limit {
                        word = next as u32;
                        rays = (next >> 32) as u32 & ALL;
                        break;
                    }
                }
            }
        }
    }
}

/// Tests what a leaf holds, or sends the rays of a mask on alone.
#[inline(always)]
fn visit<S: Simd>(
    at: &Place,
    bundle: &mut Bundle<S>,
    word: u32,
    rays: u32,
    hits: &mut [Hit; RAYS],
) {
    let index = (word & INDEX_MASK) as usize;
    let (is_leaf, kind) = (word & LEAF != 0, leaf_kind(word));
    if is_leaf && kind == LeafKind::Triangles as u32 {
        return blocks(at, bundle, &at.tree.blocks[index..index + 1], rays, hits);
    }
    if is_leaf && kind == LeafKind::Pair as u32 {
        return blocks(at, bundle, &at.tree.blocks[index..index + 2], rays, hits);
    }
    let is_group = is_leaf && kind == LeafKind::Instance as u32;
    let is_done = is_group && rays.count_ones() >= WORTH && instance(at, index, rays, hits);
    let mut mask = rays;
    while mask != 0 {
        let ray = kernel::lowest(&mut mask);
        let hit = &mut hits[ray];
        if !is_done {
            let (walk, aim) = (at.walk(ray), bundle.aim(ray));
            simd::closest_below(at.geometry.level, &walk, &aim, word, hit);
        }
        bundle.t[ray] = hit.t;
    }
}

/// Blocks of triangles: those against rays if there are enough of them, else a ray against those.
#[inline(always)]
fn blocks<S: Simd>(
    at: &Place,
    bundle: &mut Bundle<S>,
    blocks: &[TriBlock],
    rays: u32,
    hits: &mut [Hit; RAYS],
) {
    for block in blocks {
        if rays.count_ones() >= WORTH_LEAF {
            bundle.triangles(at, block, rays, hits);
            continue;
        }
        let mut mask = rays;
        while mask != 0 {
            let ray = kernel::lowest(&mut mask);
            let (walk, aim, hit) = (at.walk(ray), bundle.aim(ray), &mut hits[ray]);
            kernel::triangles::<S, false>(&walk, block, &aim, hit);
            bundle.t[ray] = hit.t;
        }
    }
}

/// Through a placed group, if rays are a packet there; whether they are.
#[inline(never)]
fn instance(at: &Place, index: usize, rays: u32, hits: &mut [Hit; RAYS]) -> bool {
    let instance = at.tree.instances[index];
    let placed = &at.geometry.instances[instance as usize];
    let of = |lane: usize| {
        let ray = &at.rays[lane];
        let (_, from) = placed.placement.at(ray.time);
        Ray {
            origin: from.point(ray.origin),
            direction: from.vector(ray.direction),
            t_max: hits[lane].t,
            time: ray.time,
        }
    };
    // Whoever takes no part repeats one who does, so that it widens no bounds.
    let mut local = [of(rays.trailing_zeros() as usize & 7); RAYS];
    for lane in 0..RAYS {
        if rays >> lane & 1 != 0 {
            local[lane] = of(lane);
        }
    }
    let group = Place {
        tree: &at.geometry.groups[placed.group as usize],
        instance,
        rays: &local,
        ..*at
    };
    simd::closest_packet_in_group(at.geometry.level, &group, rays, hits)
}

#[cfg(test)]
mod tests;
