//! The path tracer for many paths side by side: all rays of a stream are traced, then all hits worked
//! out, then all vertices scattered, stage by stage. Within a stage the usual cases take eight or
//! sixteen paths at once in lanes; whatever is rare or complicated takes the functions of [`path`](super::path) one by
//! one, from the same records.
//!
//! A stage does for each path exactly what `path` does, with the same roundings, and no path knows of
//! the others: pictures have the same bits as [`path::sample`](super::path::sample) gives (tested),
//! however samples are grouped and whatever instructions there are.

#![allow(
    clippy::needless_range_loop,
    reason = "a lane is a place in several arrays at once"
)]

mod camera;
mod entry;
mod find;
mod finish;
mod light;
mod numbers;
mod paths;
mod pilot;
mod scatter;
mod tables;
mod trainer;

pub(crate) use paths::PixelOf;
pub(crate) use pilot::{PILOT_PIXELS, Pilot};
pub(crate) use tables::Tables;
pub(crate) use trainer::Trainer;

use super::{path, volpath};
use crate::StopFlag;
use crate::bsdf::Bsdf;
use crate::bsdf::GUIDED_MOST;
use crate::geometry::Interaction;
use crate::guide::{self, Guide};
use crate::material::Slots;
use crate::math::Rgb;
use crate::ray::NONE;
use crate::render::SamplesOf;
use crate::sampler::PixelPoints;
use crate::scene::Scene;
use film::{Columns, Counters, SampleBuffer};
use glam::Vec3;
use paths::{Lists, Paths, Place};
use tables::{Find, Kind, Model};

/// Paths of a stream: enough to fill lanes on later bounces, few enough for the cache next to a core.
pub(crate) const CAPACITY: usize = Columns::LONGEST;

/// What is worked on when, in a wave: every path of a stream is at the same event.
#[derive(Clone, Copy)]
struct Wave<'s> {
    scene: &'s Scene,
    /// Vertices before this one.
    event: u32,
    /// Scattering events that a path may have.
    max_depth: u32,
}

/// Room for a stream, to be used for one after another.
pub(crate) struct Stream {
    paths: Box<Paths>,
    lists: Lists,
    /// What paths have gathered, a layer at a time.
    columns: Box<Columns>,
}

impl Stream {
    /// Empty.
    pub(crate) fn new() -> Stream {
        Stream {
            paths: Paths::new(),
            lists: Lists::new(),
            columns: Box::default(),
        }
    }

    /// Takes the next samples; whether there were any.
    pub(crate) fn fill(&mut self, scene: &Scene, samples: &mut SamplesOf) -> bool {
        let paths = &mut *self.paths;
        let split = samples.split();
        paths.clear(split);
        // All in a stream are split alike.
        while paths.room() > 0 && samples.split() == split {
            let Some(run) = samples.next(paths.room()) else {
                break;
            };
            paths.push(run.pixel, scene.pixel_key(run.pixel.whole), run.samples);
        }
        paths.start();
        paths.samples() > 0
    }

    /// Follows all paths from the camera to their ends; `None` if stopped.
    pub(crate) fn trace(
        &mut self,
        scene: &mut Scene,
        max_depth: u32,
        counters: &mut Counters,
        stop: &StopFlag,
    ) -> Option<()> {
        self.begin(scene);
        let mut event = 0;
        while !self.paths.is_done() {
            if stop.is_stopped() {
                return None;
            }
            self.advance(scene, event, max_depth, counters);
            event += 1;
        }
        Some(())
    }

    /// Makes the rays from the camera.
    fn begin(&mut self, scene: &Scene) {
        let wave = Wave {
            scene,
            event: 0,
            max_depth: 0,
        };
        entry::camera_rays(scene.geometry.level, &wave, &mut self.paths);
    }

    /// Adds what the samples have brought to the sums of their pixels.
    pub(crate) fn add_to(
        &mut self,
        scene: &Scene,
        buffer: &mut SampleBuffer,
        counters: &mut Counters,
    ) {
        let wave = Wave {
            scene,
            event: 0,
            max_depth: 0,
        };
        counters.samples += self.paths.samples() as u64;
        let (paths, columns) = (&mut *self.paths, &mut *self.columns);
        counters.rejected += entry::finish(scene.geometry.level, &wave, paths, columns, buffer);
    }

    /// From one vertex to the next.
    fn advance(&mut self, scene: &mut Scene, event: u32, max_depth: u32, counters: &mut Counters) {
        let wave = &Wave {
            scene,
            event,
            max_depth,
        };
        let level = scene.geometry.level;
        let paths = &mut *self.paths;
        counters.rays += paths.active() as u64;
        paths.find_hits(&scene.geometry, event);
        self.sort(wave);
        for place in self.lists.missed.all() {
            escape(scene, &mut self.paths, *place);
        }
        let paths = &mut *self.paths;
        let lists = &mut self.lists;
        for found in &lists.found {
            numbers::draw(wave, paths, found.all());
        }
        entry::find_flat(level, wave, paths, lists.found(Find::Flat));
        entry::find_meshes(level, wave, paths, lists.found(Find::Mesh));
        entry::find_spheres(level, wave, paths, lists.found(Find::Sphere));
        for at in 0..lists.found(Find::Other).len() {
            let place = lists.found(Find::Other)[at];
            // Pictures that had to go are let go of at each vertex: those of a whole wave would be too many.
            scene.textures.refresh();
            let wave = &Wave {
                scene,
                event,
                max_depth,
            };
            let model = scatter_one(wave, paths, place, counters);
            if model != Model::Other {
                lists.scattering[model as usize].push(place);
            }
        }
        let wave = &Wave {
            scene,
            event,
            max_depth,
        };
        if event == 0 && paths.split() > 1 {
            for model in [Model::Diffuse, Model::Conductor, Model::Dielectric] {
                lists.split(model, paths.split());
                let places = lists.scattering(model);
                paths.split_at(places);
                numbers::draw(wave, paths, places);
            }
        }
        let [diffuse, conductor, dielectric] =
            [Model::Diffuse, Model::Conductor, Model::Dielectric].map(|m| lists.scattering(m));
        counters.bounces += (diffuse.len() + conductor.len() + dielectric.len()) as u64;
        light::choose(wave, paths, Model::Diffuse, diffuse);
        entry::aim_conductor(level, wave, paths, conductor);
        light::choose(wave, paths, Model::Conductor, conductor);
        light::choose(wave, paths, Model::Dielectric, dielectric);
        if let Some(guide) = &wave.scene.guide {
            mark(guide, paths, Model::Diffuse, diffuse);
            mark(guide, paths, Model::Conductor, conductor);
            entry::guide_diffuse(level, wave, paths, diffuse);
            entry::guide_conductor(level, wave, paths, conductor);
            entry::guide_dielectric(level, wave, paths, dielectric);
        } else {
            entry::scatter_diffuse(level, wave, paths, diffuse);
            entry::scatter_conductor(level, wave, paths, conductor);
            entry::scatter_dielectric(level, wave, paths, dielectric);
        }
        counters.shadow_rays += paths.cast_shadows(&scene.geometry) as u64;
        paths.next_wave();
    }

    /// Tells paths by what they have hit.
    fn sort(&mut self, wave: &Wave) {
        let tables = &wave.scene.stream;
        let paths = &*self.paths;
        let lists = &mut self.lists;
        lists.clear();
        // Nobody has had more scattering events than there were vertices.
        let is_special = wave.event >= wave.max_depth || paths.any_passed();
        let sees_sky = wave.event == 0 || !wave.scene.lights.environments.is_empty();
        for at in 0..paths.active() {
            let place = paths.place(at);
            let hit = paths.hit_of(place.ray);
            if !hit.is_some() {
                if sees_sky {
                    lists.missed.push(place);
                }
                continue;
            }
            let mut kind = match hit.instance {
                NONE => tables.kind(hit.prim),
                _ => Kind::OTHER,
            };
            if is_special && kind != Kind::OTHER {
                if !paths.seen_first(place) {
                    kind = Kind::OTHER;
                } else if paths.depth(place) >= wave.max_depth {
                    continue;
                }
            }
            lists.found[kind.find as usize].push(place);
            lists.scattering[kind.model as usize].push(place);
        }
    }
}

/// Looks up what a guide knows at vertices, and what the camera is expected to see.
fn mark(guide: &Guide, paths: &mut Paths, model: Model, places: &[Place]) {
    for place in places {
        if model == Model::Conductor && paths.last_aim(*place).narrow > GUIDED_MOST {
            continue;
        }
        let [x, y, z, _, gx, gy, gz, _] = paths.point[place.slot as usize].0;
        let (p, ng) = (Vec3::new(x, y, z), Vec3::new(gx, gy, gz));
        let mark = guide.mark(p, ng, paths.ray(*place).direction);
        paths.set_mark(place.slot, mark);
        paths.expect(guide, mark, p, place.slot);
    }
}

/// A ray that hits nothing.
#[inline]
fn escape(scene: &Scene, paths: &mut Paths, place: Place) {
    if let Some(sky) = scene.stream.sky() {
        paths.add_sky(place, sky, scene.clamp_indirect);
        return;
    }
    let mut gathered = paths.gathered(place);
    let (ray, carried) = (paths.ray(place), paths.carried(place));
    path::escape(scene, &ray, &carried, &mut gathered);
    paths.set_gathered(place, &gathered);
}

/// A vertex by itself; if lanes scatter what is found there, says which.
fn scatter_one(wave: &Wave, paths: &mut Paths, place: Place, counters: &mut Counters) -> Model {
    let scene = wave.scene;
    let (ray, hit) = (paths.ray(place), paths.hit(place));
    let carried = paths.carried(place);
    let mut gathered = paths.gathered(place);
    let mut it = Interaction::NONE;
    scene.find(&ray, &hit, &mut it);
    let wo = -ray.direction;
    let before = gathered.radiance;
    path::shine(scene, &it, wo, &carried, &mut gathered);
    let learns = scene.guide.as_ref().is_some_and(|guide| guide.learns);
    if learns {
        paths.set_shone(place.slot, gathered.radiance - before);
    }
    if scene.leads_to_media(&hit) {
        let mut points = PixelPoints::new(scene.sampler, paths.pixel_key(place.slot));
        let mut sampler = paths.sampler(place, wave.event, &mut points);
        let (met, most) = ((ray, hit), wave.max_depth);
        volpath::go_on(
            scene,
            met,
            &carried,
            most,
            &mut gathered,
            &mut sampler,
            counters,
        );
        paths.set_gathered(place, &gathered);
        return Model::Other;
    }
    let at_limit = carried.depth >= wave.max_depth;
    if at_limit && gathered.seen_first {
        paths.set_gathered(place, &gathered);
        return Model::Other;
    }
    let numbers = paths.numbers(place);
    let slots = Slots::default();
    let Some(shading) = scene
        .materials
        .shade(&scene.textures, &it, wo, numbers.mix, &slots)
    else {
        if let Some(next) = path::pass(&it, &ray, hit.t, &mut gathered) {
            paths.go_on(place, &next);
        }
        paths.set_gathered(place, &gathered);
        return Model::Other;
    };
    path::see(&it, &shading, wo, hit.t, &mut gathered);
    paths.set_gathered(place, &gathered);
    if at_limit {
        return Model::Other;
    }
    if shading.is_plain() {
        let model = scene.stream.model(it.material);
        let given = match (shading.bsdf, model) {
            (Bsdf::Diffuse(bsdf), _) => Some((Model::Diffuse, bsdf.albedo())),
            (_, Model::Other) => None,
            _ => Some((model, Rgb::new(f32::from_bits(it.material), 0.0, 0.0))),
        };
        if let Some((model, given)) = given {
            paths.set_vertex(place, &it, shading.frame.n, given);
            return model;
        }
    }
    let split = if wave.event == 0 { paths.split() } else { 1 };
    if split > 1 {
        paths.split_at(&[place]);
    }
    for part in 0..split {
        let place = Place {
            slot: place.slot + part,
            ..place
        };
        if split > 1 {
            draw_one(wave, paths, place);
        }
        if learns && let Some(guide) = &scene.guide {
            paths.set_vertex(place, &it, shading.frame.n, Rgb::ZERO);
            paths.set_mark(place.slot, guide::mark_of(guide, &it, &shading, wo));
        }
        let numbers = paths.numbers(place);
        let mut carried = paths.carried(place);
        counters.bounces += 1;
        let (shadow, next) = path::scatter(scene, &it, &shading, wo, &numbers, &mut carried);
        if let Some(shadow) = shadow {
            paths.ask_shadow(place, &shadow);
        }
        if let Some(next) = next {
            paths.set_carried(place, &carried);
            paths.go_on(place, &next);
        }
    }
    Model::Other
}

/// The numbers of an event, one path after another.
fn draw_one(wave: &Wave, paths: &mut Paths, place: Place) {
    let mut points = PixelPoints::new(wave.scene.sampler, paths.pixel_key(place.slot));
    let mut sampler = paths.sampler(place, wave.event, &mut points);
    let numbers = sampler.bounce(wave.scene.geometry.level);
    paths.set_numbers(place, &numbers);
}
