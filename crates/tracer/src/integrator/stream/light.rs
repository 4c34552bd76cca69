//! Light sampling for eight points at once.

use super::Wave;
use super::paths::{Group, Paths, Place};
use super::tables::FlatLight;
use crate::lanes::{Float, LANES, Mask, Row, V3, Wide};
use crate::light::Aim;
use glam::{Vec2, Vec3};

/// Light from a sampled point or direction, see [`LightSample`](crate::light::LightSample).
pub(super) struct Arriving<W: Wide> {
    /// Towards the light.
    pub wi: V3<W>,
    /// The point of the light.
    pub target: V3<W>,
    /// There is no such point: it lies at infinity.
    pub at_infinity: W::M,
    /// Radiance.
    pub li: V3<W>,
    /// Density of the direction, the choice of the light not included.
    pub pdf: W::F,
    /// No direction sampled otherwise meets the light.
    pub is_delta: W::M,
    /// Light may arrive at all.
    pub any: W::M,
}

/// No light.
const DARK: u32 = u32::MAX;

/// Chooses a light for each diffuse vertex, unless there is only one.
pub(super) fn choose(wave: &Wave, paths: &mut Paths, places: &[Place]) {
    let scene = wave.scene;
    if scene.stream.only().is_some() {
        return;
    }
    for place in places {
        let slot = place.slot as usize;
        let [x, y, z, ..] = paths.point[slot].0;
        let [nx, ny, nz, ..] = paths.surface[slot].0;
        let aim = Aim::cosine(Vec3::new(nx, ny, nz));
        let u = paths.numbers[slot].0[4];
        let (light, pmf) = scene
            .lights
            .choose_index(Vec3::new(x, y, z), aim, u)
            .unwrap_or((DARK, 1.0));
        paths.point[slot].0[7] = pmf;
        paths.surface[slot].0[6] = f32::from_bits(light);
    }
}

/// Samples the lights chosen for eight points with two numbers each; also the probabilities of the
/// choice.
#[inline(always)]
pub(super) fn sample<W: Wide>(
    wave: &Wave,
    paths: &Paths,
    group: &Group,
    from: V3<W>,
    u: (W::F, W::F),
) -> (Arriving<W>, W::F) {
    let tables = &wave.scene.stream;
    let one = W::F::splat(1.0);
    if let Some(light) = tables.only() {
        let arriving = match tables.flat_light(light) {
            Some(flat) => {
                let same = [
                    spread::<W>(flat, 0),
                    spread::<W>(flat, 1),
                    spread::<W>(flat, 2),
                ];
                flat_lights::<W>(same, from, u)
            }
            None => one_by_one::<W>(wave, paths, group, [light; LANES]),
        };
        return (arriving, one);
    }
    let mut lights = [DARK; LANES];
    let mut pmf = Row::default();
    let mut flat = [None; LANES];
    for lane in 0..LANES {
        let slot = group.slots[lane] as usize;
        pmf.0[lane] = paths.point[slot].0[7];
        lights[lane] = paths.surface[slot].0[6].to_bits();
        if lights[lane] != DARK {
            flat[lane] = tables.flat_light(lights[lane]);
        }
    }
    let pmf = W::F::load(&pmf);
    let [
        Some(a),
        Some(b),
        Some(c),
        Some(d),
        Some(e),
        Some(f),
        Some(g),
        Some(h),
    ] = flat
    else {
        return (one_by_one::<W>(wave, paths, group, lights), pmf);
    };
    let lights = [a, b, c, d, e, f, g, h];
    let columns = [
        columns::<W>(lights, 0),
        columns::<W>(lights, 1),
        columns::<W>(lights, 2),
    ];
    (flat_lights::<W>(columns, from, u), pmf)
}

/// [`AreaLight::sample_li`](crate::light::AreaLight::sample_li) for flat lights.
#[inline(always)]
fn flat_lights<W: Wide>(
    lights: [[W::F; LANES]; 3],
    from: V3<W>,
    (ux, uy): (W::F, W::F),
) -> Arriving<W> {
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
    let p = V3::<W>::new(px, py, pz);
    let n = V3::<W>::new(nx, ny, nz);
    let q = p + V3::new(ax, ay, az) * x + V3::new(bx, by, bz) * y;
    let d = q - from;
    let distance2 = d.dot(d);
    let wi = d * (W::F::splat(1.0) / distance2.sqrt());
    let cos = -n.dot(wi);
    let shines = zero.lt(cos) | (zero.lt(two_sided) & cos.lt(zero));
    let li = V3::<W>::new(r, g, b);
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

/// The columns of eight times the same light.
#[inline(always)]
fn spread<W: Wide>(light: &FlatLight, row: usize) -> [W::F; LANES] {
    let mut columns = [W::F::splat(0.0); LANES];
    for (column, x) in columns.iter_mut().zip(light.rows[row].0) {
        *column = W::F::splat(x);
    }
    columns
}

/// The columns of eight lights.
#[inline(always)]
fn columns<W: Wide>(lights: [&FlatLight; LANES], row: usize) -> [W::F; LANES] {
    W::transpose([
        W::F::load(&lights[0].rows[row]),
        W::F::load(&lights[1].rows[row]),
        W::F::load(&lights[2].rows[row]),
        W::F::load(&lights[3].rows[row]),
        W::F::load(&lights[4].rows[row]),
        W::F::load(&lights[5].rows[row]),
        W::F::load(&lights[6].rows[row]),
        W::F::load(&lights[7].rows[row]),
    ])
}

/// Any lights, one lane after another.
#[inline(always)]
fn one_by_one<W: Wide>(
    wave: &Wave,
    paths: &Paths,
    group: &Group,
    lights: [u32; LANES],
) -> Arriving<W> {
    let mut lanes = Singles::default();
    fill(wave, paths, group, lights, &mut lanes);
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
struct Singles {
    wi: [Row; 3],
    target: [Row; 3],
    li: [Row; 3],
    pdf: Row,
    at_infinity: u32,
    is_delta: u32,
    any: u32,
}

#[inline(never)]
fn fill(wave: &Wave, paths: &Paths, group: &Group, lights: [u32; LANES], lanes: &mut Singles) {
    let scene = wave.scene;
    for (lane, light) in lights.into_iter().enumerate() {
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
