//! Media, curves, hair, subsurface, procedural textures and lights with pictures: what pbrt files say
//! about them and what comes out.

use crate::assets::MemorySource;
use crate::import::nanovdb::testing::{Draft, file};
use crate::model::*;
use crate::{Overrides, load};
use glam::DVec3;

fn picture(width: u32, height: u32, alpha: bool) -> Vec<u8> {
    let mut out = std::io::Cursor::new(Vec::new());
    let picture = if alpha {
        image::DynamicImage::new_rgba8(width, height)
    } else {
        image::DynamicImage::new_rgb8(width, height)
    };
    picture.write_to(&mut out, image::ImageFormat::Png).unwrap();
    out.into_inner()
}

/// A density that rises with x, and temperatures on a finer grid turned about z.
fn fire() -> Vec<u8> {
    let density = Draft {
        map: [2.0, 0.0, 0.0, 0.0, 2.0, 0.0, 0.0, 0.0, 2.0, 10.0, 0.0, 0.0],
        ..Draft::new("density").filled([-1, 0, 0], [2, 1, 1], |p| (p[0] + 2) as f32)
    };
    let heat = Draft {
        map: [0.0, -1.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0],
        ..Draft::new("temperature").filled([-8, -30, -8], [12, -1, 12], |p| -p[1] as f32)
    };
    let surface = Draft {
        class: 1,
        ..density.clone()
    };
    let surface = Draft {
        name: "surface",
        ..surface
    };
    file(&[density, heat, surface], 1)
}

fn source(text: &str) -> MemorySource {
    let with = |all: MemorySource, (path, bytes): (&str, Vec<u8>)| all.with(path, bytes).unwrap();
    [
        ("wide.png", picture(4, 2, false)),
        ("square.png", picture(4, 4, false)),
        ("alpha.png", picture(4, 4, true)),
        ("lens.dat", b"# f\n50 5 1.5 20\n-50 40 1 20\n".to_vec()),
        ("fire.nvdb", fire()),
        (
            "smoke.pbrt",
            b"MakeNamedMedium \"m\" \"string type\" \"uniformgrid\" \"float density\" 1".to_vec(),
        ),
    ]
    .into_iter()
    .fold(MemorySource::new(), with)
    .with("s.pbrt", text)
    .unwrap()
}

/// A scene and its warnings; it must come back the same from Brolly's own JSON.
fn read(text: &str) -> (SceneDesc, Vec<String>) {
    let (desc, diagnostics) = load("s.pbrt", &source(text), &Overrides::default())
        .unwrap_or_else(|e| panic!("{text}: {e}"));
    (desc, diagnostics.iter().map(|d| d.to_string()).collect())
}

/// What is in the world, under a light, without a warning.
#[track_caller]
fn world(text: &str) -> SceneDesc {
    let (desc, warnings) = read(&format!("WorldBegin\nLightSource \"infinite\"\n{text}"));
    assert_eq!(warnings, [""; 0], "{text}");
    desc
}

#[track_caller]
fn refused(text: &str, expect: &str) {
    let text = format!("WorldBegin\nLightSource \"infinite\"\n{text}\nShape \"sphere\"");
    match load("s.pbrt", &source(&text), &Overrides::default()) {
        Ok(_) => panic!("accepted: {text}"),
        Err(error) => {
            let all: Vec<String> = error.diagnostics.iter().map(|d| d.to_string()).collect();
            assert!(
                all.iter().any(|d| d.contains(expect)),
                "{text}: {all:#?}, expected {expect}"
            );
        }
    }
}

fn near(a: &[f32], b: &[f32]) -> bool {
    a.len() == b.len()
        && a.iter()
            .zip(b)
            .all(|(a, b)| (a - b).abs() <= 1e-5 * b.abs().max(1e-3))
}

#[test]
fn media_are_read_and_placed() {
    let text = "MakeNamedMedium \"outer\" \"string type\" \"homogeneous\"
        MediumInterface \"\" \"outer\"
        Camera \"perspective\"
        WorldBegin LightSource \"infinite\"
        MakeNamedMedium \"milk\" \"string type\" \"homogeneous\" \"string preset\" \"Wholemilk\" \"float scale\" 2 \"float g\" 0.5
        MakeNamedMedium \"fire\" \"string type\" \"homogeneous\" \"rgb sigma_a\" [1 2 3] \"rgb sigma_s\" [0 0 0] \"rgb Le\" [4 2 1] \"float Lescale\" 0.5
        Translate 1 2 3
        MakeNamedMedium \"fog\" \"string type\" \"uniformgrid\" \"integer nx\" 2 \"integer ny\" 1 \"integer nz\" 2
            \"float density\" [0 1 2 3] \"point3 p0\" [-1 0 0] \"point3 p1\" [1 2 3] \"float scale\" 10
        MakeNamedMedium \"smoke\" \"string type\" \"rgbgrid\" \"integer nx\" 2 \"rgb sigma_a\" [1 0 0 0 1 0]
            \"rgb Le\" [1 1 1 0 0 0] \"float Lescale\" 3
        AttributeBegin MediumInterface \"milk\" \"outer\" Shape \"sphere\" AttributeEnd
        AttributeBegin MediumInterface \"fog\" Shape \"sphere\" AttributeEnd
        Attribute \"medium\" \"float g\" 0.25
        MakeNamedMedium \"later\" \"string type\" \"homogeneous\"
        MediumInterface \"later\" \"smoke\" Material \"interface\" Shape \"sphere\"";
    let (desc, warnings) = read(text);
    assert_eq!(warnings, [""; 0]);
    let named = |name: &str| {
        let id = desc.media.iter().position(|m| m.name == name).unwrap();
        (MediumId(id as u32), &desc.media[id])
    };
    assert_eq!(desc.camera.medium, Some(named("outer").0));
    let milk = named("milk").1;
    assert!(near(&milk.sigma_a, &[0.0022, 0.0048, 0.028]), "{milk:?}");
    assert!(near(&milk.sigma_s, &[5.1, 6.42, 7.54]), "{milk:?}");
    assert_eq!((milk.g, &milk.grid), (0.5, &None));
    let fire = named("fire").1;
    assert_eq!(
        (fire.sigma_a, fire.emission),
        ([1.0, 2.0, 3.0], [2.0, 1.0, 0.5])
    );
    let fog = named("fog").1.grid.as_ref().unwrap();
    assert_eq!(fog.transform.translation, DVec3::new(1.0, 2.0, 3.0));
    assert_eq!(fog.bounds, [[-1.0, 0.0, 0.0], [1.0, 2.0, 3.0]]);
    assert_eq!(
        (fog.absorption.size, named("fog").1.sigma_s),
        ([2, 1, 2], [10.0; 3])
    );
    assert_eq!(
        fog.absorption.values,
        GridValues::Scalar(vec![0.0, 1.0, 2.0, 3.0])
    );
    assert!(std::sync::Arc::ptr_eq(&fog.absorption, &fog.scattering) && fog.emission.is_none());
    let (smoke_id, smoke) = named("smoke");
    let grid = smoke.grid.as_ref().unwrap();
    assert_eq!(
        grid.absorption.values,
        GridValues::Rgb(vec![[1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
    );
    // What is not given scatters with 1 everywhere.
    assert_eq!(grid.scattering.values, GridValues::Scalar(vec![1.0]));
    // Its emission is not divided by what white stands for.
    let shine = 3.0 * crate::color::WHITE_Y as f32;
    assert_eq!((smoke.sigma_s, smoke.emission), ([1.0; 3], [shine; 3]));
    assert_eq!(named("later").1.g, 0.25);
    let media: Vec<_> = desc.primitives.iter().map(|p| p.media).collect();
    let sides = |inside, outside| Some(MediumInterface { inside, outside });
    assert_eq!(
        media,
        [
            sides(Some(named("milk").0), Some(named("outer").0)),
            // The same on both sides: no border.
            None,
            sides(Some(named("later").0), Some(smoke_id)),
        ]
    );
}

#[test]
fn glowing_and_procedural_media() {
    let desc = world(
        "MakeNamedMedium \"hot\" \"string type\" \"uniformgrid\" \"integer nx\" 2 \"float density\" [1 1]
            \"float temperature\" [50 600] \"float temperaturescale\" 10 \"float temperatureoffset\" 0
        MakeNamedMedium \"lit\" \"string type\" \"uniformgrid\" \"integer nx\" 2 \"float density\" [1 1]
            \"rgb Le\" [1 2 3] \"float Lescale\" [0 5]
        Shape \"sphere\"",
    );
    let emission = |i: usize| {
        desc.media[i]
            .grid
            .as_ref()
            .unwrap()
            .emission
            .as_ref()
            .unwrap()
    };
    // Temperatures are interpolated before they become colours: in cells of a quarter of the side.
    assert_eq!(emission(0).size, [8, 4, 4]);
    let GridValues::Rgb(colors) = &emission(0).values else {
        panic!("temperatures without colours");
    };
    for (cell, kelvin) in [(0, 500.0), (3, 2562.5), (4, 3937.5), (7, 6000.0)] {
        let expected = crate::color::blackbody_peak_one(kelvin);
        assert!(
            near(&colors[cell], &expected),
            "{:?} {expected:?}",
            colors[cell]
        );
    }
    assert_eq!(emission(1).values, GridValues::Scalar(vec![0.0, 5.0]));
    assert_eq!(desc.media[1].emission, [1.0, 2.0, 3.0]);
    let (desc, warnings) = read(
        "WorldBegin LightSource \"infinite\" MakeNamedMedium \"c\" \"string type\" \"cloud\"
         \"float density\" 1 \"float wispiness\" 0 Shape \"sphere\"",
    );
    assert!(warnings[0].contains("finest wisps"), "{warnings:?}");
    let cloud = &desc.media[0].grid.as_ref().unwrap().absorption;
    let GridValues::Scalar(values) = &cloud.values else {
        panic!("a cloud of colours");
    };
    let n = cloud.size[0] as usize;
    let row = |y: usize| (0..n).map(move |x| (n / 2 * n + y) * n + x);
    assert!(row(0).all(|i| values[i] > 0.9) && row(n - 1).all(|i| values[i] < 0.2));
    assert!(values.iter().all(|v| (0.0..=1.0).contains(v)));
}

#[test]
fn volumes_become_grids() {
    let medium = |rest: &str| {
        let text = format!(
            "Translate 0 5 0 MakeNamedMedium \"m\" \"string type\" \"nanovdb\" \"string filename\" \"fire.nvdb\"
             \"rgb sigma_s\" [4 4 4] \"float scale\" 2 \"float g\" 0.5 {rest} Shape \"sphere\""
        );
        world(&text).media[0].clone()
    };
    let cold = medium("\"float Lescale\" 0");
    assert_eq!(
        (cold.sigma_a, cold.sigma_s, cold.g),
        ([2.0; 3], [8.0; 3], 0.5)
    );
    let grid = cold.grid.as_ref().unwrap();
    // Voxels lie at whole indices, and the density falls off beyond the last ones.
    assert_eq!(grid.absorption.size, [5, 3, 3]);
    assert_eq!(grid.bounds, [[-1.5, -0.5, -0.5], [3.5, 2.5, 2.5]]);
    let first = grid.transform.transform_point3(DVec3::new(-1.0, 0.0, 0.0));
    assert_eq!(first, DVec3::new(8.0, 5.0, 0.0));
    let GridValues::Scalar(values) = &grid.absorption.values else {
        panic!("a density of colours");
    };
    assert_eq!(
        values[..10],
        [1.0, 2.0, 3.0, 4.0, 0.0, 1.0, 2.0, 3.0, 4.0, 0.0]
    );
    assert!(std::sync::Arc::ptr_eq(&grid.absorption, &grid.scattering));
    assert_eq!((cold.emission, &grid.emission), ([0.0; 3], &None));
    // The temperature is the first coordinate in the space of the medium.
    let hot =
        medium("\"float Lescale\" 3 \"float temperaturescale\" 200 \"float temperatureoffset\" 2");
    assert_eq!(hot.emission, [3.0; 3]);
    let shine = hot.grid.as_ref().unwrap().emission.as_ref().unwrap();
    assert_eq!(shine.size, [20, 12, 12]);
    let GridValues::Rgb(colors) = &shine.values else {
        panic!("no colours");
    };
    // The second voxel lies at 10: a half to each side of it is 9.25, 9.75 and so on.
    for (cell, x) in [(4, 9.25), (5, 9.75), (6, 10.25), (7, 10.75)] {
        let expected = crate::color::blackbody_peak_one((x - 2.0) * 200.0);
        let found = colors[(6 * 12 + 2) * 20 + cell];
        assert!(near(&found, &expected), "{cell}: {found:?} {expected:?}");
    }
    let (_, warnings) = read(
        "WorldBegin LightSource \"infinite\" MakeNamedMedium \"m\" \"string type\" \"nanovdb\"
         \"string filename\" \"fire.nvdb\" \"string temperaturename\" \"heat\" Shape \"sphere\"",
    );
    assert!(warnings[0].contains("no grid \"heat\""), "{warnings:?}");
    let missing =
        "WorldBegin LightSource \"infinite\" MakeNamedMedium \"m\" \"string type\" \"nanovdb\"
         \"string filename\" \"gone.nvdb\" Shape \"sphere\"";
    let overrides = Overrides {
        allow_missing: true,
        ..Overrides::default()
    };
    let (desc, found) = load("s.pbrt", &source(missing), &overrides).unwrap();
    assert!(desc.media[0].grid.is_none() && found[0].to_string().contains("stands in"));
}

/// A list of parameters that begins in an included file goes on in the one that includes it.
#[test]
fn a_list_may_go_on_after_an_include() {
    let desc = world(
        "Include \"smoke.pbrt\"\n\"rgb sigma_a\" [1 2 3] \"float g\" 0.5\nShape \"sphere\"
        AttributeBegin Translate 1 0 0 AttributeEnd",
    );
    let medium = &desc.media[0];
    assert_eq!((medium.sigma_a, medium.g), ([1.0, 2.0, 3.0], 0.5));
    refused(
        "Include \"smoke.pbrt\" \"float density\" 2",
        "\"density\" is given twice",
    );
}

#[test]
fn broken_media_are_refused() {
    let medium = |rest: &str| format!("MakeNamedMedium \"m\" {rest}");
    for (text, expect) in [
        (medium(""), "has no \"string type\""),
        (
            medium("\"string type\" \"homogenous\""),
            "did you mean \"homogeneous\"?",
        ),
        (
            medium("\"string type\" \"heterogeneous\""),
            "pbrt-v4 has \"uniformgrid\"",
        ),
        (
            medium("\"string type\" \"nanovdb\" \"string filename\" \"a.nvdb\""),
            "a.nvdb: no such file",
        ),
        (medium("\"string type\" \"nanovdb\""), "needs \"filename\""),
        (
            medium("\"string type\" \"nanovdb\" \"string filename\" \"wide.png\""),
            "wide.png: error: not a NanoVDB file (used at s.pbrt:3)",
        ),
        (
            medium(
                "\"string type\" \"nanovdb\" \"string filename\" \"fire.nvdb\" \"string gridname\" \"dust\"",
            ),
            "no grid \"dust\"; the file has [\"density\", \"temperature\", \"surface\"]",
        ),
        (
            medium(
                "\"string type\" \"nanovdb\" \"string filename\" \"fire.nvdb\" \"string gridname\" \"surface\"",
            ),
            "not declared as a fog volume",
        ),
        (
            medium("\"string type\" \"homogeneous\" \"float g\" 1"),
            "between -1 and 1",
        ),
        (
            medium("\"string type\" \"homogeneous\" \"float scale\" -1"),
            "negative",
        ),
        (
            medium("\"string type\" \"homogeneous\" \"rgb sigma_a\" [-1 0 0]"),
            "negative component",
        ),
        (
            medium("\"string type\" \"uniformgrid\""),
            "needs \"density\"",
        ),
        (
            (0..17)
                .map(|i| format!("MakeNamedMedium \"c{i}\" \"string type\" \"cloud\"\n"))
                .collect(),
            "s.pbrt:19: error: more procedural clouds than the limit of 16",
        ),
        (
            medium("\"string type\" \"uniformgrid\" \"float density\" [1 2]"),
            "2 values for a grid of 1 x 1 x 1",
        ),
        (
            medium("\"string type\" \"uniformgrid\" \"float density\" [-1]"),
            "negative value -1",
        ),
        (
            medium("\"string type\" \"uniformgrid\" \"float density\" [1] \"point3 p1\" [0 1 1]"),
            "is empty",
        ),
        (
            medium(
                "\"string type\" \"uniformgrid\" \"float density\" [1] \"float temperature\" [1] \"rgb Le\" [1 1 1]",
            ),
            "not both",
        ),
        (
            medium("\"string type\" \"uniformgrid\" \"float density\" [1] \"float Lescale\" [1 2]"),
            "2 of \"Lescale\" for 1",
        ),
        (
            medium("\"string type\" \"rgbgrid\""),
            "needs \"sigma_a\" or \"sigma_s\"",
        ),
        (
            medium("\"string type\" \"rgbgrid\" \"rgb sigma_a\" [1 1]"),
            "multiple of 3",
        ),
        (
            medium("\"string type\" \"rgbgrid\" \"rgb sigma_s\" [1 1 1] \"rgb Le\" [1 1 1]"),
            "needs \"sigma_a\"",
        ),
        (
            medium("\"string type\" \"homogeneous\"").repeat(2),
            "defined twice",
        ),
        (
            "MakeNamedMedium \"\" \"string type\" \"homogeneous\"".into(),
            "empty name",
        ),
        (
            "MediumInterface \"fog\" \"\"".into(),
            "unknown medium \"fog\"",
        ),
    ] {
        refused(&text, expect);
    }
}

#[test]
fn curves_become_bundles() {
    let strand = |x: u32| format!("Shape \"curve\" \"point3 P\" [{x} 0 0 {x} 1 0 {x} 2 0 {x} 3 1]");
    let text = format!(
        "{} \"float width\" 0.2
        {} \"float width0\" 0.4 \"float width1\" 0
        {} \"string type\" \"cylinder\"
        AttributeBegin Translate 1 0 0 {} AttributeEnd
        Shape \"sphere\"
        Shape \"curve\" \"string type\" \"ribbon\" \"string basis\" \"bspline\" \"integer degree\" 2
            \"point3 P\" [0 0 0 1 0 0 2 1 0 3 1 0] \"normal N\" [0 0 1 0 1 1 1 0 0] \"float width1\" 3",
        strand(0),
        strand(1),
        strand(2),
        strand(3)
    );
    let desc = world(&text);
    let kinds: Vec<_> = desc
        .curves
        .iter()
        .map(|c| (c.kind, c.segments.len()))
        .collect();
    assert_eq!(
        kinds,
        [
            (CurveKind::Flat, 2),
            (CurveKind::Cylinder, 1),
            (CurveKind::Flat, 1),
            (CurveKind::Ribbon, 2)
        ]
    );
    let shapes: Vec<_> = desc.primitives.iter().map(|p| p.shape.clone()).collect();
    assert_eq!(shapes[0], Shape::Curves(CurvesId(0)));
    assert_eq!(shapes[3], Shape::Sphere { radius: 1.0 });
    let first = &desc.curves[0].segments;
    assert_eq!((first[0].width, first[1].width), ([0.2; 2], [0.4, 0.0]));
    assert_eq!(first[1].points[3], [1.0, 3.0, 1.0]);
    let ribbon = &desc.curves[3].segments;
    assert_eq!((ribbon[0].width, ribbon[1].width), ([1.0, 2.0], [2.0, 3.0]));
    assert_eq!(ribbon[1].normals, [[0.0, 1.0, 1.0], [1.0, 0.0, 0.0]]);
    assert_eq!(ribbon[0].points[0], [0.5, 0.0, 0.0]);
    for (text, expect) in [
        ("Shape \"curve\"", "needs \"P\""),
        (
            "Shape \"curve\" \"point3 P\" [0 0 0 1 1 1]",
            "cannot have 2 control points",
        ),
        (
            "Shape \"curve\" \"point3 P\" [0 0 0 1 1 1] \"integer degree\" 4",
            "must be from 2 to 3",
        ),
        (
            "Shape \"curve\" \"point3 P\" [0 0 0 1 1 1 2 2 2] \"integer degree\" 2 \"string type\" \"ribbon\"",
            "needs normals",
        ),
        (
            "Shape \"curve\" \"point3 P\" [0 0 0 1 1 1 2 2 2] \"integer degree\" 2 \"string basis\" \"hermite\"",
            "unknown basis",
        ),
        ("Shape \"curve\" \"float width\" -1", "negative width"),
    ] {
        refused(text, expect);
    }
}

#[test]
fn hair_and_subsurface_are_mapped() {
    let desc = world(
        "Material \"hair\" Shape \"sphere\"
        Material \"hair\" \"rgb reflectance\" [0.5 0.4 0.3] \"float beta_m\" 0.1 \"float alpha\" 3 Shape \"sphere\"
        Material \"hair\" \"rgb sigma_a\" [1 2 3] \"float eta\" 1.5 Shape \"sphere\"
        Material \"hair\" \"float pheomelanin\" 0.7 Shape \"sphere\"",
    );
    let hair: Vec<_> = desc.primitives[..]
        .iter()
        .map(|p| &desc.materials[p.material.index()].bsdf)
        .collect();
    let zero = FloatTex::Const(0.0);
    let melanin = |eumelanin, pheomelanin| HairColor::Melanin {
        eumelanin,
        pheomelanin,
    };
    let colors: Vec<_> = hair
        .iter()
        .map(|bsdf| match bsdf {
            BsdfDesc::Hair { color, .. } => *color,
            other => panic!("{other:?}"),
        })
        .collect();
    assert_eq!(
        colors,
        [
            melanin(FloatTex::Const(1.3), zero),
            HairColor::Reflectance(ColorTex::Const([0.5, 0.4, 0.3])),
            HairColor::Absorption(ColorTex::Const([1.0, 2.0, 3.0])),
            melanin(zero, FloatTex::Const(0.7)),
        ]
    );
    assert!(matches!(
        hair[1],
        BsdfDesc::Hair {
            ior: 1.55,
            beta_m: FloatTex::Const(0.1),
            beta_n: FloatTex::Const(0.3),
            alpha: 3.0,
            ..
        }
    ));

    let desc = world(
        "MakeNamedMedium \"air\" \"string type\" \"homogeneous\" MediumInterface \"\" \"air\"
        Material \"subsurface\" Shape \"sphere\"
        Material \"subsurface\" \"string name\" \"Skin1\" \"float scale\" 10 \"float eta\" 1.4 \"float roughness\" 0.2 Shape \"sphere\"
        Material \"subsurface\" \"rgb reflectance\" [0.8 0.5 0.2] \"rgb mfp\" [1 2 4] \"float scale\" 0.5 Shape \"sphere\"
        Material \"subsurface\" \"rgb sigma_a\" [1 1 1] \"rgb sigma_s\" [2 2 2] \"float g\" 0.5 Shape \"sphere\"",
    );
    let inside = |i: usize| {
        let media = desc.primitives[i].media.unwrap();
        assert_eq!(media.outside, Some(MediumId(0)));
        &desc.media[media.inside.unwrap().index()]
    };
    assert!(near(&inside(0).sigma_s, &[2.55, 3.21, 3.77]));
    assert!(near(&inside(1).sigma_s, &[7.4, 8.8, 10.1]) && inside(1).g == 0.0);
    // Thickness adds up to 1 / (0.5 mfp); brighter skin scatters more of it.
    let m = inside(2);
    let total: Vec<f32> = (0..3).map(|i| m.sigma_a[i] + m.sigma_s[i]).collect();
    assert!(near(&total, &[2.0, 1.0, 0.5]), "{total:?}");
    let albedo: Vec<f32> = (0..3).map(|i| m.sigma_s[i] / total[i]).collect();
    assert!(
        albedo[0] > albedo[1] && albedo[1] > albedo[2] && albedo[0] < 1.0,
        "{albedo:?}"
    );
    assert_eq!((inside(3).sigma_s, inside(3).g), ([2.0; 3], 0.5));
    match desc.materials[desc.primitives[1].material.index()].bsdf {
        BsdfDesc::Dielectric { ior, roughness, .. } => {
            assert_eq!((ior, roughness.u), (1.4, FloatTex::Const(0.2)));
        }
        ref other => panic!("{other:?}"),
    }
    for (text, expect) in [
        (
            "Material \"subsurface\" \"string name\" \"Skin3\"",
            "did you mean \"Skin1\"?",
        ),
        (
            "Material \"subsurface\" \"rgb sigma_a\" [1 1 1]",
            "needs \"sigma_s\"",
        ),
        (
            "Material \"subsurface\" \"rgb reflectance\" [1 1 1] \"rgb mfp\" [0 1 1]",
            "free path of zero",
        ),
        ("Material \"hair\" \"float beta_n\" 2", "roughness of 2"),
        ("Material \"hair\" \"float eta\" 0", "index of refraction"),
        ("Material \"measured\"", "needs a \"filename\""),
    ] {
        refused(text, expect);
    }
}

#[test]
fn every_texture_has_its_node() {
    let desc = world(
        "Texture \"cube\" \"spectrum\" \"checkerboard\" \"integer dimension\" 3 \"rgb tex1\" [1 0 0] \"rgb tex2\" [0 0 1]
        Texture \"dots\" \"float\" \"dots\" \"float inside\" 0.2 \"float outside\" 0.8 \"string mapping\" \"spherical\"
        Texture \"fbm\" \"float\" \"fbm\" \"integer octaves\" 4 \"float roughness\" 0.25
        Texture \"wrinkled\" \"float\" \"wrinkled\"
        Texture \"windy\" \"float\" \"windy\"
        Texture \"marble\" \"spectrum\" \"marble\" \"float variation\" 0.5 \"float scale\" 3
        AttributeBegin Rotate 90 1 0 0
        Texture \"dir\" \"spectrum\" \"directionmix\" \"texture tex1\" \"cube\" \"vector3 dir\" [0 2 0]
        AttributeEnd
        Texture \"tube\" \"spectrum\" \"checkerboard\" \"string mapping\" \"cylindrical\"
        Texture \"mip\" \"spectrum\" \"imagemap\" \"string filename\" \"wide.png\" \"string filter\" \"trilinear\"
        Texture \"ewa\" \"spectrum\" \"imagemap\" \"string filename\" \"wide.png\" \"string filter\" \"ewa\" \"float maxanisotropy\" 4
        Texture \"sky\" \"spectrum\" \"imagemap\" \"string filename\" \"square.png\" \"string wrap\" \"octahedralsphere\"
        Texture \"a\" \"float\" \"imagemap\" \"string filename\" \"alpha.png\"
        Texture \"g\" \"float\" \"imagemap\" \"string filename\" \"square.png\"
        Texture \"am\" \"float\" \"mix\" \"texture tex1\" \"a\" \"float tex2\" 0.5
        Texture \"gm\" \"float\" \"mix\" \"texture tex1\" \"g\" \"float tex2\" 0.5
        Shape \"sphere\" \"texture alpha\" \"am\"",
    );
    use Texture as T;
    let count = |f: &dyn Fn(&Texture) -> bool| desc.textures.iter().filter(|t| f(t)).count();
    assert_eq!(
        count(&|t| matches!(
            t,
            T::Checkerboard3d {
                even: ColorTex::Const([1.0, 0.0, 0.0]),
                ..
            }
        )),
        1
    );
    assert_eq!(
        count(&|t| matches!(
            t,
            T::Dots {
                map: UvMap::Spherical { .. },
                inside: ColorTex::Const([0.2, 0.2, 0.2]),
                ..
            }
        )),
        1
    );
    let noise = |wanted| count(&|t| matches!(t, T::Noise { pattern, .. } if *pattern == wanted));
    assert_eq!(
        noise(NoisePattern::Fbm {
            octaves: 4,
            roughness: 0.25
        }),
        1
    );
    assert_eq!(
        noise(NoisePattern::Wrinkled {
            octaves: 8,
            roughness: 0.5
        }),
        1
    );
    assert_eq!(noise(NoisePattern::Windy), 1);
    let marble = NoisePattern::Marble {
        octaves: 8,
        roughness: 0.5,
        scale: 3.0,
        variation: 0.5,
    };
    assert_eq!(noise(marble), 1);
    // Directions turn with the matrix of the moment.
    assert_eq!(
        count(
            &|t| matches!(t, T::DirectionMix { direction, .. } if (*direction - DVec3::Z).length() < 1e-12)
        ),
        1
    );
    assert_eq!(
        count(&|t| matches!(
            t,
            T::Checkerboard {
                map: UvMap::Cylindrical { .. },
                ..
            }
        )),
        1
    );
    assert_eq!(
        count(&|t| matches!(
            t,
            T::Image {
                mip: Some(MipFilter::Trilinear),
                ..
            }
        )),
        1
    );
    assert_eq!(
        count(&|t| matches!(
            t,
            T::Image {
                mip: Some(MipFilter::Ewa {
                    max_anisotropy: 4.0
                }),
                ..
            }
        )),
        1
    );
    assert_eq!(
        count(&|t| matches!(
            t,
            T::Image {
                wrap: (Wrap::Octahedral, Wrap::Octahedral),
                ..
            }
        )),
        1
    );
    // Alpha is made grey before it is mixed with a number, which has none.
    assert_eq!(
        count(&|t| matches!(
            t,
            T::Grey {
                value: FloatTex::Texture(_, Channel::AlphaOrMean)
            }
        )),
        1
    );
    let Some(FloatTex::Texture(id, Channel::R)) = desc.primitives[0].alpha else {
        panic!("{:?}", desc.primitives[0].alpha);
    };
    assert!(matches!(desc.textures[id.index()], T::Mix { .. }));
    for (text, expect) in [
        ("Texture \"x\" \"spectrum\" \"fbm\"", "is a float texture"),
        (
            "Texture \"x\" \"float\" \"marble\"",
            "is a spectrum texture",
        ),
        (
            "Texture \"x\" \"float\" \"fbm\" \"integer octaves\" 1000",
            "from 0 to 64",
        ),
        ("Texture \"x\" \"spectrum\" \"uv\"", "of pbrt-v3"),
        (
            "Texture \"x\" \"float\" \"checkerboard\" \"string mapping\" \"cubic\"",
            "unknown mapping",
        ),
        (
            "Texture \"x\" \"spectrum\" \"directionmix\" \"vector3 dir\" [0 0 0]",
            "no length",
        ),
        (
            "Texture \"x\" \"spectrum\" \"imagemap\" \"string filename\" \"wide.png\" \"string wrap\" \"mirror\"",
            "unknown wrap",
        ),
        (
            "Texture \"x\" \"spectrum\" \"imagemap\" \"string filename\" \"wide.png\" \"string filter\" \"ewa\" \"float maxanisotropy\" 0",
            "anisotropy of 0",
        ),
    ] {
        refused(text, expect);
    }
}

#[test]
fn lights_take_pictures() {
    let text = "WorldBegin
        LightSource \"goniometric\" \"string filename\" \"square.png\" \"rgb I\" [1 2 3] \"float power\" 10 \"float scale\" 2
        LightSource \"projection\" \"string filename\" \"wide.png\" \"float fov\" 40 \"float scale\" 3
        LightSource \"infinite\" \"string filename\" \"square.png\" \"float illuminance\" 7
            \"point3 portal\" [0 0 0 0 1 0 2 1 0 2 0 0]
        LightSource \"infinite\" \"rgb L\" [1 1 1] \"point3 portal\" [0 0 0 0 1 0 2 1 0 2 0 0]
        AreaLightSource \"diffuse\" \"string filename\" \"wide.png\" \"float power\" 6.283185307179586
        Shape \"trianglemesh\" \"point3 P\" [0 0 0 1 0 0 1 1 0] \"integer indices\" [0 1 2]";
    let (desc, warnings) = read(text);
    assert_eq!(warnings, [""; 0]);
    assert!(matches!(
        desc.lights[0],
        Light::Goniometric {
            intensity: [2.0, 4.0, 6.0],
            power: Some(10.0),
            ..
        }
    ));
    assert!(matches!(
        desc.lights[1],
        Light::Projection {
            intensity: [3.0, 3.0, 3.0],
            fov: 40.0,
            power: None,
            ..
        }
    ));
    let corner = DVec3::new(2.0, 1.0, 0.0);
    assert!(matches!(
        desc.lights[2],
        Light::Environment { illuminance: Some(7.0), portal: Some(p), image: Some(_), .. } if p[2] == corner
    ));
    assert!(matches!(
        desc.lights[3],
        Light::Environment {
            illuminance: None,
            portal: Some(_),
            image: None,
            radiance: [1.0, 1.0, 1.0],
            ..
        }
    ));
    // Half a square unit shines on one side: power over pi, area and the mean of the picture.
    let emission = desc.primitives[0].emission.as_ref().unwrap();
    assert!((emission.scale - 4.0).abs() < 1e-5, "{emission:?}");
    let ColorTex::Texture(id) = emission.radiance else {
        panic!("{emission:?}");
    };
    assert!(matches!(
        desc.textures[id.index()],
        Texture::UnitMean { .. }
    ));
    for (text, expect) in [
        (
            "LightSource \"goniometric\" \"string filename\" \"wide.png\"",
            "is square",
        ),
        ("LightSource \"projection\"", "needs a \"filename\""),
        (
            "LightSource \"projection\" \"string filename\" \"wide.png\" \"float fov\" 180",
            "180 degrees",
        ),
        (
            "LightSource \"infinite\" \"point3 portal\" [0 0 0 1 0 0 1 1 0]",
            "3 corners",
        ),
        (
            "LightSource \"infinite\" \"point3 portal\" [0 0 0 1 0 0 2 1 0 0 1 0]",
            "not a rectangle",
        ),
        (
            "LightSource \"infinite\" \"string filename\" \"no.png\"",
            "no.png",
        ),
    ] {
        refused(text, expect);
    }
}

/// What the importer makes of all of this can be written down and read again.
#[test]
fn imported_pictures_and_patterns_survive_a_round_trip() {
    let text = "WorldBegin
        LightSource \"goniometric\" \"string filename\" \"square.png\" \"rgb I\" [1 2 3] \"float power\" 10
        LightSource \"projection\" \"string filename\" \"wide.png\" \"float fov\" 40
        LightSource \"infinite\" \"string filename\" \"square.png\" \"float illuminance\" 7
            \"point3 portal\" [0 0 0 0 1 0 2 1 0 2 0 0]
        Texture \"mip\" \"spectrum\" \"imagemap\" \"string filename\" \"wide.png\" \"string filter\" \"ewa\"
        Texture \"marble\" \"spectrum\" \"marble\"
        AreaLightSource \"diffuse\" \"string filename\" \"wide.png\" \"float power\" 6
        Material \"diffuse\" \"texture reflectance\" \"marble\" Shape \"disk\"";
    let (desc, _) = read(text);
    let assets = source(text);
    let written = crate::native::write(&desc, &assets).unwrap();
    let mut files = assets.with("s.json", written.json).unwrap();
    for (path, bytes) in written.files {
        files.insert(&path, bytes).unwrap();
    }
    let (again, diagnostics) = load("s.json", &files, &Overrides::default()).unwrap();
    assert_eq!(again, desc);
    assert_eq!(diagnostics, []);
}

#[test]
fn a_realistic_camera_becomes_a_thin_lens() {
    let text = "Film \"rgb\" \"integer xresolution\" 300 \"integer yresolution\" 400 \"float diagonal\" 50
        Camera \"realistic\" \"string lensfile\" \"lens.dat\" \"float aperturediameter\" 10 \"float focusdistance\" 2
        WorldBegin LightSource \"infinite\" Shape \"sphere\"";
    let (desc, warnings) = read(text);
    assert!(
        warnings.len() == 1 && warnings[0].contains("thin lens of 50."),
        "{warnings:?}"
    );
    let f: f64 = 1.0 / (0.5 * (2.0 / 50.0 - 0.5 * 5.0 / (1.5 * 2500.0)));
    let image = f * 2000.0 / (2000.0 - f);
    match &desc.camera.projection {
        Projection::Perspective {
            fov, lens: Some(l), ..
        } => {
            // The shorter side of a 3 : 4 film of 50 mm is 30 mm.
            let want = 2.0 * (15.0 / image).atan().to_degrees();
            assert!((fov - want).abs() < 1e-9, "{fov}, {want}");
            assert_eq!((l.radius, l.focus_distance), (0.005, 2.0));
        }
        other => panic!("{other:?}"),
    }
    let opening = std::f64::consts::PI * 25.0 / (image * image);
    assert!((f64::from(desc.film.exposure[0]) - opening).abs() < 1e-6 * opening);
    let camera = |rest: &str| format!("Camera \"realistic\" {rest}\nWorldBegin");
    for (rest, expect) in [
        ("", "needs a \"lensfile\""),
        ("\"string lensfile\" \"wide.png\"", "not text"),
        (
            "\"string lensfile\" \"lens.dat\" \"float focusdistance\" 0.01",
            "cannot focus",
        ),
    ] {
        let error = load("s.pbrt", &source(&camera(rest)), &Overrides::default()).unwrap_err();
        let all: Vec<String> = error.diagnostics.iter().map(|d| d.to_string()).collect();
        assert!(all.iter().any(|d| d.contains(expect)), "{rest}: {all:?}");
    }
}

#[test]
fn white_balance_turns_its_light_white() {
    let text = "Film \"rgb\" \"float whitebalance\" 5000 \"float iso\" 200
        WorldBegin LightSource \"infinite\" Shape \"sphere\"";
    let (desc, warnings) = read(text);
    assert!(warnings[0].contains("channel by channel"), "{warnings:?}");
    let light = crate::color::daylight(5000.0).unwrap();
    for (gain, light) in desc.film.exposure.iter().zip(light) {
        assert!((gain * light - 2.0).abs() < 1e-5, "{gain} {light}");
    }
}

/// A scene with a bit of everything that is newer, for mutations.
const SEED: &str = "Film \"rgb\" \"integer xresolution\" [ 8 ] \"float whitebalance\" 5000
Camera \"realistic\" \"string lensfile\" \"lens.dat\" \"float aperturediameter\" 10
MakeNamedMedium \"fog\" \"string type\" \"uniformgrid\" \"integer nx\" 2 \"float density\" [ 0 1 ] \"float temperature\" [ 1000 2000 ]
WorldBegin
MakeNamedMedium \"ink\" \"string type\" \"homogeneous\" \"string preset\" \"Merlot\" \"rgb Le\" [ 1 1 1 ]
MakeNamedMedium \"smoke\" \"string type\" \"rgbgrid\" \"integer nz\" 2 \"rgb sigma_a\" [ 1 0 0 0 1 0 ]
LightSource \"infinite\" \"string filename\" \"square.png\" \"point3 portal\" [ 0 0 0 0 1 0 2 1 0 2 0 0 ] \"float illuminance\" 3
LightSource \"projection\" \"string filename\" \"wide.png\" \"float fov\" 40
Texture \"m\" \"spectrum\" \"marble\" \"integer octaves\" 3
Texture \"i\" \"float\" \"imagemap\" \"string filename\" \"alpha.png\" \"bool invert\" true \"string filter\" \"ewa\"
Texture \"d\" \"spectrum\" \"directionmix\" \"texture tex1\" \"m\" \"vector3 dir\" [ 0 1 0 ]
Material \"hair\" \"float beta_m\" 0.2 \"rgb sigma_a\" [ 1 2 3 ]
MediumInterface \"fog\" \"ink\"
Shape \"curve\" \"point3 P\" [ 0 0 0 0 1 0 0 2 0 0 3 0 1 3 0 ] \"string basis\" \"bspline\" \"integer degree\" 2
Shape \"curve\" \"string type\" \"ribbon\" \"point3 P\" [ 0 0 0 0 1 0 0 2 0 0 3 0 ] \"normal N\" [ 0 0 1 0 1 0 ]
MediumInterface \"\" \"ink\"
Material \"subsurface\" \"rgb reflectance\" [ 0.5 0.5 0.5 ] \"rgb mfp\" [ 1 1 1 ] \"float eta\" 1.3
AreaLightSource \"diffuse\" \"string filename\" \"wide.png\" \"float power\" 2
Shape \"disk\" \"texture alpha\" \"i\"";

#[test]
fn the_seed_of_the_mutations_is_sound() {
    let (desc, warnings) = read(SEED);
    assert_eq!((desc.media.len(), desc.curves.len()), (4, 2));
    // Lens, white balance, and nothing else.
    assert_eq!(warnings.len(), 2, "{warnings:#?}");
}

/// What is put in the place of a word.
const NASTY: [&str; 24] = [
    "0",
    "-1",
    "1e38",
    "-1e-38",
    "1e308",
    "4294967295",
    "2147483648",
    "0.5",
    "nan",
    "inf",
    "[",
    "]",
    "\"\"",
    "true",
    "\"float x\"",
    "\"integer nx\"",
    "\"rgb L\"",
    "\"texture scale\"",
    "Shape",
    "AttributeBegin",
    "\"point3 P\"",
    "\"m\"",
    "[ ]",
    "#",
];

mod damage {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(500))]
        /// Words are replaced by nasty ones, by other words of the file, dropped or doubled: the file is
        /// read or refused, and what is read has sound numbers.
        #[test]
        fn of_words_never_panics(
            edits in proptest::collection::vec(
                (any::<prop::sample::Index>(), any::<prop::sample::Index>(), 0u8..5),
                1..5,
            ),
        ) {
            // Quoted names with a blank in them count as one word.
            let mut words: Vec<String> = vec![];
            for (i, part) in SEED.split('"').enumerate() {
                if i % 2 == 1 {
                    words.push(format!("\"{part}\""));
                } else {
                    words.extend(part.split_whitespace().map(str::to_owned));
                }
            }
            for (at, other, what) in edits {
                let i = at.index(words.len());
                match what {
                    0 | 1 => words[i] = other.get(&NASTY).to_string(),
                    2 => words[i] = words[other.index(words.len())].clone(),
                    3 => { words.remove(i); }
                    _ => words.insert(i, words[i].clone()),
                }
            }
            let text = words.join(" ");
            let assets = source(&text);
            if let Ok((desc, _)) = load("s.pbrt", &assets, &Overrides::default()) {
                let numbers = desc.media.iter().flat_map(|m| m.sigma_a.into_iter().chain(m.sigma_s));
                for x in numbers {
                    prop_assert!(x.is_finite() && x >= 0.0, "{text}");
                }
            }
        }
    }
}
