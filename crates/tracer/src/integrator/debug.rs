//! Views of what the tracer sees: normals, albedo, depth, texture coordinates. Media are looked through;
//! their borders are passed where they have no surface.

use super::First;
use crate::material::Slots;
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
    let mut ray = ray;
    let mut travelled = 0.0;
    let mut passing = super::Passing::new();
    let (it, first) = loop {
        counters.rays += 1;
        let Some(hit) = scene.intersect(&ray) else {
            return LayerSample::EMPTY;
        };
        let it = scene.interaction(&ray, &hit);
        let depth = travelled + hit.t;
        let surface = scene.geometry.surface_of(&hit);
        let is_border = scene.has_media && surface.media.is_some() && !surface.shines();
        if is_border
            && scene.materials.is_interface(it.material)
            && let Some(origin) = passing.pass(&it, &hit, ray.direction)
        {
            travelled = depth;
            ray.origin = origin;
            continue;
        }
        let wo = -ray.direction;
        let numbers = sampler.bounce(scene.geometry.level);
        let slots = Slots::default();
        let shading = scene
            .materials
            .shade(&scene.textures, &it, wo, numbers.mix, &slots);
        break match shading {
            Some(shading) => (it, First::surface(&it, &shading, wo, depth)),
            None => (it, First::bare(&it, depth)),
        };
    };
    let color = match view {
        Integrator::Normals => first.normal * 0.5 + Rgb::splat(0.5),
        Integrator::Albedo => first.albedo,
        Integrator::Depth => Rgb::splat(first.depth),
        _ => Rgb::new(it.point.uv[0].x, it.point.uv[0].y, 0.0),
    };
    first.with(color)
}
