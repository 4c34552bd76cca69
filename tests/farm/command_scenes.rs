//! Scenes as people hand them over: in archives, converted, under a sky of their own, as animations.

use crate::support::{TestFarm, TestScene, brolly};
use std::io::Write;
use std::path::Path;

/// A ball that moves a radius with every frame.
const ANIMATION: &str = r#"{
  "brolly": 1,
  "camera": {"look_from": [0, 0, 4], "look_at": [0, 0, 0], "vfov": 50},
  "film": {"size": [24, 16]},
  "animation": {"fps": 1, "start": 0, "frames": [0, 3]},
  "materials": {"wall": {"bsdf": {"diffuse": {"reflectance": 0.5}}}},
  "primitives": [{
    "shape": {"sphere": {"radius": 0.5}},
    "material": "wall",
    "emission": {"radiance": 1},
    "transform": {"keys": [
      {"time": 0, "transform": [{"translate": [-1, 0, 0]}]},
      {"time": 4, "transform": [{"translate": [1, 0, 0]}]}
    ]}
  }]
}"#;

fn text(path: &Path) -> String {
    path.to_str().expect("a UTF-8 path").to_owned()
}

/// Runs a command that has to succeed; returns its stdout.
fn run(args: &[&str]) -> String {
    let run = brolly(args, &[]);
    assert_eq!(run.code, 0, "{args:?}: {}", run.stderr);
    run.stdout
}

/// Renders two samples of a scene to EXR.
fn rendered(scene: &Path, more: &[&str]) -> Vec<u8> {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("out.exr");
    let (scene, path) = (text(scene), text(&out));
    run(&[&["render", &scene, "--spp", "2", "-o", &path], more].concat());
    std::fs::read(out).unwrap()
}

#[test]
fn frames_are_written_one_by_one() {
    let folder = tempfile::tempdir().unwrap();
    let scene = folder.path().join("ball.json");
    std::fs::write(&scene, ANIMATION).unwrap();
    let out = |name: &str| folder.path().join(name);
    let (scene, exr, png) = (text(&scene), text(&out("a.exr")), text(&out("b-####.png")));
    let ball = ["render", &scene, "--spp", "2", "--json"];
    let report = run(&[&ball[..], &["--frames", "1-3", "-o", &exr, "-o", &png]].concat());
    let report: serde_json::Value = serde_json::from_str(&report).unwrap();
    assert_eq!(report["samples"], 3 * 24 * 16 * 2);
    let read = |name: &str| std::fs::read(out(name)).unwrap_or_else(|e| panic!("{name}: {e}"));
    let frames = ["a.0001.exr", "a.0002.exr", "a.0003.exr"].map(read);
    let shown = ["b-0001.png", "b-0002.png", "b-0003.png"].map(read);
    for (a, b) in [(0, 1), (1, 2), (0, 2)] {
        assert!(frames[a] != frames[b] && shown[a] != shown[b], "it moves");
    }
    assert!(!out("a.0000.exr").exists() && !out("a.0004.exr").exists());
    // A frame alone is the frame of the sequence, under the name that was given.
    let alone = text(&out("alone.exr"));
    run(&[&ball[..], &["--frames", "2", "-o", &alone]].concat());
    assert!(read("alone.exr") == frames[1]);
}

#[test]
fn archives_and_conversions_have_the_same_bits() {
    let scene = TestScene::room(24, 16);
    let expect = rendered(&scene.main(), &[]);
    let elsewhere = tempfile::tempdir().unwrap();
    let archive = elsewhere.path().join("room.zip");
    let mut zip = zip::ZipWriter::new(std::fs::File::create(&archive).unwrap());
    for name in ["scene.pbrt", "floor.ply"] {
        zip.start_file(name, zip::write::SimpleFileOptions::default())
            .unwrap();
        zip.write_all(&std::fs::read(scene.folder().join(name)).unwrap())
            .unwrap();
    }
    zip.finish().unwrap();
    assert!(rendered(&archive, &[]) == expect, "from an archive");
    let json = elsewhere.path().join("room.json");
    for output in [&json, &elsewhere.path().join("folder")] {
        run(&["convert", &text(&scene.main()), "-o", &text(output)]);
        assert!(rendered(output, &[]) == expect, "{}", output.display());
    }
}

/// The sky travels to the workers like any other file, and `watch --json` tells of it line by line.
#[tokio::test(flavor = "multi_thread")]
async fn a_sky_of_ones_own_on_a_farm() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name);
    std::fs::write(path("ball.json"), ANIMATION).unwrap();
    // Two by one pixels, red and blue: mantissas and exponent.
    let mut sky = b"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y 1 +X 2\n".to_vec();
    sky.extend([200, 10, 10, 129, 10, 10, 200, 129]);
    std::fs::write(path("sky.hdr"), sky).unwrap();
    let mut farm = TestFarm::start().await;
    farm.worker(1);
    let url = farm.url.clone();
    tokio::task::block_in_place(|| {
        let (scene, sky, out) = (
            text(&path("ball.json")),
            text(&path("sky.hdr")),
            text(&path("out.exr")),
        );
        let under = ["--env", &sky, "--env-rotate", "90"];
        let submit = ["submit", &scene, "--spp", "2", "--to", &url];
        let id = run(&[&submit[..], &under, &["-o", &out]].concat());
        let got = std::fs::read(path("out.exr")).unwrap();
        assert!(got == rendered(&path("ball.json"), &under));
        assert!(got != rendered(&path("ball.json"), &[]), "the sky is seen");
        let lines = run(&["watch", id.trim(), "--json", "--to", &url]);
        let last = lines.lines().next_back().expect("at least how it ended");
        let last: serde_json::Value = serde_json::from_str(last).expect("an object a line");
        assert_eq!(
            (&last["state"], &last["id"]),
            (&"done".into(), &id.trim().into())
        );
    });
}
