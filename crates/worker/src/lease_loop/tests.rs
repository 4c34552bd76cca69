//! What becomes of answers, without a coordinator.

use super::*;
use film::{SampleRange, Unit};
use protocol::Lease;
use std::collections::{BTreeMap, HashSet};

fn lease(job: Uuid, tile: u32) -> Lease {
    Lease {
        at: LeaseRef {
            job,
            unit: Unit {
                frame: 0,
                tile,
                samples: SampleRange { begin: 0, end: 1 },
            },
            attempt: 1,
        },
        spec_digest: "none".into(),
        engine_version: film::ENGINE_VERSION,
        expires_at: 0,
    }
}

#[tokio::test]
async fn a_repeated_answer_gives_back_nothing_that_is_held() {
    let mut config = WorkerConfig::new("http://127.0.0.1:9");
    config.threads = 1;
    let mut worker = LeaseLoop::new(config).unwrap();
    // A second for each of these units: two may wait, more than two seconds are plenty.
    worker.pace.observe(64 * 64, 1.0);
    let job = Uuid::from_u128(7);
    let spec = JobSpec {
        scene: "scene.json".into(),
        files: BTreeMap::new(),
        seed: 0,
        overrides: scene::Overrides::default(),
        size: [5 * 64, 64],
    };
    let answer = SyncResponse {
        leases: (0..5).map(|tile| lease(job, tile)).collect(),
        specs: vec![(job, spec)],
        cancelled: Vec::new(),
        give_back_unstarted: false,
        drain: false,
    };
    worker.take_response(answer.clone());
    let held: HashSet<LeaseRef> = worker.held.all().into_iter().collect();
    assert_eq!((held.len(), worker.reports.given_back.len()), (3, 2));
    worker.take_response(answer);
    assert_eq!(worker.held.all().len(), 3);
    let lost = |back: &&LeaseRef| held.contains(back);
    assert_eq!(worker.reports.given_back.iter().find(lost), None);
}
