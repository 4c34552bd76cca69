//! Traversal: an 8-wide tree with blocks of four triangles in its leaves.
//!
//! Generic over [`Simd`]; every level gives the same bits (tested). The triangle test is the
//! watertight one of [Woop13]. It needs no fallback to double precision here because a zero counts as
//! inside. The closest hit is the smallest (t, instance, primitive), whatever order the tree is
//! visited in.

use super::Geometry;
use super::node::{EMPTY, INDEX_MASK, LEAF, LeafKind, Tree, TriBlock, leaf_kind};
use super::simd::{Lanes, Simd, Stack};
use crate::ray::{Hit, NONE, Ray};
use glam::Vec3;

/// Slack on the far side of a box: the entry and exit distances of a slab are rounded three times
/// each, as is a triangle's own distance.
const FAR_SLACK: f32 = 1.000_000_4;

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
        let (kx, ky) = ([1, 2, 0][kz], [2, 0, 1][kz]);
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

/// Closest hit of a ray with everything.
#[inline(always)]
pub fn closest<S: Simd>(geometry: &Geometry, ray: &Ray, hit: &mut Hit) {
    walk::<S, false, true>(
        geometry,
        &geometry.world,
        NONE,
        ray.origin,
        ray.direction,
        ray,
        hit,
    );
}

/// Whether anything is hit before the ray's end.
#[inline(always)]
pub fn occluded<S: Simd>(geometry: &Geometry, ray: &Ray) -> bool {
    let mut hit = Hit::none(ray.t_max);
    walk::<S, true, true>(
        geometry,
        &geometry.world,
        NONE,
        ray.origin,
        ray.direction,
        ray,
        &mut hit,
    )
}

#[inline(always)]
fn walk<S: Simd, const ANY: bool, const TOP: bool>(
    geometry: &Geometry,
    tree: &Tree,
    instance: u32,
    origin: Vec3,
    direction: Vec3,
    ray: &Ray,
    hit: &mut Hit,
) -> bool {
    if tree.root == EMPTY {
        return false;
    }
    let walker = Walker::<S>::new(origin, direction);
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
                        stack.push(node.children[mask.trailing_zeros() as usize & 7], 0.0);
                        mask &= mask - 1;
                    }
                    word = node.children[first];
                    continue;
                }
                let t = enter.store();
                let second = mask.trailing_zeros() as usize & 7;
                mask &= mask - 1;
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
                    stack.push(node.children[next], t[next]);
                    mask &= mask - 1;
                }
                stack.sort_from(from);
            }
        } else {
            let index = (word & INDEX_MASK) as usize;
            let kind = leaf_kind(word);
            let found = if kind == LeafKind::Triangles as u32 {
                triangles::<S, ANY>(
                    geometry,
                    tree,
                    &tree.blocks[index],
                    &walker,
                    instance,
                    ray,
                    hit,
                )
            } else if kind == LeafKind::Quadric as u32 {
                quadric::<ANY>(geometry, tree, index, instance, origin, direction, ray, hit)
            } else if kind == LeafKind::Instance as u32 {
                if TOP {
                    let which = tree.instances[index];
                    let placed = &geometry.instances[which as usize];
                    let (_, from) = placed.placement.at(ray.time);
                    walk_group::<S, ANY>(
                        geometry,
                        &geometry.groups[placed.group as usize],
                        which,
                        from.point(origin),
                        from.vector(direction),
                        ray,
                        hit,
                    )
                } else {
                    false
                }
            } else if kind == LeafKind::Curve as u32 {
                curve::<ANY>(geometry, tree, index, instance, origin, direction, ray, hit)
            } else {
                let block = geometry.deformed_block(tree, tree.deforming[index], ray.time);
                triangles::<S, ANY>(geometry, tree, &block, &walker, instance, ray, hit)
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

/// The same for a group, which holds no instances.
#[inline(always)]
fn walk_group<S: Simd, const ANY: bool>(
    geometry: &Geometry,
    tree: &Tree,
    instance: u32,
    origin: Vec3,
    direction: Vec3,
    ray: &Ray,
    hit: &mut Hit,
) -> bool {
    walk::<S, ANY, false>(geometry, tree, instance, origin, direction, ray, hit)
}

#[inline(always)]
fn triangles<S: Simd, const ANY: bool>(
    geometry: &Geometry,
    tree: &Tree,
    block: &TriBlock,
    walker: &Walker<S>,
    instance: u32,
    ray: &Ray,
    hit: &mut Hit,
) -> bool {
    // Corners relative to the origin, sheared so that the ray runs along z. The same corner gives the
    // same numbers in every triangle that it belongs to.
    let [kx, ky, kz] = walker.axes;
    let [ox, oy, oz] = walker.o4;
    let [sx, sy, sz] = walker.shear;
    let corner = |c: usize| {
        let at = &block.corners[c];
        let z = S::F4::load(&at[kz]).sub(oz);
        let x = S::F4::load(&at[kx]).sub(ox).sub(sx.mul(z));
        let y = S::F4::load(&at[ky]).sub(oy).sub(sy.mul(z));
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
        let taken = offer::<ANY>(
            geometry,
            tree,
            instance,
            block.prims[lane],
            t[lane],
            u[lane],
            v[lane],
            ray,
            hit,
        );
        if ANY && taken {
            return true;
        }
    }
    false
}

#[allow(clippy::too_many_arguments)]
#[inline(always)]
fn quadric<const ANY: bool>(
    geometry: &Geometry,
    tree: &Tree,
    index: usize,
    instance: u32,
    origin: Vec3,
    direction: Vec3,
    ray: &Ray,
    hit: &mut Hit,
) -> bool {
    let (shape, prim) = &tree.quadrics[index];
    let [first, second] = shape.intersect(origin, direction);
    for t in [first, second] {
        if t > 0.0
            && t <= hit.t
            && offer::<ANY>(geometry, tree, instance, *prim, t, 0.0, 0.0, ray, hit)
        {
            return true;
        }
    }
    false
}

#[allow(clippy::too_many_arguments)]
#[cold]
#[inline(never)]
fn curve<const ANY: bool>(
    geometry: &Geometry,
    tree: &Tree,
    index: usize,
    instance: u32,
    origin: Vec3,
    direction: Vec3,
    ray: &Ray,
    hit: &mut Hit,
) -> bool {
    let part = &tree.curves[index];
    let set = &geometry.curves[part.set as usize];
    let piece = &set.pieces[part.piece as usize];
    match piece.intersect(set.kind, part.range, origin, direction, hit.t) {
        Some((t, u, v)) => offer::<ANY>(geometry, tree, instance, part.prim, t, u, v, ray, hit),
        None => false,
    }
}

/// Takes a candidate if it comes before the best so far and its surface is not transparent there.
/// For occlusion: whether it blocks.
#[allow(clippy::too_many_arguments)]
#[inline(always)]
fn offer<const ANY: bool>(
    geometry: &Geometry,
    tree: &Tree,
    instance: u32,
    prim: u32,
    t: f32,
    u: f32,
    v: f32,
    ray: &Ray,
    hit: &mut Hit,
) -> bool {
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
    if geometry.has_alpha && !geometry.is_solid(tree, &candidate, ray) {
        return false;
    }
    *hit = candidate;
    true
}
