//! Worlds of a handful of primitives: all of them are tested against eight rays at a time, without a tree.
//!
//! The tests are those of the kernel, a ray in each lane instead of a triangle, and round as they do.

#![allow(
    clippy::needless_range_loop,
    reason = "a lane is a place in several arrays at once"
)]

use super::node::Tree;
use crate::lanes::{Float, Mask, Row, V3, Wide, entry};
use crate::ray::{Hit, NONE, Ray};
use glam::Vec3;

/// Primitives up to which a tree is not faster: with 36 triangles a picture takes as long on one processor, an eighth less
/// without a tree on another.
const FEW: usize = 40;

/// Corners of as many triangles, rounded up: such that any index fits that is cut off to so many bits.
const CORNERS: usize = (3 * FEW).next_power_of_two();

/// Corners as the rays of a group see them, none across two lines of the cache.
#[repr(align(64))]
struct Sheared<const N: usize>([[Row<N>; 3]; CORNERS]);

/// All primitives of a world.
#[derive(Clone, Debug)]
pub struct Few {
    /// Of the triangles: each place once, as most are shared.
    corners: Vec<[f32; 3]>,
    triangles: Vec<Triangle>,
    spheres: Vec<Sphere>,
}

#[derive(Clone, Copy, Debug)]
struct Triangle {
    /// Among the corners.
    corners: [u32; 3],
    /// A small number, as a float, so that it fits into a lane.
    prim: f32,
}

#[derive(Clone, Copy, Debug)]
struct Sphere {
    center: Vec3,
    radius: f32,
    /// See [`Triangle::prim`].
    prim: f32,
}

/// No primitive: after all others.
const NO_PRIM: f32 = f32::INFINITY;

impl Few {
    /// Of a tree of few solid triangles and round spheres; `None` for any other.
    pub fn new(tree: &Tree) -> Option<Few> {
        let is_simple =
            tree.deforming.is_empty() && tree.curves.is_empty() && tree.instances.is_empty();
        if !is_simple || tree.prims.len() > FEW || tree.prims.is_empty() {
            return None;
        }
        let mut few = Few {
            corners: vec![],
            triangles: vec![],
            spheres: vec![],
        };
        for block in &tree.blocks {
            for (lane, &prim) in block.prims.iter().enumerate().filter(|(_, p)| **p != NONE) {
                let corners = [0, 1, 2]
                    .map(|c| few.corner([0, 1, 2].map(|axis| block.corners[c][axis][lane])));
                few.triangles.push(Triangle {
                    corners,
                    prim: prim as f32,
                });
            }
        }
        for (shape, prim) in &tree.quadrics {
            let (center, radius) = shape.sphere()?;
            few.spheres.push(Sphere {
                center,
                radius,
                prim: *prim as f32,
            });
        }
        // Of equal hits that of the first primitive counts, which has to come last here.
        few.triangles.sort_by(|a, b| b.prim.total_cmp(&a.prim));
        few.spheres.sort_by(|a, b| b.prim.total_cmp(&a.prim));
        Some(few)
    }

    /// Index of a corner, by the bits of its coordinates.
    fn corner(&mut self, p: [f32; 3]) -> u32 {
        let bits = p.map(f32::to_bits);
        let known = self
            .corners
            .iter()
            .position(|q| q.map(f32::to_bits) == bits);
        known.unwrap_or_else(|| {
            self.corners.push(p);
            self.corners.len() - 1
        }) as u32
    }

    /// See [`Geometry::closest_many`](super::Geometry::closest_many).
    #[inline(always)]
    fn closest<W: Wide<N>, const N: usize>(few: &Few, rays: &[Ray], hits: &mut [Hit]) -> Rest {
        for (ray, hit) in rays.iter().zip(&mut *hits) {
            *hit = Hit::none(ray.t_max);
        }
        let mut sheared = Sheared::<N>([[Row([0.0; N]); 3]; CORNERS]);
        let mut sorted = Sorted::<N>::new();
        for at in 0..rays.len() {
            if let Some(group) = sorted.push(&rays[at], at) {
                few.trace::<W, N, false>(rays, group, &mut sheared, hits, &mut []);
            }
        }
        while let Some(group) = sorted.rest() {
            few.trace::<W, N, false>(rays, group, &mut sheared, hits, &mut []);
        }
        sorted.alone
    }

    /// See [`Geometry::occluded_many`](super::Geometry::occluded_many).
    #[inline(always)]
    fn occluded<W: Wide<N>, const N: usize>(few: &Few, rays: &[Ray], blocked: &mut [bool]) -> Rest {
        let mut sheared = Sheared::<N>([[Row([0.0; N]); 3]; CORNERS]);
        let mut sorted = Sorted::<N>::new();
        for at in 0..rays.len() {
            if let Some(group) = sorted.push(&rays[at], at) {
                few.trace::<W, N, true>(rays, group, &mut sheared, &mut [], blocked);
            }
        }
        while let Some(group) = sorted.rest() {
            few.trace::<W, N, true>(rays, group, &mut sheared, &mut [], blocked);
        }
        sorted.alone
    }

    #[inline(always)]
    fn trace<W: Wide<N>, const N: usize, const ANY: bool>(
        &self,
        rays: &[Ray],
        group: Group<N>,
        sheared: &mut Sheared<N>,
        hits: &mut [Hit],
        blocked: &mut [bool],
    ) {
        match group.axis {
            0 => self.along::<W, N, ANY, 0>(rays, &group, sheared, hits, blocked),
            1 => self.along::<W, N, ANY, 1>(rays, &group, sheared, hits, blocked),
            _ => self.along::<W, N, ANY, 2>(rays, &group, sheared, hits, blocked),
        }
    }

    /// Rays whose direction is longest along one axis.
    #[inline(always)]
    fn along<W: Wide<N>, const N: usize, const ANY: bool, const KZ: usize>(
        &self,
        rays: &[Ray],
        group: &Group<N>,
        sheared: &mut Sheared<N>,
        hits: &mut [Hit],
        blocked: &mut [bool],
    ) {
        let rows: &[Row] = bytemuck::cast_slice(rays);
        let [ox, oy, oz, dx, dy, dz, t_max, _] = W::gather(rows, &group.at);
        let (o, d) = ([ox, oy, oz], [dx, dy, dz]);
        let (kx, ky) = ((KZ + 1) % 3, (KZ + 2) % 3);
        let (zero, one) = (W::F::splat(0.0), W::F::splat(1.0));
        let shear = [d[kx] / d[KZ], d[ky] / d[KZ], one / d[KZ]];
        let start = [o[kx], o[ky], o[KZ]];
        let mut found = W::M::from_bits(0);
        let mut best = Best::<W, N> {
            t: t_max,
            prim: W::F::splat(NO_PRIM),
            det: one,
            v: zero,
            w: zero,
        };
        for (corner, to) in self.corners.iter().zip(&mut sheared.0) {
            shear_corner::<W, N, KZ>(corner, start, shear).store(to);
        }
        for triangle in &self.triangles {
            let [a, b, c] = triangle.corners;
            let [a, b, c] = [
                &sheared.0[a as usize % CORNERS],
                &sheared.0[b as usize % CORNERS],
                &sheared.0[c as usize % CORNERS],
            ];
            let V3 {
                x: ax,
                y: ay,
                z: az,
            } = V3::<W, N>::load(a);
            let V3 {
                x: bx,
                y: by,
                z: bz,
            } = V3::<W, N>::load(b);
            let V3 {
                x: cx,
                y: cy,
                z: cz,
            } = V3::<W, N>::load(c);
            let u = cx * by - cy * bx;
            let v = ax * cy - ay * cx;
            let w = bx * ay - by * ax;
            // No branch: among so many rays there is nearly always one inside, but not always.
            let inside = zero.le(u.min(v).min(w)) | u.max(v).max(w).le(zero);
            let det = u + v + w;
            let t = (u * az + v * bz + w * cz) * shear[2] / det;
            let is_hit = inside & zero.lt(t);
            if ANY {
                found = found | (is_hit & t.lt(t_max));
            } else {
                best.take(is_hit & t.le(best.t), t, triangle.prim, [det, v, w]);
            }
        }
        let (o, d) = (V3::<W, N>::new(ox, oy, oz), V3::<W, N>::new(dx, dy, dz));
        for sphere in &self.spheres {
            let (near, far) = sphere.meet::<W, N>(o, d);
            let t = W::F::select(zero.lt(near), near, far);
            let is_hit = zero.lt(t);
            if ANY {
                found = found | (is_hit & t.lt(t_max));
            } else {
                let is_first = W::F::splat(sphere.prim).lt(best.prim);
                let nearer = t.lt(best.t) | (t.eq(best.t) & is_first);
                best.take(is_hit & nearer, t, sphere.prim, [one, zero, zero]);
            }
        }
        if ANY {
            let found = found.to_bits();
            for lane in 0..group.count {
                blocked[group.at[lane] as usize] = found >> lane & 1 == 1;
            }
            return;
        }
        let (mut t, mut prim, mut u, mut v) = Default::default();
        best.t.store(&mut t);
        best.prim.store(&mut prim);
        (best.v / best.det).store(&mut u);
        (best.w / best.det).store(&mut v);
        for lane in 0..group.count {
            let hit = &mut hits[group.at[lane] as usize];
            if prim.0[lane] < NO_PRIM {
                *hit = Hit {
                    t: t.0[lane],
                    instance: NONE,
                    prim: prim.0[lane] as u32,
                    u: u.0[lane],
                    v: v.0[lane],
                };
            }
        }
    }
}

/// The best hits of some rays so far.
struct Best<W: Wide<N>, const N: usize> {
    t: W::F,
    prim: W::F,
    /// Twice the area as the ray sees it, and the parts across from the first and the second corner; they are
    /// divided at the end, once.
    det: W::F,
    v: W::F,
    w: W::F,
}

impl<W: Wide<N>, const N: usize> Best<W, N> {
    #[inline(always)]
    fn take(&mut self, nearer: W::M, t: W::F, prim: f32, [det, v, w]: [W::F; 3]) {
        self.t = W::F::select(nearer, t, self.t);
        self.prim = W::F::select(nearer, W::F::splat(prim), self.prim);
        self.det = W::F::select(nearer, det, self.det);
        self.v = W::F::select(nearer, v, self.v);
        self.w = W::F::select(nearer, w, self.w);
    }
}

/// A corner relative to the origins, sheared so that the rays run along z; see the kernel.
#[inline(always)]
fn shear_corner<W: Wide<N>, const N: usize, const KZ: usize>(
    corner: &[f32; 3],
    start: [W::F; 3],
    shear: [W::F; 3],
) -> V3<W, N> {
    let z = W::F::splat(corner[KZ]) - start[2];
    let x = W::F::splat(corner[(KZ + 1) % 3]) - start[0] - shear[0] * z;
    let y = W::F::splat(corner[(KZ + 2) % 3]) - start[1] - shear[1] * z;
    V3::new(x, y, z)
}

impl Sphere {
    /// Where rays meet it, rising; negative or NaN where they do not. See
    /// [`Quadric::intersect`](crate::geometry::quadric::Quadric::intersect).
    #[inline(always)]
    fn meet<W: Wide<N>, const N: usize>(&self, origin: V3<W, N>, d: V3<W, N>) -> (W::F, W::F) {
        let (zero, none) = (W::F::splat(0.0), W::F::splat(-1.0));
        let radius = W::F::splat(self.radius);
        let o = origin - V3::splat(self.center);
        let a = d.dot(d);
        let b = -o.dot(d);
        let c = o.dot(o) - radius * radius;
        let l = o + d * (b / a);
        let discriminant = radius * radius - l.dot(l);
        let missed = discriminant.lt(zero);
        let q = b + (discriminant * a).sqrt().copysign(b);
        let (t0, t1) = (c / q, q / a);
        let in_order = t0.lt(t1);
        let near = W::F::select(in_order, t0, t1);
        let far = W::F::select(in_order, t1, t0);
        (
            W::F::select(missed, none, near),
            W::F::select(missed, none, far),
        )
    }
}

/// Up to eight rays whose directions are longest along the same axis; the last is repeated.
struct Group<const N: usize> {
    axis: usize,
    at: [u32; N],
    count: usize,
}

/// Rays by the axis along which their directions are longest, as the kernel picks it.
struct Sorted<const N: usize> {
    at: [[u32; N]; 3],
    count: [usize; 3],
    alone: Rest,
}

/// Rays that are too few for lanes: they are left to the tree.
#[derive(Default)]
pub struct Rest {
    at: [u32; 3 * (WORTH - 1)],
    count: usize,
}

/// Rays of a group from which on the lanes are worth it.
const WORTH: usize = 4;

impl Rest {
    /// Which rays.
    pub fn rays(&self) -> &[u32] {
        &self.at[..self.count]
    }
}

impl<const N: usize> Sorted<N> {
    #[inline(always)]
    fn new() -> Self {
        Sorted {
            at: [[0; N]; 3],
            count: [0; 3],
            alone: Rest::default(),
        }
    }

    /// Takes a ray; a group if it is complete now.
    #[inline(always)]
    fn push(&mut self, ray: &Ray, at: usize) -> Option<Group<N>> {
        let [x, y, z] = [
            ray.direction.x.abs(),
            ray.direction.y.abs(),
            ray.direction.z.abs(),
        ];
        let axis = if x > y && x > z {
            0
        } else if y > z {
            1
        } else {
            2
        };
        self.at[axis][self.count[axis]] = at as u32;
        self.count[axis] += 1;
        if self.count[axis] < N {
            return None;
        }
        self.count[axis] = 0;
        Some(Group {
            axis,
            at: self.at[axis],
            count: N,
        })
    }

    /// What is left, one group after another.
    #[inline(always)]
    fn rest(&mut self) -> Option<Group<N>> {
        for axis in 0..3 {
            let count = std::mem::take(&mut self.count[axis]);
            if count < WORTH {
                for &at in &self.at[axis][..count] {
                    self.alone.at[self.alone.count] = at;
                    self.alone.count += 1;
                }
            } else {
                let mut at = self.at[axis];
                for lane in count..N {
                    at[lane] = at[count - 1];
                }
                return Some(Group { axis, at, count });
            }
        }
        None
    }
}

entry! {
    /// Closest hits of rays, but for a rest.
    pub fn closest(few: &Few, rays: &[Ray], hits: &mut [Hit]) -> Rest = Few::closest;
}
entry! {
    /// Whether anything is hit before the ends of rays, but for a rest.
    pub fn occluded(few: &Few, rays: &[Ray], blocked: &mut [bool]) -> Rest = Few::occluded;
}
