//! Streams of paths against paths one by one: the same bits in every layer, whatever the scene, at every
//! level of instructions.

use crate::common::*;
use film::{SampleRange, Unit};
use glam::{DAffine3, DVec3};
use rand::rngs::StdRng;
use rand::{Rng, SeedableRng};
use scene::assets::MemorySource;
use scene::model::*;
use std::sync::Arc;
use tracer::{Scene, SimdLevel, StopFlag};

/// Renders every tile both ways.
fn check(name: &str, scene: &Scene, begin: u32, end: u32) {
    let stop = StopFlag::default();
    for tile in 0..scene.grid().count() {
        let unit = Unit {
            frame: 0,
            tile,
            samples: SampleRange { begin, end },
        };
        let (expected, counted) = tracer::render_singly(scene, &unit, &stop).expect("not stopped");
        let (found, counters) = tracer::render_unit(scene, &unit, &stop).expect("not stopped");
        for (i, (e, f)) in expected.pixels().iter().zip(found.pixels()).enumerate() {
            assert_eq!(e, f, "{name}, tile {tile}, pixel {i}");
        }
        assert_eq!(expected, found, "{name}, tile {tile}");
        assert_eq!(counted, counters, "{name}, tile {tile}");
    }
}

/// The scenes that come with the project, small.
#[test]
fn scenes_of_the_project_keep_their_bits() {
    let scenes = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("../../scenes");
    for name in [
        "cornell-box",
        "depth-of-field",
        "door-ajar",
        "environment",
        "glass",
        "glossy",
        "instances",
        "metals",
        "motion-blur",
        "soft-shadows",
        "textures",
        "umbrella-street",
        "veach-mis",
    ] {
        let (assets, main) = scene::assets::open(&scenes.join(name)).expect("a scene");
        let overrides = scene::Overrides::default();
        let (mut desc, _) = scene::load(&main, assets.as_ref(), &overrides).expect("a scene");
        (desc.film.width, desc.film.height) = (70, 40);
        desc.film.crop = None;
        let settings = tracer::PrepareSettings {
            seed: 3,
            frame: 0,
            clamp_indirect: None,
            threads: 2,
            picture_bytes: u64::MAX,
        };
        let stop = StopFlag::default();
        let mut scene =
            tracer::prepare(&desc, assets.as_ref(), &settings, &stop).expect("prepares");
        check(name, &scene, 0, 3);
        scene.set_split(4);
        check(&format!("{name}, split"), &scene, 3, 4);
    }
}

/// Any of several.
fn pick<T: Copy>(rng: &mut StdRng, of: &[T]) -> T {
    of[rng.random_range(0..of.len())]
}

fn some_material(rng: &mut StdRng) -> BsdfDesc {
    let roughness = |rng: &mut StdRng| Roughness {
        u: FloatTex::Const(pick(rng, &[0.0, 0.05, 0.3, 1.0])),
        v: FloatTex::Const(pick(rng, &[0.0, 0.05, 0.3])),
        scale: RoughnessScale::Alpha,
    };
    match rng.random_range(0..8) {
        0 => BsdfDesc::Conductor {
            fresnel: ConductorFresnel::EtaK {
                eta: ColorTex::Const([0.2, 0.9, 1.4]),
                k: ColorTex::Const([3.9, 2.4, 1.6]),
            },
            roughness: roughness(rng),
        },
        1 => BsdfDesc::Conductor {
            fresnel: ConductorFresnel::Reflectance(grey(0.8)),
            roughness: smooth(),
        },
        2 => BsdfDesc::Dielectric {
            ior: pick(rng, &[1.0, 1.33, 1.5, 0.7]),
            roughness: roughness(rng),
            reflect_tint: ColorTex::Const([1.0, pick(rng, &[0.0, 0.9]), 0.0]),
            transmit_tint: ColorTex::Const([pick(rng, &[0.0, 1.0]), 0.5, 0.0]),
        },
        3 => glass(),
        4 => BsdfDesc::Interface,
        5 => BsdfDesc::OrenNayar {
            reflectance: grey(0.5),
            sigma: FloatTex::Const(20.0),
        },
        6 => diffuse(pick(rng, &[0.0, 1.0])),
        _ => BsdfDesc::Diffuse {
            reflectance: ColorTex::Const([0.7, 0.5, 0.2]),
        },
    }
}

/// A medium on one side of a surface.
fn some_medium(rng: &mut StdRng, desc: &mut SceneDesc) -> MediumInterface {
    desc.media.push(Medium {
        name: String::new(),
        sigma_a: [0.1, 0.5, 1.0],
        sigma_s: pick(rng, &[[0.0; 3], [2.0, 1.0, 0.5]]),
        emission: pick(rng, &[[0.0; 3], [0.5; 3]]),
        g: 0.3,
        grid: None,
        translucent: None,
    });
    MediumInterface {
        inside: Some(MediumId(desc.media.len() as u32 - 1)),
        outside: None,
    }
}

fn some_shape(rng: &mut StdRng, desc: &mut SceneDesc) -> Shape {
    match rng.random_range(0..6) {
        0 => Shape::Rectangle,
        1 => Shape::Disk {
            radius: 0.6,
            inner_radius: 0.1,
            height: 0.0,
        },
        2 => {
            let corner = |i: u32| [(i % 5) as f32 * 0.3 - 0.6, (i / 5) as f32 * 0.3 - 0.6, 0.1];
            let positions: Vec<[f32; 3]> = (0..25).map(corner).collect();
            let indices = (0..16)
                .flat_map(|k| {
                    let a = k / 4 * 5 + k % 4;
                    [[a, a + 5, a + 1], [a + 1, a + 5, a + 6]]
                })
                .collect();
            let lean = pick(rng, &[0.0f32, 0.3, 2.0]);
            let mut normals: Vec<[f32; 3]> = positions
                .iter()
                .map(|p| [p[0] * lean, p[1] * lean, 1.0])
                .collect();
            // Some triangles have no usable normal.
            normals[7] = [0.0; 3];
            desc.mesh(Mesh {
                positions: Arc::new(positions),
                indices: Arc::new(indices),
                normals: Arc::new(if rng.random_bool(0.6) {
                    normals
                } else {
                    vec![]
                }),
                ..Mesh::default()
            })
        }
        _ => Shape::Sphere { radius: 0.5 },
    }
}

/// A few shapes of any kind in a room with any lights.
fn some_scene(rng: &mut StdRng) -> SceneDesc {
    let mut desc = blank(40, 36);
    desc.sampler = pick(
        rng,
        &[
            SamplerKind::Lattice,
            SamplerKind::Lattice,
            SamplerKind::Lattice,
            SamplerKind::OwenSobol,
            SamplerKind::Stratified,
            SamplerKind::Independent,
        ],
    );
    desc.integrator = Integrator::Path {
        max_depth: pick(rng, &[0, 1, 2, 5, 64, 64]),
    };
    if rng.random_bool(0.3) {
        desc.film.filter = Filter::Mitchell {
            radius: (2.0, 2.0),
            b: 0.33,
            c: 0.33,
        };
    }
    desc.film.max_component = pick(rng, &[None, None, Some(2.0)]);
    desc.film.exposure = [1.0, 0.5, 2.0];
    let lens = |aperture| {
        Some(Lens {
            radius: 0.1,
            focus_distance: 3.0,
            aperture,
            anamorphic: 1.3,
        })
    };
    desc.camera.projection = match rng.random_range(0..4) {
        0 => perspective(60.0, None),
        1 => perspective(60.0, lens(Aperture::Disk)),
        2 => perspective(
            60.0,
            lens(Aperture::Blades {
                count: 6,
                rotation: 10.0,
            }),
        ),
        _ => Projection::Orthographic {
            half_height: 2.0,
            window: None,
            lens: lens(Aperture::Disk),
        },
    };
    desc.camera.transform = Motion::fixed(look([0.3, 1.5, 3.5], [0.0, 0.3, 0.0], [0.0, 1.0, 0.0]));
    desc.place(
        Shape::Rectangle,
        horizontal([0.0, -0.6, 0.0], 4.0, 4.0),
        diffuse(0.6),
    );
    for _ in 0..rng.random_range(3..9) {
        let shape = some_shape(rng, &mut desc);
        let mut place = |scale: f64| {
            DVec3::new(
                rng.random_range(-scale..scale),
                rng.random_range(-0.3..1.0),
                rng.random_range(-scale..scale),
            )
        };
        let (center, turn) = (place(1.5), place(1.0));
        let stretch = pick(rng, &[DVec3::ONE, DVec3::ONE, DVec3::new(1.0, 0.5, 1.4)]);
        let transform = DAffine3::from_scale_rotation_translation(
            stretch,
            glam::DQuat::from_scaled_axis(turn * 2.0),
            center,
        );
        let mut bsdf = some_material(rng);
        if rng.random_bool(0.2) {
            let [a, b] = [bsdf, some_material(rng)].map(|part| desc.material(part));
            let amount = FloatTex::Const(0.4);
            bsdf = BsdfDesc::Mix { a, b, amount };
        }
        let is_border = rng.random_bool(0.15);
        let media = is_border.then(|| some_medium(rng, &mut desc));
        let primitive = desc.place(shape, transform, bsdf);
        primitive.reverse_orientation = rng.random_bool(0.2);
        primitive.media = media;
    }
    for _ in 0..rng.random_range(0..4) {
        let shape = pick(rng, &[0, 1, 2]);
        let shape = match shape {
            0 => Shape::Rectangle,
            1 => Shape::Sphere {
                radius: pick(rng, &[0.5, 0.5, 9.0]),
            },
            _ => desc.mesh(triangles(
                &[[0.0; 3], [1.0, 0.0, 0.0], [0.0, 1.0, 0.2]],
                &[[0, 1, 2]],
            )),
        };
        let x = rng.random_range(-2.0..2.0);
        let transform = DAffine3::from_translation(DVec3::new(x, 2.5, 0.5))
            * DAffine3::from_rotation_x(rng.random_range(0.0..6.0))
            * DAffine3::from_scale(DVec3::splat(0.4));
        let primitive = desc.place(shape, transform, diffuse(0.2));
        primitive.reverse_orientation = rng.random_bool(0.3);
        primitive.emission = Some(Emission {
            radiance: ColorTex::Const([5.0, 3.0, pick(rng, &[0.0, 9.0])]),
            scale: 1.5,
            two_sided: rng.random_bool(0.3),
        });
        if rng.random_bool(0.2) {
            primitive.alpha = Some(FloatTex::Const(0.0));
        }
    }
    if rng.random_bool(0.5) {
        desc.lights.push(sky(0.2));
        if let (true, Some(Light::Environment { hidden, .. })) =
            (rng.random_bool(0.3), desc.lights.last_mut())
        {
            *hidden = true;
        }
    }
    if rng.random_bool(0.3) {
        desc.lights.push(Light::Distant {
            direction: DVec3::new(0.2, -1.0, -0.1),
            irradiance: [1.0, 0.9, 0.7],
        });
    }
    if rng.random_bool(0.3) {
        desc.lights.push(Light::Point {
            transform: at(0.5, 2.0, 1.0),
            intensity: [2.0; 3],
        });
    }
    desc
}

/// Scenes put together by chance, at every level of instructions.
#[test]
fn any_scene_keeps_its_bits() {
    keeps_bits(0..60, |_| {});
}

/// The same with paths that are guided.
#[test]
fn any_guided_scene_keeps_its_bits() {
    keeps_bits(100..124, |desc| {
        if let Integrator::Path { max_depth } = desc.integrator {
            desc.integrator = Integrator::Guided { max_depth };
        }
    });
}

fn keeps_bits(seeds: std::ops::Range<u64>, change: impl Fn(&mut SceneDesc)) {
    for seed in seeds {
        let mut rng = StdRng::seed_from_u64(seed);
        let mut desc = some_scene(&mut rng);
        change(&mut desc);
        let settings = tracer::PrepareSettings {
            seed,
            frame: 1,
            clamp_indirect: pick(&mut rng, &[None, None, Some(0.5)]),
            threads: 1,
            picture_bytes: u64::MAX,
        };
        let assets = MemorySource::new();
        let mut scene =
            tracer::prepare(&desc, &assets, &settings, &StopFlag::default()).expect("prepares");
        if let Some(split) = pick(&mut rng, &[None, Some(1), Some(2), Some(3), Some(4)]) {
            scene.set_split(split);
        }
        for level in [SimdLevel::best(), SimdLevel::Scalar] {
            scene.set_simd_level(level);
            let (begin, end) = pick(&mut rng, &[(0, 1), (0, 7), (3, 20), (60, 70)]);
            check(&format!("scene {seed} at {level:?}"), &scene, begin, end);
        }
    }
}

/// A unit of more samples than a stream takes, and one that is stopped.
#[test]
fn long_pixels_and_stops() {
    let mut desc = blank(2, 2);
    desc.place(
        Shape::Sphere { radius: 0.8 },
        at(0.0, 0.0, -2.0),
        diffuse(0.5),
    );
    desc.lights.push(sky(1.0));
    let mut scene = compile(&desc, &MemorySource::new(), 1, 1);
    check("a long pixel", &scene, 100, 1700);
    scene.set_split(3);
    check("a long pixel, split", &scene, 100, 800);
    let stop = StopFlag::default();
    stop.stop();
    let unit = Unit {
        frame: 0,
        tile: 0,
        samples: SampleRange { begin: 0, end: 4 },
    };
    assert!(tracer::render_unit(&scene, &unit, &stop).is_none());
}

/// Units of different scenes, sizes and integrators one after another in the same room, some of them
/// stopped: each gets what it gets in a room of its own.
#[test]
fn a_workspace_keeps_nothing_of_the_unit_before() {
    let mut workspace = tracer::Workspace::default();
    let assets = MemorySource::new();
    for seed in 0..12 {
        let mut rng = StdRng::seed_from_u64(100 + seed);
        let mut desc = some_scene(&mut rng);
        if seed % 4 == 3 {
            desc.integrator = Integrator::Whitted { max_depth: 5 };
        }
        let scene = compile(&desc, &assets, seed, 1);
        let stop = StopFlag::default();
        for tile in 0..scene.grid().count() {
            let samples = pick(
                &mut rng,
                &[
                    SampleRange { begin: 0, end: 1 },
                    SampleRange { begin: 3, end: 20 },
                ],
            );
            let unit = Unit {
                frame: 0,
                tile,
                samples,
            };
            let (expected, counted) =
                tracer::render_unit(&scene, &unit, &stop).expect("not stopped");
            let (found, counters) = workspace.render(&scene, &unit, &stop).expect("not stopped");
            assert_eq!(&expected, found, "scene {seed}, tile {tile}");
            assert_eq!(counted, counters, "scene {seed}, tile {tile}");
            let stopped = StopFlag::default();
            stopped.stop();
            assert!(workspace.render(&scene, &unit, &stopped).is_none());
        }
    }
}
