//! A coordinator that is killed at any moment.

use crate::support::{Brolly, TestFarm, TestScene, Tuning, outcome, seed, wait_until};
use rand::rngs::StdRng;
use rand::{Rng, SeedableRng};
use std::time::{Duration, Instant};

/// `brolly serve` is killed at random moments, some of them between a result and the checkpoint
/// that covers it; the workers live on and keep their results.
#[tokio::test(flavor = "multi_thread")]
async fn a_killed_coordinator_loses_nothing() {
    let mut random = StdRng::seed_from_u64(seed("a_killed_coordinator_loses_nothing"));
    let scene = TestScene::room(128, 100);
    let tuning = Tuning::spp(128);
    let expect = outcome(&[2], &scene, &tuning).await;

    let data = tempfile::tempdir().unwrap();
    let (mut server, port) = Brolly::serve(data.path(), 0);
    let mut farm = TestFarm::at(format!("http://127.0.0.1:{port}"));
    farm.worker(1).worker(1);
    let id = farm.submit(&scene, &tuning).await;
    let mut recoveries = Vec::new();
    for _ in 0..4 {
        let merged = farm.client.job(id).await.unwrap().units_merged;
        let target = merged + random.random_range(1..6);
        let ended = wait_until("units are merged", async || {
            let job = farm.client.job(id).await.unwrap();
            (job.units_merged >= target || job.state.is_final()).then_some(job.state.is_final())
        })
        .await;
        if ended {
            break;
        }
        tokio::time::sleep(Duration::from_millis(random.random_range(0..150))).await;
        server.kill();
        // Long enough for the workers to finish units that nobody takes.
        tokio::time::sleep(Duration::from_millis(random.random_range(0..1000))).await;
        let begin = Instant::now();
        server = Brolly::serve(data.path(), port).0;
        let up = begin.elapsed();
        let before = farm.client.job(id).await.unwrap();
        wait_until("work goes on", async || {
            let job = farm.client.job(id).await.unwrap();
            (job.units_merged > before.units_merged || job.state.is_final()).then_some(())
        })
        .await;
        recoveries.push((up, begin.elapsed()));
    }
    eprintln!("(listens again, next unit merged) after: {recoveries:.2?}");
    assert!(!recoveries.is_empty(), "the job was over before the kills");
    assert_eq!(farm.outcome(id).await, expect);

    // What is done stays done.
    server.kill();
    let (_server, _) = Brolly::serve(data.path(), port);
    assert_eq!(farm.outcome(id).await, expect);
}

/// A finished result is kept while there is nobody to take it.
#[tokio::test(flavor = "multi_thread")]
async fn workers_keep_results_through_an_outage() {
    let scene = TestScene::room(64, 64);
    let tuning = Tuning::spp(64);
    let data = tempfile::tempdir().unwrap();
    let (mut server, port) = Brolly::serve(data.path(), 0);
    let mut farm = TestFarm::at(format!("http://127.0.0.1:{port}"));
    farm.worker(1);
    let id = farm.submit(&scene, &tuning).await;
    wait_until("the worker has a lease", async || {
        let job = farm.client.job(id).await.unwrap();
        (job.units_leased > 0 || job.state.is_final()).then_some(())
    })
    .await;
    server.kill();
    tokio::time::sleep(Duration::from_millis(1500)).await;
    let (_server, _) = Brolly::serve(data.path(), port);
    assert_eq!(farm.outcome(id).await, outcome(&[1], &scene, &tuning).await);
}
