//! The soft edge of a shadow: a rectangular light half hidden by a screen.

use crate::common::*;
use crate::irradiance::lambert;
use glam::DVec3;
use scene::model::*;
use std::f64::consts::PI;

const COLUMNS: u32 = 40;
const X: (f64, f64) = (-1.2, 1.2);
const RHO: f64 = 0.6;
/// Height and half edges of the light, height of the screen.
const LIGHT: (f64, f64, f64) = (2.0, 0.5, 0.4);
const SCREEN: f64 = 1.0;

/// The screen covers x < 0 at its height: from a point p the part of the light with
/// x > -p (H - h) / h is seen, a smaller rectangle, whose irradiance is Lambert's formula.
fn expected(x: f64) -> f64 {
    let (height, half_x, half_z) = LIGHT;
    let edge = x + (0.0 - x) * height / SCREEN;
    let left = edge.clamp(-half_x, half_x);
    if left >= half_x {
        return 0.0;
    }
    let corners = [
        DVec3::new(left, height, -half_z),
        DVec3::new(half_x, height, -half_z),
        DVec3::new(half_x, height, half_z),
        DVec3::new(left, height, half_z),
    ];
    RHO / PI * lambert(&corners, DVec3::new(x, 0.0, 0.0), DVec3::Y)
}

fn scene(sampler: SamplerKind) -> SceneDesc {
    let mut desc = blank(COLUMNS, 64);
    as_points_below(&mut desc, X, 0.0);
    desc.integrator = Integrator::Path { max_depth: 1 };
    desc.sampler = sampler;
    desc.place(
        Shape::Rectangle,
        horizontal([0.0; 3], 10.0, 10.0),
        diffuse(RHO as f32),
    );
    desc.place(
        Shape::Rectangle,
        horizontal([-10.0, SCREEN, 0.0], 10.0, 20.0),
        diffuse(0.0),
    );
    let (height, half_x, half_z) = LIGHT;
    let light = desc.place(
        Shape::Rectangle,
        horizontal([0.0, height, 0.0], -half_x, half_z),
        diffuse(0.0),
    );
    light.emission = shining(2.0);
    desc
}

#[test]
fn has_the_profile_of_the_part_that_is_seen() {
    for sampler in [
        SamplerKind::OwenSobol,
        SamplerKind::Stratified,
        SamplerKind::Independent,
    ] {
        let picture = render(&scene(sampler), 64);
        for i in 0..COLUMNS {
            let x = column(i, COLUMNS, X);
            check(
                &format!("at x = {x:.3}, {sampler:?}"),
                &picture.column(i),
                expected(x),
            );
        }
    }
}

/// With the light as a point the same shadow has a hard edge, below the screen's.
#[test]
fn is_hard_with_one_point() {
    let mut desc = scene(SamplerKind::OwenSobol);
    desc.integrator = Integrator::Whitted { max_depth: 1 };
    let picture = render(&desc, 1);
    for i in 0..COLUMNS {
        let x = column(i, COLUMNS, X);
        let lit = picture.column(i).mean() > 0.0;
        assert_eq!(lit, x > 0.0, "at x = {x}");
    }
}
