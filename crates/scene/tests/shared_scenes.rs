//! Scenes that others wrote, where they are present: every one must load without an error.

use scene::assets::open;
use scene::{Overrides, load, load_with_files};
use std::path::{Path, PathBuf};

/// Scene files below a folder beside the repository; none where that is absent.
fn shared(folder: &str, ending: &str) -> Vec<PathBuf> {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"))
        .join("../../../shared")
        .join(folder);
    let mut found: Vec<PathBuf> = std::fs::read_dir(&root)
        .into_iter()
        .flatten()
        .flatten()
        .filter_map(|entry| std::fs::read_dir(entry.path()).ok())
        .flat_map(|files| files.flatten().map(|file| file.path()))
        .filter(|path| path.extension().is_some_and(|e| e == ending))
        .collect();
    found.sort();
    if found.is_empty() {
        eprintln!("skipped: no shared scenes beside the repository");
    }
    found
}

fn pbrt_scenes() -> Vec<PathBuf> {
    let mut scenes = shared("bench/scenes", "pbrt");
    scenes.extend(shared("scenes/pbrt", "pbrt"));
    scenes
}

#[test]
fn written_scenes_read_back_equal() {
    for path in pbrt_scenes() {
        let (assets, main) = open(&path).unwrap();
        let Ok((desc, _)) = load(&main, &*assets, &Overrides::default()) else {
            continue;
        };
        let written = scene::native::write(&desc, &*assets).unwrap();
        let mut copy = scene::assets::MemorySource::new()
            .with("scene.json", &written.json)
            .unwrap();
        for (path, bytes) in written.files {
            copy.insert(&path, bytes).unwrap();
        }
        let (again, diagnostics) = load("scene.json", &copy, &Overrides::default()).unwrap();
        assert_eq!(diagnostics, [], "{}", path.display());
        // Not `assert_eq`: nobody wants to see the difference of two such things in full.
        assert!(
            again == desc,
            "{} changed on its way through JSON",
            path.display()
        );
    }
}

#[test]
fn pbrt_scenes_load() {
    for path in pbrt_scenes() {
        let (assets, main) = open(&path).unwrap();
        let loaded = match load_with_files(&main, &*assets, &Overrides::default()) {
            Ok(loaded) => loaded,
            // Large meshes of one scene are made by its own set-up, not kept.
            Err(e) if e.to_string().contains("no such file") => {
                eprintln!("skipped {}: {e}", path.display());
                continue;
            }
            Err(e) => panic!("{}: {e}", path.display()),
        };
        let triangles: usize = loaded.desc.meshes.iter().map(|m| m.indices.len()).sum();
        println!(
            "{}: {} primitives, {} triangles, {} lights, {} files",
            path.display(),
            loaded.desc.primitives.len(),
            triangles,
            loaded.desc.lights.len(),
            loaded.files.len()
        );
        for d in &loaded.diagnostics {
            println!("  {d}");
        }
    }
}
