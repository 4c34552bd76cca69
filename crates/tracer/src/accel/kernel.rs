//! Traversal: an 8-wide tree with blocks of four triangles in its leaves.
//!
//! Generic over [`Simd`]; every level gives the same bits (tested). The triangle test is the
//! watertight one of [Woop13]. It needs no fallback to double precision here because a zero counts as
//! inside. The closest hit is the smallest (t, instance, primitive), whatever order the tree is
//! visited in.

use super::Geometry;
use super::aim::Ahead;
use super::node::{BallBlock, EMPTY, INDEX_MASK, LEAF, LeafKind, Node, Tree, TriBlock, leaf_kind};
use super::simd::{self, Lanes, Simd, Stack};
use super::stream;
use crate::ray::{Hit, NONE, Ray};
use glam::Vec3;

/// Slack on the far side of a box. With u = 2^-24, the distance to a near side is rounded by at most 3 u
/// (difference, inverse, product), that to a far one by 4 u (the inverse has been multiplied by the slack), so
/// anything above 7 u lets no ray through between a box and itself; the rest is for the triangle's own
/// distance.
pub const FAR_SLACK: f32 = 1.0 + 8.0 * f32::EPSILON;

/// The least component of a direction that is taken as it is.
pub const TINY: f32 = 1e-18;

/// The two axes after an axis, in order.
pub static OTHERS: [[usize; 2]; 3] = [[1, 2], [2, 0], [0, 1]];

/// A ray certainly passes a sphere by where the square of b, what is along the ray of the way to the centre, stays
/// below a c, c being the square of the whole way without that of the radius, by more than all roundings: each is
/// at most 2^-24 of a term, and 2^-16 of all terms is as much as 256 of them.
pub const PASSING: f32 = 1.0 / 65_536.0;

/// Blocks of a tree that no longer fits the cache next to a core: nodes are then asked for before they are
/// visited. On smaller ones that is wasted work.
const LARGE: usize = 4096;

/// A ray as the kernel wants it.
#[derive(Clone, Copy, Debug, PartialEq, bytemuck::Pod, bytemuck::Zeroable)]
#[repr(C, align(32))]
pub struct Aim {
    /// Start, by axis.
    pub origin: [f32; 3],
    /// Of the direction, never infinite.
    pub inverse: [f32; 3],
    /// The same times [`FAR_SLACK`].
    pub far: [f32; 3],
    /// Where in a node the near bounds are, in bytes, by axis.
    pub near: [u32; 3],
    /// The axes x, y, z as the triangle test wants them, z the longest component of the direction: where they are
    /// among the coordinates of a corner, in bytes.
    pub axes: [u32; 3],
    /// Start, by these axes.
    pub start: [f32; 3],
    /// What makes the ray run along z.
    pub shear: [f32; 3],
    /// Fills three rows.
    pub rest: [u32; 3],
}

impl Aim {
    /// Of a ray.
    #[inline(always)]
    pub fn new<S: Simd>(origin: Vec3, direction: Vec3) -> Self {
        let (o, r) = (origin.to_array(), direction.to_array());
        let kz = if r[0].abs() > r[1].abs() && r[0].abs() > r[2].abs() {
            0
        } else if r[1].abs() > r[2].abs() {
            1
        } else {
            2
        };
        let [kx, ky] = OTHERS[kz];
        let d = [safe(r[0]), safe(r[1]), safe(r[2]), 1.0];
        let inverse = S::F4::splat(1.0).div(S::F4::load(&d));
        let far = inverse.mul(S::F4::splat(FAR_SLACK)).store();
        let inverse = inverse.store();
        let shear = S::F4::load(&[r[kx], r[ky], 1.0, 1.0])
            .div(S::F4::splat(r[kz]))
            .store();
        Aim {
            origin: o,
            inverse: [inverse[0], inverse[1], inverse[2]],
            far: [far[0], far[1], far[2]],
            near: [
                32 * (d[0] < 0.0) as u32,
                64 + 32 * (d[1] < 0.0) as u32,
                128 + 32 * (d[2] < 0.0) as u32,
            ],
            axes: [16 * kx as u32, 16 * ky as u32, 16 * kz as u32],
            start: [o[kx], o[ky], o[kz]],
            shear: [shear[0], shear[1], shear[2]],
            rest: [0; 3],
        }
    }
}

/// A component of zero would make 0 x infinity; a tiny one gives a slab that is never left.
#[inline(always)]
pub fn safe(x: f32) -> f32 {
    if x.abs() < TINY { TINY.copysign(x) } else { x }
}

/// Where a ray enters the boxes of a node's children, and where it leaves them, t at the
/// latest: those are hit that it leaves not before it enters them.
#[inline(always)]
pub fn boxes<S: Simd>(node: &Node, aim: &Aim, t: f32) -> (S::F8, S::F8) {
    let [nx, ny, nz] = aim.near;
    let enter = slab::<S>(node, nx, aim.origin[0], aim.inverse[0])
        .max(slab::<S>(node, ny, aim.origin[1], aim.inverse[1]))
        .max(slab::<S>(node, nz, aim.origin[2], aim.inverse[2]).max(S::F8::splat(0.0)));
    let leave = slab::<S>(node, nx ^ 32, aim.origin[0], aim.far[0])
        .min(slab::<S>(node, ny ^ 32, aim.origin[1], aim.far[1]))
        .min(slab::<S>(node, nz ^ 32, aim.origin[2], aim.far[2]).min(S::F8::splat(t * FAR_SLACK)));
    (enter, leave)
}

#[inline(always)]
fn slab<S: Simd>(node: &Node, bound: u32, origin: f32, inverse: f32) -> S::F8 {
    S::F8::load(simd::row(node, bound))
        .sub(S::F8::splat(origin))
        .mul(S::F8::splat(inverse))
}

/// Numbers of a scattering event, compiled for a level so that its lanes are used.
#[inline(always)]
pub fn four_pairs<S: Simd>(reversed: u32, key: u64) -> [glam::Vec2; 4] {
    crate::sampler::sobol::four_pairs(reversed, key)
}

/// What a walk through a tree is about.
#[derive(Clone, Copy)]
pub struct Walk<'a> {
    /// The scene.
    pub geometry: &'a Geometry,
    /// World or group.
    pub tree: &'a Tree,
    /// Of the group, or [`NONE`].
    pub instance: u32,
    /// The ray in the space of the tree.
    pub origin: Vec3,
    /// See `origin`.
    pub direction: Vec3,
    /// The ray in the world.
    pub ray: &'a Ray,
}

impl<'a> Walk<'a> {
    /// Through the world.
    #[inline(always)]
    pub fn world(geometry: &'a Geometry, ray: &'a Ray) -> Self {
        Walk {
            geometry,
            tree: &geometry.world,
            instance: NONE,
            origin: ray.origin,
            direction: ray.direction,
            ray,
        }
    }
}

/// Closest hit of a ray with everything.
#[inline(always)]
pub fn closest<S: Simd>(geometry: &Geometry, ray: &Ray, hit: &mut Hit) {
    walk::<S, false>(&Walk::world(geometry, ray), hit);
}

/// Whether anything is hit before the ray's end.
#[inline(always)]
pub fn occluded<S: Simd>(geometry: &Geometry, ray: &Ray) -> bool {
    let mut hit = Hit::none(ray.t_max);
    walk::<S, true>(&Walk::world(geometry, ray), &mut hit)
}

/// [`closest`] for many rays, one after the other or several in flight.
#[inline(always)]
pub fn closest_many<S: Simd>(geometry: &Geometry, rays: &[Ray], hits: &mut [Hit], in_flight: bool) {
    if in_flight {
        return stream::many::<S, false>(geometry, rays, hits, &mut []);
    }
    let mut ahead = Ahead::new(geometry.level, rays);
    for (index, (ray, hit)) in rays.iter().zip(hits).enumerate() {
        *hit = Hit::none(ray.t_max);
        walk_along::<S, false>(&Walk::world(geometry, ray), ahead.aim::<S>(index), hit);
    }
}

/// [`occluded`] for many rays, one after the other or several in flight.
#[inline(always)]
pub fn occluded_many<S: Simd>(
    geometry: &Geometry,
    rays: &[Ray],
    blocked: &mut [bool],
    in_flight: bool,
) {
    if in_flight {
        return stream::many::<S, true>(geometry, rays, &mut [], blocked);
    }
    let mut ahead = Ahead::new(geometry.level, rays);
    for (index, (ray, blocked)) in rays.iter().zip(blocked).enumerate() {
        let mut hit = Hit::none(ray.t_max);
        *blocked =
            walk_along::<S, true>(&Walk::world(geometry, ray), ahead.aim::<S>(index), &mut hit);
    }
}

/// [`closest`] within a group.
#[inline(always)]
pub fn closest_in_group<S: Simd>(group: &Walk, hit: &mut Hit) -> bool {
    walk::<S, false>(group, hit)
}

/// [`occluded`] within a group.
#[inline(always)]
pub fn occluded_in_group<S: Simd>(group: &Walk, hit: &mut Hit) -> bool {
    walk::<S, true>(group, hit)
}

/// [`closest`] below a word of a tree; the aim is that of the walk.
#[inline(always)]
pub fn closest_below<S: Simd>(at: &Walk, aim: &Aim, word: u32, hit: &mut Hit) {
    walk_below::<S, false>(at, aim, word, hit);
}

/// Whether nodes are worth being asked for before they are visited.
#[inline(always)]
pub fn is_large(tree: &Tree) -> bool {
    tree.blocks.len() >= LARGE
}

/// Through a tree; whether anything blocks, if `ANY`.
#[inline(always)]
fn walk<S: Simd, const ANY: bool>(at: &Walk, hit: &mut Hit) -> bool {
    if at.tree.root == EMPTY {
        return false;
    }
    let aim = Aim::new::<S>(at.origin, at.direction);
    walk_below::<S, ANY>(at, &aim, at.tree.root, hit)
}

/// The same with the aim of the ray.
#[inline(always)]
fn walk_along<S: Simd, const ANY: bool>(at: &Walk, aim: &Aim, hit: &mut Hit) -> bool {
    if at.tree.root == EMPTY {
        return false;
    }
    walk_below::<S, ANY>(at, aim, at.tree.root, hit)
}

/// Through what is below a word of a tree.
#[inline(always)]
fn walk_below<S: Simd, const ANY: bool>(at: &Walk, aim: &Aim, word: u32, hit: &mut Hit) -> bool {
    let tree = at.tree;
    let is_large = is_large(tree);
    let mut items = simd::stack_items();
    let mut stack = Stack::new(&mut items);
    let mut word = word;
    // What begins behind the closest hit cannot hold a closer one.
    let mut limit = simd::entry(u32::MAX, hit.t * FAR_SLACK);
    loop {
        if word & LEAF == 0 {
            let node = &tree.nodes[word as usize];
            let (enter, leave) = boxes::<S>(node, aim, hit.t);
            let mut mask = enter.le(leave);
            if mask != 0 {
                let first = lowest(&mut mask);
                if mask == 0 {
                    word = node.children[first];
                    continue;
                }
                if ANY {
                    while mask != 0 {
                        let next = node.children[lowest(&mut mask)];
                        prefetch::<S>(tree, is_large, next);
                        stack.push(next as u64);
                    }
                    word = node.children[first];
                    continue;
                }
                let t = enter.store();
                let second = lowest(&mut mask);
                prefetch::<S>(tree, is_large, node.children[first]);
                prefetch::<S>(tree, is_large, node.children[second]);
                let a = simd::entry(node.children[first], t[first]);
                let b = simd::entry(node.children[second], t[second]);
                let (near, far) = (a.min(b), a.max(b));
                if mask == 0 {
                    stack.push(far);
                    word = near as u32;
                    continue;
                }
                let third = lowest(&mut mask);
                prefetch::<S>(tree, is_large, node.children[third]);
                let c = simd::entry(node.children[third], t[third]);
                if mask == 0 {
                    let (middle, far) = (far.min(c), far.max(c));
                    stack.push(far);
                    stack.push(near.max(middle));
                    word = near.min(middle) as u32;
                    continue;
                }
                let from = stack.height();
                stack.push(far);
                stack.push(near);
                stack.push(c);
                while mask != 0 {
                    let next = lowest(&mut mask);
                    prefetch::<S>(tree, is_large, node.children[next]);
                    stack.push(simd::entry(node.children[next], t[next]));
                }
                stack.sort_from(from);
            }
        } else {
            let found = visit_leaf::<S, ANY>(at, aim, word, hit);
            if ANY && found {
                return true;
            }
            limit = simd::entry(u32::MAX, hit.t * FAR_SLACK);
        }
        loop {
            match stack.pop() {
                None => return false,
                Some(next) => {
                    if ANY || next <= limit {
                        word = next as u32;
                        break;
                    }
                }
            }
        }
    }
}

/// Takes the lowest of the lanes out of a mask.
#[inline(always)]
pub fn lowest(mask: &mut u32) -> usize {
    let lane = mask.trailing_zeros() as usize & 7;
    *mask &= *mask - 1;
    lane
}

/// Tests what a leaf holds; whether it blocks.
#[inline(always)]
pub fn visit_leaf<S: Simd, const ANY: bool>(
    at: &Walk,
    aim: &Aim,
    word: u32,
    hit: &mut Hit,
) -> bool {
    let index = (word & INDEX_MASK) as usize;
    let kind = leaf_kind(word);
    // Whatever is not a block of triangles stays out of this function, which has no register to spare.
    if kind == LeafKind::Triangles as u32 {
        triangles::<S, ANY>(at, &at.tree.blocks[index], aim, hit)
    } else if kind == LeafKind::Pair as u32 {
        triangles::<S, ANY>(at, &at.tree.blocks[index], aim, hit)
            || triangles::<S, ANY>(at, &at.tree.blocks[index + 1], aim, hit)
    } else if kind == LeafKind::Balls as u32 {
        balls::<S, ANY>(at, &at.tree.balls[index], hit)
    } else if kind == LeafKind::Deforming as u32 {
        let block = deformed(at, index);
        triangles::<S, ANY>(at, &block, aim, hit)
    } else {
        other_leaf::<ANY>(at, word, hit)
    }
}

/// Asks the cache for a node or a block of triangles that is visited soon.
#[inline(always)]
pub fn prefetch<S: Simd>(tree: &Tree, is_large: bool, word: u32) {
    if !is_large {
        return;
    }
    if word & LEAF == 0 {
        S::prefetch(tree.nodes.as_ptr().wrapping_add(word as usize));
    } else {
        let index = (word & INDEX_MASK) as usize;
        S::prefetch(tree.blocks.as_ptr().wrapping_add(index));
    }
}

/// A leaf that holds no triangles; whether it blocks.
#[inline(never)]
fn other_leaf<const ANY: bool>(at: &Walk, word: u32, hit: &mut Hit) -> bool {
    // A ray that begins at infinity meets even inverted boxes.
    if word == EMPTY {
        return false;
    }
    let index = (word & INDEX_MASK) as usize;
    let kind = leaf_kind(word);
    if kind == LeafKind::Quadric as u32 {
        return quadric::<ANY>(at, index, hit);
    }
    if kind == LeafKind::Curve as u32 {
        return curve::<ANY>(at, index, hit);
    }
    let instance = at.tree.instances[index];
    let placed = &at.geometry.instances[instance as usize];
    let (_, from) = placed.placement.at(at.ray.time);
    let group = Walk {
        tree: &at.geometry.groups[placed.group as usize],
        instance,
        origin: from.point(at.origin),
        direction: from.vector(at.direction),
        ..*at
    };
    if ANY {
        simd::occluded_in_group(at.geometry.level, &group, hit)
    } else {
        simd::closest_in_group(at.geometry.level, &group, hit)
    }
}

#[cold]
#[inline(never)]
fn deformed(at: &Walk, index: usize) -> TriBlock {
    at.geometry
        .deformed_block(at.tree, at.tree.deforming[index], at.ray.time)
}

#[inline(always)]
fn corner<S: Simd>(block: &TriBlock, corner: usize, aim: &Aim) -> (S::F4, S::F4, S::F4) {
    let ([kx, ky, kz], [ox, oy, oz], [sx, sy, _]) = (aim.axes, aim.start, aim.shear);
    let z = S::F4::load(simd::coordinate(block, corner, kz)).sub(S::F4::splat(oz));
    let x = S::F4::load(simd::coordinate(block, corner, kx)).sub(S::F4::splat(ox));
    let y = S::F4::load(simd::coordinate(block, corner, ky)).sub(S::F4::splat(oy));
    (
        x.sub(S::F4::splat(sx).mul(z)),
        y.sub(S::F4::splat(sy).mul(z)),
        z,
    )
}

/// Tests the triangles of a block; whether one blocks.
#[inline(always)]
pub fn triangles<S: Simd, const ANY: bool>(
    at: &Walk,
    block: &TriBlock,
    aim: &Aim,
    hit: &mut Hit,
) -> bool {
    // Corners relative to the origin, sheared so that the ray runs along z. The same corner gives the
    // same numbers in every triangle that it belongs to.
    let (ax, ay, az) = corner::<S>(block, 0, aim);
    let (bx, by, bz) = corner::<S>(block, 1, aim);
    let (cx, cy, cz) = corner::<S>(block, 2, aim);
    // Rounding is monotone, so a difference of two rounded products never has the wrong sign: at worst
    // it is zero, which counts as inside. That makes edges and corners watertight.
    let u = cx.mul(by).sub(cy.mul(bx));
    let v = ax.mul(cy).sub(ay.mul(cx));
    let w = bx.mul(ay).sub(by.mul(ax));
    let zero = S::F4::splat(0.0);
    let inside = zero.le(u.min(v).min(w)) | u.max(v).max(w).le(zero);
    if inside == 0 {
        return false;
    }
    let det = u.add(v).add(w);
    let t = u
        .mul(az)
        .add(v.mul(bz))
        .add(w.mul(cz))
        .mul(S::F4::splat(aim.shear[2]))
        .div(det);
    // NaN (a ray in the plane, a degenerate triangle) compares false.
    let mut mask = inside & t.le(S::F4::splat(hit.t)) & !t.le(zero);
    if mask == 0 {
        return false;
    }
    let (t, u, v) = (t.store(), v.div(det).store(), w.div(det).store());
    while mask != 0 {
        let lane = mask.trailing_zeros() as usize & 3;
        mask &= mask - 1;
        let taken = offer::<ANY>(at, block.prims[lane], t[lane], u[lane], v[lane], hit);
        if ANY && taken {
            return true;
        }
    }
    false
}

/// Four spheres, with the operations of [`Quadric::intersect`](crate::geometry::quadric::Quadric::intersect).
#[inline(always)]
fn balls<S: Simd, const ANY: bool>(at: &Walk, block: &BallBlock, hit: &mut Hit) -> bool {
    let [cx, cy, cz] = &block.centers;
    let (dx, dy, dz) = (at.direction.x, at.direction.y, at.direction.z);
    let a = S::F4::splat(dx * dx + dy * dy + dz * dz);
    let x = S::F4::splat(at.origin.x).sub(S::F4::load(cx));
    let y = S::F4::splat(at.origin.y).sub(S::F4::load(cy));
    let z = S::F4::splat(at.origin.z).sub(S::F4::load(cz));
    let (dx, dy, dz) = (S::F4::splat(dx), S::F4::splat(dy), S::F4::splat(dz));
    let (zero, square) = (S::F4::splat(0.0), S::F4::load(&block.squares));
    // Not 0 - x, which would lose the sign of a zero.
    let b = x
        .mul(dx)
        .add(y.mul(dy))
        .add(z.mul(dz))
        .mul(S::F4::splat(-1.0));
    let distance2 = x.mul(x).add(y.mul(y)).add(z.mul(z));
    let c = distance2.sub(square);
    // Most rays pass by at a distance that needs no division to be seen.
    let slack = distance2.add(square).mul(a).mul(S::F4::splat(PASSING));
    let near = a.mul(c).le(b.mul(b).add(slack));
    if near == 0 {
        return false;
    }
    let along = b.div(a);
    let lx = x.add(dx.mul(along));
    let ly = y.add(dy.mul(along));
    let lz = z.add(dz.mul(along));
    let discriminant = square.sub(lx.mul(lx).add(ly.mul(ly)).add(lz.mul(lz)));
    let met = zero.le(discriminant);
    if met == 0 {
        return false;
    }
    let q = b.add(discriminant.mul(a).sqrt().copysign(b));
    let (t0, t1) = (c.div(q), q.div(a));
    let near = t0.select_le(t1, t0, t1);
    let far = t0.select_le(t1, t1, t0);
    let end = S::F4::splat(hit.t);
    let in_reach = (near.le(end) & !near.le(zero)) | (far.le(end) & !far.le(zero));
    let mut mask = met & in_reach;
    if mask == 0 {
        return false;
    }
    let (near, far) = (near.store(), far.store());
    while mask != 0 {
        let lane = mask.trailing_zeros() as usize & 3;
        mask &= mask - 1;
        for t in [near[lane], far[lane]] {
            if t > 0.0 && t <= hit.t && offer::<ANY>(at, block.prims[lane], t, 0.0, 0.0, hit) {
                if ANY {
                    return true;
                }
                break;
            }
        }
    }
    false
}

#[inline(always)]
fn quadric<const ANY: bool>(at: &Walk, index: usize, hit: &mut Hit) -> bool {
    let (shape, prim) = &at.tree.quadrics[index];
    let [first, second] = shape.intersect(at.origin, at.direction);
    for t in [first, second] {
        if t > 0.0 && t <= hit.t && offer::<ANY>(at, *prim, t, 0.0, 0.0, hit) {
            return true;
        }
    }
    false
}

#[cold]
#[inline(never)]
fn curve<const ANY: bool>(at: &Walk, index: usize, hit: &mut Hit) -> bool {
    let part = &at.tree.curves[index];
    let set = &at.geometry.curves[part.set as usize];
    let piece = &set.pieces[part.piece as usize];
    match piece.intersect(set.kind, part.range, at.origin, at.direction, hit.t) {
        Some((t, u, v)) => offer::<ANY>(at, part.prim, t, u, v, hit),
        None => false,
    }
}

/// Takes a candidate if it comes before the best so far and its surface is not transparent there.
/// For occlusion: whether it blocks.
#[inline(always)]
pub fn offer<const ANY: bool>(at: &Walk, prim: u32, t: f32, u: f32, v: f32, hit: &mut Hit) -> bool {
    let instance = at.instance;
    let nearer = if ANY {
        t < hit.t
    } else {
        t < hit.t || (t == hit.t && (instance, prim) < (hit.instance, hit.prim))
    };
    if !nearer || prim == NONE {
        return false;
    }
    let candidate = Hit {
        t,
        instance,
        prim,
        u,
        v,
    };
    if at.geometry.has_alpha && !at.geometry.is_solid(at.tree, &candidate, at.ray) {
        return false;
    }
    *hit = candidate;
    true
}
