//! Views of what the tracer sees: normals, albedo, depth, texture coordinates.

use super::First;
use crate::math::Rgb;
use crate::ray::Ray;
use crate::sampler::Sampler;
use crate::scene::Scene;
use ::scene::model::Integrator;
use film::{Counters, LayerSample};

/// One quantity of the first surface as a colour; black where there is none.
pub fn sample(
    scene: &Scene,
    view: &Integrator,
    ray: Ray,
    sampler: &mut Sampler,
    counters: &mut Counters,
) -> LayerSample {
    counters.rays += 1;
    let Some(hit) = scene.intersect(&ray) else {
        return LayerSample::EMPTY;
    };
    let it = scene.interaction(&ray, &hit);
    let numbers = sampler.bounce(scene.geometry.level);
    let first = match scene
        .materials
        .shade(&scene.geometry.textures, &it, numbers.mix)
    {
        Some(shading) => First::surface(&it, &shading, -ray.direction, hit.t),
        None => First::bare(&it, hit.t),
    };
    let color = match view {
        Integrator::Normals => first.normal * 0.5 + Rgb::splat(0.5),
        Integrator::Albedo => first.albedo,
        Integrator::Depth => Rgb::splat(hit.t),
        _ => Rgb::new(it.point.uv[0].x, it.point.uv[0].y, 0.0),
    };
    first.with(color)
}
