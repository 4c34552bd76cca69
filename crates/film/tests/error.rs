//! The two estimators against noise of known size.

mod support;

use film::error::ErrorKind;
use film::{
    Counters, ENGINE_VERSION, Film, LayerSample, PictureError, Receipt, SampleBuffer, SampleRange,
    TileGrid, Unit, UnitResult,
};
use support::hash;

/// A film of so many independent samples drawn by `value` from a uniform number.
fn film(grid: TileGrid, spp: u32, value: impl Fn(f32) -> [f32; 3]) -> Film {
    let mut film = Film::new(grid, 0);
    for index in 0..grid.count() {
        let mut begin = 0;
        while begin < spp {
            let samples = SampleRange {
                begin,
                end: film::unit::pass_end(begin).min(spp),
            };
            begin = samples.end;
            let tile = grid.tile(index);
            let mut buffer = SampleBuffer::new(tile, samples);
            for (y, x) in (0..tile.height).flat_map(|y| (0..tile.width).map(move |x| (y, x))) {
                for i in samples.begin..samples.end {
                    let u = hash(hash(
                        (index as u64) << 50 ^ (x as u64) << 40 ^ (y as u64) << 32 ^ i as u64,
                    ));
                    let beauty = value((u >> 40) as f32 / (1 << 24) as f32);
                    let sample = LayerSample {
                        beauty,
                        alpha: 1.0,
                        ..LayerSample::EMPTY
                    };
                    buffer.add(x, y, i, &sample).unwrap();
                }
            }
            let unit = Unit {
                frame: 0,
                tile: index,
                samples,
            };
            let counters = Counters::default();
            let one = UnitResult {
                unit,
                engine: ENGINE_VERSION,
                tile,
                counters,
                buffer,
            };
            film.merge(
                &one,
                Receipt {
                    digest: [0; 32],
                    worker: "w".into(),
                },
            )
            .unwrap();
        }
    }
    film
}

#[test]
fn both_are_right_for_independent_grey_samples() {
    let grid = TileGrid {
        width: 64,
        height: 64,
    };
    for spp in [16, 64, 100] {
        let film = film(grid, spp, |u| [2.0 * u; 3]);
        // Uniform on [0, 2]: mean 1, variance 1/3.
        let exact = (1.0 / 3.0 / spp as f64 / 1.01).sqrt();
        let errors = film.tiles()[0].errors().unwrap();
        // The reciprocal of the product of the halves' means is a little more than that of what it
        // estimates, the fewer the samples the more: this errs on the safe side.
        let excess = 1.0 / spp as f64;
        for (error, excess) in [(errors.halves, excess), (errors.squares, 0.0)] {
            let ratio = error / exact;
            assert!(
                (0.96..1.04 + excess).contains(&ratio),
                "{spp}: {error} for {exact}"
            );
        }
        assert_eq!(film.error().unwrap().value, errors.halves);
        assert_eq!(film.error().unwrap().kind, ErrorKind::Estimate);
    }
}

/// Channels that take turns: luminance varies less than the channels, and the bound says so.
#[test]
fn squares_bound_from_above() {
    let grid = TileGrid {
        width: 32,
        height: 32,
    };
    let film = film(grid, 64, |u| {
        if u < 0.5 {
            [1.0, 0.0, 0.0]
        } else {
            [0.0, 0.29, 0.0]
        }
    });
    let errors = film.tiles()[0].errors().unwrap();
    assert!(errors.squares > 3.0 * errors.halves, "{errors:?}");
}

#[test]
fn tiles_combine_by_pixels() {
    let grid = TileGrid {
        width: 80,
        height: 64,
    };
    let all = film(grid, 8, |u| [u; 3]);
    for kind in [ErrorKind::Estimate, ErrorKind::Bound] {
        let by_hand: f64 = [(0, 64.0), (1, 16.0)]
            .map(|(tile, width)| {
                all.tiles()[tile].errors().unwrap().of(kind).powi(2) * width / 80.0
            })
            .iter()
            .sum();
        let error = PictureError::by(&all, kind).unwrap();
        assert!((error.value - by_hand.sqrt()).abs() < 1e-12);
        assert_eq!(error.kind, kind);
    }
}

#[test]
fn too_few_samples_say_nothing() {
    let grid = TileGrid {
        width: 4,
        height: 4,
    };
    assert_eq!(film(grid, 0, |u| [u; 3]).error(), None);
    assert_eq!(film(grid, 1, |u| [u; 3]).error(), None);
    assert!(film(grid, 2, |u| [u; 3]).error().is_some());
    assert_eq!(
        film(grid, 4, |_| [0.0; 3]).error().map(|e| e.value),
        Some(0.0)
    );
}
