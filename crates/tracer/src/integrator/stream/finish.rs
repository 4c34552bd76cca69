//! From what paths have gathered to the sums of pixels.

use super::Wave;
use super::paths::Paths;
use crate::lanes::{Float, Row, V3, Wide};
use film::{Columns, SampleBuffer};

/// Adds all samples to the sums of their pixels; how many were rejected.
#[inline(always)]
pub(super) fn add<W: Wide<N>, const N: usize>(
    wave: &Wave,
    paths: &mut Paths,
    columns: &mut Columns,
    buffer: &mut SampleBuffer,
) -> u64 {
    paths.join();
    for begin in (0..paths.samples()).step_by(N) {
        fill::<W, N>(wave, paths, begin, columns);
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

/// Exposure, the optional limit, the filter's weight for as many samples as there are lanes; see `render::finish`.
#[inline(always)]
fn fill<W: Wide<N>, const N: usize>(wave: &Wave, paths: &Paths, at: usize, to: &mut Columns) {
    let scene = wave.scene;
    let s = at as u32;
    let mut slots = [s; N];
    for lane in 0..N {
        slots[lane] += lane as u32;
    }
    let [r, g, b, weight, ..] = W::gather(&paths.radiance, &slots);
    let mut radiance = V3::<W, N>::new(r, g, b).times(V3::splat(scene.exposure));
    if scene.max_component < f32::INFINITY {
        let limit = W::F::splat(scene.max_component);
        let most = radiance.max_element();
        radiance = V3::select(limit.lt(most), radiance * (limit / most), radiance);
    }
    let beauty = radiance * weight;
    let [alpha, ar, ag, ab, nx, ny, nz, depth] = W::gather(&paths.first, &slots);
    put::<W, N>(beauty.x, at, &mut to.beauty[0]);
    put::<W, N>(beauty.y, at, &mut to.beauty[1]);
    put::<W, N>(beauty.z, at, &mut to.beauty[2]);
    put::<W, N>(alpha * weight, at, &mut to.alpha);
    put::<W, N>(ar, at, &mut to.albedo[0]);
    put::<W, N>(ag, at, &mut to.albedo[1]);
    put::<W, N>(ab, at, &mut to.albedo[2]);
    put::<W, N>(nx, at, &mut to.normal[0]);
    put::<W, N>(ny, at, &mut to.normal[1]);
    put::<W, N>(nz, at, &mut to.normal[2]);
    put::<W, N>(depth, at, &mut to.depth);
}

#[inline(always)]
fn put<W: Wide<N>, const N: usize>(x: W::F, at: usize, column: &mut [f32; Columns::LONGEST]) {
    let mut row = Row::default();
    x.store(&mut row);
    column[at..at + N].copy_from_slice(&row.0);
}
