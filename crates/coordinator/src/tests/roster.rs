//! What of workers outlives a process, theirs or the coordinator's.

use super::support::*;
use crate::audit::quarantine;
use crate::error::QUARANTINED;
use uuid::Uuid;

fn state_of(rig: &Rig, worker: Uuid) -> (String, String) {
    let now = rig.farm.clock.now();
    let status = rig.farm.state().workers[&worker].status(now, 30_000);
    (status.state, status.reason.unwrap_or_default())
}

#[tokio::test]
async fn quarantine_outlives_both_processes() {
    let rig = Rig::embedded().await;
    let id = rig.submit(spp(4)).await;
    let (bad, good) = (rig.worker("bad"), rig.worker("good"));
    let leases = rig.lease(bad, 2).await;
    for lease in &leases {
        rig.send(bad, &lease.at, render_wrong(lease.at.unit))
            .await
            .unwrap();
    }
    quarantine(&rig.farm, bad, "on request");
    rig.farm.save_worker(bad).await.unwrap();
    rig.farm.save_worker(good).await.unwrap();
    let rig = rig.restart().await;
    assert_eq!(
        state_of(&rig, bad),
        ("quarantined".into(), "on request".into())
    );
    let (state, reason) = state_of(&rig, good);
    assert_eq!(state, "lost");
    assert!(reason.contains("not seen"), "{reason}");
    // The same process, and a new one with the same name.
    let mut again = about("bad");
    again.previous_id = Some(bad);
    assert_eq!(rig.farm.register(again, None).unwrap().worker, bad);
    let new = rig.worker("bad");
    assert_ne!(new, bad);
    for worker in [bad, new] {
        assert!(rig.lease(worker, 9).await.is_empty());
        let error = rig.deliver(worker, &leases[0].at).await.unwrap_err();
        assert_eq!(error.kind(), QUARANTINED);
    }
    // A pardon is for the name, else the next process would be out again.
    assert_eq!(rig.farm.pardon(new, true, false).len(), 2);
    for worker in [bad, new] {
        rig.farm.save_worker(worker).await.unwrap();
        assert_eq!(state_of(&rig, worker).0, "idle");
    }
    let rig = rig.restart().await;
    assert_eq!(state_of(&rig, bad).0, "lost");
    let worker = rig.worker("bad");
    assert_eq!(rig.work(worker, id).await.digest, hex(&oracle(0, |_| 4)));
}

#[tokio::test]
async fn a_drained_worker_stays_drained() {
    let rig = Rig::embedded().await;
    rig.submit(spp(1)).await;
    let worker = rig.worker("a");
    if let Some(worker) = rig.farm.state().workers.get_mut(&worker) {
        worker.drained = true;
    }
    rig.farm.save_worker(worker).await.unwrap();
    let rig = rig.restart().await;
    let back = rig.worker("a");
    let answer = rig.sync(asking(back, 1)).await;
    assert!(answer.drain && answer.leases.is_empty());
    rig.farm.pardon(back, false, true);
    assert_eq!(rig.lease(back, 1).await.len(), 1);
}

/// Tiles of a worker that was taken out while a frame was not in memory are rendered again when it
/// is taken up.
#[tokio::test]
async fn nothing_of_the_untrusted_is_taken_up_again() {
    let rig = Rig::embedded().await;
    let id = rig.submit(spp(2)).await;
    let (bad, good) = (rig.worker("bad"), rig.worker("good"));
    for lease in rig.lease(bad, 2).await {
        rig.send(bad, &lease.at, render_wrong(lease.at.unit))
            .await
            .unwrap();
    }
    assert_eq!(
        rig.work(good, id)
            .await
            .digest
            .map(|d| hex(&oracle(0, |_| 2)) == Some(d)),
        Some(false)
    );
    quarantine(&rig.farm, bad, "on request");
    rig.farm
        .patch(
            id,
            protocol::JobPatch {
                stop: Some(spp(4)),
                ..Default::default()
            },
        )
        .await
        .unwrap();
    assert_eq!(rig.work(good, id).await.digest, hex(&oracle(0, |_| 4)));
}
