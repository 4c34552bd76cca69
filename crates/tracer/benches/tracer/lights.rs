//! Choosing a light and a point on it, in scenes with two, many and only one of the sky.

use crate::{BATCH, Numbers, prepared};
use divan::counter::ItemsCount;
use divan::{Bencher, black_box};
use glam::{Vec2, Vec3};
use tracer::light::Aim;

#[divan::bench(args = ["cornell-box", "umbrella-street", "environment"])]
fn sample(bencher: Bencher, name: &str) {
    let scene = prepared(name);
    let mut numbers = Numbers(5);
    let inputs: [(Vec3, Vec3, f32, Vec2); BATCH] = std::array::from_fn(|_| {
        let from = numbers.direction() * 2.0;
        (from, numbers.direction(), numbers.one(), numbers.two())
    });
    let lights = &scene.lights;
    bencher.counter(ItemsCount::new(BATCH)).bench_local(|| {
        let samples = inputs.iter().filter_map(|(from, n, choice, u)| {
            let (light, p) = lights.choose(*black_box(from), Aim::cosine(*n), *choice)?;
            let s = light.sample_li(&scene.textures, &lights.emissions, *from, *u)?;
            Some(s.li.x / (s.pdf * p))
        });
        samples.sum::<f32>()
    });
}
