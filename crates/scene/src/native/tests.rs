//! What Brolly's own files mean, and what is refused.

pub(crate) mod matter;

use crate::assets::MemorySource;
use crate::model::*;
use crate::{Look, Overrides, load};
use glam::DVec3;
use proptest::prelude::*;
use std::sync::Arc;

const SCENE: &str = r#"{
  "brolly": 1,
  "camera": {"look_from": [0, 1, 5], "look_at": [0, 1, 0], "vfov": 30, "shutter": [0, 0.5],
             "lens": {"radius": 0.1, "focus_distance": 5, "aperture": {"blades": {"count": 6, "rotation": 15}}}},
  "film": {"size": [64, 48], "filter": {"tent": {"radius": [1, 1]}}},
  "spp": 32,
  "textures": {
    "checks": {"checkerboard": {"map": {"uv": {"matrix": [8, 0, 0, 0, 8, 0]}}, "even": 0.2, "odd": "srgb(#ffffff)"}},
    "vertex": "vertex_color"
  },
  "materials": {
    "wall": {"bsdf": {"diffuse": {"reflectance": [0.7, 0.6, 0.5]}}},
    "floor": {"bsdf": {"diffuse": {"reflectance": "checks"}}, "bump_map": "checks"},
    "glass": {"bsdf": {"dielectric": {}}},
    "both": {"bsdf": {"mix": {"a": "wall", "b": "glass", "amount": {"texture": "vertex", "channel": "a"}}}}
  },
  "meshes": {"tri": {"positions": [[0,0,0],[1,0,0],[0,1,0]], "indices": [[0,1,2]], "colors": [[1,1,1,1],[1,1,1,0],[1,1,1,1]]}},
  "groups": {"pair": {"primitives": [{"shape": {"sphere": {"radius": 0.5}}, "material": "glass"}]}},
  "primitives": [
    {"shape": "rectangle", "material": "floor",
     "transform": [{"scale": [5, 5, 1]}, {"rotate": {"axis": [1, 0, 0], "degrees": -90}}]},
    {"shape": {"mesh": "tri"}, "material": "both", "alpha": "vertex"},
    {"shape": {"disk": {"radius": 1}}, "material": "wall",
     "emission": {"radiance": "blackbody(4000)", "scale": 3},
     "transform": {"keys": [{"time": 0, "transform": []}, {"time": 1, "transform": [{"translate": [0, 1, 0]}]}]}}
  ],
  "instances": [{"group": "pair", "transform": [{"translate": [1, 2, 3]}]}],
  "lights": [
    {"environment": {"radiance": 0.1}},
    {"spot": {"intensity": 5, "cone_angle": 30, "full_angle": 20}}
  ]
}"#;

fn source(text: &str) -> MemorySource {
    MemorySource::new().with("s.json", text).unwrap()
}

fn read(text: &str) -> SceneDesc {
    load("s.json", &source(text), &Overrides::default())
        .unwrap_or_else(|e| panic!("{e}"))
        .0
}

#[test]
fn a_scene_written_by_hand_is_read() {
    let desc = read(SCENE);
    assert_eq!(
        (desc.film.width, desc.film.height, desc.spp),
        (64, 48, Some(32))
    );
    assert_eq!(desc.integrator, Integrator::Path { max_depth: 64 });
    let camera = desc.camera.transform.keys[0].transform;
    assert_eq!(
        (camera.translation, camera.matrix3.z_axis),
        (DVec3::new(0.0, 1.0, 5.0), DVec3::Z)
    );
    let floor = desc.primitives[0].transform.keys[0].transform;
    assert!((floor.transform_vector3(DVec3::Z) - DVec3::Y).length() < 1e-12);
    assert!((floor.transform_vector3(DVec3::X) - DVec3::X * 5.0).length() < 1e-12);
    assert_eq!(desc.primitives[2].transform.keys.len(), 2);
    assert_eq!(
        desc.materials[1].bump_map,
        Some(FloatTex::Texture(TextureId(0), Channel::R))
    );
    assert_eq!(
        desc.instances[0].transform.keys[0].transform.translation,
        DVec3::new(1.0, 2.0, 3.0)
    );
}

#[test]
fn everything_survives_a_round_trip() {
    let mut desc = read(SCENE);
    // What a hand-written scene rarely has.
    let third = 1.0f32 / 3.0;
    let base = desc.meshes[0].clone();
    desc.meshes.push(Mesh {
        name: "rich".into(),
        tangents: Arc::new(vec![[1.0, 0.0, 0.0, -1.0]; 3]),
        normals: Arc::new(vec![[0.0, 0.0, 1.0]; 3]),
        uvs: vec![
            Arc::new(vec![[third, 0.1]; 3]),
            Arc::new(vec![[0.5, 0.25]; 3]),
        ],
        deformation: Some(Arc::new(Deformation {
            first_time: -0.1,
            keys: vec![DeformationKey {
                time: 0.7,
                positions: base.positions.to_vec(),
                normals: vec![],
            }],
        })),
        ..base
    });
    desc.primitives.push(Primitive {
        shape: Shape::Mesh(MeshId(1)),
        ..desc.primitives[0].clone()
    });
    let t = |texture| texture;
    desc.textures.extend([
        t(Texture::Constant {
            value: [third, 0.0, 1.0, 0.5],
        }),
        t(Texture::Scale {
            a: ColorTex::Const([third; 3]),
            b: FloatOrColor::Color(ColorTex::Texture(TextureId(0))),
        }),
        t(Texture::Scale {
            a: ColorTex::Texture(TextureId(2)),
            b: FloatOrColor::Float(FloatTex::Const(0.1)),
        }),
        t(Texture::Mix {
            a: ColorTex::Const([0.0; 3]),
            b: ColorTex::Texture(TextureId(1)),
            amount: FloatTex::Texture(TextureId(0), Channel::Mean),
        }),
        t(Texture::Checkerboard3d {
            matrix: glam::DAffine3::from_scale(DVec3::new(0.1, 1.0 / 3.0, 7.0)),
            even: ColorTex::Const([0.1; 3]),
            odd: ColorTex::Texture(TextureId(1)),
        }),
        t(Texture::Dots {
            map: UvMap::Spherical {
                matrix: glam::DAffine3::from_rotation_x(0.3),
            },
            inside: ColorTex::Const([third; 3]),
            outside: ColorTex::Const([0.0; 3]),
        }),
        t(Texture::Noise {
            matrix: glam::DAffine3::from_rotation_y(0.7),
            pattern: NoisePattern::Marble {
                octaves: 6,
                roughness: third,
                scale: 2.5,
                variation: 0.1,
            },
        }),
        t(Texture::Noise {
            matrix: glam::DAffine3::IDENTITY,
            pattern: NoisePattern::Windy,
        }),
        t(Texture::DirectionMix {
            a: ColorTex::Const([1.0; 3]),
            b: ColorTex::Texture(TextureId(0)),
            direction: DVec3::new(1.0, 2.0, -3.0).normalize(),
        }),
        t(Texture::Grey {
            value: FloatTex::Texture(TextureId(0), Channel::AlphaOrMean),
        }),
        t(Texture::Dots {
            map: UvMap::Cylindrical {
                matrix: glam::DAffine3::from_rotation_z(0.1),
            },
            inside: ColorTex::Const([third; 3]),
            outside: ColorTex::Const([0.0; 3]),
        }),
        t(Texture::Bilerp {
            map: UvMap::Planar {
                matrix: glam::DAffine3::from_scale(DVec3::new(0.1, 1.0 / 3.0, 0.0)),
            },
            corners: [[0.1; 3], [0.2; 3], [0.3; 3], [0.7, 0.8, 0.9]],
        }),
    ]);
    let roughness = Roughness {
        u: FloatTex::Const(0.1),
        v: FloatTex::Texture(TextureId(0), Channel::G),
        scale: RoughnessScale::Square,
    };
    let coat = Coat {
        ior: 1.3,
        roughness,
        thickness: 0.02,
        albedo: [0.1; 3],
        g: -0.5,
        max_depth: 7,
        samples: 3,
    };
    let white = ColorTex::Const([1.0; 3]);
    let fresnel = ConductorFresnel::EtaK {
        eta: white,
        k: ColorTex::Texture(TextureId(1)),
    };
    let lobe = LafortuneLobe {
        albedo: [0.3; 3],
        c: [-1.0, -1.0, 1.0],
        exponent: 20.5,
    };
    let bsdfs = [
        BsdfDesc::OrenNayar {
            reflectance: white,
            sigma: FloatTex::Const(20.0),
        },
        BsdfDesc::Phong {
            diffuse: white,
            specular: white,
            exponent: FloatTex::Const(30.0),
        },
        BsdfDesc::Lafortune {
            diffuse: white,
            lobes: vec![lobe],
        },
        BsdfDesc::Mirror { reflectance: white },
        BsdfDesc::Dielectric {
            ior: 1.33,
            roughness,
            reflect_tint: white,
            transmit_tint: ColorTex::Texture(TextureId(0)),
        },
        BsdfDesc::ThinDielectric { ior: 1.6 },
        BsdfDesc::Conductor { fresnel, roughness },
        BsdfDesc::Conductor {
            fresnel: ConductorFresnel::Reflectance(white),
            roughness,
        },
        BsdfDesc::CoatedDiffuse {
            reflectance: white,
            coat,
        },
        BsdfDesc::CoatedConductor {
            fresnel,
            roughness,
            coat,
        },
        BsdfDesc::DiffuseTransmission {
            reflectance: white,
            transmittance: white,
        },
        BsdfDesc::TwoSided {
            inner: MaterialId(0),
        },
        BsdfDesc::Interface,
    ];
    for (i, bsdf) in bsdfs.into_iter().enumerate() {
        let normal_map = (i == 3).then_some((TextureId(0), 0.5));
        desc.materials.push(Material {
            name: format!("m/{i}~\"ü"),
            bsdf,
            normal_map,
            bump_map: None,
        });
    }
    desc.groups.push(Group {
        name: "outer".into(),
        primitives: vec![],
        instances: vec![Instance {
            group: GroupId(0),
            transform: Motion::identity(),
        }],
    });
    desc.instances.push(Instance {
        group: GroupId(1),
        transform: desc.primitives[2].transform.clone(),
    });
    desc.lights.push(Light::Point {
        transform: glam::DAffine3::from_translation(DVec3::X),
        intensity: [0.1; 3],
    });
    desc.lights.push(Light::Distant {
        direction: DVec3::new(0.1, -1.0, 1.0 / 3.0),
        irradiance: [third; 3],
    });
    desc.film.crop = Some([1, 2, 30, 40]);
    desc.film.max_component = Some(10.5);
    desc.animation = Some(Animation {
        fps: 24.0,
        start: 0.5,
        frames: (3, 9),
    });
    desc.sampler = SamplerKind::Independent;
    desc.camera.shutter_curve = ShutterCurve::Trapezoid {
        open: 0.2,
        close: 0.3,
    };
    for projection in [
        Projection::Spherical {
            mapping: SphereMapping::OctahedralEqualArea,
        },
        Projection::Orthographic {
            half_height: 1.0 / 3.0,
            window: Some(ScreenWindow {
                x: (-1.0, 0.5),
                y: (-0.1, 0.2),
            }),
            lens: None,
        },
    ] {
        desc.camera.projection = projection;
        for integrator in [
            Integrator::Uv,
            Integrator::Whitted { max_depth: 3 },
            Integrator::Guided { max_depth: 9 },
            Integrator::Direct { max_depth: 0 },
        ] {
            desc.integrator = integrator;
            let written = super::write(&desc, &MemorySource::new()).unwrap();
            let mut files = source(&written.json);
            for (path, bytes) in written.files {
                files.insert(&path, bytes).unwrap();
            }
            let (again, diagnostics) = load("s.json", &files, &Overrides::default()).unwrap();
            assert_eq!(again, desc);
            assert_eq!(diagnostics, []);
        }
    }
}

#[test]
fn broken_files_are_refused() {
    let check = |from: &str, to: &str, expect: &str| {
        assert!(SCENE.contains(from), "{from}");
        let error = match load(
            "s.json",
            &source(&SCENE.replacen(from, to, 1)),
            &Overrides::default(),
        ) {
            Ok(_) => panic!("accepted: {from:?} -> {to:?}"),
            Err(error) => error,
        };
        let all: Vec<String> = error.diagnostics.iter().map(|d| d.to_string()).collect();
        assert!(
            all.iter().any(|d| d.contains(expect)),
            "{from:?} -> {to:?}: {all:#?}, expected {expect}"
        );
    };
    check("\"brolly\": 1", "\"brolly\": 2", "version 2");
    check("\"brolly\": 1,", "", "missing field \"brolly\"");
    check(
        "\"spp\": 32",
        "\"ssp\": 32",
        "s.json:6:7#/ssp: error: unknown field \"ssp\"; did you mean \"spp\"?",
    );
    check("\"vfov\": 30", "\"vfov\": 1e999", "number out of range");
    check("\"vfov\": 30", "\"vfov\": 200", "field of view of 200");
    check("\"vfov\": 30", "\"vfov\": \"wide\"", "s.json:3:");
    check(
        "\"look_at\": [0, 1, 0]",
        "\"look_at\": [0, 1, 5]",
        "looks from where it looks at",
    );
    check(
        "\"look_at\": [0, 1, 0]",
        "\"look_at\": [0, 1]",
        "/camera/look_at",
    );
    check(
        "\"material\": \"floor\"",
        "\"material\": \"flor\"",
        "unknown material \"flor\"; did you mean \"floor\"?",
    );
    check(
        "\"material\": \"floor\"",
        "\"material\": \"flor\"",
        "s.json:20:40#/primitives/0/material",
    );
    check(
        "{\"mesh\": \"tri\"}",
        "{\"mesh\": \"try\"}",
        "unknown mesh \"try\"; did you mean \"tri\"?",
    );
    check(
        "{\"mesh\": \"tri\"}",
        "{\"ply\": \"a.ply\"}",
        "no such file",
    );
    check("{\"mesh\": \"tri\"}", "{\"ply\": \"../a.ply\"}", "leaves");
    check("\"group\": \"pair\"", "\"group\": \"par\"", "unknown group");
    check(
        "\"a\": \"wall\"",
        "\"a\": \"both\"",
        "unknown material \"both\"",
    );
    check(
        "\"reflectance\": \"checks\"",
        "\"reflectance\": \"srgb(#12)\"",
        "six hexadecimal",
    );
    check(
        "\"reflectance\": \"checks\"",
        "\"reflectance\": [1, 2]",
        "three numbers",
    );
    check(
        "\"reflectance\": \"checks\"",
        "\"reflectance\": [-1, 2, 3]",
        "a colour of",
    );
    check(
        "\"dielectric\": {}",
        "\"dielectrik\": {}",
        "unknown word \"dielectrik\"; did you mean \"dielectric\"?",
    );
    check(
        "\"indices\": [[0,1,2]]",
        "\"indices\": [[0,1,3]]",
        "index 3",
    );
    check(
        "\"indices\": [[0,1,2]]",
        "\"indices\": [[0,1,-2]]",
        "invalid value",
    );
    check("\"indices\": [[0,1,2]]", "\"ply\": \"x\"", "one of \"ply\"");
    check(
        "\"wall\": {",
        "\"glass\": {",
        "the name \"glass\" is there twice",
    );
    check(
        "\"degrees\": -90",
        "\"degrees\": -90, \"degrees\": 3",
        "duplicate field",
    );
    check("\"scale\": [5, 5, 1]", "\"scale\": [5, 0, 1]", "singular");
    check("{\"time\": 1, \"tr", "{\"time\": 0, \"tr", "do not rise");
    check("\"radius\": 0.5", "\"radius\": -0.5", "radius -0.5");
    check("\"spp\": 32", "\"spp\": 0", "samples per pixel");
    check("[64, 48]", "[64, 480000]", "a side is 1 to 65536");
    check(
        "\"spp\": 32",
        "\"spp\": 32, \"integrator\": {\"name\": \"pat\"}",
        "did you mean \"path\"?",
    );
    check(
        "\"radiance\": 0.1",
        "\"image\": \"sky.exr\"",
        "no such file",
    );
    check("  ]\n}", "  ]", "EOF");
    assert!(
        load(
            "s.json",
            &source(&"[".repeat(100_000)),
            &Overrides::default()
        )
        .is_err()
    );
    let mut files = MemorySource::new();
    files.insert("s.json", &b"\xff\xfe{"[..]).unwrap();
    assert!(load("s.json", &files, &Overrides::default()).is_err());
}

#[test]
fn overrides_are_applied() {
    let look = Look {
        look_from: Some([3.0, 0.0, 0.0]),
        vfov: Some(50.0),
        transparent: true,
        env_strength: Some(2.0),
        ..Look::default()
    };
    let overrides = Overrides {
        size: Some([100, 50]),
        integrator: Some("whitted".into()),
        look,
        ..Overrides::default()
    };
    let (desc, _) = load("s.json", &source(SCENE), &overrides).unwrap();
    assert_eq!((desc.film.width, desc.film.height), (100, 50));
    assert_eq!(desc.integrator, Integrator::Whitted { max_depth: 64 });
    let guided = Overrides {
        integrator: Some("guided".into()),
        ..Overrides::default()
    };
    let (guided, _) = load("s.json", &source(SCENE), &guided).unwrap();
    assert_eq!(guided.integrator, Integrator::Guided { max_depth: 64 });
    assert_eq!(
        desc.camera.transform.keys[0].transform.matrix3.z_axis,
        DVec3::X
    );
    assert!(matches!(
        desc.camera.projection,
        Projection::Perspective {
            fov: 50.0,
            lens: Some(_),
            ..
        }
    ));
    assert!(matches!(
        desc.lights[0],
        Light::Environment {
            hidden: true,
            radiance: [0.2, 0.2, 0.2],
            ..
        }
    ));
    for (overrides, expect) in [
        (
            Overrides {
                size: Some([0, 1]),
                ..Overrides::default()
            },
            "a side is",
        ),
        (
            Overrides {
                integrator: Some("pathe".into()),
                ..Overrides::default()
            },
            "did you mean \"path\"",
        ),
        (
            Overrides {
                look: Look {
                    camera: Some("x".into()),
                    ..Look::default()
                },
                ..Overrides::default()
            },
            "no camera",
        ),
        (
            Overrides {
                look: Look {
                    env: Some("no.hdr".into()),
                    ..Look::default()
                },
                ..Overrides::default()
            },
            "no such file",
        ),
    ] {
        let error = load("s.json", &source(SCENE), &overrides)
            .unwrap_err()
            .to_string();
        assert!(error.contains(expect), "{error}");
    }
    let missing = Overrides {
        allow_missing: true,
        look: Look {
            env: Some("no.hdr".into()),
            ..Look::default()
        },
        ..Overrides::default()
    };
    let (desc, warnings) = load("s.json", &source(SCENE), &missing).unwrap();
    assert!(desc.images[0].missing && warnings[0].reason.contains("stands in"));
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(300))]
    #[test]
    fn damage_never_panics(edits in proptest::collection::vec((0usize..4000, any::<u8>(), 0u8..3), 1..4)) {
        let mut bytes = SCENE.as_bytes().to_vec();
        for (at, byte, what) in edits {
            let at = at % bytes.len();
            match what {
                0 => bytes[at] = byte,
                1 => { bytes.remove(at); }
                _ => bytes.insert(at, byte),
            }
        }
        let mut files = MemorySource::new();
        files.insert("s.json", bytes).unwrap();
        let _ = load("s.json", &files, &Overrides::default());
    }
    #[test]
    fn damaged_buffers_never_panic(at in 0usize..400, byte: u8, cut in 0usize..400) {
        let mut mesh = read(SCENE).meshes[0].clone();
        mesh.deformation = Some(Arc::new(Deformation { first_time: 0.0, keys: vec![] }));
        let mut bytes = super::buffer::write(&mesh);
        let at = at % bytes.len();
        bytes[at] = byte;
        let _ = super::buffer::read(&bytes);
        bytes.truncate(cut);
        let _ = super::buffer::read(&bytes);
    }
}
