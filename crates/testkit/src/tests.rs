//! The statistics against tables, and against samplers that are right and wrong.

use super::chi2::SphereTest;
use super::*;
use std::f64::consts::PI;

fn near(a: f64, b: f64, tolerance: f64) {
    assert!((a - b).abs() <= tolerance, "{a} is not {b}");
}

#[test]
fn distributions_match_tables() {
    near(special::ln_gamma(0.5), PI.sqrt().ln(), 1e-12);
    near(special::ln_gamma(1.0), 0.0, 1e-12);
    near(special::ln_gamma(101.0), 363.739_375_555_563_5, 1e-9);
    near(
        special::chi2_survival(3.841_458_820_694_124, 1),
        0.05,
        1e-12,
    );
    near(
        special::chi2_survival(124.342_113_404_004_1, 100),
        0.05,
        1e-10,
    );
    near(special::chi2_survival(10.0, 30), 0.999_773_0, 1e-6);
    near(
        special::student_two_sided(2.262_157_162_798_205, 9.0),
        0.05,
        1e-10,
    );
    near(special::student_two_sided(0.0, 9.0), 1.0, 1e-12);
    near(
        special::normal_two_sided(1.959_963_984_540_054),
        0.05,
        1e-12,
    );
    near(sidak(0.01, 1), 0.01, 1e-15);
    near(1.0 - (1.0 - sidak(0.01, 200)).powi(200), 0.01, 1e-12);
}

#[test]
fn quadrature_integrates_peaks_and_edges() {
    near(sphere_integral(|_| 1.0, 1e-6), 4.0 * PI, 1e-6);
    near(
        sphere_integral(|w| f64::from(w[2].max(0.0)), 1e-6),
        PI,
        1e-5,
    );
    let axis = [0.6, 0.0, 0.8];
    let n = 20_000.0;
    let lobe = |w: [f32; 3]| {
        let c = f64::from(w[0] * 0.6 + w[2] * 0.8);
        // 1 - c from the chord: the cosine has too few digits.
        let d = [w[0] - 0.6, w[1], w[2] - 0.8].map(f64::from);
        let h = 0.5 * (d[0] * d[0] + d[1] * d[1] + d[2] * d[2]);
        if c > 0.0 {
            (n * (-h).ln_1p()).exp() * (n + 1.0) / (2.0 * PI)
        } else {
            0.0
        }
    };
    near(sphere_integral_about(axis, lobe, 1e-6), 1.0, 1e-4);
}

/// Uniform directions of a hemisphere, losing a part.
fn hemisphere(rng: &mut TestRng, lost: f32) -> Option<[f32; 3]> {
    let mut w = rng.direction();
    w[2] = w[2].abs();
    (rng.u() >= lost).then_some(w)
}

#[test]
fn chi2_accepts_what_is_right() {
    let pdf = |w: [f32; 3]| if w[2] > 0.0 { 0.9 / (2.0 * PI) } else { 0.0 };
    let mut small = 0;
    for seed in 0..40 {
        let test = SphereTest {
            samples: 20_000,
            level: 1e-4,
            ..SphereTest::default()
        };
        let chi2 = test.run(seed, |rng| hemisphere(rng, 0.1), pdf).unwrap();
        small += usize::from(chi2.p < 0.1);
    }
    // p-values are uniform: 4 of 40 expected.
    assert!(
        (0..=10).contains(&small),
        "{small} of 40 p-values below 0.1"
    );
}

#[test]
fn chi2_refuses_what_is_wrong() {
    let test = SphereTest {
        axis: [0.6, 0.0, 0.8],
        power: 2,
        ..SphereTest::default()
    };
    let flat = |w: [f32; 3]| if w[2] > 0.0 { 0.5 / PI } else { 0.0 };
    let tilted = |w: [f32; 3]| flat(w) * (1.0 + 0.08 * f64::from(w[0]));
    test.run(1, |rng| hemisphere(rng, 0.0), flat).unwrap();
    test.run(1, |rng| hemisphere(rng, 0.0), tilted).unwrap_err();
    let lost = test.run(1, |rng| hemisphere(rng, 0.01), flat).unwrap_err();
    assert!(lost.to_string().contains("lost: "), "{lost}");
    // Directions where the density is zero.
    test.run(1, |rng| Some(rng.direction()), flat).unwrap_err();
    // A density of more than 1.
    test.run(1, |rng| hemisphere(rng, 0.0), |w| 1.01 * flat(w))
        .unwrap_err();
}

#[test]
fn t_and_z_tests_tell_means_apart() {
    let mut rng = TestRng::new(7);
    let m: Moments = (0..10_000).map(|_| f64::from(rng.u())).collect();
    assert!(ttest::p_value(&m, 0.5) > 0.01);
    assert!(ttest::p_value(&m, 0.52) < 1e-6);
    near(m.variance(), 1.0 / 12.0, 2e-3);
    let known = |mean| ztest::Known {
        mean,
        variance: 1e-4,
    };
    let a = [known(0.5), known(0.2)];
    assert!(ztest::compare(&a, &[known(0.51), known(0.2)], 0.01).is_ok());
    let worst = ztest::compare(&a, &[known(0.51), known(0.3)], 0.01).unwrap_err();
    assert_eq!(worst.index, 1);
}
