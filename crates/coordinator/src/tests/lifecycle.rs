//! Jobs from submission to their end.

use super::support::*;
use crate::error::{GONE, LOOSER_STOP, WRONG_STATE};
use protocol::{JobPatch, JobState, Stop};

#[tokio::test]
async fn one_worker_renders_a_job() {
    let rig = Rig::memory().await;
    let id = rig.submit(Stop::default()).await;
    let status = rig.status(id);
    assert_eq!((status.width, status.height), (100, 70));
    assert_eq!(status.stop.spp, Some(8), "the file's");
    assert!(status.waiting_for.unwrap().contains("none is connected"));
    let worker = rig.worker("a");
    let status = rig.work(worker, id).await;
    assert_eq!(status.state, JobState::Done);
    assert_eq!(status.digest, hex(&oracle(0, |_| 8)));
    assert_eq!((status.spp, status.units_merged), (8.0, 16));
    assert_eq!(status.samples, 8 * 7000);
    assert_eq!(status.progress, Some(1.0));
    rig.farm.close().await;
}

#[tokio::test]
async fn pause_resume_same_bits() {
    let rig = Rig::embedded().await;
    let id = rig.submit(spp(64)).await;
    let worker = rig.worker("a");
    let leases = rig.lease(worker, 9).await;
    rig.farm.pause(id).await.unwrap();
    assert!(rig.lease(worker, 5).await.is_empty());
    // Units in work finish and are merged.
    for lease in &leases {
        rig.deliver(worker, &lease.at).await.unwrap();
    }
    let status = rig.merged(id, 9).await;
    assert_eq!(status.state, JobState::Paused);
    assert_eq!(status.waiting_for.as_deref(), Some("paused"));
    let rig = rig.restart().await;
    assert_eq!(rig.status(id).state, JobState::Paused);
    let worker = rig.worker("b");
    assert!(rig.lease(worker, 5).await.is_empty());
    rig.farm.resume(id).await.unwrap();
    let status = rig.work(worker, id).await;
    assert_eq!(status.digest, hex(&oracle(0, |_| 64)));
    assert_eq!(status.units_merged, 28);
}

#[tokio::test]
async fn extend_equals_one_shot() {
    for (first, then) in [(256, 512), (100, 300)] {
        let rig = Rig::embedded().await;
        let id = rig.submit(spp(first)).await;
        let worker = rig.worker("a");
        let status = rig.work(worker, id).await;
        assert_eq!(status.digest, hex(&oracle(0, |_| first)));
        let rig = rig.restart().await;
        assert_eq!(
            hex(&rig.film_digest(id, 0)),
            status.digest,
            "kept over a restart"
        );
        let looser = JobPatch {
            stop: Some(spp(first - 1)),
            ..JobPatch::default()
        };
        let error = rig.farm.patch(id, looser).await.unwrap_err();
        assert_eq!(error.kind(), LOOSER_STOP);
        let patch = JobPatch {
            stop: Some(spp(then)),
            ..JobPatch::default()
        };
        let status = rig.farm.patch(id, patch).await.unwrap();
        assert_eq!((status.state, status.digest), (JobState::Queued, None));
        let worker = rig.worker("b");
        let status = rig.work(worker, id).await;
        assert_eq!(status.digest, hex(&oracle(0, |_| then)));
        assert_eq!(status.spp, f64::from(then));
    }
}

#[tokio::test]
async fn a_running_job_is_extended() {
    let rig = Rig::memory().await;
    let id = rig.submit(spp(16)).await;
    let worker = rig.worker("a");
    let leases = rig.lease(worker, 10).await;
    let patch = JobPatch {
        stop: Some(spp(100)),
        priority: Some(90),
        name: Some("longer".into()),
        ..JobPatch::default()
    };
    let status = rig.farm.patch(id, patch).await.unwrap();
    assert_eq!((status.priority, status.name.as_str()), (90, "longer"));
    for lease in leases.iter().rev() {
        rig.deliver(worker, &lease.at).await.unwrap();
    }
    let status = rig.work(worker, id).await;
    assert_eq!(status.digest, hex(&oracle(0, |_| 100)));
}

#[tokio::test]
async fn cancelled_and_tried_again() {
    let rig = Rig::embedded().await;
    let id = rig.submit(spp(32)).await;
    let worker = rig.worker("a");
    let leases = rig.lease(worker, 8).await;
    for lease in &leases[..5] {
        rig.deliver(worker, &lease.at).await.unwrap();
    }
    rig.merged(id, 5).await;
    rig.farm.cancel(id).await.unwrap();
    let status = rig.farm.cancel(id).await.unwrap();
    assert_eq!(status.state, JobState::Cancelled, "twice is once");
    // Its workers hear of it, and late results are not taken.
    let held: Vec<_> = leases[5..].iter().map(|l| l.at.clone()).collect();
    let mut request = asking(worker, 0);
    request.held = held.clone();
    assert_eq!(rig.sync(request).await.cancelled, held);
    let error = rig.deliver(worker, &held[0]).await.unwrap_err();
    assert_eq!(error.kind(), GONE);
    let rig = rig.restart().await;
    assert_eq!(rig.status(id).state, JobState::Cancelled);
    assert_eq!(rig.farm.pause(id).await.unwrap_err().kind(), WRONG_STATE);
    rig.farm.retry(id).await.unwrap();
    let worker = rig.worker("b");
    let status = rig.work(worker, id).await;
    assert_eq!(status.digest, hex(&oracle(0, |_| 32)));
    assert_eq!(status.units_merged, 24);
}

/// A unit that was on its way when its job ended is not held by its worker for ever, who would be given
/// less and less.
#[tokio::test]
async fn late_results_free_their_worker() {
    let rig = Rig::memory().await;
    let held = |worker| rig.farm.state().workers[&worker].held.len();
    let worker = rig.worker("a");
    let cancelled = rig.submit(spp(4)).await;
    let leases = rig.lease(worker, 3).await;
    assert_eq!(held(worker), 3);
    rig.farm.cancel(cancelled).await.unwrap();
    for (i, lease) in leases.iter().enumerate() {
        let error = rig.deliver(worker, &lease.at).await.unwrap_err();
        assert_eq!((error.kind(), held(worker)), (GONE, 2 - i));
    }
    let deleted = rig.submit(spp(4)).await;
    let leases = rig.lease(worker, 1).await;
    rig.farm.cancel(deleted).await.unwrap();
    rig.farm.delete(deleted).await.unwrap();
    rig.deliver(worker, &leases[0].at).await.unwrap_err();
    assert_eq!(held(worker), 0);
}

#[tokio::test]
async fn time_ends_at_whole_units_and_can_be_repeated() {
    let rig = Rig::embedded().await;
    let stop = Stop {
        time: Some(0.3),
        ..Stop::default()
    };
    let id = rig.submit(stop).await;
    let worker = rig.worker("a");
    // One tile gets ahead of the others.
    let leases = rig.lease(worker, 24).await;
    for lease in leases
        .iter()
        .filter(|l| l.at.unit.tile == 2 || l.at.unit.samples.end <= 2)
    {
        rig.deliver(worker, &lease.at).await.unwrap();
    }
    let status = rig.done(id).await;
    assert!(status.render_seconds >= 0.3, "{}", status.render_seconds);
    let counts = {
        let film = crate::checkpoint::look(&rig.farm, id, 0).unwrap().unwrap();
        let film = film.read().unwrap();
        film.tiles().iter().map(|t| t.spp()).collect::<Vec<_>>()
    };
    assert!(counts[2] > counts[0] && counts[0] == 2, "{counts:?}");
    let again = Stop {
        samples: Some(counts.clone()),
        ..Stop::default()
    };
    let repeat = rig.submit(again).await;
    let repeated = rig.work(worker, repeat).await;
    assert_eq!(repeated.digest, status.digest);
    // And it goes on from there as if time had not ended it.
    let patch = JobPatch {
        stop: Some(spp(600)),
        ..JobPatch::default()
    };
    {
        rig.farm.patch(id, patch).await.unwrap();
        let status = rig.work(worker, id).await;
        assert_eq!(status.digest, hex(&oracle(0, |_| 600)));
    }
}

#[tokio::test]
async fn noise_stop_same_for_any_farm() {
    let stop = Stop {
        noise: Some(0.2),
        spp: Some(2048),
        ..Stop::default()
    };
    let mut digests = Vec::new();
    for order in 0..3 {
        let rig = Rig::memory().await;
        let id = rig.submit(stop.clone()).await;
        let worker = rig.worker("a");
        loop {
            let status = rig.status(id);
            if status.state.is_final() {
                assert_eq!(status.error_kind, "estimate");
                assert!(status.target_met.is_some());
                digests.push(status.digest);
                break;
            }
            let mut leases = rig.lease(worker, [1, 5, 40][order]).await;
            if order == 2 {
                leases.reverse();
            }
            for lease in leases {
                rig.deliver(worker, &lease.at).await.unwrap();
            }
            tokio::time::sleep(std::time::Duration::from_millis(1)).await;
        }
    }
    assert!(digests[0].is_some() && digests.iter().all(|d| *d == digests[0]));
}

#[tokio::test]
async fn a_broken_scene_fails_with_its_place() {
    let rig = Rig::memory().await;
    let mut request = rig.request(Stop::default());
    let digest = rig
        .farm
        .stores
        .blobs
        .put(b"WorldBegin\nShape \"nonsense\" \"oops\n")
        .unwrap();
    request
        .files
        .insert("scene.pbrt".into(), crate::record::hex(&digest));
    let job = crate::submit::submit(&rig.farm, request, None)
        .await
        .unwrap();
    let status = rig.wait(job.id, |s| s.state.is_final()).await;
    assert_eq!(status.state, JobState::Failed);
    let problem = status.problem.unwrap();
    assert_eq!(problem.kind, "/problems/bad-scene");
    let finding = problem.findings.first().unwrap();
    assert_eq!(finding.file, "scene.pbrt");
    assert!(finding.line.is_some());
}

#[tokio::test]
async fn deleting_frees_what_only_this_job_needed() {
    let rig = Rig::embedded().await;
    let (one, two) = (rig.submit(spp(4)).await, rig.submit(spp(4)).await);
    let worker = rig.worker("a");
    rig.work(worker, one).await;
    rig.work(worker, two).await;
    let scene = *blake3::hash(SCENE.as_bytes()).as_bytes();
    let blobs = || rig.farm.stores.blobs.list().unwrap();
    rig.farm.delete(one).await.unwrap();
    assert!(blobs().contains(&scene));
    assert_eq!(hex(&rig.film_digest(two, 0)), hex(&oracle(0, |_| 4)));
    rig.farm.delete(two).await.unwrap();
    assert_eq!(blobs(), Vec::<[u8; 32]>::new());
    assert!(rig.farm.stores.log.jobs().is_empty());
    assert!(rig.farm.status(one).is_err());
    let rig = rig.restart().await;
    assert!(rig.farm.state().jobs.is_empty());
}

/// Time alone does not render for ever: the samples end before it, and the job says so.
#[tokio::test]
async fn a_job_with_time_alone_ends_at_the_cap() {
    let rig = Rig::memory().await;
    let stop = Stop {
        time: Some(1e6),
        ..Stop::default()
    };
    let id = rig.submit(stop).await;
    let worker = rig.worker("a");
    let status = rig.work(worker, id).await;
    assert_eq!(status.samples, 65_536 * 7000);
    let said = status.warnings.iter().any(|w| w.reason.contains("65536"));
    assert!(said, "{:?}", status.warnings);
}
