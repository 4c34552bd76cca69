//! The way in: from a main file to a checked scene.

use crate::apply::Done;
use crate::assets::{AssetSource, RecordingSource, normalize};
use crate::context::{Context, Issue};
use crate::diagnostic::{Diagnostic, Place, SceneError, Severity};
use crate::import::{Imported, stage};
use crate::model::SceneDesc;
use crate::overrides::Overrides;
use std::collections::BTreeSet;

/// A scene, what there is to say about it, and the files that it uses: those that were read, and the
/// pictures that the tracer will read.
#[derive(Clone, Debug)]
pub struct Loaded {
    /// The scene.
    pub desc: SceneDesc,
    /// Warnings.
    pub diagnostics: Vec<Diagnostic>,
    /// Paths in the source, the main file among them.
    pub files: BTreeSet<String>,
}

/// Reads a scene, applies the overrides and checks the result. `main` is a path of the source.
pub fn load(
    main: &str,
    assets: &dyn AssetSource,
    overrides: &Overrides,
) -> Result<(SceneDesc, Vec<Diagnostic>), SceneError> {
    load_with_files(main, assets, overrides).map(|loaded| (loaded.desc, loaded.diagnostics))
}

/// The same, and which files the scene uses, so that only those need to travel.
pub fn load_with_files(
    main: &str,
    assets: &dyn AssetSource,
    overrides: &Overrides,
) -> Result<Loaded, SceneError> {
    let place = Place {
        file: main.to_owned(),
        ..Place::default()
    };
    let main = normalize(main).map_err(|e| SceneError::one(place.clone(), e.to_string()))?;
    let recorder = RecordingSource::new(assets);
    let mut cx = Context::new(&main, &recorder, overrides.allow_missing);
    let ending = main
        .rsplit_once('.')
        .map(|(_, e)| e.to_ascii_lowercase())
        .unwrap_or_default();
    // Formats whose files always have a view of their own.
    let whole = |desc: SceneDesc| (desc, None);
    // Formats whose files may lack a camera and light.
    let partial = |imported: Imported| (imported.desc, Some(imported.has_camera));
    let look = &overrides.look;
    let result = match ending.as_str() {
        "json" => crate::native::import(&main, &mut cx).map(whole),
        "pbrt" => crate::import::pbrt::import(&main, &mut cx).map(whole),
        "gltf" | "glb" => crate::import::gltf::import(&main, &mut cx, look).map(partial),
        "obj" => crate::import::obj::import(&main, &mut cx).map(partial),
        "ply" => crate::import::ply_scene(&main, &mut cx).map(partial),
        _ => {
            let reason = "not a scene: expected a .json, .pbrt, .gltf, .glb, .obj or .ply file";
            return Err(SceneError::one(place, reason));
        }
    };
    let (mut desc, partial) = match result {
        Ok(result) => result,
        Err(issue) => {
            cx.error(issue);
            let diagnostics = cx.finish()?;
            return Err(SceneError { diagnostics });
        }
    };
    // What failed to be read would only be reported again as missing.
    if cx.has_errors() {
        let diagnostics = cx.finish()?;
        return Err(SceneError { diagnostics });
    }
    desc.meshes = std::mem::take(&mut cx.meshes);
    let mut done = Done::default();
    if let Some(has_camera) = partial {
        done.names = matches!(ending.as_str(), "gltf" | "glb");
        if !has_camera {
            done.target = stage::frame(&mut desc, look, overrides.size);
        }
        let sky = stage::sky(&mut desc, look, &main, &mut cx);
        cx.keep(sky);
    }
    crate::apply::apply(&mut desc, overrides, done, &mut cx);
    desc.images = std::mem::take(&mut cx.images);
    crate::validate::drop_degenerate(&mut desc, &mut cx);
    for finding in crate::validate::validate(&desc) {
        let Diagnostic {
            severity,
            mut place,
            reason,
        } = finding;
        if place.file.is_empty() {
            place.file.clone_from(&main);
        }
        match severity {
            Severity::Warning => cx.warn(&place, reason),
            Severity::Error => cx.error(Issue { place, reason }),
        }
    }
    let diagnostics = cx.finish()?;
    Ok(Loaded {
        desc,
        diagnostics,
        files: recorder.used(),
    })
}
