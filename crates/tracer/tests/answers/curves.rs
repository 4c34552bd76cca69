//! Curves: what they cover, how they are placed, and hair that absorbs nothing.

use crate::common::*;
use glam::{DAffine3, DVec3};
use scene::model::*;
use std::sync::Arc;
use testkit::TestRng;

fn strand(points: [[f32; 3]; 4], width: [f32; 2]) -> CurveSegment {
    CurveSegment {
        points,
        width,
        u: [0.0, 1.0],
        normals: [[0.0, 0.0, 1.0]; 2],
    }
}

fn add(desc: &mut SceneDesc, kind: CurveKind, segments: Vec<CurveSegment>) -> Shape {
    desc.curves.push(Curves {
        name: "fur".into(),
        kind,
        segments: Arc::new(segments),
    });
    Shape::Curves(CurvesId(desc.curves.len() as u32 - 1))
}

fn hair(sigma: f32) -> BsdfDesc {
    BsdfDesc::Hair {
        color: HairColor::Absorption(grey(sigma)),
        ior: 1.55,
        beta_m: FloatTex::Const(0.3),
        beta_n: FloatTex::Const(0.4),
        alpha: 2.0,
    }
}

/// Strands in all directions through a ball.
fn tangle(count: usize, width: f32) -> Vec<CurveSegment> {
    let mut rng = TestRng::new(5);
    let mut point = |scale: f32| {
        let p = rng.direction();
        [p[0] * scale, p[1] * scale, p[2] * scale - 4.0]
    };
    (0..count)
        .map(|_| {
            let points = [point(0.8), point(0.5), point(0.5), point(0.8)];
            strand(points, [width, width * 0.5])
        })
        .collect()
}

/// Hair without pigment cannot be seen under a white sky, from whatever side light meets it.
#[test]
fn white_hair_vanishes_under_a_white_sky() {
    for kind in [CurveKind::Flat, CurveKind::Cylinder, CurveKind::Ribbon] {
        let mut desc = blank(24, 24);
        desc.integrator = Integrator::Path { max_depth: 2000 };
        desc.lights.push(sky(1.0));
        let shape = add(&mut desc, kind, tangle(60, 0.05));
        desc.place(shape, DAffine3::IDENTITY, hair(0.0));
        let picture = render(&desc, 64);
        check(&format!("{kind:?}"), &picture.moments(), 1.0);
        assert_eq!(picture.rejected, 0);
        // With pigment it can.
        desc.materials[0].bsdf = hair(2.0);
        assert!(render(&desc, 16).moments().mean() < 0.95);
    }
}

/// A strip of width w covers w of a view that is 2 wide, wherever it comes from: placed, scaled,
/// mirrored, in an instance, in motion, cut by holes.
#[test]
fn a_strip_covers_its_width() {
    let straight = |length: f32, width: f32| {
        let y = |i: f32| [0.0, length * (i / 1.5 - 1.0), 0.0];
        strand([y(0.0), y(1.0), y(2.0), y(3.0)], [width; 2])
    };
    let mut base = blank(64, 8);
    base.integrator = Integrator::Path { max_depth: 0 };
    base.lights.push(sky(1.0));
    // A black strip before a white sky, sticking out of the picture.
    let shape = add(&mut base, CurveKind::Flat, vec![straight(2.0, 0.5)]);
    base.place(shape, at(0.0, 0.0, -3.0), diffuse(0.0));
    let mut scaled = base.clone();
    scaled.curves[0].segments = Arc::new(vec![straight(1.0, 0.25)]);
    scaled.primitives[0].transform =
        Motion::fixed(at(0.1, 0.0, -3.0) * DAffine3::from_scale(DVec3::new(-2.0, 2.0, 2.0)));
    let mut placed = scaled.clone();
    placed.primitives[0].transform = Motion::identity();
    let inner = placed.primitives.pop().unwrap();
    placed.groups.push(Group {
        name: "strip".into(),
        primitives: vec![inner],
        instances: vec![],
    });
    placed.instances.push(Instance {
        group: GroupId(0),
        transform: scaled.primitives[0].transform.clone(),
    });
    let mut moving = base.clone();
    moving.primitives[0].transform = Motion {
        keys: [-0.3, 0.3]
            .iter()
            .enumerate()
            .map(|(i, x)| MotionKey {
                time: i as f64,
                transform: at(*x, 0.0, -3.0),
            })
            .collect(),
    };
    let mut cut = base.clone();
    cut.primitives[0].alpha = Some(FloatTex::Const(0.5));
    for (what, desc, covered) in [
        ("strip", base, 0.25),
        ("scaled", scaled, 0.25),
        ("placed", placed, 0.25),
        ("moving", moving, 0.25),
        ("cut", cut, 0.125),
    ] {
        check(what, &render(&desc, 64).moments(), 1.0 - covered);
    }
}

/// Texture coordinates run along the strand and across it.
#[test]
fn coordinates_run_along_and_across() {
    let mut desc = blank(16, 16);
    desc.integrator = Integrator::Uv;
    let y = |i: f32| [0.0, i / 1.5 - 1.0, -2.0];
    let mut piece = strand([y(0.0), y(1.0), y(2.0), y(3.0)], [2.0; 2]);
    piece.u = [0.25, 0.75];
    let shape = add(&mut desc, CurveKind::Flat, vec![piece]);
    desc.place(shape, DAffine3::IDENTITY, diffuse(0.5));
    let picture = render(&desc, 64);
    for row in 0..16 {
        for column in 0..16 {
            let [u, v, _] = picture.rgb[row * 16 + column];
            let up = 1.0 - (row as f64 + 0.5) / 16.0;
            // Seen from +Z, along +Y: v grows along z x y = -x.
            let across = 1.0 - (column as f64 + 0.5) / 16.0;
            assert!((u - (0.25 + 0.5 * up)).abs() < 0.01, "{row} {column}: {u}");
            assert!((v - across).abs() < 0.01, "{row} {column}: {v}");
        }
    }
}

#[test]
fn shining_curves_are_refused() {
    let mut desc = blank(4, 4);
    let shape = add(&mut desc, CurveKind::Flat, tangle(1, 0.1));
    desc.place(shape, DAffine3::IDENTITY, hair(0.1)).emission = shining(1.0);
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
    assert!(error.contains("\"fur\""), "{error}");
}
