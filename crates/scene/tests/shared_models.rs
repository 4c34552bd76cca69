//! glTF models that others wrote, where they are present: what is read agrees with what is known
//! about them from the renderer that made their reference pictures.

use glam::{DAffine3, DVec3};
use scene::assets::open;
use scene::model::{Primitive, SceneDesc, Shape};
use scene::{Overrides, load_with_files};
use std::path::{Path, PathBuf};

/// Folders with a model and its `ref.json`; none where they are absent.
fn models() -> Vec<PathBuf> {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../../shared/scenes/gltf");
    let mut found: Vec<PathBuf> = std::fs::read_dir(&root)
        .into_iter()
        .flatten()
        .flatten()
        .map(|entry| entry.path())
        .filter(|path| path.join("ref.json").is_file())
        .collect();
    found.sort();
    if found.is_empty() {
        eprintln!("skipped: no shared models beside the repository");
    }
    found
}

fn points(p: &Primitive, outer: &DAffine3, desc: &SceneDesc, out: &mut (u64, DVec3, DVec3)) {
    let Shape::Mesh(id) = p.shape else {
        panic!("glTF has meshes only")
    };
    let mesh = &desc.meshes[id.index()];
    out.0 += mesh.indices.len() as u64;
    let to = *outer * p.transform.keys[0].transform;
    for i in mesh.indices.as_flattened() {
        let p = DVec3::from_array(mesh.positions[*i as usize].map(f64::from));
        let p = to.transform_point3(p);
        out.1 = out.1.min(p);
        out.2 = out.2.max(p);
    }
}

fn measure(desc: &SceneDesc) -> (u64, DVec3, DVec3) {
    let mut out = (0, DVec3::INFINITY, DVec3::NEG_INFINITY);
    for p in &desc.primitives {
        points(p, &DAffine3::IDENTITY, desc, &mut out);
    }
    for i in &desc.instances {
        for p in &desc.groups[i.group.index()].primitives {
            points(p, &i.transform.keys[0].transform, desc, &mut out);
        }
    }
    out
}

#[test]
fn models_are_read_as_their_references_say() {
    for folder in models() {
        let text = std::fs::read_to_string(folder.join("ref.json")).unwrap();
        let known: serde_json::Value = serde_json::from_str(&text).unwrap();
        let (assets, main) = open(&folder).unwrap();
        assert_eq!(known["model"], main.as_str());
        let loaded = load_with_files(&main, &*assets, &Overrides::default())
            .unwrap_or_else(|e| panic!("{main}: {e}"));
        let (triangles, low, high) = measure(&loaded.desc);
        println!(
            "{main}: {} meshes, {triangles} triangles, {} materials, {} pictures, {} lights, {} files",
            loaded.desc.meshes.len(),
            loaded.desc.materials.len(),
            loaded.desc.images.len(),
            loaded.desc.lights.len(),
            loaded.files.len(),
        );
        for d in &loaded.diagnostics {
            println!("  {d}");
        }
        let dropped: u64 = loaded
            .diagnostics
            .iter()
            .filter_map(|d| {
                d.reason
                    .strip_suffix(" triangles without area are left out")
            })
            .map(|n| n.parse::<u64>().unwrap())
            .sum();
        assert_eq!(
            known["triangles_instanced"].as_u64(),
            Some(triangles + dropped),
            "{main}"
        );
        let corner = |name: &str| {
            DVec3::from_array(std::array::from_fn(|i| known[name][i].as_f64().unwrap()))
        };
        let size = (high - low).length();
        for (got, want) in [(low, corner("bounds_min")), (high, corner("bounds_max"))] {
            assert!(
                (got - want).length() < 1e-3 * size,
                "{main}: {got} for {want}"
            );
        }
    }
}

/// Through Brolly's own format and back: the same but for the pictures, which get files of their own.
#[test]
fn written_models_read_back_equal() {
    for folder in models() {
        let (assets, main) = open(&folder).unwrap();
        let desc = load_with_files(&main, &*assets, &Overrides::default())
            .unwrap()
            .desc;
        let written = scene::native::write(&desc, &*assets).unwrap();
        let mut copy = scene::assets::MemorySource::new()
            .with("scene.json", &written.json)
            .unwrap();
        for (path, bytes) in written.files {
            copy.insert(&path, bytes).unwrap();
        }
        let again = load_with_files("scene.json", &copy, &Overrides::default()).unwrap();
        let content = |desc: &SceneDesc, source: &dyn scene::AssetSource| -> Vec<_> {
            let bytes = |i: &scene::model::ImageDesc| match &i.bytes {
                Some(bytes) => bytes.clone(),
                None => source.read(&i.path).unwrap(),
            };
            let images = desc.images.iter();
            images.map(|i| (i.encoding, bytes(i))).collect()
        };
        assert!(
            content(&desc, &*assets) == content(&again.desc, &copy),
            "the pictures of {main} changed"
        );
        let plain = |mut desc: SceneDesc| {
            desc.images.clear();
            desc
        };
        assert!(
            plain(again.desc) == plain(desc),
            "{main} changed on its way through JSON"
        );
    }
}
