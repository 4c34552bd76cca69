//! Packets against single rays: the same hits, bit for bit, and bounds that hold.

use super::*;
use crate::accel::simd::Scalar;
use crate::accel::tests::{Tri, geometry, levels, point};
use crate::accel::{Few, SimdLevel};
use ::scene::model as desc;
use ::scene::model::SceneDesc;
use glam::{DAffine3, DVec3, Vec3};
use proptest::prelude::*;
use rand::{Rng, SeedableRng, rngs::StdRng};
use std::sync::Arc;

/// How rays of a run are alike.
#[derive(Clone, Copy, Debug)]
enum Kind {
    /// A row of pixels.
    Row,
    /// Samples of one pixel.
    Pixel,
    /// Samples of one pixel out of focus.
    Lens,
    /// A row with directions that have zeros, of both signs, or next to nothing.
    Zeros,
    /// Not at all.
    Loose,
}

const KINDS: [Kind; 5] = [Kind::Row, Kind::Pixel, Kind::Lens, Kind::Zeros, Kind::Loose];

/// Rays from somewhere around to somewhere near the middle.
fn run(rng: &mut StdRng, kind: Kind, count: usize) -> Vec<Ray> {
    let (eye, target) = (point(rng, 5.0), point(rng, 1.5));
    let step = point(rng, 0.02);
    let zeros = [0.0, -0.0, 1e-30, -1e-19];
    let (zero, axis) = (zeros[rng.random_range(0..4)], rng.random_range(0..3));
    let is_mixed = rng.random_bool(0.3);
    (0..count)
        .map(|i| {
            let (mut from, mut to) = (eye, target);
            match kind {
                Kind::Row => to += step * i as f32,
                Kind::Pixel => to += point(rng, 0.01),
                Kind::Lens => {
                    from += point(rng, 0.15);
                    to += point(rng, 0.01);
                }
                Kind::Zeros => {
                    let mut d = (to + step * i as f32 - from).to_array();
                    d[axis] = if is_mixed {
                        zeros[rng.random_range(0..4)]
                    } else {
                        zero
                    };
                    return Ray::new(from, Vec3::from_array(d), 0.0);
                }
                Kind::Loose => (from, to) = (point(rng, 5.0), point(rng, 2.0)),
            }
            Ray::new(from, to - from, 0.001 * (i % 40) as f32)
        })
        .collect()
}

/// Runs of one kind and, last, of all kinds, of lengths that have nothing to do with packets. Some rays end early.
fn arrays(rng: &mut StdRng) -> Vec<(String, Vec<Ray>)> {
    let mut arrays: Vec<(String, Vec<Ray>)> = KINDS
        .into_iter()
        .map(|kind| {
            let rays = (0..12).flat_map(|_| run(rng, kind, 32));
            (format!("{kind:?}"), rays.collect())
        })
        .collect();
    let mut mixed = vec![];
    for i in 0..150 {
        let count = rng.random_range(1..24);
        mixed.extend(run(rng, KINDS[i % 5], count));
    }
    for ray in mixed.iter_mut().step_by(11) {
        ray.t_max = rng.random_range(-1.0..8.0);
    }
    arrays.push(("mixed".into(), mixed));
    arrays
}

fn bits(hit: &Hit) -> [u32; 5] {
    let Hit {
        t,
        instance,
        prim,
        u,
        v,
    } = hit;
    [t.to_bits(), *instance, *prim, u.to_bits(), v.to_bits()]
}

/// Eights of an array that are packets.
fn packets(rays: &[Ray]) -> usize {
    let (eights, _) = rays.as_chunks::<RAYS>();
    let bundles = eights.iter().filter_map(|e| Bundle::<Scalar>::new(e, ALL));
    bundles.count()
}

/// At all levels and with arrays of all lengths.
fn check(name: &str, geometry: &mut Geometry, rays: &[Ray]) {
    let hits: Vec<Hit> = rays.iter().map(|r| geometry.closest(r)).collect();
    for level in levels() {
        geometry.level = level;
        for in_flight in [false, true] {
            for count in [0, 1, 7, 8, 9, 31, rays.len() - 3, rays.len()] {
                let some = &rays[..count.min(rays.len())];
                let mut found = vec![Hit::none(0.5); some.len()];
                simd::closest_coherent(level, geometry, some, &mut found, in_flight);
                for (i, ray) in some.iter().enumerate() {
                    assert_eq!(
                        bits(&found[i]),
                        bits(&hits[i]),
                        "{name} at {level:?}, {count} rays, in flight {in_flight}, ray {i} {ray:?}"
                    );
                }
            }
        }
    }
}

#[test]
fn packets_are_as_single_rays_on_soups() {
    let mut rng = StdRng::seed_from_u64(11);
    let mut soups: Vec<Vec<Tri>> = [0, 1, 4, 24, 300, 6000]
        .into_iter()
        .map(|count| {
            let size = if count > 1000 { 0.1 } else { 0.6 };
            let soup = (0..count).map(|_| {
                let p = point(&mut rng, 2.0);
                [p, p + point(&mut rng, size), p + point(&mut rng, size)]
            });
            soup.collect()
        })
        .collect();
    // Equal distances everywhere.
    let three = [
        point(&mut rng, 2.0),
        point(&mut rng, 2.0),
        point(&mut rng, 2.0),
    ];
    soups.push(vec![three; 70]);
    soups.push(hills(40));
    for soup in soups {
        let mut geometry = geometry(&soup, SimdLevel::best());
        for (kind, rays) in arrays(&mut rng) {
            let name = format!("{kind} on {} triangles", soup.len());
            check(&name, &mut geometry, &rays);
        }
        geometry.few = Few::new(&geometry.world);
        for (kind, rays) in arrays(&mut rng) {
            let mut found = vec![Hit::none(0.5); rays.len()];
            geometry.closest_coherent(&rays, &mut found);
            for (ray, found) in rays.iter().zip(&found) {
                let hit = geometry.closest(ray);
                assert_eq!(bits(found), bits(&hit), "{kind}, few, {ray:?}");
            }
        }
    }
}

/// What the other tests say is of packets, too.
#[test]
fn most_camera_rays_are_packets() {
    let mut rng = StdRng::seed_from_u64(12);
    for (kind, rays) in arrays(&mut rng) {
        let (count, of) = (packets(&rays), rays.len() / RAYS);
        match kind.as_str() {
            "Row" | "Pixel" | "Lens" => assert!(count * 2 > of, "{kind}: {count} of {of}"),
            "Loose" => assert!(count == 0, "{kind}: {count} of {of}"),
            _ => assert!(count > 5 && count < of, "{kind}: {count} of {of}"),
        }
    }
}

/// Bounds of what is not finite mean nothing.
#[test]
fn only_finite_rays_are_packets() {
    let plain = Ray::new(Vec3::ZERO, Vec3::new(1.0, 2.0, 3.0), 0.0);
    assert!(Bundle::<Scalar>::new(&[plain; RAYS], ALL).is_some());
    for lane in 0..RAYS {
        for odd in [f32::NAN, f32::INFINITY, f32::NEG_INFINITY] {
            for axis in 0..3 {
                let mut from = [plain; RAYS];
                from[lane].origin[axis] = odd;
                let mut along = [plain; RAYS];
                along[lane].direction[axis] = odd;
                for rays in [from, along] {
                    assert!(Bundle::<Scalar>::new(&rays, ALL).is_none(), "{rays:?}");
                }
            }
        }
        let mut rays = [plain; RAYS];
        rays[lane].t_max = f32::NAN;
        assert!(Bundle::<Scalar>::new(&rays, ALL).is_none(), "{rays:?}");
    }
}

/// Two by two triangles a square, one corner after the other.
fn hills(n: usize) -> Vec<Tri> {
    let at = |i: usize, j: usize| {
        let (x, z) = (i as f32 / n as f32, j as f32 / n as f32);
        let (s, c) = crate::math::sin_cos_2pi((3.0 * x).fract());
        let (r, _) = crate::math::sin_cos_2pi((2.0 * z).fract());
        Vec3::new(4.0 * x - 2.0, 0.4 * s * r + 0.2 * c, 4.0 * z - 2.0)
    };
    let squares = (0..n * n).map(|k| (k % n, k / n));
    squares
        .flat_map(|(i, j)| {
            let (a, b, c, d) = (at(i, j), at(i + 1, j), at(i + 1, j + 1), at(i, j + 1));
            [[a, b, c], [a, c, d]]
        })
        .collect()
}

fn primitive(shape: desc::Shape, alpha: Option<f32>) -> desc::Primitive {
    desc::Primitive {
        shape,
        transform: desc::Motion::identity(),
        material: desc::MaterialId(0),
        emission: None,
        alpha: alpha.map(desc::FloatTex::Const),
        reverse_orientation: false,
        media: None,
    }
}

fn loaded(name: &str) -> SceneDesc {
    let scenes = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("../../scenes");
    let (assets, main) = ::scene::assets::open(&scenes.join(name)).expect("a scene");
    let overrides = ::scene::Overrides::default();
    ::scene::load(&main, assets.as_ref(), &overrides)
        .expect("a scene")
        .0
}

/// Hills, spheres and strands, whole and with holes, placed many times: at rest, mirrored and on their way.
fn mixture() -> SceneDesc {
    let mut rng = StdRng::seed_from_u64(13);
    let mut scene = loaded("furnace");
    scene.camera.shutter = (0.0, 0.04);
    let corners: Vec<Vec3> = hills(24).into_iter().flatten().collect();
    let indices = (0..corners.len() as u32 / 3).map(|i| [3 * i, 3 * i + 1, 3 * i + 2]);
    scene.meshes = vec![desc::Mesh {
        positions: Arc::new(corners.iter().map(|p| p.to_array()).collect()),
        indices: Arc::new(indices.collect()),
        ..desc::Mesh::default()
    }];
    let strands = (0..60).map(|_| desc::CurveSegment {
        points: [0; 4].map(|_| point(&mut rng, 1.5).to_array()),
        width: [0.05, 0.02],
        u: [0.0, 1.0],
        normals: [[0.0, 0.0, 1.0]; 2],
    });
    scene.curves = vec![desc::Curves {
        name: "strands".into(),
        kind: desc::CurveKind::Cylinder,
        segments: Arc::new(strands.collect()),
    }];
    let shapes = |alpha| {
        vec![
            primitive(desc::Shape::Mesh(desc::MeshId(0)), alpha),
            primitive(desc::Shape::Curves(desc::CurvesId(0)), alpha),
            primitive(desc::Shape::Sphere { radius: 0.3 }, alpha),
        ]
    };
    scene.primitives = shapes(Some(0.7));
    scene.groups = [None, Some(0.5)]
        .map(|alpha| desc::Group {
            name: "placed".into(),
            primitives: shapes(alpha),
            instances: vec![],
        })
        .into();
    scene.instances = (0..40)
        .map(|i| {
            let mut key = |time: f64| {
                let to = point(&mut rng, 2.0).as_dvec3();
                let mirror = if i % 3 == 0 { -1.0 } else { 1.0 };
                let size = DVec3::new(0.3 * mirror, 0.2, 0.3);
                let turn =
                    glam::DQuat::from_rotation_y(i as f64) * glam::DQuat::from_rotation_x(0.3);
                let transform = DAffine3::from_scale_rotation_translation(size, turn, to);
                desc::MotionKey { time, transform }
            };
            let keys = if i % 4 == 0 {
                vec![key(0.0), key(0.04)]
            } else {
                vec![key(0.0)]
            };
            desc::Instance {
                group: desc::GroupId(i % 2),
                transform: desc::Motion { keys },
            }
        })
        .collect();
    scene
}

#[test]
fn packets_are_as_single_rays_in_scenes() {
    let mut rng = StdRng::seed_from_u64(14);
    let names = ["instances", "motion-blur", "textures", "whitted"];
    let mut scenes: Vec<(&str, SceneDesc)> = names.map(|name| (name, loaded(name))).into();
    scenes.push(("mixture", mixture()));
    for (name, scene) in scenes {
        let folder = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("../../scenes");
        let from = if name == "mixture" { "furnace" } else { name };
        let (assets, _) = ::scene::assets::open(&folder.join(from)).expect("a scene");
        let settings = crate::PrepareSettings {
            seed: 0,
            frame: 0,
            clamp_indirect: None,
            threads: 1,
            picture_bytes: u64::MAX,
        };
        let stop = crate::StopFlag::default();
        let prepared = crate::prepare(&scene, assets.as_ref(), &settings, &stop);
        let mut geometry = prepared.expect("a scene prepares").geometry;
        let geometry = Arc::get_mut(&mut geometry).expect("nobody else has it");
        for (kind, rays) in arrays(&mut rng) {
            let hits = rays.iter().filter(|r| geometry.closest(r).is_some());
            let (hits, least) = (hits.count(), rays.len() / 20);
            assert!(
                hits > least,
                "{kind} in {name}: hit {hits} of {}",
                rays.len()
            );
            check(&format!("{kind} in {name}"), geometry, &rays);
        }
    }
}

fn number(magnitude: f32) -> impl Strategy<Value = f32> {
    prop_oneof![
        8 => -magnitude..magnitude,
        1 => Just(0.0f32),
        1 => Just(-0.0f32),
        1 => -1e-17f32..1e-17,
    ]
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 3000, failure_persistence: None, ..ProptestConfig::default() })]

    /// No ray enters a box before the bound or leaves it after, and it meets those that it meets alone.
    #[test]
    fn bounds_hold(
        origins in prop::array::uniform8(prop::array::uniform3(number(4.0))),
        directions in prop::array::uniform8(prop::array::uniform3(number(1.0))),
        spread in prop_oneof![Just(0.0f32), Just(1e-6), Just(0.01), Just(1.0)],
        boxes in prop::array::uniform8(prop::array::uniform6(number(4.0))),
        ends in prop::array::uniform8(prop_oneof![Just(f32::INFINITY), 0.0f32..10.0]),
    ) {
        let mut node = Node::empty();
        for (child, sides) in boxes.iter().enumerate().skip(1) {
            for axis in 0..3 {
                let (a, b) = (sides[axis], sides[axis + 3]);
                node.bounds[2 * axis][child] = a.min(b);
                node.bounds[2 * axis + 1][child] = a.max(b);
            }
        }
        let mut rays = [Ray::new(Vec3::ZERO, Vec3::ZERO, 0.0); RAYS];
        for (i, ray) in rays.iter_mut().enumerate() {
            let near = |of: &[[f32; 3]; 8]| {
                Vec3::from_array(of[0]) + (Vec3::from_array(of[i]) - Vec3::from_array(of[0])) * spread
            };
            // The signs of the first.
            let d = near(&directions).to_array();
            let d = [0, 1, 2].map(|axis| d[axis].abs().copysign(directions[0][axis]));
            *ray = Ray { t_max: ends[i], ..Ray::new(near(&origins), Vec3::from_array(d), 0.0) };
        }
        let Some(bundle) = Bundle::<Scalar>::new(&rays, ALL) else {
            return Ok(());
        };
        let (earliest, latest) = bundle.boxes(&node);
        let mut met = [0; 8];
        for (i, ray) in rays.iter().enumerate() {
            let aim = Aim::new::<Scalar>(ray.origin, ray.direction);
            let same = bundle.aim(i);
            prop_assert_eq!(same.inverse.map(f32::to_bits), aim.inverse.map(f32::to_bits));
            prop_assert_eq!(same.far.map(f32::to_bits), aim.far.map(f32::to_bits));
            prop_assert_eq!(same.shear.map(f32::to_bits), aim.shear.map(f32::to_bits));
            prop_assert_eq!((same.near, same.axes, same.start), (aim.near, aim.axes, aim.start));
            let (enter, leave) = kernel::boxes::<Scalar>(&node, &aim, ray.t_max);
            for child in 0..8 {
                prop_assert!(earliest[child] <= enter[child] && leave[child] <= latest[child]);
            }
            let mask = enter.le(leave);
            for child in 0..8 {
                met[child] |= (mask >> child & 1) << i;
            }
        }
        for child in 0..8 {
            prop_assert_eq!(bundle.meet(&node, child), met[child]);
        }
    }
}
