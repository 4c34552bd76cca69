//! What a stream knows of its paths: records of eight numbers, so that the paths of a group are rows to
//! read and a transposition.

use super::CAPACITY;
use super::tables::{Find, Model};
use crate::accel::Geometry;
use crate::geometry::Interaction;
use crate::guide::{Guide, Mark};
use crate::integrator::First;
use crate::integrator::path::{Carried, Gathered, Shadow};
use crate::lanes::{LANES, MOST_LANES, Row, Wide};
use crate::light::Aim;
use crate::math::{Rgb, luminance};
use crate::ray::{Hit, Ray};
use crate::sampler::{self, BounceNumbers, LatticeKeys, PixelKey, PixelPoints, Sampler, TOGETHER};
use glam::{Vec2, Vec3};
use std::ops::Range;

/// A path that is still on its way: where its ray is, and where its other records are.
#[derive(Clone, Copy, Debug)]
pub(super) struct Place {
    /// Among the rays of this wave.
    pub ray: u32,
    /// Among the paths of the stream.
    pub slot: u32,
}

/// `last_pdf` of a path whose last direction has no density.
pub(super) const NO_DENSITY: f32 = -1.0;

/// All records. Those by slot stay where they are; rays move up where paths have ended.
pub(super) struct Paths {
    /// Rays of this wave ([`Ray`]), and whose they are.
    rays: Vec<Row>,
    slots: Vec<u32>,
    hits: Vec<Hit>,
    /// Rays of the next wave.
    next_rays: Vec<Row>,
    next_slots: Vec<u32>,
    /// Shadow rays, the light that they stand for (three numbers) and whose it is.
    shadow_rays: Vec<Row>,
    shadow_light: Vec<(Rgb, u32)>,
    blocked: Vec<bool>,
    /// By slot: throughput, eta_scale, last_pdf, depth (bits), split, expected.
    pub carried: Vec<Row>,
    /// By slot: last_p, axis of last_aim, its narrowness (bits), drawn.
    pub last: Vec<Row>,
    /// By slot: alpha, albedo, normal, depth of the first surface.
    pub first: Vec<Row>,
    /// By slot: numbers of the event, see [`BounceNumbers`].
    pub numbers: Vec<Row>,
    /// By slot: point, error, geometric normal, pmf of the light.
    pub point: Vec<Row>,
    /// By slot: shading normal; albedo of a diffuse surface, material (bits) of others; light (bits);
    /// mark (bits).
    pub surface: Vec<Row>,
    /// By slot: radiance, weight of the pixel filter.
    pub radiance: Vec<Row>,
    rare: Vec<Rare>,
    /// By slot: what the surface that was met gives off; kept for a guide that learns.
    shone: Vec<Rgb>,
    any_passed: bool,
    /// Paths that a sample is split into; those of one lie side by side, the camera's first.
    split: usize,
    /// Paths in work.
    len: usize,
    /// Sample index by slot.
    index: Box<[u32; CAPACITY]>,
    /// Index of the numbers of events by slot, its bits reversed.
    pub reversed: Box<[u32; CAPACITY]>,
    /// Pixel by slot.
    pixel: Box<[u32; CAPACITY]>,
    pixels: Vec<Pixel>,
    /// Dimension that the keys of all pixels have been made for.
    made: u32,
}

/// What the samples of a pixel have in common.
#[derive(Clone, Copy)]
struct Pixel {
    of: PixelOf,
    key: PixelKey,
    /// Sample after its last.
    end: u32,
    /// Dimension that `keys` are of.
    dimension: u32,
    keys: LatticeKeys,
}

/// A pixel that samples are of.
#[derive(Clone, Copy, Debug)]
pub(crate) struct PixelOf {
    /// Its place in the tile.
    pub place: [u32; 2],
    /// Its place in the whole picture.
    pub whole: [u32; 2],
}

/// The rest of [`Gathered`].
#[derive(Clone, Copy)]
struct Rare {
    seen_first: bool,
    passed: u32,
    travelled: f32,
}

impl Paths {
    pub fn new() -> Box<Paths> {
        // Lanes read past the last path, and make nothing of it.
        let rows = || vec![Row::default(); CAPACITY + MOST_LANES];
        Box::new(Paths {
            rays: Vec::with_capacity(CAPACITY),
            slots: Vec::with_capacity(CAPACITY),
            hits: vec![Hit::none(0.0); CAPACITY],
            next_rays: Vec::with_capacity(CAPACITY),
            next_slots: Vec::with_capacity(CAPACITY),
            shadow_rays: Vec::with_capacity(CAPACITY),
            shadow_light: Vec::with_capacity(CAPACITY),
            blocked: vec![false; CAPACITY],
            carried: rows(),
            last: rows(),
            first: rows(),
            numbers: rows(),
            point: rows(),
            surface: rows(),
            radiance: rows(),
            rare: vec![Rare::NONE; CAPACITY],
            shone: vec![Rgb::ZERO; CAPACITY],
            any_passed: false,
            split: 1,
            len: 0,
            index: Box::new([0; CAPACITY]),
            reversed: Box::new([0; CAPACITY]),
            pixel: Box::new([0; CAPACITY]),
            pixels: Vec::with_capacity(CAPACITY),
            made: u32::MAX,
        })
    }

    /// Makes room for new samples, each split into so many paths.
    pub fn clear(&mut self, split: u32) {
        self.split = split as usize;
        self.len = 0;
        self.pixels.clear();
        self.made = u32::MAX;
        let nothing = Carried {
            throughput: Rgb::ONE,
            eta_scale: 1.0,
            last_pdf: None,
            last_p: Vec3::ZERO,
            last_aim: Aim::ANYWHERE,
            depth: 0,
            split: 1.0,
            expected: 0.0,
            drawn: 0.0,
        };
        self.carried.fill(carried_row(&nothing));
        self.first.fill(first_row(&First::NOTHING));
        self.rare.fill(Rare::NONE);
        self.any_passed = false;
    }

    /// Adds samples of a pixel.
    pub fn push(&mut self, of: PixelOf, key: PixelKey, samples: Range<u32>) {
        let pixel = self.pixels.len() as u32;
        let split = self.split as u32;
        for index in samples {
            for _ in 0..split {
                self.index[self.len] = index;
                self.reversed[self.len] = index.reverse_bits();
                self.pixel[self.len] = pixel;
                self.len += 1;
            }
        }
        self.pixels.push(Pixel {
            of,
            key,
            end: self.samples() as u32,
            dimension: u32::MAX,
            keys: LatticeKeys::default(),
        });
    }

    /// Puts all samples on their way; [`super::camera::rays`] makes their rays.
    pub fn start(&mut self) {
        self.slots.clear();
        self.slots
            .extend((0..self.len as u32).step_by(self.split.max(1)));
        self.rays.resize(self.samples(), Row::default());
        if self.split > 1 {
            // Camera rays clear those of the first paths only.
            self.radiance[..self.len].fill(Row::default());
        }
    }

    /// Samples, on their way or not.
    #[inline(always)]
    pub fn samples(&self) -> usize {
        self.len / self.split
    }

    /// Samples that there is room for.
    pub fn room(&self) -> usize {
        (CAPACITY - self.len) / self.split
    }

    /// Paths that a sample is split into.
    #[inline(always)]
    pub fn split(&self) -> u32 {
        self.split as u32
    }

    /// Slot of the camera's path of a sample.
    #[inline(always)]
    pub fn slot_of(&self, sample: usize) -> usize {
        sample * self.split
    }

    /// Splits paths at their first vertex: `places` are those of all parts.
    pub fn split_at(&mut self, places: &[Place]) {
        for place in places {
            let first = Place {
                slot: place.slot - place.slot % self.split as u32,
                ..*place
            };
            if place.slot != first.slot {
                continue;
            }
            let split = self.split as u32;
            let carried = self.carried(first).part(split);
            let first = first.slot as usize;
            for slot in first..first + self.split {
                let part = (slot - first) as u32;
                let of_part = sampler::index_of_part(self.index[slot], split, part);
                self.reversed[slot] = of_part.reverse_bits();
                self.carried[slot] = carried_row(&carried);
                self.last[slot] = self.last[first];
                self.point[slot] = self.point[first];
                self.surface[slot] = self.surface[first];
                if slot != first {
                    self.rare[slot] = Rare::LATER;
                }
            }
        }
    }

    /// Puts together what the parts of each sample have gathered: records of samples, by their number.
    pub fn join(&mut self) {
        let split = self.split;
        if split == 1 {
            return;
        }
        for sample in 0..self.samples() {
            let first = sample * split;
            let mut sum = self.radiance[first];
            for slot in first + 1..first + split {
                let [r, g, b, ..] = self.radiance[slot].0;
                sum.0[0] += r;
                sum.0[1] += g;
                sum.0[2] += b;
            }
            self.radiance[sample] = sum;
            self.first[sample] = self.first[first];
        }
    }

    /// The pixel of a sample.
    #[inline(always)]
    pub fn pixel(&self, slot: usize) -> &PixelOf {
        &self.pixels[self.pixel[slot] as usize].of
    }

    /// The sample after the last of a path's pixel.
    #[inline(always)]
    pub fn end_of_pixel(&self, slot: usize) -> usize {
        self.pixels[self.pixel[slot] as usize].end as usize
    }

    /// What tells a sample's pixel from others.
    #[inline(always)]
    pub fn pixel_key(&self, slot: u32) -> PixelKey {
        self.pixels[self.pixel[slot as usize] as usize].key
    }

    /// The numbers of a path from an event on, given the points of its pixel.
    pub fn sampler<'p>(&self, place: Place, event: u32, of: &'p mut PixelPoints) -> Sampler<'p> {
        let index = self.reversed[place.slot as usize].reverse_bits();
        Sampler::at_event(of, index, event)
    }

    /// Index of a sample.
    #[inline(always)]
    pub fn index(&self, slot: usize) -> u32 {
        self.index[slot]
    }

    /// Rays of this wave, to be made.
    #[inline(always)]
    pub fn rays_mut(&mut self) -> &mut [Row] {
        &mut self.rays
    }

    pub fn is_done(&self) -> bool {
        self.rays.is_empty()
    }

    /// Paths on their way.
    pub fn active(&self) -> usize {
        self.rays.len()
    }

    pub fn place(&self, at: usize) -> Place {
        Place {
            ray: at as u32,
            slot: self.slots[at],
        }
    }

    /// Finds the hits of all rays of an event.
    pub fn find_hits(&mut self, geometry: &Geometry, event: u32) {
        let rays = bytemuck::cast_slice(&self.rays);
        let hits = &mut self.hits[..self.rays.len()];
        // A camera's rays run alike, those that follow do not.
        if event == 0 {
            geometry.closest_coherent(rays, hits);
        } else {
            geometry.closest_many(rays, hits);
        }
    }

    #[inline(always)]
    pub fn hit(&self, place: Place) -> Hit {
        self.hits[place.ray as usize]
    }

    /// The hit of a ray of this wave.
    #[inline(always)]
    pub fn hit_of(&self, ray: u32) -> &Hit {
        &self.hits[ray as usize]
    }

    /// Whether any path has passed a border without a surface.
    pub fn any_passed(&self) -> bool {
        self.any_passed
    }

    #[inline(always)]
    pub fn ray(&self, place: Place) -> Ray {
        bytemuck::cast(self.rays[place.ray as usize])
    }

    #[inline(always)]
    pub fn rays(&self) -> &[Row] {
        &self.rays
    }

    #[inline(always)]
    pub fn depth(&self, place: Place) -> u32 {
        self.carried[place.slot as usize].0[5].to_bits()
    }

    #[inline(always)]
    pub fn seen_first(&self, place: Place) -> bool {
        self.rare[place.slot as usize].seen_first
    }

    /// The layers of the first surface have been kept.
    #[inline(always)]
    pub fn set_seen(&mut self, slot: u32) {
        self.rare[slot as usize].seen_first = true;
    }

    pub fn carried(&self, place: Place) -> Carried {
        let [r, g, b, eta_scale, pdf, depth, split, expected] = self.carried[place.slot as usize].0;
        let [px, py, pz, ax, ay, az, narrow, drawn] = self.last[place.slot as usize].0;
        Carried {
            throughput: Rgb::new(r, g, b),
            eta_scale,
            last_pdf: (pdf != NO_DENSITY).then_some(pdf),
            last_p: Vec3::new(px, py, pz),
            last_aim: Aim {
                axis: Vec3::new(ax, ay, az),
                narrow: narrow.to_bits(),
            },
            depth: depth.to_bits(),
            split,
            expected,
            drawn,
        }
    }

    /// What lights are chosen for, as lanes have left it there.
    pub fn last_aim(&self, place: Place) -> Aim {
        let [_, _, _, x, y, z, narrow, _] = self.last[place.slot as usize].0;
        Aim {
            axis: Vec3::new(x, y, z),
            narrow: narrow.to_bits(),
        }
    }

    pub fn set_carried(&mut self, place: Place, c: &Carried) {
        self.carried[place.slot as usize] = carried_row(c);
        let ([px, py, pz], [ax, ay, az]) = (c.last_p.to_array(), c.last_aim.axis.to_array());
        let narrow = f32::from_bits(c.last_aim.narrow);
        self.last[place.slot as usize] = Row([px, py, pz, ax, ay, az, narrow, c.drawn]);
    }

    pub fn gathered(&self, place: Place) -> Gathered {
        let slot = place.slot as usize;
        let [alpha, r, g, b, x, y, z, depth] = self.first[slot].0;
        let rare = self.rare[slot];
        Gathered {
            radiance: Rgb::from_slice(&self.radiance[slot].0),
            first: First {
                alpha,
                albedo: Rgb::new(r, g, b),
                normal: Vec3::new(x, y, z),
                depth,
            },
            seen_first: rare.seen_first,
            passed: rare.passed,
            travelled: rare.travelled,
        }
    }

    pub fn set_gathered(&mut self, place: Place, g: &Gathered) {
        let slot = place.slot as usize;
        self.first[slot] = first_row(&g.first);
        self.radiance[slot].0[..3].copy_from_slice(&g.radiance.to_array());
        self.any_passed |= g.passed > 0;
        self.rare[slot] = Rare {
            seen_first: g.seen_first,
            passed: g.passed,
            travelled: g.travelled,
        };
    }

    pub fn numbers(&self, place: Place) -> BounceNumbers {
        let [lx, ly, bx, by, light_choice, lobe, roulette, mix] =
            self.numbers[place.slot as usize].0;
        BounceNumbers {
            light: Vec2::new(lx, ly),
            bsdf: Vec2::new(bx, by),
            light_choice,
            lobe,
            roulette,
            mix,
        }
    }

    pub fn set_numbers(&mut self, place: Place, n: &BounceNumbers) {
        self.numbers[place.slot as usize] = Row([
            n.light.x,
            n.light.y,
            n.bsdf.x,
            n.bsdf.y,
            n.light_choice,
            n.lobe,
            n.roulette,
            n.mix,
        ]);
    }

    /// Adds what a constant sky sends along a ray that meets nothing; see
    /// [`path::escape`](crate::integrator::path::escape).
    #[inline(always)]
    pub fn add_sky(&mut self, place: Place, sky: Rgb, clamp_indirect: f32) {
        let slot = place.slot as usize;
        let [r, g, b, _, _, depth, ..] = self.carried[slot].0;
        if depth.to_bits() == 0 && !self.rare[slot].seen_first {
            self.first[slot].0[0] = 1.0;
        }
        let mut light = Rgb::new(r, g, b) * sky;
        if depth.to_bits() >= 2 {
            let most = light.max_element();
            if most > clamp_indirect {
                light *= clamp_indirect / most;
            }
        }
        self.add(slot, light);
    }

    #[inline(always)]
    fn add(&mut self, slot: usize, light: Rgb) {
        let radiance = &mut self.radiance[slot].0;
        radiance[0] += light.x;
        radiance[1] += light.y;
        radiance[2] += light.z;
    }

    /// Makes the keys of all pixels for the event that begins at a dimension, if there are so many paths that
    /// most will be asked for: side by side that takes half the time. In the first passes each pixel has few
    /// samples, and its keys would be much of what they take.
    #[inline(always)]
    pub fn make_keys(&mut self, dimension: u32, paths: usize) {
        if self.made == dimension || paths < self.pixels.len() {
            return;
        }
        self.made = dimension;
        let mut groups = self.pixels.chunks_exact_mut(TOGETHER);
        for pixels in &mut groups {
            let mut of = [pixels[0].key; TOGETHER];
            for at in 0..TOGETHER {
                of[at] = pixels[at].key;
            }
            let made = PixelKey::lattice_keys_of(of, dimension);
            for at in 0..TOGETHER {
                pixels[at].dimension = dimension;
                pixels[at].keys = made[at];
            }
        }
    }

    /// Keys of the event of a path's pixel that begins at a dimension.
    #[inline(always)]
    pub fn keys(&mut self, slot: u32, dimension: u32) -> &LatticeKeys {
        let pixel = &mut self.pixels[self.pixel[slot as usize] as usize];
        if pixel.dimension != dimension {
            pixel.dimension = dimension;
            pixel.keys = pixel.key.lattice_keys(dimension);
        }
        &pixel.keys
    }

    /// A vertex that lanes go on with: its shading normal, and the albedo or the material (bits).
    pub fn set_vertex(&mut self, place: Place, it: &Interaction, normal: Vec3, given: Rgb) {
        let slot = place.slot as usize;
        let ([px, py, pz], [gx, gy, gz]) = (it.p.to_array(), it.ng.to_array());
        self.point[slot] = Row([px, py, pz, it.error, gx, gy, gz, 0.0]);
        let ([nx, ny, nz], [r, g, b]) = (normal.to_array(), given.to_array());
        self.surface[slot] = Row([nx, ny, nz, r, g, b, 0.0, 0.0]);
    }

    /// What a guide knows at a vertex.
    #[inline(always)]
    pub fn mark(&self, slot: u32) -> Mark {
        Mark(self.surface[slot as usize].0[7].to_bits())
    }

    /// See [`Paths::mark`]; it goes when another vertex is found.
    #[inline(always)]
    pub fn set_mark(&mut self, slot: u32, mark: Mark) {
        self.surface[slot as usize].0[7] = f32::from_bits(mark.0);
    }

    /// See [`path::expect`](crate::integrator::path::expect).
    #[inline(always)]
    pub fn expect(&mut self, guide: &Guide, mark: Mark, p: Vec3, slot: u32) {
        let carried = &mut self.carried[slot as usize].0;
        if let Some(way) = mark.way()
            && carried[7] == 0.0
        {
            let throughput = luminance(Rgb::from_slice(carried)) * carried[6];
            carried[7] = throughput * guide.sent(p, way);
        }
    }

    /// What the surface that was met gives off; see [`Trainer`](super::Trainer).
    pub fn shone(&self, slot: u32) -> Rgb {
        self.shone[slot as usize]
    }

    /// See [`Paths::shone`].
    pub fn set_shone(&mut self, slot: u32, light: Rgb) {
        self.shone[slot as usize] = light;
    }

    /// Density that the last direction was drawn with; see [`Carried::drawn`].
    pub fn drawn(&self, slot: u32) -> f32 {
        self.last[slot as usize].0[7]
    }

    /// The path goes on.
    pub fn go_on(&mut self, place: Place, ray: &Ray) {
        self.push_next(bytemuck::cast(*ray), place.slot);
    }

    #[inline(always)]
    pub fn push_next(&mut self, ray: Row, slot: u32) {
        self.next_rays.push(ray);
        self.next_slots.push(slot);
    }

    /// Light arrives, unless something stands in the way.
    pub fn ask_shadow(&mut self, place: Place, shadow: &Shadow) {
        self.push_shadow(bytemuck::cast(shadow.ray), shadow.light, place.slot);
    }

    #[inline(always)]
    pub fn push_shadow(&mut self, ray: Row, light: Rgb, slot: u32) {
        self.shadow_rays.push(ray);
        self.shadow_light.push((light, slot));
    }

    /// Traces all shadow rays and adds what arrives; how many there were.
    pub fn cast_shadows(&mut self, geometry: &Geometry) -> usize {
        let count = self.shadow_rays.len();
        let blocked = &mut self.blocked[..count];
        geometry.occluded_many(bytemuck::cast_slice(&self.shadow_rays), blocked);
        for ((light, slot), blocked) in self.shadow_light.iter().zip(blocked) {
            if !*blocked {
                let radiance = &mut self.radiance[*slot as usize].0;
                radiance[0] += light.x;
                radiance[1] += light.y;
                radiance[2] += light.z;
            }
        }
        self.shadow_rays.clear();
        self.shadow_light.clear();
        count
    }

    /// The rays that go on are those to trace.
    pub fn next_wave(&mut self) {
        std::mem::swap(&mut self.rays, &mut self.next_rays);
        std::mem::swap(&mut self.slots, &mut self.next_slots);
        self.next_rays.clear();
        self.next_slots.clear();
    }
}

fn carried_row(c: &Carried) -> Row {
    let [r, g, b] = c.throughput.to_array();
    let pdf = c.last_pdf.unwrap_or(NO_DENSITY);
    let depth = f32::from_bits(c.depth);
    Row([r, g, b, c.eta_scale, pdf, depth, c.split, c.expected])
}

fn first_row(first: &First) -> Row {
    let ([r, g, b], [x, y, z]) = (first.albedo.to_array(), first.normal.to_array());
    Row([first.alpha, r, g, b, x, y, z, first.depth])
}

impl Rare {
    const NONE: Rare = Rare {
        seen_first: false,
        passed: 0,
        travelled: 0.0,
    };

    /// Of a path that begins behind the first surface.
    const LATER: Rare = Rare {
        seen_first: true,
        ..Rare::NONE
    };
}

/// A list of paths.
pub(super) struct List {
    places: Box<[Place; CAPACITY]>,
    len: usize,
}

impl List {
    fn new() -> List {
        List {
            places: Box::new([Place { ray: 0, slot: 0 }; CAPACITY]),
            len: 0,
        }
    }

    pub fn all(&self) -> &[Place] {
        &self.places[..self.len]
    }

    #[inline(always)]
    pub fn push(&mut self, place: Place) {
        self.places[self.len] = place;
        self.len += 1;
    }
}

/// The paths of a wave by what is done with them.
pub(super) struct Lists {
    /// Rays that leave the scene.
    pub missed: List,
    /// By [`Find`]: how the vertices of hits are found.
    pub found: [List; 4],
    /// By [`Model`]: how vertices scatter; those of [`Model::Other`] are done with.
    pub scattering: [List; 4],
}

impl Lists {
    pub fn new() -> Lists {
        let lists = || [List::new(), List::new(), List::new(), List::new()];
        Lists {
            missed: List::new(),
            found: lists(),
            scattering: lists(),
        }
    }

    pub fn clear(&mut self) {
        self.missed.len = 0;
        for list in self.found.iter_mut().chain(&mut self.scattering) {
            list.len = 0;
        }
    }

    /// Has all parts of paths scatter.
    pub fn split(&mut self, model: Model, split: u32) {
        let list = &mut self.scattering[model as usize];
        // From the end: none is written over before it is read.
        for at in (0..list.len).rev() {
            let first = list.places[at];
            for part in 0..split {
                list.places[at * split as usize + part as usize] = Place {
                    slot: first.slot + part,
                    ..first
                };
            }
        }
        list.len *= split as usize;
    }

    pub fn found(&self, find: Find) -> &[Place] {
        self.found[find as usize].all()
    }

    pub fn scattering(&self, model: Model) -> &[Place] {
        self.scattering[model as usize].all()
    }
}

/// Places one after another, the last repeated where there are fewer.
#[inline(always)]
pub(super) fn in_turn<const N: usize>(begin: usize, end: usize) -> [u32; N] {
    let mut places = [0; N];
    for (lane, place) in places.iter_mut().enumerate() {
        *place = (begin + lane).min(end - 1) as u32;
    }
    places
}

/// Paths that lanes work on together, up to one a lane; the lanes beyond them repeat the last.
#[derive(Clone, Copy)]
pub(super) struct Group<const N: usize> {
    pub rays: [u32; N],
    pub slots: [u32; N],
    /// One bit a lane.
    pub used: u32,
}

impl<const N: usize> Group<N> {
    #[inline(always)]
    pub fn new(places: &[Place]) -> Self {
        let last = places[places.len() - 1];
        let mut group = Group {
            rays: [last.ray; N],
            slots: [last.slot; N],
            used: (1 << places.len()) - 1,
        };
        for (lane, place) in places.iter().enumerate() {
            group.rays[lane] = place.ray;
            group.slots[lane] = place.slot;
        }
        group
    }
}

/// The inverse of [`Wide::gather`]; lanes that are not used repeat the last that is.
#[inline(always)]
pub(super) fn scatter<W: Wide<N>, const N: usize>(
    records: &mut [Row],
    at: &[u32; N],
    columns: [W::F; LANES],
) {
    let rows = W::records(columns);
    for lane in 0..N {
        records[at[lane] as usize] = rows[lane];
    }
}
