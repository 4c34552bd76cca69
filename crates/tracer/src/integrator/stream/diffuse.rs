//! Diffuse vertices in lanes: what [`path::scatter`](super::path::scatter) does with [`Bsdf::Diffuse`].
//!
//! [`Bsdf::Diffuse`]: crate::bsdf::Bsdf::Diffuse

use super::Wave;
use super::light::{self, Arriving};
use super::paths::{self, Group, Paths, Place};
use crate::integrator::path::{ROULETTE_FACTOR, ROULETTE_FROM};
use crate::lanes::{Float, Frame3, Int, LANES, Mask, Row, V3, Wide, copysign};
use crate::math::{INV_PI, Rgb};
use crate::sampling::lanes::cosine_hemisphere;

/// Eight vertices.
struct Vertex<W: Wide> {
    p: V3<W>,
    error: W::F,
    ng: V3<W>,
    time: W::F,
}

/// Scatters at diffuse vertices: shadow rays and the rays that go on.
#[inline(always)]
pub(super) fn scatter<W: Wide>(wave: &Wave, paths: &mut Paths, places: &[Place]) {
    let (zero, one) = (W::F::splat(0.0), W::F::splat(1.0));
    for places in places.chunks(LANES) {
        let group = Group::new(places);
        let [.., dx, dy, dz, _, time] = paths::gather::<W>(paths.rays(), &group.rays);
        let [px, py, pz, error, gx, gy, gz, _] = paths::gather::<W>(&paths.point, &group.slots);
        let [nx, ny, nz, r, g, b, _, _] = paths::gather::<W>(&paths.surface, &group.slots);
        let [lx, ly, bx, by, _, _, roulette, _] = paths::gather::<W>(&paths.numbers, &group.slots);
        let [tr, tg, tb, eta_scale, _, depth, _, _] =
            paths::gather::<W>(&paths.carried, &group.slots);
        let vertex = Vertex::<W> {
            p: V3::new(px, py, pz),
            error,
            ng: V3::new(gx, gy, gz),
            time,
        };
        let wo = -V3::<W>::new(dx, dy, dz);
        let n = V3::<W>::new(nx, ny, nz);
        let albedo = V3::<W>::new(r, g, b);
        let throughput = V3::<W>::new(tr, tg, tb);
        if wave.event == 0 {
            see::<W>(paths, &group, wo, n, vertex.ng, albedo);
        }
        let depth = depth.bits() + W::I::splat(1);
        let is_indirect = is_at_least::<W>(depth, 2);
        let wo_z = wo.dot(n);
        // Light that is sampled.
        let (arriving, pmf) = light::sample::<W>(wave, paths, &group, vertex.p, (lx, ly));
        let (sent, arrives) = reflected::<W>(&arriving, pmf, n, wo_z, albedo);
        let light = bounded::<W>(
            wave.scene.clamp_indirect,
            throughput.times(sent),
            is_indirect,
        );
        let asked = arrives.to_bits() & group.used;
        if asked != 0 {
            push_shadows::<W>(paths, &group, &vertex, &arriving, light, asked);
        }
        // The direction that the path goes on in.
        let (x, y, z) = cosine_hemisphere::<W>(bx, by);
        let side = wo_z.lt(zero);
        let wi = V3::<W>::new(x, y, W::F::select(side, -z, z));
        let mut goes_on = zero.lt(wo_z * wi.z);
        let throughput = throughput.times(albedo);
        let keep = (throughput.max_element() * eta_scale * W::F::splat(ROULETTE_FACTOR)).min(one);
        let is_at_stake = is_at_least::<W>(depth, ROULETTE_FROM);
        goes_on = goes_on & (!is_at_stake | roulette.lt(keep));
        let kept = throughput * (one / keep);
        let throughput = V3::select(is_at_stake, kept, throughput);
        let pdf = z * W::F::splat(INV_PI);
        let w = Frame3::<W>::from_normal(n).to_world(wi);
        let origin = vertex.origin_towards(w);
        let next = paths::rows::<W>([
            origin.x,
            origin.y,
            origin.z,
            w.x,
            w.y,
            w.z,
            W::F::splat(f32::INFINITY),
            time,
        ]);
        let mut rest = goes_on.to_bits() & group.used;
        while rest != 0 {
            let lane = rest.trailing_zeros() as usize & 7;
            rest &= rest - 1;
            paths.push_next(next[lane], group.slots[lane]);
        }
        let depth = W::F::from_bits(depth);
        let t = throughput;
        paths::scatter::<W>(
            &mut paths.carried,
            &group.slots,
            [t.x, t.y, t.z, eta_scale, pdf, depth, zero, zero],
        );
        // The cosine is not narrowed: zero as an integer, too.
        paths::scatter::<W>(
            &mut paths.last,
            &group.slots,
            [px, py, pz, nx, ny, nz, zero, zero],
        );
    }
}

/// Keeps the layers of first surfaces.
#[inline(always)]
fn see<W: Wide>(paths: &mut Paths, group: &Group, wo: V3<W>, n: V3<W>, ng: V3<W>, albedo: V3<W>) {
    let zero = W::F::splat(0.0);
    let mut depth = Row::default();
    let mut unseen = 0;
    for lane in 0..LANES {
        let place = Place {
            ray: group.rays[lane],
            slot: group.slots[lane],
        };
        depth.0[lane] = paths.hit(place).t;
        unseen |= (!paths.seen_first(place) as u32) << lane;
    }
    if unseen == 0 {
        return;
    }
    let behind = n.dot(wo).lt(zero) & ng.dot(wo).lt(zero);
    let n = V3::select(behind, -n, n);
    let first = paths::rows::<W>([
        W::F::splat(1.0),
        albedo.x,
        albedo.y,
        albedo.z,
        n.x,
        n.y,
        n.z,
        W::F::load(&depth),
    ]);
    let mut rest = unseen & group.used;
    while rest != 0 {
        let lane = rest.trailing_zeros() as usize & 7;
        rest &= rest - 1;
        let slot = group.slots[lane];
        paths.first[slot as usize] = first[lane];
        paths.set_seen(slot);
    }
}

/// Light that is reflected to `wo`, and where there is any.
#[inline(always)]
fn reflected<W: Wide>(
    arriving: &Arriving<W>,
    pmf: W::F,
    n: V3<W>,
    wo_z: W::F,
    albedo: V3<W>,
) -> (V3<W>, W::M) {
    let (zero, one) = (W::F::splat(0.0), W::F::splat(1.0));
    let wi_z = arriving.wi.dot(n);
    let pdf_bsdf = wi_z.abs() * W::F::splat(INV_PI);
    let f = albedo * pdf_bsdf;
    let pdf = arriving.pdf * pmf;
    let ratio = pdf_bsdf / pdf;
    let weight = one / (one + ratio * ratio);
    let certain = arriving.is_delta | pdf.eq(W::F::splat(f32::INFINITY));
    let weight = W::F::select(certain, one, weight);
    let sent = f.times(arriving.li) * (weight / pdf);
    let arrives = arriving.any & zero.lt(wo_z * wi_z) & !f.is_zero() & !sent.is_zero();
    (sent, arrives)
}

/// The optional, biased bound; see [`path::bounded`](super::path::bounded).
#[inline(always)]
fn bounded<W: Wide>(most: f32, light: V3<W>, is_indirect: W::M) -> V3<W> {
    if most == f32::INFINITY {
        return light;
    }
    let strongest = light.max_element();
    let most = W::F::splat(most);
    let beyond = is_indirect & most.lt(strongest);
    V3::select(beyond, light * (most / strongest), light)
}

impl<W: Wide> Vertex<W> {
    /// See [`Interaction::origin_towards`](crate::geometry::Interaction::origin_towards).
    #[inline(always)]
    fn origin_towards(&self, w: V3<W>) -> V3<W> {
        self.p + self.ng * copysign::<W>(self.error, w.dot(self.ng))
    }
}

#[inline(always)]
fn push_shadows<W: Wide>(
    paths: &mut Paths,
    group: &Group,
    vertex: &Vertex<W>,
    arriving: &Arriving<W>,
    light: V3<W>,
    mut asked: u32,
) {
    let far = arriving.at_infinity;
    let towards = V3::select(far, arriving.wi, arriving.target - vertex.p);
    let origin = vertex.origin_towards(towards);
    let direction = V3::select(far, arriving.wi, arriving.target - origin);
    let t_max = W::F::select(far, W::F::splat(f32::INFINITY), W::F::splat(0.9999));
    let rays = paths::rows::<W>([
        origin.x,
        origin.y,
        origin.z,
        direction.x,
        direction.y,
        direction.z,
        t_max,
        vertex.time,
    ]);
    let mut lights = [Row::default(); 3];
    light.store(&mut lights);
    while asked != 0 {
        let lane = asked.trailing_zeros() as usize & 7;
        asked &= asked - 1;
        let light = Rgb::new(lights[0].0[lane], lights[1].0[lane], lights[2].0[lane]);
        paths.push_shadow(rays[lane], light, group.slots[lane]);
    }
}

/// Whether small integers are at least some bound.
#[inline(always)]
fn is_at_least<W: Wide>(x: W::I, bound: u32) -> W::M {
    W::F::splat(bound as f32).le(W::F::from_int(x))
}
