//! Who gets which unit when.

use super::support::*;
use protocol::{JobState, Stop};
use std::time::Duration;

async fn job(rig: &Rig, priority: u8, stop: Stop) -> uuid::Uuid {
    let mut request = rig.request(stop);
    request.priority = Some(priority);
    rig.submit_request(request).await
}

#[tokio::test]
async fn priority_goes_first_but_starves_nobody() {
    let rig = Rig::memory().await;
    let low = job(&rig, 10, spp(4096)).await;
    let high = job(&rig, 90, spp(4096)).await;
    let worker = rig.worker("a");
    let leases = rig.lease(worker, 60).await;
    let of_low = leases.iter().filter(|l| l.at.job == low).count();
    assert_eq!(leases.len(), 60);
    assert_eq!(of_low, 6, "a tenth");
    assert_eq!(leases[0].at.job, high);
}

#[tokio::test]
async fn first_passes_of_a_new_job_go_first() {
    let rig = Rig::memory().await;
    let old = job(&rig, 50, spp(4096)).await;
    let worker = rig.worker("a");
    let begun = rig.lease(worker, 24).await;
    assert!(begun.iter().all(|l| l.at.job == old));
    let new = job(&rig, 50, spp(4096)).await;
    // Whoever holds later passes is asked to give back what has not begun.
    let mut request = asking(worker, 0);
    request.held = vec![begun.last().unwrap().at.clone()];
    assert!(rig.sync(request).await.give_back_unstarted);
    let next = rig.lease(worker, 5).await;
    assert!(next.iter().all(|l| l.at.job == new), "{next:?}");
}

#[tokio::test]
async fn one_user_cannot_starve_another() {
    let rig = Rig::memory().await;
    for _ in 0..30 {
        job(&rig, 60, spp(64)).await;
    }
    let lonely = job(&rig, 50, spp(1)).await;
    let worker = rig.worker("a");
    // Every tenth lease goes to who waits longest: the thirty before it, then this one.
    let mut leases = rig.lease(worker, 256).await;
    leases.extend(rig.lease(worker, 256).await);
    assert!(leases.iter().any(|l| l.at.job == lonely));
}

#[tokio::test]
async fn equals_are_served_in_turn() {
    let rig = Rig::memory().await;
    let jobs = [
        job(&rig, 50, spp(4096)).await,
        job(&rig, 50, spp(4096)).await,
        job(&rig, 50, spp(4096)).await,
    ];
    let worker = rig.worker("a");
    let leases = rig.lease(worker, 30).await;
    for id in jobs {
        let of_it = leases.iter().filter(|l| l.at.job == id).count();
        assert!((9..=11).contains(&of_it), "{of_it} of 30");
    }
}

/// A worker that gets nothing is told once, then waits like any other.
#[tokio::test(start_paused = true)]
async fn a_draining_worker_waits() {
    let rig = Rig::memory().await;
    rig.submit(spp(1)).await;
    let worker = rig.worker("a");
    if let Some(worker) = rig.farm.state().workers.get_mut(&worker) {
        worker.drained = true;
    }
    let waits = async || {
        let before = tokio::time::Instant::now();
        let mut request = asking(worker, 0);
        request.wait_ms = 10_000;
        let drain = rig.sync(request).await.drain;
        (drain, before.elapsed() >= Duration::from_secs(10))
    };
    assert_eq!(waits().await, (true, false), "told at once");
    assert_eq!(waits().await, (true, true));
    assert_eq!(waits().await, (true, true));
    rig.farm.pardon(worker, false, true);
    assert_eq!(waits().await, (false, false), "so is the end of it");
    assert_eq!(waits().await, (false, true));
}

#[tokio::test]
async fn give_back_goes_to_the_next() {
    let rig = Rig::memory().await;
    let id = rig.submit(spp(1)).await;
    let (leaving, staying) = (rig.worker("leaving"), rig.worker("staying"));
    let leases = rig.lease(leaving, 4).await;
    let mut request = asking(leaving, 4);
    request.given_back = leases.iter().map(|l| l.at.clone()).collect();
    request.draining = true;
    let answer = rig.sync(request).await;
    assert!(answer.leases.is_empty() && answer.drain);
    assert_eq!(rig.lease(staying, 4).await.len(), 4);
    assert!(rig.status(id).units_leased == 4);
}

#[tokio::test]
async fn a_waiting_worker_is_woken_at_once() {
    let rig = std::sync::Arc::new(Rig::memory().await);
    let worker = rig.worker("a");
    let waiting = {
        let rig = rig.clone();
        tokio::spawn(async move {
            let mut request = asking(worker, 1);
            request.wait_ms = 30_000;
            rig.sync(request).await
        })
    };
    tokio::time::sleep(Duration::from_millis(50)).await;
    let start = std::time::Instant::now();
    rig.submit(spp(1)).await;
    let answer = waiting.await.unwrap();
    assert_eq!((answer.leases.len(), answer.specs.len()), (1, 1));
    assert_eq!(answer.specs[0].1.size, [100, 70]);
    assert!(start.elapsed() < Duration::from_secs(10));
}

#[tokio::test]
async fn cancel_reaches_running_unit() {
    let rig = std::sync::Arc::new(Rig::memory().await);
    let id = rig.submit(spp(1)).await;
    let worker = rig.worker("a");
    let held: Vec<_> = rig
        .lease(worker, 2)
        .await
        .into_iter()
        .map(|l| l.at)
        .collect();
    let waiting = {
        let (rig, held) = (rig.clone(), held.clone());
        tokio::spawn(async move {
            let mut request = asking(worker, 0);
            (request.wait_ms, request.held) = (30_000, held);
            rig.sync(request).await
        })
    };
    tokio::time::sleep(Duration::from_millis(50)).await;
    rig.farm.cancel(id).await.unwrap();
    assert_eq!(waiting.await.unwrap().cancelled, held);
}

#[tokio::test(start_paused = true)]
async fn heartbeats_keep_a_lease() {
    let rig = Rig::memory().await;
    let id = rig.submit(spp(1)).await;
    let worker = rig.worker("a");
    let held: Vec<_> = rig
        .lease(worker, 2)
        .await
        .into_iter()
        .map(|l| l.at)
        .collect();
    for _ in 0..10 {
        tokio::time::sleep(rig.farm.config.heartbeat).await;
        let mut request = asking(worker, 0);
        request.held = held[..1].to_vec();
        assert_eq!(rig.sync(request).await.cancelled, vec![]);
    }
    assert_eq!(rig.status(id).units_leased, 1, "the other was not named");
    tokio::time::sleep(rig.farm.config.lease_ttl * 2).await;
    assert_eq!(rig.status(id).units_leased, 0);
    assert_eq!(rig.status(id).state, JobState::Running);
    let now = rig.farm.clock.now();
    assert_eq!(
        rig.farm.state().workers[&worker].status(now, 30_000).state,
        "lost"
    );
}

fn samples_of(leases: &[protocol::Lease]) -> u64 {
    let pixels = |l: &protocol::Lease| GRID.tile(l.at.unit.tile).pixels() as u64;
    let samples = |l| pixels(l) * u64::from(l.at.unit.samples.len());
    leases.iter().map(samples).sum()
}

async fn ask_samples(
    rig: &Rig,
    worker: uuid::Uuid,
    want: u32,
    samples: u64,
) -> Vec<protocol::Lease> {
    let mut request = asking(worker, want);
    request.want_samples = samples;
    rig.sync(request).await.leases
}

/// Units grow from pass to pass: who asks by samples gets many of the first and few of the last.
#[tokio::test]
async fn units_are_given_by_samples() {
    let rig = Rig::memory().await;
    rig.submit(spp(256)).await;
    let worker = rig.worker("a");
    let first = ask_samples(&rig, worker, 0, 30_000).await;
    assert!(first.len() > 8, "{}", first.len());
    assert!(samples_of(&first) <= 30_000);
    let rest = ask_samples(&rig, worker, 0, u64::MAX).await;
    assert_eq!(first.len() + rest.len(), 4 * 9, "alone it may have all");
    assert!(ask_samples(&rig, worker, 3, u64::MAX).await.is_empty());
}

#[tokio::test]
async fn a_unit_that_is_wanted_is_given_however_long_it_is() {
    let rig = Rig::memory().await;
    rig.submit(spp(1)).await;
    let worker = rig.worker("a");
    assert!(ask_samples(&rig, worker, 0, 1).await.is_empty());
    assert_eq!(ask_samples(&rig, worker, 1, 1).await.len(), 1);
    assert_eq!(ask_samples(&rig, worker, 3, 0).await.len(), 3);
}

/// Nobody takes so much that the others have nothing to do at the end.
#[tokio::test]
async fn what_is_left_is_shared() {
    let rig = Rig::memory().await;
    rig.submit(spp(64)).await;
    let (one, two) = (rig.worker("a"), rig.worker("b"));
    let all = 100 * 70 * 64;
    let first = samples_of(&ask_samples(&rig, one, 0, u64::MAX).await);
    assert!(first <= all / 4 && first > all / 16, "{first} of {all}");
    let second = samples_of(&ask_samples(&rig, two, 0, u64::MAX).await);
    assert!(second <= (all - first) / 4 && second > 0, "{second}");
    // Enough for everyone: what is wanted is given.
    let rig = Rig::memory().await;
    rig.submit(spp(4096)).await;
    let (one, _) = (rig.worker("a"), rig.worker("b"));
    let first = samples_of(&ask_samples(&rig, one, 0, 30_000).await);
    assert!(first <= 30_000 && first > 15_000, "{first}");
}
