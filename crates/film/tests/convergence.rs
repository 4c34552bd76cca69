//! Stops: the same samples whatever way they were reached.

mod support;

use film::convergence::is_border;
use film::{Film, Next, Receipt, SampleRange, StopRule, TileGrid, Unit, next_unit};
use support::unit;

const GRID: TileGrid = TileGrid {
    width: 16,
    height: 12,
};

/// Renders tile 0 until the rule is met; borders and errors on the way.
fn run(film: &mut Film, rule: &StopRule) -> (Vec<(u32, f64)>, bool) {
    let mut seen = vec![];
    loop {
        match next_unit(&film.tiles()[0], 0, rule) {
            Next::Done { target_met } => return (seen, target_met),
            Next::Unit(samples) => {
                let one = unit(
                    GRID,
                    Unit {
                        frame: 0,
                        tile: 0,
                        samples,
                    },
                );
                film.merge(
                    &one,
                    Receipt {
                        digest: [0; 32],
                        worker: "w".into(),
                    },
                )
                .unwrap();
                seen.push((
                    samples.end,
                    film.tiles()[0].errors().map_or(f64::NAN, |e| e.halves),
                ));
            }
        }
    }
}

fn noise(target: f64, spp: u32) -> StopRule {
    StopRule {
        noise: Some(target),
        ..StopRule::at_spp(spp)
    }
}

#[test]
fn a_tile_stops_at_its_first_quiet_border() {
    let mut film = Film::new(GRID, 0);
    let (seen, met) = run(&mut film, &noise(0.03, 4096));
    let borders: Vec<u32> = seen.iter().map(|s| s.0).collect();
    assert!(met && is_border(*borders.last().unwrap()));
    assert!(
        borders.len() > 6 && *borders.last().unwrap() < 4096,
        "{seen:?}"
    );
    let (last, before) = seen.split_last().unwrap();
    assert!(
        last.1 <= 0.03 && before.iter().all(|s| s.0 < 16 || s.1 > 0.03),
        "{seen:?}"
    );
}

#[test]
fn tightening_gives_what_a_straight_run_gives() {
    let mut straight = Film::new(GRID, 0);
    run(&mut straight, &noise(0.02, 8192));
    let mut extended = Film::new(GRID, 0);
    for rule in [noise(0.5, 30), noise(0.04, 8192), noise(0.02, 8192)] {
        run(&mut extended, &rule);
    }
    assert_eq!(extended.digest(), straight.digest());
}

#[test]
fn even_a_loose_target_needs_16_samples() {
    let mut film = Film::new(GRID, 0);
    let (seen, met) = run(&mut film, &noise(1e9, 4096));
    assert_eq!((seen.last().unwrap().0, met), (16, true));
    let (_, met) = run(&mut Film::new(GRID, 0), &noise(1e-9, 40));
    assert!(!met, "the cap comes first");
}

#[test]
fn caps_cut_a_pass_and_recorded_counts_repeat_it() {
    let mut film = Film::new(GRID, 0);
    let (seen, met) = run(&mut film, &StopRule::at_spp(100));
    let ends: Vec<u32> = seen.iter().map(|s| s.0).collect();
    assert_eq!((ends, met), (vec![1, 2, 4, 8, 16, 32, 64, 100], true));
    let mut again = Film::new(GRID, 0);
    run(
        &mut again,
        &StopRule {
            samples: Some(vec![100]),
            ..StopRule::at_spp(65_536)
        },
    );
    assert_eq!(again.digest(), film.digest());
    run(&mut film, &StopRule::at_spp(256));
    let mut straight = Film::new(GRID, 0);
    run(&mut straight, &StopRule::at_spp(256));
    assert_eq!(film.digest(), straight.digest());
}

#[test]
fn gaps_come_first() {
    let mut film = Film::new(GRID, 0);
    for (begin, end) in [(0, 1), (1, 2), (4, 8), (8, 16)] {
        let one = unit(
            GRID,
            Unit {
                frame: 0,
                tile: 0,
                samples: SampleRange { begin, end },
            },
        );
        film.merge(
            &one,
            Receipt {
                digest: [0; 32],
                worker: "w".into(),
            },
        )
        .unwrap();
    }
    let next = next_unit(&film.tiles()[0], 0, &noise(1e9, 64));
    assert_eq!(next, Next::Unit(SampleRange { begin: 2, end: 4 }));
    let beyond = next_unit(
        &film.tiles()[0],
        7,
        &StopRule {
            samples: Some(vec![9]),
            ..noise(1e-9, 64)
        },
    );
    assert_eq!(
        beyond,
        Next::Done { target_met: false },
        "a tile without a count has none"
    );
}

#[test]
fn looser_stops_are_seen() {
    let counts = |samples: &[u32]| StopRule {
        samples: Some(samples.to_vec()),
        ..StopRule::at_spp(64)
    };
    assert!(StopRule::at_spp(64).extends(&StopRule::at_spp(64), 2));
    assert!(!StopRule::at_spp(63).extends(&StopRule::at_spp(64), 2));
    assert!(noise(0.1, 64).extends(&noise(0.2, 64), 2));
    assert!(!noise(0.3, 64).extends(&noise(0.2, 64), 2));
    assert!(!noise(0.1, 64).extends(&StopRule::at_spp(64), 2));
    assert!(StopRule::at_spp(64).extends(&noise(0.2, 64), 2));
    assert!(StopRule::at_spp(64).extends(&counts(&[3, 5]), 2));
    assert!(counts(&[3, 6]).extends(&counts(&[3, 5]), 2));
    assert!(!counts(&[2, 6]).extends(&counts(&[3, 5]), 2));
}
