//! Workers that die, stall, leave.

use crate::support::{Brolly, RawWorker, TestFarm, TestScene, Tuning, outcome, seed, wait_until};
use coordinator::Config;
use rand::rngs::StdRng;
use rand::{Rng, SeedableRng};
use std::time::Duration;

/// Leases that do not keep a test waiting.
fn impatient() -> Config {
    Config {
        lease_ttl: Duration::from_millis(1500),
        heartbeat: Duration::from_millis(200),
        ..Config::default()
    }
}

/// Three processes render; again and again one of them is killed, at a moment that is
/// counted in merged units, and replaced.
#[tokio::test(flavor = "multi_thread")]
async fn killed_workers_change_nothing() {
    let mut random = StdRng::seed_from_u64(seed("killed_workers_change_nothing"));
    let scene = TestScene::room(128, 100);
    let tuning = Tuning::spp(64);
    let expect = outcome(&[2], &scene, &tuning).await;

    let farm = TestFarm::with_config(impatient()).await;
    let mut workers: Vec<Brolly> = (0..3).map(|_| Brolly::work(&farm.url, 1)).collect();
    let id = farm.submit(&scene, &tuning).await;
    let mut kills = 0;
    let mut next_kill = random.random_range(1..4);
    let job = wait_until("the job survives the kills", async || {
        let job = farm.client.job(id).await.expect("the job's state");
        if job.units_merged >= next_kill && kills < 6 && !job.state.is_final() {
            let victim = random.random_range(0..workers.len());
            workers[victim].kill();
            workers[victim] = Brolly::work(&farm.url, 1);
            kills += 1;
            next_kill = job.units_merged + random.random_range(1..5);
        }
        job.state.is_final().then_some(job)
    })
    .await;
    eprintln!("{kills} kills, {} units merged", job.units_merged);
    assert!(kills >= 2, "the job was over before the kills");
    assert_eq!(farm.outcome(id).await, expect);
    assert_eq!(job.samples, 128 * 100 * 64, "nothing lost, nothing twice");
}

/// A process that is stopped past the end of its lease and goes on then does no harm.
#[tokio::test(flavor = "multi_thread")]
async fn a_worker_paused_past_its_lease_does_no_harm() {
    let scene = TestScene::room(64, 64);
    let tuning = Tuning::spp(32);
    let expect = outcome(&[1], &scene, &tuning).await;
    let mut farm = TestFarm::with_config(impatient()).await;
    let sleeper = Brolly::work(&farm.url, 1);
    let id = farm.submit(&scene, &tuning).await;
    wait_until("the sleeper has a lease", async || {
        let job = farm.client.job(id).await.unwrap();
        (job.units_leased > 0 || job.state.is_final()).then_some(())
    })
    .await;
    sleeper.signal("STOP");
    farm.worker(1);
    assert_eq!(farm.outcome(id).await, expect);
    sleeper.signal("CONT");
    assert_eq!(farm.outcome(id).await, expect);
    let second = Tuning {
        seed: 9,
        ..tuning.clone()
    };
    assert_eq!(
        farm.render(&scene, &second).await,
        outcome(&[1], &scene, &second).await
    );
}

/// SIGTERM: the worker leaves by itself, and what it held does not wait for the lease to expire.
#[tokio::test(flavor = "multi_thread")]
async fn sigterm_gives_leases_back() {
    let scene = TestScene::room(128, 128);
    let tuning = Tuning::spp(64);
    // Leases that would keep this test waiting for an hour.
    let mut farm = TestFarm::with_config(Config {
        lease_ttl: Duration::from_secs(3600),
        heartbeat: Duration::from_millis(200),
        ..Config::default()
    })
    .await;
    let mut worker = Brolly::work(&farm.url, 1);
    let id = farm.submit(&scene, &tuning).await;
    wait_until("a unit is merged", async || {
        let job = farm.client.job(id).await.unwrap();
        (job.units_merged > 0).then_some(())
    })
    .await;
    worker.signal("TERM");
    assert_eq!(worker.wait(), 0, "{}", worker.log());
    farm.worker(2);
    assert_eq!(farm.outcome(id).await, outcome(&[1], &scene, &tuning).await);
}

/// A worker that only takes leases and dies keeps nobody from the picture.
#[tokio::test(flavor = "multi_thread")]
async fn leases_of_the_dead_expire() {
    let scene = TestScene::room(40, 40);
    let mut farm = TestFarm::with_config(impatient()).await;
    let id = farm.submit(&scene, &Tuning::spp(4)).await;
    let mut dead = RawWorker::register(&farm.client, "dead").await;
    dead.lease().await;
    farm.worker(1);
    assert_eq!(
        farm.outcome(id).await,
        outcome(&[1], &scene, &Tuning::spp(4)).await
    );
}
