//! From what paths have gathered to the sums of pixels.

use super::Wave;
use super::paths::{self, Paths};
use crate::lanes::{Float, LANES, Row, V3, Wide};
use film::{Columns, SampleBuffer};

/// Adds all samples to the sums of their pixels; how many were rejected.
#[inline(always)]
pub(super) fn add<W: Wide>(
    wave: &Wave,
    paths: &mut Paths,
    columns: &mut Columns,
    buffer: &mut SampleBuffer,
) -> u64 {
    paths.join();
    for begin in (0..paths.samples()).step_by(LANES) {
        fill::<W>(wave, paths, begin, columns);
    }
    let mut rejected = 0;
    let mut begin = 0;
    while begin < paths.samples() {
        let slot = paths.slot_of(begin);
        let end = paths.end_of_pixel(slot);
        let [x, y] = paths.pixel(slot).place;
        rejected += buffer.add_run(x, y, paths.index(slot), begin..end, columns);
        begin = end;
    }
    rejected
}

/// Exposure, the optional limit, the filter's weight for eight samples; see `render::finish`.
#[inline(always)]
fn fill<W: Wide>(wave: &Wave, paths: &Paths, at: usize, to: &mut Columns) {
    let scene = wave.scene;
    let s = at as u32;
    let slots = [s, s + 1, s + 2, s + 3, s + 4, s + 5, s + 6, s + 7];
    let [r, g, b, weight, ..] = paths::gather::<W>(&paths.radiance, &slots);
    let mut radiance = V3::<W>::new(r, g, b).times(V3::splat(scene.exposure));
    if scene.max_component < f32::INFINITY {
        let limit = W::F::splat(scene.max_component);
        let most = radiance.max_element();
        radiance = V3::select(limit.lt(most), radiance * (limit / most), radiance);
    }
    let beauty = radiance * weight;
    let [alpha, ar, ag, ab, nx, ny, nz, depth] = paths::gather::<W>(&paths.first, &slots);
    put::<W>(beauty.x, at, &mut to.beauty[0]);
    put::<W>(beauty.y, at, &mut to.beauty[1]);
    put::<W>(beauty.z, at, &mut to.beauty[2]);
    put::<W>(alpha * weight, at, &mut to.alpha);
    put::<W>(ar, at, &mut to.albedo[0]);
    put::<W>(ag, at, &mut to.albedo[1]);
    put::<W>(ab, at, &mut to.albedo[2]);
    put::<W>(nx, at, &mut to.normal[0]);
    put::<W>(ny, at, &mut to.normal[1]);
    put::<W>(nz, at, &mut to.normal[2]);
    put::<W>(depth, at, &mut to.depth);
}

#[inline(always)]
fn put<W: Wide>(x: W::F, at: usize, column: &mut [f32; Columns::LONGEST]) {
    let mut row = Row::default();
    x.store(&mut row);
    column[at..at + LANES].copy_from_slice(&row.0);
}
