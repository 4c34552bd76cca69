//! Files that are refused, with the place and the reason, and files that are read with a warning.

use super::*;

/// A model with a bit of everything that can be broken.
fn model() -> Model {
    let mut m = Model::triangle();
    m.indices(&[0, 1, 2]);
    m.picture();
    let m = m
        .material(json!({"name": "m", "pbrMetallicRoughness": {"baseColorTexture": {"index": 0}}}));
    m.with(
        "/cameras",
        json!([{"type": "perspective", "perspective": {"yfov": 1, "znear": 1}}]),
    )
    .with("/nodes/0/children", json!([1]))
    .with("/nodes/1", json!({"camera": 0}))
}

fn refused(text: &str, expect: &str) {
    match load_text(text, &Overrides::default()) {
        Ok(_) => panic!("accepted; expected {expect}"),
        Err(error) => {
            let all: Vec<String> = error.diagnostics.iter().map(ToString::to_string).collect();
            assert!(
                all.iter().any(|d| d.contains(expect)),
                "{all:#?}, expected {expect}"
            );
        }
    }
}

#[test]
fn broken_values_are_refused() {
    assert_eq!(model().load().unwrap().1.len(), 1);
    // A value that is set, and what is said about it.
    let table = [
        (
            "/asset",
            json!(null),
            "/asset: error: expected an object, found null",
        ),
        (
            "/asset/version",
            json!("1.0"),
            "m.gltf#/asset/version: error: glTF of version \"1.0\"",
        ),
        ("/asset/minVersion", json!("2.1"), "needs glTF 2.1"),
        (
            "/extensionsRequired",
            json!(["KHR_no_such"]),
            "m.gltf#/extensionsRequired/0: error: the file requires the extension KHR_no_such",
        ),
        (
            "/scene",
            json!(7),
            "m.gltf#/scene: error: 7 of \"scenes\", but there are only 1 of them",
        ),
        ("/scenes", json!([]), "of \"scenes\""),
        (
            "/scenes/0/nodes",
            json!([5]),
            "/scenes/0/nodes/0: error: 5 of \"nodes\"",
        ),
        ("/scenes/0/nodes", json!({}), "expected an array"),
        ("/nodes/0/children", json!([0]), "node 0 is there twice"),
        ("/nodes/1/children", json!([0]), "none may contain itself"),
        (
            "/nodes/0/mesh",
            json!(1.5),
            "/nodes/0/mesh: error: expected a whole number, found 1.5",
        ),
        ("/nodes/0/mesh", json!(-1), "expected a whole number"),
        (
            "/nodes/0/matrix",
            json!([1, 2]),
            "expected 16 numbers, found 2",
        ),
        (
            "/nodes/0/matrix",
            json!([1, 0, 0, 1, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1]),
            "last row is not 0 0 0 1",
        ),
        ("/nodes/0/scale", json!([0, 1, 1]), "singular"),
        (
            "/nodes/0/rotation",
            json!(["x", 0, 0, 1]),
            "/nodes/0/rotation/0: error: expected a number, found a string",
        ),
        (
            "/meshes/0/primitives/0/attributes/POSITION",
            json!(99),
            "99 of \"accessors\"",
        ),
        (
            "/meshes/0/primitives/0/indices",
            json!(0),
            "where 1 are needed",
        ),
        ("/meshes/0/primitives/0/mode", json!(9), "unknown mode 9"),
        (
            "/meshes/0/primitives/0/material",
            json!(3),
            "3 of \"materials\"",
        ),
        (
            "/accessors/0/componentType",
            json!(5124),
            "unknown component type 5124",
        ),
        ("/accessors/0/type", json!("VEC9"), "unknown type \"VEC9\""),
        ("/accessors/0/type", json!("VEC2"), "POSITION of 2 numbers"),
        (
            "/accessors/0/count",
            json!(0),
            "an accessor without elements",
        ),
        (
            "/accessors/0/count",
            json!(4),
            "4 elements of 12 bytes from byte 0 do not lie in a view of 36 bytes",
        ),
        (
            "/accessors/0/count",
            json!(4_000_000_000_000_000u64),
            "do not lie in a view",
        ),
        (
            "/accessors/0/byteOffset",
            json!(9_000_000_000_000_000u64),
            "do not lie in a view",
        ),
        (
            "/accessors/0/bufferView",
            json!(77),
            "77 of \"bufferViews\"",
        ),
        ("/accessors/1/count", json!(2), "2 elements for 3 vertices"),
        (
            "/bufferViews/0/byteLength",
            json!(1u64 << 40),
            "of a buffer of",
        ),
        (
            "/bufferViews/0/byteOffset",
            json!(1u64 << 52),
            "of a buffer of",
        ),
        (
            "/bufferViews/0/byteStride",
            json!(8),
            "a stride of 8 bytes for elements of 12",
        ),
        ("/bufferViews/0/byteStride", json!(0), "a stride of 0"),
        ("/bufferViews/0/buffer", json!(1), "1 of \"buffers\""),
        (
            "/images/0/uri",
            json!("x.png"),
            "both \"uri\" and \"bufferView\"",
        ),
        (
            "/images/0/bufferView",
            json!(0),
            "not a picture of a known kind",
        ),
        ("/textures/0/source", json!(2), "2 of \"images\""),
        (
            "/materials/0/pbrMetallicRoughness/baseColorTexture/index",
            json!(1),
            "1 of \"textures\"",
        ),
        (
            "/materials/0/pbrMetallicRoughness/baseColorTexture/texCoord",
            json!(2),
            "material \"m\" asks for TEXCOORD_2, which the primitive does not have",
        ),
        (
            "/materials/0/alphaMode",
            json!("GLASS"),
            "unknown alpha mode \"GLASS\"",
        ),
        (
            "/materials/0/doubleSided",
            json!(1),
            "expected true or false",
        ),
        ("/cameras/0/perspective/yfov", json!(0), "yfov is 0"),
        ("/cameras/0/perspective/yfov", json!(4), "field of view"),
        (
            "/cameras/0/type",
            json!("fish"),
            "unknown camera type \"fish\"",
        ),
        (
            "/animations",
            json!([{"channels": [{"sampler": 0, "target": {"node": 0, "path": "scale"}}],
                               "samplers": [{"input": 0, "output": 0}]}]),
            "elements of 3 numbers where 1 are needed",
        ),
        ("/skins", json!([{"joints": []}]), "a skin"),
    ];
    for (pointer, value, expect) in table {
        let mut m = model();
        if pointer == "/skins" {
            m = m.with("/nodes/0/skin", 0.into());
        }
        refused(&m.with(pointer, value).text(), expect);
    }
}

#[test]
fn broken_numbers_and_indices_are_refused() {
    let nan = floats(&[f32::NAN, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0]);
    let mut m = model();
    m.attribute("POSITION", "VEC3", 5126, 3, &nan);
    refused(&m.text(), "element 0 has a number that is not finite");
    let mut m = model();
    m.indices(&[0, 1, 3]);
    refused(&m.text(), "index 3, but there are only 3 vertices");
    let mut m = model();
    let places = m.view(&[2, 1]);
    let values = m.view(&[0; 24]);
    for (places, count, expect) in [
        (places, 2, "indices that do not rise"),
        (places, 4, "4 of 3 elements"),
        (values, 1, "do not lie"),
    ] {
        let sparse = json!({"count": count, "indices": {"bufferView": places, "componentType": 5121},
                            "values": {"bufferView": if expect == "do not lie" { places } else { values }, "byteOffset": if expect == "do not lie" { 20 } else { 0 }}});
        refused(&model_with(&m, "/accessors/0/sparse", sparse), expect);
    }
    // What has no bytes may not claim any number.
    let huge = json!({"componentType": 5126, "count": 1u64 << 40, "type": "VEC3"});
    refused(
        &model_with(&m, "/accessors/0", huge),
        "the limit is 16777216",
    );
}

fn model_with(m: &Model, pointer: &str, value: Value) -> String {
    let copy = Model {
        json: m.json.clone(),
        bytes: m.bytes.clone(),
    };
    copy.with(pointer, value).text()
}

#[test]
fn broken_texts_are_refused() {
    let text = model().text();
    for (bad, expect) in [
        ("", "not readable as JSON"),
        ("{", "EOF while parsing"),
        (&text[..text.len() / 2], "not readable as JSON"),
        ("[]", "expected an object"),
        ("{}", "the property \"asset\" is missing"),
        (
            "{\"asset\": {\"version\": \"2.0\"}, \"asset\": 1}",
            "m.gltf:1:37#/asset: error: not readable as JSON: the property \"asset\" is there twice",
        ),
        (
            "{\"asset\": {\"version\": \"2.0\"}} x",
            "trailing characters",
        ),
        (
            "{\"asset\": {\"version\": \"2.0\"}, \"scene\": 1e999}",
            "number out of range",
        ),
        (
            "{\"asset\": {\"version\": \"2.0\"}}",
            "the file has no scene",
        ),
        (
            "{\"asset\": {\"version\": \"2.0\"}, \"scene\": 0, \"nodes\": [{}]}",
            "0 of \"scenes\", but there are only 0",
        ),
        // An older format, in which lists are objects.
        (
            "{\"asset\": {\"version\": \"1.0\"}, \"buffers\": {\"b\": {}}}",
            "m.gltf#/asset/version: error: glTF of version \"1.0\"; 2.0 is read here",
        ),
    ] {
        refused(bad, expect);
    }
    let deep = "[".repeat(100_000);
    refused(&deep, "recursion limit");
    let many = format!("[{}0]", "0,".repeat(9_000_000));
    refused(&many, "more than 8000000 values");
    let files = MemorySource::new().with("m.gltf", b"\xff{}").unwrap();
    let error = load("m.gltf", &files, &Overrides::default()).unwrap_err();
    assert!(
        error.to_string().contains("not UTF-8 text, at byte 0"),
        "{error}"
    );
}

#[test]
fn broken_buffers_are_refused() {
    for (buffers, expect) in [
        (json!([{"byteLength": 9}]), "a buffer without a \"uri\""),
        (
            json!([{"byteLength": 1u64 << 40, "uri": "data:;base64,AAAA"}]),
            "but there are only 3 bytes",
        ),
        (
            json!([{"byteLength": 3, "uri": "data:;base64,A*AA"}]),
            "damaged base64",
        ),
        (
            json!([{"byteLength": 3, "uri": "no.bin"}]),
            "no.bin: no such file",
        ),
        (
            json!([{"byteLength": 3, "uri": "../a.bin"}]),
            "leaves the scene's folder",
        ),
        (
            json!([{"byteLength": 3, "uri": "%2e%2e/a.bin"}]),
            "leaves the scene's folder",
        ),
        (
            json!([{"byteLength": 3, "uri": "/etc/passwd"}]),
            "an absolute path",
        ),
        (json!([{"byteLength": 3, "uri": "http://x/a.bin"}]), "a URL"),
        (
            json!([{"uri": "data:;base64,AAAA"}]),
            "\"byteLength\" is missing",
        ),
        (json!([]), "0 of \"buffers\""),
    ] {
        refused(&model().with("/buffers", buffers).text(), expect);
    }
}

#[test]
fn broken_glbs_are_refused() {
    let whole = model().glb();
    let refused = |bytes: &[u8], expect: &str| {
        let files = MemorySource::new().with("m.glb", bytes).unwrap();
        match load("m.glb", &files, &Overrides::default()) {
            Ok(_) => panic!("accepted; expected {expect}"),
            Err(error) => assert!(
                error.to_string().contains(expect),
                "{error}, expected {expect}"
            ),
        }
    };
    let patch = |at: usize, bytes: &[u8]| {
        let mut copy = whole.clone();
        copy[at..at + bytes.len()].copy_from_slice(bytes);
        copy
    };
    refused(&whole[..9], "the file ends in its header, at byte 9");
    refused(&whole[..whole.len() - 1], "the header says");
    refused(
        &patch(4, &[1]),
        "a GLB of version 1; only version 2 (glTF 2.0) is read, at byte 4",
    );
    refused(&patch(8, &[255; 4]), "the header says 4294967295 bytes");
    refused(&patch(12, &[255; 4]), "a chunk of 4294967295 bytes");
    refused(
        &patch(16, b"BIN\0"),
        "the first chunk is not JSON, at byte 12",
    );
    refused(b"glTF\x02\0\0\0\x0c\0\0\0", "a GLB without a JSON chunk");
    let twice = glb(b"{}", None);
    let mut copy = twice.clone();
    copy.extend_from_slice(&twice[12..]);
    let size = copy.len() as u32;
    copy[8..12].copy_from_slice(&size.to_le_bytes());
    refused(&copy, "a second chunk of the same kind");
    // Every cut is an error and no panic.
    for cut in (0..whole.len()).step_by(7) {
        let files = MemorySource::new().with("m.glb", &whole[..cut]).unwrap();
        assert!(
            load("m.glb", &files, &Overrides::default()).is_err(),
            "{cut}"
        );
    }
    // What follows the end, and chunks that nobody knows, are named.
    let mut longer = whole.clone();
    longer.extend([1, 2, 3]);
    let files = MemorySource::new().with("m.glb", longer).unwrap();
    let (_, said) = load("m.glb", &files, &Overrides::default()).unwrap();
    assert!(
        said.iter()
            .any(|d| d.reason.contains("3 bytes after the end")),
        "{said:?}"
    );
}

#[test]
fn what_is_odd_is_named_and_read() {
    let said = |m: Model, expect: &str| {
        let (_, said) = m
            .load()
            .unwrap_or_else(|e| panic!("{e}, expected {expect}"));
        assert!(
            said.iter().any(|s| s.contains(expect)),
            "{said:#?}, expected {expect}"
        );
    };
    let table = [
        (
            "/materials/0/pbrMetallicRoughness/metallicFactor",
            json!(1.5),
            "/metallicFactor: warning: 1.5 is out of range (0 to 1); 1 is used",
        ),
        (
            "/materials/0/pbrMetallicRoughness/metalicFactor",
            json!(1),
            "unknown property \"metalicFactor\"; did you mean \"metallicFactor\"?; it is ignored",
        ),
        (
            "/materials/0/emissiveFactor",
            json!([2, 0, 0]),
            "is out of range",
        ),
        (
            "/nodes/0/rotation",
            json!([0, 0, 0, 2]),
            "a quaternion of length 2",
        ),
        (
            "/extensionsUsed",
            json!(["EXT_no_such"]),
            "the extension EXT_no_such is not supported; it is ignored",
        ),
        (
            "/nodes/0/extensions",
            json!({"EXT_no_such": {}}),
            "/nodes/0/extensions/EXT_no_such: warning",
        ),
        (
            "/scenes/1",
            json!({"name": "other"}),
            "this one of 2 scenes is rendered",
        ),
        (
            "/meshes/0/primitives/0/attributes/COLOR_1",
            json!(0),
            "the attribute COLOR_1 is not used",
        ),
        ("/textures/0", json!({}), "a texture without a picture"),
        (
            "/animations",
            json!([{"channels": [{"sampler": 0, "target": {"node": 0, "path": "pointer"}}], "samplers": [{}]}]),
            "animating \"pointer\" is not supported",
        ),
        (
            "/materials/0/extensions",
            json!({"KHR_materials_dispersion": {"dispersion": 1}}),
            "dispersion is approximated",
        ),
    ];
    for (pointer, value, expect) in table {
        said(model().with(pointer, value), expect);
    }
    let mut m = model();
    m.indices(&[0, 1, 2, 0, 0, 1]);
    said(m, "1 triangles without area are left out");
    let text = format!("\u{feff}{}", model().text());
    let (_, found) = load_text(&text, &Overrides::default()).unwrap();
    assert!(
        found.iter().any(|s| s.contains("byte-order mark")),
        "{found:?}"
    );
    // A missing picture has a stand-in where that is allowed.
    let m = model().with("/images", json!([{"uri": "no.png"}]));
    refused(
        &m.text(),
        "m.gltf#/images/0/uri: error: no.png: no such file",
    );
    let lenient = Overrides {
        allow_missing: true,
        ..Overrides::default()
    };
    let (desc, _) = load_text(&m.text(), &lenient).unwrap();
    assert!(desc.images[0].missing);
    // So has a missing buffer, with all that lies in it.
    let m = model().with("/buffers", json!([{"byteLength": 1000, "uri": "no.bin"}]));
    refused(
        &m.text(),
        "m.gltf#/buffers/0/uri: error: no.bin: no such file",
    );
    let (desc, said) = load_text(&m.text(), &lenient).unwrap();
    assert_eq!(mesh(&desc).indices.len(), 12);
    assert!(desc.images[0].missing);
    assert!(
        said.iter()
            .any(|s| s.contains("no.bin: no such file; cubes")),
        "{said:?}"
    );
}

#[test]
fn endless_work_is_refused() {
    // One set of vertices, read again by a great many primitives.
    let mut m = Model::new();
    let count = 1 << 20;
    m.attribute("POSITION", "VEC3", 5126, count, &vec![0; 12 * count]);
    let index = m.indices(&[0, 1, 2]);
    let primitive = json!({"attributes": {"POSITION": 0}, "indices": index});
    m.json["meshes"][0]["primitives"] = vec![primitive; 20].into();
    refused(&m.text(), "more work than the limit");
}
