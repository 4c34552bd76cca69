//! What OBJ and MTL files mean, and what is refused.

use crate::assets::MemorySource;
use crate::model::*;
use crate::{Overrides, load};

pub(in crate::import) const MTL: &str = "# a comment
newmtl wall
Kd 0.5 0.25 0.125
Ka 1 1 1
Ns 98
Ks 0 0 0
illum 1
newmtl glass
illum 7
Ni 1.33
Tf 0.9 1 0.9
newmtl metal
Pr 0.25
Pm 1
Pc 0.5
Pcr 0.125
Ke 1 2 3
map_Kd -s 2 3 1 -o 0.5 0 0 -clamp on my picture.png
norm -bm 0.5 my picture.png
newmtl leaf
d 0.5
map_d my picture.png
";

fn files(obj: &str, mtl: &str) -> MemorySource {
    let mut png = std::io::Cursor::new(Vec::new());
    image::RgbImage::new(1, 1)
        .write_to(&mut png, image::ImageFormat::Png)
        .unwrap();
    MemorySource::new()
        .with("d/m.obj", obj)
        .unwrap()
        .with("d/m.mtl", mtl)
        .unwrap()
        .with("d/my picture.png", png.get_ref())
        .unwrap()
}

pub(in crate::import) const OBJ: &str = "mtllib m.mtl
v 0 0 0
v 1 0 0
v 1 1 0
v 0 1 0 \\
 1
vt 0 0
vt 1 0
vt 1 1
vn 0 0 1
usemtl wall
f 1 2 3 4
usemtl metal
f -4/1/1 -3/2/1 -2/3/1
usemtl glass
f 1//1 2//1 3//1
usemtl leaf
f 1/1 2/2 3/3
usemtl wall
f 1 3 4
";

#[test]
fn faces_are_grouped_by_material() {
    let source = files(OBJ, MTL);
    let loaded = crate::load_with_files("d/m.obj", &source, &Overrides::default()).unwrap();
    assert_eq!(
        loaded.files.iter().collect::<Vec<_>>(),
        ["d/m.mtl", "d/m.obj", "d/my picture.png"]
    );
    let said: Vec<String> = loaded.diagnostics.iter().map(ToString::to_string).collect();
    assert!(said.is_empty(), "{said:?}");
    let desc = loaded.desc;
    let names: Vec<&str> = desc.materials.iter().map(|m| m.name.as_str()).collect();
    assert_eq!(names, ["glass", "leaf", "metal", "wall"]);
    let mesh = |i: usize| match desc.primitives[i].shape {
        Shape::Mesh(id) => &desc.meshes[id.index()],
        ref other => panic!("{other:?}"),
    };
    assert_eq!((mesh(0).normals.len(), mesh(0).uvs.len()), (3, 0));
    // The quad and the triangle share their corners.
    assert_eq!(*mesh(3).indices, [[0, 1, 2], [0, 2, 3], [0, 2, 3]]);
    assert_eq!(mesh(3).positions.len(), 4);
    assert_eq!(mesh(2).tangents.len(), 3);
    let surface = |i: usize| match &desc.materials[i].bsdf {
        BsdfDesc::Principled(p) => p,
        other => panic!("{other:?}"),
    };
    let number = FloatTex::Const;
    let glass = surface(0);
    assert_eq!(
        (glass.transmission, glass.ior, glass.thin),
        (number(1.0), 1.33, false)
    );
    assert_eq!(glass.base_color, ColorTex::Const([0.9, 1.0, 0.9]));
    let leaf = desc.primitives[1].alpha;
    assert!(
        matches!(leaf, Some(FloatTex::Texture(_, Channel::R))),
        "{leaf:?}"
    );
    let metal = surface(2);
    assert_eq!(
        (metal.metallic, metal.roughness),
        (number(1.0), number(0.25))
    );
    assert_eq!(
        (metal.coat, metal.coat_roughness),
        (number(0.5), number(0.125))
    );
    let ColorTex::Texture(id) = metal.base_color else {
        panic!()
    };
    let Texture::Image { map, wrap, .. } = &desc.textures[id.index()] else {
        panic!()
    };
    assert_eq!(
        *map,
        UvMap::Uv {
            set: 0,
            matrix: [2.0, 0.0, 0.5, 0.0, 3.0, 0.0]
        }
    );
    assert_eq!(*wrap, (Wrap::Clamp, Wrap::Clamp));
    assert_eq!(desc.materials[2].normal_map.map(|(_, s)| s), Some(0.5));
    let emission = desc.primitives[2].emission.as_ref().unwrap();
    assert_eq!(emission.radiance, ColorTex::Const([1.0, 2.0, 3.0]));
    let wall = surface(3);
    assert_eq!(
        (wall.specular, wall.base_color),
        (number(0.0), ColorTex::Const([0.5, 0.25, 0.125]))
    );
    let FloatTex::Const(r) = wall.roughness else {
        panic!()
    };
    // alpha^2 = 2 / 100, alpha = r^2.
    assert!((r * r * r * r - 0.02).abs() < 1e-6);
}

#[test]
fn broken_files_are_refused_and_odd_ones_named() {
    let check = |obj: &str, mtl: &str, expect: &str| {
        let found = match load("d/m.obj", &files(obj, mtl), &Overrides::default()) {
            Ok((_, said)) => said,
            Err(error) => error.diagnostics,
        };
        let all: Vec<String> = found.iter().map(ToString::to_string).collect();
        assert!(
            all.iter().any(|d| d.contains(expect)),
            "{all:#?}, expected {expect}"
        );
    };
    let face = "v 0 0 0\nv 1 0 0\nv 0 1 0\n";
    let with = |line: &str| format!("{face}{line}\nf 1 2 3\n");
    check("", MTL, "d/m.obj: error: the file has no faces");
    check(
        &with("v 1 x 0"),
        MTL,
        "d/m.obj:4: error: \"x\" is no finite number",
    );
    check(&with("v 1 nan 0"), MTL, "no finite number");
    check(&with("v 1 1e999 0"), MTL, "no finite number");
    check(
        &with("v 1 2"),
        MTL,
        "d/m.obj:4: error: expected 3 numbers, found 2",
    );
    check(&with("f 1 2"), MTL, "a face of 2 corners");
    check(
        &with("f 1 2 4"),
        MTL,
        "index 4, but there are 3 positions so far",
    );
    check(&with("f 1 2 -4"), MTL, "index -4");
    check(&with("f 1 2 0"), MTL, "index 0");
    check(&with("f 1 2 99999999999999999999"), MTL, "is no index");
    check(
        &with("f 1/1 2/1 3/1"),
        MTL,
        "index 1, but there are 0 texture coordinates so far",
    );
    check(&with("f / / /"), MTL, "is no corner of a face");
    check(
        &with("curv2 1 2"),
        MTL,
        "d/m.obj:4: warning: unknown statement \"curv2\"",
    );
    check(
        &with("l 1 2"),
        MTL,
        "d/m.obj:4: warning: lines and points have no surface",
    );
    check(&with("s 1"), MTL, "warning: smoothing groups are not used");
    check(&with("usemtl wal"), MTL, "no material \"wal\"");
    check(
        &with("mtllib m.mtl\nusemtl wal"),
        MTL,
        "did you mean \"wall\"?",
    );
    check(
        &with("mtllib no.mtl"),
        MTL,
        "d/m.obj:4: error: d/no.mtl: no such file",
    );
    check(
        &with("mtllib sub\\no.mtl"),
        MTL,
        "d/m.obj:4: error: d/sub/no.mtl: no such file",
    );
    check(
        &with("mtllib m.mtl\nusemtl a"),
        "newmtl a\nmap_Kd -colorspace sRGB my picture.png",
        "the option -colorspace of a picture is not used",
    );
    check(
        &with("mtllib ../../x.mtl"),
        MTL,
        "leaves the scene's folder",
    );
    let library = "mtllib m.mtl\nusemtl a";
    check(
        &with(library),
        "Kd 1 1 1",
        "d/m.mtl:1: error: \"Kd\" before the first newmtl",
    );
    check(
        &with(library),
        "newmtl a\nnewmtl a",
        "d/m.mtl:2: error: material \"a\" is there twice",
    );
    check(
        &with(library),
        "newmtl a\nKd 1 1",
        "d/m.mtl:2: error: Kd with 2 numbers",
    );
    check(
        &with(library),
        "newmtl a\nKd red",
        "\"red\" is no finite number",
    );
    check(
        &with(library),
        "newmtl a\nPm 2",
        "d/m.mtl:1: warning: Pm is 2, out of range; 1 is used",
    );
    check(&with(library), "newmtl a\nKq 2", "\"Kq\" is not used");
    check(
        &with(library),
        "newmtl a\nTr 1",
        "d/m.mtl:1: warning: material \"a\" has Tr 1, which means invisible: shown solid",
    );
    check(
        &with(library),
        "newmtl a\nKd spectral x.rfl",
        "only RGB is read",
    );
    check(
        &with(library),
        "newmtl a\nmap_Kd no.png",
        "d/m.mtl:2: error: d/no.png: no such file",
    );
    check(
        &with(library),
        "newmtl a\nmap_Kd -bm",
        "-bm without its values",
    );
    check(
        &with(library),
        "newmtl a\nmap_Kd -foo 1 x.png",
        "unknown option \"-foo\"",
    );
    check(&with(library), "newmtl a\nmap_Kd -s 1 2 3", "no file name");
    check(
        &with(library),
        "newmtl a\nbump my picture.png",
        "heights of bump maps have no unit",
    );
}

/// Old programs wrote names and comments in the encoding of their country.
#[test]
fn names_in_latin_1_are_read() {
    let obj = b"# caf\xe9\nmtllib m.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nusemtl d\xe6k\nf 1 2 3\n";
    let mtl = b"newmtl d\xe6k\nKd 1 0 0\n";
    let source = MemorySource::new()
        .with("m.obj", obj)
        .unwrap()
        .with("m.mtl", mtl)
        .unwrap();
    let (desc, said) = load("m.obj", &source, &Overrides::default()).unwrap();
    assert_eq!(desc.materials[0].name, "d\u{e6}k");
    let said: Vec<String> = said.iter().map(ToString::to_string).collect();
    let about = |file: &str| said.iter().filter(|s| s.starts_with(file)).count();
    assert_eq!((about("m.obj:6"), about("m.mtl:1")), (1, 1), "{said:?}");
    // Two bytes a character.
    let wide: Vec<u8> = "v 0 0 0\n"
        .encode_utf16()
        .flat_map(u16::to_be_bytes)
        .collect();
    let source = MemorySource::new().with("m.obj", wide).unwrap();
    let error = load("m.obj", &source, &Overrides::default()).unwrap_err();
    assert!(
        error.to_string().contains("m.obj:1: a zero byte"),
        "{error}"
    );
}

#[test]
fn a_ply_file_is_a_scene() {
    let text = "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\n\
                element face 1\nproperty list uchar int vertex_indices\nend_header\n0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n";
    let source = MemorySource::new().with("m.ply", text).unwrap();
    let (desc, said) = load("m.ply", &source, &Overrides::default()).unwrap();
    assert_eq!(
        (desc.primitives.len(), desc.lights.len(), said.len()),
        (1, 1, 1)
    );
    assert!(desc.camera.transform.keys[0].transform.translation.z > 0.0);
    let named = Overrides {
        look: crate::Look {
            camera: Some("x".into()),
            ..crate::Look::default()
        },
        ..Overrides::default()
    };
    let error = load("m.ply", &source, &named).unwrap_err().to_string();
    assert!(error.contains("no camera \"x\""), "{error}");
}

/// `d` is meant, and so is glass; `Tr 1` of a plain surface is not.
#[test]
fn what_is_wholly_transparent() {
    let alpha = |mtl: &str| {
        let obj = "mtllib m.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nusemtl a\nf 1 2 3\n";
        let mtl = format!("newmtl a\n{mtl}\n");
        let (desc, _) = load("d/m.obj", &files(obj, &mtl), &Overrides::default()).unwrap();
        desc.primitives[0].alpha
    };
    assert_eq!(alpha("Tr 1"), None);
    assert_eq!(alpha("Tr 1\nillum 4"), None);
    assert_eq!(alpha("Tr 0.75"), Some(FloatTex::Const(0.25)));
    assert_eq!(alpha("d 0\nTr 1"), Some(FloatTex::Const(0.0)));
}

/// Scans have their colours at the vertices.
#[test]
fn a_ply_file_keeps_its_colours() {
    let text = "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\n\
                property uchar red\nproperty uchar green\nproperty uchar blue\nelement face 1\n\
                property list uchar int vertex_indices\nend_header\n0 0 0 255 0 0\n1 0 0 0 255 0\n0 1 0 0 0 188\n3 0 1 2\n";
    let source = MemorySource::new().with("m.ply", text).unwrap();
    let (desc, _) = load("m.ply", &source, &Overrides::default()).unwrap();
    let BsdfDesc::Principled(p) = &desc.materials[0].bsdf else {
        panic!("{:?}", desc.materials[0])
    };
    let ColorTex::Texture(id) = p.base_color else {
        panic!("{:?}", p.base_color)
    };
    assert_eq!(desc.textures[id.index()], Texture::VertexColor);
    let colors = &desc.meshes[0].colors;
    assert_eq!(colors[..2], [[1.0, 0.0, 0.0, 1.0], [0.0, 1.0, 0.0, 1.0]]);
    // sRGB 188 is half of the light.
    assert!((colors[2][2] - 0.5).abs() < 5e-3, "{colors:?}");
}
