//! Parts of media against what they should be; whole pictures are in `tests/answers/media.rs`.

use super::grid::GridMedium;
use super::*;
use crate::math::{dot, normalize};
use glam::{DAffine3, DVec3, Vec3};
use scene::model::{Grid, GridValues, MediumGrid};
use std::sync::Arc;
use testkit::TestRng;
use testkit::chi2::SphereTest;

#[test]
fn directions_follow_the_phase_function() {
    let list = [-0.95, -0.5, -1e-4, 0.0, 2e-3, 0.3, 0.85];
    for (i, g) in list.into_iter().enumerate() {
        let d = normalize(Vec3::new(0.3, -0.8, 0.5));
        let test = SphereTest {
            axis: if g < 0.0 { -d } else { d }.to_array(),
            rings: 20,
            power: 2,
            tests: list.len(),
            ..SphereTest::default()
        };
        let sample = |rng: &mut TestRng| {
            let (wi, pdf) = phase::sample(g, d, rng.u2().into());
            assert!((pdf / phase::value(g, d, wi) - 1.0).abs() < 1e-6);
            Some(wi.to_array())
        };
        let density = |w: [f32; 3]| f64::from(phase::value(g, d, w.into()));
        if let Err(e) = test.run(i as u64, sample, density) {
            panic!("g = {g}: {e}");
        }
        // The mean cosine is g: what the parameter means.
        let mut rng = TestRng::new(40 + i as u64);
        let n = 200_000;
        let sum: f64 = (0..n)
            .map(|_| f64::from(dot(d, phase::sample(g, d, rng.u2().into()).0)))
            .sum();
        assert!((sum / f64::from(n) - f64::from(g)).abs() < 6e-3, "{g}");
    }
}

fn ramp(size: [u32; 3]) -> (GridMedium, Coefficients) {
    let mut values = vec![];
    for z in 0..size[2] {
        for y in 0..size[1] {
            for x in 0..size[0] {
                values.push((x * 7 + y * 3 + z * 5) as f32 % 11.0 * 0.1);
            }
        }
    }
    let grid = Arc::new(Grid {
        size,
        values: GridValues::Scalar(values),
    });
    let (a, s) = (Rgb::new(0.5, 1.0, 2.0), Rgb::new(1.0, 0.2, 0.1));
    let desc = MediumGrid {
        transform: DAffine3::from_scale_rotation_translation(
            DVec3::new(2.0, 1.0, 3.0),
            glam::DQuat::from_rotation_y(0.4),
            DVec3::new(0.3, -0.2, 0.1),
        ),
        bounds: [[-1.0, -1.0, -1.0], [1.0, 1.0, 1.0]],
        absorption: grid.clone(),
        scattering: grid,
        emission: None,
    };
    let whole = Coefficients {
        a,
        s,
        emission: Rgb::ZERO,
    };
    (GridMedium::new(&desc, a, s), whole)
}

/// The stretches of a ray join up, cover just the box, and none of their bounds is exceeded.
#[test]
fn bounds_hold_along_every_ray() {
    let mut rng = TestRng::new(3);
    for size in [[1, 1, 1], [5, 9, 3], [16, 16, 16], [300, 2, 7]] {
        let (grid, whole) = ramp(size);
        let mut met = 0;
        for _ in 0..300 {
            let o = Vec3::from(rng.direction()) * (6.0 * rng.u());
            let d = Vec3::from(rng.direction());
            let stretches: Vec<_> = grid.walk(o, d, 20.0).collect();
            for pair in stretches.windows(2) {
                assert_eq!(pair[0].to, pair[1].from);
            }
            for s in &stretches {
                assert!(s.from >= 0.0 && s.to <= 20.0 && s.to > s.from);
                met += 1;
                for i in 0..8 {
                    let t = s.from + (s.to - s.from) * (i as f32 + 0.5) / 8.0;
                    let c = grid.at(o + d * t, &whole);
                    assert!(
                        c.t().max_element() <= s.bound,
                        "{size:?}: {c:?} exceeds {s:?}"
                    );
                }
            }
        }
        assert!(met > 100, "{size:?}: only {met} stretches");
    }
}

/// Along the axes and across corners the walk neither stops short nor goes on for ever.
#[test]
fn a_walk_reaches_the_far_side() {
    let (grid, _) = ramp([16, 16, 16]);
    let length: f32 = grid
        .walk(Vec3::new(0.3, -0.2, 0.1) - Vec3::Y * 5.0, Vec3::Y, FAR)
        .map(|s| s.to - s.from)
        .sum();
    assert!((length - 2.0).abs() < 1e-4, "{length}");
    assert_eq!(grid.walk(Vec3::splat(100.0), Vec3::Y, FAR).count(), 0);
    assert_eq!(grid.walk(Vec3::ZERO, Vec3::ZERO, FAR).count(), 0);
    assert_eq!(grid.walk(Vec3::NAN, Vec3::Y, FAR).count(), 0);
}

#[test]
fn rates_lie_between_nothing_and_extinction() {
    let c = Coefficients {
        a: Rgb::new(0.0, 1.0, 3.0),
        s: Rgb::new(2.0, 0.0, 1.0),
        emission: Rgb::ZERO,
    };
    assert_eq!(rate(&c), Rgb::new(2.0, 0.0, 1.75));
}
