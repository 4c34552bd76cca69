//! The path tracer: next-event estimation and multiple importance sampling at every vertex
//! [Kajiya86], [Veach95].
//!
//! What happens at a vertex is here, in the order in which it must be rounded; [`sample`] does it for one
//! path, `stream` for many side by side.

use super::{First, PASS_MAX, from_infinity, power_heuristic, sky_alpha, volpath};
use crate::geometry::Interaction;
use crate::guide::{self, Guide, Guided, Mark};
use crate::light::Aim;
use crate::material::{Shading, Slots};
use crate::math::{Rgb, luminance};
use crate::ray::{NONE, Ray};
use crate::sampler::{BounceNumbers, Sampler};
use crate::scene::Scene;
use crate::split::SPLIT_MAX;
use film::{Counters, LayerSample};
use glam::Vec3;

/// First scattering event after which a path may end by chance.
pub(super) const ROULETTE_FROM: u32 = 2;
/// A path goes on for certain while its throughput is above the reciprocal of this: on diffuse
/// interreflection ending paths earlier costs more noise than it saves time.
pub(super) const ROULETTE_FACTOR: f32 = 4.0;

/// What a path carries from one vertex to the next.
#[derive(Clone, Copy)]
pub(super) struct Carried {
    pub throughput: Rgb,
    /// Square of the product of relative indices: radiance grows inside glass and shrinks on the way
    /// out, which must not decide how long a path lives.
    pub eta_scale: f32,
    /// Density of the last direction; none after the camera and after mirrors and glass, which light
    /// sampling cannot reach through.
    pub last_pdf: Option<f32>,
    /// The vertex that the last direction left from.
    pub last_p: Vec3,
    /// What lights were chosen for there.
    pub last_aim: Aim,
    /// Scattering events.
    pub depth: u32,
    /// Into how many the path was split: each lives as long as the whole would.
    pub split: f32,
    /// Luminance that the camera is expected to see, if a guide knows; else 0.
    pub expected: f32,
    /// Density that the last direction was drawn with, guidance and roulette included, for a guide that learns.
    pub drawn: f32,
}

impl Carried {
    /// From the camera.
    pub(super) fn start(ray: &Ray) -> Carried {
        Carried {
            throughput: Rgb::ONE,
            eta_scale: 1.0,
            last_pdf: None,
            last_p: ray.origin,
            last_aim: Aim::ANYWHERE,
            depth: 0,
            split: 1.0,
            expected: 0.0,
            drawn: 0.0,
        }
    }

    /// One of the paths that this one is split into at its first vertex.
    pub(super) fn part(&self, split: u32) -> Carried {
        let split = split as f32;
        Carried {
            throughput: self.throughput * (1.0 / split),
            split,
            ..*self
        }
    }
}

/// What a path has gathered.
#[derive(Clone, Copy)]
pub(super) struct Gathered {
    pub radiance: Rgb,
    pub first: First,
    /// `first` is what the camera sees; before, the path has met nothing but borders without a surface.
    pub seen_first: bool,
    /// How many of those.
    pub passed: u32,
    /// How far, until `first`.
    pub travelled: f32,
}

impl Gathered {
    /// Nothing yet.
    pub(super) const NOTHING: Gathered = Gathered {
        radiance: Rgb::ZERO,
        first: First::NOTHING,
        seen_first: false,
        passed: 0,
        travelled: 0.0,
    };

    /// Nothing yet, by a path that begins behind the first surface.
    const LATER: Gathered = Gathered {
        seen_first: true,
        ..Gathered::NOTHING
    };
}

/// Light that arrives unless something stands in the way.
pub(super) struct Shadow {
    /// The way.
    pub ray: Ray,
    /// What it adds to the path's radiance.
    pub light: Rgb,
}

/// Radiance along a camera ray, one path by itself: the reference for streams. At the first vertex it is
/// split into several, each with numbers of its own, which share what the camera ray has cost.
pub fn sample(
    scene: &Scene,
    ray: Ray,
    max_depth: u32,
    split: u32,
    sampler: &mut Sampler,
    counters: &mut Counters,
) -> LayerSample {
    let mut others = [Rgb::ZERO; SPLIT_MAX as usize];
    let others = &mut others[1..split as usize];
    let mut gathered = Gathered::NOTHING;
    let start = Carried::start(&ray);
    let mut follower = Follower {
        scene,
        max_depth,
        counters,
    };
    follower.follow(ray, start, &mut gathered, sampler, others);
    let radiance = others.iter().fold(gathered.radiance, |sum, r| sum + *r);
    gathered.first.with(radiance)
}

/// What is the same for all paths of a sample.
struct Follower<'a> {
    scene: &'a Scene,
    max_depth: u32,
    counters: &'a mut Counters,
}

impl Follower<'_> {
    /// Follows a path to its end. What the paths that it is split into at its first vertex gather, besides
    /// itself, goes to `others`.
    fn follow(
        &mut self,
        mut ray: Ray,
        mut carried: Carried,
        gathered: &mut Gathered,
        sampler: &mut Sampler,
        mut others: &mut [Rgb],
    ) {
        let scene = self.scene;
        loop {
            self.counters.rays += 1;
            let hit = scene.geometry.closest(&ray);
            if !hit.is_some() {
                escape(scene, &ray, &carried, gathered);
                break;
            }
            let mut it = Interaction::NONE;
            scene.find(&ray, &hit, &mut it);
            let wo = -ray.direction;
            shine(scene, &it, wo, &carried, gathered);
            if scene.leads_to_media(&hit) {
                let (max_depth, counters) = (self.max_depth, &mut *self.counters);
                let met = (ray, hit);
                volpath::go_on(scene, met, &carried, max_depth, gathered, sampler, counters);
                break;
            }
            if carried.depth >= self.max_depth && gathered.seen_first {
                break;
            }
            let mut numbers = sampler.bounce(scene.geometry.level);
            let slots = Slots::default();
            let others = std::mem::take(&mut others);
            let Some(shading) =
                scene
                    .materials
                    .shade(&scene.textures, &it, wo, numbers.mix, &slots)
            else {
                let Some(next) = pass(&it, &ray, hit.t, gathered) else {
                    break;
                };
                ray = next;
                continue;
            };
            see(&it, &shading, wo, hit.t, gathered);
            if carried.depth >= self.max_depth {
                break;
            }
            if !others.is_empty() {
                let split = others.len() as u32 + 1;
                carried = carried.part(split);
                sampler.split(split);
                numbers = sampler.part(0).bounce(scene.geometry.level);
                for (i, other) in others.iter_mut().enumerate() {
                    let mut sampler = sampler.part(i as u32 + 1);
                    let numbers = sampler.bounce(scene.geometry.level);
                    let mut carried = carried;
                    let mut gathered = Gathered::LATER;
                    let vertex = (&it, &shading, wo, &numbers);
                    if let Some(next) = self.scatter(vertex, &mut carried, &mut gathered) {
                        self.follow(next, carried, &mut gathered, &mut sampler, &mut []);
                    }
                    *other = gathered.radiance;
                }
            }
            let vertex = (&it, &shading, wo, &numbers);
            let Some(next) = self.scatter(vertex, &mut carried, gathered) else {
                break;
            };
            ray = next;
        }
    }

    /// [`scatter`], and the light that arrives.
    fn scatter(
        &mut self,
        (it, shading, wo, numbers): (&Interaction, &Shading, Vec3, &BounceNumbers),
        carried: &mut Carried,
        gathered: &mut Gathered,
    ) -> Option<Ray> {
        self.counters.bounces += 1;
        let (shadow, next) = scatter(self.scene, it, shading, wo, numbers, carried);
        if let Some(shadow) = shadow {
            self.counters.shadow_rays += 1;
            if !self.scene.geometry.occluded(&shadow.ray) {
                gathered.radiance += shadow.light;
            }
        }
        next
    }
}

/// Nothing is hit any more.
pub(super) fn escape(scene: &Scene, ray: &Ray, carried: &Carried, gathered: &mut Gathered) {
    if carried.depth > 0 {
        let light = carried.throughput * from_infinity(scene, ray, carried.last_pdf);
        gathered.radiance += bounded(scene, light, carried.depth);
        return;
    }
    if !gathered.seen_first {
        gathered.first.alpha = sky_alpha(scene);
    }
    if !hidden_sky(scene) {
        gathered.radiance += carried.throughput * from_infinity(scene, ray, None);
    }
}

/// What a surface gives off.
#[inline]
pub(super) fn shine(
    scene: &Scene,
    it: &Interaction,
    wo: Vec3,
    carried: &Carried,
    gathered: &mut Gathered,
) {
    let le = scene.emitted(it, wo);
    if le == Rgb::ZERO {
        return;
    }
    let weight = match carried.last_pdf {
        Some(pdf) if it.light != NONE => {
            let by_light = scene.lights.pdf_area(carried.last_p, carried.last_aim, it);
            power_heuristic(pdf, by_light)
        }
        _ => 1.0,
    };
    gathered.radiance += bounded(scene, carried.throughput * le * weight, carried.depth);
}

/// Goes on in the same direction where there is no surface; `None` after too many. The vertex that the
/// direction left from, and so its weight against light sampling, stay as they are.
pub(super) fn pass(it: &Interaction, ray: &Ray, t: f32, gathered: &mut Gathered) -> Option<Ray> {
    gathered.passed += 1;
    gathered.travelled += t;
    (gathered.passed <= PASS_MAX).then(|| it.spawn(ray.direction))
}

/// Keeps the layers of the first surface.
#[inline]
pub(super) fn see(it: &Interaction, shading: &Shading, wo: Vec3, t: f32, gathered: &mut Gathered) {
    if !gathered.seen_first {
        gathered.seen_first = true;
        gathered.first = First::surface(it, shading, wo, gathered.travelled + t);
    }
}

/// Light that a sampled light sends on, and the ray that goes on, if any.
#[inline]
pub(super) fn scatter(
    scene: &Scene,
    it: &Interaction,
    shading: &Shading,
    wo: Vec3,
    numbers: &BounceNumbers,
    carried: &mut Carried,
) -> (Option<Shadow>, Option<Ray>) {
    carried.depth += 1;
    let world_wo = wo;
    let wo = shading.frame.to_local(wo);
    let aim = shading.aim(wo);
    let shadow = if shading.bsdf.is_delta() {
        None
    } else {
        light(scene, it, shading, aim, wo, numbers, carried)
    };
    let guided = match &scene.guide {
        None => Guided::without(shading.sample(wo, numbers.lobe, numbers.bsdf)),
        Some(guide) => {
            let mark = guide::mark_of(guide, it, shading, world_wo);
            expect(guide, mark, it.p, carried);
            match guide.directions(mark) {
                Some(directions) => directions.guide(shading, wo, numbers),
                None => Guided::without(shading.sample(wo, numbers.lobe, numbers.bsdf)),
            }
        }
    };
    let Some(Guided { s, drawn, comes }) = guided else {
        return (shadow, None);
    };
    carried.throughput *= s.weight;
    carried.drawn = drawn;
    // Directions that light comes from are found more often, so that each carries less: that must not end them.
    if comes.is_some() {
        carried.eta_scale *= drawn / s.pdf;
    }
    if s.transmitted {
        carried.eta_scale *= s.eta * s.eta;
    }
    if carried.depth >= ROULETTE_FROM {
        let keep = match comes {
            Some(comes) if carried.expected > 0.0 => {
                let throughput = luminance(carried.throughput) * carried.split;
                guide::keep(throughput, comes, carried.expected)
            }
            _ => {
                let strongest = carried.throughput.max_element();
                (strongest * carried.eta_scale * (ROULETTE_FACTOR * carried.split)).min(1.0)
            }
        };
        let goes_on = numbers.roulette < keep;
        if !goes_on {
            return (shadow, None);
        }
        carried.throughput *= 1.0 / keep;
        carried.drawn *= keep;
    }
    carried.last_pdf = if s.delta { None } else { Some(s.pdf) };
    carried.last_p = it.p;
    carried.last_aim = aim;
    (shadow, Some(it.spawn(shading.frame.to_world(s.wi))))
}

/// What the camera is expected to see, at the first vertex where a guide knows.
#[inline(always)]
pub(super) fn expect(guide: &Guide, mark: Mark, p: Vec3, carried: &mut Carried) {
    if let Some(way) = mark.way()
        && carried.expected == 0.0
    {
        let throughput = luminance(carried.throughput) * carried.split;
        carried.expected = throughput * guide.sent(p, way);
    }
}

/// Light sent to `wo` from a sampled light, weighted against sampling the BSDF.
#[inline]
fn light(
    scene: &Scene,
    it: &Interaction,
    shading: &Shading,
    aim: Aim,
    wo: Vec3,
    numbers: &BounceNumbers,
    carried: &Carried,
) -> Option<Shadow> {
    let (light, pmf) = scene.lights.choose(it.p, aim, numbers.light_choice)?;
    let emissions = &scene.lights.emissions;
    let sample = light.sample_li(&scene.textures, emissions, it.p, numbers.light)?;
    let (f, pdf_bsdf) = shading.eval_pdf(wo, shading.frame.to_local(sample.wi));
    if f == Rgb::ZERO {
        return None;
    }
    let pdf = sample.pdf * pmf;
    let weight = if sample.delta {
        1.0
    } else {
        power_heuristic(pdf, pdf_bsdf)
    };
    let sent = f * sample.li * (weight / pdf);
    if sent == Rgb::ZERO {
        return None;
    }
    Some(Shadow {
        ray: match sample.target {
            Some(q) => it.spawn_to(q),
            None => it.spawn(sample.wi),
        },
        light: bounded(scene, carried.throughput * sent, carried.depth),
    })
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
