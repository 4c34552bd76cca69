//! Packed geometry: meshopt and Draco.

use super::*;
use crate::import::gltf::meshopt::decode;
use draco_core::{
    DataType, EncoderBuffer, EncoderOptions, GeometryAttributeType, MeshEncoder, PointAttribute,
};

/// Zeros at the end of packed attributes; the last `stride` bytes are the first element's base.
fn tail(bytes: &[u8], base: &[u8]) -> Vec<u8> {
    let mut out = bytes.to_vec();
    out.resize(bytes.len() + 32 - base.len(), 0);
    out.extend_from_slice(base);
    out
}

#[test]
fn attributes_of_every_width() {
    // Two elements of 4 bytes: byte 0 has no deltas, byte 1 deltas of 2 bits, byte 2 of 4, byte 3 of 8.
    // Deltas are zigzag: 2 is +1, 1 is -1.
    let mut packed = vec![0xa0];
    packed.extend([0]);
    packed.extend([1, 0b1001_0000, 0, 0, 0]);
    // The largest 4-bit value says that a byte follows: 200 is +100.
    packed.extend([2, 0xf3, 0, 0, 0, 0, 0, 0, 0, 200]);
    packed.push(3);
    packed.extend([20, 19, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0]);
    let data = tail(&packed, &[7, 10, 20, 30]);
    let out = decode(&data, 2, 4, "ATTRIBUTES", "NONE").unwrap();
    assert_eq!(out, [7, 11, 120, 40, 7, 10, 118, 30]);
    for (data, count, stride, expect) in [
        (&data[..data.len() - 1], 2, 4, "packed data"),
        (&data[..], 2, 3, "multiples of 4"),
        (&data[..], 2, 0, "multiples of 4"),
        (&data[..], 300, 4, "packed data"),
        (&data[..10], 2, 4, "without its tail"),
        (&[0xa1, 0][..], 1, 4, "version 1"),
        (&[][..], 1, 4, "too early"),
    ] {
        let error = decode(data, count, stride, "ATTRIBUTES", "NONE").unwrap_err();
        assert!(error.contains(expect), "{error}, expected {expect}");
    }
}

#[test]
fn triangles_and_sequences() {
    // 0xf0: three new vertices by the first entry of the table (0, 0); then the edge (2, 1), two
    // pushes back, with a new vertex; then an explicit triangle 0 1 2 (restart, all fresh).
    let mut packed = vec![0xe1, 0xf0, 0x10, 0xfe, 0x00];
    packed.extend([0; 16]);
    let out = decode(&packed, 9, 4, "TRIANGLES", "NONE").unwrap();
    let words: Vec<u32> = out
        .as_chunks::<4>()
        .0
        .iter()
        .map(|w| u32::from_le_bytes(*w))
        .collect();
    assert_eq!(words, [0, 1, 2, 2, 1, 3, 0, 1, 2]);
    assert!(
        decode(&packed, 10, 4, "TRIANGLES", "NONE")
            .unwrap_err()
            .contains("no triangles")
    );
    assert!(decode(&packed[..12], 9, 4, "TRIANGLES", "NONE").is_err());
    assert!(decode(&packed, 9, 3, "TRIANGLES", "NONE").is_err());
    // Deltas to either of two last values: +1 (first), +50 (second), +1, -1 ...
    let mut packed = vec![0xd1, 0x04, 0xc9, 0x01, 0x04, 0x03];
    packed.extend([0; 4]);
    let out = decode(&packed, 4, 2, "INDICES", "NONE").unwrap();
    let words: Vec<u16> = out
        .as_chunks::<2>()
        .0
        .iter()
        .map(|w| u16::from_le_bytes(*w))
        .collect();
    assert_eq!(words, [1, 50, 2, 49]);
}

#[test]
fn filters() {
    // Straight up, and down an edge.
    let mut row = [0u8, 0, 127, 9];
    let packed = |row: &[u8], filter: &str| {
        let mut out = vec![0xa0];
        out.resize(1 + row.len(), 0);
        let zeros = 32usize.saturating_sub(row.len());
        out.resize(out.len() + zeros, 0);
        out.extend_from_slice(row);
        decode(&out, 1, row.len(), "ATTRIBUTES", filter)
    };
    assert_eq!(packed(&row, "OCTAHEDRAL").unwrap(), [0, 0, 127, 9]);
    row[..3].copy_from_slice(&[127, 127, 127]);
    assert_eq!(
        packed(&row, "OCTAHEDRAL").unwrap()[..3],
        [0, 0, (-127i8) as u8]
    );
    // The identity: the largest component, w, is left out.
    let quaternion: Vec<u8> = [0i16, 0, 0, 0x7fff]
        .iter()
        .flat_map(|x| x.to_le_bytes())
        .collect();
    let out = packed(&quaternion, "QUATERNION").unwrap();
    assert_eq!(out, [0, 0, 0, 0, 0, 0, 0xff, 0x7f]);
    // 3 * 2^-1.
    let word = (0xff00_0003u32).to_le_bytes();
    assert_eq!(packed(&word, "EXPONENTIAL").unwrap(), 1.5f32.to_le_bytes());
    assert!(
        packed(&word, "WAVELET")
            .unwrap_err()
            .contains("unknown filter")
    );
}

#[test]
fn a_packed_view_stands_for_its_bytes() {
    let mut m = Model::triangle();
    let mut packed = vec![0xe1, 0xf0];
    packed.extend([0; 16]);
    m.indices(&[2, 1, 0]);
    let view = m.view(&packed);
    let offset = m.json["bufferViews"][view]["byteOffset"].clone();
    let target = view - 1;
    let extension = json!({"buffer": 0, "byteOffset": offset, "byteLength": packed.len(), "byteStride": 2,
                           "count": 3, "mode": "TRIANGLES"});
    let m = m
        .with("/extensionsUsed", json!(["EXT_meshopt_compression"]))
        .with("/extensionsRequired", json!(["EXT_meshopt_compression"]))
        .with(
            &format!("/bufferViews/{target}/extensions"),
            json!({"EXT_meshopt_compression": extension}),
        );
    assert_eq!(*mesh(&m.fine()).indices, [[0, 1, 2]]);
    let path = format!("/bufferViews/{target}/extensions/EXT_meshopt_compression/count");
    let error = m
        .with(&path, json!(1u64 << 50))
        .load()
        .unwrap_err()
        .to_string();
    assert!(error.contains("cannot lie in 18 bytes"), "{error}");
}

/// The triangle of the other tests as Draco packs it.
fn draco() -> Vec<u8> {
    let mut mesh = draco_core::Mesh::new();
    let mut attribute = |kind, width: u8, numbers: &[f32], id: u32| {
        let mut a = PointAttribute::new();
        a.init(kind, width, DataType::Float32, false, 3);
        a.buffer_mut().update(&floats(numbers), Some(0));
        a.set_unique_id(id);
        mesh.add_attribute_preserve_unique_id(a);
    };
    attribute(
        GeometryAttributeType::Position,
        3,
        &[0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0],
        5,
    );
    attribute(
        GeometryAttributeType::TexCoord,
        2,
        &[0.0, 1.0, 1.0, 1.0, 0.0, 0.0],
        9,
    );
    mesh.set_num_points(3);
    mesh.set_num_faces(1);
    mesh.set_faces_from_flat_indices(&[0, 1, 2]);
    let mut encoder = MeshEncoder::new();
    encoder.set_mesh(mesh);
    let mut out = EncoderBuffer::new();
    encoder.encode(&EncoderOptions::new(), &mut out).unwrap();
    out.data().to_vec()
}

#[test]
fn draco_meshes_are_unpacked() {
    let packed = draco();
    let mut m = Model::new();
    let view = m.view(&packed);
    let m = m
        .with("/extensionsUsed", json!(["KHR_draco_mesh_compression"]))
        .with("/extensionsRequired", json!(["KHR_draco_mesh_compression"]))
        .with(
            "/accessors",
            json!([
                {"componentType": 5126, "count": 3, "type": "VEC3"},
                {"componentType": 5126, "count": 3, "type": "VEC2"},
                {"componentType": 5123, "count": 3, "type": "SCALAR"}
            ]),
        )
        .with(
            "/meshes/0/primitives/0",
            json!({
                "attributes": {"POSITION": 0, "TEXCOORD_0": 1}, "indices": 2,
                "extensions": {"KHR_draco_mesh_compression": {
                    "bufferView": view, "attributes": {"POSITION": 5, "TEXCOORD_0": 9}}}
            }),
        );
    let desc = m.fine();
    let mesh = mesh(&desc);
    assert_eq!((mesh.indices.len(), mesh.positions.len()), (1, 3));
    for (p, uv) in mesh.positions.iter().zip(mesh.uvs[0].iter()) {
        // Positions and coordinates of this triangle are the same numbers, up to quantisation.
        assert!(
            (p[0] - uv[0]).abs() < 1e-2 && (p[1] - uv[1]).abs() < 1e-2,
            "{p:?} {uv:?}"
        );
    }
    let path = "/meshes/0/primitives/0/extensions/KHR_draco_mesh_compression/attributes/POSITION";
    let error = m
        .clone()
        .with(path, 1.into())
        .load()
        .unwrap_err()
        .to_string();
    assert!(
        error.contains("the packed mesh has no attribute 1"),
        "{error}"
    );
    // What is in no buffer at all is zero, as in other accessors; positions cannot be.
    let (desc, said) = m
        .with(
            "/accessors/3",
            json!({"componentType": 5121, "normalized": true, "count": 3, "type": "VEC4"}),
        )
        .with("/meshes/0/primitives/0/attributes/COLOR_0", 3.into())
        .load()
        .unwrap();
    assert!(
        said[0].contains("COLOR_0 lies neither in the packed mesh"),
        "{said:?}"
    );
    let colors = match desc.primitives[0].shape {
        Shape::Mesh(id) => &desc.meshes[id.index()].colors,
        ref other => panic!("{other:?}"),
    };
    assert_eq!(**colors, [[0.0; 4]; 3]);
    for cut in 0..packed.len() {
        let mut m = Model::new();
        let view = m.view(&packed[..cut.max(1)]);
        let m = m
            .with(
                "/accessors",
                json!([{"componentType": 5126, "count": 3, "type": "VEC3"}]),
            )
            .with(
                "/meshes/0/primitives/0",
                json!({"attributes": {"POSITION": 0}, "extensions": {"KHR_draco_mesh_compression": {
                "bufferView": view, "attributes": {"POSITION": 5}}}}),
            );
        assert!(m.load().is_err(), "{cut} bytes");
    }
}
