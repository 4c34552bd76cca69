//! From what a user names to a source and its main file.

use super::{AssetError, AssetSource, DirSource, ZipSource};
use crate::diagnostic::{Place, SceneError};
use std::path::Path;

/// What a main file may end in: scenes proper before models, and these before meshes, which are
/// mostly parts of the others.
const EXTENSIONS: [&[&str]; 3] = [&["json", "pbrt", "gltf", "glb"], &["obj"], &["ply"]];

fn extension(name: &str) -> Option<String> {
    Some(name.rsplit_once('.')?.1.to_ascii_lowercase())
}

/// Which file of a folder or archive is the scene: `scene.*` wins, else there must be exactly one at
/// the top (or in the one folder at the top, as archives often have). Foreign scenes travel with
/// JSON notes beside them, so a `.json` under another name counts only where nothing else does.
pub fn find_main(listing: &[String]) -> Result<String, String> {
    let mut top = "";
    loop {
        let here: Vec<&str> = listing
            .iter()
            .filter_map(|path| path.strip_prefix(top))
            .collect();
        let ending_in = |endings: &[&str]| -> Vec<&str> {
            let fits = |name: &str| extension(name).is_some_and(|e| endings.contains(&e.as_str()));
            let files = here.iter().copied();
            files.filter(|n| !n.contains('/') && fits(n)).collect()
        };
        let mut found = EXTENSIONS
            .iter()
            .map(|endings| ending_in(endings))
            .find(|found| !found.is_empty())
            .unwrap_or_default();
        if found.iter().any(|name| name.starts_with("scene.")) {
            found.retain(|name| name.starts_with("scene."));
        } else if found.iter().any(|name| !name.ends_with(".json")) {
            found.retain(|name| !name.ends_with(".json"));
        }
        match found.as_slice() {
            [only] => return Ok(format!("{top}{only}")),
            [] => {
                let first = here
                    .first()
                    .and_then(|path| path.split_once('/'))
                    .map(|(folder, _)| folder);
                match first {
                    Some(folder)
                        if here
                            .iter()
                            .all(|p| p.split_once('/').is_some_and(|(f, _)| f == folder)) =>
                    {
                        top = &listing[0][..top.len() + folder.len() + 1];
                    }
                    _ => {
                        return Err(
                            "no scene in it: expected a .json, .pbrt, .gltf, .glb, .obj or .ply file"
                                .into(),
                        );
                    }
                }
            }
            several => {
                return Err(format!(
                    "several scenes in it ({}): name one of them",
                    several.join(", ")
                ));
            }
        }
    }
}

/// Opens what a user named: a scene file, a folder or a `.zip`. Returns the source and the path of
/// the main file in it.
pub fn open(path: &Path) -> Result<(Box<dyn AssetSource>, String), SceneError> {
    let shown = path.display().to_string();
    let fail = |reason: String| {
        SceneError::one(
            Place {
                file: shown.clone(),
                ..Place::default()
            },
            reason,
        )
    };
    let asset = |e: AssetError| match e {
        AssetError::Unreadable { reason, .. } | AssetError::Refused { reason, .. } => fail(reason),
        other => fail(other.to_string()),
    };
    let about = path.metadata().map_err(|e| fail(e.to_string()))?;
    let name = path
        .file_name()
        .map(|n| n.to_string_lossy().into_owned())
        .unwrap_or_default();
    let source: Box<dyn AssetSource> = if about.is_dir() {
        Box::new(DirSource::new(path).map_err(asset)?)
    } else if extension(&name).as_deref() == Some("zip") {
        Box::new(ZipSource::open(path).map_err(asset)?)
    } else {
        let folder = path
            .parent()
            .filter(|p| !p.as_os_str().is_empty())
            .unwrap_or(Path::new("."));
        return Ok((Box::new(DirSource::new(folder).map_err(asset)?), name));
    };
    let main = find_main(&source.list()).map_err(fail)?;
    Ok((source, main))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_main_file_is_found() {
        let check = |files: &[&str], expect: Result<&str, &str>| {
            let listing: Vec<String> = files.iter().map(|f| f.to_string()).collect();
            match (find_main(&listing), expect) {
                (Ok(got), Ok(want)) => assert_eq!(got, want),
                (Err(got), Err(want)) => assert!(got.contains(want), "{got}"),
                (got, _) => panic!("{files:?}: {got:?}, expected {expect:?}"),
            }
        };
        check(&["a.ply", "cornell.pbrt"], Ok("cornell.pbrt"));
        check(
            &["other.pbrt", "scene.pbrt", "x/scene.json"],
            Ok("scene.pbrt"),
        );
        check(&["ToyCar.gltf", "metadata.json"], Ok("ToyCar.gltf"));
        check(&["room/a.ply", "room/room.pbrt"], Ok("room/room.pbrt"));
        check(&["a/b/c.glb"], Ok("a/b/c.glb"));
        check(&["a.obj", "a.mtl", "b.ply"], Ok("a.obj"));
        check(&["a.ply", "texture.png"], Ok("a.ply"));
        check(&["a.pbrt", "b.pbrt"], Err("several"));
        check(&["scene.json", "scene.pbrt"], Err("several"));
        check(&["x/a.pbrt", "y/b.pbrt"], Err("no scene"));
        check(&["readme"], Err("no scene"));
        check(&[], Err("no scene"));
    }
}
