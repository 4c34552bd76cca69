//! Cameras, lights, variants, and what files without them are given.

use super::*;
use crate::Look;
use glam::DVec3;
use std::f64::consts::FRAC_1_SQRT_2 as HALF;

fn look(m: &Model, look: Look) -> Result<(SceneDesc, Vec<String>), SceneError> {
    load_text(
        &m.text(),
        &Overrides {
            look,
            ..Overrides::default()
        },
    )
}

fn cameras() -> Model {
    Model::triangle()
        .with("/cameras", json!([
            {"name": "wide", "type": "perspective", "perspective": {"yfov": 1.5, "aspectRatio": 2, "znear": 0.1}},
            {"type": "orthographic", "orthographic": {"xmag": 3, "ymag": 1.5, "znear": 0.1, "zfar": 9}}
        ]))
        .with("/nodes", json!([
            {"mesh": 0},
            {"camera": 0, "translation": [0, 0, 5], "scale": [2, 2, 2]},
            {"name": "side", "camera": 1, "rotation": [0, HALF, 0, HALF], "translation": [5, 0, 0]}
        ]))
        .with("/scenes/0/nodes", json!([0, 1, 2]))
}

#[test]
fn cameras_are_taken_by_name() {
    let named = |name: &str| {
        let camera = Some(name.to_owned());
        look(
            &cameras(),
            Look {
                camera,
                ..Look::default()
            },
        )
    };
    let first = cameras().fine();
    let Projection::Perspective {
        fov,
        fov_axis: FovAxis::Vertical,
        ..
    } = first.camera.projection
    else {
        panic!()
    };
    assert!((fov - 1.5f64.to_degrees()).abs() < 1e-12);
    assert_eq!((first.film.width, first.film.height), (1440, 720));
    // The node's scale does not count.
    let at = first.camera.transform.keys[0].transform;
    assert_eq!(
        (at.translation, at.matrix3.z_axis),
        (DVec3::Z * 5.0, DVec3::Z)
    );
    assert_eq!(named("wide").unwrap().0.camera, first.camera);
    let side = named("side").unwrap().0;
    assert!(matches!(
        side.camera.projection,
        Projection::Orthographic {
            half_height: 1.5,
            ..
        }
    ));
    assert!((side.camera.transform.keys[0].transform.matrix3.z_axis - DVec3::X).length() < 1e-7);
    let error = named("sid").unwrap_err().to_string();
    assert!(
        error.contains("no camera \"sid\"; did you mean \"side\"?; it has wide, side"),
        "{error}"
    );
}

#[test]
fn files_without_a_camera_are_framed() {
    let m = Model::triangle().with("/nodes/0/translation", json!([10, 20, 30]));
    let desc = m.fine();
    let camera = desc.camera.transform.keys[0].transform;
    let middle = DVec3::new(10.5, 20.5, 30.0);
    let towards = (middle - camera.translation).normalize();
    assert!((towards + camera.matrix3.z_axis).length() < 1e-9);
    assert!(camera.translation.y > middle.y && camera.translation.z > middle.z);
    // Every vertex lies in the picture.
    for p in mesh(&desc).positions.iter() {
        let p = DVec3::from_array(p.map(f64::from)) + DVec3::new(10.0, 20.0, 30.0);
        let q = camera.inverse().transform_point3(p);
        let half = libm::tan(20f64.to_radians());
        assert!(q.z < 0.0 && q.y.abs() < -q.z * half && q.x.abs() < -q.z * half * 1280.0 / 720.0);
    }
    // A setting looks at the middle unless it says otherwise.
    let from = Look {
        look_from: Some([10.5, 20.5, 40.0]),
        ..Look::default()
    };
    let (desc, _) = look(&m, from).unwrap();
    assert!((desc.camera.transform.keys[0].transform.matrix3.z_axis - DVec3::Z).length() < 1e-12);
    let all = Look {
        look_from: Some([0.0, 9.0, 0.0]),
        look_at: Some([0.0; 3]),
        up: Some([0.0, 0.0, -1.0]),
        vfov: Some(25.0),
        ..Look::default()
    };
    let (desc, _) = look(&m, all).unwrap();
    let camera = desc.camera.transform.keys[0].transform;
    assert_eq!(
        (camera.translation, camera.matrix3.x_axis),
        (DVec3::Y * 9.0, DVec3::X)
    );
    assert!(matches!(
        desc.camera.projection,
        Projection::Perspective { fov: 25.0, .. }
    ));
}

#[test]
fn light_comes_from_the_file_the_settings_or_a_soft_sky() {
    let m = Model::triangle();
    let (desc, said) = m.load().unwrap();
    assert!(
        said[0].contains("the file has no light: a soft sky lights it"),
        "{said:?}"
    );
    let [
        Light::Environment {
            image: Some((id, SphereMapping::LatLong)),
            ..
        },
    ] = desc.lights[..]
    else {
        panic!("{:?}", desc.lights)
    };
    let bytes = desc.images[id.index()].bytes.clone().unwrap();
    assert!(bytes.starts_with(b"PF\n64 32\n-1.0\n"));
    // What shines by itself needs no sky.
    let glowing = Model::triangle().material(json!({"emissiveFactor": [1, 1, 1]}));
    assert!(glowing.fine().lights.is_empty());
    let files = MemorySource::new()
        .with("m.gltf", m.text())
        .unwrap()
        .with("sky.pfm", b"PF\n1 1\n-1.0\n\0\0\0\0\0\0\0\0\0\0\0\0")
        .unwrap();
    let settings = Look {
        env: Some("sky.pfm".into()),
        env_strength: Some(2.0),
        env_rotate: Some(90.0),
        transparent: true,
        ..Look::default()
    };
    let overrides = Overrides {
        look: settings,
        ..Overrides::default()
    };
    let loaded = crate::load_with_files("m.gltf", &files, &overrides).unwrap();
    assert_eq!(loaded.diagnostics, []);
    assert!(loaded.files.contains("sky.pfm"));
    let [
        Light::Environment {
            radiance,
            hidden: true,
            transform,
            ..
        },
    ] = &loaded.desc.lights[..]
    else {
        panic!("{:?}", loaded.desc.lights)
    };
    assert_eq!(*radiance, [2.0; 3]);
    assert!((transform.transform_vector3(DVec3::X) + DVec3::Z).length() < 1e-12);
}

#[test]
fn punctual_lights() {
    let m = Model::triangle()
        .with("/extensionsUsed", json!(["KHR_lights_punctual"]))
        .with("/extensions", json!({"KHR_lights_punctual": {"lights": [
            {"type": "point", "color": [1, 0.5, 0], "intensity": 10, "range": 5},
            {"type": "directional", "intensity": 3},
            {"type": "spot", "spot": {"innerConeAngle": 0.25, "outerConeAngle": 0.5}}
        ]}}))
        .with("/nodes", json!([
            {"mesh": 0},
            {"extensions": {"KHR_lights_punctual": {"light": 0}}, "translation": [1, 2, 3]},
            {"extensions": {"KHR_lights_punctual": {"light": 1}}, "rotation": [-HALF, 0, 0, HALF]},
            {"extensions": {"KHR_lights_punctual": {"light": 2}}, "scale": [1, 1, 9]}
        ]))
        .with("/scenes/0/nodes", json!([0, 1, 2, 3]));
    let desc = m.fine();
    let [
        Light::Point {
            transform,
            intensity,
        },
        Light::Distant {
            direction,
            irradiance,
        },
        spot,
    ] = &desc.lights[..]
    else {
        panic!("{:?}", desc.lights)
    };
    assert_eq!(
        (transform.translation, *intensity),
        (DVec3::new(1.0, 2.0, 3.0), [10.0, 5.0, 0.0])
    );
    // Turned from -Z to -Y.
    assert!((*direction + DVec3::Y).length() < 1e-7);
    assert_eq!(*irradiance, [3.0; 3]);
    let Light::Spot {
        transform,
        cone_angle,
        full_angle,
        falloff: SpotFalloff::Squared,
        ..
    } = spot
    else {
        panic!("{spot:?}")
    };
    assert!((transform.matrix3.z_axis + DVec3::Z).length() < 1e-12);
    assert!(
        (cone_angle - 0.5f64.to_degrees()).abs() < 1e-12
            && (full_angle - 0.25f64.to_degrees()).abs() < 1e-12
    );
}

#[test]
fn variants_choose_materials() {
    let mut m = Model::triangle();
    m.json["materials"] = json!([{"name": "red"}, {"name": "blue"}]);
    m.json["meshes"][0]["primitives"][0]["material"] = 0.into();
    let m = m
        .with("/extensionsUsed", json!(["KHR_materials_variants"]))
        .with(
            "/extensions",
            json!({"KHR_materials_variants": {"variants": [{"name": "day"}, {"name": "night"}]}}),
        )
        .with(
            "/meshes/0/primitives/0/extensions",
            json!({"KHR_materials_variants": {"mappings": [{"material": 1, "variants": [1]}]}}),
        );
    let named = |name: Option<&str>| {
        let variant = name.map(str::to_owned);
        look(
            &m,
            Look {
                variant,
                ..Look::default()
            },
        )
        .map(|(desc, _)| desc.materials[0].name.clone())
    };
    assert_eq!(named(None).unwrap(), "red");
    assert_eq!(named(Some("day")).unwrap(), "red");
    assert_eq!(named(Some("night")).unwrap(), "blue");
    let error = named(Some("dawn")).unwrap_err().to_string();
    assert!(
        error.contains("no variant \"dawn\"; did you mean \"day\"?; it has day, night"),
        "{error}"
    );
}
