use super::*;
use crate::assets::MemorySource;
use crate::model::{Group, GroupId, Instance, Medium, Mesh};
use crate::{Overrides, load};
use std::sync::Arc;

fn scene() -> SceneDesc {
    let text = "WorldBegin\nLightSource \"infinite\"\nShape \"sphere\"\nShape \"trianglemesh\" \"point3 P\" [0 0 0 1 0 0 0 1 0]";
    let assets = MemorySource::new().with("s.pbrt", text).unwrap();
    load("s.pbrt", &assets, &Overrides::default()).unwrap().0
}

#[test]
fn every_kind_of_problem_is_found() {
    let check = |change: &dyn Fn(&mut SceneDesc), expect: &str| {
        let mut desc = scene();
        assert_eq!(validate(&desc), []);
        change(&mut desc);
        let found = validate(&desc);
        assert!(
            found.iter().any(|d| d.to_string().contains(expect)),
            "{expect}: {found:?}"
        );
    };
    check(&|d| d.film.width = 0, "0 x 720");
    check(&|d| d.film.width = 70_000, "a side is 1 to 65536");
    check(
        &|d| (d.film.width, d.film.height) = (65_536, 65_536),
        "the limit is 268435456",
    );
    check(&|d| d.film.crop = Some([5, 5, 5, 9]), "a crop from");
    check(
        &|d| d.film.filter = Filter::Box { radius: (0.0, 1.0) },
        "filter radius",
    );
    check(&|d| d.camera.shutter = (1.0, f64::NAN), "shutter");
    check(&|d| d.spp = Some(0), "samples per pixel");
    check(&|d| d.primitives.clear(), "only the environment");
    check(
        &|d| (d.primitives, d.lights) = (vec![], vec![]),
        "nothing to render",
    );
    check(&|d| d.lights.clear(), "nothing shines");
    check(
        &|d| {
            d.integrator = Integrator::Guided { max_depth: 5 };
            d.media.push(Medium {
                name: "fog".into(),
                sigma_a: [0.1; 3],
                sigma_s: [0.1; 3],
                emission: [0.0; 3],
                g: 0.0,
                grid: None,
                translucent: None,
            });
        },
        "paths are not guided inside media",
    );
    check(
        &|d| d.primitives[0].shape = Shape::Sphere { radius: -1.0 },
        "radius -1",
    );
    check(
        &|d| d.primitives[0].transform.keys[0].transform.matrix3 *= 0.0,
        "singular",
    );
    check(
        &|d| {
            let key = d.primitives[0].transform.keys[0];
            d.primitives[0].transform.keys.push(key);
        },
        "do not rise",
    );
    check(&|d| d.primitives[0].material.0 = 9, "no material");
    check(
        &|d| d.meshes[0].indices = Arc::new(vec![[0, 1, 3]]),
        "index 3",
    );
    check(&|d| d.meshes[0].indices = Arc::new(vec![]), "is empty");
    check(
        &|d| d.meshes[0].positions = Arc::new(vec![[f32::NAN; 3]; 3]),
        "not finite",
    );
    check(
        &|d| d.meshes[0].normals = Arc::new(vec![[0.0; 3]; 2]),
        "2 normals for 3 vertices",
    );
    check(&|d| d.materials.push(d.materials[0].clone()), "twice");
    let nested = |d: &mut SceneDesc, links: &[&[u32]]| {
        d.groups = links
            .iter()
            .enumerate()
            .map(|(i, to)| Group {
                name: format!("g{i}"),
                primitives: vec![d.primitives[0].clone()],
                instances: to
                    .iter()
                    .map(|&g| Instance {
                        group: GroupId(g),
                        transform: Motion::identity(),
                    })
                    .collect(),
            })
            .collect();
        d.instances = vec![Instance {
            group: GroupId(0),
            transform: Motion::identity(),
        }];
    };
    check(&|d| nested(d, &[&[0]]), "\"g0\" contains itself");
    check(&|d| nested(d, &[&[1], &[2], &[0]]), "contains itself");
    check(&|d| nested(d, &[&[7]]), "no group");
    check(
        &|d| {
            let links: Vec<Vec<u32>> = (0..40)
                .map(|i| if i < 39 { vec![i + 1] } else { vec![] })
                .collect();
            nested(d, &links.iter().map(Vec::as_slice).collect::<Vec<_>>());
        },
        "more than 32 deep",
    );
    check(
        &|d| {
            let links: Vec<Vec<u32>> = (0..30)
                .map(|i| if i < 29 { vec![i + 1; 4] } else { vec![] })
                .collect();
            nested(d, &links.iter().map(Vec::as_slice).collect::<Vec<_>>());
        },
        "instances of instances",
    );
    // Several problems at once are all named.
    let mut desc = scene();
    desc.film.width = 0;
    desc.spp = Some(0);
    assert_eq!(validate(&desc).len(), 2);
}

#[test]
fn triangles_without_area_are_dropped() {
    let mut mesh = Mesh {
        positions: Arc::new(vec![
            [0.0; 3],
            [1.0, 0.0, 0.0],
            [0.0, 1.0, 0.0],
            [2.0, 0.0, 0.0],
        ]),
        indices: Arc::new(vec![[0, 1, 2], [0, 0, 1], [0, 1, 3]]),
        ..Mesh::default()
    };
    assert_eq!(geometry::drop_degenerate(&mut mesh), 2);
    assert_eq!(mesh.indices[..], [[0, 1, 2]]);
}
