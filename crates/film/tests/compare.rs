//! Differences between pictures, and pictures read back from our own files.

mod support;

use film::compare::{Difference, flip_map};
use film::output::color::srgb_to_linear;
use film::output::png::{Bytes8, encode_png};
use film::{Film, Look, Picture, PictureInfo, Receipt, SampleRange, TileGrid, Unit};
use film::{compare, difference_png, read_picture, write_exr, write_png};
use support::unit;

fn picture(width: usize, height: usize, value: impl Fn(usize, usize) -> [f32; 3]) -> Picture {
    let rgb = (0..width * height)
        .map(|i| value(i % width, i / width))
        .collect();
    Picture { width, height, rgb }
}

#[test]
fn numbers_by_hand() {
    let b = picture(2, 1, |x, _| [[1.0, 0.0, 0.5], [0.0, 0.0, 2.0]][x]);
    let a = picture(2, 1, |x, _| [[1.5, 0.0, 0.5], [0.1, 0.0, 1.0]][x]);
    let c = compare(&a, &b).unwrap();
    assert!((c.mse - (0.25 + 0.01 + 1.0) / 6.0).abs() < 1e-8);
    assert!((c.relmse - (0.25 / 1.01 + 0.01 / 0.01 + 1.0 / 4.01) / 6.0).abs() < 1e-7);
    assert_eq!((c.mean_b, c.not_finite), ([0.5, 0.0, 1.25], 0));
    assert!((c.means().1 - 1.75 / 3.0).abs() < 1e-12);
    assert_eq!(c.ratios()[1], None);
    assert!((c.ratios()[2].unwrap() - 0.6).abs() < 1e-12);
    let same = compare(&b, &b).unwrap();
    assert_eq!((same.mse, same.relmse, same.flip), (0.0, 0.0, 0.0));
    let bad = picture(2, 1, |_, _| [f32::NAN, 1.0, f32::INFINITY]);
    let c = compare(&bad, &b).unwrap();
    assert!(c.not_finite == 2 && c.mse.is_finite() && c.flip.is_finite());
    let error = compare(&a, &picture(1, 2, |_, _| [0.0; 3])).unwrap_err();
    assert_eq!(error.to_string(), "sizes differ: 2x1 and 1x2");
}

/// Numbers of the reference program of the authors of FLIP (1.7, LDR, defaults) for the same bytes.
#[test]
fn flip_agrees_with_its_authors() {
    let bytes = |value: &dyn Fn(usize, usize) -> [u8; 3]| {
        picture(96, 64, |x, y| {
            value(x, y).map(|b| srgb_to_linear(b as f32 / 255.0))
        })
    };
    let base = bytes(&|x, y| {
        [
            (x * 5 % 256) as u8,
            (y * 4) as u8,
            ((x / 8 + y / 8) % 2 * 180) as u8,
        ]
    });
    let moved = bytes(&|x, y| {
        let x = x.saturating_sub(2);
        [
            (x * 5 % 256) as u8,
            (y * 4) as u8,
            ((x / 8 + y / 8) % 2 * 180) as u8,
        ]
    });
    let noisy = bytes(&|x, y| {
        let n = (x * 37 + y * 101 + x * y % 17) % 41;
        [
            (x * 5 % 256) as u8 / 2 + n as u8,
            (y * 4) as u8 / 2 + 60,
            n as u8 * 3,
        ]
    });
    for (name, other, authors) in [("moved", &moved, FLIP_MOVED), ("noisy", &noisy, FLIP_NOISY)] {
        let map = flip_map(other, &base).unwrap();
        let mean = map.iter().sum::<f32>() / map.len() as f32;
        assert!(
            (mean - authors).abs() < 2e-4,
            "{name}: {mean}, theirs {authors}"
        );
    }
}

const FLIP_MOVED: f32 = 0.242_173;
const FLIP_NOISY: f32 = 0.645_433;

#[test]
fn our_own_files_read_back() {
    let grid = TileGrid {
        width: 70,
        height: 20,
    };
    let mut film = Film::new(grid, 0);
    for tile in 0..grid.count() {
        let one = unit(
            grid,
            Unit {
                frame: 0,
                tile,
                samples: SampleRange { begin: 0, end: 1 },
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
    let info = PictureInfo::of(&film, 0, "0", false);
    let exr = read_picture(&write_exr(&film, &info).unwrap()).unwrap();
    let red = film::layer::channel(&film, film::Layer::Beauty, 0);
    assert_eq!(exr.rgb.iter().map(|rgb| rgb[0]).collect::<Vec<_>>(), red);
    let png = read_picture(&write_png(&film, Look::default(), &info).unwrap()).unwrap();
    for (a, b) in png.rgb.iter().zip(&exr.rgb) {
        assert!(
            (0..3).all(|c| (a[c] - b[c].min(1.0)).abs() < 0.006),
            "{a:?} {b:?}"
        );
    }
    let map = difference_png(&png, &exr, Difference::Relative)
        .unwrap()
        .unwrap();
    assert_eq!(read_picture(&map).unwrap().width, 70);
}

#[test]
fn transparent_png_is_seen_against_black() {
    let data = vec![255, 255, 255, 0, 255, 0, 0, 255];
    let bytes = encode_png(
        &Bytes8 {
            width: 2,
            height: 1,
            channels: 4,
            data,
        },
        &[],
    )
    .unwrap();
    assert_eq!(
        read_picture(&bytes).unwrap().rgb,
        [[0.0; 3], [1.0, 0.0, 0.0]]
    );
}
