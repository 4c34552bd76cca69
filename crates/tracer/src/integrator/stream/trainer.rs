//! Paths that are remembered, for a guide to learn from.

use super::{CAPACITY, PixelOf, Stream};
use crate::StopFlag;
use crate::guide::{Mark, Step};
use crate::math::{Rgb, luminance};
use crate::sampler::PixelKey;
use crate::scene::Scene;
use film::Counters;
use glam::Vec3;

/// Samples of a pixel.
const SAMPLES: u32 = 4;

/// Room for paths and for what they have found out.
pub(crate) struct Trainer {
    stream: Stream,
    scene: Scene,
    /// By slot: throughput and radiance at the beginning of the event.
    before: Vec<(Rgb, Rgb)>,
    /// By slot: the last step, and at which event.
    last: Vec<Option<(u32, u32)>>,
    /// Slots with rays at the beginning of the event.
    active: Vec<u32>,
    /// By step: the slot, and throughput and radiance when the path went on.
    left: Vec<(u32, Rgb, Rgb)>,
}

impl Trainer {
    /// Paths that are followed together.
    pub(crate) const PATHS: usize = CAPACITY;
    /// Pixels that they are of.
    pub(crate) const PIXELS: usize = CAPACITY / SAMPLES as usize;

    /// For a scene.
    pub(crate) fn new(scene: &Scene) -> Trainer {
        Trainer {
            stream: Stream::new(),
            scene: scene.view(),
            before: vec![(Rgb::ZERO, Rgb::ZERO); CAPACITY],
            last: vec![None; CAPACITY],
            active: Vec::with_capacity(CAPACITY),
            left: Vec::new(),
        }
    }

    /// Follows paths from some pixels of the whole picture, each with a seed, and says what they have found out; `None` if stopped.
    pub(crate) fn walk(
        &mut self,
        max_depth: u32,
        pixels: &[([u32; 2], u64); Self::PIXELS],
        stop: &StopFlag,
    ) -> Option<Vec<Step>> {
        let paths = &mut *self.stream.paths;
        paths.clear(1);
        for (whole, seed) in *pixels {
            let key = PixelKey::new(seed, self.scene.frame, whole);
            let pixel = PixelOf {
                place: [0, 0],
                whole,
            };
            paths.push(pixel, key, 0..SAMPLES);
        }
        paths.start();
        self.last.fill(None);
        self.left.clear();
        let mut steps = Vec::new();
        let mut counters = Counters::default();
        self.stream.begin(&self.scene);
        let mut event = 0;
        while !self.stream.paths.is_done() {
            if stop.is_stopped() {
                return None;
            }
            self.look();
            self.stream
                .advance(&mut self.scene, event, max_depth, &mut counters);
            self.remember(event, &mut steps);
            event += 1;
        }
        let paths = &*self.stream.paths;
        for (step, (slot, throughput, radiance)) in steps.iter_mut().zip(&self.left) {
            if step.share > 0.0 && step.to == Step::NOWHERE {
                let found = Rgb::from_slice(&paths.radiance[*slot as usize].0);
                step.arrived = over(found - *radiance, *throughput);
            }
        }
        // What overflows says nothing.
        for step in &mut steps {
            let light = (step.arrived + step.emitted) * step.cos / step.drawn;
            if !(step.direct.is_finite() && step.share.is_finite() && light.is_finite()) {
                (step.direct, step.share, step.emitted, step.arrived) = (0.0, 0.0, 0.0, 0.0);
                step.to = Step::NOWHERE;
            }
        }
        Some(steps)
    }

    /// Before an event.
    fn look(&mut self) {
        let paths = &mut *self.stream.paths;
        self.active.clear();
        for at in 0..paths.active() {
            let place = paths.place(at);
            let slot = place.slot as usize;
            let throughput = Rgb::from_slice(&paths.carried[slot].0);
            let radiance = Rgb::from_slice(&paths.radiance[slot].0);
            self.before[slot] = (throughput, radiance);
            self.active.push(place.slot);
            paths.set_mark(place.slot, Mark::NONE);
            paths.set_shone(place.slot, Rgb::ZERO);
        }
    }

    /// After an event.
    fn remember(&mut self, event: u32, steps: &mut Vec<Step>) {
        let paths = &*self.stream.paths;
        // Steps of this event by slot: the last ones of slots.
        for slot in &self.active {
            let at = *slot as usize;
            let Some(way) = paths.mark(*slot).way() else {
                continue;
            };
            let index = steps.len() as u32;
            if let Some((last, of)) = self.last[at]
                && of + 1 == event
            {
                steps[last as usize].to = index;
                steps[last as usize].emitted = over(paths.shone(*slot), self.before[at].0);
            }
            self.last[at] = Some((index, event));
            let (throughput, radiance) = self.before[at];
            let found = Rgb::from_slice(&paths.radiance[at].0);
            let [x, y, z, ..] = paths.point[at].0;
            steps.push(Step {
                p: Vec3::new(x, y, z),
                way,
                direct: over(found - radiance - paths.shone(*slot), throughput),
                share: 0.0,
                w: Vec3::Z,
                cos: 0.0,
                drawn: 1.0,
                emitted: 0.0,
                arrived: 0.0,
                to: Step::NOWHERE,
            });
            self.left.push((*slot, throughput, found));
        }
        for at in 0..paths.active() {
            let place = paths.place(at);
            let slot = place.slot as usize;
            let Some((last, of)) = self.last[slot] else {
                continue;
            };
            if of != event {
                continue;
            }
            let step = &mut steps[last as usize];
            let (before, _) = self.before[slot];
            let throughput = Rgb::from_slice(&paths.carried[slot].0);
            let [.., gx, gy, gz, _] = paths.point[slot].0;
            step.share = over(throughput, before);
            step.w = paths.ray(place).direction;
            step.cos = step.w.dot(Vec3::new(gx, gy, gz)).abs();
            step.drawn = paths.drawn(place.slot);
            self.left[last as usize].1 = throughput;
        }
    }
}

/// Luminance of what a path has brought over what it carried. What a channel does not carry it says nothing about.
fn over(brought: Rgb, carried: Rgb) -> f32 {
    luminance(Vec3::select(
        carried.cmpgt(Vec3::ZERO),
        brought / carried,
        Vec3::ZERO,
    ))
}
