//! A few samples of a few pixels, to learn how noisy they are and what they cost.

use super::{CAPACITY, PixelOf, Stream};
use crate::StopFlag;
use crate::math::{Rgb, luminance};
use crate::sampler::PixelKey;
use crate::scene::Scene;
use crate::split::SPLIT_MAX;
use film::Counters;

/// Pixels that are looked at together.
pub(crate) const PILOT_PIXELS: usize = 16;

/// Samples of each.
const SAMPLES: u32 = 8;

const _: () = assert!(PILOT_PIXELS * (SAMPLES * SPLIT_MAX) as usize <= CAPACITY);

/// Room for the samples.
pub(crate) struct Pilot {
    stream: Stream,
    scene: Scene,
}

impl Pilot {
    /// For a scene.
    pub(crate) fn new(scene: &Scene) -> Pilot {
        Pilot {
            stream: Stream::new(),
            scene: scene.view(),
        }
    }

    /// Renders samples of some pixels of the whole picture; their means (luminance) and how many rays all
    /// have taken. `None` if stopped.
    pub(crate) fn render(
        &mut self,
        max_depth: u32,
        split: u32,
        seed: u64,
        pixels: &[[u32; 2]; PILOT_PIXELS],
        stop: &StopFlag,
    ) -> Option<([f64; PILOT_PIXELS], f64)> {
        let scene = &mut self.scene;
        let paths = &mut *self.stream.paths;
        paths.clear(split);
        for whole in *pixels {
            let key = PixelKey::new(seed, scene.frame, whole);
            let pixel = PixelOf {
                place: [0, 0],
                whole,
            };
            paths.push(pixel, key, 0..SAMPLES);
        }
        paths.start();
        let mut counters = Counters::default();
        self.stream.trace(scene, max_depth, &mut counters, stop)?;
        let paths = &mut *self.stream.paths;
        paths.join();
        let mut means = [0.0; PILOT_PIXELS];
        for sample in 0..paths.samples() {
            let [r, g, b, weight, ..] = paths.radiance[sample].0;
            let beauty = Rgb::new(r, g, b) * scene.exposure * weight;
            means[sample / SAMPLES as usize] += f64::from(luminance(beauty)) / f64::from(SAMPLES);
        }
        Some((means, (counters.rays + counters.shadow_rays) as f64))
    }
}
