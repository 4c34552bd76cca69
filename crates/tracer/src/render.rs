//! One unit of work: the one entry point for workers.

use crate::StopFlag;
use crate::integrator::stream::{PixelOf, Stream};
use crate::integrator::{debug, direct, path, volpath, whitted};
use crate::math::Rgb;
use crate::ray::Ray;
use crate::sampler::Sampler;
use crate::scene::Scene;
use crate::split::Part;
use ::scene::model::Integrator;
use film::{Counters, LayerSample, SampleBuffer, SampleRange, Unit};
use glam::Vec2;
use std::ops::Range;

/// Renders one unit on the calling thread; `None` if it was stopped.
///
/// Every sample is a function of the scene, the seed, the frame, its pixel and its index alone, so
/// the result does not depend on how samples are grouped into units.
pub fn render_unit(
    scene: &Scene,
    unit: &Unit,
    stop: &StopFlag,
) -> Option<(SampleBuffer, Counters)> {
    let mut workspace = Workspace::default();
    let (_, counters) = workspace.render(scene, unit, stop)?;
    Some((workspace.buffer?, counters))
}

/// Room to render in, for one unit after another. The sums of a tile are a megabyte: where units are
/// short, asking the system for it each time, and giving it back, takes a noticeable part of the time.
#[derive(Default)]
pub struct Workspace {
    buffer: Option<SampleBuffer>,
    stream: Option<Stream>,
}

impl Workspace {
    /// [`render_unit`], with sums that stay here until the next unit.
    pub fn render(
        &mut self,
        scene: &Scene,
        unit: &Unit,
        stop: &StopFlag,
    ) -> Option<(&SampleBuffer, Counters)> {
        let tile = scene.grid.tile(unit.tile);
        let buffer = match &mut self.buffer {
            Some(buffer) => {
                buffer.reset(tile, unit.samples);
                buffer
            }
            none => none.insert(SampleBuffer::new(tile, unit.samples)),
        };
        let counters = match scene.integrator {
            Integrator::Path { max_depth } if !scene.is_foggy => {
                // One that is stopped midway is not used again.
                let mut stream = self.stream.take().unwrap_or_else(Stream::new);
                let counters = add_stream(scene, unit, max_depth, stop, &mut stream, buffer)?;
                self.stream = Some(stream);
                counters
            }
            _ => add_singly(scene, unit, stop, buffer)?,
        };
        Some((buffer, counters))
    }
}

/// Many paths side by side.
fn add_stream(
    scene: &Scene,
    unit: &Unit,
    max_depth: u32,
    stop: &StopFlag,
    stream: &mut Stream,
    buffer: &mut SampleBuffer,
) -> Option<Counters> {
    let mut counters = Counters::default();
    let mut scene = scene.view();
    let mut samples = SamplesOf::new(&scene, unit);
    while stream.fill(&scene, &mut samples) {
        stream.trace(&mut scene, max_depth, &mut counters, stop)?;
        stream.add_to(&scene, buffer, &mut counters);
    }
    Some(counters)
}

/// [`render_unit`] one sample after another: whatever is not done in streams, and the reference for
/// what is.
pub fn render_singly(
    scene: &Scene,
    unit: &Unit,
    stop: &StopFlag,
) -> Option<(SampleBuffer, Counters)> {
    let mut buffer = SampleBuffer::new(scene.grid.tile(unit.tile), unit.samples);
    let counters = add_singly(scene, unit, stop, &mut buffer)?;
    Some((buffer, counters))
}

fn add_singly(
    scene: &Scene,
    unit: &Unit,
    stop: &StopFlag,
    buffer: &mut SampleBuffer,
) -> Option<Counters> {
    let mut counters = Counters::default();
    let mut scene = scene.view();
    let mut samples = SamplesOf::new(&scene, unit);
    // A sample may be long: look for the end within a pixel too, but not for every sample.
    while let Some(run) = samples.next(64) {
        if stop.is_stopped() {
            return None;
        }
        let [x, y] = run.pixel.place;
        let mut points = scene.points(run.pixel.whole);
        for index in run.samples {
            scene.textures.refresh();
            let mut sampler = Sampler::start(&mut points, index);
            let (pixel, split) = (run.pixel.whole, run.split);
            let value = render_sample(&scene, pixel, split, &mut sampler, &mut counters);
            counters.samples += 1;
            if buffer.add(x, y, index, &value).is_err() {
                counters.rejected += 1;
            }
        }
    }
    Some(counters)
}

/// Some samples of a pixel, one after another.
pub(crate) struct RunOf {
    pub pixel: PixelOf,
    /// How many paths each of them is split into.
    pub split: u32,
    /// Their indices.
    pub samples: Range<u32>,
}

/// The samples of a unit, pixel by pixel, one part of the picture that is split alike after another.
pub(crate) struct SamplesOf {
    /// Where the tile lies in the whole picture: a pixel of a crop is named by its place there, so that both
    /// are the same.
    origin: [u32; 2],
    parts: Vec<Part>,
    samples: SampleRange,
    /// Pixel of the last part.
    next_place: [u32; 2],
    next_index: u32,
}

impl SamplesOf {
    fn new(scene: &Scene, unit: &Unit) -> SamplesOf {
        let tile = scene.grid.tile(unit.tile);
        let origin = [tile.x + scene.crop_origin[0], tile.y + scene.crop_origin[1]];
        let mut parts = scene
            .splits
            .parts(origin, [origin[0] + tile.width, origin[1] + tile.height]);
        parts.reverse();
        SamplesOf {
            origin,
            next_place: parts.last().map_or([0, 0], |p| p.begin),
            parts,
            samples: unit.samples,
            next_index: unit.samples.begin,
        }
    }

    /// Into how many paths the next samples are split.
    pub(crate) fn split(&self) -> u32 {
        self.parts.last().map_or(1, |part| part.split)
    }

    /// Samples of one pixel, as many as are left there but at most so many.
    pub(crate) fn next(&mut self, most: usize) -> Option<RunOf> {
        let part = *self.parts.last()?;
        if self.samples.begin >= self.samples.end {
            return None;
        }
        let [x, y] = self.next_place;
        let left = self.samples.end - self.next_index;
        let end = self.next_index + left.min(u32::try_from(most).unwrap_or(u32::MAX));
        let run = RunOf {
            pixel: PixelOf {
                place: [x - self.origin[0], y - self.origin[1]],
                whole: [x, y],
            },
            split: part.split,
            samples: self.next_index..end,
        };
        self.next_index = end;
        if end == self.samples.end {
            self.next_index = self.samples.begin;
            self.next_place = if x + 1 < part.end[0] {
                [x + 1, y]
            } else {
                [part.begin[0], y + 1]
            };
            if self.next_place[1] == part.end[1] {
                self.parts.pop();
                self.next_place = self.parts.last().map_or([0, 0], |p| p.begin);
            }
        }
        Some(run)
    }
}

/// The camera's ray for a sample of a pixel of the whole picture, and the filter's weight.
#[inline]
pub(crate) fn camera_ray(scene: &Scene, pixel: [u32; 2], sampler: &mut Sampler) -> (Ray, f32) {
    let center = Vec2::new(pixel[0] as f32 + 0.5, pixel[1] as f32 + 0.5);
    let size = Vec2::new(scene.full_size[0] as f32, scene.full_size[1] as f32);
    let (on_film, lens, moment) = sampler.camera(scene.geometry.level);
    let (offset, weight) = scene.filter.sample(on_film);
    let time = scene.camera.time(moment);
    let ray = scene.camera.ray((center + offset) / size, Some(lens), time);
    (ray, weight)
}

/// One sample of one pixel of the whole picture.
#[inline]
fn render_sample(
    scene: &Scene,
    pixel: [u32; 2],
    split: u32,
    sampler: &mut Sampler,
    counters: &mut Counters,
) -> LayerSample {
    if let Integrator::Whitted { max_depth } = scene.integrator {
        let center = Vec2::new(pixel[0] as f32 + 0.5, pixel[1] as f32 + 0.5);
        let size = Vec2::new(scene.full_size[0] as f32, scene.full_size[1] as f32);
        let ray = scene
            .camera
            .ray(center / size, None, scene.camera.shutter.0);
        return finish(scene, whitted::sample(scene, ray, max_depth, counters), 1.0);
    }
    let (ray, weight) = camera_ray(scene, pixel, sampler);
    match &scene.integrator {
        Integrator::Path { max_depth } if scene.is_foggy => {
            let limits = volpath::Limits {
                events: *max_depth,
                deltas: None,
            };
            finish(
                scene,
                volpath::sample(scene, ray, limits, sampler, counters),
                weight,
            )
        }
        Integrator::Path { max_depth } => finish(
            scene,
            path::sample(scene, ray, *max_depth, split, sampler, counters),
            weight,
        ),
        Integrator::Direct { max_depth } => finish(
            scene,
            direct::sample(scene, ray, *max_depth, sampler, counters),
            weight,
        ),
        view => {
            let mut sample = debug::sample(scene, view, ray, sampler, counters);
            sample.beauty = sample.beauty.map(|c| c * weight);
            sample
        }
    }
}

/// Exposure, the optional limit, the filter's weight.
#[inline]
fn finish(scene: &Scene, mut sample: LayerSample, weight: f32) -> LayerSample {
    let mut radiance = Rgb::from_array(sample.beauty) * scene.exposure;
    let most = radiance.max_element();
    if most > scene.max_component {
        radiance *= scene.max_component / most;
    }
    sample.beauty = (radiance * weight).to_array();
    sample.alpha *= weight;
    sample
}
