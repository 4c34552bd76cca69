//! Accessors, modes, vertices, containers.

use super::*;

#[test]
fn one_triangle_in_every_container() {
    let model = Model::triangle();
    let first = model.fine();
    let m = mesh(&first);
    assert_eq!(*m.positions, [[0.0; 3], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]]);
    assert_eq!(*m.indices, [[0, 1, 2]]);
    // v is turned round: (0, 0) is the bottom left here.
    assert_eq!(*m.uvs[0], [[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]]);
    let mut json = model.json.clone();
    json["buffers"] = json!([{"byteLength": model.bytes.len(), "uri": "a%20b.bin"}]);
    let files = MemorySource::new()
        .with("x/m.gltf", json.to_string())
        .unwrap()
        .with("x/a b.bin", &model.bytes)
        .unwrap()
        .with("m.glb", model.glb())
        .unwrap();
    let loaded = crate::load_with_files("x/m.gltf", &files, &Overrides::default()).unwrap();
    assert_eq!(
        loaded.files.iter().collect::<Vec<_>>(),
        ["x/a b.bin", "x/m.gltf"]
    );
    let (glb, _) = load("m.glb", &files, &Overrides::default()).unwrap();
    for desc in [loaded.desc, glb] {
        assert_eq!(mesh(&desc).positions, m.positions);
        assert_eq!(mesh(&desc).uvs, m.uvs);
    }
}

#[test]
fn integers_are_fractions_where_the_file_says_so() {
    // Type, bytes of three pairs, what becomes of them if normalized.
    let check = |component: u32, normalized: bool, bytes: &[u8], expect: [[f32; 2]; 3]| {
        let mut m = Model::triangle();
        let index = m.attribute("TEXCOORD_0", "VEC2", component, 3, bytes);
        let m = m.with(&format!("/accessors/{index}/normalized"), normalized.into());
        let desc = m.fine();
        let turned = expect.map(|[u, v]| [u, 1.0 - v]);
        assert_eq!(*mesh(&desc).uvs[0], turned, "{component} {normalized}");
    };
    check(
        5121,
        true,
        &[0, 255, 255, 0, 51, 0],
        [[0.0, 1.0], [1.0, 0.0], [0.2, 0.0]],
    );
    check(
        5121,
        false,
        &[0, 2, 1, 0, 3, 0],
        [[0.0, 2.0], [1.0, 0.0], [3.0, 0.0]],
    );
    check(
        5120,
        true,
        &[0, 127, 0x81, 0x80, 0, 0],
        [[0.0, 1.0], [-1.0, -1.0], [0.0, 0.0]],
    );
    let shorts: Vec<u8> = [0u16, 65_535, 13_107, 0, 0, 0]
        .iter()
        .flat_map(|x| x.to_le_bytes())
        .collect();
    check(5123, true, &shorts, [[0.0, 1.0], [0.2, 0.0], [0.0, 0.0]]);
    let signed: Vec<u8> = [0i16, 32_767, -32_768, 0, 0, 0]
        .iter()
        .flat_map(|x| x.to_le_bytes())
        .collect();
    check(5122, true, &signed, [[0.0, 1.0], [-1.0, 0.0], [0.0, 0.0]]);
}

#[test]
fn strides_and_sparse_accessors() {
    let mut m = Model::triangle();
    // Positions 16 bytes apart, from byte 4 on.
    let wide = floats(&[9.0, 0.0, 0.0, 0.0, 9.0, 2.0, 0.0, 0.0, 9.0, 0.0, 3.0, 0.0]);
    let index = m.attribute("POSITION", "VEC3", 5126, 3, &wide);
    let view = m.json["accessors"][index]["bufferView"].as_u64().unwrap();
    let m = m
        .with(&format!("/bufferViews/{view}/byteStride"), 16.into())
        .with(&format!("/accessors/{index}/byteOffset"), 4.into());
    assert_eq!(
        *mesh(&m.fine()).positions,
        [[0.0; 3], [2.0, 0.0, 0.0], [0.0, 3.0, 0.0]]
    );
    // All zero but two elements.
    let mut m = Model::triangle();
    let places = m.view(&[1, 2]);
    let values = m.view(&floats(&[4.0, 0.0, 0.0, 0.0, 5.0, 0.0]));
    let sparse = json!({"count": 2, "indices": {"bufferView": places, "componentType": 5121},
                        "values": {"bufferView": values}});
    m.json["accessors"][0] =
        json!({"componentType": 5126, "count": 3, "type": "VEC3", "sparse": sparse});
    assert_eq!(
        *mesh(&m.fine()).positions,
        [[0.0; 3], [4.0, 0.0, 0.0], [0.0, 5.0, 0.0]]
    );
}

#[test]
fn triangles_strips_and_fans() {
    let corners = floats(&[
        0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 1.0, 1.0, 0.0, 0.0, 2.0, 0.0,
    ]);
    let check = |mode: u64, expect: &[[u32; 3]]| {
        let mut m = Model::new();
        m.attribute("POSITION", "VEC3", 5126, 5, &corners);
        let m = m.with("/meshes/0/primitives/0/mode", mode.into());
        let (desc, said) = m.load().unwrap();
        assert_eq!(*mesh(&desc).indices, expect, "{mode}");
        said
    };
    let said = check(4, &[[0, 1, 2]]);
    assert!(
        said.iter()
            .any(|s| s.contains("2 corners after the last triangle")),
        "{said:?}"
    );
    check(5, &[[0, 1, 2], [1, 3, 2], [2, 3, 4]]);
    check(6, &[[1, 2, 0], [2, 3, 0], [3, 4, 0]]);
    let mut m = Model::triangle();
    m.json["meshes"][0]["primitives"] = json!([
        {"attributes": {"POSITION": 0}},
        {"attributes": {"POSITION": 0}, "mode": 0},
        {"attributes": {"POSITION": 0}, "mode": 3}
    ]);
    let (desc, said) = m.load().unwrap();
    assert_eq!(desc.primitives.len(), 1);
    for what in [
        "/primitives/1: warning: points have no surface",
        "/primitives/2: warning: lines",
    ] {
        assert!(said.iter().any(|s| s.contains(what)), "{said:?}");
    }
}

#[test]
fn vertices_that_nothing_uses_are_left_out() {
    let mut m = Model::new();
    let many: Vec<f32> = (0..300).map(|i| (i * i % 97) as f32).collect();
    m.attribute("POSITION", "VEC3", 5126, 100, &floats(&many));
    m.indices(&[90, 7, 31]);
    let desc = m.fine();
    let row = |i: usize| [many[3 * i], many[3 * i + 1], many[3 * i + 2]];
    assert_eq!(*mesh(&desc).positions, [row(90), row(7), row(31)]);
    assert_eq!(*mesh(&desc).indices, [[0, 1, 2]]);
}

#[test]
fn vertex_colours_multiply_and_bring_alpha() {
    let mut m = Model::triangle();
    m.attribute("COLOR_0", "VEC3", 5126, 3, &floats(&[0.5; 9]));
    let m = m.material(json!({
        "alphaMode": "BLEND", "pbrMetallicRoughness": {"baseColorFactor": [0.5, 1, 1, 0.25]}
    }));
    let desc = m.fine();
    assert_eq!(*mesh(&desc).colors, [[0.5, 0.5, 0.5, 1.0]; 3]);
    let BsdfDesc::Principled(p) = &desc.materials[0].bsdf else {
        panic!()
    };
    let ColorTex::Texture(id) = p.base_color else {
        panic!()
    };
    assert_eq!(
        desc.primitives[0].alpha,
        Some(FloatTex::Texture(id, Channel::A))
    );
    let Texture::Scale {
        a: ColorTex::Texture(a),
        b: FloatOrColor::Color(ColorTex::Texture(b)),
    } = desc.textures[id.index()]
    else {
        panic!("{:?}", desc.textures)
    };
    assert_eq!(
        desc.textures[a.index()],
        Texture::Constant {
            value: [0.5, 1.0, 1.0, 0.25]
        }
    );
    assert_eq!(desc.textures[b.index()], Texture::VertexColor);
}

#[test]
fn tangents_are_taken_or_made_for_what_needs_them() {
    let normal_map = json!({"normalTexture": {"index": 0, "texCoord": 1, "scale": 0.5}});
    let mut m = Model::triangle();
    m.picture();
    let m = m.material(normal_map.clone());
    let desc = m.fine();
    // The map's own set comes first, and tangents follow it: u falls along x.
    let made = mesh(&desc);
    assert_eq!(made.uvs.len(), 1);
    assert_eq!(made.uvs[0][1], [0.25, 0.5]);
    // v rises (upwards) along +y, u falls along +x: mirrored.
    assert_eq!(*made.tangents, [[-1.0, 0.0, 0.0, -1.0]; 3]);
    assert_eq!(desc.materials[0].normal_map.map(|(_, s)| s), Some(0.5));
    let mut m = Model::triangle();
    m.picture();
    m.attribute(
        "TANGENT",
        "VEC4",
        5126,
        3,
        &floats(&[0.0, 1.0, 0.0, -1.0].repeat(3)),
    );
    let given = m.material(normal_map).fine();
    assert_eq!(*mesh(&given).tangents, [[0.0, 1.0, 0.0, -1.0]; 3]);
    // Without a normal map nothing needs them.
    assert!(mesh(&Model::triangle().fine()).tangents.is_empty());
}

#[test]
fn instances_and_shared_meshes() {
    let mut m = Model::triangle();
    let at = m.accessor("VEC3", 5126, 2, &floats(&[0.0, 0.0, 0.0, 5.0, 0.0, 0.0]));
    let scale = m.accessor("VEC3", 5126, 2, &floats(&[1.0, 1.0, 1.0, 2.0, 2.0, 2.0]));
    let m = m
        .with("/extensionsUsed", json!(["EXT_mesh_gpu_instancing"]))
        .with("/extensionsRequired", json!(["EXT_mesh_gpu_instancing"]))
        .with("/nodes/0/translation", json!([0, 1, 0]))
        .with(
            "/nodes/0/extensions",
            json!({"EXT_mesh_gpu_instancing": {"attributes": {"TRANSLATION": at, "SCALE": scale}}}),
        );
    let desc = m.fine();
    assert_eq!((desc.primitives.len(), desc.meshes.len()), (2, 1));
    let second = desc.primitives[1].transform.keys[0].transform;
    assert_eq!(
        second.transform_point3(glam::DVec3::X),
        glam::DVec3::new(7.0, 1.0, 0.0)
    );
    // A mesh that is placed often enough becomes a group.
    let mut m = Model::triangle();
    m.indices(&[0, 1, 2].repeat(10_000));
    let nodes: Vec<Value> = (0..20)
        .map(|i| json!({"mesh": 0, "translation": [i, 0, 0]}))
        .collect();
    let m = m
        .with("/nodes", json!(nodes))
        .with("/scenes/0/nodes", json!((0..20).collect::<Vec<_>>()));
    let desc = m.fine();
    assert_eq!(
        (desc.groups.len(), desc.instances.len(), desc.meshes.len()),
        (1, 20, 1)
    );
    assert!(desc.primitives.is_empty());
}

#[test]
fn nodes_place_what_hangs_on_them() {
    let m = Model::triangle().with(
        "/nodes",
        json!([
            {"children": [1], "matrix": [0, 0, -1, 0, 0, 1, 0, 0, 1, 0, 0, 0, 10, 0, 0, 1]},
            {"mesh": 0, "scale": [-2, 1, 1], "rotation": [0, 0, 1, 0]}
        ]),
    );
    let desc = m.fine();
    let placed = desc.primitives[0].transform.keys[0].transform;
    // (1,0,0) is mirrored and doubled to (-2,0,0), turned half round to (2,0,0); the matrix, given
    // column by column, takes x to -z and moves by 10.
    assert!(
        (placed.transform_point3(glam::DVec3::X) - glam::DVec3::new(10.0, 0.0, -2.0)).length()
            < 1e-12
    );
    assert!(placed.matrix3.determinant() < 0.0);
}

/// A file need not have a scene; then everything in it is shown, each node where its parents put it.
#[test]
fn a_file_without_scenes_is_shown_whole() {
    let mut m = Model::triangle().with(
        "/nodes",
        json!([{"mesh": 0}, {"children": [2], "translation": [0, 5, 0]}, {"mesh": 0}]),
    );
    let whole = m.json.as_object_mut().unwrap();
    whole.remove("scenes");
    whole.remove("scene");
    let (desc, said) = m.load().unwrap();
    assert!(
        said[0].contains("the file has no scene: all of its nodes"),
        "{said:?}"
    );
    let heights: Vec<f64> = desc
        .primitives
        .iter()
        .map(|p| p.transform.keys[0].transform.translation.y)
        .collect();
    assert_eq!(heights, [0.0, 5.0]);
    // Nothing is a root where nodes contain themselves.
    let error = m
        .with("/nodes", json!([{"children": [0]}]))
        .load()
        .unwrap_err();
    assert!(error.to_string().contains("must form a tree"), "{error}");
}
