//! Machines that disagree, units that nobody can render.

use super::support::*;
use crate::error::{BAD_RESULT, DIGEST_MISMATCH, ENGINE_VERSION, OTHER_BYTES, QUARANTINED};
use crate::results::{Delivery, Taken};
use protocol::{JobState, LeaseFailure, LeaseRef, Stop};
use uuid::Uuid;

fn state_of(rig: &Rig, worker: Uuid) -> String {
    let now = rig.farm.clock.now();
    rig.farm.state().workers[&worker].status(now, 30_000).state
}

/// One worker is wrong about a unit that another rendered before or after it.
async fn disagree(wrong_first: bool) {
    let rig = Rig::embedded().await;
    let id = rig.submit(spp(8)).await;
    let (good, bad, third) = (rig.worker("good"), rig.worker("bad"), rig.worker("third"));
    // The bad one renders some of tile 0 and 1.
    let leases = rig.lease(bad, 6).await;
    let mut at = leases[0].at.clone();
    for lease in &leases[1..] {
        rig.send(bad, &lease.at, render(lease.at.unit))
            .await
            .unwrap();
    }
    let (first, second) = if wrong_first {
        (bad, good)
    } else {
        (good, bad)
    };
    let bytes = |worker| {
        if worker == bad {
            render_wrong(at.unit)
        } else {
            render(at.unit)
        }
    };
    assert_eq!(
        rig.send(first, &at, bytes(first)).await.unwrap(),
        Taken::New
    );
    let error = rig.send(second, &at, bytes(second)).await.unwrap_err();
    assert_eq!(error.kind(), OTHER_BYTES);
    // Neither of the two settles it.
    let unit = at.unit;
    for worker in [good, bad] {
        let more = rig.lease(worker, 99).await;
        assert!(more.iter().all(|l| l.at.unit != unit));
        for lease in more {
            rig.deliver(worker, &lease.at).await.unwrap();
        }
    }
    assert_ne!(
        rig.status(id).state,
        JobState::Done,
        "an open audit holds the job"
    );
    let audit = rig.lease(third, 1).await.remove(0);
    assert_eq!(audit.at.unit, unit);
    assert!(audit.at.attempt > 1);
    at = audit.at;
    let settled = rig.deliver(third, &at).await;
    if wrong_first {
        assert_eq!(settled.unwrap_err().kind(), OTHER_BYTES);
    } else {
        assert_eq!(settled.unwrap(), Taken::Same);
    }
    tokio::time::sleep(std::time::Duration::from_millis(20)).await;
    assert_eq!(state_of(&rig, bad), "quarantined");
    assert_eq!(state_of(&rig, good), "idle");
    let error = rig.deliver(bad, &leases[1].at).await.unwrap_err();
    assert_eq!(error.kind(), QUARANTINED);
    assert!(rig.lease(bad, 9).await.is_empty());
    // Also over a restart nothing of the bad one comes back.
    let rig = rig.restart().await;
    let good = rig.worker("good");
    let status = rig.work(good, id).await;
    assert_eq!(status.digest, hex(&oracle(0, |_| 8)));
    let film = crate::checkpoint::look(&rig.farm, id, 0).unwrap().unwrap();
    let film = film.read().unwrap();
    let units = film.tiles().iter().flat_map(|t| t.merged_units());
    assert!(units.into_iter().all(|u| *u.worker != *bad.to_string()));
}

#[tokio::test]
async fn duplicate_other_bytes_is_409_and_audited() {
    disagree(false).await;
}

#[tokio::test]
async fn bad_worker_taken_out_same_bits() {
    disagree(true).await;
}

/// Other bytes for a unit of a finished job: it is taken up again, and a third worker decides.
async fn disagree_when_done(film_is_wrong: bool, stop: Stop) {
    let rig = Rig::embedded().await;
    let id = rig.submit(stop).await;
    let (first, late, third) = (rig.worker("first"), rig.worker("late"), rig.worker("third"));
    let at = rig.lease(first, 1).await.remove(0).at;
    let (of_first, of_late) = match film_is_wrong {
        true => (render_wrong(at.unit), render(at.unit)),
        false => (render(at.unit), render_wrong(at.unit)),
    };
    rig.send(first, &at, of_first).await.unwrap();
    let done = rig.work(third, id).await;
    assert_eq!(done.state, JobState::Done);
    assert_eq!(done.digest == hex(&oracle(0, |_| 8)), !film_is_wrong);
    // Garbage opens nothing.
    let error = rig.send(late, &at, vec![1, 2, 3]).await.unwrap_err();
    assert_eq!(error.kind(), BAD_RESULT);
    assert_eq!(rig.status(id).state, JobState::Done);
    let error = rig.send(late, &at, of_late).await.unwrap_err();
    assert_eq!(error.kind(), OTHER_BYTES);
    assert_ne!(rig.status(id).state, JobState::Done);
    // Neither of the two is asked.
    for worker in [first, late] {
        assert!(rig.lease(worker, 9).await.is_empty());
    }
    let audit = loop {
        // Once the frame is read again.
        if let Some(lease) = rig.lease(third, 1).await.pop() {
            break lease.at;
        }
        tokio::time::sleep(std::time::Duration::from_millis(5)).await;
    };
    assert_eq!(audit.unit, at.unit);
    let settled = rig.deliver(third, &audit).await;
    assert_eq!(settled.is_err(), film_is_wrong, "{settled:?}");
    let done = rig.work(third, id).await;
    assert_eq!(done.digest, hex(&oracle(0, |_| 8)));
    let (good, bad) = if film_is_wrong {
        (late, first)
    } else {
        (first, late)
    };
    assert_eq!(state_of(&rig, bad), "quarantined");
    assert_eq!(state_of(&rig, good), "idle");
    let rig = rig.restart().await;
    assert_eq!(rig.status(id).state, JobState::Done);
    assert_eq!(rig.film_digest(id, 0), oracle(0, |_| 8));
}

#[tokio::test]
async fn other_bytes_after_the_end_are_audited_the_film_was_wrong() {
    disagree_when_done(true, spp(8)).await;
}

#[tokio::test]
async fn other_bytes_after_the_end_are_audited_the_late_one_was_wrong() {
    disagree_when_done(false, spp(8)).await;
}

/// A time limit that is long over cuts nothing off what is rendered again.
#[tokio::test]
async fn what_is_taken_up_again_ends_where_it_ended() {
    let stop = Stop {
        spp: Some(8),
        time: Some(1e6),
        ..Stop::default()
    };
    disagree_when_done(true, stop).await;
}

#[tokio::test]
async fn quarantine_by_hand_renders_again_what_was_touched() {
    let rig = Rig::memory().await;
    let id = rig.submit(spp(8)).await;
    let (bad, good) = (rig.worker("bad"), rig.worker("good"));
    for lease in rig.lease(bad, 3).await {
        rig.send(bad, &lease.at, render_wrong(lease.at.unit))
            .await
            .unwrap();
    }
    rig.merged(id, 3).await;
    crate::audit::quarantine(&rig.farm, bad, "on request");
    let status = rig.work(good, id).await;
    assert_eq!(status.digest, hex(&oracle(0, |_| 8)));
    assert_eq!(status.samples, 8 * 7000);
}

fn failure(at: &LeaseRef) -> LeaseFailure {
    LeaseFailure {
        lease: at.clone(),
        reason: "it burns".into(),
        scene_error: false,
        machine_error: false,
    }
}

#[tokio::test]
async fn poison_unit_fails_job_with_reason() {
    let rig = Rig::memory().await;
    let id = rig.submit(spp(8)).await;
    let mut unit = None;
    for name in ["a", "b", "c"] {
        let worker = rig.worker(name);
        let lease = rig.lease(worker, 1).await.remove(0);
        assert_eq!(*unit.get_or_insert(lease.at.unit), lease.at.unit);
        let mut request = asking(worker, 1);
        request.failed = vec![failure(&lease.at)];
        let more = rig.sync(request).await.leases;
        assert!(
            more.iter().all(|l| l.at.unit != lease.at.unit),
            "never back to who failed it"
        );
    }
    let status = rig.status(id);
    assert_eq!(status.state, JobState::Failed);
    let problem = status.problem.unwrap();
    assert_eq!(problem.kind, "/problems/poison-unit");
    let detail = problem.detail.unwrap();
    assert!(
        detail.contains("0-0-0-1") && detail.contains("it burns"),
        "{detail}"
    );
    rig.farm.retry(id).await.unwrap();
    let worker = rig.worker("d");
    assert_eq!(rig.work(worker, id).await.digest, hex(&oracle(0, |_| 8)));
}

#[tokio::test]
async fn a_scene_error_fails_at_once_a_machine_error_never() {
    let rig = Rig::memory().await;
    let id = rig.submit(spp(8)).await;
    for n in 0..5 {
        let worker = rig.worker(&format!("m{n}"));
        let lease = rig.lease(worker, 1).await.remove(0);
        let mut request = asking(worker, 0);
        request.failed = vec![LeaseFailure {
            machine_error: true,
            ..failure(&lease.at)
        }];
        rig.sync(request).await;
    }
    assert_eq!(rig.status(id).state, JobState::Running);
    let worker = rig.worker("s");
    let lease = rig.lease(worker, 1).await.remove(0);
    let mut request = asking(worker, 0);
    request.failed = vec![LeaseFailure {
        scene_error: true,
        ..failure(&lease.at)
    }];
    rig.sync(request).await;
    let problem = rig.status(id).problem.unwrap();
    assert_eq!(problem.kind, "/problems/scene-failed");
    assert_eq!(problem.detail.as_deref(), Some("it burns"));
}

#[tokio::test]
async fn a_worker_that_fails_three_times_is_blocked_and_it_is_said() {
    let rig = Rig::memory().await;
    let id = rig.submit(spp(8)).await;
    let worker = rig.worker("clumsy");
    for lease in rig.lease(worker, 3).await {
        let mut request = asking(worker, 0);
        request.failed = vec![failure(&lease.at)];
        rig.sync(request).await;
    }
    assert!(rig.lease(worker, 1).await.is_empty());
    let why = rig.status(id).waiting_for.unwrap();
    assert!(why.contains("failed this job too often"), "{why}");
    // A stale report of the same attempt counts nothing.
    let other = rig.worker("fine");
    assert_eq!(rig.work(other, id).await.state, JobState::Done);
}

#[tokio::test]
async fn damaged_and_foreign_results_are_refused_whole() {
    let rig = Rig::memory().await;
    let id = rig.submit(spp(2)).await;
    let worker = rig.worker("a");
    let at = rig.lease(worker, 1).await.remove(0).at;
    let good = render(at.unit);
    let kind = |r: Result<Taken, crate::error::ApiError>| r.unwrap_err().kind();
    for cut in [0, 10, good.len() / 2, good.len() - 1] {
        assert_eq!(
            kind(rig.send(worker, &at, good[..cut].to_vec()).await),
            BAD_RESULT
        );
    }
    let mut flipped = good.clone();
    flipped[good.len() / 2] ^= 4;
    assert_eq!(kind(rig.send(worker, &at, flipped).await), BAD_RESULT);
    let other = film::Unit { tile: 1, ..at.unit };
    assert_eq!(kind(rig.send(worker, &at, render(other)).await), BAD_RESULT);
    let result = film::decode_unit(&good).unwrap();
    let old = film::encode_unit(
        at.unit,
        &result.buffer,
        &result.counters,
        film::EngineVersion(u32::MAX),
    );
    assert_eq!(kind(rig.send(worker, &at, old).await), ENGINE_VERSION);
    let claimed = Delivery {
        job: id,
        unit: at.unit,
        worker,
        token: None,
        digest: *blake3::hash(&good).as_bytes(),
        claimed: Some([7; 32]),
        bytes: good.into(),
        cpu_seconds: 0.0,
    };
    assert_eq!(kind(rig.farm.take(claimed).await), DIGEST_MISMATCH);
    assert_eq!(rig.status(id).units_merged, 0);
    assert_eq!(rig.work(worker, id).await.digest, hex(&oracle(0, |_| 2)));
}

#[tokio::test]
async fn other_engine_version_refused() {
    let rig = Rig::memory().await;
    let mut request = about("old");
    request.engine_version = film::EngineVersion(u32::MAX);
    let error = rig.farm.register(request, None).unwrap_err();
    assert_eq!(error.kind(), ENGINE_VERSION);
    assert!(error.to_string().contains("4294967295"));
}

/// `brolly render` has the workers it started and no others.
#[tokio::test]
async fn a_job_does_not_wait_for_workers_that_will_never_be() {
    for machine_error in [false, true] {
        let rig = Rig::with_crew(1).await;
        let id = rig.submit(spp(8)).await;
        let worker = rig.worker("only");
        for attempt in 1..=3 {
            let lease = rig.lease(worker, 1).await.remove(0);
            let mut request = asking(worker, 0);
            request.failed = vec![LeaseFailure {
                machine_error,
                ..failure(&lease.at)
            }];
            rig.sync(request).await;
            let last = !machine_error || attempt == 3;
            assert_eq!(rig.status(id).state == JobState::Failed, last);
            if last {
                break;
            }
        }
        let problem = rig.status(id).problem.unwrap();
        assert_eq!(problem.kind, "/problems/poison-unit");
        let detail = problem.detail.unwrap();
        assert!(detail.contains("it burns"), "{detail}");
    }
}
