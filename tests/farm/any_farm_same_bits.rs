//! The same picture from any farm.

use crate::support::{TestScene, Tuning, brolly, outcome};

#[tokio::test(flavor = "multi_thread")]
async fn any_workers_same_bits() {
    let scene = TestScene::room(100, 70);
    let tuning = Tuning::spp(16);
    let one = outcome(&[1], &scene, &tuning).await;
    assert_eq!(one.samples, 100 * 70 * 16);
    for farm in [&[2, 2, 2][..], &[1; 7], &[5, 1]] {
        assert_eq!(
            outcome(farm, &scene, &tuning).await,
            one,
            "workers {farm:?}"
        );
    }
}

/// A level that the processor lacks falls back to a lower one, so each run proves something
/// wherever it can. Guided paths are trained by each worker for itself.
#[test]
fn every_simd_level_gives_the_same_bits() {
    let scene = TestScene::room(70, 40);
    let main = scene.main();
    let main = main.to_str().unwrap();
    for integrator in ["path", "guided"] {
        let mut pictures = Vec::new();
        for (i, level) in ["scalar", "sse2", "avx2", "avx512"].into_iter().enumerate() {
            let out = scene.folder().join(format!("{integrator}-{level}.exr"));
            let out = out.to_str().unwrap();
            let workers = (i % 2 + 1).to_string();
            let run = brolly(
                &[
                    "render",
                    main,
                    "-o",
                    out,
                    "--spp",
                    "8",
                    "--integrator",
                    integrator,
                    "--workers",
                    &workers,
                    "--threads",
                    "1",
                ],
                &[("BROLLY_SIMD", level)],
            );
            assert_eq!(run.code, 0, "{integrator} at {level}: {}", run.stderr);
            let used = brolly(&["info"], &[("BROLLY_SIMD", level)]).stdout;
            let used = used
                .lines()
                .find(|l| l.contains("SIMD"))
                .unwrap_or_default();
            eprintln!("asked for {level}: {used}");
            pictures.push((level, std::fs::read(out).unwrap()));
        }
        for (level, picture) in &pictures[1..] {
            let same = *picture == pictures[0].1;
            assert!(same, "{integrator} at {level} differs from scalar");
        }
    }
}

/// `brolly render` is a farm as well.
#[tokio::test(flavor = "multi_thread")]
async fn render_gives_the_bits_of_a_farm() {
    let scene = TestScene::room(70, 40);
    let farm = outcome(&[2], &scene, &Tuning::spp(8)).await;
    let out = scene.folder().join("render.exr");
    let args = [
        "render",
        scene.folder().to_str().unwrap(),
        "-o",
        out.to_str().unwrap(),
        "--spp",
        "8",
        "--workers",
        "3",
        "--threads",
        "1",
    ];
    let run = brolly(&args, &[]);
    assert_eq!(run.code, 0, "{}", run.stderr);
    assert!(std::fs::read(out).unwrap() == farm.exr);
}
