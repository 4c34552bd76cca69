//! Jobs with many frames.

use super::support::*;
use protocol::{JobPatch, JobState};

#[tokio::test]
async fn frames_are_opened_one_after_the_other() {
    let rig = Rig::embedded().await;
    let mut request = rig.request(spp(4));
    request.frames = Some([3, 7]);
    let id = rig.submit_request(request).await;
    let worker = rig.worker("a");
    // More units are wanted than two frames have.
    let leases = rig.lease(worker, 99).await;
    assert_eq!(leases.len(), 2 * 4 * 3);
    assert!(leases.iter().all(|l| [3, 4].contains(&l.at.unit.frame)));
    for lease in leases.iter().filter(|l| l.at.unit.frame == 3) {
        rig.deliver(worker, &lease.at).await.unwrap();
    }
    rig.wait(id, |s| s.units_merged == 12).await;
    let rig = rig.restart().await;
    let worker = rig.worker("b");
    let status = rig.work(worker, id).await;
    assert_eq!(status.digest, hex(&oracle(3, |_| 4)));
    assert_eq!((status.units_merged, status.spp), (60, 4.0));
    for frame in 3..=7 {
        assert_eq!(
            rig.film_digest(id, frame),
            oracle(frame, |_| 4),
            "frame {frame}"
        );
    }
    assert!(
        rig.farm.stores.log.jobs().is_empty(),
        "the log is empty at the end"
    );
    let patch = JobPatch {
        stop: Some(spp(8)),
        ..JobPatch::default()
    };
    rig.farm.patch(id, patch).await.unwrap();
    let status = rig.work(worker, id).await;
    assert_eq!(status.state, JobState::Done);
    for frame in 3..=7 {
        assert_eq!(
            rig.film_digest(id, frame),
            oracle(frame, |_| 8),
            "frame {frame}"
        );
    }
}

#[tokio::test]
async fn frames_in_memory() {
    let rig = Rig::memory().await;
    let mut request = rig.request(spp(2));
    request.frames = Some([0, 3]);
    let id = rig.submit_request(request).await;
    let worker = rig.worker("a");
    assert_eq!(rig.work(worker, id).await.state, JobState::Done);
    for frame in 0..=3 {
        assert_eq!(rig.film_digest(id, frame), oracle(frame, |_| 2));
    }
}
