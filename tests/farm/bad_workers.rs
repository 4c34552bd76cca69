//! Workers that must not take part.

use crate::support::{TestFarm, TestScene, Tuning};
use coordinator::{Config, Scope, Token};
use film::EngineVersion;
use protocol::JobState;
use worker::WorkerError;

#[tokio::test(flavor = "multi_thread")]
async fn other_engine_version_is_refused() {
    let mut farm = TestFarm::start().await;
    farm.worker_with(|config| config.engine_version = EngineVersion(999));
    let error = farm.ended(0).await.unwrap_err();
    assert!(
        matches!(error, WorkerError::EngineVersion { .. }),
        "{error:?}"
    );
    assert!(error.to_string().contains("999"), "{error}");
}

#[tokio::test(flavor = "multi_thread")]
async fn a_worker_without_a_token_is_told() {
    let mut farm = TestFarm::with_config(Config {
        tokens: vec![
            Token::new(Scope::Work, "let me work").unwrap(),
            Token::new(Scope::Watch, "let me watch").unwrap(),
        ],
        ..Config::default()
    })
    .await;
    farm.worker(1);
    farm.worker_with(|config| config.token = Some("let me watch".into()));
    for _ in 0..2 {
        let error = farm.ended(0).await.unwrap_err();
        assert!(matches!(error, WorkerError::Unauthorised(_)), "{error:?}");
    }
}

/// A picture that does not decode fails the job with the worker's message.
#[tokio::test(flavor = "multi_thread")]
async fn a_picture_that_does_not_decode_fails_the_job() {
    let scene = TestScene::room(16, 16);
    // A good header and nothing behind it: the coordinator reads only headers.
    let mut png = Vec::new();
    png.extend_from_slice(b"\x89PNG\r\n\x1a\n\0\0\0\rIHDR\0\0\0\x08\0\0\0\x08\x08\x02\0\0\0");
    png.extend_from_slice(&0x4b6d_29dcu32.to_be_bytes());
    scene.write("torn.png", &png);
    scene.replace(
        "Material \"diffuse\" \"rgb reflectance\" [0.6 0.5 0.4]",
        "Texture \"torn\" \"spectrum\" \"imagemap\" \"string filename\" \"torn.png\"\nMaterial \"diffuse\" \"texture reflectance\" \"torn\"",
    );
    let mut farm = TestFarm::start().await;
    farm.worker(1);
    let id = farm.submit(&scene, &Tuning::spp(1)).await;
    let job = farm.ends(id).await;
    assert_eq!(job.state, JobState::Failed);
    let problem = serde_json::to_string(&job.problem).unwrap();
    assert!(problem.contains("torn.png"), "{problem}");
}
