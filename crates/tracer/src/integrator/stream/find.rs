//! Points on surfaces, in lanes: what [`Interaction::find`](crate::geometry::Interaction::find)
//! does for them.

use super::Wave;
use super::paths::{self, Group, Paths, Place};
use crate::geometry::interaction::{ROUNDING, ROUNDING_OF_CORNERS};
use crate::lanes::{Float, Mask, Row, V3, Wide};

/// Works out the vertices of hits on triangles that have records.
#[inline(always)]
pub(super) fn find_flat<W: Wide<N>, const N: usize>(
    wave: &Wave,
    paths: &mut Paths,
    places: &[Place],
) {
    let tables = &wave.scene.stream;
    for places in places.chunks(N) {
        let group = Group::new(places);
        let mut records = [[&Row::ZERO; N]; 2];
        let (mut u, mut v) = (Row::default(), Row::default());
        for lane in 0..N {
            let hit = paths.hit_of(group.rays[lane]);
            let record = tables.record(hit.prim);
            records[0][lane] = &record.0[0];
            records[1][lane] = &record.0[1];
            u.0[lane] = hit.u;
            v.0[lane] = hit.v;
        }
        let [ax, ay, az, bx, by, bz, cx, cy] = W::columns(records[0]);
        let [cz, nx, ny, nz, size, r, g, b] = W::columns(records[1]);
        let (u, v) = (W::F::load(&u), W::F::load(&v));
        let w = W::F::splat(1.0) - u - v;
        let p = V3::<W, N>::new(ax, ay, az) * w
            + V3::<W, N>::new(bx, by, bz) * u
            + V3::<W, N>::new(cx, cy, cz) * v;
        let error = p.largest() * W::F::splat(ROUNDING) + size;
        let zero = W::F::splat(0.0);
        paths::scatter::<W, N>(
            &mut paths.point,
            &group.slots,
            [p.x, p.y, p.z, error, nx, ny, nz, zero],
        );
        paths::scatter::<W, N>(
            &mut paths.surface,
            &group.slots,
            [nx, ny, nz, r, g, b, zero, zero],
        );
    }
}

/// Works out the vertices of hits on spheres.
#[inline(always)]
pub(super) fn find_spheres<W: Wide<N>, const N: usize>(
    wave: &Wave,
    paths: &mut Paths,
    places: &[Place],
) {
    let tables = &wave.scene.stream;
    for places in places.chunks(N) {
        let group = Group::new(places);
        let mut records = [[&Row::ZERO; N]; 2];
        let mut t = Row::default();
        for lane in 0..N {
            let hit = paths.hit_of(group.rays[lane]);
            let record = tables.record(hit.prim);
            records[0][lane] = &record.0[0];
            records[1][lane] = &record.0[1];
            t.0[lane] = hit.t;
        }
        let [cx, cy, cz, radius, side, ..] = W::columns(records[0]);
        let [.., r, g, b] = W::columns(records[1]);
        let [ox, oy, oz, dx, dy, dz, ..] = W::gather(paths.rays(), &group.rays);
        let center = V3::<W, N>::new(cx, cy, cz);
        let (o, d) = (V3::<W, N>::new(ox, oy, oz), V3::<W, N>::new(dx, dy, dz));
        let n = (o + d * W::F::load(&t) - center).normalized();
        let p = center + n * radius;
        let turned = side.lt(W::F::splat(0.0));
        let n = V3::select(turned, -n, n);
        let error =
            (p.largest() + center.largest() + (p - center).largest()) * W::F::splat(ROUNDING);
        let zero = W::F::splat(0.0);
        paths::scatter::<W, N>(
            &mut paths.point,
            &group.slots,
            [p.x, p.y, p.z, error, n.x, n.y, n.z, zero],
        );
        paths::scatter::<W, N>(
            &mut paths.surface,
            &group.slots,
            [n.x, n.y, n.z, r, g, b, zero, zero],
        );
    }
}

/// Works out the vertices of hits on meshes.
#[inline(always)]
pub(super) fn find_meshes<W: Wide<N>, const N: usize>(
    wave: &Wave,
    paths: &mut Paths,
    places: &[Place],
) {
    let geometry = &wave.scene.geometry;
    for places in places.chunks(N) {
        let group = Group::new(places);
        let mut corners = [[Row::default(); 3]; 3];
        let mut normals = [[Row::default(); 3]; 3];
        let (mut u, mut v) = (Row::default(), Row::default());
        let mut given = [Row::default(); 3];
        let (mut flipped, mut smooth) = (0, 0);
        for lane in 0..N {
            let hit = paths.hit_of(group.rays[lane]);
            let at = geometry.world.prims[hit.prim as usize];
            let surface = &geometry.surfaces[at.surface as usize];
            let mesh = &geometry.meshes[surface.mesh as usize];
            let indices = mesh.indices[at.index as usize];
            let is_smooth = !mesh.normals.is_empty();
            for c in 0..3 {
                let p = mesh.positions[indices[c] as usize];
                for axis in 0..3 {
                    corners[c][axis].0[lane] = p[axis];
                }
                if is_smooth {
                    let n = mesh.normals[indices[c] as usize];
                    for axis in 0..3 {
                        normals[c][axis].0[lane] = n[axis];
                    }
                }
            }
            u.0[lane] = hit.u;
            v.0[lane] = hit.v;
            let r = wave.scene.stream.given(at.surface);
            given[0].0[lane] = r.x;
            given[1].0[lane] = r.y;
            given[2].0[lane] = r.z;
            flipped |= (surface.flip as u32) << lane;
            smooth |= (is_smooth as u32) << lane;
        }
        let (u, v) = (W::F::load(&u), W::F::load(&v));
        let w = W::F::splat(1.0) - u - v;
        let a = V3::<W, N>::load(&corners[0]);
        let b = V3::<W, N>::load(&corners[1]);
        let c = V3::<W, N>::load(&corners[2]);
        let (e1, e2) = (b - a, c - a);
        let p = a * w + b * u + c * v;
        let size = e1.largest() + e2.largest();
        let error = p.largest() * W::F::splat(ROUNDING) + size * W::F::splat(ROUNDING_OF_CORNERS);
        let mut ng = e1.cross(e2).normalized();
        ng = V3::select(W::M::from_bits(flipped), -ng, ng);
        let mut ns = ng;
        if smooth != 0 {
            let n = V3::<W, N>::load(&normals[0]) * w
                + V3::<W, N>::load(&normals[1]) * u
                + V3::<W, N>::load(&normals[2]) * v;
            let zero = W::F::splat(0.0);
            let length2 = n.dot(n);
            // Lanes without normals have zeros here.
            let usable = zero.lt(length2);
            ns = V3::select(usable, n * (W::F::splat(1.0) / length2.sqrt()), ns);
            // Vertex normals decide which side is outside.
            let inside = usable & ng.dot(ns).lt(zero);
            ng = V3::select(inside, -ng, ng);
        }
        let zero = W::F::splat(0.0);
        paths::scatter::<W, N>(
            &mut paths.point,
            &group.slots,
            [p.x, p.y, p.z, error, ng.x, ng.y, ng.z, zero],
        );
        let given = V3::<W, N>::load(&given);
        paths::scatter::<W, N>(
            &mut paths.surface,
            &group.slots,
            [ns.x, ns.y, ns.z, given.x, given.y, given.z, zero, zero],
        );
    }
}
