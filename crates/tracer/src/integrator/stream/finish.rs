//! From what paths have gathered to the sums of pixels.

use super::Wave;
use super::paths::{self, Paths};
use crate::lanes::{Float, LANES, Row, V3, Wide};
use film::{Run, SampleBuffer};

/// Adds all samples to the sums of their pixels; how many were rejected.
#[inline(always)]
pub(super) fn add<W: Wide>(wave: &Wave, paths: &mut Paths, buffer: &mut SampleBuffer) -> u64 {
    let mut run = Run::new();
    let mut rejected = 0;
    let mut begin = 0;
    while begin < paths.len() {
        let pixel = *paths.pixel(begin);
        let mut end = begin + 1;
        while end < paths.len()
            && end - begin < Run::LONGEST
            && paths.pixel(end).place == pixel.place
        {
            end += 1;
        }
        let mut at = 0;
        while begin + at < end {
            columns::<W>(wave, paths, begin + at, at, &mut run);
            at += LANES;
        }
        let [x, y] = pixel.place;
        rejected += buffer.add_run(x, y, paths.index(begin), end - begin, &run);
        begin = end;
    }
    rejected
}

/// Exposure, the optional limit, the filter's weight for eight samples; see `render::finish`.
#[inline(always)]
fn columns<W: Wide>(wave: &Wave, paths: &Paths, slot: usize, at: usize, run: &mut Run) {
    let scene = wave.scene;
    let s = slot as u32;
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
    put::<W>(beauty.x, at, &mut run.beauty[0]);
    put::<W>(beauty.y, at, &mut run.beauty[1]);
    put::<W>(beauty.z, at, &mut run.beauty[2]);
    put::<W>(alpha * weight, at, &mut run.alpha);
    put::<W>(ar, at, &mut run.albedo[0]);
    put::<W>(ag, at, &mut run.albedo[1]);
    put::<W>(ab, at, &mut run.albedo[2]);
    put::<W>(nx, at, &mut run.normal[0]);
    put::<W>(ny, at, &mut run.normal[1]);
    put::<W>(nz, at, &mut run.normal[2]);
    put::<W>(depth, at, &mut run.depth);
}

#[inline(always)]
fn put<W: Wide>(x: W::F, at: usize, column: &mut [f32; Run::LONGEST]) {
    let mut row = Row::default();
    x.store(&mut row);
    column[at..at + LANES].copy_from_slice(&row.0);
}
