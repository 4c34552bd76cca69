//! Rays against clusters, in lanes.

#![allow(
    clippy::needless_range_loop,
    reason = "a lane is a place in several arrays at once"
)]

use super::sort::{Rest, Sorted, WORTH};
use super::{ALONE, Cluster, Few, Sphere};
use crate::accel::aim::safe;
use crate::accel::kernel::{FAR_SLACK, PASSING};
use crate::lanes::{Float, Mask, Row, V3, Wide, entry};
use crate::ray::{Hit, NONE, Ray};
use std::ops::Range;

/// Corners of a cluster, rounded up: such that any index fits that is cut off to so many bits.
const CORNERS: usize = (3 * ALONE).next_power_of_two();

/// Corners as the rays of a group see them, none across two lines of the cache.
#[repr(align(64))]
struct Sheared<const N: usize>([[Row<N>; 3]; CORNERS]);

/// No primitive: after all others.
const NO_PRIM: f32 = f32::INFINITY;

entry! {
    /// Closest hits of up to [`MOST_RAYS`] rays, but for a rest.
    pub fn closest(few: &Few, rays: &[Ray], hits: &mut [Hit]) -> Rest = Few::closest;
}
entry! {
    /// Whether anything is hit before the ends of up to [`MOST_RAYS`] rays, but for a rest.
    pub fn occluded(few: &Few, rays: &[Ray], blocked: &mut [bool]) -> Rest = Few::occluded;
}

impl Few {
    /// See [`Geometry::closest_many`](super::Geometry::closest_many).
    #[inline(always)]
    fn closest<W: Wide<N>, const N: usize>(few: &Few, rays: &[Ray], hits: &mut [Hit]) -> Rest {
        for (ray, hit) in rays.iter().zip(&mut *hits) {
            *hit = Hit::none(ray.t_max);
        }
        few.all::<W, N, false>(rays, hits, &mut [])
    }

    /// See [`Geometry::occluded_many`](super::Geometry::occluded_many).
    #[inline(always)]
    fn occluded<W: Wide<N>, const N: usize>(few: &Few, rays: &[Ray], blocked: &mut [bool]) -> Rest {
        few.all::<W, N, true>(rays, &mut [], blocked)
    }

    #[inline(always)]
    fn all<W: Wide<N>, const N: usize, const ANY: bool>(
        &self,
        rays: &[Ray],
        hits: &mut [Hit],
        blocked: &mut [bool],
    ) -> Rest {
        // A constant, or it is made elsewhere and copied.
        let mut sheared = const { Sheared::<N>([[Row([0.0; N]); 3]; CORNERS]) };
        let mut rest = Rest::default();
        let rows: &[Row] = bytemuck::cast_slice(rays);
        let is_one = self.clusters.len() == 1;
        let mut sorted = Sorted::new();
        if is_one {
            sorted.sort::<W, N, false>(rows);
        } else {
            sorted.sort::<W, N, true>(rows);
        }
        for axis in 0..3 {
            for at in sorted.along(axis).chunks(N) {
                if at.len() < WORTH {
                    rest.add(at);
                    continue;
                }
                let group = Group::new(at);
                match (axis, is_one) {
                    (0, true) => {
                        self.along::<W, N, ANY, 0, false>(rows, &group, &mut sheared, hits, blocked)
                    }
                    (1, true) => {
                        self.along::<W, N, ANY, 1, false>(rows, &group, &mut sheared, hits, blocked)
                    }
                    (_, true) => {
                        self.along::<W, N, ANY, 2, false>(rows, &group, &mut sheared, hits, blocked)
                    }
                    (0, false) => {
                        self.along::<W, N, ANY, 0, true>(rows, &group, &mut sheared, hits, blocked)
                    }
                    (1, false) => {
                        self.along::<W, N, ANY, 1, true>(rows, &group, &mut sheared, hits, blocked)
                    }
                    (_, false) => {
                        self.along::<W, N, ANY, 2, true>(rows, &group, &mut sheared, hits, blocked)
                    }
                }
            }
        }
        rest
    }

    /// Rays whose direction is longest along one axis.
    #[inline(always)]
    fn along<W: Wide<N>, const N: usize, const ANY: bool, const KZ: usize, const MANY: bool>(
        &self,
        rows: &[Row],
        group: &Group<N>,
        sheared: &mut Sheared<N>,
        hits: &mut [Hit],
        blocked: &mut [bool],
    ) {
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
        let mut inverse = d;
        if MANY {
            for axis in 0..3 {
                inverse[axis] = one / safe::<W, N>(d[axis]);
            }
        }
        let (o3, d3) = (V3::<W, N>::new(ox, oy, oz), V3::<W, N>::new(dx, dy, dz));
        let a = d3.dot(d3);
        let backward = MANY && rows[group.at[0] as usize].0[3 + KZ] < 0.0;
        for &at in &self.orders[2 * KZ + backward as usize] {
            let cluster = &self.clusters[at as usize];
            if MANY {
                let mut met = cluster.meet::<W, N>(o, inverse, if ANY { t_max } else { best.t });
                if ANY {
                    met = met & !found;
                }
                if met.to_bits() == 0 {
                    continue;
                }
            }
            for (corner, to) in self.corners[of(&cluster.corners)]
                .iter()
                .zip(&mut sheared.0)
            {
                shear_corner::<W, N, KZ>(corner, start, shear).store(to);
            }
            for triangle in &self.triangles[of(&cluster.triangles)] {
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
                    let nearer = if MANY {
                        best.is_behind(t, triangle.prim)
                    } else {
                        t.le(best.t)
                    };
                    best.take(is_hit & nearer, t, triangle.prim, [det, v, w]);
                }
            }
            for sphere in &self.spheres[of(&cluster.spheres)] {
                let Some((near, far)) = sphere.meet::<W, N>(o3, d3, a) else {
                    continue;
                };
                let t = W::F::select(zero.lt(near), near, far);
                let is_hit = zero.lt(t);
                if ANY {
                    found = found | (is_hit & t.lt(t_max));
                } else {
                    let nearer = best.is_behind(t, sphere.prim);
                    best.take(is_hit & nearer, t, sphere.prim, [one, zero, zero]);
                }
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

/// A range of indices.
#[inline(always)]
pub(super) fn of(range: &Range<u32>) -> Range<usize> {
    range.start as usize..range.end as usize
}

impl Cluster {
    /// Which rays meet its box before they end; see [`kernel::boxes`](super::kernel::boxes).
    #[inline(always)]
    fn meet<W: Wide<N>, const N: usize>(&self, o: [W::F; 3], inverse: [W::F; 3], t: W::F) -> W::M {
        let mut enter = W::F::splat(0.0);
        let mut leave = t;
        for axis in 0..3 {
            let a = (W::F::splat(self.bounds.min[axis]) - o[axis]) * inverse[axis];
            let b = (W::F::splat(self.bounds.max[axis]) - o[axis]) * inverse[axis];
            enter = enter.max(a.min(b));
            leave = leave.min(a.max(b));
        }
        enter.le(leave * W::F::splat(FAR_SLACK))
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
    /// Whether a hit comes before it; equal ones count by the primitive.
    #[inline(always)]
    fn is_behind(&self, t: W::F, prim: f32) -> W::M {
        let is_first = W::F::splat(prim).lt(self.prim);
        t.lt(self.t) | (t.eq(self.t) & is_first)
    }

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
    /// Where rays meet it, rising; negative or NaN where they do not, nothing if none does. `a` is the square of
    /// the direction. See [`Quadric::intersect`](crate::geometry::quadric::Quadric::intersect).
    #[inline(always)]
    fn meet<W: Wide<N>, const N: usize>(
        &self,
        origin: V3<W, N>,
        d: V3<W, N>,
        a: W::F,
    ) -> Option<(W::F, W::F)> {
        let (zero, none) = (W::F::splat(0.0), W::F::splat(-1.0));
        let radius = W::F::splat(self.radius);
        let o = origin - V3::splat(self.center);
        let b = -o.dot(d);
        let (distance2, square) = (o.dot(o), radius * radius);
        let c = distance2 - square;
        // Most rays pass by at a distance that needs no division to be seen.
        let slack = a * (distance2 + square) * W::F::splat(PASSING);
        let passes = (b * b + slack).lt(a * c);
        if (!passes).to_bits() == 0 {
            return None;
        }
        let l = o + d * (b / a);
        let discriminant = square - l.dot(l);
        let missed = discriminant.lt(zero);
        let q = b + (discriminant * a).sqrt().copysign(b);
        let (t0, t1) = (c / q, q / a);
        let in_order = t0.lt(t1);
        let near = W::F::select(in_order, t0, t1);
        let far = W::F::select(in_order, t1, t0);
        Some((
            W::F::select(missed, none, near),
            W::F::select(missed, none, far),
        ))
    }
}

/// Rays whose directions are longest along the same axis, up to one a lane; the last is repeated.
struct Group<const N: usize> {
    at: [u32; N],
    count: usize,
}

impl<const N: usize> Group<N> {
    #[inline(always)]
    fn new(at: &[u32]) -> Self {
        let mut group = Group {
            at: [at[at.len() - 1]; N],
            count: at.len(),
        };
        // Of a length that is known, which needs no call.
        if let Some(all) = at.first_chunk() {
            group.at = *all;
        } else {
            group.at[..at.len()].copy_from_slice(at);
        }
        group
    }
}
