//! `brolly convert`: any scene as Brolly's own JSON, with the same bits when rendered.

use crate::args::ConvertArgs;
use crate::scene_files;
use anyhow::Context;
use scene::Overrides;
use std::path::{Path, PathBuf};
use std::process::ExitCode;

pub fn run(args: ConvertArgs) -> anyhow::Result<ExitCode> {
    let scene = scene_files::open(&args.scene, &args.look, |look| Overrides {
        look,
        allow_missing: args.allow_missing,
        ..Overrides::default()
    })?;
    for warning in &scene.warnings {
        eprintln!("{warning}");
    }
    let written = scene::native::write(&scene.desc, &*scene.source)?;
    let main = main_file(&args.output);
    let folder = main.parent().unwrap_or(Path::new(""));
    for (path, bytes) in &written.files {
        // Names come from the scene: one that leaves the folder is refused here as everywhere.
        let path = folder.join(scene::assets::normalize(path)?);
        write(&path, bytes)?;
    }
    write(&main, written.json.as_bytes())?;
    Ok(ExitCode::SUCCESS)
}

/// `FILE.json` as it is, else a folder that gets `scene.json`.
fn main_file(output: &Path) -> PathBuf {
    let json = output
        .extension()
        .is_some_and(|extension| extension.eq_ignore_ascii_case("json"));
    if json && !output.is_dir() {
        output.to_owned()
    } else {
        output.join("scene.json")
    }
}

fn write(path: &Path, bytes: &[u8]) -> anyhow::Result<()> {
    let fail = || format!("{} cannot be written", path.display());
    if let Some(folder) = path.parent().filter(|p| !p.as_os_str().is_empty()) {
        std::fs::create_dir_all(folder).with_context(fail)?;
    }
    std::fs::write(path, bytes).with_context(fail)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn folders_get_a_scene_json() {
        assert_eq!(main_file(Path::new("a/b.json")), Path::new("a/b.json"));
        assert_eq!(main_file(Path::new("a")), Path::new("a/scene.json"));
        assert_eq!(main_file(Path::new("a.b")), Path::new("a.b/scene.json"));
    }
}
