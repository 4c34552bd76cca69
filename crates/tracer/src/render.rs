//! One unit of work: the one entry point for workers.

use crate::StopFlag;
use crate::integrator::{debug, direct, path, volpath, whitted};
use crate::math::Rgb;
use crate::sampler::{PixelPoints, Sampler};
use crate::scene::Scene;
use ::scene::model::Integrator;
use film::{Counters, LayerSample, SampleBuffer, Unit};
use glam::Vec2;

/// Renders one unit on the calling thread; `None` if it was stopped.
///
/// Every sample is a function of the scene, the seed, the frame, its pixel and its index alone, so
/// the result does not depend on how samples are grouped into units.
pub fn render_unit(
    scene: &Scene,
    unit: &Unit,
    stop: &StopFlag,
) -> Option<(SampleBuffer, Counters)> {
    let tile = scene.grid.tile(unit.tile);
    let mut buffer = SampleBuffer::new(tile, unit.samples);
    let mut counters = Counters::default();
    let mut scene = scene.view();
    for y in 0..tile.height {
        for x in 0..tile.width {
            if stop.is_stopped() {
                return None;
            }
            // A pixel of a crop is named by its place in the whole picture, so that both are the same.
            let pixel = [
                tile.x + x + scene.crop_origin[0],
                tile.y + y + scene.crop_origin[1],
            ];
            let mut points = PixelPoints::new(scene.sampler, scene.seed, scene.frame, pixel);
            for index in unit.samples.begin..unit.samples.end {
                // A sample may be long: look again within a pixel, but not for every sample.
                if index & 63 == 63 && stop.is_stopped() {
                    return None;
                }
                scene.textures.refresh();
                let mut sampler = Sampler::start(&mut points, index);
                let sample = render_sample(&scene, pixel, &mut sampler, &mut counters);
                counters.samples += 1;
                if buffer.add(x, y, index, &sample).is_err() {
                    counters.rejected += 1;
                }
            }
        }
    }
    Some((buffer, counters))
}

/// One sample of one pixel of the whole picture.
#[inline]
fn render_sample(
    scene: &Scene,
    pixel: [u32; 2],
    sampler: &mut Sampler,
    counters: &mut Counters,
) -> LayerSample {
    let center = Vec2::new(pixel[0] as f32 + 0.5, pixel[1] as f32 + 0.5);
    let size = Vec2::new(scene.full_size[0] as f32, scene.full_size[1] as f32);
    if let Integrator::Whitted { max_depth } = scene.integrator {
        let ray = scene
            .camera
            .ray(center / size, None, scene.camera.shutter.0);
        return finish(scene, whitted::sample(scene, ray, max_depth, counters), 1.0);
    }
    let (on_film, lens, moment) = sampler.camera(scene.geometry.level);
    let (offset, weight) = scene.filter.sample(on_film);
    let time = scene.camera.time(moment);
    let ray = scene.camera.ray((center + offset) / size, Some(lens), time);
    match &scene.integrator {
        Integrator::Path { max_depth } if scene.has_media => {
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
            path::sample(scene, ray, *max_depth, sampler, counters),
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
