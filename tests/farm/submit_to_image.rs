//! From a scene to its picture.

use crate::support::{RawWorker, TestFarm, TestScene, Tuning, outcome};
use client::{ImageQuery, JobQuery};
use film::{Film, Receipt, TileGrid};
use protocol::JobState;

#[tokio::test(flavor = "multi_thread")]
async fn a_scene_becomes_a_picture() {
    let scene = TestScene::room(48, 32);
    let mut farm = TestFarm::start().await;
    farm.worker(2);
    let id = farm.submit(&scene, &Tuning::default()).await;
    let job = farm.done(id).await;
    assert_eq!((job.width, job.height), (48, 32));
    assert_eq!(job.spp, 8.0, "the file asks for 8");
    assert_eq!(job.samples, 48 * 32 * 8);
    assert!(job.rays >= job.samples);
    assert_eq!(job.rejected_samples, 0);
    assert!(job.digest.is_some() && job.finished_at.is_some());
    assert!(job.error.is_some_and(|e| e > 0.0));

    let query = ImageQuery::default();
    let png = farm
        .client
        .image(id, "png", &query, None)
        .await
        .unwrap()
        .unwrap();
    assert!(png.bytes.starts_with(b"\x89PNG"));
    let exr = farm
        .client
        .image(id, "exr", &query, None)
        .await
        .unwrap()
        .unwrap();
    assert!(exr.bytes.starts_with(&[0x76, 0x2f, 0x31, 0x01]));
    let again = farm
        .client
        .image(id, "exr", &query, exr.etag.as_deref())
        .await
        .unwrap();
    assert!(again.is_none(), "304 for the picture that we have");

    let list = farm.client.jobs(&JobQuery::default()).await.unwrap();
    assert_eq!(list.jobs.iter().map(|j| j.id).collect::<Vec<_>>(), [id]);
    let tiles = farm.client.tiles(id, None).await.unwrap();
    assert_eq!(tiles.samples, [8]);

    farm.client.delete_job(id).await.unwrap();
    assert_eq!(farm.client.job(id).await.unwrap_err().status(), Some(404));
}

#[tokio::test(flavor = "multi_thread")]
async fn size_and_seed_of_the_job_win() {
    let scene = TestScene::room(48, 32);
    let mut farm = TestFarm::start().await;
    farm.worker(2);
    let sized = Tuning {
        size: Some([33, 70]),
        ..Tuning::spp(2)
    };
    let id = farm.submit(&scene, &sized).await;
    let job = farm.done(id).await;
    assert_eq!((job.width, job.height, job.spp), (33, 70, 2.0));
    let seeded = Tuning {
        seed: 1,
        ..sized.clone()
    };
    let other = farm.render(&scene, &seeded).await;
    assert_ne!(farm.outcome(id).await.digest, other.digest);
    assert_eq!(outcome(&[1], &scene, &seeded).await, other);
}

/// A job whose scene is broken fails and says where.
#[tokio::test(flavor = "multi_thread")]
async fn a_broken_scene_fails_with_its_place() {
    let scene = TestScene::room(16, 16);
    scene.replace("\"float radius\" [0.4]", "\"float radius\" [\"big\"]");
    let mut farm = TestFarm::start().await;
    farm.worker(1);
    let id = farm.submit(&scene, &Tuning::spp(1)).await;
    let job = farm.ends(id).await;
    assert_eq!(job.state, JobState::Failed);
    let problem = job.problem.expect("a problem");
    let finding = problem.findings.iter().find(|f| f.severity == "error");
    let finding = finding.expect("an error");
    assert_eq!(finding.file, "scene.pbrt");
    assert!(finding.line.is_some(), "{finding}");
}

/// The farm adds nothing and loses nothing: the same units rendered and merged without any of it.
#[tokio::test(flavor = "multi_thread")]
async fn the_farm_gives_what_the_tracer_gives() {
    let scene = TestScene::room(80, 48);
    let tuning = Tuning::spp(8);
    let mut farm = TestFarm::start().await;
    let id = farm.submit(&scene, &tuning).await;
    let mut hand = RawWorker::register(&farm.client, "hand").await;
    let grid = TileGrid {
        width: 80,
        height: 48,
    };
    let mut film = Film::new(grid, 0);
    let mut merged = 0;
    // The hand renders all units and keeps a film of its own.
    while merged < 80 * 48 * 8 {
        let lease = hand.lease().await;
        let bytes = hand.render(&lease).await;
        let result = film::decode_unit(&bytes).expect("what was just encoded");
        merged += result.counters.samples;
        film.merge(&result, Receipt::of(&bytes, "hand"))
            .expect("fits");
        hand.deliver(&lease, bytes).await.expect("taken");
    }
    let by_hand = farm.outcome(id).await;
    let digest: String = film
        .digest()
        .iter()
        .map(|byte| format!("{byte:02x}"))
        .collect();
    assert_eq!(by_hand.digest, Some(digest));
    farm.worker(2);
    let by_farm = farm.render(&scene, &tuning).await;
    assert_eq!(by_hand, by_farm);
}
