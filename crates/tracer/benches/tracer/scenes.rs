//! Samples a second of whole scenes: one tile in the middle, on one thread.

use crate::prepared;
use divan::Bencher;
use divan::counter::ItemsCount;
use film::{SampleRange, Unit};
use tracer::{StopFlag, render_unit};

#[divan::bench(
    args = [
        "cornell-box", "soft-shadows", "glossy", "depth-of-field", "motion-blur", "environment", "glass",
        "metals", "textures", "instances", "veach-mis", "whitted", "umbrella-street",
        "door-ajar",
    ],
    sample_count = 5
)]
fn samples(bencher: Bencher, name: &str) {
    let scene = prepared(name);
    let unit = Unit {
        frame: 0,
        tile: scene.grid().count() / 2,
        samples: SampleRange { begin: 0, end: 16 },
    };
    let stop = StopFlag::default();
    let render = || render_unit(&scene, &unit, &stop).expect("nobody stops it");
    let samples = render().1.samples;
    bencher
        .counter(ItemsCount::new(samples))
        .bench_local(render);
}
