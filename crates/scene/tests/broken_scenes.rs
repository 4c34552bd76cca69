//! Every file in `scenes/broken` is refused with the reason that stands beside it.

use scene::assets::DirSource;
use scene::{Overrides, load};
use std::path::Path;

#[test]
fn broken_scenes_are_refused() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../scenes/broken");
    let assets = DirSource::new(&folder).unwrap();
    let expected = std::fs::read_to_string(folder.join("expected.txt")).unwrap();
    for line in expected.lines() {
        let (file, reason) = line.split_once('\t').unwrap();
        match load(file, &assets, &Overrides::default()) {
            Ok(_) => panic!("{file} was accepted"),
            Err(error) => {
                let all: Vec<String> = error
                    .diagnostics
                    .iter()
                    .map(|d| format!("{}: {}", d.place, d.reason))
                    .collect();
                assert!(
                    all.iter().any(|d| d.contains(reason)),
                    "{file}: {all:#?}, expected {reason}"
                );
            }
        }
    }
    let listed = |name: &str| {
        expected
            .lines()
            .any(|line| line.split('\t').next() == Some(name))
    };
    for entry in std::fs::read_dir(&folder).unwrap().flatten() {
        let name = entry.file_name().into_string().unwrap();
        assert!(
            ![".json", ".pbrt", ".gltf", ".obj"]
                .iter()
                .any(|ending| name.ends_with(ending))
                || listed(&name),
            "{name} is not in expected.txt"
        );
    }
}
