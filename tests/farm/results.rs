//! Results that come twice, late, or wrong.

use crate::support::{RawWorker, TestFarm, TestScene, Tuning, outcome};
use client::Delivery;
use coordinator::Config;
use film::ENGINE_VERSION;
use std::time::Duration;

#[tokio::test(flavor = "multi_thread")]
async fn the_same_bytes_twice_are_a_duplicate() {
    let scene = TestScene::room(40, 40);
    let tuning = Tuning::spp(4);
    let mut farm = TestFarm::start().await;
    let id = farm.submit(&scene, &tuning).await;
    let mut worker = RawWorker::register(&farm.client, "twice").await;
    let lease = worker.lease().await;
    let bytes = worker.render(&lease).await;
    let first = worker.deliver(&lease, bytes.clone()).await.unwrap();
    let second = worker.deliver(&lease, bytes.clone()).await.unwrap();
    assert_eq!((first, second), (Delivery::Accepted, Delivery::Duplicate));
    farm.worker(1);
    assert_eq!(farm.outcome(id).await, outcome(&[1], &scene, &tuning).await);
    // Also when the job is done.
    let third = worker.deliver(&lease, bytes).await.unwrap();
    assert_eq!(third, Delivery::Duplicate);
    assert_eq!(farm.client.job(id).await.unwrap().samples, 40 * 40 * 4);
}

#[tokio::test(flavor = "multi_thread")]
async fn a_late_result_is_work_saved() {
    let scene = TestScene::room(40, 40);
    let tuning = Tuning::spp(4);
    let mut farm = TestFarm::with_config(Config {
        lease_ttl: Duration::from_millis(300),
        heartbeat: Duration::from_millis(100),
        ..Config::default()
    })
    .await;
    let id = farm.submit(&scene, &tuning).await;
    let mut late = RawWorker::register(&farm.client, "late").await;
    let lease = late.lease().await;
    let bytes = late.render(&lease).await;
    late.wait_until_lost(id).await;
    assert_eq!(
        late.deliver(&lease, bytes).await.unwrap(),
        Delivery::Accepted,
        "nobody else has rendered it"
    );
    farm.worker(1);
    assert_eq!(farm.outcome(id).await, outcome(&[1], &scene, &tuning).await);
}

#[tokio::test(flavor = "multi_thread")]
async fn other_bytes_for_a_known_unit_are_refused() {
    let scene = TestScene::room(40, 40);
    let tuning = Tuning::spp(4);
    let mut farm = TestFarm::start().await;
    let id = farm.submit(&scene, &tuning).await;
    let mut worker = RawWorker::register(&farm.client, "honest").await;
    let lease = worker.lease().await;
    let bytes = worker.render(&lease).await;
    let mut forged = film::decode_unit(&bytes).unwrap();
    forged.buffer.pixels_mut()[7].beauty[1] += 1;
    let forged = film::encode_unit(
        lease.at.unit,
        &forged.buffer,
        &forged.counters,
        ENGINE_VERSION,
    );
    assert_eq!(
        worker.deliver(&lease, bytes).await.unwrap(),
        Delivery::Accepted
    );
    let liar = RawWorker::register(&farm.client, "liar").await;
    assert_eq!(
        liar.deliver(&lease, forged).await.unwrap(),
        Delivery::OtherBytes
    );
    farm.worker(1);
    assert_eq!(farm.outcome(id).await, outcome(&[1], &scene, &tuning).await);
}

#[tokio::test(flavor = "multi_thread")]
async fn damaged_bytes_are_refused_whole() {
    let scene = TestScene::room(40, 40);
    let mut farm = TestFarm::start().await;
    let id = farm.submit(&scene, &Tuning::spp(2)).await;
    let mut worker = RawWorker::register(&farm.client, "damaged").await;
    let lease = worker.lease().await;
    let bytes = worker.render(&lease).await;
    for (what, bad) in [
        ("cut", bytes[..bytes.len() - 1].to_vec()),
        ("flipped", {
            let mut bad = bytes.clone();
            let middle = bad.len() / 2;
            bad[middle] ^= 1;
            bad
        }),
        ("empty", Vec::new()),
        ("long", [bytes.clone(), vec![0; 10]].concat()),
    ] {
        let error = worker.deliver(&lease, bad).await.expect_err(what);
        let status = error.status().unwrap_or_default();
        assert!((400..500).contains(&status), "{what}: {error}");
    }
    farm.worker(1);
    assert_eq!(
        farm.outcome(id).await,
        outcome(&[1], &scene, &Tuning::spp(2)).await
    );
}

#[tokio::test(flavor = "multi_thread")]
async fn a_result_for_a_cancelled_job_is_gone() {
    let scene = TestScene::room(40, 40);
    let farm = TestFarm::start().await;
    let id = farm.submit(&scene, &Tuning::spp(4)).await;
    let mut worker = RawWorker::register(&farm.client, "slow").await;
    let lease = worker.lease().await;
    let bytes = worker.render(&lease).await;
    farm.client.cancel(id).await.unwrap();
    assert_eq!(worker.deliver(&lease, bytes).await.unwrap(), Delivery::Gone);
}
