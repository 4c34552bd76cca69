//! Damaged files of every format: whatever is broken in them, reading ends with a scene or an error.
//! The damage is random but the same in every run.

use super::gltf::tests::everything;
use super::nanovdb::testing::{Draft, file};
use crate::assets::MemorySource;
use crate::{Overrides, load};
use proptest::prelude::*;
use proptest::test_runner::RngSeed;
use serde_json::{Value, json};

/// 400 cases, or as many more as PROPTEST_CASES says.
fn config() -> ProptestConfig {
    let given = ProptestConfig::default();
    ProptestConfig {
        cases: given.cases.max(400),
        rng_seed: RngSeed::Fixed(7),
        failure_persistence: None,
        ..given
    }
}

/// Where (as a share of the length), what is done there, and with which byte.
fn edits() -> impl Strategy<Value = Vec<(f64, u8, u8)>> {
    prop::collection::vec((0.0..1.0f64, 0..4u8, any::<u8>()), 1..6)
}

fn damaged(bytes: &[u8], edits: &[(f64, u8, u8)]) -> Vec<u8> {
    let mut out = bytes.to_vec();
    for &(place, kind, byte) in edits {
        let at = (place * out.len() as f64) as usize;
        match kind {
            _ if out.is_empty() => out.push(byte),
            0 => out[at] = byte,
            1 => out[at] ^= 1 << (byte % 8),
            2 => out.insert(at, byte),
            _ => {
                let end = (at + usize::from(byte)).min(out.len());
                out.drain(at..end);
            }
        }
    }
    out
}

/// Loads, and checks what was made of it against the limits.
fn survive(main: &str, files: &MemorySource) {
    if let Ok((desc, _)) = load(main, files, &Overrides::default()) {
        assert!(
            crate::validate(&desc)
                .iter()
                .all(|d| d.severity == crate::Severity::Warning)
        );
        let bytes: u64 = desc
            .meshes
            .iter()
            .map(crate::model::Mesh::memory_bytes)
            .sum();
        assert!(bytes <= crate::limits::MAX_IMPORT_BYTES);
    }
}

/// All places of a tree that hold no list and no object.
fn leaves(json: &Value, at: String, out: &mut Vec<String>) {
    match json {
        Value::Array(list) => {
            for (i, item) in list.iter().enumerate() {
                leaves(item, format!("{at}/{i}"), out);
            }
        }
        Value::Object(map) => {
            for (name, item) in map {
                leaves(item, format!("{at}/{name}"), out);
            }
        }
        _ => out.push(at),
    }
}

/// Values that programs do not expect.
fn nasty() -> Vec<Value> {
    vec![
        json!(null),
        json!(true),
        json!(0),
        json!(-1),
        json!(0.5),
        json!(1),
        json!(2),
        json!(3),
        json!(7),
        json!(255),
        json!(65_535),
        json!(4_294_967_295u64),
        json!(9_007_199_254_740_993u64),
        json!(1e300),
        json!(-1e300),
        json!(1e-300),
        json!(""),
        json!("SCALAR"),
        json!("MAT4"),
        json!([]),
        json!([0]),
        json!({}),
    ]
}

#[test]
fn what_is_damaged_was_whole() {
    let model = everything();
    let files = MemorySource::new().with("m.gltf", model.text()).unwrap();
    let (desc, _) = load("m.gltf", &files, &Overrides::default()).unwrap();
    assert_eq!(
        (desc.primitives.len(), desc.media.len(), desc.lights.len()),
        (3, 2, 1)
    );
}

proptest! {
    #![proptest_config(config())]

    #[test]
    fn gltf_with_wrong_values(picks in prop::collection::vec((0.0..1.0f64, 0..22usize), 1..4)) {
        let model = everything();
        let mut json = model.json.clone();
        let mut places = Vec::new();
        leaves(&json, String::new(), &mut places);
        for (place, value) in picks {
            let pointer = &places[(place * places.len() as f64) as usize];
            if let Some(slot) = json.pointer_mut(pointer) {
                *slot = nasty()[value].clone();
            }
        }
        let text = super::gltf::tests::text_of(&json, &model.bytes);
        survive("m.gltf", &MemorySource::new().with("m.gltf", text).unwrap());
    }

    #[test]
    fn gltf_with_damaged_numbers(edits in edits()) {
        let mut model = everything();
        let size = model.bytes.len();
        model.bytes = damaged(&model.bytes, &edits);
        model.bytes.resize(size, 0x7f);
        let text = model.text();
        survive("m.gltf", &MemorySource::new().with("m.gltf", text).unwrap());
    }

    #[test]
    fn damaged_glb(edits in edits()) {
        let bytes = damaged(&everything().glb(), &edits);
        survive("m.glb", &MemorySource::new().with("m.glb", bytes).unwrap());
    }

    #[test]
    fn damaged_nanovdb(edits in edits(), head in any::<bool>(), kind in prop::sample::select(vec![1u32, 13, 16])) {
        let draft = Draft { kind, ..Draft::new("density").filled([-3; 3], [6; 3], |p| p[0].abs() as f32) };
        let bytes = file(&[draft], 0);
        // Most bytes are empty tables: half of the damage goes to the facts at the front.
        let split = if head { 1200 } else { bytes.len() };
        let mut bad = damaged(&bytes[..split], &edits);
        bad.extend(&bytes[split..]);
        let scene = "WorldBegin\nLightSource \"infinite\"\nMakeNamedMedium \"m\" \"string type\" \"nanovdb\" \
            \"string filename\" \"a.nvdb\"\nMediumInterface \"m\" \"\"\nShape \"sphere\"";
        let files = MemorySource::new().with("s.pbrt", scene).unwrap().with("a.nvdb", bad).unwrap();
        survive("s.pbrt", &files);
    }

    #[test]
    fn damaged_obj(edits in edits(), which in any::<bool>()) {
        let (obj, mtl) = (super::obj::tests::OBJ, super::obj::tests::MTL);
        let (obj, mtl) = if which {
            (damaged(obj.as_bytes(), &edits), mtl.as_bytes().to_vec())
        } else {
            (obj.as_bytes().to_vec(), damaged(mtl.as_bytes(), &edits))
        };
        let files = MemorySource::new()
            .with("d/m.obj", obj)
            .unwrap()
            .with("d/m.mtl", mtl)
            .unwrap()
            .with("d/my picture.png", super::gltf::tests::white())
            .unwrap();
        survive("d/m.obj", &files);
    }

    #[test]
    fn damaged_ply(edits in edits(), binary in any::<bool>()) {
        let mesh = super::ply::PlyMesh {
            positions: vec![[0.0; 3], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [1.0; 3]],
            normals: vec![[0.0, 0.0, 1.0]; 4],
            uvs: vec![[0.5, 0.25]; 4],
            indices: vec![[0, 1, 2], [1, 3, 2]],
            ..super::ply::PlyMesh::default()
        };
        let ascii = b"ply\nformat ascii 1.0\nelement vertex 4\nproperty float x\nproperty float y\nproperty float z\nelement face 1\nproperty list uchar int vertex_indices\nend_header\n0 0 0\n1 0 0\n0 1 0\n1 1 1\n4 0 1 3 2\n";
        let bytes = if binary { super::ply::write(&mesh) } else { ascii.to_vec() };
        let bytes = damaged(&bytes, &edits);
        survive("m.ply", &MemorySource::new().with("m.ply", bytes).unwrap());
    }

    #[test]
    fn damaged_json(edits in edits(), picks in prop::collection::vec((0.0..1.0f64, 0..22usize), 0..3)) {
        let mut json: Value = serde_json::from_str(&crate::native::tests::matter::written()).unwrap();
        let mut places = Vec::new();
        leaves(&json, String::new(), &mut places);
        let text = if picks.is_empty() {
            damaged(json.to_string().as_bytes(), &edits)
        } else {
            for (place, value) in picks {
                let pointer = &places[(place * places.len() as f64) as usize];
                if let Some(slot) = json.pointer_mut(pointer) {
                    *slot = nasty()[value].clone();
                }
            }
            json.to_string().into_bytes()
        };
        survive("s.json", &MemorySource::new().with("s.json", text).unwrap());
    }
}
