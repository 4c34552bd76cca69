//! Lights without extent on a diffuse plane: cosine law, inverse square, the edge of a spot.

use crate::common::*;
use glam::{DAffine3, DVec3};
use scene::model::*;
use std::f64::consts::PI;

const COLUMNS: u32 = 16;
const X: (f64, f64) = (-2.0, 2.0);
const RHO: f64 = 0.6;

/// A plane y = 0 seen point by point, lit by one light.
fn lit_by(light: Light, integrator: Integrator) -> Picture {
    let mut desc = blank(COLUMNS, 4);
    as_points_below(&mut desc, X, 0.0);
    desc.integrator = integrator;
    desc.place(
        Shape::Rectangle,
        horizontal([0.0; 3], 10.0, 10.0),
        diffuse(RHO as f32),
    );
    desc.lights.push(light);
    render(&desc, 2)
}

fn compare(what: &str, light: &Light, irradiance: impl Fn(f64) -> f64) {
    for integrator in [
        Integrator::Whitted { max_depth: 2 },
        Integrator::Direct { max_depth: 2 },
        Integrator::Path { max_depth: 4 },
    ] {
        let picture = lit_by(light.clone(), integrator);
        for i in 0..COLUMNS {
            let x = column(i, COLUMNS, X);
            let (got, want) = (picture.column(i).mean(), RHO / PI * irradiance(x));
            assert!(
                (got - want).abs() <= 2e-4 * want + 1e-6,
                "{what} at x = {x} by {integrator:?}: {got}, expected {want}"
            );
        }
    }
}

#[test]
fn distant_light_goes_with_the_cosine() {
    for direction in [
        DVec3::NEG_Y,
        DVec3::new(1.0, -1.0, 0.0),
        DVec3::new(-3.0, -0.5, 2.0),
    ] {
        let light = Light::Distant {
            direction,
            irradiance: [3.0; 3],
        };
        compare("distant", &light, |_| 3.0 * -direction.normalize().y);
    }
    let from_below = Light::Distant {
        direction: DVec3::Y,
        irradiance: [3.0; 3],
    };
    compare("distant, from below", &from_below, |_| 0.0);
}

/// A shining surface of opacity 0 lights the scene, and nobody sees it.
#[test]
fn an_invisible_surface_shines() {
    for integrator in [
        Integrator::Direct { max_depth: 2 },
        Integrator::Path { max_depth: 4 },
    ] {
        let picture = |alpha: Option<f32>| {
            let mut desc = blank(COLUMNS, 4);
            as_points_below(&mut desc, X, 0.0);
            desc.integrator = integrator;
            desc.place(
                Shape::Rectangle,
                horizontal([0.0; 3], 10.0, 10.0),
                diffuse(RHO as f32),
            );
            // Faces down, beside what the camera sees.
            let at = spanned([0.0, 1.0, -3.0], [0.0, 0.0, 0.5], [0.5, 0.0, 0.0]);
            let lamp = desc.place(Shape::Rectangle, at, diffuse(0.0));
            lamp.emission = shining(5.0);
            lamp.reverse_orientation = true;
            lamp.alpha = alpha.map(FloatTex::Const);
            render(&desc, 64).moments().mean()
        };
        let (seen, unseen) = (picture(None), picture(Some(0.0)));
        assert!(seen > 1e-3, "{seen}");
        assert!((unseen / seen - 1.0).abs() < 0.05, "{unseen}, {seen}");
    }
}

#[test]
fn point_light_goes_with_the_inverse_square() {
    for height in [0.3, 1.0, 20.0] {
        let light = Light::Point {
            transform: at(0.5, height, 0.0),
            intensity: [5.0; 3],
        };
        compare("point", &light, |x| {
            let d2 = (x - 0.5) * (x - 0.5) + height * height;
            5.0 * height / (d2 * d2.sqrt())
        });
    }
}

#[test]
fn spot_has_the_edge_that_it_says() {
    for falloff in [SpotFalloff::SmoothStep, SpotFalloff::Squared] {
        // +Z of light space points down.
        let transform = DAffine3::from_translation(DVec3::new(0.0, 1.0, 0.0))
            * DAffine3::from_rotation_x(PI / 2.0);
        let light = Light::Spot {
            transform,
            intensity: [5.0; 3],
            cone_angle: 55.0,
            full_angle: 20.0,
            falloff,
        };
        compare("spot", &light, |x| {
            let cos = 1.0 / (1.0 + x * x).sqrt();
            let (c0, c1) = (55f64.to_radians().cos(), 20f64.to_radians().cos());
            let t = ((cos - c0) / (c1 - c0)).clamp(0.0, 1.0);
            let edge = match falloff {
                SpotFalloff::SmoothStep => t * t * (3.0 - 2.0 * t),
                SpotFalloff::Squared => t * t,
            };
            5.0 * edge * cos * cos * cos
        });
    }
}

/// Several lights of very different strength: choosing one of them is unbiased.
#[test]
fn lights_add_up() {
    let mut desc = blank(COLUMNS, 64);
    as_points_below(&mut desc, X, 0.0);
    desc.integrator = Integrator::Path { max_depth: 1 };
    desc.sampler = SamplerKind::Independent;
    desc.place(
        Shape::Rectangle,
        horizontal([0.0; 3], 10.0, 10.0),
        diffuse(RHO as f32),
    );
    let points = [
        (-1.5, 0.4, 0.2),
        (0.3, 2.0, 4.0),
        (1.7, 0.8, 0.0),
        (9.0, 3.0, 30.0),
        (0.0, -1.0, 50.0),
    ];
    for (x, y, intensity) in points {
        desc.lights.push(Light::Point {
            transform: at(x, y, 0.0),
            intensity: [intensity as f32; 3],
        });
    }
    desc.lights.push(Light::Distant {
        direction: DVec3::NEG_Y,
        irradiance: [0.2; 3],
    });
    desc.lights.push(sky(0.1));
    let picture = render(&desc, 1024);
    for i in 0..COLUMNS {
        let x = column(i, COLUMNS, X);
        let from = |&(lx, h, intensity): &(f64, f64, f64)| {
            let d2 = (x - lx) * (x - lx) + h * h;
            if h > 0.0 {
                intensity * h / (d2 * d2.sqrt())
            } else {
                0.0
            }
        };
        let irradiance = points.iter().map(from).sum::<f64>() + 0.2 + 0.1 * PI;
        check(
            &format!("at x = {x}"),
            &picture.column(i),
            RHO / PI * irradiance,
        );
    }
}
