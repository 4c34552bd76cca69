//! The path tracer where there are participating media: [`super::path`] with flights between surfaces
//! that may scatter, absorb and shine. Where media lie only behind surfaces, paths come here when they meet
//! one of those, and stay to their end; scenes without media never come here.
//!
//! Lights are sampled through media and through borders without a surface (interfaces); a shadow ray
//! carries the transmittance, and the density with which a flight would have passed the same way, so
//! that light sampling and scattering are weighed against each other with everything that happened in
//! between (balance heuristic over both and over the channels [Veach95], [Miller19]; see
//! [`crate::medium::track`]). A scattering event in a medium counts as one of the path's events, but for
//! those inside a translucent body: the whole walk from entering it to leaving it counts as one.

use super::path::{self, Gathered, ROULETTE_FACTOR, ROULETTE_FROM, bounded, hidden_sky};
use super::{First, Passing, sky_alpha};
use crate::bsdf::Bsdf;
use crate::geometry::{Interaction, Surface};
use crate::light::Aim;
use crate::light::Light;
use crate::material::Shading;
use crate::material::Slots;
use crate::math::{Rgb, dot, length, mean};
use crate::medium::track::{self, Carried, Flight, Shadow};
use crate::medium::{FAR, Medium, phase};
use crate::ray::{Hit, NONE, Ray};
use crate::sampler::{BounceNumbers, Sampler};
use crate::scene::Scene;
use film::{Counters, LayerSample};
use glam::Vec3;

/// Which events end a path.
#[derive(Clone, Copy)]
pub struct Limits {
    /// Scattering events.
    pub events: u32,
    /// Perfect mirrors and panes, where those are counted apart (direct light only).
    pub deltas: Option<u32>,
}

/// Most events inside translucent bodies along a path.
const WALK_MAX: u32 = 1024;

/// Where light is gathered.
#[derive(Clone, Copy)]
enum Vertex<'a> {
    Surface {
        it: &'a Interaction,
        shading: &'a Shading<'a>,
        wo: Vec3,
        /// What the surface is the border of.
        sides: Option<[u32; 2]>,
    },
    Medium {
        p: Vec3,
        /// Way of travel.
        d: Vec3,
        g: f32,
        time: f32,
    },
}

/// The medium on the side of a surface that `w` points to.
#[inline]
fn beyond(sides: Option<[u32; 2]>, it: &Interaction, w: Vec3, current: u32) -> u32 {
    match sides {
        None => current,
        Some([inside, outside]) => {
            if w.dot(it.ng) < 0.0 {
                inside
            } else {
                outside
            }
        }
    }
}

/// Radiance along a camera ray.
pub fn sample(
    scene: &Scene,
    ray: Ray,
    limits: Limits,
    sampler: &mut Sampler,
    counters: &mut Counters,
) -> LayerSample {
    let mut gathered = Gathered::NOTHING;
    let medium = scene.media.camera.unwrap_or(NONE);
    let carried = path::Carried::start(&ray);
    let start = Start {
        ray,
        hit: None,
        medium,
        carried: &carried,
    };
    follow(scene, start, limits, &mut gathered, sampler, counters);
    gathered.first.with(gathered.radiance)
}

/// Goes on with a path outside of all media whose ray has hit a surface that media lie behind, and that has
/// gathered what the surface gives off: its last vertex was weighed by the power heuristic, as this light
/// must be.
pub(super) fn go_on(
    scene: &Scene,
    (ray, hit): (Ray, Hit),
    carried: &path::Carried,
    max_depth: u32,
    gathered: &mut Gathered,
    sampler: &mut Sampler,
    counters: &mut Counters,
) {
    let start = Start {
        ray,
        hit: Some(hit),
        medium: NONE,
        carried,
    };
    let limits = Limits {
        events: max_depth,
        deltas: None,
    };
    follow(scene, start, limits, gathered, sampler, counters);
}

/// Where a path begins here.
struct Start<'a> {
    ray: Ray,
    /// The ray's hit, if that is known already, the ray counted and the light of its surface gathered.
    hit: Option<Hit>,
    medium: u32,
    carried: &'a path::Carried,
}

fn follow(
    scene: &Scene,
    start: Start,
    limits: Limits,
    gathered: &mut Gathered,
    sampler: &mut Sampler,
    counters: &mut Counters,
) {
    let hero = ((sampler.next_1d() * 3.0) as usize).min(2);
    let Start {
        mut ray,
        hit: mut known,
        mut medium,
        carried: before,
    } = start;
    let mut carried = Carried {
        beta: before.throughput,
        unidirectional: Rgb::ONE,
        light: Rgb::splat(before.last_pdf.map_or(1.0, |pdf| 1.0 / pdf)),
    };
    let Gathered {
        radiance,
        first,
        seen_first,
        travelled,
        ..
    } = gathered;
    let (mut depth, mut deltas) = (before.depth, 0);
    // Events inside translucent bodies.
    let mut walk = 0;
    let mut passing = Passing::new();
    // The surface or the point of a medium that the ray left.
    let mut from = ray.origin;
    // Whether the last direction could have been sampled from lights, and the vertex it left from.
    let mut by_lights = before.last_pdf.is_some();
    let (mut last_p, mut last_aim) = (before.last_p, before.last_aim);
    // Parts of a path live as long as the whole would.
    let mut eta_scale = before.eta_scale * before.split;

    loop {
        let is_gathered = known.is_some();
        let hit = known.take().unwrap_or_else(|| {
            counters.rays += 1;
            scene.geometry.closest(&ray)
        });
        let scale = length(ray.direction);
        if let Some(m) = scene.media.get(medium) {
            let end = if hit.is_some() { hit.t * scale } else { FAR };
            let d = ray.direction * (1.0 / scale);
            // What lies between the surface and where the ray started off it is crossed too.
            let ahead = dot(ray.origin - from, d);
            let begin = ray.origin - d * ahead;
            let end = end + ahead;
            let mut own = Rgb::ZERO;
            let mut numbers = sampler.flight();
            let flight = track::fly(
                m,
                hero,
                (begin, d),
                end,
                &mut numbers,
                &mut carried,
                &mut own,
            );
            if own != Rgb::ZERO {
                *radiance += bounded(scene, own, depth);
            }
            match flight {
                Flight::Passed => {}
                Flight::Ended => break,
                Flight::Scattered { distance, at } => {
                    let p = begin + d * distance;
                    if !*seen_first {
                        *seen_first = true;
                        let t = at.t();
                        *first = First {
                            alpha: 1.0,
                            albedo: Rgb::select(t.cmpgt(Rgb::ZERO), at.s / t, Rgb::ZERO),
                            normal: Vec3::ZERO,
                            depth: *travelled + distance,
                        };
                    }
                    carried.normalize();
                    counters.bounces += 1;
                    if m.border.is_some() {
                        // No light is sampled here: the border would be in its way.
                        walk += 1;
                        let numbers = sampler.bounce(scene.geometry.level);
                        let (wi, _) = phase::sample(m.g, d, numbers.bsdf);
                        let roulette = numbers.roulette;
                        if walk > WALK_MAX
                            || !survives(&mut carried, eta_scale, depth + walk, roulette)
                        {
                            break;
                        }
                        by_lights = false;
                        ray = Ray::new(p, wi, ray.time);
                        from = p;
                        continue;
                    }
                    if depth >= limits.events {
                        break;
                    }
                    depth += 1;
                    let numbers = sampler.bounce(scene.geometry.level);
                    let vertex = Vertex::Medium {
                        p,
                        d,
                        g: m.g,
                        time: ray.time,
                    };
                    let l = light(scene, vertex, medium, &carried, &numbers, sampler, counters);
                    *radiance += bounded(scene, l, depth);
                    let (wi, pdf) = phase::sample(m.g, d, numbers.bsdf);
                    if !survives(&mut carried, eta_scale, depth, numbers.roulette) {
                        break;
                    }
                    carried.light = carried.unidirectional / pdf;
                    by_lights = true;
                    (last_p, last_aim) = (p, Aim::ANYWHERE);
                    ray = Ray::new(p, wi, ray.time);
                    from = p;
                    continue;
                }
            }
        }
        if !hit.is_some() {
            if depth == 0 && deltas == 0 {
                if !*seen_first {
                    // A medium covers as much as it takes away.
                    let left = mean(carried.beta) / mean(carried.unidirectional);
                    let sky = sky_alpha(scene);
                    first.alpha = sky + (1.0 - sky) * (1.0 - left).clamp(0.0, 1.0);
                }
                if hidden_sky(scene) {
                    break;
                }
            }
            let l = from_infinity(scene, &ray, &carried, by_lights);
            *radiance += bounded(scene, l, depth);
            break;
        }
        let it = scene.interaction(&ray, &hit);
        let wo = ray.direction * (-1.0 / scale);
        let le = scene.emitted(&it, wo);
        if le != Rgb::ZERO && !is_gathered {
            let mut density = carried.unidirectional;
            if by_lights && it.light != NONE {
                density += carried.light * scene.lights.pdf_area(last_p, last_aim, &it);
            }
            let l = carried.beta * le * (1.0 / mean(density));
            *radiance += bounded(scene, l, depth);
        }
        let surface: &Surface = scene.geometry.surface_of(&hit);
        let numbers = sampler.bounce(scene.geometry.level);
        let slots = Slots::default();
        let Some(shading) = scene
            .materials
            .shade(&scene.textures, &it, wo, numbers.mix, &slots)
        else {
            // A border without a surface: on in the same direction. The vertex that the direction left
            // from, and its weight against light sampling, stay as they are.
            let Some(origin) = passing.pass(&it, &hit, ray.direction) else {
                break;
            };
            *travelled += hit.t * scale;
            medium = beyond(surface.media, &it, ray.direction, medium);
            ray.origin = origin;
            from = it.p;
            continue;
        };
        if !*seen_first {
            *seen_first = true;
            *first = First::surface(&it, &shading, wo, *travelled + hit.t * scale);
        }
        let border = match scene.media.get(medium) {
            Some(Medium {
                border: Some(border),
                ..
            }) if matches!(shading.bsdf, Bsdf::Dielectric(_)) => Some(border),
            _ => None,
        };
        let shading = match border {
            Some(border) => shading.with(&border.bsdf),
            None => shading,
        };
        if border.is_some() {
            walk += 1;
            if walk > WALK_MAX {
                break;
            }
        } else if depth >= limits.events {
            break;
        }
        let delta = shading.bsdf.is_delta();
        match limits.deltas {
            _ if border.is_some() => {}
            Some(most) if delta => {
                deltas += 1;
                if deltas > most {
                    break;
                }
            }
            _ => depth += 1,
        }
        counters.bounces += 1;
        carried.normalize();
        let wo_local = shading.frame.to_local(wo);
        if !delta {
            let vertex = Vertex::Surface {
                it: &it,
                shading: &shading,
                wo: wo_local,
                sides: surface.media,
            };
            let l = light(scene, vertex, medium, &carried, &numbers, sampler, counters);
            *radiance += bounded(scene, l, depth);
        }
        let Some(s) = shading.sample(wo_local, numbers.lobe, numbers.bsdf) else {
            break;
        };
        carried.beta *= s.weight;
        if s.transmitted {
            eta_scale *= match border {
                Some(border) => 1.0 / border.eta2,
                None => s.eta * s.eta,
            };
        }
        if !survives(&mut carried, eta_scale, depth + walk, numbers.roulette) {
            break;
        }
        by_lights = !s.delta;
        carried.light = carried.unidirectional / s.pdf;
        (last_p, last_aim) = (it.p, shading.aim(wo_local));
        let wi = shading.frame.to_world(s.wi);
        medium = beyond(surface.media, &it, wi, medium);
        ray = it.spawn(wi);
        from = it.p;
    }
}

/// Russian roulette on what the path still carries.
#[inline]
fn survives(carried: &mut Carried, eta_scale: f32, depth: u32, u: f32) -> bool {
    if depth < ROULETTE_FROM {
        return carried.beta != Rgb::ZERO;
    }
    let keep = (carried.beta.max_element() * eta_scale * ROULETTE_FACTOR).min(1.0);
    // A throughput of NaN ends here too: nothing compares with it.
    let goes_on = u < keep;
    if goes_on {
        carried.beta *= 1.0 / keep;
    }
    goes_on
}

/// Radiance from environments along a ray that meets nothing, weighted.
fn from_infinity(scene: &Scene, ray: &Ray, carried: &Carried, by_lights: bool) -> Rgb {
    let mut sum = Rgb::ZERO;
    for &index in &scene.lights.environments {
        let Light::Environment(e) = &scene.lights.lights[index as usize] else {
            continue;
        };
        let le = e.le(&scene.textures.images, ray.origin, ray.direction);
        let mut density = carried.unidirectional;
        if by_lights {
            density +=
                carried.light * (scene.lights.pmf_infinite() * e.pdf(ray.origin, ray.direction));
        }
        sum += carried.beta * le * (1.0 / mean(density));
    }
    sum
}

/// Light sent on at a vertex from a sampled light, weighted against sampling directions.
fn light(
    scene: &Scene,
    vertex: Vertex,
    medium: u32,
    carried: &Carried,
    numbers: &BounceNumbers,
    sampler: &mut Sampler,
    counters: &mut Counters,
) -> Rgb {
    let mut flight = sampler.flight();
    let (p, aim) = match vertex {
        Vertex::Surface {
            it, shading, wo, ..
        } => (it.p, shading.aim(wo)),
        Vertex::Medium { p, .. } => (p, Aim::ANYWHERE),
    };
    let Some((light, pmf)) = scene.lights.choose(p, aim, numbers.light_choice) else {
        return Rgb::ZERO;
    };
    let textures = &scene.textures;
    let Some(sample) = light.sample_li(textures, &scene.lights.emissions, p, numbers.light) else {
        return Rgb::ZERO;
    };
    let (f, pdf, ray, mut within) = match vertex {
        Vertex::Surface {
            it,
            shading,
            wo,
            sides,
        } => {
            let (f, pdf) = shading.eval_pdf(wo, shading.frame.to_local(sample.wi));
            let ray = match sample.target {
                Some(q) => it.spawn_to(q),
                None => it.spawn(sample.wi),
            };
            (f, pdf, ray, beyond(sides, it, sample.wi, medium))
        }
        Vertex::Medium { p, d, g, time } => {
            let f = phase::value(g, d, sample.wi);
            let ray = match sample.target {
                Some(q) => Ray {
                    origin: p,
                    direction: q - p,
                    t_max: 0.9999,
                    time,
                },
                None => Ray::new(p, sample.wi, time),
            };
            (Rgb::splat(f), f, ray, medium)
        }
    };
    if f * sample.li == Rgb::ZERO {
        return Rgb::ZERO;
    }
    // Through media and borders to the light.
    let mut ray = ray;
    let mut shadow = Shadow::START;
    let mut passing = Passing::new();
    let mut from = p;
    loop {
        counters.shadow_rays += 1;
        let hit = scene.geometry.closest(&ray);
        let blocked = hit.is_some()
            && !scene
                .materials
                .is_interface(scene.geometry.surface_of(&hit).material);
        if blocked {
            return Rgb::ZERO;
        }
        let scale = length(ray.direction);
        if let Some(m) = scene.media.get(within) {
            // A ray to a point ends a little before it; the medium does not.
            let end = match (hit.is_some(), sample.target) {
                (true, _) => hit.t * scale,
                (false, Some(_)) => scale,
                (false, None) => FAR,
            };
            let d = ray.direction * (1.0 / scale);
            let ahead = dot(ray.origin - from, d);
            let begin = ray.origin - d * ahead;
            track::shadow(m, (begin, d), end + ahead, &mut flight, &mut shadow);
            if shadow.through == Rgb::ZERO {
                return Rgb::ZERO;
            }
        }
        if !hit.is_some() {
            break;
        }
        let it = scene.interaction(&ray, &hit);
        within = beyond(
            scene.geometry.surface_of(&hit).media,
            &it,
            ray.direction,
            within,
        );
        let Some(origin) = passing.pass(&it, &hit, ray.direction) else {
            return Rgb::ZERO;
        };
        ray.origin = origin;
        from = it.p;
        if let Some(q) = sample.target {
            ray.direction = q - origin;
        }
    }
    let pdf_light = sample.pdf * pmf;
    let mut density = carried.unidirectional * pdf_light;
    if !sample.delta {
        density += carried.unidirectional * shadow.unidirectional * pdf;
    }
    carried.beta * f * sample.li * shadow.through * (1.0 / mean(density))
}
