//! Cancelling reaches the middle of a unit.

use crate::support::{TestFarm, TestScene, Tuning, wait_until};
use protocol::JobState;
use std::time::Instant;

#[tokio::test(flavor = "multi_thread")]
async fn cancel_reaches_running_unit() {
    let scene = TestScene::room(64, 64);
    let mut farm = TestFarm::start().await;
    farm.worker(1);
    let long = farm.submit(&scene, &Tuning::spp(1 << 20)).await;
    wait_until("a long unit is in work", async || {
        let job = farm.client.job(long).await.unwrap();
        (job.spp >= 64.0).then_some(())
    })
    .await;
    let begin = Instant::now();
    let job = farm.client.cancel(long).await.unwrap();
    assert_eq!(job.state, JobState::Cancelled);
    wait_until("the worker is free", async || {
        let workers = farm.client.workers().await.unwrap().workers;
        (workers.iter().all(|w| w.leases == 0)).then_some(())
    })
    .await;
    // The thread is free as well: a second job needs it.
    let short = farm.submit(&scene, &Tuning::spp(1)).await;
    farm.done(short).await;
    eprintln!("free after {:.2?}", begin.elapsed());

    // Cancelled twice is cancelled; retried it runs.
    let again = farm.client.cancel(long).await.unwrap();
    assert_eq!(again.state, JobState::Cancelled);
    let retried = farm.client.retry_job(long).await.unwrap();
    assert!(!retried.state.is_final());
    farm.client.cancel(long).await.unwrap();
}
