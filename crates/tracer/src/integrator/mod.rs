//! Integrators: from a camera sample to what it brings. The seam is a unit, not a ray (see
//! `render.rs`); inside it each sample is computed by one of these functions.

pub mod debug;
pub mod direct;
pub mod path;
pub(crate) mod stream;
pub mod volpath;
pub mod whitted;

use crate::geometry::Interaction;
use crate::light::{Light, LightSample};
use crate::material::Shading;
use crate::math::Rgb;
use crate::ray::{Hit, NONE, Ray};
use crate::scene::Scene;
use film::{Counters, LayerSample};
use glam::Vec3;

/// Surfaces without scattering (interfaces) that a path passes at most.
const PASS_MAX: u32 = 1000;

/// Passing borders that have no surface.
struct Passing {
    count: u32,
    last: (u32, u32),
    extra: f32,
}

impl Passing {
    fn new() -> Passing {
        Passing {
            count: 0,
            last: (NONE, NONE),
            extra: 0.0,
        }
    }

    /// Where a ray in direction `w` goes on; `None` after too many borders. A triangle far larger than its
    /// distance is found with an error beyond the usual offset, again and again from the same place: each
    /// time in a row the offset grows.
    fn pass(&mut self, it: &Interaction, hit: &Hit, w: Vec3) -> Option<Vec3> {
        self.count += 1;
        if self.count > PASS_MAX {
            return None;
        }
        let this = (hit.instance, hit.prim);
        self.extra = if this == self.last {
            (self.extra * 4.0).max(it.p.abs().max_element().max(1.0) * 1e-6)
        } else {
            0.0
        };
        self.last = this;
        let side = if w.dot(it.ng) < 0.0 { -1.0 } else { 1.0 };
        Some(it.origin_towards(w) + it.ng * (side * self.extra))
    }
}

/// What a sample has gathered beside radiance: the layers of its first surface.
#[derive(Clone, Copy)]
pub(crate) struct First {
    pub alpha: f32,
    pub albedo: Rgb,
    pub normal: Vec3,
    pub depth: f32,
}

impl First {
    pub(crate) const NOTHING: First = First {
        alpha: 0.0,
        albedo: Rgb::ZERO,
        normal: Vec3::ZERO,
        depth: f32::INFINITY,
    };

    pub(crate) fn surface(it: &Interaction, shading: &Shading, wo: Vec3, depth: f32) -> First {
        First {
            alpha: 1.0,
            albedo: shading.bsdf.albedo(shading.frame.to_local(wo)),
            normal: if shading.frame.n.dot(wo) < 0.0 && it.ng.dot(wo) < 0.0 {
                -shading.frame.n
            } else {
                shading.frame.n
            },
            depth,
        }
    }

    /// A surface that only shines or lets pass.
    pub(crate) fn bare(it: &Interaction, depth: f32) -> First {
        First {
            alpha: 1.0,
            albedo: Rgb::ZERO,
            normal: it.ns,
            depth,
        }
    }

    pub(crate) fn with(self, radiance: Rgb) -> LayerSample {
        LayerSample {
            beauty: radiance.to_array(),
            alpha: self.alpha,
            albedo: self.albedo.to_array(),
            normal: self.normal.to_array(),
            depth: self.depth,
        }
    }
}

/// Weight of one of two ways to sample the same thing [Veach95], power heuristic.
#[inline(always)]
pub(crate) fn power_heuristic(a: f32, b: f32) -> f32 {
    if a == f32::INFINITY {
        return 1.0;
    }
    // Through the ratio, so that large densities do not overflow.
    let r = b / a;
    1.0 / (1.0 + r * r)
}

/// Whether something stands between a point and a light sample.
#[inline]
pub(crate) fn is_shadowed(
    scene: &Scene,
    it: &Interaction,
    sample: &LightSample,
    counters: &mut Counters,
) -> bool {
    counters.shadow_rays += 1;
    let ray = match sample.target {
        Some(q) => it.spawn_to(q),
        None => it.spawn(sample.wi),
    };
    if scene.has_media {
        return is_blocked(scene, ray, sample.target);
    }
    scene.occluded(&ray)
}

/// Whether a surface stands in the way, where there may be borders without a surface: those of media.
#[cold]
fn is_blocked(scene: &Scene, mut ray: Ray, target: Option<Vec3>) -> bool {
    let mut passing = Passing::new();
    loop {
        let Some(hit) = scene.intersect(&ray) else {
            return false;
        };
        let material = scene.geometry.surface_of(&hit).material;
        if !scene.materials.is_interface(material) {
            return true;
        }
        let it = scene.interaction(&ray, &hit);
        let Some(origin) = passing.pass(&it, &hit, ray.direction) else {
            return true;
        };
        ray.origin = origin;
        if let Some(q) = target {
            ray.direction = q - origin;
        }
    }
}

/// Radiance from infinity along a ray; with `mis` = (pdf of the direction), each environment is
/// weighted against sampling it as a light.
#[inline]
pub(crate) fn from_infinity(scene: &Scene, ray: &Ray, pdf_bsdf: Option<f32>) -> Rgb {
    let mut sum = Rgb::ZERO;
    for &index in &scene.lights.environments {
        let Light::Environment(e) = &scene.lights.lights[index as usize] else {
            continue;
        };
        let le = e.le(&scene.textures.images, ray.origin, ray.direction);
        let weight = match pdf_bsdf {
            None => 1.0,
            Some(pdf) => {
                let pdf_light = scene.lights.pmf_infinite() * e.pdf(ray.origin, ray.direction);
                power_heuristic(pdf, pdf_light)
            }
        };
        sum += le * weight;
    }
    sum
}

/// Alpha of a camera ray that meets nothing: the sky covers, unless it is hidden or absent.
pub(crate) fn sky_alpha(scene: &Scene) -> f32 {
    let seen = scene
        .lights
        .environments
        .iter()
        .any(|i| match &scene.lights.lights[*i as usize] {
            Light::Environment(e) => !e.hidden,
            _ => false,
        });
    if seen { 1.0 } else { 0.0 }
}
