//! What scripts rely on: exit codes, stdout, fields.

use crate::support::{Brolly, TestFarm, TestScene, Tuning, brolly};
use protocol::JobState;
use std::io::Read;
use std::net::TcpListener;

fn text(path: &std::path::Path) -> String {
    path.to_str().expect("a UTF-8 path").to_owned()
}

#[test]
fn exit_codes() {
    let scene = TestScene::room(16, 16);
    let broken = TestScene::room(16, 16);
    broken.replace(
        "Shape \"sphere\"",
        "Shape \"sphere\" \"float radius\" [\"x\"]",
    );
    let (good, broken) = (text(&scene.main()), text(&broken.main()));
    // A port that was free a moment ago: nobody listens.
    let closed = TcpListener::bind("127.0.0.1:0").unwrap();
    let nobody = format!("http://{}", closed.local_addr().unwrap());
    drop(closed);
    let id = "01890000-0000-7000-8000-000000000000";
    let check = |args: &[&str], code: i32, stderr: &str| {
        let run = brolly(args, &[]);
        assert_eq!(run.code, code, "{args:?}: {}", run.stderr);
        assert!(run.stderr.contains(stderr), "{args:?}: {}", run.stderr);
        run
    };
    check(&["info"], 0, "");
    check(&["--version"], 0, "");
    check(&[], 2, "Usage");
    check(&["render"], 2, "SCENE");
    check(&["render", &good, "--spp", "none"], 2, "--spp");
    check(&["extend", id], 2, "--spp");
    check(&["render", "/nowhere/scene.pbrt"], 1, "nowhere");
    check(&["render", &good, "-o", "/nowhere/a.png"], 1, "nowhere");
    check(&["render", &good, "--size", "70000x1"], 1, "65536");
    let run = check(&["render", &broken], 1, "scene.pbrt:");
    assert_eq!(run.stdout, "");
    check(&["submit", &good, "--to", &nobody], 3, "cannot be reached");
    check(&["jobs", "--to", &nobody], 3, "cannot be reached");
    check(&["info", "--health", &nobody], 3, "cannot be reached");
    check(&["jobs", "--to", "https://x"], 2, "http");

    let run = brolly(&["check", &broken], &[]);
    assert_eq!(run.code, 1);
    let places = run.stdout.lines().filter(|l| l.starts_with("scene.pbrt:"));
    assert!(places.count() > 0, "{}", run.stdout);
    assert_eq!(brolly(&["check", &good], &[]).code, 0);
}

#[test]
fn render_json_has_exactly_these_fields() {
    let scene = TestScene::room(24, 16);
    let (png, exr) = (scene.folder().join("a.png"), scene.folder().join("b.exr"));
    let args = [
        "render",
        &text(&scene.main()),
        "--spp",
        "4",
        "--json",
        "-o",
        &text(&png),
        "-o",
        &text(&exr),
    ];
    let run = brolly(&args, &[]);
    assert_eq!(run.code, 0, "{}", run.stderr);
    let report: serde_json::Value = serde_json::from_str(&run.stdout).expect("one object");
    let fields: Vec<&str> = report
        .as_object()
        .unwrap()
        .keys()
        .map(String::as_str)
        .collect();
    let mut expect = vec![
        "job",
        "width",
        "height",
        "spp",
        "samples",
        "rays",
        "prepare_seconds",
        "render_seconds",
        "cpu_seconds",
        "error",
        "error_kind",
        "warnings",
    ];
    expect.sort_unstable();
    let mut fields = fields;
    fields.sort_unstable();
    assert_eq!(fields, expect);
    assert_eq!(report["width"], 24);
    assert_eq!(report["samples"], 24 * 16 * 4);
    assert!(report["cpu_seconds"].as_f64().unwrap() > 0.0);
    assert!(std::fs::read(png).unwrap().starts_with(b"\x89PNG"));
    assert!(
        std::fs::read(exr)
            .unwrap()
            .starts_with(&[0x76, 0x2f, 0x31, 0x01])
    );
    let left: Vec<_> = std::fs::read_dir(scene.folder())
        .unwrap()
        .filter(|e| {
            e.as_ref()
                .unwrap()
                .path()
                .extension()
                .is_some_and(|e| e == "part")
        })
        .collect();
    assert!(left.is_empty());
}

/// A job from submission to deletion, by commands alone.
#[tokio::test(flavor = "multi_thread")]
async fn a_job_by_commands() {
    let scene = TestScene::room(24, 16);
    let out = text(&scene.folder().join("out.png"));
    let mut farm = TestFarm::start().await;
    farm.worker(1);
    let url = farm.url.clone();
    let main = text(&scene.main());
    let run = |args: &[&str]| {
        let args = [args, &["--to", &url]].concat();
        let run = brolly(&args, &[]);
        assert_eq!(run.code, 0, "{args:?}: {}", run.stderr);
        run.stdout
    };
    tokio::task::block_in_place(|| {
        let id = run(&[
            "submit", &main, "--spp", "4", "--name", "a name", "-o", &out,
        ]);
        let id = id.strip_suffix('\n').expect("a line").to_owned();
        assert_eq!(id.len(), 36, "the id alone: {id:?}");
        assert!(std::fs::read(&out).unwrap().starts_with(b"\x89PNG"));
        assert!(run(&["jobs"]).contains(&id));
        assert!(run(&["jobs", "--state", "done"]).contains("a name"));
        assert!(!run(&["jobs", "--state", "failed"]).contains(&id));
        assert!(run(&["show", &id]).contains("done"));
        let shown: serde_json::Value =
            serde_json::from_str(&run(&["show", &id, "--json"])).expect("an object");
        assert_eq!(shown["spp"], 4.0);
        run(&["watch", &id]);
        run(&["extend", &id, "--spp", "8"]);
        run(&["watch", &id]);
        let albedo = text(&scene.folder().join("albedo.exr"));
        run(&["fetch", &id, "-o", &albedo, "--layer", "albedo"]);
        assert!(std::fs::metadata(albedo).unwrap().len() > 0);
        let looser = brolly(&["extend", &id, "--spp", "2", "--to", &url], &[]);
        assert_eq!(looser.code, 1);
        let unknown = "01890000-0000-7000-8000-000000000000";
        assert_eq!(brolly(&["show", unknown, "--to", &url], &[]).code, 1);
    });
}

/// The environment stands in for flags.
#[test]
fn variables_work_as_flags() {
    let data = tempfile::tempdir().unwrap();
    let (_server, port) = Brolly::serve(data.path(), 0);
    let url = format!("http://127.0.0.1:{port}");
    let run = brolly(&["jobs"], &[("BROLLY_URL", &url)]);
    assert_eq!((run.code, run.stdout.as_str()), (0, ""), "{}", run.stderr);
    let health = brolly(&["info", "--health", &url, "--json"], &[]);
    assert_eq!(health.code, 0, "{}", health.stderr);
    let info: serde_json::Value = serde_json::from_str(&health.stdout).expect("an object");
    assert_eq!(info["engine_version"], film::ENGINE_VERSION.0);
    // One process holds a data folder.
    let second = brolly(
        &[
            "serve",
            "--listen",
            "127.0.0.1:0",
            "--data",
            &text(data.path()),
        ],
        &[],
    );
    assert_eq!(second.code, 1, "{}", second.stderr);
    // Off loopback without tokens.
    let other = tempfile::tempdir().unwrap();
    let open = brolly(
        &[
            "serve",
            "--listen",
            "0.0.0.0:0",
            "--data",
            &text(other.path()),
        ],
        &[],
    );
    assert_eq!(open.code, 1, "{}", open.stderr);
    assert!(open.stderr.contains("token"), "{}", open.stderr);
}

#[test]
fn interrupted_render_ends_with_130() {
    let scene = TestScene::room(128, 128);
    let mut render = Brolly::start(&["render", &text(&scene.main()), "--spp", "1000000"]);
    // Its workers register once all is up.
    while !render.log().contains("registered") {
        std::thread::sleep(std::time::Duration::from_millis(20));
    }
    render.signal("INT");
    assert_eq!(render.wait(), 130, "{}", render.log());
}

/// A cancelled job is told apart from a picture.
#[tokio::test(flavor = "multi_thread")]
async fn waiting_for_a_cancelled_job_fails() {
    let scene = TestScene::room(24, 16);
    let farm = TestFarm::start().await;
    let id = farm.submit(&scene, &Tuning::spp(4)).await;
    let (url, shown) = (farm.url.clone(), id.to_string());
    farm.client.cancel(id).await.unwrap();
    assert_eq!(farm.ends(id).await.state, JobState::Cancelled);
    let run = tokio::task::block_in_place(|| brolly(&["watch", &shown, "--to", &url], &[]));
    assert_eq!(run.code, 1, "{}", run.stderr);
    assert!(run.stderr.contains("cancelled"), "{}", run.stderr);
}

/// Stdout that is closed early is no crash.
#[test]
fn a_closed_pipe_is_no_error() {
    use std::process::{Command, Stdio};
    let mut child = Command::new(env!("CARGO_BIN_EXE_brolly-under-test"))
        .arg("info")
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    drop(child.stdout.take());
    let mut stderr = String::new();
    child
        .stderr
        .take()
        .unwrap()
        .read_to_string(&mut stderr)
        .unwrap();
    assert_eq!(child.wait().unwrap().code(), Some(0), "{stderr}");
    assert!(!stderr.contains("panicked"), "{stderr}");
}
