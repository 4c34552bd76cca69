//! `brolly check`: every error and warning of a scene.

use super::{print_json, print_line};
use crate::args::CheckArgs;
use crate::scene_files;
use scene::{Diagnostic, Overrides, SceneError};
use serde::Serialize;
use std::process::ExitCode;

#[derive(Serialize)]
struct Report<'a> {
    ok: bool,
    findings: &'a [Diagnostic],
}

pub fn run(args: CheckArgs) -> anyhow::Result<ExitCode> {
    let opened = scene_files::open(&args.scene, &args.look, |look| Overrides {
        look,
        allow_missing: args.allow_missing,
        ..Overrides::default()
    });
    let (ok, findings) = match opened {
        Ok(scene) => (true, scene.warnings),
        Err(error) => match error.downcast::<SceneError>() {
            Ok(error) => (false, error.diagnostics),
            Err(error) => return Err(error),
        },
    };
    if args.json {
        print_json(&Report {
            ok,
            findings: &findings,
        })?;
    } else {
        for finding in &findings {
            print_line(&finding.to_string())?;
        }
    }
    Ok(ExitCode::from(u8::from(!ok)))
}
