//! The order of units, decisions at borders, ends.

use super::*;

const WORKER: Uuid = Uuid::from_u128(1);

fn spp(n: u32) -> StopRule {
    StopRule::at_spp(n)
}

fn noise(target: f64, cap: u32) -> StopRule {
    StopRule {
        noise: Some(target),
        ..spp(cap)
    }
}

/// Leases, accepts and merges everything, with this error by samples.
fn drain(plan: &mut FramePlan, error: impl Fn(u32, u32) -> f64) -> Vec<Unit> {
    let mut units = Vec::new();
    while let Some(unit) = plan.lease(|_| true) {
        units.push(unit);
        plan.accept(&unit, [0; 32], WORKER);
        let at = unit.samples.end;
        plan.merged(unit.tile, at, || Some(error(unit.tile, at)));
    }
    units
}

fn names(units: &[Unit]) -> Vec<String> {
    units
        .iter()
        .map(|u| format!("{}:{}-{}", u.tile, u.samples.begin, u.samples.end))
        .collect()
}

#[test]
fn passes_go_over_all_tiles() {
    let mut plan = FramePlan::new(0, 2, spp(5));
    let units = drain(&mut plan, |_, _| 1.0);
    assert_eq!(
        names(&units),
        [
            "0:0-1", "1:0-1", "0:1-2", "1:1-2", "0:2-4", "1:2-4", "0:4-5", "1:4-5"
        ]
    );
    assert!(plan.is_complete());
}

#[test]
fn without_a_target_all_passes_are_leased_at_once() {
    let mut plan = FramePlan::new(0, 1, spp(64));
    let mut leased = 0;
    while plan.lease(|_| true).is_some() {
        leased += 1;
    }
    assert_eq!(leased, 7);
    assert!(!plan.is_complete());
}

#[test]
fn with_a_target_the_next_pass_waits_for_the_decision() {
    let mut plan = FramePlan::new(0, 1, noise(0.1, 1000));
    let mut units = Vec::new();
    while let Some(unit) = plan.lease(|_| true) {
        units.push(unit);
    }
    assert_eq!(units.last().map(|u| u.samples.end), Some(16));
    for unit in units.iter().rev() {
        plan.accept(unit, [0; 32], WORKER);
    }
    plan.merged(0, 16, || Some(0.2));
    let next = plan.lease(|_| true).unwrap();
    assert_eq!((next.samples.begin, next.samples.end), (16, 32));
    assert_eq!(plan.lease(|_| true), None);
    plan.accept(&next, [0; 32], WORKER);
    plan.merged(0, 32, || Some(0.1));
    assert!(plan.is_complete() && !plan.has_ready());
}

#[test]
fn a_target_stops_each_tile_for_itself_or_at_the_cap() {
    let mut plan = FramePlan::new(0, 3, noise(0.1, 100));
    drain(&mut plan, |tile, at| match tile {
        0 => 0.05,
        1 => 2.0 / f64::from(at),
        _ => 1.0,
    });
    assert_eq!(plan.merged_spp(), [16, 32, 100]);
    assert!(plan.is_complete());
}

#[test]
fn extend_equals_one_shot() {
    let error = |_: u32, at: u32| 1.0 / f64::from(at);
    for (first, then) in [
        (spp(256), spp(512)),
        (spp(100), spp(1500)),
        (noise(0.05, 4096), noise(0.001, 4096)),
        (noise(0.05, 20), noise(0.05, 4096)),
    ] {
        let mut plan = FramePlan::new(0, 2, first);
        drain(&mut plan, error);
        assert!(plan.is_complete());
        plan.set_goal(then.clone());
        for (tile, at) in plan.merged_spp().into_iter().enumerate() {
            plan.merged(tile as u32, at, || Some(error(0, at)));
        }
        drain(&mut plan, error);
        let mut straight = FramePlan::new(0, 2, then.clone());
        drain(&mut straight, error);
        assert!(plan.is_complete());
        assert_eq!(plan.merged_spp(), straight.merged_spp(), "{then:?}");
    }
}

#[test]
fn released_units_come_first_again() {
    let mut plan = FramePlan::new(0, 2, spp(4));
    let first = plan.lease(|_| true).unwrap();
    let second = plan.lease(|_| true).unwrap();
    plan.lease(|_| true).unwrap();
    plan.release(&first);
    assert_eq!(plan.next_begin(), Some(0));
    // A worker that may not have it gets the next one.
    assert_eq!(
        plan.lease(|u| *u != first).map(|u| u.samples.begin),
        Some(1)
    );
    assert_eq!(plan.lease(|_| true), Some(first));
    plan.release(&second);
    plan.release(&second);
    assert_eq!(plan.lease(|_| true), Some(second));
}

#[test]
fn arriving_units_are_sorted_out() {
    let mut plan = FramePlan::new(3, 1, spp(100));
    let unit = |begin, end| Unit {
        frame: 3,
        tile: 0,
        samples: SampleRange { begin, end },
    };
    plan.accept(&unit(64, 100), [7; 32], WORKER);
    assert_eq!(plan.fit(&unit(0, 1)), Fit::Wanted);
    assert!(matches!(plan.fit(&unit(64, 100)), Fit::Known(a) if a.digest == [7; 32]));
    assert_eq!(plan.fit(&unit(64, 128)), Fit::Unwanted);
    assert_eq!(plan.fit(&unit(100, 128)), Fit::Unwanted);
    assert_eq!(plan.fit(&unit(0, 2)), Fit::Foreign);
    assert_eq!(
        plan.fit(&Unit {
            frame: 2,
            ..unit(0, 1)
        }),
        Fit::Foreign
    );
    assert_eq!(
        plan.fit(&Unit {
            tile: 1,
            ..unit(0, 1)
        }),
        Fit::Foreign
    );
}

#[test]
fn time_ends_at_whole_units() {
    let mut plan = FramePlan::new(0, 3, spp(1000));
    let unit = |tile, begin, end| Unit {
        frame: 0,
        tile,
        samples: SampleRange { begin, end },
    };
    // Tile 0 is whole, tile 1 has a gap below an accepted unit, tile 2 has nothing yet.
    for u in [unit(0, 0, 1), unit(0, 1, 2), unit(1, 0, 1), unit(1, 2, 4)] {
        plan.accept(&u, [0; 32], WORKER);
    }
    plan.merged(0, 2, || None);
    plan.merged(1, 1, || None);
    assert_eq!(plan.stop_here(), [2, 4, 1]);
    let mut left = Vec::new();
    while let Some(u) = plan.lease(|_| true) {
        left.push(u);
    }
    assert_eq!(left, [unit(2, 0, 1), unit(1, 1, 2)]);
    assert_eq!(plan.fit(&unit(0, 2, 4)), Fit::Unwanted);
    for u in &left {
        plan.accept(u, [0; 32], WORKER);
    }
    plan.merged(2, 1, || None);
    assert!(!plan.is_complete());
    plan.merged(1, 4, || None);
    assert!(plan.is_complete());
}

#[test]
fn a_cleared_tile_is_decided_anew() {
    let mut plan = FramePlan::new(0, 1, noise(0.1, 1000));
    drain(&mut plan, |_, at| 3.2 / f64::from(at));
    assert_eq!(plan.merged_spp(), [32]);
    plan.clear_tile(0);
    assert!(!plan.is_complete());
    drain(&mut plan, |_, _| 0.01);
    assert_eq!(plan.merged_spp(), [16]);
    assert!(plan.is_complete());
}
