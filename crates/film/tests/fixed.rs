//! Rounding happens once and exactly, and sums hold at their bounds.

use film::buffer::{REJECTED_KEPT, in_second_half, luminance_fixed};
use film::error::second_half_of;
use film::fixed::{self, BOUNDED_MAX, VALUE_MAX, from_bounded, from_fixed, to_bounded, to_fixed};
use film::{LayerSample, Reject, SampleBuffer, SampleRange, Square, Tile};
use proptest::prelude::*;

/// Sign, significand and exponent: value = significand * 2^exponent.
fn parts(value: f32) -> (bool, u32, i32) {
    let bits = value.to_bits();
    let (exponent, fraction) = ((bits >> 23 & 0xff) as i32, bits & 0x7f_ffff);
    let (significand, exponent) = match exponent {
        0 => (fraction, -149),
        _ => (fraction | 1 << 23, exponent - 150),
    };
    (bits >> 31 == 1, significand, exponent)
}

/// Nearest integer to significand * 2^shift, ties to even, in integers alone.
fn nearest_even(significand: u64, shift: i32) -> i128 {
    if shift >= 0 {
        return (significand as i128) << shift;
    }
    let down = (-shift).min(100) as u32;
    let (value, one) = (significand as i128, 1i128 << down);
    let (whole, rest) = (value / one, value % one);
    whole + (2 * rest > one || (2 * rest == one && whole % 2 == 1)) as i128
}

fn values(most: f32) -> impl Strategy<Value = f32> {
    let near = prop_oneof![
        any::<f32>(),
        (0u32..1 << 24, -45i32..9).prop_map(|(m, e)| m as f32 * (e as f32).exp2()),
        Just(most),
        Just(0.0),
        Just(f32::MIN_POSITIVE),
    ];
    let signed = (near, any::<bool>()).prop_map(|(v, negative)| if negative { -v } else { v });
    signed.prop_filter("in bounds", move |v: &f32| v.abs() <= most)
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(4096))]

    #[test]
    fn values_round_like_exact_arithmetic(value in values(VALUE_MAX)) {
        let (negative, significand, exponent) = parts(value);
        let exact = nearest_even(significand as u64, exponent + 40);
        prop_assert_eq!(to_fixed(value), if negative { -exact } else { exact });
    }

    #[test]
    fn bounded_values_round_like_exact_arithmetic(value in values(BOUNDED_MAX)) {
        let (negative, significand, exponent) = parts(value);
        let exact = nearest_even(significand as u64, exponent + 20) as i64;
        prop_assert_eq!(to_bounded(value), if negative { -exact } else { exact });
    }

    /// Squares are rounded to the nearest step of 2^-64, ties up.
    #[test]
    fn squares_round_like_exact_arithmetic(value in values(VALUE_MAX)) {
        let (_, significand, exponent) = parts(value);
        let square = significand as u128 * significand as u128;
        let exact = if exponent >= 0 {
            Square { whole: square << (2 * exponent), fraction: 0 }
        } else {
            let down = (-2 * exponent) as u32;
            let whole = if down < 128 { square >> down } else { 0 };
            let rest = square - if down < 128 { whole << down } else { 0 };
            let fraction = match down {
                0..=64 => rest << (64 - down),
                65..=127 => (rest + (1 << (down - 65))) >> (down - 64),
                _ => 0,
            };
            Square { whole, fraction: fraction as u64 }
        };
        prop_assert_eq!(Square::of(value), exact);
    }

    #[test]
    fn sums_of_squares_carry(a in any::<(u64, u64)>(), b in any::<(u64, u64)>()) {
        let wide = |v: (u64, u64)| (v.0 as u128) << 64 | v.1 as u128;
        let of = |v: (u64, u64)| Square { whole: v.0 as u128, fraction: v.1 };
        let mut sum = of(a);
        sum += of(b);
        let (exact, carry) = wide(a).overflowing_add(wide(b));
        prop_assert_eq!(sum.whole, (exact >> 64) + ((carry as u128) << 64));
        prop_assert_eq!(sum.fraction, exact as u64);
    }

    #[test]
    fn luminance_of_sums_is_the_sum_of_luminances(
        samples in proptest::collection::vec(any::<[i64; 3]>(), 1..50)
    ) {
        let each: i128 = samples.iter().map(|s| luminance_fixed(s.map(i128::from))).sum();
        let mut sum = [0i128; 3];
        for sample in &samples {
            for c in 0..3 {
                sum[c] += sample[c] as i128;
            }
        }
        let off = luminance_fixed(sum) - each;
        prop_assert!((0..=samples.len() as i128).contains(&off));
    }

    #[test]
    fn halves_are_counted(begin in 0u32..5000, length in 0u32..700) {
        let range = SampleRange { begin, end: begin + length };
        let slow = (begin..range.end).filter(|&i| in_second_half(i)).count() as u32;
        prop_assert_eq!(second_half_of(range), slow);
    }
}

#[test]
fn halves_are_even_in_every_aligned_block() {
    for log in 1..12 {
        let size = 1u32 << log;
        for block in 0..8 {
            let range = SampleRange {
                begin: block * size,
                end: (block + 1) * size,
            };
            assert_eq!(second_half_of(range), size / 2);
        }
    }
}

/// 2^24 samples of 2^32 by doubling: no sum wraps, none loses a bit.
#[test]
fn the_largest_sums_are_exact() {
    let (mut value, mut square) = (to_fixed(VALUE_MAX), Square::of(VALUE_MAX));
    let mut bounded = to_bounded(-BOUNDED_MAX);
    for _ in 0..24 {
        value += value;
        let same = square;
        square += same;
        bounded += bounded;
    }
    assert_eq!(value, 1 << (32 + 40 + 24));
    assert_eq!((square.whole, square.fraction), (1 << (64 + 24), 0));
    assert_eq!(bounded, -(1 << (10 + 20 + 24)));
    assert_eq!(from_fixed(value), 2f64.powi(56));
    assert_eq!(square.to_f64(), 2f64.powi(88));
    assert_eq!(from_bounded(bounded), -(2f64.powi(34)));
}

/// The smallest steps survive, also beside a sun.
#[test]
fn the_smallest_steps_are_exact() {
    let step = 2f32.powi(-40);
    assert_eq!((to_fixed(step), to_fixed(-step)), (1, -1));
    assert_eq!(
        Square::of(2f32.powi(-32)),
        Square {
            whole: 0,
            fraction: 1
        }
    );
    let sun = to_fixed(4e9);
    let mut sum = sun;
    for _ in 0..1000 {
        sum += to_fixed(1e-5);
    }
    assert!((from_fixed(sum - sun) / 1e-2 - 1.0).abs() < 1e-6);
    let mut squares = Square::of(4e9);
    for _ in 0..1000 {
        squares += Square::of(1e-5);
    }
    let wall = squares.fraction as f64 / 2f64.powi(64) / 1e-7;
    assert!((wall - 1.0).abs() < 1e-6, "{wall}");
}

fn buffer() -> SampleBuffer {
    let tile = Tile {
        x: 0,
        y: 0,
        width: 4,
        height: 2,
    };
    SampleBuffer::new(tile, SampleRange { begin: 0, end: 1 })
}

#[test]
fn bad_samples_add_nothing_and_are_reported() {
    let good = LayerSample {
        beauty: [1.0; 3],
        alpha: 1.0,
        depth: 2.0,
        ..LayerSample::EMPTY
    };
    let too_large = VALUE_MAX.next_up();
    let bad = [
        (
            LayerSample {
                beauty: [1.0, f32::NAN, 0.0],
                ..good
            },
            Reject::NotFinite,
        ),
        (
            LayerSample {
                beauty: [f32::INFINITY, 0.0, 0.0],
                ..good
            },
            Reject::NotFinite,
        ),
        (
            LayerSample {
                alpha: f32::NEG_INFINITY,
                ..good
            },
            Reject::NotFinite,
        ),
        (
            LayerSample {
                albedo: [0.0, 0.0, f32::NAN],
                ..good
            },
            Reject::NotFinite,
        ),
        (
            LayerSample {
                normal: [f32::INFINITY, 0.0, 0.0],
                ..good
            },
            Reject::NotFinite,
        ),
        (
            LayerSample {
                depth: f32::NAN,
                ..good
            },
            Reject::NotFinite,
        ),
        (
            LayerSample {
                beauty: [0.0, 0.0, -too_large],
                ..good
            },
            Reject::OutOfRange,
        ),
        (
            LayerSample {
                depth: too_large,
                ..good
            },
            Reject::OutOfRange,
        ),
        (
            LayerSample {
                albedo: [BOUNDED_MAX.next_up(); 3],
                ..good
            },
            Reject::OutOfRange,
        ),
        (
            LayerSample {
                alpha: -2000.0,
                ..good
            },
            Reject::OutOfRange,
        ),
    ];
    let mut sums = buffer();
    for (at, (sample, reason)) in bad.iter().enumerate() {
        assert_eq!(
            sums.add(at as u32 % 4, at as u32 / 8, 0, sample),
            Err(*reason),
            "{sample:?}"
        );
    }
    assert_eq!(sums.pixels(), buffer().pixels());
    assert_eq!((sums.rejected_count(), sums.rejected().len()), (10, 10));
    assert_eq!((sums.rejected()[9].x, sums.rejected()[9].y), (1, 1));
    for _ in 0..20 {
        assert!(sums.add(0, 0, 0, &bad[0].0).is_err());
    }
    assert_eq!(
        (sums.rejected_count(), sums.rejected().len()),
        (30, REJECTED_KEPT)
    );
    let edge = LayerSample {
        beauty: [VALUE_MAX; 3],
        depth: VALUE_MAX,
        ..good
    };
    assert_eq!(sums.add(3, 1, 0, &edge), Ok(()));
    assert_eq!(
        sums.add(3, 1, 0, &LayerSample::EMPTY),
        Ok(()),
        "infinitely far is not an error"
    );
    assert_eq!(
        (
            sums.pixels()[7].hits,
            fixed::from_fixed(sums.pixels()[7].depth)
        ),
        (1, 2f64.powi(32))
    );
}
