//! What moves while the shutter is open: at each point the share of the time that it is covered.

use crate::common::*;
use glam::{DAffine3, DVec3};
use scene::model::*;
use std::sync::Arc;

const COLUMNS: u32 = 40;
const ROWS: u32 = 32;
const X: (f64, f64) = (-1.0, 3.0);
const CURVES: [ShutterCurve; 3] = [
    ShutterCurve::Box,
    ShutterCurve::Trapezoid {
        open: 0.3,
        close: 0.5,
    },
    ShutterCurve::Trapezoid {
        open: 0.0,
        close: 1.0,
    },
];

/// How much of the light has come in by the time t in [0, 1].
fn let_in(curve: &ShutterCurve, t: f64) -> f64 {
    let t = t.clamp(0.0, 1.0);
    match *curve {
        ShutterCurve::Box => t,
        ShutterCurve::Trapezoid { open, close } => {
            let rising = if open > 0.0 {
                t.min(open) * t.min(open) / (2.0 * open)
            } else {
                0.0
            };
            let level = (t.min(1.0 - close) - open).max(0.0);
            let late = (t - (1.0 - close)).max(0.0);
            let falling = if close > 0.0 {
                late - late * late / (2.0 * close)
            } else {
                0.0
            };
            (rising + level + falling) / (1.0 - 0.5 * (open + close))
        }
    }
}

fn moved(x: f64) -> DAffine3 {
    at(x, 0.0, -2.0)
}

fn keys(list: &[(f64, DAffine3)]) -> Motion {
    Motion {
        keys: list
            .iter()
            .map(|&(time, transform)| MotionKey { time, transform })
            .collect(),
    }
}

/// Compares a picture along the line with the share of light let in between two moments.
fn compare(what: &str, desc: &mut SceneDesc, covered: impl Fn(f64) -> (f64, f64)) {
    as_points(desc, X);
    for curve in CURVES {
        desc.camera.shutter_curve = curve.clone();
        const SPP: u32 = 128;
        let picture = render(desc, SPP);
        for i in 0..COLUMNS {
            let x = column(i, COLUMNS, X);
            let (from, to) = covered(x);
            let expected = (let_in(&curve, to) - let_in(&curve, from)).max(0.0);
            let measured = picture.column(i);
            // Evenly spaced moments count the share to within one of them, so that the rows of a column
            // may all agree on a neighbour of what is expected.
            let grain = 0.5 / f64::from(SPP) / f64::from(ROWS).sqrt();
            if (measured.mean() - expected).abs() > 4.0 * grain {
                check(
                    &format!("{what}, {curve:?}, x = {x:.2}"),
                    &measured,
                    expected,
                );
            }
        }
    }
}

/// A square of half width 0.3 that goes from x = 0 to x = 2.
#[test]
fn streak_of_a_moving_light() {
    let mut desc = blank(COLUMNS, ROWS);
    desc.camera.shutter = (10.0, 10.5);
    let square = DAffine3::from_scale(DVec3::splat(0.3));
    let primitive = desc.place(Shape::Rectangle, DAffine3::IDENTITY, diffuse(0.0));
    primitive.emission = shining(1.0);
    primitive.transform = keys(&[(10.0, moved(0.0) * square), (10.5, moved(2.0) * square)]);
    let covered = |x: f64| ((x - 0.3) / 2.0, (x + 0.3) / 2.0);
    compare("primitive", &mut desc, covered);

    let mut primitive = desc.primitives.pop().unwrap();
    let motion = std::mem::replace(&mut primitive.transform, Motion::fixed(square));
    let translation = |k: &MotionKey| DAffine3::from_translation(k.transform.translation);
    let of_group = keys(&[
        (10.0, translation(&motion.keys[0])),
        (10.5, translation(&motion.keys[1])),
    ]);
    desc.groups.push(Group {
        name: String::new(),
        primitives: vec![primitive],
        instances: vec![],
    });
    desc.instances.push(Instance {
        group: GroupId(0),
        transform: of_group,
    });
    compare("instance", &mut desc, covered);

    // A group in a group, each of which goes half of the way.
    let half = |x: f64| at(x, 0.0, -1.0);
    desc.groups.push(Group {
        name: String::new(),
        primitives: vec![],
        instances: vec![Instance {
            group: GroupId(0),
            transform: keys(&[(10.0, half(0.0)), (10.5, half(1.0))]),
        }],
    });
    desc.instances[0] = Instance {
        group: GroupId(1),
        transform: keys(&[(10.0, half(0.0)), (10.5, half(1.0))]),
    };
    compare("nested instances", &mut desc, covered);
}

/// A camera that goes the other way sees the same streak of a light that stands still.
#[test]
fn streak_of_a_moving_camera() {
    let mut desc = blank(COLUMNS, ROWS);
    let square = DAffine3::from_scale(DVec3::splat(0.3));
    desc.place(Shape::Rectangle, moved(0.0) * square, diffuse(0.0))
        .emission = shining(1.0);
    desc.camera.transform = keys(&[(0.0, at(0.0, 0.0, 0.0)), (1.0, at(-2.0, 0.0, 0.0))]);
    compare("camera", &mut desc, |x| ((x - 0.3) / 2.0, (x + 0.3) / 2.0));
}

/// A strip that first moves and then stretches, by three keys of its vertices: edges at
/// (0, 0.5), (1, 1.5), (1, 2.5).
#[test]
fn streak_of_a_deforming_mesh() {
    let edges = |a: f32, b: f32| vec![[a, -0.5, 0.0], [b, -0.5, 0.0], [b, 0.5, 0.0], [a, 0.5, 0.0]];
    let mut mesh = triangles(&edges(0.0, 0.5), &[[0, 1, 2], [0, 2, 3]]);
    let key = |time, a, b| DeformationKey {
        time,
        positions: edges(a, b),
        normals: vec![],
    };
    mesh.deformation = Some(Arc::new(Deformation {
        first_time: 0.0,
        keys: vec![key(0.5, 1.0, 1.5), key(1.0, 1.0, 2.5)],
    }));
    let mut desc = blank(COLUMNS, ROWS);
    let shape = desc.mesh(mesh);
    desc.place(shape, moved(0.0), diffuse(0.0)).emission = shining(1.0);
    compare("deforming mesh", &mut desc, |x| {
        // When the right edge arrives at x and when the left one has passed it.
        let arrives = if x <= 0.5 {
            0.0
        } else if x <= 1.5 {
            (x - 0.5) / 2.0
        } else {
            0.5 + (x - 1.5) / 2.0
        };
        let leaves = if x <= 0.0 {
            0.0
        } else if x <= 1.0 {
            x / 2.0
        } else {
            1.0
        };
        (arrives, leaves)
    });
    // At one moment it has one place: half way through the first move.
    desc.camera.shutter = (0.25, 0.25);
    let picture = render(&desc, 4);
    for i in 0..COLUMNS {
        let x = column(i, COLUMNS, X);
        let lit = if x > 0.5 && x < 1.0 { 1.0 } else { 0.0 };
        assert_eq!(picture.column(i).mean(), lit, "mid-way, x = {x}");
    }
}

/// A sector of 20 degrees that turns by 80 about its tip, evenly: a point at angle phi is covered from
/// (phi - 20) / 80 to phi / 80 of the time.
#[test]
fn streak_of_a_turning_instance() {
    let (wide, turn) = (20f64, 80f64);
    let far = [
        (5.0 * wide.to_radians().cos()) as f32,
        (5.0 * wide.to_radians().sin()) as f32,
        0.0,
    ];
    let mut desc = blank(1, ROWS);
    let shape = desc.mesh(triangles(&[[0.0; 3], [5.0, 0.0, 0.0], far], &[[0, 1, 2]]));
    let material = desc.material(diffuse(0.0));
    let primitive = Primitive {
        shape,
        transform: Motion::identity(),
        material,
        emission: shining(1.0),
        alpha: None,
        reverse_orientation: false,
        media: None,
    };
    desc.groups.push(Group {
        name: String::new(),
        primitives: vec![primitive],
        instances: vec![],
    });
    let turned = |degrees: f64| moved(0.0) * DAffine3::from_rotation_z(degrees.to_radians());
    desc.instances.push(Instance {
        group: GroupId(0),
        transform: keys(&[(0.0, turned(0.0)), (1.0, turned(turn))]),
    });
    for step in 1..20 {
        let phi = 5.3 * f64::from(step);
        as_points(&mut desc, (-1e-7, 1e-7));
        let (y, x) = phi.to_radians().sin_cos();
        desc.camera.transform = Motion::fixed(at(x, y, 0.0));
        let covered = let_in(&ShutterCurve::Box, phi / turn)
            - let_in(&ShutterCurve::Box, (phi - wide) / turn);
        check(
            &format!("at {phi} degrees"),
            &render(&desc, 128).moments(),
            covered,
        );
    }
}

/// The frames of an animation are moments of one motion.
#[test]
fn frames_follow_the_clock() {
    let mut desc = blank(COLUMNS, 1);
    as_points(&mut desc, X);
    desc.camera.shutter = (0.0, 0.0);
    desc.animation = Some(Animation {
        fps: 4.0,
        start: 1.0,
        frames: (0, 4),
    });
    let square = DAffine3::from_scale(DVec3::splat(0.3));
    let primitive = desc.place(Shape::Rectangle, DAffine3::IDENTITY, diffuse(0.0));
    primitive.emission = shining(1.0);
    primitive.transform = keys(&[(1.0, moved(0.0) * square), (2.0, moved(2.0) * square)]);
    for frame in 0..5 {
        let settings = tracer::PrepareSettings {
            seed: 1,
            frame,
            clamp_indirect: None,
            threads: 1,
            picture_bytes: u64::MAX,
        };
        let none = scene::assets::MemorySource::new();
        let scene = tracer::prepare(&desc, &none, &settings, &Default::default()).unwrap();
        let picture = Picture::of(&scene, 1);
        let center = f64::from(frame) * 0.5;
        for i in 0..COLUMNS {
            let x = column(i, COLUMNS, X);
            let lit = if (x - center).abs() < 0.3 { 1.0 } else { 0.0 };
            assert_eq!(picture.green(i, 0), lit, "frame {frame}, x = {x}");
        }
    }
}
