//! Animations, skins, morph targets.

use super::*;
use glam::DVec3;

/// Adds an animation channel of a node.
pub(super) fn animate(
    m: &mut Model,
    node: usize,
    path: &str,
    kind: &str,
    times: &[f32],
    values: &[f32],
    shape: &str,
) {
    let width = match shape {
        "SCALAR" => 1,
        "VEC3" => 3,
        _ => 4,
    };
    let input = m.accessor("SCALAR", 5126, times.len(), &floats(times));
    let output = m.accessor(shape, 5126, values.len() / width, &floats(values));
    if m.json.get("animations").is_none() {
        m.json["animations"] = json!([{"channels": [], "samplers": []}]);
    }
    let animation = &mut m.json["animations"][0];
    let sampler = animation["samplers"].as_array().unwrap().len();
    let samplers = animation["samplers"].as_array_mut().unwrap();
    samplers.push(json!({"input": input, "output": output, "interpolation": kind}));
    let channels = animation["channels"].as_array_mut().unwrap();
    channels.push(json!({"sampler": sampler, "target": {"node": node, "path": path}}));
}

#[test]
fn moving_nodes_get_keys() {
    let mut m = Model::triangle();
    let path = [0.0, 0.0, 0.0, 2.0, 0.0, 0.0, 2.0, 0.0, 4.0];
    animate(
        &mut m,
        0,
        "translation",
        "LINEAR",
        &[0.0, 1.0, 2.5],
        &path,
        "VEC3",
    );
    let desc = m.fine();
    let keys = &desc.primitives[0].transform.keys;
    let places: Vec<_> = keys
        .iter()
        .map(|k| (k.time, k.transform.translation))
        .collect();
    assert_eq!(
        places,
        [
            (0.0, DVec3::ZERO),
            (1.0, DVec3::X * 2.0),
            (2.5, DVec3::new(2.0, 0.0, 4.0))
        ]
    );
    // 24 frames a second, the last one included.
    assert_eq!(
        desc.animation,
        Some(Animation {
            fps: 24.0,
            start: 0.0,
            frames: (0, 60)
        })
    );
    // A step stays where it is until just before it.
    let mut m = Model::triangle();
    animate(
        &mut m,
        0,
        "translation",
        "STEP",
        &[0.0, 1.0],
        &[0.0, 0.0, 0.0, 1.0, 0.0, 0.0],
        "VEC3",
    );
    let desc = m.fine();
    let keys = &desc.primitives[0].transform.keys;
    assert_eq!(keys.len(), 3);
    assert_eq!(keys[1].transform.translation, DVec3::ZERO);
    assert_eq!((keys[1].time as f32).next_up(), 1.0);
}

#[test]
fn curves_and_hierarchies_are_sampled() {
    // A node that goes along a curve, above one that turns: what hangs below is where the exact
    // composition puts it, at every key.
    let mut m = Model::triangle().with(
        "/nodes",
        json!([{"children": [1]}, {"mesh": 0, "translation": [1, 0, 0]}]),
    );
    let half = std::f32::consts::FRAC_1_SQRT_2;
    animate(
        &mut m,
        0,
        "rotation",
        "LINEAR",
        &[0.0, 1.0],
        &[0.0, 0.0, 0.0, 1.0, 0.0, 0.0, half, half],
        "VEC4",
    );
    let flat = [0.0; 3];
    let spline = [
        flat,
        flat,
        [0.0, 3.0, 0.0],
        [0.0, 0.0, 0.0],
        [0.0, 1.0, 0.0],
        flat,
    ]
    .concat();
    animate(
        &mut m,
        1,
        "translation",
        "CUBICSPLINE",
        &[0.0, 1.0],
        &spline,
        "VEC3",
    );
    let desc = m.fine();
    let keys = &desc.primitives[0].transform.keys;
    assert!(keys.len() > 40, "{}", keys.len());
    for key in keys {
        let t = key.time;
        // Hermite from 0 with slope 3 to 1 with slope 0.
        let y = 3.0 * (t * t * t - 2.0 * t * t + t) + 3.0 * t * t - 2.0 * t * t * t;
        let angle = t * std::f64::consts::FRAC_PI_2;
        let expect = DVec3::new(-y * libm::sin(angle), y * libm::cos(angle), 0.0);
        let got = key.transform.translation;
        assert!((got - expect).length() < 1e-6, "{t}: {got} for {expect}");
    }
}

#[test]
fn several_animations_are_played_as_far_as_they_agree() {
    let mut m = Model::triangle();
    animate(
        &mut m,
        0,
        "translation",
        "LINEAR",
        &[0.0, 1.0],
        &[0.0, 0.0, 0.0, 1.0, 0.0, 0.0],
        "VEC3",
    );
    let mut second = m.json["animations"][0].clone();
    second["name"] = "again".into();
    let m = m.with("/animations/1", second);
    let (_, said) = m.load().unwrap();
    assert!(
        said.iter()
            .any(|s| s.contains("animation \"again\" moves what an earlier one moves")),
        "{said:?}"
    );
    let mut m = m;
    let output = m.accessor("VEC3", 5126, 2, &floats(&[1.0, 1.0, 1.0, 2.0, 2.0, 2.0]));
    m.json["animations"][1]["samplers"][0]["output"] = output.into();
    m.json["animations"][1]["channels"][0]["target"]["path"] = "scale".into();
    let desc = m.fine();
    let last = desc.primitives[0].transform.keys.last().unwrap().transform;
    assert_eq!(last.transform_point3(DVec3::X), DVec3::X * 3.0);
}

#[test]
fn morph_targets_change_the_shape() {
    let mut m = Model::triangle();
    let raise = m.accessor(
        "VEC3",
        5126,
        3,
        &floats(&[0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0]),
    );
    let m = m
        .with(
            "/meshes/0/primitives/0/targets",
            json!([{"POSITION": raise}]),
        )
        .with("/meshes/0/weights", json!([0.5]));
    let still = m.fine();
    assert_eq!(mesh(&still).positions[0], [0.0, 0.0, 0.5]);
    assert!(mesh(&still).deformation.is_none());
    let mut m = m.with("/nodes/0/weights", json!([0.25]));
    assert_eq!(mesh(&m.fine()).positions[0], [0.0, 0.0, 0.25]);
    animate(
        &mut m,
        0,
        "weights",
        "LINEAR",
        &[0.0, 2.0],
        &[0.0, 1.0],
        "SCALAR",
    );
    let moving = m.fine();
    let deformation = mesh(&moving).deformation.clone().unwrap();
    assert_eq!(mesh(&moving).positions[0], [0.0; 3]);
    assert_eq!((deformation.first_time, deformation.keys.len()), (0.0, 1));
    assert_eq!(
        (deformation.keys[0].time, deformation.keys[0].positions[0]),
        (2.0, [0.0, 0.0, 1.0])
    );
}

/// A triangle of which one vertex follows a second joint; its node lies far away, which must not
/// matter.
pub(super) fn skinned() -> Model {
    let mut m = Model::triangle();
    m.attribute(
        "JOINTS_0",
        "VEC4",
        5121,
        3,
        &[0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0],
    );
    m.attribute(
        "WEIGHTS_0",
        "VEC4",
        5126,
        3,
        &floats(&[1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.5, 0.5, 0.0, 0.0]),
    );
    let mut inverse = vec![];
    for x in [0.0, -1.0] {
        inverse.extend([
            1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, x, 0.0, 0.0, 1.0,
        ]);
    }
    let inverse = m.accessor("MAT4", 5126, 2, &floats(&inverse));
    m.with(
        "/nodes",
        json!([
            {"mesh": 0, "skin": 0, "translation": [100, 0, 0]},
            {"children": [2]},
            {"translation": [1, 0, 2]}
        ]),
    )
    .with("/scenes/0/nodes", json!([0, 1]))
    .with(
        "/skins",
        json!([{"joints": [1, 2], "inverseBindMatrices": inverse}]),
    )
}

#[test]
fn skins_place_vertices_by_their_joints() {
    let desc = skinned().fine();
    let expect = [[0.0, 0.0, 0.0], [1.0, 0.0, 2.0], [0.0, 1.0, 1.0]];
    assert_eq!(*mesh(&desc).positions, expect);
    assert_eq!(desc.primitives[0].transform, Motion::identity());
    let mut m = skinned();
    animate(
        &mut m,
        2,
        "translation",
        "LINEAR",
        &[0.0, 0.5],
        &[1.0, 0.0, 0.0, 1.0, 0.0, 4.0],
        "VEC3",
    );
    let moving = m.fine();
    let deformation = mesh(&moving).deformation.clone().unwrap();
    assert_eq!(
        *mesh(&moving).positions,
        [[0.0; 3], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]]
    );
    // Twice as often as there are frames.
    assert_eq!(deformation.keys.len(), 24);
    let last = deformation.keys.last().unwrap();
    assert_eq!((last.time, last.positions[1]), (0.5, [1.0, 0.0, 4.0]));
}
