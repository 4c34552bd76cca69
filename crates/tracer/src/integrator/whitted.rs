//! The lecture's basic ray tracer [Whitted80]: pixel centre, lens centre, shutter opening, one shadow
//! ray to every light (area lights as a point at their centroid), and at mirrors and glass one
//! reflected and one refracted ray. It knows no media: they are looked through.

use super::First;
use crate::bsdf::Bsdf;
use crate::geometry::Interaction;
use crate::light::{AreaShape, Light, LightSample};
use crate::material::Shading;
use crate::material::Slots;
use crate::math::{self, Rgb};
use crate::ray::Ray;
use crate::scene::Scene;
use film::{Counters, LayerSample};
use glam::{Vec2, Vec3};

/// Colour seen along a ray.
pub fn sample(scene: &Scene, ray: Ray, max_depth: u32, counters: &mut Counters) -> LayerSample {
    let mut first = None;
    let radiance = trace(scene, &ray, max_depth, counters, &mut first);
    first
        .unwrap_or(First {
            alpha: super::sky_alpha(scene),
            ..First::NOTHING
        })
        .with(radiance)
}

fn trace(
    scene: &Scene,
    ray: &Ray,
    depth_left: u32,
    counters: &mut Counters,
    first: &mut Option<First>,
) -> Rgb {
    counters.rays += 1;
    let Some(hit) = scene.intersect(ray) else {
        return super::from_infinity(scene, ray, None);
    };
    let it = scene.interaction(ray, &hit);
    let wo = -ray.direction;
    let mut radiance = scene.emitted(&it, wo);
    // A mix has no place in this model: its larger part stands for it.
    let slots = Slots::default();
    let shading = scene
        .materials
        .shade(&scene.textures, &it, wo, 0.5, &slots)
        .map(|shading| match shading.bsdf {
            Bsdf::Mixed(mixed) => shading.with(mixed.largest()),
            _ => shading,
        });
    let Some(shading) = shading else {
        first.get_or_insert(First::bare(&it, hit.t));
        return radiance
            + if depth_left > 0 {
                trace(
                    scene,
                    &it.spawn(ray.direction),
                    depth_left - 1,
                    counters,
                    first,
                )
            } else {
                Rgb::ZERO
            };
    };
    first.get_or_insert(First::surface(&it, &shading, wo, hit.t));
    let wo_local = shading.frame.to_local(wo);
    if !shading.bsdf.is_delta() {
        for light in &scene.lights.lights {
            radiance += from_light(scene, light, &it, &shading, wo_local, counters);
        }
    }
    if depth_left > 0 && shading.bsdf.is_delta() {
        // The two choices of a pane are at the two ends of the uniform number; each comes back with
        // weight 1 / probability, so that its probability turns it into its share.
        let ends = [
            shading.sample(wo_local, 0.0, Vec2::splat(0.5)),
            shading.sample(wo_local, 0.999_999_9, Vec2::splat(0.5)),
        ];
        let mut done: Option<bool> = None;
        for s in ends.into_iter().flatten() {
            if done == Some(s.transmitted) {
                continue;
            }
            done = Some(s.transmitted);
            let share = s.weight * s.pdf;
            let next = it.spawn(shading.frame.to_world(s.wi));
            radiance += share * trace(scene, &next, depth_left - 1, counters, first);
        }
    }
    radiance
}

fn from_light(
    scene: &Scene,
    light: &Light,
    it: &Interaction,
    shading: &Shading,
    wo: Vec3,
    counters: &mut Counters,
) -> Rgb {
    let textures = &scene.textures;
    let sample = match light {
        Light::Environment(_) => None,
        Light::Area(area) => {
            let centroid = match &area.shape {
                AreaShape::Triangle { p, e1, e2, .. } => *p + (*e1 + *e2) * (1.0 / 3.0),
                AreaShape::Parallelogram { p, e1, e2, .. } => *p + (*e1 + *e2) * 0.5,
                AreaShape::Sphere { center, .. } | AreaShape::Disk { center, .. } => *center,
            };
            point_like(scene, area, centroid, it)
        }
        delta => delta.sample_li(textures, &scene.lights.emissions, it.p, Vec2::splat(0.5)),
    };
    let Some(sample) = sample else {
        return Rgb::ZERO;
    };
    let f = shading.eval_pdf(wo, shading.frame.to_local(sample.wi)).0;
    if f == Rgb::ZERO || super::is_shadowed(scene, it, &sample, counters) {
        return Rgb::ZERO;
    }
    f * sample.li
}

/// An area light as a point at its centroid: E = L A cos / r^2 (for a sphere, L pi r^2 / d^2 from its
/// near side).
fn point_like(
    scene: &Scene,
    area: &crate::light::AreaLight,
    centroid: Vec3,
    it: &Interaction,
) -> Option<LightSample> {
    let textures = &scene.textures;
    let emission = &scene.lights.emissions[area.emission as usize];
    let d = centroid - it.p;
    let distance = math::length(d);
    if distance == 0.0 {
        return None;
    }
    let wi = d * (1.0 / distance);
    let (target, projected, cos) = match &area.shape {
        AreaShape::Sphere { radius, inward, .. } => {
            let cos = if *inward { -1.0 } else { 1.0 };
            (
                it.p + wi * (distance - radius).max(0.0),
                math::PI * radius * radius,
                cos,
            )
        }
        AreaShape::Triangle { n, .. }
        | AreaShape::Parallelogram { n, .. }
        | AreaShape::Disk { n, .. } => {
            let cos = -n.dot(wi);
            (centroid, area.area() * cos.abs(), cos)
        }
    };
    let point = crate::texture::Point {
        uv: [Vec2::splat(0.5); 2],
        p: centroid,
        ..Default::default()
    };
    let le = emission.le(textures, &point, cos);
    Some(LightSample {
        wi,
        target: Some(target),
        li: le * (projected / (distance * distance)),
        pdf: 1.0,
        delta: true,
    })
}
