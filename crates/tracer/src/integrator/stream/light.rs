//! Light sampling for as many points at once as there are lanes.

use super::paths::{Group, Paths, Place};
use super::tables::{Lamp, Model};
use super::{Wave, entry};
use crate::lanes::{Float, Frame3, Int, LANES, Mask, Row, V3, Wide};
use crate::light::{Aim, Asking, CONE_MIN, INSIDE};
use crate::math::TWO_PI;
use crate::sampling;
use glam::{Vec2, Vec3};

/// Light from a sampled point or direction, see [`LightSample`](crate::light::LightSample).
pub(super) struct Arriving<W: Wide<N>, const N: usize> {
    /// Towards the light.
    pub wi: V3<W, N>,
    /// The point of the light.
    pub target: V3<W, N>,
    /// There is no such point: it lies at infinity.
    pub at_infinity: W::M,
    /// Radiance.
    pub li: V3<W, N>,
    /// Density of the direction, the choice of the light not included.
    pub pdf: W::F,
    /// No direction sampled otherwise meets the light.
    pub is_delta: W::M,
    /// Light may arrive at all.
    pub any: W::M,
}

/// No light.
const DARK: u32 = u32::MAX;

/// What light is asked for: by which paths, and which lights were chosen.
struct Asked<'a, const N: usize> {
    wave: &'a Wave<'a>,
    paths: &'a Paths,
    group: &'a Group<N>,
    lights: [u32; N],
}

/// Chooses a light for each vertex, unless there is only one.
pub(super) fn choose(wave: &Wave, paths: &mut Paths, model: Model, places: &[Place]) {
    let scene = wave.scene;
    if scene.stream.only().is_some() {
        return;
    }
    if scene.lights.suit_lanes() {
        let level = scene.geometry.level;
        match model {
            Model::Diffuse => entry::choose_for_diffuse(level, wave, paths, places),
            Model::Conductor => entry::choose_for_conductor(level, wave, paths, places),
            _ => entry::choose_for_any(level, wave, paths, places),
        }
        return;
    }
    for place in places {
        let slot = place.slot as usize;
        let [x, y, z, ..] = paths.point[slot].0;
        let [nx, ny, nz, ..] = paths.surface[slot].0;
        let aim = match model {
            Model::Diffuse => Aim::cosine(Vec3::new(nx, ny, nz)),
            Model::Conductor => paths.last_aim(*place),
            _ => Aim::ANYWHERE,
        };
        let u = paths.numbers[slot].0[4];
        let (light, pmf) = scene
            .lights
            .choose_index(Vec3::new(x, y, z), aim, u)
            .unwrap_or((DARK, 1.0));
        paths.point[slot].0[7] = pmf;
        paths.surface[slot].0[6] = f32::from_bits(light);
    }
}

/// [`choose`] for diffuse vertices, in lanes.
#[inline(always)]
pub(super) fn for_diffuse<W: Wide<N>, const N: usize>(
    wave: &Wave,
    paths: &mut Paths,
    places: &[Place],
) {
    choose_for::<W, N, { Model::Diffuse as u8 }>(wave, paths, places);
}

/// [`choose`] for metal, in lanes.
#[inline(always)]
pub(super) fn for_conductor<W: Wide<N>, const N: usize>(
    wave: &Wave,
    paths: &mut Paths,
    places: &[Place],
) {
    choose_for::<W, N, { Model::Conductor as u8 }>(wave, paths, places);
}

/// [`choose`] whatever directions matter, in lanes.
#[inline(always)]
pub(super) fn for_any<W: Wide<N>, const N: usize>(
    wave: &Wave,
    paths: &mut Paths,
    places: &[Place],
) {
    choose_for::<W, N, { Model::Other as u8 }>(wave, paths, places);
}

#[inline(always)]
fn choose_for<W: Wide<N>, const N: usize, const MODEL: u8>(
    wave: &Wave,
    paths: &mut Paths,
    places: &[Place],
) {
    for places in places.chunks(N) {
        let group = Group::new(places);
        let zero = W::F::splat(0.0);
        let [px, py, pz, ..] = W::gather(&paths.point, &group.slots);
        let mut axis = V3::new(zero, zero, zero);
        let mut narrow = W::I::splat(0);
        if MODEL == Model::Diffuse as u8 {
            let [nx, ny, nz, ..] = W::gather(&paths.surface, &group.slots);
            axis = V3::new(nx, ny, nz);
        } else if MODEL == Model::Conductor as u8 {
            let [_, _, _, ax, ay, az, squared, _] = W::gather(&paths.last, &group.slots);
            axis = V3::new(ax, ay, az);
            narrow = squared.bits();
        }
        let [_, _, _, _, u, ..] = W::gather(&paths.numbers, &group.slots);
        let asking = Asking {
            p: V3::new(px, py, pz),
            axis,
            narrow,
        };
        let (light, pmf) = wave.scene.lights.choose_in_lanes::<W, N>(&asking, u);
        let is_dark = pmf.le(zero);
        let light = W::F::select(
            is_dark,
            W::F::from_bits(W::I::splat(DARK)),
            W::F::from_bits(light),
        );
        let pmf = W::F::select(is_dark, W::F::splat(1.0), pmf);
        let (mut lights, mut probabilities) = (Row::<N>::default(), Row::<N>::default());
        light.store(&mut lights);
        pmf.store(&mut probabilities);
        for (lane, place) in places.iter().enumerate() {
            let slot = place.slot as usize;
            paths.point[slot].0[7] = probabilities.0[lane];
            paths.surface[slot].0[6] = lights.0[lane];
        }
    }
}

/// Samples the lights chosen for points with two numbers each; also the probabilities of the
/// choice.
#[inline(always)]
pub(super) fn sample<W: Wide<N>, const N: usize>(
    wave: &Wave,
    paths: &Paths,
    group: &Group<N>,
    from: V3<W, N>,
    u: (W::F, W::F),
) -> (Arriving<W, N>, W::F) {
    let tables = &wave.scene.stream;
    let one = W::F::splat(1.0);
    if let Some(light) = tables.only() {
        let asked = Asked {
            wave,
            paths,
            group,
            lights: [light; N],
        };
        let arriving = match tables.lamp(light) {
            Some(lamp) => {
                let same = [
                    spread::<W, N>(lamp, 0),
                    spread::<W, N>(lamp, 1),
                    spread::<W, N>(lamp, 2),
                ];
                lamps::<W, N>(&asked, lamp.is_sphere, same, from, u)
            }
            None => one_by_one::<W, N>(&asked),
        };
        return (arriving, one);
    }
    let mut lights = [DARK; N];
    let mut pmf = Row::default();
    let mut chosen = [None; N];
    let mut spheres = 0;
    for lane in 0..N {
        let slot = group.slots[lane] as usize;
        pmf.0[lane] = paths.point[slot].0[7];
        lights[lane] = paths.surface[slot].0[6].to_bits();
        if lights[lane] != DARK {
            chosen[lane] = tables.lamp(lights[lane]);
        }
        spheres += chosen[lane].is_some_and(|l| l.is_sphere) as usize;
    }
    let pmf = W::F::load(&pmf);
    let asked = Asked {
        wave,
        paths,
        group,
        lights,
    };
    let Some(first) = chosen[0] else {
        return (one_by_one::<W, N>(&asked), pmf);
    };
    let mut all = [first; N];
    for lane in 1..N {
        let Some(lamp) = chosen[lane] else {
            return (one_by_one::<W, N>(&asked), pmf);
        };
        all[lane] = lamp;
    }
    if spheres % N != 0 {
        return (one_by_one::<W, N>(&asked), pmf);
    }
    let columns = [
        columns::<W, N>(all, 0),
        columns::<W, N>(all, 1),
        columns::<W, N>(all, 2),
    ];
    let are_spheres = spheres == N;
    let arriving = lamps::<W, N>(&asked, are_spheres, columns, from, u);
    (arriving, pmf)
}

/// Lamps that are all flat or all spheres.
#[inline(always)]
fn lamps<W: Wide<N>, const N: usize>(
    asked: &Asked<N>,
    are_spheres: bool,
    columns: [[W::F; LANES]; 3],
    from: V3<W, N>,
    u: (W::F, W::F),
) -> Arriving<W, N> {
    if !are_spheres {
        return flat::<W, N>(columns, from, u);
    }
    let (arriving, outside) = spheres::<W, N>(columns, from, u);
    if (!outside).to_bits() & asked.group.used != 0 {
        return one_by_one::<W, N>(asked);
    }
    arriving
}

/// The same for spheres that fill a cone; and where they do, as they do from outside.
#[inline(always)]
fn spheres<W: Wide<N>, const N: usize>(
    lights: [[W::F; LANES]; 3],
    from: V3<W, N>,
    (ux, uy): (W::F, W::F),
) -> (Arriving<W, N>, W::M) {
    let [cx, cy, cz, radius, ..] = lights[0];
    let [.., r, g, b] = lights[1];
    let [inward, two_sided, unseen, ..] = lights[2];
    let (zero, one) = (W::F::splat(0.0), W::F::splat(1.0));
    let center = V3::<W, N>::new(cx, cy, cz);
    let d = center - from;
    let (d2, r2) = (d.dot(d), radius * radius);
    let outside = !d2.le(r2 * W::F::splat(INSIDE));
    let sin2 = r2 / d2;
    let one_minus_cos = sin2 / (one + (one - sin2).sqrt());
    let one_minus_cos = one_minus_cos.max(W::F::splat(CONE_MIN));
    let distance = d.length();
    let frame = Frame3::<W, N>::from_normal(d * (one / distance));
    let local = sampling::lanes::uniform_cone::<W, N>(ux, uy, one_minus_cos);
    let wi = frame.to_world(local);
    let sin2 = (one - local.z * local.z).max(zero);
    let height2 = radius * radius - distance * distance * sin2;
    let t = distance * local.z - height2.max(zero).sqrt();
    let on = from + wi * t;
    let n = (on - center).normalized();
    let q = center + n * radius;
    let pdf = one / (W::F::splat(TWO_PI) * one_minus_cos);
    let n = (q - center).normalized() * inward;
    let cos = -n.dot(wi);
    let shines = zero.lt(cos) | (zero.lt(two_sided) & cos.lt(zero));
    let li = V3::<W, N>::new(r, g, b);
    let any = shines & !li.is_zero() & zero.lt(pdf) & pdf.lt(W::F::splat(f32::INFINITY));
    let arriving = Arriving {
        wi,
        target: q,
        at_infinity: W::M::from_bits(0),
        li,
        pdf,
        is_delta: zero.lt(unseen),
        any,
    };
    (arriving, outside)
}

/// [`AreaLight::sample_li`](crate::light::AreaLight::sample_li) for flat lights.
#[inline(always)]
fn flat<W: Wide<N>, const N: usize>(
    lights: [[W::F; LANES]; 3],
    from: V3<W, N>,
    (ux, uy): (W::F, W::F),
) -> Arriving<W, N> {
    let [px, py, pz, ax, ay, az, bx, by] = lights[0];
    let [bz, nx, ny, nz, pdf_area, r, g, b] = lights[1];
    let [is_triangle, two_sided, unseen, ..] = lights[2];
    let (zero, half) = (W::F::splat(0.0), W::F::splat(0.5));
    let is_triangle = zero.lt(is_triangle);
    // The square, folded along its diagonal for triangles.
    let upper = ux.lt(uy);
    let small = half * W::F::select(upper, ux, uy);
    let x = W::F::select(upper, small, ux - small);
    let y = W::F::select(upper, uy - small, small);
    let x = W::F::select(is_triangle, x, ux);
    let y = W::F::select(is_triangle, y, uy);
    let p = V3::<W, N>::new(px, py, pz);
    let n = V3::<W, N>::new(nx, ny, nz);
    let q = p + V3::new(ax, ay, az) * x + V3::new(bx, by, bz) * y;
    let d = q - from;
    let distance2 = d.dot(d);
    let wi = d * (W::F::splat(1.0) / distance2.sqrt());
    let cos = -n.dot(wi);
    let shines = zero.lt(cos) | (zero.lt(two_sided) & cos.lt(zero));
    let li = V3::<W, N>::new(r, g, b);
    let pdf = pdf_area * distance2 / cos.abs();
    let any = shines & !li.is_zero() & pdf.lt(W::F::splat(f32::INFINITY)) & !distance2.eq(zero);
    Arriving {
        wi,
        target: q,
        at_infinity: W::M::from_bits(0),
        li,
        pdf,
        is_delta: zero.lt(unseen),
        any,
    }
}

/// The columns of the same light in every lane.
#[inline(always)]
fn spread<W: Wide<N>, const N: usize>(light: &Lamp, row: usize) -> [W::F; LANES] {
    let mut columns = [W::F::splat(0.0); LANES];
    for (column, x) in columns.iter_mut().zip(light.rows[row].0) {
        *column = W::F::splat(x);
    }
    columns
}

/// The columns of as many lights as lanes.
#[inline(always)]
fn columns<W: Wide<N>, const N: usize>(lights: [&Lamp; N], row: usize) -> [W::F; LANES] {
    let mut rows = [&lights[0].rows[row]; N];
    for lane in 1..N {
        rows[lane] = &lights[lane].rows[row];
    }
    W::columns(rows)
}

/// Any lights, one lane after another.
#[inline(always)]
fn one_by_one<W: Wide<N>, const N: usize>(asked: &Asked<N>) -> Arriving<W, N> {
    let mut lanes = Singles::default();
    fill(asked, &mut lanes);
    Arriving {
        wi: V3::load(&lanes.wi),
        target: V3::load(&lanes.target),
        at_infinity: W::M::from_bits(lanes.at_infinity),
        li: V3::load(&lanes.li),
        pdf: W::F::load(&lanes.pdf),
        is_delta: W::M::from_bits(lanes.is_delta),
        any: W::M::from_bits(lanes.any),
    }
}

/// What [`one_by_one`] fills.
#[derive(Default)]
struct Singles<const N: usize> {
    wi: [Row<N>; 3],
    target: [Row<N>; 3],
    li: [Row<N>; 3],
    pdf: Row<N>,
    at_infinity: u32,
    is_delta: u32,
    any: u32,
}

#[inline(never)]
fn fill<const N: usize>(asked: &Asked<N>, lanes: &mut Singles<N>) {
    let Asked {
        wave,
        paths,
        group,
        lights,
    } = asked;
    let scene = wave.scene;
    for (lane, &light) in lights.iter().enumerate() {
        if group.used >> lane & 1 == 0 || light == DARK {
            continue;
        }
        let slot = group.slots[lane] as usize;
        let [x, y, z, ..] = paths.point[slot].0;
        let [ux, uy, ..] = paths.numbers[slot].0;
        let light = &scene.lights.lights[light as usize];
        let Some(sample) = light.sample_li(
            &scene.textures,
            &scene.lights.emissions,
            Vec3::new(x, y, z),
            Vec2::new(ux, uy),
        ) else {
            continue;
        };
        let target = sample.target.unwrap_or(Vec3::ZERO);
        for axis in 0..3 {
            lanes.wi[axis].0[lane] = sample.wi[axis];
            lanes.target[axis].0[lane] = target[axis];
            lanes.li[axis].0[lane] = sample.li[axis];
        }
        lanes.pdf.0[lane] = sample.pdf;
        lanes.at_infinity |= (sample.target.is_none() as u32) << lane;
        lanes.is_delta |= (sample.delta as u32) << lane;
        lanes.any |= 1 << lane;
    }
}
