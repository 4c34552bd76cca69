//! Pausing, extending and stopping by noise do not change a bit.

use crate::support::{TestFarm, TestScene, Tuning, outcome, wait_until};
use protocol::{JobPatch, JobState, Stop};

fn spp(spp: u32) -> JobPatch {
    JobPatch {
        stop: Some(Stop {
            spp: Some(spp),
            ..Stop::default()
        }),
        ..JobPatch::default()
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn pause_resume_same_bits() {
    let scene = TestScene::room(100, 70);
    let tuning = Tuning::spp(32);
    let mut farm = TestFarm::start().await;
    farm.worker(1);
    let id = farm.submit(&scene, &tuning).await;
    let mut pauses = 0;
    for wanted in [1, 5, 9] {
        wait_until("units are merged", async || {
            let job = farm.client.job(id).await.unwrap();
            (job.units_merged >= wanted || job.state.is_final()).then_some(())
        })
        .await;
        if farm.client.pause(id).await.is_err() {
            break; // done already
        }
        let held = wait_until("units in work finish", async || {
            let job = farm.client.job(id).await.unwrap();
            (job.units_leased == 0).then_some(job)
        })
        .await;
        if held.state.is_final() {
            break;
        }
        assert_eq!(held.state, JobState::Paused);
        pauses += 1;
        if let Err(error) = farm.client.resume(id).await {
            // The last unit in work may have been the last of the job.
            let job = farm.client.job(id).await.unwrap();
            assert_eq!(job.state, JobState::Done, "{error}");
            break;
        }
    }
    eprintln!("{pauses} pauses");
    assert_eq!(farm.outcome(id).await, outcome(&[2], &scene, &tuning).await);
}

#[tokio::test(flavor = "multi_thread")]
async fn extend_equals_one_shot() {
    let scene = TestScene::room(70, 40);
    let mut farm = TestFarm::start().await;
    farm.worker(2);
    // 11 lies inside a pass: its units are cut, and the rest is rendered later.
    let id = farm.submit(&scene, &Tuning::spp(11)).await;
    let first = farm.outcome(id).await;
    assert_eq!(first, outcome(&[1], &scene, &Tuning::spp(11)).await);
    farm.client.patch_job(id, &spp(24)).await.unwrap();
    let job = wait_until("the extension is done", async || {
        let job = farm.client.job(id).await.unwrap();
        (job.state == JobState::Done && job.spp >= 24.0).then_some(job)
    })
    .await;
    assert_eq!(job.samples, 70 * 40 * 24);
    // The files carry the stop rule of their job, so the pixels are compared by digest.
    let straight = outcome(&[1], &scene, &Tuning::spp(24)).await;
    assert_eq!(farm.outcome(id).await.digest, straight.digest);
    assert_eq!(farm.outcome(id).await.exr, straight.exr);

    let looser = farm.client.patch_job(id, &spp(8)).await.unwrap_err();
    assert!(matches!(looser.status(), Some(400..=499)), "{looser}");
}

#[tokio::test(flavor = "multi_thread")]
async fn noise_stop_same_for_any_farm() {
    let scene = TestScene::room(100, 70);
    let tuning = Tuning::noise(0.03, 512);
    let mut farm = TestFarm::start().await;
    farm.worker(1);
    let id = farm.submit(&scene, &tuning).await;
    let one = farm.outcome(id).await;
    let job = farm.client.job(id).await.unwrap();
    let tiles = farm.client.tiles(id, None).await.unwrap();
    eprintln!(
        "error {:?} at {} spp, tiles {:?}",
        job.error, job.spp, tiles.samples
    );
    assert!(tiles.samples.iter().all(|&spp| (16..=512).contains(&spp)));
    for workers in [&[2, 2][..], &[1, 1, 1, 1, 1]] {
        assert_eq!(outcome(workers, &scene, &tuning).await, one, "{workers:?}");
    }

    // Sample counts of a picture, given back as a stop rule, give the picture.
    let mut again = tuning.clone();
    again.stop = Stop {
        samples: Some(tiles.samples),
        ..Stop::default()
    };
    let repeated = outcome(&[2], &scene, &again).await;
    assert_eq!(repeated.digest, one.digest);

    // A tighter target later gives what a straight run gives.
    let tighter = JobPatch {
        stop: Some(Stop {
            noise: Some(0.02),
            spp: Some(512),
            ..Stop::default()
        }),
        ..JobPatch::default()
    };
    let samples = job.samples;
    farm.client.patch_job(id, &tighter).await.unwrap();
    wait_until("the tighter target is reached", async || {
        let job = farm.client.job(id).await.unwrap();
        (job.state == JobState::Done && job.samples > samples).then_some(())
    })
    .await;
    let straight = outcome(&[2], &scene, &Tuning::noise(0.02, 512)).await;
    assert_eq!(farm.outcome(id).await.digest, straight.digest);
}
