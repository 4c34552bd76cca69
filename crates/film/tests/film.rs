//! A film takes each sample once, in any order, and says what is wrong with the rest.

mod support;

use film::layer::{Layer, channel};
use film::{
    Counters, ENGINE_VERSION, EngineVersion, Film, MergeError, Merged, PackedUnit, Receipt,
    SampleBuffer, SampleRange, Square, TileGrid, Unit, UnitResult, encode_unit,
};
use proptest::prelude::*;
use support::{hash, unit};

const GRID: TileGrid = TileGrid {
    width: 70,
    height: 9,
};

fn range(begin: u32, end: u32) -> SampleRange {
    SampleRange { begin, end }
}

fn result(tile: u32, begin: u32, end: u32) -> UnitResult {
    unit(
        GRID,
        Unit {
            frame: 4,
            tile,
            samples: range(begin, end),
        },
    )
}

fn receipt(result: &UnitResult, worker: &str) -> Receipt {
    let bytes = encode_unit(result.unit, &result.buffer, &result.counters, result.engine);
    Receipt::of(&bytes, worker)
}

/// Merges a result, and into a copy its bytes, which must come to the same.
fn merge(film: &mut Film, result: &UnitResult) -> Result<Merged, MergeError> {
    let bytes = encode_unit(result.unit, &result.buffer, &result.counters, result.engine);
    let receipt = receipt(result, "ada");
    let packed = PackedUnit::read(bytes).map(|packed| {
        let mut copy = film.clone();
        (copy.merge_packed(&packed, receipt.clone()), copy)
    });
    let merged = film.merge(result, receipt);
    if let Ok((packed, copy)) = packed {
        assert_eq!(packed, merged);
        assert_eq!(copy.digest(), film.digest());
        assert_eq!(copy.counters(), film.counters());
        // Copies have no room to spare in their ledgers.
        let sizes = [&copy, &*film].map(|film| film.clone().bytes());
        assert_eq!(sizes[0], sizes[1], "planes of other widths");
        for (copy, tile) in copy.tiles().iter().zip(film.tiles()) {
            assert_eq!(copy.merged_units(), tile.merged_units());
            assert_eq!(copy.rejected(), tile.rejected());
            assert_eq!(copy.rejected_count(), tile.rejected_count());
        }
    }
    merged
}

#[test]
fn duplicates_are_known_from_other_bytes() {
    let mut film = Film::new(GRID, 4);
    let first = result(0, 0, 1);
    assert_eq!(merge(&mut film, &first), Ok(Merged::Added));
    let before = (film.digest(), film.tiles()[0].version());
    assert_eq!(
        film.merge(&first, receipt(&first, "bob")),
        Ok(Merged::AlreadyMerged)
    );
    let mut bad = first.clone();
    bad.buffer.pixels_mut()[3].beauty[1] += 1;
    let error = film.merge(&bad, receipt(&bad, "bob"));
    assert_eq!(
        error,
        Err(MergeError::OtherBytes {
            unit: bad.unit,
            worker: "ada".into()
        })
    );
    assert_eq!((film.digest(), film.tiles()[0].version()), before);
}

#[test]
fn overlaps_are_refused() {
    let mut film = Film::new(GRID, 4);
    merge(&mut film, &result(0, 64, 100)).unwrap();
    for (begin, end) in [(64, 128), (99, 128), (64, 99), (70, 80)] {
        let bad = result(0, begin, end);
        let merged = range(64, 100);
        assert_eq!(
            merge(&mut film, &bad),
            Err(MergeError::Overlap {
                unit: bad.unit,
                merged
            })
        );
    }
    assert_eq!(merge(&mut film, &result(0, 100, 128)), Ok(Merged::Added));
    assert_eq!(merge(&mut film, &result(0, 32, 64)), Ok(Merged::Added));
    assert_eq!(film.tiles()[0].ranges(), [range(32, 128)]);
    assert_eq!((film.tiles()[0].spp(), film.tiles()[0].samples()), (0, 96));
}

#[test]
fn what_does_not_belong_is_refused() {
    let mut film = Film::new(GRID, 4);
    let mut bad = result(0, 0, 1);
    bad.unit.frame = 5;
    assert!(matches!(
        merge(&mut film, &bad),
        Err(MergeError::Foreign {
            frame: 4,
            tiles: 2,
            ..
        })
    ));
    bad = result(0, 0, 1);
    bad.unit.tile = 2;
    assert!(matches!(
        merge(&mut film, &bad),
        Err(MergeError::Foreign { .. })
    ));
    bad.unit.tile = 1;
    assert_eq!(
        merge(&mut film, &bad),
        Err(MergeError::BadShape { unit: bad.unit })
    );
    bad = result(0, 0, 1);
    bad.engine = EngineVersion(7777);
    assert!(matches!(
        merge(&mut film, &bad),
        Err(MergeError::EngineVersion { .. })
    ));
    bad = result(0, 3, 5);
    assert!(matches!(
        merge(&mut film, &bad),
        Err(MergeError::OutOfRange { .. })
    ));
    bad = result(0, 0, 1);
    bad.buffer.pixels_mut()[0].square[0] = Square {
        whole: u128::MAX,
        fraction: 0,
    };
    assert!(matches!(
        merge(&mut film, &bad),
        Err(MergeError::OutOfRange { .. })
    ));
    bad = result(0, 0, 1);
    bad.buffer.pixels_mut()[0].alpha = -(1 << 31);
    assert!(matches!(
        merge(&mut film, &bad),
        Err(MergeError::OutOfRange { .. })
    ));
    assert_eq!(
        film.digest(),
        Film::new(GRID, 4).digest(),
        "an error changes nothing"
    );
    assert_eq!(film.tiles()[0].version(), 0);
}

#[test]
fn ranges_and_what_is_missing() {
    let mut film = Film::new(GRID, 4);
    assert_eq!(
        film.tiles()[0].missing(5),
        [range(0, 1), range(1, 2), range(2, 4), range(4, 5)]
    );
    for (begin, end) in [(4, 8), (0, 1), (1, 2), (600, 700)] {
        merge(&mut film, &result(0, begin, end)).unwrap();
    }
    let tile = &film.tiles()[0];
    assert_eq!(tile.ranges(), [range(0, 2), range(4, 8), range(600, 700)]);
    assert_eq!(tile.spp(), 2);
    assert_eq!(tile.missing(8), [range(2, 4)]);
    assert_eq!(tile.missing(3), [range(2, 3)]);
    let late: Vec<_> = tile.missing(1100).into_iter().skip(5).collect();
    assert_eq!(
        late,
        [
            range(128, 256),
            range(256, 512),
            range(512, 600),
            range(700, 1024),
            range(1024, 1100)
        ]
    );
    assert!(tile.contains(range(4, 8)) && tile.contains(range(0, 2)) && tile.contains(range(9, 9)));
    assert!(!tile.contains(range(1, 5)) && !tile.contains(range(0, 3)));
}

#[test]
fn a_bad_workers_tiles_are_cleared() {
    let mut film = Film::new(GRID, 4);
    merge(&mut film, &result(0, 0, 1)).unwrap();
    let mallory = result(1, 0, 1);
    film.merge(&mallory, receipt(&mallory, "mallory")).unwrap();
    merge(&mut film, &result(1, 1, 2)).unwrap();
    let clean = film.tiles()[0].digest();
    assert_eq!(film.clear_worker("nobody"), [0u32; 0]);
    assert_eq!(film.clear_worker("mallory"), [1]);
    let tile = &film.tiles()[1];
    assert_eq!((tile.spp(), tile.version(), tile.ranges().len()), (0, 3, 0));
    assert_eq!(
        (tile.counters().samples, film.tiles()[0].digest()),
        (0, clean)
    );
    assert_eq!(merge(&mut film, &mallory), Ok(Merged::Added));
    assert_eq!(film.tiles()[1].version(), 4);
}

/// Sums at their bounds for the most samples there can be: 2^24, in as few units as the schedule
/// allows.
#[test]
fn the_bounds_hold_for_all_samples() {
    let grid = TileGrid {
        width: 2,
        height: 1,
    };
    let mut film = Film::new(grid, 0);
    let mut at = 0;
    while at < film::unit::SPP_MAX {
        let samples = range(at, film::unit::pass_end(at));
        let mut one = UnitResult {
            unit: Unit {
                frame: 0,
                tile: 0,
                samples,
            },
            engine: ENGINE_VERSION,
            tile: grid.tile(0),
            counters: Counters::default(),
            buffer: SampleBuffer::new(grid.tile(0), samples),
        };
        let n = samples.len();
        for (pixel, sign) in one.buffer.pixels_mut().iter_mut().zip([1i64, -1]) {
            // What adding n samples of 2^32 gives (`fixed` has the sums, by doubling).
            let sum = (sign as i128 * n as i128) << 72;
            pixel.beauty = [sum; 3];
            pixel.half = sum;
            pixel.square = [Square {
                whole: (n as u128) << 64,
                fraction: 0,
            }; 3];
            pixel.depth = sum;
            pixel.albedo = [(sign * n as i64) << 30; 3];
            pixel.hits = n;
        }
        if at < 1 << 20 || samples.end == film::unit::SPP_MAX {
            merge(&mut film, &one).unwrap();
        } else {
            film.merge(&one, receipt(&one, "w")).unwrap();
        }
        at = samples.end;
    }
    let tile = &film.tiles()[0];
    assert_eq!(tile.spp(), 1 << 24);
    for c in 0..3 {
        let bound = 4_294_967_296.0;
        assert_eq!(channel(&film, Layer::Beauty, c), [bound, -bound]);
        assert_eq!(channel(&film, Layer::Variance, c), [0.0; 2]);
        assert_eq!(channel(&film, Layer::Albedo, c), [1024.0, -1024.0]);
    }
    assert_eq!(channel(&film, Layer::Depth, 0)[0], 4_294_967_296.0);
    assert_eq!(tile.errors().map(|e| e.squares), Some(0.0));
}

/// A cut of 0..64 into units, in some order.
fn any_cut() -> impl Strategy<Value = Vec<(u32, u32)>> {
    (
        proptest::collection::btree_set(1u32..64, 0..20),
        any::<u64>(),
    )
        .prop_map(|(mut cuts, seed)| {
            cuts.extend([1, 2, 4, 8, 16, 32, 64]);
            let mut begin = 0;
            let mut units: Vec<_> = cuts
                .into_iter()
                .map(|end| (std::mem::replace(&mut begin, end), end))
                .collect();
            units.sort_by_key(|unit| hash(seed ^ unit.0 as u64));
            units
        })
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(24))]

    /// Sums of every width and sign, on top of each other.
    #[test]
    fn packed_sums_add_up_to_the_same(seeds in proptest::collection::vec((any::<u64>(), 0u32..73), 1..7)) {
        let mut film = Film::new(GRID, 4);
        for (at, (seed, bits)) in seeds.into_iter().enumerate() {
            let begin = 512 * (at as u32 + 1);
            let mut one = UnitResult { buffer: SampleBuffer::new(GRID.tile(1), range(begin, begin + 1)), ..result(1, begin, begin + 1) };
            for (i, pixel) in one.buffer.pixels_mut().iter_mut().enumerate() {
                let at = |k: u64| hash(seed ^ (i as u64) << 8 ^ k);
                let value = |k| ((at(k) as i128) << 64 | at(k + 50) as i128) >> (127 - bits);
                pixel.beauty = [value(0), value(1), value(2) >> 30];
                pixel.half = value(3) >> 17;
                pixel.depth = value(4);
                let square = |k| Square { whole: (at(k) as u128) >> (at(k) % 64), fraction: at(k + 1) };
                pixel.square = [square(5), square(7), square(9)];
                pixel.normal = [11, 12, 13].map(|k| at(k) as i64 >> 34);
                pixel.hits = (at(14) % 2) as u32;
            }
            prop_assert_eq!(merge(&mut film, &one), Ok(Merged::Added));
        }
    }

    #[test]
    fn any_order_and_cut_give_the_same_film(cut in any_cut(), duplicate in 0usize..7) {
        let straight = {
            let mut film = Film::new(GRID, 4);
            for (begin, end) in [(0, 1), (1, 2), (2, 4), (4, 8), (8, 16), (16, 32), (32, 64)] {
                merge(&mut film, &result(1, begin, end)).unwrap();
            }
            film
        };
        let mut film = Film::new(GRID, 4);
        for &(begin, end) in &cut {
            prop_assert_ne!(film.digest(), straight.digest());
            merge(&mut film, &result(1, begin, end)).unwrap();
        }
        let (begin, end) = cut[duplicate];
        prop_assert_eq!(merge(&mut film, &result(1, begin, end)), Ok(Merged::AlreadyMerged));
        prop_assert_eq!(film.digest(), straight.digest());
        prop_assert_eq!(film.tiles()[1].errors(), straight.tiles()[1].errors());
        prop_assert_eq!(film.counters(), straight.counters());
    }
}
