//! The path tracer for many paths side by side: all rays of a stream are traced, then all hits worked
//! out, then all vertices scattered, stage by stage. Within a stage the usual cases take eight paths at
//! once in lanes; whatever is rare or complicated takes the functions of [`path`](super::path) one by
//! one, from the same records.
//!
//! A stage does for each path exactly what `path` does, with the same roundings, and no path knows of
//! the others: pictures have the same bits as [`path::sample`](super::path::sample) gives (tested),
//! however samples are grouped and whatever instructions there are.

mod camera;
mod diffuse;
mod entry;
mod find;
mod finish;
mod light;
mod numbers;
mod paths;
mod tables;

pub(crate) use paths::PixelOf;
pub(crate) use tables::Tables;

use super::path;
use crate::StopFlag;
use crate::bsdf::Bsdf;
use crate::geometry::Interaction;
use crate::material::Slots;
use crate::ray::NONE;
use crate::render::SamplesOf;
use crate::sampler::Sampler;
use crate::scene::Scene;
use film::{Counters, SampleBuffer};
use paths::{List, Paths, Place};
use tables::Kind;

/// Paths of a stream: enough to fill lanes on later bounces, few enough for the cache next to a core.
pub(crate) const CAPACITY: usize = 512;

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
    /// Rays that leave the scene.
    missed: List,
    /// Hits that lanes find from records.
    flat: List,
    /// Hits that lanes find.
    plain: List,
    /// Hits that are found one by one.
    other: List,
    /// Vertices that scatter diffusely.
    diffuse: List,
}

impl Stream {
    /// Empty.
    pub(crate) fn new() -> Stream {
        Stream {
            paths: Paths::new(),
            missed: List::new(),
            flat: List::new(),
            plain: List::new(),
            other: List::new(),
            diffuse: List::new(),
        }
    }

    /// Takes the next samples; whether there were any.
    pub(crate) fn fill(&mut self, scene: &Scene, samples: &mut SamplesOf) -> bool {
        let paths = &mut *self.paths;
        paths.clear();
        while paths.len() < CAPACITY {
            let Some(run) = samples.next(CAPACITY - paths.len()) else {
                break;
            };
            paths.push(run.pixel, scene.points(run.pixel.whole), run.samples);
        }
        paths.len() > 0
    }

    /// Follows all paths from the camera to their ends; `None` if stopped.
    pub(crate) fn trace(
        &mut self,
        scene: &Scene,
        max_depth: u32,
        counters: &mut Counters,
        stop: &StopFlag,
    ) -> Option<()> {
        let mut wave = Wave {
            scene,
            event: 0,
            max_depth,
        };
        let level = scene.geometry.level;
        entry::camera_rays(level, &wave, &mut self.paths, ());
        while !self.paths.is_done() {
            if stop.is_stopped() {
                return None;
            }
            self.advance(&wave, counters);
            wave.event += 1;
        }
        Some(())
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
        counters.samples += self.paths.len() as u64;
        counters.rejected += entry::finish(scene.geometry.level, &wave, &mut self.paths, buffer);
    }

    /// From one vertex to the next.
    fn advance(&mut self, wave: &Wave, counters: &mut Counters) {
        let scene = wave.scene;
        let level = scene.geometry.level;
        let paths = &mut *self.paths;
        counters.rays += paths.active() as u64;
        paths.find_hits(&scene.geometry);
        self.sort(wave);
        let paths = &mut *self.paths;
        for place in self.missed.all() {
            escape(scene, paths, *place);
        }
        numbers::draw(wave, paths, self.flat.all());
        numbers::draw(wave, paths, self.plain.all());
        numbers::draw(wave, paths, self.other.all());
        entry::find_flat(level, wave, paths, self.flat.all());
        entry::find(level, wave, paths, self.plain.all());
        self.diffuse.clear();
        self.diffuse.extend(self.flat.all());
        self.diffuse.extend(self.plain.all());
        for place in self.other.all() {
            scatter_one(wave, paths, *place, &mut self.diffuse, counters);
        }
        counters.bounces += self.diffuse.len() as u64;
        light::choose(wave, paths, self.diffuse.all());
        entry::scatter_diffuse(level, wave, paths, self.diffuse.all());
        counters.shadow_rays += paths.cast_shadows(&scene.geometry) as u64;
        paths.next_wave();
    }

    /// Tells paths by what they have hit.
    fn sort(&mut self, wave: &Wave) {
        let tables = &wave.scene.stream;
        let paths = &*self.paths;
        self.missed.clear();
        self.flat.clear();
        self.plain.clear();
        self.other.clear();
        // Nobody has had more scattering events than there were vertices.
        let is_special = wave.event >= wave.max_depth || paths.any_passed();
        let sees_sky = wave.event == 0 || !wave.scene.lights.environments.is_empty();
        for at in 0..paths.active() {
            let place = paths.place(at);
            let hit = paths.hit_of(place.ray);
            if !hit.is_some() {
                self.missed.push_if(place, sees_sky);
                continue;
            }
            let mut kind = match hit.instance {
                NONE => tables.kind(hit.prim),
                _ => Kind::Other,
            };
            if is_special && kind != Kind::Other {
                if !paths.seen_first(place) {
                    kind = Kind::Other;
                } else if paths.depth(place) >= wave.max_depth {
                    continue;
                }
            }
            self.flat.push_if(place, kind == Kind::Flat);
            self.plain.push_if(place, kind == Kind::Plain);
            self.other.push_if(place, kind == Kind::Other);
        }
    }
}

/// A ray that hits nothing.
fn escape(scene: &Scene, paths: &mut Paths, place: Place) {
    let mut gathered = paths.gathered(place);
    let (ray, carried) = (paths.ray(place), paths.carried(place));
    path::escape(scene, &ray, &carried, &mut gathered);
    paths.set_gathered(place, &gathered);
}

/// A vertex by itself; if lanes scatter what is found there, it is put on their list instead.
fn scatter_one(
    wave: &Wave,
    paths: &mut Paths,
    place: Place,
    diffuse: &mut List,
    counters: &mut Counters,
) {
    let scene = wave.scene;
    let (ray, hit) = (paths.ray(place), paths.hit(place));
    let mut carried = paths.carried(place);
    let mut gathered = paths.gathered(place);
    let mut it = Interaction::NONE;
    scene.find(&ray, &hit, &mut it);
    let wo = -ray.direction;
    path::shine(scene, &it, wo, &carried, &mut gathered);
    let at_limit = carried.depth >= wave.max_depth;
    if at_limit && gathered.seen_first {
        paths.set_gathered(place, &gathered);
        return;
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
        return;
    };
    path::see(&it, &shading, wo, hit.t, &mut gathered);
    paths.set_gathered(place, &gathered);
    if at_limit {
        return;
    }
    if let (Bsdf::Diffuse(bsdf), true) = (shading.bsdf, shading.is_plain()) {
        paths.set_vertex(place, &it, shading.frame.n, bsdf.albedo());
        diffuse.push_if(place, true);
        return;
    }
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

/// The numbers of an event, one path after another.
fn draw_one(wave: &Wave, paths: &mut Paths, place: Place) {
    let (points, index) = paths.points(place);
    let mut sampler = Sampler::at_event(points, index, wave.event);
    let numbers = sampler.bounce(wave.scene.geometry.level);
    paths.set_numbers(place, &numbers);
}
