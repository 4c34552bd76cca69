//! Participating media: Beer's law, single scattering, emission, furnaces, and the bookkeeping of what a
//! ray is in.

use crate::common::*;
use glam::{DAffine3, DVec3};
use scene::model::*;
use std::sync::Arc;
use testkit::{Moments, ttest};

/// Adds a medium.
fn medium(desc: &mut SceneDesc, sigma_a: [f32; 3], sigma_s: [f32; 3]) -> MediumId {
    desc.media.push(Medium {
        name: "fog".into(),
        sigma_a,
        sigma_s,
        emission: [0.0; 3],
        g: 0.0,
        grid: None,
        translucent: None,
    });
    MediumId(desc.media.len() as u32 - 1)
}

/// A grid along z with these values, over the slab of [`slab`] and far to the sides.
fn varying(values: &[f32]) -> MediumGrid {
    let grid = Arc::new(Grid {
        size: [1, 1, values.len() as u32],
        values: GridValues::Scalar(values.to_vec()),
    });
    MediumGrid {
        transform: DAffine3::IDENTITY,
        bounds: [[-1e3, -1e3, -3.0], [1e3, 1e3, -1.0]],
        absorption: grid.clone(),
        scattering: grid,
        emission: None,
    }
}

/// A medium between z = -1 and z = -3, behind borders without a surface.
fn slab(desc: &mut SceneDesc, inside: MediumId) {
    for (z, up) in [(-1.0, 1.0), (-3.0, -1.0)] {
        let at = spanned([0.0, 0.0, z], [1e3 * up, 0.0, 0.0], [0.0, 1e3, 0.0]);
        desc.place(Shape::Rectangle, at, BsdfDesc::Interface).media = Some(MediumInterface {
            inside: Some(inside),
            outside: None,
        });
    }
}

/// A ball with a medium in it.
fn ball(desc: &mut SceneDesc, radius: f64, bsdf: BsdfDesc, inside: MediumId) -> &mut Primitive {
    let primitive = desc.place(Shape::Sphere { radius }, at(0.0, 0.0, -4.0), bsdf);
    primitive.media = Some(MediumInterface {
        inside: Some(inside),
        outside: None,
    });
    primitive
}

fn channel(picture: &Picture, c: usize) -> Moments {
    picture.rgb.iter().map(|p| p[c]).collect()
}

const SIGMA: [f32; 3] = [0.2, 0.7, 2.0];

/// What only absorbs is passed by Beer's law, channel by channel and without noise.
#[test]
fn absorption_is_exact() {
    let mut desc = blank(8, 8);
    desc.lights.push(sky(1.0));
    let glass = medium(&mut desc, SIGMA, [0.0; 3]);
    slab(&mut desc, glass);
    for integrator in [
        Integrator::Path { max_depth: 4 },
        Integrator::Direct { max_depth: 4 },
    ] {
        desc.integrator = integrator;
        for p in &render(&desc, 1).rgb {
            for (value, sigma) in p.iter().zip(SIGMA) {
                let expected = (-2.0 * f64::from(sigma)).exp();
                assert!((value / expected - 1.0).abs() < 1e-4, "{p:?}");
            }
        }
    }
    // The basic ray tracer looks through media and their borders.
    desc.integrator = Integrator::Whitted { max_depth: 4 };
    assert!(render(&desc, 1).rgb.iter().flatten().all(|v| *v == 1.0));
}

/// Through a grid the optical depth is the integral of its interpolation: with the values held beyond the
/// outermost centres, the mean of the values.
#[test]
fn a_grid_attenuates_by_its_integral() {
    for values in [vec![1.0], vec![0.0, 1.0, 5.0, 2.0], vec![1.0; 37]] {
        let mut desc = blank(24, 24);
        desc.lights.push(sky(1.0));
        let smoke = medium(&mut desc, SIGMA, [0.0; 3]);
        desc.media[0].grid = Some(varying(&values));
        slab(&mut desc, smoke);
        let mean = f64::from(values.iter().sum::<f32>()) / values.len() as f64;
        let picture = render(&desc, 64);
        for (c, sigma) in SIGMA.into_iter().enumerate() {
            let expected = (-2.0 * f64::from(sigma) * mean).exp();
            check(&format!("{values:?}, {c}"), &channel(&picture, c), expected);
        }
    }
}

/// Light of the medium's own: a e (1 - exp(-t d)) / t, exactly where it is homogeneous; what scatters is
/// left out by a depth of 0.
#[test]
fn a_medium_shines() {
    let scatter = [0.3, 0.1, 0.0];
    for grid in [None, Some(varying(&[1.0, 1.0]))] {
        let mut desc = blank(24, 24);
        desc.integrator = Integrator::Path { max_depth: 0 };
        let fire = medium(&mut desc, SIGMA, scatter);
        desc.media[0].emission = [3.0, 2.0, 1.0];
        desc.media[0].grid = grid.clone();
        slab(&mut desc, fire);
        let picture = render(&desc, if grid.is_some() { 256 } else { 1 });
        for c in 0..3 {
            let (a, s) = (f64::from(SIGMA[c]), f64::from(scatter[c]));
            let e = f64::from(desc.media[0].emission[c]);
            let expected = a * e * (1.0 - (-2.0 * (a + s)).exp()) / (a + s);
            check(&format!("channel {c}"), &channel(&picture, c), expected);
        }
    }
}

/// Light falling straight on a slab and scattered back once: with t the extinction, E the irradiance and p
/// the phase function for turning back, s p E (1 - exp(-2 t d)) / (2 t).
#[test]
fn a_slab_scatters_once() {
    let (sigma_a, sigma_s) = ([0.1, 0.3, 0.0], [0.5, 0.4, 1.5]);
    for g in [0.0f32, -0.4, 0.6] {
        for grid in [None, Some(varying(&[1.0; 9]))] {
            for integrator in [
                Integrator::Path { max_depth: 1 },
                Integrator::Direct { max_depth: 3 },
            ] {
                let mut desc = blank(24, 24);
                desc.integrator = integrator;
                desc.lights.push(Light::Distant {
                    direction: glam::DVec3::NEG_Z,
                    irradiance: [2.0; 3],
                });
                let fog = medium(&mut desc, sigma_a, sigma_s);
                desc.media[0].g = g;
                desc.media[0].grid = grid.clone();
                slab(&mut desc, fog);
                let picture = render(&desc, 64);
                for c in 0..3 {
                    let g = f64::from(g);
                    let (a, s) = (f64::from(sigma_a[c]), f64::from(sigma_s[c]));
                    let t = a + s;
                    let back = (1.0 - g * g) / (4.0 * std::f64::consts::PI * (1.0 + g).powi(3));
                    let expected = s * back * 2.0 * (1.0 - (-4.0 * t).exp()) / (2.0 * t);
                    let what = format!("g {g}, channel {c}, grid {}", grid.is_some());
                    check(&what, &channel(&picture, c), expected);
                }
            }
        }
    }
}

/// Once scattered light of a white sky, against quadrature: at depth x the mean over directions of what
/// the sky sends through the slab is J(x) = 1/2 int_0^1 exp(-t x / mu) + exp(-t (d - x) / mu) dmu.
#[test]
fn a_slab_scatters_the_sky_once() {
    let (sigma_a, sigma_s) = ([0.1, 0.3, 0.05], [0.5, 0.4, 1.5]);
    for grid in [None, Some(varying(&[1.0; 2]))] {
        let mut desc = blank(32, 32);
        desc.integrator = Integrator::Path { max_depth: 1 };
        desc.lights.push(sky(1.0));
        let fog = medium(&mut desc, sigma_a, sigma_s);
        desc.media[0].grid = grid.clone();
        slab(&mut desc, fog);
        let picture = render(&desc, 128);
        for c in 0..3 {
            let (s, t) = (f64::from(sigma_s[c]), f64::from(sigma_a[c] + sigma_s[c]));
            let (d, n) = (2.0, 600);
            let mut sum = 0.0;
            for i in 0..n {
                let x = d * (f64::from(i) + 0.5) / f64::from(n);
                let mut j = 0.0;
                for k in 0..n {
                    let mu = (f64::from(k) + 0.5) / f64::from(n);
                    j += (-t * x / mu).exp() + (-t * (d - x) / mu).exp();
                }
                sum += s * (-t * x).exp() * 0.5 * j / f64::from(n) * d / f64::from(n);
            }
            let expected = sum + (-t * d).exp();
            let what = format!("channel {c}, grid {}", grid.is_some());
            check(&what, &channel(&picture, c), expected);
        }
    }
}

/// What only scatters cannot be seen under a white sky, whatever its colour, shape and border.
#[test]
fn a_white_cloud_vanishes_under_a_white_sky() {
    let rough = Roughness {
        u: FloatTex::Const(0.3),
        ..smooth()
    };
    let glassy = Principled {
        roughness: FloatTex::Const(0.4),
        transmission: FloatTex::Const(1.0),
        ..Principled::default()
    };
    let borders = [
        ("cloud", BsdfDesc::Interface),
        ("milk", glass()),
        ("wax", BsdfDesc::Principled(Box::new(glassy))),
        (
            "same index",
            BsdfDesc::Dielectric {
                ior: 1.0,
                roughness: rough,
                reflect_tint: grey(1.0),
                transmit_tint: grey(1.0),
            },
        ),
    ];
    for (name, bsdf) in borders {
        for (g, grid) in [(0.0, false), (0.7, false), (-0.3, true)] {
            let mut desc = blank(20, 20);
            desc.integrator = Integrator::Path { max_depth: 4000 };
            desc.lights.push(sky(1.0));
            let cloud = medium(&mut desc, [0.0; 3], [1.0, 3.0, 6.0]);
            desc.media[0].g = g;
            if grid {
                let mut varied = varying(&[0.2, 1.0, 0.5]);
                varied.bounds = [[-2.0, -2.0, -6.0], [2.0, 2.0, -2.0]];
                desc.media[0].grid = Some(varied);
            }
            ball(&mut desc, 0.9, bsdf.clone(), cloud);
            let picture = render(&desc, 64);
            // Principled glass keeps energy to within its tables.
            let slack = if name == "wax" { 0.02 } else { 0.0 };
            for c in 0..3 {
                let what = format!("{name}, g {g}, grid {grid}, channel {c}");
                let seen = channel(&picture, c);
                if slack > 0.0 {
                    assert!((seen.mean() - 1.0).abs() < slack, "{what}: {}", seen.mean());
                } else {
                    check(&what, &seen, 1.0);
                }
            }
            assert_eq!(picture.rejected, 0);
        }
    }
}

/// Of a translucent body, the walk inside counts as one event: with a single one, nothing is lost. A
/// light in a single direction, which a smooth border hides from whatever is inside, lights it.
#[test]
fn a_walk_inside_a_translucent_body_is_one_event() {
    for (g, sigma) in [(0.0, [1.0, 3.0, 6.0]), (0.8, [30.0, 10.0, 20.0])] {
        let mut desc = blank(20, 20);
        desc.integrator = Integrator::Path { max_depth: 1 };
        desc.lights.push(sky(1.0));
        let milk = medium(&mut desc, [0.0; 3], sigma);
        desc.media[0].g = g;
        desc.media[0].translucent = Some(1.5);
        ball(&mut desc, 0.9, glass(), milk);
        let picture = render(&desc, 256);
        for c in 0..3 {
            let what = format!("translucent, g {g}, channel {c}");
            check(&what, &channel(&picture, c), 1.0);
        }
        assert_eq!(picture.rejected, 0);
        desc.lights = vec![Light::Distant {
            direction: DVec3::NEG_Z,
            irradiance: [1.0; 3],
        }];
        let lit = channel(&render(&desc, 16), 1).mean();
        assert!(lit > 0.02, "{lit}");
    }
}

/// A camera in a medium, and borders between a medium and itself, which nobody can see.
#[test]
fn borders_without_a_difference_are_invisible() {
    let mut desc = blank(8, 8);
    let water = medium(&mut desc, SIGMA, [0.0; 3]);
    desc.camera.medium = Some(water);
    let wall = spanned([0.0, 0.0, -6.0], [2.0, 0.0, 0.0], [0.0, 2.0, 0.0]);
    desc.place(Shape::Rectangle, wall, diffuse(0.0)).emission = shining(5.0);
    for with_ball in [false, true] {
        if with_ball {
            ball(&mut desc, 0.9, BsdfDesc::Interface, water).media = Some(MediumInterface {
                inside: Some(water),
                outside: Some(water),
            });
        }
        for p in &render(&desc, 2).rgb {
            for (value, sigma) in p.iter().zip(SIGMA) {
                let expected = 5.0 * (-6.0 * f64::from(sigma)).exp();
                assert!((value / expected - 1.0).abs() < 1e-3, "{with_ball}: {p:?}");
            }
        }
    }
}

/// Lights shine through media and borders: a floor below a lamp with a slab between them.
#[test]
fn lights_reach_through_media() {
    let mut desc = blank(6, 6);
    let glass = medium(&mut desc, SIGMA, [0.0; 3]);
    slab(&mut desc, glass);
    let floor = spanned([0.0, 0.0, -5.0], [9.0, 0.0, 0.0], [0.0, 9.0, 0.0]);
    desc.place(Shape::Rectangle, floor, diffuse(0.8));
    desc.lights.push(Light::Distant {
        direction: glam::DVec3::NEG_Z,
        irradiance: [1.0; 3],
    });
    desc.integrator = Integrator::Path { max_depth: 1 };
    for p in &render(&desc, 1).rgb {
        for (value, sigma) in p.iter().zip(SIGMA) {
            // Through the slab to the floor and back to the camera.
            let expected = 0.8 / std::f64::consts::PI * (-4.0 * f64::from(sigma)).exp();
            assert!((value / expected - 1.0).abs() < 1e-3, "{p:?}");
        }
    }
    // Shadow rays of the basic ray tracer pass the borders too.
    desc.integrator = Integrator::Whitted { max_depth: 4 };
    let seen = render(&desc, 1).green(3, 3);
    assert!((seen - 0.8 / std::f64::consts::PI).abs() < 1e-5, "{seen}");
}

/// A medium goes where its border goes: in an instance that is scaled, in motion, through holes.
#[test]
fn borders_may_be_placed_moved_and_cut() {
    let through = |chord: f64| SIGMA.map(|s| (-chord * f64::from(s)).exp());
    let mut desc = blank(4, 4);
    desc.camera.projection = orthographic((-1e-3, 1e-3), (-1e-3, 1e-3));
    desc.lights.push(sky(1.0));
    let glass = medium(&mut desc, SIGMA, [0.0; 3]);
    ball(&mut desc, 0.5, BsdfDesc::Interface, glass);
    let mut placed = desc.clone();
    let inner = placed.primitives.pop().unwrap();
    placed.groups.push(Group {
        name: "ball".into(),
        primitives: vec![inner],
        instances: vec![],
    });
    placed.instances.push(Instance {
        group: GroupId(0),
        transform: Motion::fixed(DAffine3::from_scale(glam::DVec3::new(-2.0, 2.0, 2.0))),
    });
    let mut moving = desc.clone();
    moving.primitives[0].transform = Motion {
        keys: [-4.0, -8.0]
            .iter()
            .enumerate()
            .map(|(i, z)| MotionKey {
                time: i as f64,
                transform: at(0.0, 0.0, *z),
            })
            .collect(),
    };
    let mut cut = desc.clone();
    cut.primitives[0].alpha = Some(FloatTex::Const(0.0));
    for (what, scene, chord) in [
        ("ball", desc, 1.0),
        ("placed", placed, 2.0),
        ("moving", moving, 1.0),
        ("cut", cut, 0.0),
    ] {
        for p in &render(&scene, 4).rgb {
            for (value, expected) in p.iter().zip(through(chord)) {
                assert!((value / expected - 1.0).abs() < 1e-3, "{what}: {p:?}");
            }
        }
    }
}

/// A grid that does not hold what it says is refused with its name.
#[test]
fn broken_grids_are_refused() {
    let mut desc = blank(4, 4);
    medium(&mut desc, SIGMA, [0.0; 3]);
    let mut grid = varying(&[1.0, 2.0]);
    grid.absorption = Arc::new(Grid {
        size: [u32::MAX, u32::MAX, u32::MAX],
        values: GridValues::Scalar(vec![1.0]),
    });
    desc.media[0].grid = Some(grid);
    let settings = tracer::PrepareSettings {
        seed: 0,
        frame: 0,
        clamp_indirect: None,
        threads: 1,
        picture_bytes: u64::MAX,
    };
    let assets = scene::assets::MemorySource::new();
    let stop = tracer::StopFlag::default();
    let error = tracer::prepare(&desc, &assets, &settings, &stop)
        .err()
        .unwrap()
        .to_string();
    assert!(
        error.contains("\"fog\"") && error.contains("absorption"),
        "{error}"
    );
}

/// Milk in smooth and in rough glass, smoke in paper, a lamp in each of them and a lamp full of smoke above.
fn bottles() -> SceneDesc {
    let mut desc = blank(24, 24);
    desc.camera.projection = perspective(50.0, None);
    desc.camera.transform = Motion::fixed(look([0.0, 1.2, 4.0], [0.0, 0.5, 0.0], [0.0, 1.0, 0.0]));
    let milk = medium(&mut desc, [0.05, 0.2, 0.8], [1.5, 1.0, 0.5]);
    let smoke = medium(&mut desc, SIGMA, [0.4; 3]);
    let floor = horizontal([0.0; 3], 3.0, 3.0);
    desc.place(Shape::Rectangle, floor, diffuse(0.7));
    let mut rough = glass();
    if let BsdfDesc::Dielectric { roughness, .. } = &mut rough {
        (roughness.u, roughness.v) = (FloatTex::Const(0.2), FloatTex::Const(0.2));
    }
    let paper = BsdfDesc::DiffuseTransmission {
        reflectance: grey(0.3),
        transmittance: grey(0.6),
    };
    for (x, bsdf, inside) in [
        (-0.8, glass(), milk),
        (0.0, rough, milk),
        (0.8, paper, smoke),
    ] {
        let body = desc.place(Shape::Sphere { radius: 0.4 }, at(x, 0.45, 0.0), bsdf);
        body.media = Some(MediumInterface {
            inside: Some(inside),
            outside: None,
        });
        let lamp = desc.place(
            Shape::Sphere { radius: 0.1 },
            at(x, 0.45, 0.0),
            diffuse(0.0),
        );
        lamp.emission = shining(3.0);
    }
    // A lamp that is a border itself, big and near: both ways to its light count.
    let globe = desc.place(
        Shape::Sphere { radius: 0.5 },
        at(0.0, 1.2, -1.0),
        diffuse(0.2),
    );
    globe.emission = shining(2.0);
    globe.media = Some(MediumInterface {
        inside: Some(smoke),
        outside: None,
    });
    desc
}

/// Paths outside of all media are those of scenes without any, until they meet the border of one: the same
/// light as if they always looked out for media, also if they are split on the way.
#[test]
fn media_behind_surfaces_need_no_search() {
    let desc = bottles();
    let mut foggy = desc.clone();
    // Far from everything, and nothing but a reason to look out.
    let far = medium(&mut foggy, SIGMA, [0.0; 3]);
    let border = ball(&mut foggy, 0.5, BsdfDesc::Interface, far);
    border.transform = Motion::fixed(at(0.0, 0.0, 500.0));
    let (plain, foggy) = [&desc, &foggy]
        .map(|d| compile(d, &Default::default(), 3, 2))
        .into();
    assert!(!plain.is_foggy && foggy.is_foggy);
    let expected = Picture::of(&foggy, 1024);
    for split in [None, Some(1), Some(4)] {
        let mut scene = compile(&desc, &Default::default(), 5, 2);
        if let Some(split) = split {
            scene.set_split(split);
        }
        let picture = Picture::of(&scene, 1024);
        for c in 0..3 {
            let differences: Moments = (picture.rgb.iter().zip(&expected.rgb))
                .map(|(a, b)| a[c] - b[c])
                .collect();
            let what = format!("split {split:?}, channel {c}");
            assert!(
                differences.error() < 2e-3,
                "{what}: {}",
                differences.error()
            );
            ttest::assert_mean(&what, &differences, 0.0, LEVEL);
        }
    }
}

/// A lamp is as bright with a medium in it as without: what light sampling and scattering find of it is
/// weighed alike on both sides.
#[test]
fn a_lamp_may_be_a_border() {
    let lit = |has_medium: bool| {
        let mut desc = blank(16, 16);
        desc.integrator = Integrator::Path { max_depth: 1 };
        desc.camera.transform = Motion::fixed(look([0.0, 4.0, 0.0], [0.0; 3], [0.0, 0.0, 1.0]));
        desc.camera.projection = orthographic((0.6, 2.6), (-1.0, 1.0));
        desc.place(
            Shape::Rectangle,
            horizontal([0.0; 3], 9.0, 9.0),
            diffuse(0.8),
        );
        let smoke = medium(&mut desc, SIGMA, [0.4; 3]);
        let globe = desc.place(
            Shape::Sphere { radius: 0.5 },
            at(0.0, 0.6, 0.0),
            diffuse(0.2),
        );
        globe.emission = shining(2.0);
        if has_medium {
            globe.media = Some(MediumInterface {
                inside: Some(smoke),
                outside: None,
            });
        }
        render(&desc, 1024)
    };
    let (with, without) = (lit(true), lit(false));
    let differences: Moments = (with.rgb.iter().zip(&without.rgb))
        .map(|(a, b)| a[1] - b[1])
        .collect();
    let bound = 1e-2 * without.moments().mean();
    assert!(
        differences.error() < bound,
        "{} : {bound}",
        differences.error()
    );
    ttest::assert_mean("a lamp with smoke in it", &differences, 0.0, LEVEL);
}
