//! Samples that are split into several paths at their first vertex: the same mean, less noise where light
//! bounces, and left alone where that does not pay.

use crate::common::*;
use film::{SampleRange, Unit};
use scene::assets::MemorySource;
use scene::model::*;
use testkit::{Moments, ttest};
use tracer::{Scene, StopFlag};

/// A corner of two walls, a lamp that shines away from them onto a third, metal, glass, and a border that
/// is no surface before a part of it.
fn corner() -> SceneDesc {
    let mut desc = blank(48, 48);
    desc.camera.projection = perspective(60.0, None);
    desc.camera.transform = Motion::fixed(look([0.0, 1.0, 4.0], [0.0, 0.8, 0.0], [0.0, 1.0, 0.0]));
    let floor = horizontal([0.0; 3], 3.0, 3.0);
    desc.place(Shape::Rectangle, floor, diffuse(0.7));
    let wall = spanned([0.0, 1.5, -1.5], [1.5, 0.0, 0.0], [0.0, 1.5, 0.0]);
    desc.place(Shape::Rectangle, wall, diffuse(0.6));
    let side = spanned([-1.5, 1.5, 0.0], [0.0, 0.0, -1.5], [0.0, 1.5, 0.0]);
    desc.place(Shape::Rectangle, side, diffuse(0.8));
    desc.place(Shape::Sphere { radius: 0.4 }, at(0.7, 0.4, -0.3), glass());
    let metal = BsdfDesc::Conductor {
        fresnel: ConductorFresnel::Reflectance(grey(0.8)),
        roughness: Roughness {
            u: FloatTex::Const(0.3),
            ..smooth()
        },
    };
    desc.place(Shape::Sphere { radius: 0.4 }, at(-0.4, 0.4, 0.2), metal);
    let border = spanned([0.6, 0.8, 1.0], [0.5, 0.0, 0.0], [0.0, 0.5, 0.0]);
    desc.place(Shape::Rectangle, border, BsdfDesc::Interface);
    let lamp = spanned([0.0, 1.4, -1.2], [0.3, 0.0, 0.0], [0.0, 0.3, 0.0]);
    let lamp = desc.place(Shape::Rectangle, lamp, diffuse(0.0));
    lamp.emission = shining(8.0);
    lamp.reverse_orientation = true;
    desc.lights.push(sky(0.05));
    desc
}

/// Rays of all samples.
fn rays(scene: &Scene, spp: u32) -> u64 {
    let samples = SampleRange { begin: 0, end: spp };
    let unit = |tile| Unit {
        frame: 0,
        tile,
        samples,
    };
    (0..scene.grid().count())
        .map(|tile| {
            let stop = StopFlag::default();
            let (_, counters) = tracer::render_unit(scene, &unit(tile), &stop).unwrap();
            counters.rays + counters.shadow_rays
        })
        .sum()
}

/// Mean square difference of two pictures, that is twice the variance of each.
fn difference(a: &Picture, b: &Picture) -> f64 {
    let squares = a.rgb.iter().zip(&b.rgb).map(|(a, b)| (a[1] - b[1]).powi(2));
    squares.sum::<f64>() / a.rgb.len() as f64
}

fn compiled(desc: &SceneDesc, seed: u64, split: Option<u32>) -> Scene {
    let mut scene = compile(desc, &MemorySource::new(), seed, 2);
    if let Some(split) = split {
        scene.set_split(split);
    }
    scene
}

#[test]
fn the_mean_stays() {
    let mut desc = corner();
    for sampler in [SamplerKind::Lattice, SamplerKind::Independent] {
        desc.sampler = sampler;
        let whole = Picture::of(&compiled(&desc, 1, Some(1)), 256);
        for split in [None, Some(2), Some(4)] {
            let parts = Picture::of(&compiled(&desc, 2, split), 256);
            assert_eq!(parts.rejected, 0);
            let differences: Moments = (whole.rgb.iter().zip(&parts.rgb))
                .map(|(a, b)| a[1] - b[1])
                .collect();
            let what = format!("{sampler:?}, split {split:?}");
            assert!(
                differences.error() < 1e-3,
                "{what}: {}",
                differences.error()
            );
            ttest::assert_mean(&what, &differences, 0.0, LEVEL);
        }
    }
}

/// Four paths a sample are far quieter than one where all light has bounced.
#[test]
fn bounced_light_gets_quieter() {
    let desc = corner();
    let noise = |split| {
        let [a, b] = [1, 2].map(|seed| Picture::of(&compiled(&desc, seed, Some(split)), 16));
        difference(&a, &b)
    };
    let (one, four) = (noise(1), noise(4));
    assert!(
        four < 0.4 * one,
        "variance {four} with four, {one} with one"
    );
}

/// What is chosen is better than what is not chosen, and no sample is split where only the lens and edges
/// make noise.
#[test]
fn the_choice_pays() {
    let desc = corner();
    let cost = |split| {
        let scenes = [1, 2].map(|seed| compiled(&desc, seed, split));
        let pictures = [0, 1].map(|i| Picture::of(&scenes[i], 16));
        difference(&pictures[0], &pictures[1]) * rays(&scenes[0], 16) as f64
    };
    let (chosen, one) = (cost(None), cost(Some(1)));
    assert!(chosen < 0.9 * one, "{chosen} as chosen, {one} without");

    let mut edges = blank(96, 96);
    let glowing = |desc: &mut SceneDesc, x, radiance| {
        let shape = Shape::Sphere { radius: 0.2 };
        desc.place(shape, at(x, 0.1, -2.0), diffuse(0.0)).emission = shining(radiance);
    };
    glowing(&mut edges, -0.4, 1.0);
    glowing(&mut edges, 0.3, 3.0);
    edges.integrator = Integrator::Path { max_depth: 1 };
    let (chosen, one) = (compiled(&edges, 1, None), compiled(&edges, 1, Some(1)));
    assert_eq!(rays(&chosen, 4), rays(&one, 4));
}

/// Samples differ in what they see of a surface that is half not there. If those of a pixel all took the
/// same half, because numbers drawn before paths are split are only every second or fourth of a
/// sequence, splitting would make noise instead of less.
#[test]
fn choices_before_the_split_stay_spread() {
    let mut desc = blank(32, 32);
    desc.camera.transform = Motion::fixed(look([0.0, 3.0, 0.0], [0.0; 3], [0.0, 0.0, 1.0]));
    let a = desc.material(diffuse(0.8));
    let b = desc.material(BsdfDesc::Interface);
    let amount = FloatTex::Const(0.5);
    let cut_out = BsdfDesc::Mix { a, b, amount };
    desc.place(Shape::Rectangle, horizontal([0.0; 3], 4.0, 4.0), cut_out);
    let below = horizontal([0.0, -1.0, 0.0], 40.0, 40.0);
    desc.place(Shape::Rectangle, below, diffuse(0.1));
    desc.lights.push(sky(1.0));
    let noise = |split| {
        let [a, b] = [1, 2].map(|seed| Picture::of(&compiled(&desc, seed, Some(split)), 16));
        difference(&a, &b)
    };
    let (one, two, four) = (noise(1), noise(2), noise(4));
    assert!(
        two < 1.1 * one && four < 1.1 * one,
        "variance {one} with one, {two} with two, {four} with four"
    );
}
