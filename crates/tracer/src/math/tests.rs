//! Errors of the elementary functions against `libm` in double precision; frames.

use super::*;
use glam::Vec3;

/// Largest error of `ours` over `n` steps of [lo, hi], and where it is.
fn worst(
    lo: f64,
    hi: f64,
    n: usize,
    ours: impl Fn(f32) -> f32,
    exact: impl Fn(f64) -> f64,
    scale: impl Fn(f64) -> f64,
) -> (f64, f32) {
    let mut worst = (0.0, 0.0);
    for i in 0..=n {
        let x = (lo + (hi - lo) * i as f64 / n as f64) as f32;
        let want = exact(f64::from(x));
        let error = (f64::from(ours(x)) - want).abs() / scale(want);
        assert!(!error.is_nan(), "NaN at {x}");
        if error > worst.0 {
            worst = (error, x);
        }
    }
    worst
}

#[test]
fn elementary_functions_are_accurate() {
    const N: usize = 400_000;
    let tau = 2.0 * std::f64::consts::PI;
    let one = |_: f64| 1.0;
    let relative = |v: f64| v.abs().max(1e-30);
    let checks = [
        (
            "sin 2 pi u",
            worst(
                0.0,
                1.0,
                N,
                |u| sin_cos_2pi(u).0,
                |u| libm::sin(tau * u),
                one,
            ),
            1.2e-7,
        ),
        (
            "cos 2 pi u",
            worst(
                0.0,
                1.0,
                N,
                |u| sin_cos_2pi(u).1,
                |u| libm::cos(tau * u),
                one,
            ),
            1.2e-7,
        ),
        ("exp", worst(-87.0, 88.7, N, exp, libm::exp, relative), 2e-7),
        (
            "exp near 0",
            worst(-1.0, 1.0, N, exp, libm::exp, relative),
            2e-7,
        ),
        (
            "ln",
            worst(1e-3, 40.0, N, ln, libm::log, |v| v.abs().max(1.0)),
            1.5e-7,
        ),
        (
            "ln large",
            worst(1.0, 1e30, N, ln, libm::log, |v| v.abs().max(1.0)),
            1.5e-7,
        ),
        ("asin", worst(-1.0, 1.0, N, asin, libm::asin, one), 3e-7),
        ("acos", worst(-1.0, 1.0, N, acos, libm::acos, one), 4e-7),
        (
            "acos near 1, relative",
            worst(0.9999, 0.999_999_9, N, acos, libm::acos, relative),
            3e-7,
        ),
        (
            "pow 3000",
            worst(
                0.98,
                1.0,
                N,
                |x| powf(x, 3000.0),
                |x| libm::pow(x, 3000.0),
                relative,
            ),
            1e-7,
        ),
        (
            "pow 1/2.4",
            worst(
                1e-3,
                4.0,
                N,
                |x| powf(x, 0.416_666_7),
                |x| libm::pow(x, f64::from(0.416_666_7f32)),
                relative,
            ),
            1e-7,
        ),
        (
            "atan2",
            worst(
                -3.13,
                3.13,
                N,
                |a| atan2((f64::from(a).sin_()) as f32, (f64::from(a).cos_()) as f32),
                |a| libm::atan2(f64::from(a.sin_() as f32), f64::from(a.cos_() as f32)),
                one,
            ),
            3e-7,
        ),
    ];
    for (name, (error, at), limit) in checks {
        println!("{name}: {error:.2e} at {at}");
        assert!(
            error < limit,
            "{name}: error {error:e} at {at}, limit {limit:e}"
        );
    }
}

/// Double-precision functions without the system's library.
trait Libm {
    fn sin_(self) -> f64;
    fn cos_(self) -> f64;
}
impl Libm for f64 {
    fn sin_(self) -> f64 {
        libm::sin(self)
    }
    fn cos_(self) -> f64 {
        libm::cos(self)
    }
}

#[test]
fn special_values() {
    assert_eq!(exp(f32::NEG_INFINITY), 0.0);
    assert_eq!(exp(f32::INFINITY), f32::INFINITY);
    assert_eq!(exp(0.0), 1.0);
    assert!(exp(f32::NAN).is_nan());
    assert_eq!(ln(0.0), f32::NEG_INFINITY);
    assert_eq!(ln(1.0), 0.0);
    assert_eq!(ln(f32::INFINITY), f32::INFINITY);
    assert!(ln(-1.0).is_nan() && ln(f32::NAN).is_nan());
    assert!((ln(1e-42) - libm::logf(1e-42)).abs() < 1e-4);
    assert_eq!(powf(0.0, 2.0), 0.0);
    assert_eq!(powf(0.0, 0.0), 1.0);
    assert_eq!(powf(0.5, 3.0), 0.125);
    assert_eq!(powf(0.5, 1e6), 0.0);
    assert_eq!(powf(2.0, 1e6), f32::INFINITY);
    assert!(powf(-1.0, 2.0).is_nan() && powf(f32::NAN, 2.0).is_nan());
    assert_eq!(atan2(0.0, 0.0), 0.0);
    assert_eq!(atan2(0.0, 1.0), 0.0);
    assert_eq!(atan2(0.0, -1.0), PI);
    assert_eq!(atan2(1.0, 0.0), FRAC_PI_2);
    assert_eq!(atan2(-1.0, 0.0), -FRAC_PI_2);
    assert_eq!(acos(1.0), 0.0);
    assert_eq!(acos(2.0), 0.0);
    assert_eq!(acos(-1.0), PI);
    assert_eq!(sin_cos_2pi(0.0), (0.0, 1.0));
    assert_eq!(sin_cos_2pi(0.25), (1.0, 0.0));
    assert_eq!(sin_cos_2pi(0.5), (0.0, -1.0));
}

#[test]
fn frames_are_orthonormal() {
    for i in 0..2000 {
        let (s, c) = sin_cos_2pi(i as f32 * 0.618_034 % 1.0);
        let z = 1.0 - 2.0 * (i as f32 / 1999.0);
        let r = safe_sqrt(1.0 - z * z);
        let n = normalize(Vec3::new(r * c, r * s, z));
        for frame in [
            Frame::from_normal(n),
            Frame::from_normal_tangent(n, Vec3::new(0.3, -2.0, 0.1)),
            Frame::from_normal_tangent(n, n),
            Frame::from_normal_tangent(n, Vec3::NAN),
        ] {
            let ok = |v: f32, want: f32| (v - want).abs() < 5e-6;
            assert!(ok(dot(frame.s, frame.s), 1.0), "{frame:?}");
            assert!(ok(dot(frame.t, frame.t), 1.0), "{frame:?}");
            assert!(ok(dot(frame.s, frame.t), 0.0), "{frame:?}");
            assert!(
                ok(dot(frame.s, n), 0.0) && ok(dot(frame.t, n), 0.0),
                "{frame:?}"
            );
            assert!(
                ok(dot(frame.s.cross(frame.t), n), 1.0),
                "left-handed: {frame:?}"
            );
            let v = Vec3::new(0.2, -0.5, 1.5);
            assert!(
                length(frame.to_local(frame.to_world(v)) - v) < 1e-5,
                "{frame:?}"
            );
        }
    }
}
