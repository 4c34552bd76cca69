//! Scattering in lanes: what [`path::scatter`](crate::integrator::path::scatter) does for models that
//! have lanes.

use super::Wave;
use super::light::{self, Arriving};
use super::paths::{self, Group, NO_DENSITY, Paths, Place};
use crate::bsdf::lanes::{AimOf, Lanes, Samples};
use crate::bsdf::{ConductorLanes, DielectricLanes, DiffuseLanes};
use crate::guide::{self, BRINGS_FACTOR, COS_MIN, SHARE};
use crate::integrator::path::{ROULETTE_FACTOR, ROULETTE_FROM};
use crate::lanes::{Float, Frame3, Int, LANES, Mask, Row, V3, Wide};
use crate::math::Rgb;

/// Scatters at diffuse vertices.
#[inline(always)]
pub(super) fn diffuse<W: Wide<N>, const N: usize>(
    wave: &Wave,
    paths: &mut Paths,
    places: &[Place],
) {
    scatter::<W, N, DiffuseLanes<W, N>, false>(wave, paths, places);
}

/// Scatters on metal.
#[inline(always)]
pub(super) fn conductor<W: Wide<N>, const N: usize>(
    wave: &Wave,
    paths: &mut Paths,
    places: &[Place],
) {
    scatter::<W, N, ConductorLanes<W, N>, false>(wave, paths, places);
}

/// [`diffuse`] with the guidance that there is.
#[inline(always)]
pub(super) fn guide_diffuse<W: Wide<N>, const N: usize>(
    wave: &Wave,
    paths: &mut Paths,
    places: &[Place],
) {
    scatter::<W, N, DiffuseLanes<W, N>, true>(wave, paths, places);
}

/// [`conductor`] with the guidance that there is.
#[inline(always)]
pub(super) fn guide_conductor<W: Wide<N>, const N: usize>(
    wave: &Wave,
    paths: &mut Paths,
    places: &[Place],
) {
    scatter::<W, N, ConductorLanes<W, N>, true>(wave, paths, places);
}

/// Scatters at glass.
#[inline(always)]
pub(super) fn dielectric<W: Wide<N>, const N: usize>(
    wave: &Wave,
    paths: &mut Paths,
    places: &[Place],
) {
    scatter::<W, N, DielectricLanes<W, N>, false>(wave, paths, places);
}

/// [`dielectric`] on paths that are guided elsewhere.
#[inline(always)]
pub(super) fn guide_dielectric<W: Wide<N>, const N: usize>(
    wave: &Wave,
    paths: &mut Paths,
    places: &[Place],
) {
    scatter::<W, N, DielectricLanes<W, N>, true>(wave, paths, places);
}

/// What lights are to be chosen for on metal, where there is a choice.
#[inline(always)]
pub(super) fn aim_conductor<W: Wide<N>, const N: usize>(
    wave: &Wave,
    paths: &mut Paths,
    places: &[Place],
) {
    for places in places.chunks(N) {
        let group = Group::new(places);
        let vertex = Vertex::<W, N>::gather(paths, &group);
        let bsdf = model::<W, N, ConductorLanes<W, N>>(wave, paths, &group, &vertex);
        let wo = vertex.frame().to_local(vertex.wo);
        let zero = W::F::splat(0.0);
        keep_last::<W, N, ConductorLanes<W, N>>(paths, &group, &vertex, &bsdf, wo, zero);
    }
}

/// A vertex in each lane.
struct Vertex<W: Wide<N>, const N: usize> {
    wo: V3<W, N>,
    time: W::F,
    p: V3<W, N>,
    error: W::F,
    ng: V3<W, N>,
    n: V3<W, N>,
    /// Parameters of the model, or which material has them.
    given: V3<W, N>,
}

impl<W: Wide<N>, const N: usize> Vertex<W, N> {
    #[inline(always)]
    fn gather(paths: &Paths, group: &Group<N>) -> Self {
        let [.., dx, dy, dz, _, time] = W::gather(paths.rays(), &group.rays);
        let [px, py, pz, error, gx, gy, gz, _] = W::gather(&paths.point, &group.slots);
        let [nx, ny, nz, r, g, b, _, _] = W::gather(&paths.surface, &group.slots);
        Vertex {
            wo: -V3::new(dx, dy, dz),
            time,
            p: V3::new(px, py, pz),
            error,
            ng: V3::new(gx, gy, gz),
            n: V3::new(nx, ny, nz),
            given: V3::new(r, g, b),
        }
    }

    #[inline(always)]
    fn frame(&self) -> Frame3<W, N> {
        Frame3::from_normal(self.n)
    }

    /// See [`Interaction::origin_towards`](crate::geometry::Interaction::origin_towards).
    #[inline(always)]
    fn origin_towards(&self, w: V3<W, N>) -> V3<W, N> {
        self.p + self.ng * self.error.copysign(w.dot(self.ng))
    }
}

/// The models at vertices.
#[inline(always)]
fn model<W: Wide<N>, const N: usize, B: Lanes<W, N>>(
    wave: &Wave,
    paths: &Paths,
    group: &Group<N>,
    vertex: &Vertex<W, N>,
) -> B {
    let zero = W::F::splat(0.0);
    if B::AIM == AimOf::Normal {
        let V3 { x, y, z } = vertex.given;
        return B::new([[x, y, z, zero, zero, zero, zero, zero], [zero; LANES]]);
    }
    let mut rows = [[&Row::ZERO; N]; 2];
    for lane in 0..N {
        let material = paths.surface[group.slots[lane] as usize].0[3].to_bits();
        let params = wave.scene.stream.params(material);
        rows[0][lane] = &params[0];
        rows[1][lane] = &params[1];
    }
    B::new([W::columns(rows[0]), W::columns(rows[1])])
}

/// Keeps the vertex, what lights are chosen for there and the density that the direction was drawn with.
#[inline(always)]
fn keep_last<W: Wide<N>, const N: usize, B: Lanes<W, N>>(
    paths: &mut Paths,
    group: &Group<N>,
    vertex: &Vertex<W, N>,
    bsdf: &B,
    wo: V3<W, N>,
    drawn: W::F,
) {
    let zero = W::F::splat(0.0);
    let (axis, narrow) = match B::AIM {
        AimOf::Normal => (vertex.n, zero),
        AimOf::Mirrored => {
            let mirrored = V3::new(-wo.x, -wo.y, wo.z);
            (vertex.frame().to_world(mirrored), bsdf.narrowness())
        }
        AimOf::Anywhere => (V3::new(zero, zero, zero), zero),
    };
    let p = vertex.p;
    paths::scatter::<W, N>(
        &mut paths.last,
        &group.slots,
        [p.x, p.y, p.z, axis.x, axis.y, axis.z, narrow, drawn],
    );
}

/// Scatters at as many vertices at a time as there are lanes: shadow rays, and the rays that go on.
#[inline(always)]
fn scatter<W: Wide<N>, const N: usize, B: Lanes<W, N>, const GUIDED: bool>(
    wave: &Wave,
    paths: &mut Paths,
    places: &[Place],
) {
    let (zero, one) = (W::F::splat(0.0), W::F::splat(1.0));
    for places in places.chunks(N) {
        let group = Group::new(places);
        let vertex = Vertex::<W, N>::gather(paths, &group);
        let bsdf: B = model::<W, N, B>(wave, paths, &group, &vertex);
        let [lx, ly, bx, by, _, lobe, roulette, _] = W::gather(&paths.numbers, &group.slots);
        let [tr, tg, tb, eta_scale, _, depth, split, expected] =
            W::gather(&paths.carried, &group.slots);
        let frame = vertex.frame();
        let wo = frame.to_local(vertex.wo);
        let throughput = V3::<W, N>::new(tr, tg, tb);
        if wave.event == 0 {
            see::<W, N>(paths, &group, &vertex, bsdf.albedo(wo));
        }
        let depth = depth.bits() + W::I::splat(1);
        // Light that is sampled.
        let finds_lights = !bsdf.is_delta();
        if finds_lights.to_bits() & group.used != 0 {
            let (arriving, pmf) = light::sample::<W, N>(wave, paths, &group, vertex.p, (lx, ly));
            let (f, pdf) = bsdf.eval_pdf(wo, frame.to_local(arriving.wi));
            let (sent, arrives) = weighted::<W, N>(&arriving, pmf, f, pdf);
            let is_indirect = is_at_least::<W, N>(depth, 2);
            let clamp = wave.scene.clamp_indirect;
            let light = bounded::<W, N>(clamp, throughput.times(sent), is_indirect);
            let asked = (arrives & finds_lights).to_bits() & group.used;
            if asked != 0 {
                push_shadows::<W, N>(paths, &group, &vertex, &arriving, light, asked);
            }
        }
        // The direction that the path goes on in.
        let guided = if GUIDED {
            guide::<W, N, B>(wave, paths, &group, &frame, &bsdf, wo, lobe, (bx, by))
        } else {
            Guided::without(bsdf.sample(wo, lobe, (bx, by)))
        };
        let s = guided.s;
        let throughput = throughput.times(s.weight);
        let mut eta_scale = eta_scale;
        if GUIDED {
            let more = W::F::select(guided.any, guided.drawn / s.pdf, one);
            eta_scale = eta_scale * more;
        }
        let eta_scale = eta_scale * (s.eta * s.eta);
        let factor = W::F::splat(ROULETTE_FACTOR) * split;
        let mut keep = (throughput.max_element() * eta_scale * factor).min(one);
        if GUIDED {
            let weight = throughput.luminance() * split;
            let brings = weight * guided.comes;
            let by_guide = (W::F::splat(BRINGS_FACTOR) * brings / expected)
                .max(weight)
                .min(one);
            keep = W::F::select(guided.any & zero.lt(expected), by_guide, keep);
        }
        let is_at_stake = is_at_least::<W, N>(depth, ROULETTE_FROM);
        let goes_on = s.any & (!is_at_stake | roulette.lt(keep));
        let kept = throughput * (one / keep);
        let t = V3::select(is_at_stake, kept, throughput);
        let w = frame.to_world(s.wi);
        let origin = vertex.origin_towards(w);
        let next = W::records([
            origin.x,
            origin.y,
            origin.z,
            w.x,
            w.y,
            w.z,
            W::F::splat(f32::INFINITY),
            vertex.time,
        ]);
        let mut rest = goes_on.to_bits() & group.used;
        while rest != 0 {
            let lane = rest.trailing_zeros() as usize % N;
            rest &= rest - 1;
            paths.push_next(next[lane], group.slots[lane]);
        }
        let pdf = W::F::select(s.delta, W::F::splat(NO_DENSITY), s.pdf);
        let depth = W::F::from_bits(depth);
        paths::scatter::<W, N>(
            &mut paths.carried,
            &group.slots,
            [
                t.x,
                t.y,
                t.z,
                eta_scale,
                pdf,
                depth,
                split,
                if GUIDED { expected } else { zero },
            ],
        );
        let drawn = if GUIDED {
            W::F::select(is_at_stake, guided.drawn * keep, guided.drawn)
        } else {
            zero
        };
        keep_last::<W, N, B>(paths, &group, &vertex, &bsdf, wo, drawn);
    }
}

/// Directions drawn with or without guidance; see [`guide::Guided`](crate::guide::Guided).
struct Guided<W: Wide<N>, const N: usize> {
    s: Samples<W, N>,
    /// Density that they were drawn with.
    drawn: W::F,
    /// Radiance that is expected from there, where there was guidance,
    comes: W::F,
    /// that is, here.
    any: W::M,
}

impl<W: Wide<N>, const N: usize> Guided<W, N> {
    #[inline(always)]
    fn without(s: Samples<W, N>) -> Self {
        Guided {
            drawn: s.pdf,
            s,
            comes: W::F::splat(0.0),
            any: W::M::from_bits(0),
        }
    }
}

/// See [`Directions::guide`](crate::guide::Directions::guide).
#[inline(always)]
#[allow(clippy::too_many_arguments, reason = "all of a group at hand")]
fn guide<W: Wide<N>, const N: usize, B: Lanes<W, N>>(
    wave: &Wave,
    paths: &Paths,
    group: &Group<N>,
    frame: &Frame3<W, N>,
    bsdf: &B,
    wo: V3<W, N>,
    lobe: W::F,
    u: (W::F, W::F),
) -> Guided<W, N> {
    let mut roots = [0; N];
    let mut any = 0;
    for lane in 0..N {
        roots[lane] = paths.mark(group.slots[lane]).root();
        any |= u32::from(roots[lane] != 0) << lane;
    }
    let Some(guide) = wave.scene.guide.as_ref().filter(|_| any != 0) else {
        return Guided::without(bsdf.sample(wo, lobe, u));
    };
    let quads = guide.quads();
    let mut irradiance = Row::<N>::default();
    for lane in 0..N {
        irradiance.0[lane] = quads[roots[lane] as usize].0[3];
    }
    let (zero, one, share) = (W::F::splat(0.0), W::F::splat(1.0), W::F::splat(SHARE));
    let any = W::M::from_bits(any);
    let by_guide = any & lobe.lt(share);
    let rest = (lobe - share) * (one / (one - share));
    let mut s = bsdf.sample(wo, W::F::select(any, rest, lobe), u);
    let by_bsdf = frame.to_world(s.wi);
    let (w, density) = guide::lanes::draw::<W, N>(quads, &roots, by_guide, u, by_bsdf);
    let wi = V3::select(by_guide, frame.to_local(w), s.wi);
    let (f, pdf) = bsdf.eval_pdf(wo, wi);
    let pdf = W::F::select(by_guide, pdf, s.pdf);
    let weight = V3::select(by_guide, f, s.weight * s.pdf);
    let mixed = share * density + (one - share) * pdf;
    let drawn = W::F::select(any, mixed, s.pdf);
    s.any = (by_guide & !f.is_zero()) | (!by_guide & s.any);
    s.weight = V3::select(any, weight * (one / mixed), s.weight);
    s.pdf = pdf;
    s.wi = wi;
    let cos = wi.z.abs().max(W::F::splat(COS_MIN));
    let comes = W::F::load(&irradiance) * density / cos;
    Guided {
        s,
        drawn,
        comes: W::F::select(any, comes, zero),
        any,
    }
}

/// Keeps the layers of first surfaces.
#[inline(always)]
fn see<W: Wide<N>, const N: usize>(
    paths: &mut Paths,
    group: &Group<N>,
    vertex: &Vertex<W, N>,
    albedo: V3<W, N>,
) {
    let zero = W::F::splat(0.0);
    let mut depth = Row::default();
    let mut unseen = 0;
    for lane in 0..N {
        let place = Place {
            ray: group.rays[lane],
            slot: group.slots[lane],
        };
        depth.0[lane] = paths.hit_of(place.ray).t;
        unseen |= (!paths.seen_first(place) as u32) << lane;
    }
    if unseen == 0 {
        return;
    }
    let (n, wo) = (vertex.n, vertex.wo);
    let behind = n.dot(wo).lt(zero) & vertex.ng.dot(wo).lt(zero);
    let n = V3::select(behind, -n, n);
    let first = W::records([
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
        let lane = rest.trailing_zeros() as usize % N;
        rest &= rest - 1;
        let slot = group.slots[lane];
        paths.first[slot as usize] = first[lane];
        paths.set_seen(slot);
    }
}

/// Light that is sent on, weighted against sampling the BSDF, and where there is any.
#[inline(always)]
fn weighted<W: Wide<N>, const N: usize>(
    arriving: &Arriving<W, N>,
    pmf: W::F,
    f: V3<W, N>,
    pdf_bsdf: W::F,
) -> (V3<W, N>, W::M) {
    let one = W::F::splat(1.0);
    let pdf = arriving.pdf * pmf;
    let ratio = pdf_bsdf / pdf;
    let weight = one / (one + ratio * ratio);
    let certain = arriving.is_delta | pdf.eq(W::F::splat(f32::INFINITY));
    let weight = W::F::select(certain, one, weight);
    let sent = f.times(arriving.li) * (weight / pdf);
    let arrives = arriving.any & !f.is_zero() & !sent.is_zero();
    (sent, arrives)
}

/// The optional, biased bound; see [`path::bounded`](super::path::bounded).
#[inline(always)]
fn bounded<W: Wide<N>, const N: usize>(most: f32, light: V3<W, N>, is_indirect: W::M) -> V3<W, N> {
    if most == f32::INFINITY {
        return light;
    }
    let strongest = light.max_element();
    let most = W::F::splat(most);
    let beyond = is_indirect & most.lt(strongest);
    V3::select(beyond, light * (most / strongest), light)
}

#[inline(always)]
fn push_shadows<W: Wide<N>, const N: usize>(
    paths: &mut Paths,
    group: &Group<N>,
    vertex: &Vertex<W, N>,
    arriving: &Arriving<W, N>,
    light: V3<W, N>,
    mut asked: u32,
) {
    let far = arriving.at_infinity;
    let towards = V3::select(far, arriving.wi, arriving.target - vertex.p);
    let origin = vertex.origin_towards(towards);
    let direction = V3::select(far, arriving.wi, arriving.target - origin);
    let t_max = W::F::select(far, W::F::splat(f32::INFINITY), W::F::splat(0.9999));
    let rays = W::records([
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
        let lane = asked.trailing_zeros() as usize % N;
        asked &= asked - 1;
        let light = Rgb::new(lights[0].0[lane], lights[1].0[lane], lights[2].0[lane]);
        paths.push_shadow(rays[lane], light, group.slots[lane]);
    }
}

/// Whether small integers are at least some bound.
#[inline(always)]
fn is_at_least<W: Wide<N>, const N: usize>(x: W::I, bound: u32) -> W::M {
    W::F::splat(bound as f32).le(W::F::from_int(x))
}
