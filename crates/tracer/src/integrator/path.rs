//! The path tracer: next-event estimation and multiple importance sampling at every vertex
//! [Kajiya86], [Veach95].

use super::{First, PASS_MAX, from_infinity, power_heuristic, sampled_light, sky_alpha};
use crate::geometry::Interaction;
use crate::light::Aim;
use crate::material::Slots;
use crate::math::Rgb;
use crate::ray::{NONE, Ray};
use crate::sampler::Sampler;
use crate::scene::Scene;
use film::{Counters, LayerSample};

/// First scattering event after which a path may end by chance.
pub(super) const ROULETTE_FROM: u32 = 2;
/// A path goes on for certain while its throughput is above the reciprocal of this: on diffuse
/// interreflection ending paths earlier costs more noise than it saves time.
pub(super) const ROULETTE_FACTOR: f32 = 3.0;

/// Radiance along a camera ray.
#[inline]
pub fn sample(
    scene: &Scene,
    mut ray: Ray,
    max_depth: u32,
    sampler: &mut Sampler,
    counters: &mut Counters,
) -> LayerSample {
    let mut radiance = Rgb::ZERO;
    let mut throughput = Rgb::ONE;
    let mut first = First::NOTHING;
    let mut seen_first = false;
    let mut depth = 0;
    let mut passed = 0;
    let mut travelled = 0.0;
    // Density of the last direction, and the vertex it left from; none after the camera and after
    // mirrors and glass, which light sampling cannot reach through.
    let mut last_pdf: Option<f32> = None;
    let mut last_p = ray.origin;
    let mut last_aim = Aim::ANYWHERE;
    // Square of the product of relative indices: radiance grows inside glass and shrinks on the way
    // out, which must not decide how long a path lives.
    let mut eta_scale = 1.0f32;

    loop {
        counters.rays += 1;
        let hit = scene.geometry.closest(&ray);
        if !hit.is_some() {
            if depth == 0 {
                first.alpha = if seen_first {
                    first.alpha
                } else {
                    sky_alpha(scene)
                };
                if !hidden_sky(scene) {
                    radiance += throughput * from_infinity(scene, &ray, None);
                }
            } else {
                radiance += bounded(
                    scene,
                    throughput * from_infinity(scene, &ray, last_pdf),
                    depth,
                );
            }
            break;
        }
        let mut it = Interaction::NONE;
        scene.find(&ray, &hit, &mut it);
        let wo = -ray.direction;
        let le = scene.emitted(&it, wo);
        if le != Rgb::ZERO {
            let weight = match last_pdf {
                Some(pdf) if it.light != NONE => {
                    power_heuristic(pdf, scene.lights.pdf_area(last_p, last_aim, &it))
                }
                _ => 1.0,
            };
            radiance += bounded(scene, throughput * le * weight, depth);
        }
        let at_limit = depth >= max_depth;
        if at_limit && seen_first {
            break;
        }
        let numbers = sampler.bounce(scene.geometry.level);
        let slots = Slots::default();
        let Some(shading) = scene
            .materials
            .shade(&scene.textures, &it, wo, numbers.mix, &slots)
        else {
            // No surface: go on in the same direction. The vertex that the direction left from, and
            // so its weight against light sampling, stay as they are.
            passed += 1;
            if passed > PASS_MAX {
                break;
            }
            travelled += hit.t;
            ray = it.spawn(ray.direction);
            continue;
        };
        if !seen_first {
            seen_first = true;
            first = First::surface(&it, &shading, wo, travelled + hit.t);
        }
        if at_limit {
            break;
        }
        depth += 1;
        counters.bounces += 1;
        let wo_local = shading.frame.to_local(wo);
        let aim = shading.aim(wo_local);
        if !shading.bsdf.is_delta() {
            let l = sampled_light(scene, &it, &shading, aim, wo_local, &numbers, counters);
            if l != Rgb::ZERO {
                radiance += bounded(scene, throughput * l, depth);
            }
        }
        let Some(s) = shading.sample(wo_local, numbers.lobe, numbers.bsdf) else {
            break;
        };
        throughput *= s.weight;
        if s.transmitted {
            eta_scale *= s.eta * s.eta;
        }
        if depth >= ROULETTE_FROM {
            let keep = (throughput.max_element() * eta_scale * ROULETTE_FACTOR).min(1.0);
            // A throughput of NaN ends here too: nothing compares with it.
            let goes_on = numbers.roulette < keep;
            if !goes_on {
                break;
            }
            throughput *= 1.0 / keep;
        }
        last_pdf = if s.delta { None } else { Some(s.pdf) };
        last_p = it.p;
        last_aim = aim;
        ray = it.spawn(shading.frame.to_world(s.wi));
    }
    first.with(radiance)
}

/// The optional, biased bound on what indirect paths carry.
#[inline(always)]
pub(super) fn bounded(scene: &Scene, radiance: Rgb, depth: u32) -> Rgb {
    let most = radiance.max_element();
    if depth >= 2 && most > scene.clamp_indirect {
        radiance * (scene.clamp_indirect / most)
    } else {
        radiance
    }
}

/// Whether the sky is not to be seen directly.
pub(super) fn hidden_sky(scene: &Scene) -> bool {
    !scene.lights.environments.is_empty() && sky_alpha(scene) == 0.0
}
