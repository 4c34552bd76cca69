//! The same bits however samples are grouped, whoever prepares the scene, whatever part is rendered.

use crate::common::*;
use film::{PixelSums, SampleBuffer, SampleRange, Unit};
use glam::DAffine3;
use scene::assets::MemorySource;
use scene::model::*;
use std::sync::Arc;
use tracer::{Scene, StopFlag};

/// A bit of everything: meshes, an instance that turns, glass, a lens, a sky, roulette.
fn busy(sampler: SamplerKind) -> SceneDesc {
    let mut desc = blank(80, 70);
    desc.sampler = sampler;
    desc.film.filter = Filter::Mitchell {
        radius: (2.0, 2.0),
        b: 0.33,
        c: 0.33,
    };
    let lens = Lens {
        radius: 0.05,
        focus_distance: 3.0,
        aperture: Aperture::Blades {
            count: 5,
            rotation: 3.0,
        },
        anamorphic: 1.2,
    };
    desc.camera.projection = perspective(50.0, Some(lens));
    desc.camera.transform = Motion::fixed(look([0.3, 1.0, 3.0], [0.0, 0.4, 0.0], [0.0, 1.0, 0.0]));
    desc.place(
        Shape::Rectangle,
        horizontal([0.0; 3], 5.0, 5.0),
        diffuse(0.6),
    );
    desc.place(Shape::Sphere { radius: 0.4 }, at(0.5, 0.4, 0.0), glass());
    let rough = Roughness {
        u: FloatTex::Const(0.2),
        v: FloatTex::Const(0.05),
        scale: RoughnessScale::Alpha,
    };
    let metal = BsdfDesc::Conductor {
        fresnel: ConductorFresnel::Reflectance(grey(0.8)),
        roughness: rough,
    };
    desc.place(Shape::Sphere { radius: 0.4 }, at(-0.5, 0.4, -0.4), metal);
    desc.place(
        Shape::Rectangle,
        horizontal([0.0, 2.5, 0.0], -0.3, 0.3),
        diffuse(0.2),
    )
    .emission = shining(9.0);
    desc.place(
        Shape::Sphere { radius: 0.05 },
        at(0.0, 0.2, 0.8),
        diffuse(0.2),
    )
    .emission = shining(30.0);
    desc.lights.push(sky(0.2));
    // A wavy sheet of a few hundred triangles.
    let n = 14u32;
    let height = |i: u32, j: u32| 0.1 * ((i * 7 + j * 13) % 5) as f32;
    let point = |k: u32| {
        [
            (k % n) as f32 * 0.1,
            height(k % n, k / n),
            (k / n) as f32 * 0.1,
        ]
    };
    let cell = |k: u32| {
        let a = k / (n - 1) * n + k % (n - 1);
        [[a, a + n, a + 1], [a + 1, a + n, a + n + 1]]
    };
    let mesh = Mesh {
        positions: Arc::new((0..n * n).map(point).collect()),
        indices: Arc::new((0..(n - 1) * (n - 1)).flat_map(cell).collect()),
        ..Mesh::default()
    };
    let shape = desc.mesh(mesh);
    desc.place(shape, DAffine3::IDENTITY, diffuse(0.7));
    let sheet = desc.primitives.pop().unwrap();
    desc.groups.push(Group {
        name: String::new(),
        primitives: vec![sheet],
        instances: vec![],
    });
    for i in 0..3 {
        let turned = |degrees: f64| {
            at(-1.5 + f64::from(i), 0.2, -1.5) * DAffine3::from_rotation_y(degrees.to_radians())
        };
        let key = |time, degrees| MotionKey {
            time,
            transform: turned(degrees),
        };
        let keys = vec![key(0.0, 0.0), key(1.0, 20.0 * f64::from(i))];
        desc.instances.push(Instance {
            group: GroupId(0),
            transform: Motion { keys },
        });
    }
    desc
}

/// The same with smoke in the air, a layered surface and a few hairs.
fn hazy(sampler: SamplerKind) -> SceneDesc {
    let mut desc = busy(sampler);
    let grid = Arc::new(Grid {
        size: [3, 4, 5],
        values: GridValues::Scalar((0..60).map(|i| (i * 7 % 11) as f32 * 0.1).collect()),
    });
    desc.media.push(Medium {
        name: "smoke".into(),
        sigma_a: [0.1, 0.4, 0.9],
        sigma_s: [3.0, 2.0, 1.0],
        emission: [0.1, 0.0, 0.2],
        g: 0.4,
        grid: Some(MediumGrid {
            transform: DAffine3::from_rotation_y(0.3),
            bounds: [[-1.0, 0.0, -1.0], [1.0, 1.5, 1.0]],
            absorption: grid.clone(),
            scattering: grid,
            emission: None,
        }),
        translucent: None,
    });
    desc.media.push(Medium {
        name: "haze".into(),
        sigma_a: [0.01; 3],
        sigma_s: [0.05, 0.06, 0.08],
        emission: [0.0; 3],
        g: 0.0,
        grid: None,
        translucent: None,
    });
    let (smoke, haze) = (Some(MediumId(0)), Some(MediumId(1)));
    desc.camera.medium = haze;
    desc.place(
        Shape::Sphere { radius: 1.1 },
        at(0.0, 0.8, 0.0),
        BsdfDesc::Interface,
    )
    .media = Some(MediumInterface {
        inside: smoke,
        outside: haze,
    });
    let layered = Principled {
        metallic: FloatTex::Const(0.3),
        transmission: FloatTex::Const(0.4),
        coat: FloatTex::Const(0.7),
        sheen_color: grey(0.2),
        sheen_roughness: FloatTex::Const(0.4),
        iridescence: FloatTex::Const(0.5),
        ..Principled::default()
    };
    desc.place(
        Shape::Sphere { radius: 0.3 },
        at(0.0, 0.3, -0.2),
        BsdfDesc::Principled(Box::new(layered)),
    );
    let strand = |i: i32| CurveSegment {
        points: [0.0, 0.3, 0.6, 0.9]
            .map(|y: f32| [0.1 * i as f32, y, 1.0 + 0.3 * y * y * i as f32 * 0.2]),
        width: [0.03, 0.01],
        u: [0.0, 1.0],
        normals: [[0.0; 3]; 2],
    };
    desc.curves.push(Curves {
        name: "hair".into(),
        kind: CurveKind::Cylinder,
        segments: Arc::new((-4..5).map(strand).collect()),
    });
    let hair = BsdfDesc::Hair {
        color: HairColor::Reflectance(grey(0.6)),
        ior: 1.55,
        beta_m: FloatTex::Const(0.3),
        beta_n: FloatTex::Const(0.3),
        alpha: 2.0,
    };
    desc.place(Shape::Curves(CurvesId(0)), DAffine3::IDENTITY, hair);
    desc
}

const SAMPLERS: [SamplerKind; 4] = [
    SamplerKind::Lattice,
    SamplerKind::OwenSobol,
    SamplerKind::Stratified,
    SamplerKind::Independent,
];

fn unit(scene: &Scene, tile: u32, begin: u32, end: u32) -> SampleBuffer {
    let samples = SampleRange { begin, end };
    let unit = Unit {
        frame: 0,
        tile,
        samples,
    };
    tracer::render_unit(scene, &unit, &StopFlag::default())
        .unwrap()
        .0
}

fn add(a: &PixelSums, b: &PixelSums) -> PixelSums {
    let three = |f: &dyn Fn(&PixelSums) -> [i64; 3]| [0, 1, 2].map(|c| f(a)[c] + f(b)[c]);
    let square = |c: usize| {
        let (fraction, carry) = a.square[c].fraction.overflowing_add(b.square[c].fraction);
        film::Square {
            whole: a.square[c].whole + b.square[c].whole + u128::from(carry),
            fraction,
        }
    };
    PixelSums {
        beauty: [0, 1, 2].map(|c| a.beauty[c] + b.beauty[c]),
        square: [0, 1, 2].map(square),
        half: a.half + b.half,
        alpha: a.alpha + b.alpha,
        albedo: three(&|s| s.albedo),
        normal: three(&|s| s.normal),
        depth: a.depth + b.depth,
        hits: a.hits + b.hits,
    }
}

#[test]
fn units_can_be_cut_anywhere() {
    for (sampler, build) in SAMPLERS
        .into_iter()
        .flat_map(|s| [(s, busy as fn(_) -> _), (s, hazy)])
    {
        let scene = compile(&build(sampler), &MemorySource::new(), 5, 1);
        for tile in 0..scene.grid().count() {
            let whole = unit(&scene, tile, 0, 8);
            let parts = [
                unit(&scene, tile, 3, 8),
                unit(&scene, tile, 0, 1),
                unit(&scene, tile, 1, 3),
            ];
            for (i, sum) in whole.pixels().iter().enumerate() {
                let joined = parts[1..]
                    .iter()
                    .fold(parts[0].pixels()[i], |s, p| add(&s, &p.pixels()[i]));
                assert_eq!(*sum, joined, "{sampler:?}, tile {tile}, pixel {i}");
            }
        }
    }
}

#[test]
fn threads_of_the_preparation_change_nothing() {
    let desc = hazy(SamplerKind::OwenSobol);
    let [one, four] = [1, 4].map(|threads| compile(&desc, &MemorySource::new(), 5, threads));
    for tile in 0..one.grid().count() {
        assert_eq!(
            unit(&one, tile, 0, 8),
            unit(&four, tile, 0, 8),
            "tile {tile}"
        );
    }
}

/// Any pixel can be rendered alone, and again.
#[test]
fn a_crop_is_a_part_of_the_picture() {
    for (integrator, build) in [
        (Integrator::Path { max_depth: 8 }, busy as fn(_) -> _),
        (Integrator::Path { max_depth: 8 }, hazy),
        (Integrator::Direct { max_depth: 4 }, hazy),
        (Integrator::Whitted { max_depth: 4 }, busy),
        (Integrator::Normals, hazy),
    ] {
        let mut desc: SceneDesc = build(SamplerKind::OwenSobol);
        desc.integrator = integrator;
        let full = Picture::of(&compile(&desc, &MemorySource::new(), 5, 1), 4);
        let [x0, y0, x1, y1] = [13, 40, 77, 66];
        desc.film.crop = Some([x0, y0, x1, y1]);
        let crop = Picture::of(&compile(&desc, &MemorySource::new(), 5, 1), 4);
        assert_eq!((crop.width, crop.height), (x1 - x0, y1 - y0));
        for y in 0..crop.height {
            for x in 0..crop.width {
                let (a, b) = (crop.green(x, y), full.green(x + x0, y + y0));
                assert_eq!(a, b, "{integrator:?}, pixel {x}, {y} of the crop");
            }
        }
    }
}

/// Another seed and another frame are other samples.
#[test]
fn seeds_and_frames_differ() {
    let desc = busy(SamplerKind::OwenSobol);
    let one = compile(&desc, &MemorySource::new(), 5, 1);
    let other = compile(&desc, &MemorySource::new(), 6, 1);
    assert_ne!(unit(&one, 0, 0, 1), unit(&other, 0, 0, 1));
}
