//! Scenes of every format, through the one way in.

use scene::assets::{AssetBytes, AssetSource, MemorySource, ZipSource, find_main};
use scene::limits::{MAX_IMPORT_BYTES, MAX_PIXELS};
use scene::{Overrides, Severity, load_with_files};

/// A picture of two pixels, grey and alpha: what scenes here may refer to as `p.png`.
const PNG: &[u8] = include_bytes!("two-pixels.png");
/// A mesh that scenes here may refer to as `m.ply`.
const PLY: &str = "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\n\
    property float z\nelement face 1\nproperty list uchar int vertex_indices\nend_header\n\
    0 0 0 1 0 0 0 1 0 3 0 1 2\n";

/// Files that a scene may name.
fn beside(main: &str, bytes: &[u8]) -> MemorySource {
    let mut sky = b"PF 2 2 -1 ".to_vec();
    sky.resize(sky.len() + 2 * 2 * 3 * 4, 0);
    let files: [(&str, &[u8]); 6] = [
        (main, bytes),
        ("p.png", PNG),
        ("m.ply", PLY.as_bytes()),
        ("sky.pfm", &sky),
        ("part.pbrt", b"Translate 1 2 3 Shape \"sphere\""),
        ("lens.dat", b"50 5 1.5 20\n-50 40 1 20\n"),
    ];
    let mut all = MemorySource::new();
    for (path, bytes) in files {
        all.insert(path, bytes.to_vec()).expect("a good path");
    }
    all
}

/// Reads a scene and checks what was made of it against the limits.
fn survive(main: &str, files: &dyn AssetSource) {
    let Ok(loaded) = load_with_files(main, files, &Overrides::default()) else {
        return;
    };
    let desc = &loaded.desc;
    for finding in scene::validate(desc) {
        assert!(finding.severity == Severity::Warning, "{finding}");
    }
    let bytes: u64 = desc.meshes.iter().map(|mesh| mesh.memory_bytes()).sum();
    assert!(bytes <= MAX_IMPORT_BYTES, "{bytes} bytes of meshes");
    let pixels = u64::from(desc.film.width) * u64::from(desc.film.height);
    assert!((1..=MAX_PIXELS).contains(&pixels), "{pixels} pixels");
    for path in &loaded.files {
        assert!(files.exists(path), "{path} is listed and not there");
    }
}

/// A pbrt file.
pub fn pbrt(bytes: &[u8]) {
    survive("s.pbrt", &beside("s.pbrt", bytes));
}

/// A PLY mesh, gzipped ones included.
pub fn ply(bytes: &[u8]) {
    survive("s.ply", &beside("s.ply", bytes));
}

/// A glTF file; its buffers lie in data URIs.
pub fn gltf(bytes: &[u8]) {
    survive("s.gltf", &beside("s.gltf", bytes));
}

/// A binary glTF file.
pub fn glb(bytes: &[u8]) {
    survive("s.glb", &beside("s.glb", bytes));
}

/// An OBJ file and, after the first zero byte, its MTL file.
pub fn obj(bytes: &[u8]) {
    let mut parts = bytes.splitn(2, |b| *b == 0);
    let (obj, mtl) = (
        parts.next().unwrap_or_default(),
        parts.next().unwrap_or_default(),
    );
    let mut files = beside("s.obj", obj);
    files.insert("s.mtl", mtl.to_vec()).expect("a good path");
    survive("s.obj", &files);
}

/// Brolly's own JSON.
pub fn native(bytes: &[u8]) {
    survive("s.json", &beside("s.json", bytes));
}

/// An archive with a scene: its main file is found as for a user who names the archive.
pub fn zip(bytes: &[u8]) {
    let Ok(files) = ZipSource::new("s.zip", AssetBytes::from(bytes)) else {
        return;
    };
    let list = files.list();
    for path in &list {
        // Damaged entries are refused one by one.
        if let (Ok(whole), Ok(head)) = (files.read(path), files.read_prefix(path, 16)) {
            assert!(whole.starts_with(&head), "{path} begins in two ways");
        }
    }
    if let Ok(main) = find_main(&list) {
        survive(&main, &files);
    }
}

/// The container of binary glTF around JSON and a buffer.
fn wrapped(json: &str, buffer: &[u8]) -> Vec<u8> {
    let padded = |bytes: &[u8], by: u8| {
        let mut bytes = bytes.to_vec();
        bytes.resize(bytes.len().next_multiple_of(4), by);
        bytes
    };
    let mut out = b"glTF\x02\0\0\0\0\0\0\0".to_vec();
    for (kind, chunk) in [
        (b"JSON", padded(json.as_bytes(), b' ')),
        (b"BIN\0", padded(buffer, 0)),
    ] {
        out.extend_from_slice(&(chunk.len() as u32).to_le_bytes());
        out.extend_from_slice(kind);
        out.extend_from_slice(&chunk);
    }
    let length = (out.len() as u32).to_le_bytes();
    out[8..12].copy_from_slice(&length);
    out
}

/// A mesh packed by Draco, in a file that is fine otherwise.
pub fn draco(bytes: &[u8]) {
    let length = bytes.len();
    let json = format!(
        r#"{{"asset": {{"version": "2.0"}}, "scenes": [{{"nodes": [0]}}], "nodes": [{{"mesh": 0}}],
        "extensionsUsed": ["KHR_draco_mesh_compression"],
        "meshes": [{{"primitives": [{{"attributes": {{"POSITION": 0, "NORMAL": 1, "TEXCOORD_0": 2}}, "indices": 3,
            "extensions": {{"KHR_draco_mesh_compression": {{"bufferView": 0,
                "attributes": {{"POSITION": 0, "NORMAL": 1, "TEXCOORD_0": 2}}}}}}}}]}}],
        "accessors": [
            {{"componentType": 5126, "count": 4, "type": "VEC3"}},
            {{"componentType": 5126, "count": 4, "type": "VEC3"}},
            {{"componentType": 5126, "count": 4, "type": "VEC2"}},
            {{"componentType": 5125, "count": 6, "type": "SCALAR"}}],
        "bufferViews": [{{"buffer": 0, "byteLength": {length}}}], "buffers": [{{"byteLength": {length}}}]}}"#
    );
    let file = wrapped(&json, bytes);
    survive("s.glb", &beside("s.glb", &file));
}

/// Positions and indices packed by meshopt, in a file that is fine otherwise: the first four bytes
/// choose mode, filter, stride and number of the elements.
pub fn meshopt(bytes: &[u8]) {
    let Some((&[mode, filter, stride, count], bytes)) = bytes.split_first_chunk() else {
        return;
    };
    let mode = ["ATTRIBUTES", "TRIANGLES", "INDICES"][usize::from(mode % 3)];
    let filter = ["NONE", "OCTAHEDRAL", "QUATERNION", "EXPONENTIAL"][usize::from(filter % 4)];
    let (kind, component, size, target) = match mode {
        "ATTRIBUTES" if filter == "OCTAHEDRAL" => ("VEC3", 5120, 4, "NORMAL"),
        "ATTRIBUTES" if filter == "QUATERNION" => ("VEC4", 5122, 8, "TANGENT"),
        "ATTRIBUTES" => ("VEC3", 5126, 12, "POSITION"),
        _ => ("SCALAR", 5125, 4, "indices"),
    };
    let stride = size + usize::from(stride % 2) * 4;
    let (count, length) = (usize::from(count).max(1), bytes.len());
    // What is not packed is zero, or the corners of one triangle over and over.
    let plain = 3 * count.max(3);
    let positions = if target == "POSITION" { 1 } else { 0 };
    let indices = if target == "indices" {
        r#", "indices": 1"#
    } else {
        ""
    };
    let attribute = match target {
        "NORMAL" | "TANGENT" => format!(r#", "{target}": 1"#),
        _ => String::new(),
    };
    let floats = plain * 12;
    let total = floats + length;
    let expanded = stride * count;
    let json = format!(
        r#"{{"asset": {{"version": "2.0"}}, "scenes": [{{"nodes": [0]}}], "nodes": [{{"mesh": 0}}],
        "extensionsUsed": ["EXT_meshopt_compression"],
        "meshes": [{{"primitives": [{{"attributes": {{"POSITION": {positions}{attribute}}}{indices}}}]}}],
        "accessors": [
            {{"bufferView": 0, "componentType": 5126, "count": {count}, "type": "VEC3"}},
            {{"bufferView": 1, "componentType": {component}, "count": {count}, "type": "{kind}"}}],
        "bufferViews": [
            {{"buffer": 0, "byteLength": {floats}}},
            {{"buffer": 1, "byteLength": {expanded}, "byteStride": {stride},
              "extensions": {{"EXT_meshopt_compression": {{"buffer": 0, "byteOffset": {floats}, "byteLength": {length},
                "byteStride": {stride}, "count": {count}, "mode": "{mode}", "filter": "{filter}"}}}}}}],
        "buffers": [{{"byteLength": {total}}},
            {{"byteLength": {expanded}, "extensions": {{"EXT_meshopt_compression": {{"fallback": true}}}}}}]}}"#
    );
    let corner = [0.0f32, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0].map(f32::to_le_bytes);
    let mut buffer: Vec<u8> = corner
        .as_flattened()
        .iter()
        .copied()
        .cycle()
        .take(floats)
        .collect();
    buffer.extend_from_slice(bytes);
    survive("s.glb", &beside("s.glb", &wrapped(&json, &buffer)));
}
