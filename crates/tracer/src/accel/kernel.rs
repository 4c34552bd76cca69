//! Traversal: an 8-wide tree with blocks of four triangles in its leaves.
//!
//! Generic over [`Simd`]; every level gives the same bits (tested). The triangle test is the
//! watertight one of [Woop13]. It needs no fallback to double precision here because a zero counts as
//! inside. The closest hit is the smallest (t, instance, primitive), whatever order the tree is
//! visited in.

use super::Geometry;
use super::node::{EMPTY, INDEX_MASK, LEAF, LeafKind, Tree, TriBlock, leaf_kind};
use super::simd::{self, Lanes, Simd, Stack};
use crate::ray::{Hit, NONE, Ray};
use glam::Vec3;

/// Slack on the far side of a box: the entry and exit distances of a slab are rounded three times
/// each, as is a triangle's own distance.
const FAR_SLACK: f32 = 1.000_000_4;

/// The two axes after an axis, in order.
static OTHERS: [[usize; 2]; 3] = [[1, 2], [2, 0], [0, 1]];

/// Blocks of a tree that no longer fits the cache next to a core: nodes are then asked for before they are
/// visited. On smaller ones that is wasted work.
const LARGE: usize = 4096;

/// A ray as the kernel wants it.
struct Walker<S: Simd> {
    origin: [S::F8; 3],
    inverse: [S::F8; 3],
    /// Index of the near bound in [`super::node::Node::bounds`], by axis.
    near: [usize; 3],
    /// Origin and direction as the triangle test wants them: axes x, y, z with z the longest component
    /// of the direction, and the shear that makes the ray run along it.
    axes: [usize; 3],
    o4: [S::F4; 3],
    shear: [S::F4; 3],
}

impl<S: Simd> Walker<S> {
    #[inline(always)]
    fn new(origin: Vec3, direction: Vec3) -> Self {
        // A component of zero would make 0 x infinity; a tiny one gives a slab that is never left.
        let safe = |x: f32| {
            if x.abs() < 1e-18 {
                1e-18f32.copysign(x)
            } else {
                x
            }
        };
        let d = [safe(direction.x), safe(direction.y), safe(direction.z)];
        let (o, r) = (origin.to_array(), direction.to_array());
        let kz = if r[0].abs() > r[1].abs() && r[0].abs() > r[2].abs() {
            0
        } else if r[1].abs() > r[2].abs() {
            1
        } else {
            2
        };
        let [kx, ky] = OTHERS[kz];
        Walker {
            origin: [S::F8::splat(o[0]), S::F8::splat(o[1]), S::F8::splat(o[2])],
            inverse: [
                S::F8::splat(1.0 / d[0]),
                S::F8::splat(1.0 / d[1]),
                S::F8::splat(1.0 / d[2]),
            ],
            near: [
                (d[0] < 0.0) as usize,
                2 + (d[1] < 0.0) as usize,
                4 + (d[2] < 0.0) as usize,
            ],
            axes: [kx, ky, kz],
            o4: [
                S::F4::splat(o[kx]),
                S::F4::splat(o[ky]),
                S::F4::splat(o[kz]),
            ],
            shear: [
                S::F4::splat(r[kx] / r[kz]),
                S::F4::splat(r[ky] / r[kz]),
                S::F4::splat(1.0 / r[kz]),
            ],
        }
    }
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
    fn world(geometry: &'a Geometry, ray: &'a Ray) -> Self {
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

/// [`closest`] for many rays.
#[inline(always)]
pub fn closest_many<S: Simd>(geometry: &Geometry, rays: &[Ray], hits: &mut [Hit]) {
    for (ray, hit) in rays.iter().zip(hits) {
        *hit = Hit::none(ray.t_max);
        walk::<S, false>(&Walk::world(geometry, ray), hit);
    }
}

/// [`occluded`] for many rays.
#[inline(always)]
pub fn occluded_many<S: Simd>(geometry: &Geometry, rays: &[Ray], blocked: &mut [bool]) {
    for (ray, blocked) in rays.iter().zip(blocked) {
        let mut hit = Hit::none(ray.t_max);
        *blocked = walk::<S, true>(&Walk::world(geometry, ray), &mut hit);
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

#[inline(always)]
fn walk<S: Simd, const ANY: bool>(at: &Walk, hit: &mut Hit) -> bool {
    let tree = at.tree;
    if tree.root == EMPTY {
        return false;
    }
    let walker = Walker::<S>::new(at.origin, at.direction);
    let is_large = tree.blocks.len() >= LARGE;
    let mut stack = Stack::empty();
    let mut word = tree.root;
    loop {
        if word & LEAF == 0 {
            let node = &tree.nodes[word as usize];
            let slab = |axis: usize, which: usize| {
                S::F8::load(&node.bounds[which])
                    .sub(walker.origin[axis])
                    .mul(walker.inverse[axis])
            };
            let [nx, ny, nz] = walker.near;
            let enter = slab(0, nx)
                .max(slab(1, ny))
                .max(slab(2, nz).max(S::F8::splat(0.0)));
            let leave = slab(0, nx ^ 1)
                .min(slab(1, ny ^ 1))
                .min(slab(2, nz ^ 1).min(S::F8::splat(hit.t)));
            let mut mask = enter.le(leave.mul(S::F8::splat(FAR_SLACK)));
            if mask != 0 {
                let first = mask.trailing_zeros() as usize & 7;
                mask &= mask - 1;
                if mask == 0 {
                    word = node.children[first];
                    continue;
                }
                if ANY {
                    while mask != 0 {
                        let next = node.children[mask.trailing_zeros() as usize & 7];
                        prefetch::<S>(tree, is_large, next);
                        stack.push(next, 0.0);
                        mask &= mask - 1;
                    }
                    word = node.children[first];
                    continue;
                }
                prefetch::<S>(tree, is_large, node.children[first]);
                let t = enter.store();
                let second = mask.trailing_zeros() as usize & 7;
                mask &= mask - 1;
                prefetch::<S>(tree, is_large, node.children[second]);
                if mask == 0 {
                    let (near, far) = if t[second] < t[first] {
                        (second, first)
                    } else {
                        (first, second)
                    };
                    stack.push(node.children[far], t[far]);
                    word = node.children[near];
                    continue;
                }
                let from = stack.height();
                stack.push(node.children[first], t[first]);
                stack.push(node.children[second], t[second]);
                while mask != 0 {
                    let next = mask.trailing_zeros() as usize & 7;
                    prefetch::<S>(tree, is_large, node.children[next]);
                    stack.push(node.children[next], t[next]);
                    mask &= mask - 1;
                }
                stack.sort_from(from);
            }
        } else {
            let index = (word & INDEX_MASK) as usize;
            // Whatever is not a block of triangles stays out of this function, which has no register
            // to spare.
            let found = if leaf_kind(word) == LeafKind::Triangles as u32 {
                triangles::<S, ANY>(at, &tree.blocks[index], &walker, hit)
            } else if leaf_kind(word) == LeafKind::Pair as u32 {
                triangles::<S, ANY>(at, &tree.blocks[index], &walker, hit)
                    || triangles::<S, ANY>(at, &tree.blocks[index + 1], &walker, hit)
            } else if leaf_kind(word) == LeafKind::Deforming as u32 {
                let block = deformed(at, index);
                triangles::<S, ANY>(at, &block, &walker, hit)
            } else {
                other_leaf::<ANY>(at, word, hit)
            };
            if ANY && found {
                return true;
            }
        }
        // What begins behind the closest hit cannot hold a closer one.
        loop {
            match stack.pop() {
                None => return false,
                Some((next, t)) => {
                    if ANY || t <= hit.t * FAR_SLACK {
                        word = next;
                        break;
                    }
                }
            }
        }
    }
}

/// Asks the cache for a node or a block of triangles that is visited soon.
#[inline(always)]
fn prefetch<S: Simd>(tree: &Tree, is_large: bool, word: u32) {
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
fn triangles<S: Simd, const ANY: bool>(
    at: &Walk,
    block: &TriBlock,
    walker: &Walker<S>,
    hit: &mut Hit,
) -> bool {
    // Corners relative to the origin, sheared so that the ray runs along z. The same corner gives the
    // same numbers in every triangle that it belongs to.
    let [kx, ky, kz] = walker.axes;
    let [ox, oy, oz] = walker.o4;
    let [sx, sy, sz] = walker.shear;
    let corner = |c: usize| {
        let corner = &block.corners[c];
        let z = S::F4::load(&corner[kz]).sub(oz);
        let x = S::F4::load(&corner[kx]).sub(ox).sub(sx.mul(z));
        let y = S::F4::load(&corner[ky]).sub(oy).sub(sy.mul(z));
        (x, y, z)
    };
    let ((ax, ay, az), (bx, by, bz), (cx, cy, cz)) = (corner(0), corner(1), corner(2));
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
    let t = u.mul(az).add(v.mul(bz)).add(w.mul(cz)).mul(sz).div(det);
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
fn offer<const ANY: bool>(at: &Walk, prim: u32, t: f32, u: f32, v: f32, hit: &mut Hit) -> bool {
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
