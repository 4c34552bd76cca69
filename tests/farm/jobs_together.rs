//! Several jobs on one farm.

use crate::support::{TestFarm, TestScene, Tuning, outcome};

#[tokio::test(flavor = "multi_thread")]
async fn jobs_do_not_touch_each_other() {
    let scene = TestScene::room(70, 70);
    let tunings: Vec<Tuning> = (0..4)
        .map(|i| Tuning {
            seed: i,
            priority: Some(20 * i as u8),
            ..Tuning::spp(8 + i as u32)
        })
        .collect();
    let mut farm = TestFarm::start().await;
    let mut ids = Vec::new();
    for tuning in &tunings {
        ids.push(farm.submit(&scene, tuning).await);
    }
    farm.worker(1).worker(2);
    for (id, tuning) in ids.into_iter().zip(&tunings) {
        let together = farm.outcome(id).await;
        let alone = outcome(&[1], &scene, tuning).await;
        assert_eq!(together, alone, "{tuning:?}");
    }
}

/// What is urgent overtakes what came first.
#[tokio::test(flavor = "multi_thread")]
async fn priority_goes_first() {
    let scene = TestScene::room(128, 128);
    let mut farm = TestFarm::start().await;
    let low = Tuning {
        priority: Some(10),
        ..Tuning::spp(64)
    };
    let high = Tuning {
        priority: Some(90),
        ..Tuning::spp(8)
    };
    let low = farm.submit(&scene, &low).await;
    let high = farm.submit(&scene, &high).await;
    farm.worker(1);
    let (low, high) = (farm.done(low).await, farm.done(high).await);
    assert!(high.finished_at < low.finished_at);
}
