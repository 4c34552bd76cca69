//! Reconstruction filters by what they do to an edge.

use crate::common::*;
use glam::Vec2;
use scene::model::*;
use std::f64::consts::PI;
use tracer::camera::filter::FilterSampler;

const FILTERS: [Filter; 7] = [
    Filter::Box { radius: (0.5, 0.5) },
    Filter::Box { radius: (1.3, 0.7) },
    Filter::Tent { radius: (1.5, 1.0) },
    Filter::Gaussian {
        radius: (2.0, 1.5),
        sigma: 0.6,
    },
    Filter::Mitchell {
        radius: (2.0, 2.0),
        b: 1.0 / 3.0,
        c: 1.0 / 3.0,
    },
    Filter::BlackmanHarris { radius: (1.5, 2.0) },
    Filter::LanczosSinc {
        radius: (3.0, 3.0),
        tau: 3.0,
    },
];

/// The filter's own formula along x, not normalised.
fn value(filter: &Filter, x: f64) -> f64 {
    let t = x.abs();
    match *filter {
        Filter::Box { radius } => f64::from(t <= radius.0),
        Filter::Tent { radius } => (radius.0 - t).max(0.0),
        Filter::Gaussian { radius, sigma } => {
            let g = |t: f64| (-t * t / (2.0 * sigma * sigma)).exp();
            (g(t) - g(radius.0)).max(0.0)
        }
        Filter::Mitchell { radius, b, c } => {
            let t = 2.0 * t / radius.0;
            if t < 1.0 {
                (12.0 - 9.0 * b - 6.0 * c) * t.powi(3) + (-18.0 + 12.0 * b + 6.0 * c) * t * t + 6.0
                    - 2.0 * b
            } else if t < 2.0 {
                (-b - 6.0 * c) * t.powi(3)
                    + (6.0 * b + 30.0 * c) * t * t
                    + (-12.0 * b - 48.0 * c) * t
                    + 8.0 * b
                    + 24.0 * c
            } else {
                0.0
            }
        }
        Filter::BlackmanHarris { radius } if t <= radius.0 => {
            let phase = PI * (t / radius.0 + 1.0);
            0.35875 - 0.48829 * phase.cos() + 0.14128 * (2.0 * phase).cos()
                - 0.01168 * (3.0 * phase).cos()
        }
        Filter::LanczosSinc { radius, tau } if t <= radius.0 => {
            let sinc = |t: f64| {
                if t < 1e-9 {
                    1.0
                } else {
                    (PI * t).sin() / (PI * t)
                }
            };
            sinc(t) * sinc(t / tau)
        }
        _ => 0.0,
    }
}

/// Integral of the normalised filter above `edge`.
fn above(filter: &Filter, edge: f64) -> f64 {
    const CELLS: i32 = 40_000;
    let (mut part, mut whole) = (0.0, 0.0);
    for i in 0..CELLS {
        let x = 8.0 * (f64::from(i) + 0.5) / f64::from(CELLS) - 4.0;
        let v = value(filter, x);
        whole += v;
        part += if x > edge { v } else { 0.0 };
    }
    part / whole
}

/// A pixel whose centre lies `d` left of a bright half plane shows the filter's integral above d.
#[test]
fn edges_have_the_filters_profile() {
    for filter in FILTERS {
        let mut desc = blank(12, 64);
        desc.film.filter = filter;
        // One pixel is one unit wide; the edge is not at a pixel's border.
        desc.camera.projection = orthographic((-6.0, 6.0), (-32.0, 32.0));
        desc.place(
            Shape::Rectangle,
            spanned([100.2, 0.0, -1.0], [100.0, 0.0, 0.0], [0.0, 100.0, 0.0]),
            diffuse(0.0),
        )
        .emission = shining(1.0);
        let picture = render(&desc, 512);
        for i in 0..12 {
            let d = 0.2 - column(i, 12, (-6.0, 6.0));
            check(
                &format!("{filter:?}, {d} from the edge"),
                &picture.column(i),
                above(&filter, d),
            );
        }
    }
}

/// Weights have the mean 1; only filters with negative lobes have others than 1, and some below 0.
#[test]
fn weights_average_to_one() {
    for filter in FILTERS {
        let sampler = FilterSampler::new(&filter);
        let n = 1 << 16;
        let line = |u: &dyn Fn(f32) -> Vec2| -> Vec<f64> {
            (0..n)
                .map(|i| f64::from(sampler.sample(u((i as f32 + 0.5) / n as f32)).1))
                .collect()
        };
        // Separable: the mean along both axes through the middle, over what the middle itself weighs.
        let (x, y) = (line(&|u| Vec2::new(u, 0.5)), line(&|u| Vec2::new(0.5, u)));
        let mean = |w: &[f64]| w.iter().sum::<f64>() / w.len() as f64;
        let mean = mean(&x) * mean(&y) / f64::from(sampler.sample(Vec2::splat(0.5)).1);
        assert!((mean - 1.0).abs() < 1e-3, "{filter:?}: {mean}");
        let weights: Vec<f64> = x.into_iter().chain(y).collect();
        let lobed = matches!(filter, Filter::Mitchell { .. } | Filter::LanczosSinc { .. });
        assert_eq!(weights.iter().any(|w| *w < 0.0), lobed, "{filter:?}");
        assert!(
            lobed || weights.iter().all(|w| (*w - 1.0).abs() < 1e-5),
            "{filter:?}"
        );
    }
}
