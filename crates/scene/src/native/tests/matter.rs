//! Principled surfaces, hair, media and curves in Brolly's own files.

use super::{read, source};
use crate::assets::MemorySource;
use crate::model::*;
use crate::{Overrides, load};
use glam::{DAffine3, DVec3};
use std::sync::Arc;

const SCENE: &str = r#"{
  "brolly": 1,
  "camera": {"look_from": [0, 1, 5], "medium": "fog"},
  "textures": {"alpha": {"threshold": {"value": "vertex", "at": 0.25}}, "vertex": "vertex_color"},
  "materials": {
    "paint": {"bsdf": {"principled": {"base_color": "srgb(#ff0000)", "coat": 1, "sheen_color": 0.5,
               "coat_normal_map": {"texture": "vertex", "strength": 0.5}, "anisotropy_direction": "vertex"}}},
    "plain": {"bsdf": {"principled": {}}},
    "fur": {"bsdf": {"hair": {"color": {"reflectance": [0.4, 0.2, 0.1]}, "beta_n": "vertex"}}},
    "nothing": {"bsdf": "interface"}
  },
  "media": {
    "fog": {"sigma_s": 0.1, "g": 0.8},
    "smoke": {"sigma_a": [1, 2, 3], "sigma_s": 0.5,
              "grid": {"bounds": [[-1, -1, -1], [1, 1, 1]], "transform": [{"translate": [0, 1, 0]}],
                       "absorption": {"size": [2, 1, 1], "values": [0.5, 1]},
                       "emission": {"size": [1, 1, 1], "colors": [[1, 0.5, 0.25]]}}}
  },
  "curves": {"strand": {"segments": [
    {"points": [[0,0,0], [0,1,0], [1,1,0], [1,2,0]], "width": [0.1, 0.01]}
  ]}},
  "primitives": [
    {"shape": {"sphere": {"radius": 2}}, "material": "nothing", "media": {"inside": "smoke", "outside": "fog"}},
    {"shape": {"curves": "strand"}, "material": "fur"}
  ],
  "lights": [{"environment": {}}]
}"#;

pub(crate) fn written() -> String {
    // A texture refers only to textures before it.
    SCENE.replace(
        r#""alpha": {"threshold": {"value": "vertex", "at": 0.25}}, "vertex": "vertex_color""#,
        r#""vertex": "vertex_color", "alpha": {"threshold": {"value": {"texture": "vertex", "channel": "a"}, "at": 0.25}}"#,
    )
}

#[test]
fn surfaces_media_and_curves_are_read() {
    let desc = read(&written());
    let BsdfDesc::Principled(paint) = &desc.materials[0].bsdf else {
        panic!("{:?}", desc.materials[0]);
    };
    assert_eq!(paint.base_color, ColorTex::Const([1.0, 0.0, 0.0]));
    assert_eq!(paint.coat_normal_map, Some((TextureId(0), 0.5)));
    assert_eq!(paint.anisotropy_direction, Some(TextureId(0)));
    let BsdfDesc::Principled(plain) = &desc.materials[1].bsdf else {
        panic!("{:?}", desc.materials[1]);
    };
    assert_eq!(**plain, Principled::default());
    assert_eq!(
        desc.textures[1],
        Texture::Threshold {
            value: FloatTex::Texture(TextureId(0), Channel::A),
            at: 0.25
        }
    );
    assert_eq!(desc.camera.medium, Some(MediumId(0)));
    assert_eq!(
        desc.primitives[0].media,
        Some(MediumInterface {
            inside: Some(MediumId(1)),
            outside: Some(MediumId(0))
        })
    );
    let grid = desc.media[1].grid.as_ref().unwrap();
    assert!(Arc::ptr_eq(&grid.absorption, &grid.scattering));
    assert_eq!(grid.transform.translation, DVec3::Y);
    assert_eq!(desc.primitives[1].shape, Shape::Curves(CurvesId(0)));
    assert_eq!(desc.curves[0].segments[0].u, [0.0, 1.0]);
    assert_eq!(desc.curves[0].kind, CurveKind::Cylinder);
}

#[test]
fn surfaces_media_and_curves_survive_a_round_trip() {
    let mut desc = read(&written());
    let third = 1.0f32 / 3.0;
    let t = |channel| FloatTex::Texture(TextureId(0), channel);
    desc.materials.push(Material {
        name: "everything".into(),
        bsdf: BsdfDesc::Principled(Box::new(Principled {
            base_color: ColorTex::Texture(TextureId(0)),
            metallic: t(Channel::B),
            roughness: t(Channel::G),
            anisotropy: FloatTex::Const(third),
            anisotropy_rotation: FloatTex::Const(-33.5),
            anisotropy_direction: None,
            ior: 0.0,
            specular: FloatTex::Const(0.9),
            specular_color: ColorTex::Const([third, 2.0, 0.0]),
            metal_edge: ColorTex::Const([0.5, 0.6, 0.7]),
            transmission: FloatTex::Const(0.8),
            thin: true,
            diffuse_transmission: FloatTex::Const(0.7),
            diffuse_transmission_color: ColorTex::Const([0.1, 0.2, 0.3]),
            coat: FloatTex::Const(0.6),
            coat_roughness: t(Channel::R),
            coat_ior: 1.6,
            coat_normal_map: Some((TextureId(0), third)),
            sheen_color: ColorTex::Texture(TextureId(0)),
            sheen_roughness: t(Channel::A),
            iridescence: FloatTex::Const(0.4),
            iridescence_ior: 1.33,
            iridescence_thickness: t(Channel::Mean),
        })),
        normal_map: Some((TextureId(0), 2.0)),
        bump_map: None,
    });
    for color in [
        HairColor::Absorption(ColorTex::Const([third; 3])),
        HairColor::Melanin {
            eumelanin: FloatTex::Const(1.5),
            pheomelanin: t(Channel::R),
        },
    ] {
        let name = format!("hair {}", desc.materials.len());
        desc.materials.push(Material {
            name,
            bsdf: BsdfDesc::Hair {
                color,
                ior: 1.4,
                beta_m: FloatTex::Const(0.1),
                beta_n: FloatTex::Const(0.9),
                alpha: -3.0,
            },
            normal_map: None,
            bump_map: None,
        });
    }
    let own = Arc::new(Grid {
        size: [1, 3, 2],
        values: GridValues::Rgb(vec![[third, 0.0, 5.5]; 6]),
    });
    let shared = desc.media[1].grid.clone().unwrap();
    desc.media.push(Medium {
        name: "cloud".into(),
        sigma_a: [third; 3],
        sigma_s: [1.0, 2.0, 3.0],
        emission: [0.25; 3],
        g: -third,
        grid: Some(MediumGrid {
            transform: DAffine3::from_scale(DVec3::new(1.0, 2.0, 1.0 / 3.0)),
            bounds: [[-third; 3], [third; 3]],
            absorption: own.clone(),
            scattering: shared.absorption.clone(),
            emission: Some(own),
        }),
        translucent: Some(1.0 + third),
    });
    desc.primitives[1].media = Some(MediumInterface {
        inside: None,
        outside: Some(MediumId(2)),
    });
    let segment = CurveSegment {
        points: [[third; 3], [1.0; 3], [2.0; 3], [0.1; 3]],
        width: [0.0, third],
        u: [0.25, 0.75],
        normals: [[0.0, 1.0, 0.0], [third; 3]],
    };
    desc.curves.push(Curves {
        name: "ribbons".into(),
        kind: CurveKind::Ribbon,
        segments: Arc::new(vec![segment; 3]),
    });
    desc.primitives.push(Primitive {
        shape: Shape::Curves(CurvesId(1)),
        ..desc.primitives[1].clone()
    });
    assert_eq!(crate::validate(&desc), []);
    let written = crate::native::write(&desc, &MemorySource::new()).unwrap();
    // Two grids of the first medium, one more of the second; none is written twice.
    let grids = written
        .files
        .iter()
        .filter(|(p, _)| p.starts_with("grids/"));
    assert_eq!(grids.count(), 3);
    let mut files = source(&written.json);
    for (path, bytes) in &written.files {
        files.insert(path, bytes.as_slice()).unwrap();
    }
    let (again, diagnostics) = load("s.json", &files, &Overrides::default()).unwrap();
    assert_eq!(diagnostics, []);
    assert_eq!(again, desc);
    // Every cut of a binary file is refused, and so is anything after its end.
    for (path, bytes) in &written.files {
        for cut in 0..bytes.len() {
            let mut files = files.clone();
            files.insert(path, &bytes[..cut]).unwrap();
            assert!(
                load("s.json", &files, &Overrides::default()).is_err(),
                "{path} of {cut} bytes"
            );
        }
        let mut longer = bytes.clone();
        longer.push(0);
        let mut files = files.clone();
        files.insert(path, longer).unwrap();
        let error = load("s.json", &files, &Overrides::default()).unwrap_err();
        assert!(error.to_string().contains("left over"), "{path}: {error}");
    }
}

#[test]
fn pictures_inside_other_files_get_files_of_their_own() {
    let mut desc = read(&written());
    let bytes: Arc<[u8]> = b"PF\n1 1\n-1.0\n\0\0\0\0\0\0\0\0\0\0\0\0".as_slice().into();
    for encoding in [Encoding::Linear, Encoding::Srgb] {
        desc.images.push(ImageDesc {
            path: "model.glb#/images/0".into(),
            encoding,
            missing: false,
            bytes: Some(bytes.clone()),
        });
    }
    let written = crate::native::write(&desc, &MemorySource::new()).unwrap();
    let pictures: Vec<&str> = written
        .files
        .iter()
        .map(|(path, _)| path.as_str())
        .filter(|path| path.starts_with("images/"))
        .collect();
    assert_eq!(pictures, ["images/00000.pfm"]);
    let mut files = source(&written.json);
    for (path, bytes) in &written.files {
        files.insert(path, bytes.as_slice()).unwrap();
    }
    let again = load("s.json", &files, &Overrides::default()).unwrap().0;
    let encodings: Vec<Encoding> = again.images.iter().map(|i| i.encoding).collect();
    assert_eq!(encodings, [Encoding::Linear, Encoding::Srgb]);
}

#[test]
fn broken_surfaces_media_and_curves_are_refused() {
    let scene = written();
    let check = |from: &str, to: &str, expect: &str| {
        assert!(scene.contains(from), "{from}");
        let text = scene.replacen(from, to, 1);
        let error = match load("s.json", &source(&text), &Overrides::default()) {
            Ok(_) => panic!("accepted: {from:?} -> {to:?}"),
            Err(error) => error,
        };
        let all: Vec<String> = error.diagnostics.iter().map(|d| d.to_string()).collect();
        assert!(
            all.iter().any(|d| d.contains(expect)),
            "{from:?} -> {to:?}: {all:#?}, expected {expect}"
        );
    };
    let principled = "\"principled\": {}";
    let with = |field: &str| format!("\"principled\": {{{field}}}");
    let field = |field: &str, expect: &str| check(principled, &with(field), expect);
    field("\"metalic\": 1", "did you mean \"metallic\"?");
    field("\"metallic\": 1.5", "metallic is 1.5; 0 to 1 is possible");
    field("\"roughness\": -1", "roughness is -1");
    field("\"base_color\": [1, -1, 0]", "a colour of");
    field(
        "\"base_color\": \"no\"",
        "/materials/plain: error: unknown texture \"no\"",
    );
    field("\"ior\": -1", "an index of refraction of -1");
    field("\"coat_ior\": 0", "an index of refraction of 0");
    field("\"iridescence_thickness\": -3", "a film -3 nm thick");
    field(
        "\"coat_normal_map\": {\"texture\": \"x\"}",
        "unknown texture",
    );
    field("\"anisotropy_direction\": \"x\"", "unknown texture");
    field("\"thin\": 1", "expected a boolean");
    check("\"beta_n\": \"vertex\"", "\"beta_n\": 2", "beta_n is 2");
    check("\"beta_n\": \"vertex\"", "\"alpha\": 90", "tilted by 90");
    check(
        "{\"reflectance\": [0.4, 0.2, 0.1]}",
        "{\"melanin\": {\"eumelanin\": -1}}",
        "eumelanin of -1",
    );
    check(
        "\"medium\": \"fog\"",
        "\"medium\": \"fogg\"",
        "did you mean \"fog\"?",
    );
    check("\"inside\": \"smoke\"", "\"inside\": \"mist\"", "s.json:");
    check(
        "\"inside\": \"smoke\"",
        "\"inside\": \"mist\"",
        "/primitives/0/media: error: unknown medium \"mist\"",
    );
    check("\"g\": 0.8", "\"g\": 1", "an asymmetry of 1");
    check("\"sigma_s\": 0.1", "\"sigma_s\": [1, -1, 0]", "sigma_s of");
    check(
        "[[-1, -1, -1], [1, 1, 1]]",
        "[[1, 1, 1], [-1, -1, -1]]",
        "a box from",
    );
    check(
        "\"translate\": [0, 1, 0]",
        "\"scale\": [0, 1, 0]",
        "singular",
    );
    check(
        "\"size\": [2, 1, 1]",
        "\"size\": [2, 2, 1]",
        "2 x 2 x 1 cells with 2 values",
    );
    check(
        "\"size\": [2, 1, 1]",
        "\"size\": [4000000000, 4000000000, 4000000000]",
        "a side is 1 to 16384",
    );
    check("\"size\": [2, 1, 1]", "\"size\": [0, 1, 1]", "0 x 1 x 1");
    check("\"size\": [2, 1, 1], ", "", "a grid has either \"file\"");
    check(
        "\"values\": [0.5, 1]",
        "\"file\": \"a.bin\"",
        "a grid has either \"file\"",
    );
    check(
        "\"size\": [2, 1, 1], \"values\": [0.5, 1]",
        "\"file\": \"a.bin\"",
        "a.bin: no such file",
    );
    check(
        "\"size\": [2, 1, 1], \"values\": [0.5, 1]",
        "\"file\": \"../a.bin\"",
        "leaves the scene's folder",
    );
    check("[0.5, 1]", "[0.5, -1]", "negative or not finite");
    check(
        "{\"curves\": \"strand\"}",
        "{\"curves\": \"strnd\"}",
        "did you mean \"strand\"?",
    );
    check(
        "\"width\": [0.1, 0.01]",
        "\"width\": [-0.1, 0.01]",
        "segment 0: a width",
    );
    check(
        "\"width\": [0.1, 0.01]",
        "\"width\": [0, 0]",
        "segment 0: a width",
    );
    check(
        "{\"segments\": [",
        "{\"kind\": \"ribbon\", \"segments\": [",
        "a ribbon without normals",
    );
    check(
        "{\"segments\": [",
        "{\"file\": \"x\", \"segments\": [",
        "curves have either",
    );
    check("\"at\": 0.25", "\"at\": 1e40", "number out of range");
    check(
        "\"value\": {\"texture\": \"vertex\"",
        "\"value\": {\"texture\": \"alpha\"",
        "unknown texture \"alpha\"",
    );
}
