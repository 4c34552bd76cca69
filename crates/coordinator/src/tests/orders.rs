//! Any order of arrival, duplicates, late results: the same bits.

use super::support::*;
use crate::results::Taken;
use proptest::prelude::*;
use protocol::JobState;

/// What happens next.
#[derive(Clone, Debug)]
enum Step {
    Lease {
        worker: usize,
        want: u32,
    },
    /// The lease at this place of those that were ever given, to be delivered by this worker: maybe
    /// for the second time, maybe after somebody else did.
    Deliver {
        worker: usize,
        lease: usize,
    },
    GiveBack {
        lease: usize,
    },
    Checkpoint,
    Restart,
}

fn step() -> impl Strategy<Value = Step> {
    prop_oneof![
        3 => (0..3usize, 1..6u32).prop_map(|(worker, want)| Step::Lease { worker, want }),
        6 => (0..3usize, any::<prop::sample::Index>()).prop_map(|(worker, i)| Step::Deliver { worker, lease: i.index(40) }),
        1 => (0..40usize).prop_map(|lease| Step::GiveBack { lease }),
        1 => Just(Step::Checkpoint),
        1 => Just(Step::Restart),
    ]
}

async fn play(steps: Vec<Step>) {
    let mut rig = Rig::embedded().await;
    let id = rig.submit(spp(24)).await;
    let mut workers: Vec<_> = ["a", "b", "c"].map(|n| rig.worker(n)).to_vec();
    let mut given = Vec::new();
    for step in steps {
        match step {
            Step::Lease { worker, want } => {
                let leases = rig.lease(workers[worker], want).await;
                given.extend(leases.into_iter().map(|l| (l.at, workers[worker])));
            }
            Step::Deliver { worker, lease } => {
                if let Some((at, _)) = given.get(lease) {
                    rig.deliver(workers[worker], at).await.unwrap();
                }
            }
            Step::GiveBack { lease } => {
                if let Some((at, worker)) = given.get(lease) {
                    let mut request = asking(*worker, 0);
                    request.given_back = vec![at.clone()];
                    rig.sync(request).await;
                }
            }
            Step::Checkpoint => rig.farm.checkpoint(id).await.unwrap(),
            Step::Restart => {
                rig = rig.restart().await;
                workers = ["a", "b", "c"].map(|n| rig.worker(n)).to_vec();
                given.iter_mut().for_each(|(_, w)| *w = workers[0]);
            }
        }
    }
    if rig.status(id).state != JobState::Done {
        // Whatever nobody delivered comes back with time; a restart is quicker.
        rig = rig.restart().await;
        let last = rig.worker("last");
        rig.work(last, id).await;
    }
    let status = rig.done(id).await;
    assert_eq!(status.digest, hex(&oracle(0, |_| 24)));
    // 0-1, 1-2, 2-4, 4-8, 8-16, 16-24 of four tiles: each merged once.
    assert_eq!(status.units_merged, 24);
    rig.farm.close().await;
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 24, ..ProptestConfig::default() })]
    #[test]
    fn all_orders_of_arrival_small(steps in prop::collection::vec(step(), 1..80)) {
        let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build().unwrap();
        runtime.block_on(play(steps));
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn any_workers_same_bits() {
    for count in [1usize, 2, 7, 64] {
        let rig = Rig::memory().await;
        let id = rig.submit(spp(128)).await;
        let rig = std::sync::Arc::new(rig);
        let workers = (0..count).map(|n| {
            let rig = rig.clone();
            tokio::spawn(async move {
                let worker = rig.worker(&format!("w{n}"));
                while !rig.status(id).state.is_final() {
                    for lease in rig.lease(worker, 2).await {
                        rig.deliver(worker, &lease.at).await.unwrap();
                    }
                    tokio::task::yield_now().await;
                }
            })
        });
        futures::future::join_all(workers).await;
        let status = rig.done(id).await;
        assert_eq!(status.digest, hex(&oracle(0, |_| 128)), "{count} workers");
    }
}

#[tokio::test]
async fn duplicate_same_bytes_is_noop() {
    let rig = Rig::embedded().await;
    let id = rig.submit(spp(2)).await;
    let worker = rig.worker("a");
    let leases = rig.lease(worker, 99).await;
    assert_eq!(leases.len(), 8);
    let first = &leases[0].at;
    assert_eq!(rig.deliver(worker, first).await.unwrap(), Taken::New);
    assert_eq!(rig.deliver(worker, first).await.unwrap(), Taken::Same);
    for lease in &leases[1..] {
        assert_eq!(rig.deliver(worker, &lease.at).await.unwrap(), Taken::New);
    }
    let status = rig.done(id).await;
    assert_eq!(status.units_merged, 8);
    // Also when the job is done, and after a restart.
    assert_eq!(rig.deliver(worker, first).await.unwrap(), Taken::Same);
    let rig = rig.restart().await;
    let worker = rig.worker("a");
    assert_eq!(rig.deliver(worker, first).await.unwrap(), Taken::Same);
    assert_eq!(rig.status(id).digest, status.digest);
}

#[tokio::test]
async fn the_same_result_many_times_at_once_is_merged_once() {
    let rig = Rig::embedded().await;
    let id = rig.submit(spp(1)).await;
    let worker = rig.worker("a");
    let leases = rig.lease(worker, 4).await;
    for lease in &leases {
        let tries = (0..8).map(|_| rig.deliver(worker, &lease.at));
        let taken = futures::future::join_all(tries).await;
        let new = taken.iter().filter(|t| matches!(t, Ok(Taken::New))).count();
        assert_eq!(new, 1, "{taken:?}");
        assert!(taken.iter().all(Result::is_ok));
    }
    let status = rig.done(id).await;
    assert_eq!(
        (status.units_merged, status.digest),
        (4, hex(&oracle(0, |_| 1)))
    );
}

#[tokio::test(start_paused = true)]
async fn worker_paused_past_lease_then_reports() {
    let rig = Rig::memory().await;
    let id = rig.submit(spp(1)).await;
    let (slow, quick) = (rig.worker("slow"), rig.worker("quick"));
    let first = rig.lease(slow, 4).await;
    assert_eq!(first.len(), 4);
    assert!(rig.lease(quick, 4).await.is_empty());
    tokio::time::sleep(rig.farm.config.lease_ttl * 2).await;
    let second = rig.lease(quick, 4).await;
    assert_eq!(
        second.iter().map(|l| l.at.attempt).collect::<Vec<_>>(),
        [2; 4]
    );
    // A late report frees nothing that is somebody else's ...
    let mut request = asking(slow, 0);
    request.given_back = vec![first[0].at.clone()];
    rig.sync(request).await;
    assert_eq!(rig.status(id).units_leased, 4);
    // ... and a late result is as good as any.
    assert_eq!(rig.deliver(slow, &first[0].at).await.unwrap(), Taken::New);
    assert_eq!(
        rig.deliver(quick, &second[0].at).await.unwrap(),
        Taken::Same
    );
    let mut request = asking(quick, 0);
    request.held = second.iter().map(|l| l.at.clone()).collect();
    assert_eq!(rig.sync(request).await.cancelled, [second[0].at.clone()]);
    for lease in &second[1..] {
        rig.deliver(quick, &lease.at).await.unwrap();
    }
    assert_eq!(rig.done(id).await.digest, hex(&oracle(0, |_| 1)));
}
