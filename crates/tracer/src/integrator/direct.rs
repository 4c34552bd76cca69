//! Direct light only, with multiple importance sampling; mirrors and glass are followed. In media light
//! scatters once too.

use super::path;
use super::volpath::{self, Limits};
use crate::material::Slots;
use crate::math::Rgb;
use crate::ray::Ray;
use crate::sampler::Sampler;
use crate::scene::Scene;
use film::{Counters, LayerSample};

/// Radiance along a camera ray that is emitted, or scattered once after any number of perfect
/// mirrors and panes.
pub fn sample(
    scene: &Scene,
    ray: Ray,
    max_depth: u32,
    sampler: &mut Sampler,
    counters: &mut Counters,
) -> LayerSample {
    if scene.has_media {
        let limits = Limits {
            events: 1,
            deltas: Some(max_depth),
        };
        return volpath::sample(scene, ray, limits, sampler, counters);
    }
    let mut ray = ray;
    let mut throughput = Rgb::ONE;
    let mut layers: Option<LayerSample> = None;
    let mut total = Rgb::ZERO;
    for _ in 0..=max_depth {
        // One scattering event seen from here: the path tracer with a depth of one.
        let Some(delta) = follow(scene, &ray, sampler, counters) else {
            let seen = path::sample(scene, ray, 1, 1, sampler, counters);
            total += throughput * Rgb::from_array(seen.beauty);
            layers.get_or_insert(seen);
            break;
        };
        total += throughput * delta.emitted;
        layers.get_or_insert(delta.layers);
        let Some((next, weight)) = delta.next else {
            break;
        };
        throughput *= weight;
        ray = next;
    }
    LayerSample {
        beauty: total.to_array(),
        ..layers.unwrap_or(LayerSample::EMPTY)
    }
}

struct Followed {
    emitted: Rgb,
    layers: LayerSample,
    next: Option<(Ray, Rgb)>,
}

/// If a ray meets a perfect mirror or pane: what that gives off and the ray that goes on.
fn follow(
    scene: &Scene,
    ray: &Ray,
    sampler: &mut Sampler,
    counters: &mut Counters,
) -> Option<Followed> {
    counters.rays += 1;
    let hit = scene.intersect(ray)?;
    let it = scene.interaction(ray, &hit);
    let wo = -ray.direction;
    let numbers = sampler.bounce(scene.geometry.level);
    let slots = Slots::default();
    let shading = scene
        .materials
        .shade(&scene.textures, &it, wo, numbers.mix, &slots)?;
    if !shading.bsdf.is_delta() {
        return None;
    }
    let sampled = shading.sample(shading.frame.to_local(wo), numbers.lobe, numbers.bsdf);
    Some(Followed {
        emitted: scene.emitted(&it, wo),
        layers: super::First::surface(&it, &shading, wo, hit.t).with(Rgb::ZERO),
        next: sampled.map(|s| (it.spawn(shading.frame.to_world(s.wi)), s.weight)),
    })
}
