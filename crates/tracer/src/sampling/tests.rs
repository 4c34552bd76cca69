//! Warps against their inverses and densities.

use super::*;
use crate::math::length;
use glam::{Vec2, Vec3};
use proptest::prelude::*;
use testkit::TestRng;
use testkit::chi2::{SphereTest, compare};

fn unit() -> impl Strategy<Value = f32> {
    (0u32..1 << 24).prop_map(|i| i as f32 / 16_777_216.0)
}

fn square() -> impl Strategy<Value = Vec2> {
    (unit(), unit()).prop_map(|(x, y)| Vec2::new(x, y))
}

/// Distance on the unit torus: an azimuth of 0 may come back as nearly 1.
fn around(a: Vec2, b: Vec2) -> f32 {
    let d = (a - b).abs();
    d.x.max(d.y.min(1.0 - d.y))
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 2000, failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn disk_inverts(u in square()) {
        let p = uniform_disk_concentric(u);
        prop_assert!(p.length_squared() <= 1.0 + 1e-6);
        let v = uniform_disk_concentric_inverse(p);
        prop_assert!((u - v).abs().max_element() < 1e-5, "{u} {v}");
    }

    #[test]
    fn polygon_inverts(u in square(), blades in 3u32..12, rotation in -720.0f32..720.0) {
        let polygon = RegularPolygon::new(blades, rotation);
        let p = polygon.sample(u);
        prop_assert!(p.length() <= 1.0 + 1e-6);
        let v = polygon.inverse(p);
        // Near the centre the direction is lost; u.x runs around.
        let tolerance = 2e-6 / p.length().max(1e-9);
        let d = (u.x - v.x).abs();
        prop_assert!(d.min(1.0 - d) < tolerance + 2e-6 && (u.y - v.y).abs() < 2e-5, "{u} {p} {v}");
    }

    #[test]
    fn directions_invert(u in square()) {
        // Where sin is small, the azimuth keeps fewer digits.
        let check = |w: Vec3, v: Vec2| {
            let sin = (w.x * w.x + w.y * w.y).sqrt();
            (length(w) - 1.0).abs() < 2e-6 && around(u, v) < 1e-5 + 1e-6 / sin.max(1e-9)
        };
        let w = cosine_hemisphere(u);
        prop_assert!((length(w) - 1.0).abs() < 2e-6 && w.z >= 0.0);
        prop_assert!((u - cosine_hemisphere_inverse(w)).abs().max_element() < 1e-5);
        let w = cosine_hemisphere_polar(u);
        prop_assert!(check(w, Vec2::new(w.x * w.x + w.y * w.y, uniform_sphere_inverse(w).y)));
        let w = uniform_hemisphere(u);
        prop_assert!(w.z >= 0.0 && check(w, uniform_hemisphere_inverse(w)));
        let w = uniform_sphere(u);
        prop_assert!(check(w, uniform_sphere_inverse(w)));
    }

    #[test]
    fn cones_invert(u in square(), exponent in 0.0f32..12.0) {
        let h = crate::math::exp(-exponent);
        let w = uniform_cone(u, h);
        prop_assert!((length(w) - 1.0).abs() < 2e-6 && 1.0 - w.z <= h * 1.001 + 1e-7);
        let v = uniform_cone_inverse(w, h);
        prop_assert!((u.x - v.x).abs() < 1e-5, "{u} {v}");
    }

    #[test]
    fn power_cosine_inverts(u in square(), n in 0.0f32..100.0) {
        let w = power_cosine(u, n);
        prop_assert!((length(w) - 1.0).abs() < 2e-6 && w.z > 0.0);
        let v = power_cosine_inverse(w, n);
        prop_assert!((u.x - v.x).abs() < 2e-5, "{u} {v}");
    }

    #[test]
    fn triangle_inverts(u in square()) {
        let b = uniform_triangle(u);
        prop_assert!(b.min_element() >= 0.0 && b.x + b.y <= 1.0);
        prop_assert!((u - uniform_triangle_inverse(b)).abs().max_element() < 1e-6);
    }

    #[test]
    fn linear_and_tent_invert(u in unit(), a in 0.0f32..3.0, b in 0.01f32..3.0, r in 0.1f32..3.0) {
        let x = linear(u, a, b);
        prop_assert!((0.0..1.0).contains(&x));
        prop_assert!((linear_inverse(x, a, b) - u).abs() < 2e-6);
        let y = tent(u, r);
        prop_assert!(y.abs() <= r);
        prop_assert!((tent_inverse(y, r) - u).abs() < 2e-6);
    }

    #[test]
    fn piecewise_inverts(u in square(), values in prop::collection::vec(0.0f32..1.0, 35)) {
        let table = Piecewise1d::new(&values);
        let s = table.sample(u.x);
        prop_assert!((0.0..1.0).contains(&s.x) && s.pdf > 0.0);
        prop_assert!((table.inverse(s.x) - u.x).abs() < 1e-5);
        let cell = (s.x * 35.0) as usize;
        // Rounding may put x into the neighbour at a border.
        prop_assert!(cell == s.index || (s.x * 35.0 - (s.x * 35.0).round()).abs() < 1e-4);
        let table = Piecewise2d::new(&values, 7, 5);
        let (p, pdf) = table.sample(u);
        prop_assert!(pdf > 0.0);
        let v = table.inverse(p);
        prop_assert!((v - u).abs().max_element() < 1e-4, "{u} {p} {v}");
    }
}

/// A warp and its density.
type Warp = (
    &'static str,
    Box<dyn Fn(Vec2) -> Vec3>,
    Box<dyn Fn(Vec3) -> f32>,
);

#[test]
fn directions_follow_their_densities() {
    let up = |pdf: f32| move |w: Vec3| if w.z > 0.0 { pdf } else { 0.0 };
    let cone = 0.3;
    let mut warps: Vec<Warp> = vec![
        (
            "cosine",
            Box::new(cosine_hemisphere),
            Box::new(|w| cosine_hemisphere_pdf(w.z)),
        ),
        (
            "cosine, polar",
            Box::new(cosine_hemisphere_polar),
            Box::new(|w| cosine_hemisphere_pdf(w.z)),
        ),
        (
            "hemisphere",
            Box::new(uniform_hemisphere),
            Box::new(up(uniform_hemisphere_pdf())),
        ),
        (
            "sphere",
            Box::new(uniform_sphere),
            Box::new(|_| uniform_sphere_pdf()),
        ),
        (
            "cone",
            Box::new(move |u| uniform_cone(u, cone)),
            Box::new(move |w| {
                if 1.0 - w.z < cone {
                    uniform_cone_pdf(cone)
                } else {
                    0.0
                }
            }),
        ),
    ];
    for n in [0.0, 1.0, 7.5, 300.0, 10_000.0] {
        warps.push((
            "power cosine",
            Box::new(move |u| power_cosine(u, n)),
            Box::new(move |w| power_cosine_pdf(w.z, n)),
        ));
    }
    let tests = warps.len();
    for (name, warp, pdf) in warps {
        let test = SphereTest {
            tests,
            power: 2,
            rings: 24,
            ..SphereTest::default()
        };
        let sample = |rng: &mut TestRng| Some(warp(rng.u2().into()).to_array());
        if let Err(e) = test.run(11, sample, |w| f64::from(pdf(w.into()))) {
            panic!("{name}: {e}");
        }
    }
}

#[test]
fn polygons_and_disk_are_uniform() {
    type Map<'a> = &'a dyn Fn(Vec2) -> Vec2;
    // A grid of cells inside the inscribed circle, where each point counts the same.
    let polygon = RegularPolygon::new(6, 17.0);
    let inner = 0.5 * 3f32.sqrt();
    let disk = |u| uniform_disk_concentric(u);
    let hexagon = |u| polygon.sample(u);
    let maps: [(Map, f32, f32); 2] = [
        (&disk, uniform_disk_pdf(), 1.0),
        (&hexagon, polygon.pdf(), inner),
    ];
    for (map, pdf, radius) in maps {
        let mut rng = TestRng::new(3);
        let (n, side) = (200_000, 8usize);
        let half = radius * 0.5f32.sqrt();
        let mut observed = vec![0u64; side * side + 1];
        for _ in 0..n {
            let p = (map(rng.u2().into()) + half) / (2.0 * half) * side as f32;
            let inside = p.min_element() >= 0.0 && p.max_element() < side as f32;
            let cell = if inside {
                p.y as usize * side + p.x as usize
            } else {
                side * side
            };
            observed[cell] += 1;
        }
        let cell = f64::from(4.0 * half * half * pdf) / (side * side) as f64 * f64::from(n);
        let mut expected = vec![cell; side * side];
        expected.push(f64::from(n) - cell * (side * side) as f64);
        let chi2 = compare(&observed, &expected);
        assert!(chi2.p > 0.005, "{chi2:?}\n{observed:?}\n{expected:?}");
    }
}

#[test]
fn tables_are_drawn_by_their_values() {
    let values: Vec<f32> = (0..37)
        .map(|i| if i % 5 == 2 { 0.0 } else { (i * i % 11) as f32 })
        .collect();
    let sum: f32 = values.iter().sum();
    let n = 200_000;
    let expected: Vec<f64> = values
        .iter()
        .map(|v| f64::from(v / sum) * f64::from(n))
        .collect();
    let alias = AliasTable::new(&values);
    let piecewise = Piecewise1d::new(&values);
    assert!((alias.sum() - f64::from(sum)).abs() < 1e-9);
    assert!((piecewise.integral() - f64::from(sum) / 37.0).abs() < 1e-6);
    let mut rng = TestRng::new(9);
    let (mut by_alias, mut by_cell, mut rest) = (vec![0; 37], vec![0; 37], vec![0; 16]);
    for _ in 0..n {
        let a = alias.sample(rng.u());
        by_alias[a.index as usize] += 1;
        rest[(a.u * 16.0) as usize] += 1;
        assert!((a.pmf - values[a.index as usize] / sum).abs() < 1e-6);
        let s = piecewise.sample(rng.u());
        by_cell[s.index] += 1;
        assert!((s.pdf - values[s.index] / sum * 37.0).abs() < 1e-4 && s.pdf == piecewise.pdf(s.x));
    }
    for (name, seen) in [("alias", &by_alias), ("cells", &by_cell)] {
        let chi2 = compare(seen, &expected);
        assert!(chi2.p > 0.005, "{name}: {chi2:?}\n{seen:?}\n{expected:?}");
    }
    let chi2 = compare(&rest, &[f64::from(n) / 16.0; 16]);
    assert!(chi2.p > 0.005, "what is left over: {chi2:?} {rest:?}");
}

#[test]
fn tables_survive_odd_values() {
    for values in [vec![0.0; 5], vec![f32::NAN, -1.0, f32::INFINITY]] {
        let table = Piecewise1d::new(&values);
        assert_eq!(table.integral(), 0.0);
        assert!(
            (table.pdf(0.5) - 1.0).abs() < 1e-6,
            "uniform where nothing is left"
        );
        assert!((table.sample(0.3).x - 0.3).abs() < 1e-6);
        let alias = AliasTable::new(&values);
        assert!((alias.sample(0.999).pmf - 1.0 / values.len() as f32).abs() < 1e-6);
    }
    // One bright cell at the end, and at the start, of many dark ones.
    for bright in [0, 4095] {
        let mut values = vec![0.0; 4096];
        values[bright] = 1e9;
        let table = Piecewise1d::new(&values);
        let alias = AliasTable::new(&values);
        for u in [0.0, 1e-7, 0.5, crate::math::ONE_MINUS_EPSILON] {
            let s = table.sample(u);
            assert_eq!((s.index, s.pdf), (bright, 4096.0));
            assert_eq!(alias.sample(u).index, bright as u32);
        }
    }
    let one = Piecewise1d::new(&[3.0]);
    assert_eq!(
        one.sample(0.25),
        PiecewiseSample {
            x: 0.25,
            pdf: 1.0,
            index: 0
        }
    );
    // Values over a wide range: every draw has a positive density.
    let values: Vec<f32> = (0..1000)
        .map(|i| crate::math::powf(10.0, (i % 17) as f32 - 8.0))
        .collect();
    let table = Piecewise2d::new(&values, 40, 25);
    let mut rng = TestRng::new(5);
    for _ in 0..20_000 {
        let (p, pdf) = table.sample(rng.u2().into());
        assert!(
            pdf > 0.0 && p.min_element() >= 0.0 && p.max_element() < 1.0,
            "{p} {pdf}"
        );
    }
    let mut integral = 0.0;
    for y in 0..25 {
        for x in 0..40 {
            let p = Vec2::new((x as f32 + 0.5) / 40.0, (y as f32 + 0.5) / 25.0);
            integral += table.pdf(p) / 1000.0;
        }
    }
    assert!((integral - 1.0).abs() < 1e-4, "{integral}");
}
