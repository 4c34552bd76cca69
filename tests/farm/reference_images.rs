//! Pictures against references of another renderer, where they are to be had.

use crate::support::brolly;
use film::compare::compare;
use film::output::read::read_picture;
use std::path::PathBuf;

/// Beside the repository, or wherever the variable says.
fn scenes() -> PathBuf {
    std::env::var_os("BROLLY_BENCH_SCENES").map_or_else(
        || {
            PathBuf::from(concat!(
                env!("CARGO_MANIFEST_DIR"),
                "/../../shared/bench/scenes"
            ))
        },
        PathBuf::from,
    )
}

/// Few samples, so the picture is noisy; its mean is not, and a wrong light or material moves that.
#[test]
fn means_agree_with_the_references() {
    let Ok(entries) = std::fs::read_dir(scenes()) else {
        eprintln!("SKIPPED: no reference scenes in {}", scenes().display());
        return;
    };
    let out = tempfile::tempdir().unwrap();
    let mut folders: Vec<PathBuf> = entries.flatten().map(|e| e.path()).collect();
    folders.sort();
    let mut wrong = Vec::new();
    for folder in folders {
        let Ok(reference) = std::fs::read(folder.join("ref.exr")) else {
            continue;
        };
        let name = folder.file_name().unwrap().to_string_lossy().into_owned();
        let picture = out.path().join(format!("{name}.exr"));
        let args = [
            "render",
            folder.to_str().unwrap(),
            "--spp",
            "16",
            "-o",
            picture.to_str().unwrap(),
        ];
        let run = brolly(&args, &[]);
        if run.stderr.contains("no such file") {
            eprintln!("SKIPPED: {name} is not complete there");
            continue;
        }
        if run.code != 0 {
            wrong.push(format!("{name}: exit {}: {}", run.code, run.stderr));
            continue;
        }
        let ours = read_picture(&std::fs::read(picture).unwrap()).unwrap();
        let reference = read_picture(&reference).unwrap();
        let difference = compare(&ours, &reference).unwrap();
        let (a, b) = difference.means();
        eprintln!(
            "{name}: mean {a:.5} against {b:.5}, relMSE {:.4}",
            difference.relmse
        );
        if difference.not_finite > 0 || (a / b - 1.0).abs() > 0.03 {
            wrong.push(format!("{name}: mean {a:.5} against {b:.5}"));
        }
    }
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
}
