//! What pbrt files mean, and what is refused.

use crate::assets::MemorySource;
use crate::model::*;
use crate::{Overrides, load, load_with_files};
use glam::DVec3;
use proptest::prelude::*;

const PLY: &str = "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\n\
    element face 1\nproperty list uchar int vertex_indices\nend_header\n0 0 0 1 0 0 0 1 0 3 0 1 2\n";

fn png(alpha: bool) -> Vec<u8> {
    let mut out = std::io::Cursor::new(Vec::new());
    let picture = if alpha {
        image::DynamicImage::new_rgba8(4, 2)
    } else {
        image::DynamicImage::new_rgb8(4, 2)
    };
    picture.write_to(&mut out, image::ImageFormat::Png).unwrap();
    out.into_inner()
}

fn source(text: &str) -> MemorySource {
    let files: [(&str, &[u8]); 6] = [
        ("t.ply", PLY.as_bytes()),
        ("rgb.png", &png(false)),
        ("rgba.png", &png(true)),
        ("sky.pfm", b"PF 8 8 -1 "),
        ("part.pbrt", b"Translate 1 2 3\n\nShape \"sphere\""),
        ("loop.pbrt", b"\nInclude \"loop.pbrt\""),
    ];
    files
        .iter()
        .fold(MemorySource::new(), |all, (path, bytes)| {
            all.with(path, bytes).unwrap()
        })
        .with("s.pbrt", text)
        .unwrap()
}

/// Reads a file whose world has a light; returns it with its warnings.
fn read(text: &str) -> (SceneDesc, Vec<String>) {
    let (desc, diagnostics) = load("s.pbrt", &source(text), &Overrides::default())
        .unwrap_or_else(|e| panic!("{text}: {e}"));
    (desc, diagnostics.iter().map(|d| d.to_string()).collect())
}

/// What is in the world, under a light.
fn world(text: &str) -> (SceneDesc, Vec<String>) {
    read(&format!("WorldBegin\nLightSource \"infinite\"\n{text}"))
}

#[test]
fn broken_files_are_refused() {
    let check = |text: &str, expect: &str| {
        let error = match load("s.pbrt", &source(text), &Overrides::default()) {
            Ok(_) => panic!("accepted: {text}"),
            Err(error) => error,
        };
        let all: Vec<String> = error.diagnostics.iter().map(|d| d.to_string()).collect();
        assert!(
            all.iter().any(|d| d.contains(expect)),
            "{text}: {all:#?}, expected {expect}"
        );
    };
    check("", "before WorldBegin");
    check("Bogus", "s.pbrt:1: error: unknown directive \"Bogus\"");
    check(
        "\n\nWorldBegn",
        "s.pbrt:3: error: unknown directive \"WorldBegn\"; did you mean \"WorldBegin\"?",
    );
    check(
        "WorldBegin\nWorldEnd",
        "s.pbrt:2: error: WorldEnd is of an older pbrt",
    );
    check("Film \"image\"\nWorldBegin", "pbrt-v4 has \"rgb\"");
    check(
        "WorldBegin\nMaterial \"uber\"",
        "s.pbrt:2: error: unknown material type \"uber\": it is of pbrt-v3",
    );
    check(
        "WorldBegin\nMaterial \"difuse\"",
        "did you mean \"diffuse\"?",
    );
    check(
        "WorldBegin\nMaterial \"metal\"",
        "pbrt-v4 has \"conductor\"",
    );
    check("WorldBegin\nShape \"cone\"", "trianglemesh");
    check(
        "WorldBegin\nShape \"sphere\" \"color L\" [1 1 1]",
        "pbrt-v4 has \"rgb\"",
    );
    check(
        "WorldBegin\nShape \"sphere\" \"float radius\" [1 2]",
        "needs one number, has 2",
    );
    check(
        "WorldBegin\nShape \"sphere\" \"float radius\" [-1]",
        "must be above zero",
    );
    check(
        "WorldBegin\nShape \"sphere\" \"integer radius\" [1]",
        "should be of type float, not integer",
    );
    check(
        "WorldBegin\nShape \"sphere\" \"float radius\" [nan]",
        "is no value",
    );
    check(
        "WorldBegin\nShape \"sphere\" \"float radius\" [1e999]",
        "too large",
    );
    check(
        "WorldBegin\nShape \"sphere\" \"float radius\" [",
        "the file ends",
    );
    check(
        "WorldBegin\nShape \"sphere\" \"float radius\" [1 \"a\"]",
        "values of one type",
    );
    check(
        "WorldBegin\nShape \"sphere\" \"float radius\" 1 \"float radius\" 2",
        "given twice",
    );
    check(
        "WorldBegin\nShape \"sphere\" \"radius\" 1",
        "expected a declaration",
    );
    check("WorldBegin\nShape \"sphere", "a string that does not end");
    check("WorldBegin\nShape sphere", "needs a quoted name");
    check(
        "WorldBegin \"x\"",
        "expected a directive, found the string \"x\"",
    );
    check("WorldBegin \u{1}", "stray bytes");
    check(
        "Shape \"sphere\"\nWorldBegin",
        "Shape belongs after WorldBegin",
    );
    check("WorldBegin\nFilm \"rgb\"", "Film belongs before WorldBegin");
    check(
        "WorldBegin\nAttributeBegin",
        "AttributeBegin without AttributeEnd",
    );
    check(
        "WorldBegin\nAttributeEnd",
        "AttributeEnd without a beginning",
    );
    check(
        "WorldBegin\nAttributeBegin\nObjectBegin \"a\"\nAttributeEnd",
        "the other kind of block, opened at s.pbrt:3",
    );
    check(
        "WorldBegin\nObjectBegin \"a\" ObjectBegin \"b\"",
        "inside another object",
    );
    check(
        "WorldBegin\nObjectBegin \"a\" ObjectInstance \"a\" ObjectEnd",
        "no nested instances",
    );
    check("WorldBegin\nObjectInstance \"a\"", "unknown object \"a\"");
    check(
        "WorldBegin\nNamedMaterial \"a\" Shape \"sphere\"",
        "unknown material \"a\"",
    );
    check(
        "WorldBegin\nMaterial \"diffuse\" \"texture reflectance\" \"x\"",
        "unknown spectrum texture \"x\"",
    );
    check(
        "WorldBegin\nMaterial \"mix\" \"string materials\" [\"a\" \"b\"]",
        "unknown material \"a\" in a mix",
    );
    check(
        "WorldBegin\nMaterial \"diffuse\" \"rgb reflectance\" [1 -1 0]",
        "negative component",
    );
    check(
        "WorldBegin\nMaterial \"diffuse\" \"rgb reflectance\" [1 1]",
        "needs three numbers, has 2",
    );
    check(
        "WorldBegin\nMaterial \"diffuse\" \"spectrum reflectance\" \"metal-Xx-eta\"",
        "unknown spectrum",
    );
    check(
        "WorldBegin\nMaterial \"diffuse\" \"spectrum reflectance\" [500 1 400 1]",
        "do not rise",
    );
    check(
        "WorldBegin\nMaterial \"conductor\" \"rgb eta\" [1 1 1] \"rgb reflectance\" [1 1 1]",
        "not both",
    );
    check("WorldBegin\nScale 0 1 1 Shape \"sphere\"", "singular");
    check("WorldBegin\nRotate 1 0 0 0", "axis of no length");
    check("LookAt 0 0 0 0 0 0 0 1 0\nWorldBegin", "LookAt");
    check(
        "WorldBegin\nTransform [1 2 3]",
        "Transform needs a number, found \"]\"",
    );
    check("WorldBegin\nTransform 1 2 3", "16 numbers in brackets");
    check(
        "WorldBegin\nTransform [0 0 0 1 0 0 0 1 0 0 0 1 0 0 0 1] Shape \"sphere\"",
        "not affine",
    );
    check(
        "WorldBegin\nInclude \"loop.pbrt\"",
        "loop.pbrt:2: error: loop.pbrt includes itself",
    );
    check("WorldBegin\nInclude \"none.pbrt\"", "no such file");
    check(
        "WorldBegin\nInclude \"../x.pbrt\"",
        "leaves the scene's folder",
    );
    check(
        "WorldBegin\nShape \"plymesh\" \"string filename\" \"/t.ply\"",
        "absolute",
    );
    check("WorldBegin\nShape \"plymesh\"", "needs a \"filename\"");
    check(
        "WorldBegin\nShape \"trianglemesh\" \"point3 P\" [0 0 0 1 0 0 0 1 0] \"integer indices\" [0 1 3]",
        "index 3",
    );
    check(
        "WorldBegin\nShape \"trianglemesh\" \"point3 P\" [0 0 0 1 0 0 0 1 0] \"integer indices\" [0 -1 2]",
        "index -1",
    );
    check(
        "WorldBegin\nShape \"trianglemesh\" \"point3 P\" [0 0 0 1 0 0 0 1 0] \"integer indices\" [0 1]",
        "three each",
    );
    check(
        "WorldBegin\nShape \"trianglemesh\" \"point3 P\" [0 0 0 1 0 0 0 1] \"integer indices\" [0 1 2]",
        "multiple of 3",
    );
    check(
        "WorldBegin\nShape \"trianglemesh\" \"point3 P\" [0 0 0 1 0 0 0 1 0] \"normal N\" [0 0 1]",
        "1 of \"N\" for 3",
    );
    check(
        "WorldBegin\nShape \"loopsubdiv\" \"integer levels\" 99",
        "must be from 0 to 10",
    );
    check(
        "WorldBegin\nTexture \"a\" \"color\" \"constant\"",
        "pbrt-v4 has \"spectrum\"",
    );
    check(
        "WorldBegin\nTexture \"a\" \"float\" \"constant\" Texture \"a\" \"float\" \"constant\"",
        "defined twice",
    );
    check(
        "WorldBegin\nTexture \"a\" \"spectrum\" \"imagemap\" \"string filename\" \"t.ply\"",
        "not a picture",
    );
    check(
        "WorldBegin\nLightSource \"infinite\" \"string filename\" \"rgb.png\"",
        "4 x 2 pixels; a picture of the sky is square",
    );
    check(
        "WorldBegin\nLightSource \"infinite\" \"string filename\" \"sky.pfm\" \"rgb L\" [1 1 1]",
        "not both",
    );
    check(
        "WorldBegin\nLightSource \"infinite\" \"string mapname\" \"sky.pfm\"",
        "of pbrt-v3",
    );
    check(
        "WorldBegin\nMakeNamedMaterial \"a\" \"string type\" \"diffuse\" MakeNamedMaterial \"a\" \"string type\" \"diffuse\"",
        "twice",
    );
    check(
        "Film \"rgb\" \"integer xresolution\" 0\nWorldBegin",
        "must be from 1 to 65536",
    );
    check(
        "Film \"rgb\" \"integer xresolution\" 65536 \"integer yresolution\" 65536\nWorldBegin\nShape \"sphere\"",
        "in all",
    );
    check(
        "Camera \"perspective\" \"float fov\" 180\nWorldBegin",
        "field of view",
    );
    check(
        "Camera \"perspective\" \"float shutteropen\" 1\nWorldBegin",
        "does not open",
    );
    check(
        "Sampler \"zsobol\" \"integer pixelsamples\" 0\nWorldBegin",
        "must be from 1",
    );
    check(
        "PixelFilter \"box\" \"float xradius\" 0\nWorldBegin",
        "above zero",
    );
    check("WorldBegin", "nothing to render");
    check(
        &format!("WorldBegin\n{}", "AttributeBegin ".repeat(2000)),
        "nested more than 1024",
    );
    // Errors after which reading can go on are all reported.
    let text = "WorldBegin\nRotate 1 0 0 0\nNamedMaterial \"x\"\nShape \"sphere\"\nShape \"cube\"";
    let error = load("s.pbrt", &source(text), &Overrides::default()).unwrap_err();
    assert_eq!(error.diagnostics.len(), 3, "{:#?}", error.diagnostics);
}

#[test]
fn what_is_not_understood_is_named() {
    let check = |text: &str, expect: &str| {
        let (_, warnings) = world(text);
        assert!(
            warnings.iter().any(|w| w.contains(expect)),
            "{text}: {warnings:#?}"
        );
    };
    check(
        "Shape \"sphere\" \"float bogus\" 1",
        "s.pbrt:3: warning: parameter \"bogus\" of shape \"sphere\"",
    );
    check(
        "Material \"measured\" \"string filename\" \"a.bsdf\" Shape \"sphere\"",
        "\"measured\" (a.bsdf) is not read",
    );
    check(
        "MakeNamedMedium \"m\" \"string type\" \"homogeneous\" \"string preset\" \"Aple\" Shape \"sphere\"",
        "unknown preset \"Aple\"; did you mean \"Apple\"?",
    );
    check(
        "Material \"hair\" \"rgb sigma_a\" [1 1 1] \"float eumelanin\" 1 Shape \"sphere\"",
        "several ways",
    );
    check(
        "Material \"diffuse\" \"rgb reflectance\" [2 0 0] Shape \"sphere\"",
        "cut to 1",
    );
    check(
        "Material \"dielectric\" \"spectrum eta\" \"glass-BK7\" Shape \"sphere\"",
        "without dispersion",
    );
    check(
        "Texture \"a\" \"float\" \"ptex\" Shape \"sphere\"",
        "\"ptex\" is not supported",
    );
    check(
        "LightSource \"goniometric\" Shape \"sphere\"",
        "shines equally in all directions",
    );
    check("ColorSpace \"rec2020\" Shape \"sphere\"", "converted");
    check("Option \"seed\" 3 Shape \"sphere\"", "Option");
    check("Shape \"cylinder\"", "becomes triangles");
    check(
        "Shape \"trianglemesh\" \"point3 P\" [0 0 0 1 0 0 2 0 0]",
        "1 triangles without area",
    );
    assert_eq!(world("Shape \"sphere\"").1, [""; 0]);
    assert!(read("WorldBegin Shape \"sphere\"").1[0].contains("nothing shines"));
}

#[test]
fn the_frame_has_pbrts_defaults() {
    let (desc, _) = world("Shape \"sphere\"");
    let film = &desc.film;
    assert_eq!(
        (film.width, film.height, film.exposure, film.crop),
        (1280, 720, [1.0; 3], None)
    );
    assert_eq!(
        film.filter,
        Filter::Gaussian {
            radius: (1.5, 1.5),
            sigma: 0.5
        }
    );
    assert_eq!(
        (desc.integrator, desc.spp),
        (Integrator::Path { max_depth: 5 }, Some(16))
    );
    assert_eq!(
        desc.camera.projection,
        Projection::Perspective {
            fov: 90.0,
            fov_axis: FovAxis::Shorter,
            window: None,
            lens: None
        }
    );
    let text = "Film \"rgb\" \"float iso\" 200 \"float cropwindow\" [0.25 0.5 0 1]\nCamera \"perspective\" \"float shutterclose\" 0.5
        \"float lensradius\" 0.1 \"float focaldistance\" 3 \"float screenwindow\" [-1 1 -2 2]
        Sampler \"stratified\" \"integer xsamples\" 3 \"integer ysamples\" 5
        Integrator \"bdpt\" \"integer maxdepth\" 7\nWorldBegin\nShape \"sphere\"";
    let (desc, _) = read(text);
    assert_eq!(
        (desc.film.exposure, desc.film.crop),
        ([1.0; 3], Some([320, 0, 640, 720]))
    );
    assert_eq!(
        (desc.sampler, desc.spp),
        (SamplerKind::Stratified, Some(15))
    );
    assert_eq!(desc.integrator, Integrator::Path { max_depth: 7 });
    match desc.camera.projection {
        Projection::Perspective {
            window: Some(w),
            lens: Some(l),
            ..
        } => {
            assert_eq!(
                (w.x, w.y, l.radius, l.focus_distance),
                ((-1.0, 1.0), (-2.0, 2.0), 0.1, 3.0)
            );
        }
        other => panic!("{other:?}"),
    }
}

#[test]
fn the_camera_looks_where_pbrts_does() {
    // Right-handed world, Z up, as exporters write it: the picture must not be mirrored.
    let (desc, _) = read(
        "Scale -1 1 1\nLookAt 0 -5 0 0 0 0 0 0 1\nCamera \"perspective\"\nWorldBegin\nShape \"sphere\"",
    );
    let m = desc.camera.transform.keys[0].transform;
    let near = |a: DVec3, b: DVec3| assert!((a - b).length() < 1e-12, "{a} {b}");
    near(m.translation, DVec3::new(0.0, -5.0, 0.0));
    near(m.transform_vector3(DVec3::NEG_Z), DVec3::Y);
    near(m.transform_vector3(DVec3::Y), DVec3::Z);
    near(m.transform_vector3(DVec3::X), DVec3::X);
    // Without it pbrt's picture of the same view is mirrored.
    let (desc, _) =
        read("LookAt 0 -5 0 0 0 0 0 0 1\nCamera \"perspective\"\nWorldBegin\nShape \"sphere\"");
    near(
        desc.camera.transform.keys[0]
            .transform
            .transform_vector3(DVec3::X),
        DVec3::NEG_X,
    );
    // Numbers come column by column.
    let (desc, _) = read(
        "Transform [1 0 0 0 0 1 0 0 0 0 -1 0 0 -1 6.8 1]\nCamera \"perspective\"\nWorldBegin\nShape \"sphere\"",
    );
    let m = desc.camera.transform.keys[0].transform;
    near(m.translation, DVec3::new(0.0, 1.0, 6.8));
    near(m.transform_vector3(DVec3::NEG_Z), DVec3::NEG_Z);
}

#[test]
fn transforms_multiply_from_the_right_and_move() {
    let (desc, _) = world("Translate 1 0 0 Rotate 90 0 0 1 Scale 2 2 2 Shape \"sphere\"");
    let m = desc.primitives[0].transform.keys[0].transform;
    assert!((m.transform_point3(DVec3::X) - DVec3::new(1.0, 2.0, 0.0)).length() < 1e-12);
    let text = "TransformTimes 0.25 0.75\nWorldBegin\nLightSource \"infinite\"\nAttributeBegin\nActiveTransform EndTime
        Translate 0 0 3\nActiveTransform All\nShape \"sphere\"\nAttributeEnd\nShape \"sphere\"";
    let (desc, _) = read(text);
    let keys = &desc.primitives[0].transform.keys;
    assert_eq!(
        keys.iter()
            .map(|k| (k.time, k.transform.translation.z))
            .collect::<Vec<_>>(),
        [(0.25, 0.0), (0.75, 3.0)]
    );
    assert!(!desc.primitives[1].transform.is_moving());
}

#[test]
fn objects_become_groups() {
    let text = "Translate 5 0 0\nObjectBegin \"a\"\nTranslate 0 1 0\nShape \"sphere\"\nAreaLightSource \"diffuse\"\nShape \"disk\"
        ObjectEnd\nTranslate 0 0 9\nObjectInstance \"a\"\nObjectInstance \"a\"";
    let (desc, warnings) = world(text);
    assert_eq!(
        (
            desc.groups.len(),
            desc.instances.len(),
            desc.primitives.len()
        ),
        (1, 2, 0)
    );
    assert_eq!(
        desc.groups[0].primitives[0].transform.keys[0]
            .transform
            .translation,
        DVec3::new(5.0, 1.0, 0.0)
    );
    assert_eq!(
        desc.instances[0].transform.keys[0].transform.translation,
        DVec3::new(5.0, 0.0, 9.0)
    );
    assert!(
        desc.groups[0]
            .primitives
            .iter()
            .all(|p| p.emission.is_none())
    );
    assert!(warnings[0].contains("area lights inside an object"));
}

#[test]
fn included_files_share_the_state_and_imported_ones_do_not() {
    let (desc, _) = world(
        "Include \"part.pbrt\"\nShape \"sphere\"\nIdentity\nImport \"part.pbrt\"\nShape \"sphere\"",
    );
    let x: Vec<f64> = desc
        .primitives
        .iter()
        .map(|p| p.transform.keys[0].transform.translation.x)
        .collect();
    assert_eq!(x, [1.0, 1.0, 1.0, 0.0]);
    let text = "WorldBegin Include \"part.pbrt\" LightSource \"infinite\" \"string filename\" \"sky.pfm\"
        Texture \"a\" \"float\" \"imagemap\" \"string filename\" \"rgb.png\" Shape \"plymesh\" \"string filename\" \"./t.ply\"";
    let loaded = load_with_files("s.pbrt", &source(text), &Overrides::default()).unwrap();
    let files: Vec<&str> = loaded.files.iter().map(String::as_str).collect();
    assert_eq!(
        files,
        ["part.pbrt", "rgb.png", "s.pbrt", "sky.pfm", "t.ply"]
    );
}

#[test]
fn lights_have_pbrts_levels() {
    let light = |text: &str| world(text).0.lights.pop().unwrap();
    let close = |a: Rgb, b: Rgb| {
        assert!(
            a.iter()
                .zip(b)
                .all(|(a, b)| (a - b).abs() < 1e-5 * b.abs().max(1.0)),
            "{a:?} {b:?}"
        )
    };
    match light(
        "LightSource \"point\" \"rgb I\" [1 2 3] \"float scale\" 2 \"point3 from\" [1 0 0] Shape \"sphere\"",
    ) {
        Light::Point {
            transform,
            intensity,
        } => {
            assert_eq!(
                (transform.translation, intensity),
                (DVec3::X, [2.0, 4.0, 6.0])
            );
        }
        other => panic!("{other:?}"),
    }
    match light("LightSource \"point\" \"float power\" 12.566370614359172 Shape \"sphere\"") {
        Light::Point { intensity, .. } => close(intensity, [1.0; 3]),
        other => panic!("{other:?}"),
    }
    match light(
        "Rotate 90 1 0 0 LightSource \"distant\" \"point3 from\" [0 0 1] \"point3 to\" [0 0 0] \"float illuminance\" 3 Shape \"sphere\"",
    ) {
        Light::Distant {
            direction,
            irradiance,
        } => {
            assert!((direction - DVec3::Y).length() < 1e-12, "{direction}");
            assert_eq!(irradiance, [3.0; 3]);
        }
        other => panic!("{other:?}"),
    }
    match light(
        "LightSource \"spot\" \"point3 from\" [1 1 1] \"point3 to\" [1 1 0] \"blackbody I\" 6500 Shape \"sphere\"",
    ) {
        Light::Spot {
            transform,
            intensity,
            cone_angle,
            full_angle,
            ..
        } => {
            assert!((transform.transform_vector3(DVec3::Z) - DVec3::NEG_Z).length() < 1e-12);
            assert_eq!((cone_angle, full_angle), (30.0, 25.0));
            assert!((crate::color::luminance(intensity) - 1.0).abs() < 1e-5);
        }
        other => panic!("{other:?}"),
    }
    // Two equal triangles, each with its own light of that power in pbrt.
    let square = "\"point3 P\" [0 0 0 1 0 0 1 1 0 0 1 0] \"integer indices\" [0 1 2 0 2 3]";
    let (desc, _) = world(&format!(
        "AreaLightSource \"diffuse\" \"float power\" 3.141592653589793 Shape \"trianglemesh\" {square}"
    ));
    let emission = desc.primitives[0].emission.as_ref().unwrap();
    assert!(
        (emission.scale - 2.0).abs() < 1e-6 && !emission.two_sided,
        "{emission:?}"
    );
}

#[test]
fn materials_and_textures_are_mapped() {
    let text = "Texture \"f\" \"float\" \"imagemap\" \"string filename\" \"rgba.png\" \"bool invert\" true \"float scale\" 0.5
        Texture \"c\" \"spectrum\" \"imagemap\" \"string filename\" \"rgb.png\" \"string encoding\" \"linear\" \"float uscale\" 3
        Texture \"s\" \"spectrum\" \"scale\" \"texture tex\" \"c\" \"texture scale\" \"f\"
        Texture \"k\" \"float\" \"constant\" \"float value\" 0.25
        NamedMaterial \"later\" Shape \"sphere\" \"texture alpha\" \"f\"
        MakeNamedMaterial \"later\" \"string type\" \"coateddiffuse\" \"texture reflectance\" \"s\" \"texture roughness\" \"k\"
        \"texture displacement\" \"f\" \"string normalmap\" \"rgb.png\"
        Material \"conductor\" \"spectrum eta\" \"metal-Au-eta\" \"spectrum k\" \"metal-Au-k\" \"float vroughness\" 0.3
        \"bool remaproughness\" false Shape \"sphere\"";
    let (desc, warnings) = world(text);
    assert_eq!(warnings, [""; 0]);
    let later = &desc.materials[desc.primitives[0].material.index()];
    assert_eq!(later.name, "later");
    match &later.bsdf {
        BsdfDesc::CoatedDiffuse {
            reflectance: ColorTex::Texture(id),
            coat,
        } => {
            assert!(matches!(
                desc.textures[id.index()],
                Texture::Scale {
                    b: FloatOrColor::Float(FloatTex::Texture(TextureId(1), Channel::R)),
                    ..
                }
            ));
            assert_eq!(coat.roughness.u, FloatTex::Const(0.25));
            assert_eq!(
                (coat.ior, coat.thickness, coat.max_depth, coat.samples),
                (1.5, 0.01, 10, 1)
            );
            assert_eq!(coat.roughness.scale, RoughnessScale::Sqrt);
        }
        other => panic!("{other:?}"),
    }
    assert!(later.bump_map.is_some() && later.normal_map.is_some());
    assert_eq!(
        desc.primitives[0].alpha,
        Some(FloatTex::Texture(TextureId(1), Channel::R))
    );
    let mix = Texture::Mix {
        a: ColorTex::Const([1.0; 3]),
        b: ColorTex::Const([0.0; 3]),
        amount: FloatTex::Texture(TextureId(0), Channel::AlphaOrMean),
    };
    assert_eq!(desc.textures[1], mix, "1 - s v");
    assert_eq!(
        desc.images.iter().map(|i| i.encoding).collect::<Vec<_>>(),
        [Encoding::Auto, Encoding::Linear]
    );
    match &desc.materials[desc.primitives[1].material.index()].bsdf {
        BsdfDesc::Conductor {
            fresnel: ConductorFresnel::EtaK { .. },
            roughness,
        } => {
            assert_eq!(
                (roughness.u, roughness.v, roughness.scale),
                (
                    FloatTex::Const(0.0),
                    FloatTex::Const(0.3),
                    RoughnessScale::Alpha
                )
            );
        }
        other => panic!("{other:?}"),
    }
}

#[test]
fn tessellated_shapes_point_outwards() {
    let text = "Shape \"sphere\" \"float zmin\" -0.5\nShape \"cylinder\"\nShape \"disk\" \"float phimax\" 90
        Shape \"bilinearmesh\" \"point3 P\" [0 0 0 1 0 0 0 1 0 1 1 0.5]\nShape \"bilinearmesh\" \"point3 P\" [0 0 0 1 0 0 0 1 0 1 1 0]";
    let (desc, _) = world(text);
    assert_eq!(desc.meshes.len(), 5);
    for (mesh, outside) in desc.meshes.iter().zip([true, true, false, false, false]) {
        for t in mesh.indices.iter() {
            let [a, b, c] = t.map(|i| DVec3::from_array(mesh.positions[i as usize].map(f64::from)));
            let n = (b - a).cross(c - a);
            let middle = (a + b + c) / 3.0;
            let want = if outside {
                DVec3::new(
                    middle.x,
                    middle.y,
                    if mesh.name.contains("sphere") {
                        middle.z
                    } else {
                        0.0
                    },
                )
            } else {
                DVec3::Z
            };
            assert!(n.dot(want) > 0.0, "{}: {n} {middle}", mesh.name);
            if !mesh.normals.is_empty() {
                let shading = DVec3::from_array(mesh.normals[t[0] as usize].map(f64::from));
                assert!(shading.dot(n) > 0.0, "{}", mesh.name);
            }
        }
    }
    assert_eq!(desc.meshes[4].indices.len(), 2);
}

const SEED: &str = "Scale -1 1 1 LookAt 0 -5 0 0 0 0 0 0 1\nFilm \"rgb\" \"integer xresolution\" [4]\nWorldBegin # c\n\
    AttributeBegin Transform [1 0 0 0 0 1 0 0 0 0 1 0 0 0 0 1]\nTexture \"a\" \"float\" \"imagemap\" \"string filename\" \
    \"rgb.png\"\nMaterial \"coateddiffuse\" \"texture roughness\" \"a\" \"rgb reflectance\" [.5 .5 1e-1]\nAreaLightSource \
    \"diffuse\" \"blackbody L\" 3000 \"float power\" 2 Shape \"trianglemesh\" \"point3 P\" [0 0 0 1 0 0 0 1 0] \"integer \
    indices\" [0 1 2] \"bool x\" true AttributeEnd ObjectBegin \"o\" Include \"part.pbrt\" Shape \"loopsubdiv\" \"integer \
    levels\" 1 \"point3 P\" [0 0 0 1 0 0 0 1 0] \"integer indices\" [0 1 2] ObjectEnd ObjectInstance \"o\" Shape \"disk\"";

#[test]
fn the_seed_of_the_mutations_is_sound() {
    read(SEED);
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(400))]
    #[test]
    fn damage_never_panics(edits in proptest::collection::vec((0usize..SEED.len(), any::<u8>(), 0u8..3), 1..4)) {
        let mut bytes = SEED.as_bytes().to_vec();
        for (at, byte, what) in edits {
            let at = at % bytes.len();
            match what {
                0 => bytes[at] = byte,
                1 => { bytes.remove(at); }
                _ => bytes.insert(at, byte),
            }
        }
        let mut assets = source("");
        assets.insert("s.pbrt", bytes).unwrap();
        let _ = load("s.pbrt", &assets, &Overrides::default());
    }
}

/// No file includes itself, but each level has twice the work of the one below.
#[test]
fn files_that_double_at_every_level_are_refused() {
    let mut files = MemorySource::new();
    for level in 0..40 {
        let twice = format!("Include \"{0}.pbrt\"\nInclude \"{0}.pbrt\"\n", level + 1);
        files
            .insert(&format!("{level}.pbrt"), twice.into_bytes())
            .unwrap();
    }
    files.insert("40.pbrt", Vec::new()).unwrap();
    let error = load("0.pbrt", &files, &Overrides::default()).unwrap_err();
    let said = error.to_string();
    assert!(
        said.contains("more files included than the limit of 10000"),
        "{said}"
    );
}
