//! Paths that are guided: the same mean, less noise where light comes through gaps and round corners, the
//! same bits whoever trains.

use crate::common::*;
use film::{SampleRange, Unit};
use scene::assets::MemorySource;
use scene::model::*;
use std::sync::Arc;
use testkit::{Moments, ttest};
use tracer::{PrepareError, PrepareSettings, Scene, StopFlag};

/// A room with all kinds of things in it and a lamp behind a wall, which shines up at the ceiling there: what the
/// camera sees is lit through the gap between the wall and the ceiling.
fn room(is_guided: bool) -> SceneDesc {
    let mut desc = blank(48, 48);
    let max_depth = 24;
    desc.integrator = if is_guided {
        Integrator::Guided { max_depth }
    } else {
        Integrator::Path { max_depth }
    };
    desc.camera.projection = perspective(70.0, None);
    desc.camera.transform = Motion::fixed(look([0.0, 1.0, 1.9], [0.0, 0.8, 0.0], [0.0, 1.0, 0.0]));
    let wall = |desc: &mut SceneDesc, center, a, b, reflectance| {
        desc.place(
            Shape::Rectangle,
            spanned(center, a, b),
            diffuse(reflectance),
        );
    };
    let (x, y, z) = ([2.0, 0.0, 0.0], [0.0, 1.2, 0.0], [0.0, 0.0, 3.0]);
    wall(&mut desc, [0.0, 0.0, -1.0], z, x, 0.6);
    wall(&mut desc, [0.0, 2.4, -1.0], x, z, 0.8);
    wall(&mut desc, [-2.0, 1.2, -1.0], y, z, 0.7);
    wall(&mut desc, [2.0, 1.2, -1.0], z, y, 0.5);
    wall(&mut desc, [0.0, 1.2, 2.0], y, x, 0.7);
    wall(&mut desc, [0.0, 1.2, -4.0], x, y, 0.7);
    // The wall between, on either side.
    let between = [0.0, 1.1, 0.0];
    wall(&mut desc, [0.0, 1.1, -1.5], x, between, 0.7);
    wall(&mut desc, [0.0, 1.1, -1.6], between, x, 0.7);
    let lamp = spanned([0.0, 1.2, -3.0], [0.0, 0.0, -0.4], [-0.4, 0.0, 0.0]);
    desc.place(Shape::Rectangle, lamp, diffuse(0.0)).emission = shining(60.0);
    let rough = |u| Roughness {
        u: FloatTex::Const(u),
        v: FloatTex::Const(u),
        scale: RoughnessScale::Alpha,
    };
    let metal = |u| BsdfDesc::Conductor {
        fresnel: ConductorFresnel::Reflectance(grey(0.8)),
        roughness: rough(u),
    };
    let ball = Shape::Sphere { radius: 0.25 };
    desc.place(ball.clone(), at(-0.9, 0.25, 0.0), metal(0.5));
    desc.place(ball.clone(), at(-0.3, 0.25, -0.4), metal(0.05));
    desc.place(ball.clone(), at(0.3, 0.25, 0.0), glass());
    let layered = Principled {
        coat: FloatTex::Const(0.7),
        ..Principled::default()
    };
    desc.place(
        ball,
        at(0.9, 0.25, -0.4),
        BsdfDesc::Principled(Box::new(layered)),
    );
    let curtain = BsdfDesc::DiffuseTransmission {
        reflectance: grey(0.3),
        transmittance: grey(0.4),
    };
    let hanging = spanned([1.3, 1.4, -0.8], [0.4, 0.0, 0.2], [0.0, 0.5, 0.0]);
    desc.place(Shape::Rectangle, hanging, curtain);
    let a = desc.material(diffuse(0.8));
    let b = desc.material(BsdfDesc::Interface);
    let amount = FloatTex::Const(0.5);
    let lace = BsdfDesc::Mix { a, b, amount };
    let hanging = spanned([-1.3, 1.4, -0.8], [0.4, 0.0, -0.2], [0.0, 0.5, 0.0]);
    desc.place(Shape::Rectangle, hanging, lace);
    desc
}

fn compiled(desc: &SceneDesc, seed: u64) -> Scene {
    compile(desc, &MemorySource::new(), seed, 2)
}

#[test]
fn the_mean_stays() {
    // Without guidance that takes many samples.
    let alone = Picture::of(&compiled(&room(false), 1), 1024);
    for split in [1, 4] {
        let mut scene = compiled(&room(true), 2);
        scene.set_split(split);
        let guided = Picture::of(&scene, 256);
        assert_eq!(guided.rejected, 0);
        let differences: Moments = (alone.rgb.iter().zip(&guided.rgb))
            .map(|(a, b)| a[1] - b[1])
            .collect();
        let what = format!("split {split}, mean {}", alone.moments().mean());
        assert!(
            differences.error() < 0.005 * alone.moments().mean(),
            "{what}: {}",
            differences.error()
        );
        ttest::assert_mean(&what, &differences, 0.0, LEVEL);
    }
}

#[test]
fn light_through_a_gap_gets_quieter() {
    let noise = |is_guided| {
        let desc = room(is_guided);
        let [a, b] = [1, 2].map(|seed| Picture::of(&compiled(&desc, seed), 16));
        let squares: Vec<f64> = (a.rgb.iter().zip(&b.rgb))
            .map(|(a, b)| (a[1] - b[1]).powi(2) / ((0.5 * (a[1] + b[1])).powi(2) + 0.01))
            .collect();
        squares.iter().sum::<f64>() / squares.len() as f64
    };
    let (alone, guided) = (noise(false), noise(true));
    assert!(
        guided < 0.55 * alone,
        "variance {guided} guided, {alone} without"
    );
}

/// Who trains, and with how many threads, makes no difference; neither does the seed of the picture to the guide.
#[test]
fn everybody_trains_the_same() {
    let desc = room(true);
    let unit = Unit {
        frame: 0,
        tile: 0,
        samples: SampleRange { begin: 0, end: 4 },
    };
    let of = |threads| {
        let scene = compile(&desc, &MemorySource::new(), 5, threads);
        let stop = StopFlag::default();
        (
            tracer::render_unit(&scene, &unit, &stop).unwrap().0,
            scene.memory_bytes(),
        )
    };
    let one = of(1);
    for threads in [2, 3] {
        assert!(of(threads) == one, "with {threads} threads");
    }
    // As many cells, quadrants and spots: another guide would hardly have just that.
    let other = compile(&desc, &MemorySource::new(), 6, 2);
    assert_eq!(other.memory_bytes(), one.1);
}

/// Scenes from which there is nothing to learn.
#[test]
fn nothing_to_learn_is_no_trouble() {
    let mut black = room(true);
    for primitive in &mut black.primitives {
        primitive.emission = None;
    }
    let picture = Picture::of(&compiled(&black, 1), 2);
    assert!(picture.rgb.iter().all(|p| *p == [0.0; 3]) && picture.rejected == 0);

    let mut empty = blank(20, 10);
    empty.integrator = Integrator::Guided { max_depth: 5 };
    empty.lights.push(sky(0.5));
    let picture = Picture::of(&compiled(&empty, 1), 2);
    assert!(picture.rgb.iter().all(|p| (p[1] - 0.5).abs() < 1e-6));

    let mut seen = room(true);
    seen.integrator = Integrator::Guided { max_depth: 0 };
    assert_eq!(Picture::of(&compiled(&seen, 1), 2).rejected, 0);

    // One pixel, and far too much light.
    let mut bright = room(true);
    (bright.film.width, bright.film.height) = (1, 1);
    for primitive in &mut bright.primitives {
        if let Some(emission) = &mut primitive.emission {
            emission.scale = 1e37;
        }
    }
    Picture::of(&compiled(&bright, 1), 16);
}

/// Paths in fog are not guided, and picture and samples are those of the path tracer.
#[test]
fn fog_is_as_without() {
    let foggy = |is_guided| {
        let mut desc = room(is_guided);
        (desc.film.width, desc.film.height) = (16, 16);
        desc.media.push(Medium {
            name: "haze".into(),
            sigma_a: [0.01; 3],
            sigma_s: [0.05; 3],
            emission: [0.0; 3],
            g: 0.0,
            grid: None,
            translucent: None,
        });
        desc.camera.medium = Some(MediumId(0));
        Picture::of(&compiled(&desc, 1), 4).rgb
    };
    assert_eq!(foggy(true), foggy(false));
}

#[test]
fn training_stops() {
    let settings = PrepareSettings {
        seed: 1,
        frame: 0,
        clamp_indirect: None,
        threads: 1,
        picture_bytes: u64::MAX,
    };
    let stop = Arc::new(StopFlag::default());
    stop.stop();
    let found = tracer::prepare(&room(true), &MemorySource::new(), &settings, &stop);
    assert!(matches!(found.err(), Some(PrepareError::Stopped)));
}
