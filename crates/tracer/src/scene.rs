//! A prepared scene: immutable and shared between threads.

use crate::accel::{Geometry, SimdLevel};
use crate::camera::filter::FilterSampler;
use crate::camera::{Camera, PixelView};
use crate::geometry::Interaction;
use crate::geometry::interaction::Needs;
use crate::guide::Guide;
use crate::integrator::stream::Tables;
use crate::light::{Light, Lights};
use crate::material::Materials;
use crate::math::Rgb;
use crate::medium::Media;
use crate::ray::{Hit, NONE, Ray};
use crate::sampler::{PixelKey, PixelPoints};
use crate::split::{SPLIT_MAX, Splits};
use crate::texture::Textures;
use ::scene::model::{Integrator, SamplerKind};
use film::TileGrid;
use glam::Vec3;
use std::sync::Arc;

/// A scene ready to be rendered.
pub struct Scene {
    /// What rays meet.
    pub geometry: Arc<Geometry>,
    /// What it looks like. A unit of work has its own view of it.
    pub textures: Textures,
    /// How it scatters.
    pub materials: Arc<Materials>,
    /// What shines.
    pub lights: Arc<Lights>,
    /// What lies between surfaces.
    pub media: Arc<Media>,
    /// Whether anything lies there: rays must then know where they are.
    pub has_media: bool,
    /// Whether rays may meet them without having met a surface first: the camera is inside one, or there are
    /// borders that are no surfaces.
    pub is_foggy: bool,
    /// The view.
    pub camera: Arc<Camera>,
    /// How much of a surface a pixel covers.
    pub view: PixelView,
    /// Reconstruction filter.
    pub filter: Arc<FilterSampler>,
    /// How light is gathered.
    pub integrator: Integrator,
    /// Where light comes from, if paths are guided.
    pub(crate) guide: Option<Arc<Guide>>,
    /// What streams of paths want to know.
    pub(crate) stream: Arc<Tables>,
    /// Which points a pixel is sampled at.
    pub sampler: SamplerKind,
    /// How many paths samples are split into.
    pub(crate) splits: Arc<Splits>,
    /// Seed of the sampler.
    pub seed: u64,
    /// Frame number.
    pub frame: u32,
    /// How the picture (the crop, if there is one) is cut into tiles.
    pub grid: TileGrid,
    /// Size of the whole picture and the corner of the crop in it.
    pub full_size: [u32; 2],
    /// See `full_size`.
    pub crop_origin: [u32; 2],
    /// Factor on all radiance.
    pub exposure: Rgb,
    /// Samples are scaled down to this; biased.
    pub max_component: f32,
    /// Bound on what one indirect path carries; biased.
    pub clamp_indirect: f32,
}

impl Scene {
    /// How the picture is cut into tiles.
    pub fn grid(&self) -> TileGrid {
        self.grid
    }

    /// Renders with the instructions of a level from now on, or with the best that there are below it. It never
    /// changes a bit; only views of this scene that exist already keep theirs.
    pub fn set_simd_level(&mut self, level: SimdLevel) {
        if let Some(geometry) = Arc::get_mut(&mut self.geometry) {
            geometry.level = level.available();
        }
    }

    /// Splits all samples into so many paths (1 to 4) from now on, instead of what was found to be best for
    /// each part of the picture: other samples, of the same mean.
    pub fn set_split(&mut self, split: u32) {
        self.splits = Arc::new(Splits::all(split.clamp(1, SPLIT_MAX)));
    }

    /// The same scene for one unit of work: it holds pictures of its own, so that others may be dropped
    /// between its samples.
    pub(crate) fn view(&self) -> Scene {
        Scene {
            geometry: self.geometry.clone(),
            textures: self.textures.view(),
            materials: self.materials.clone(),
            lights: self.lights.clone(),
            media: self.media.clone(),
            camera: self.camera.clone(),
            filter: self.filter.clone(),
            guide: self.guide.clone(),
            stream: self.stream.clone(),
            splits: self.splits.clone(),
            ..*self
        }
    }

    /// The points of a pixel of the whole picture.
    pub(crate) fn points(&self, pixel: [u32; 2]) -> PixelPoints {
        PixelPoints::new(self.sampler, self.pixel_key(pixel))
    }

    /// What tells a pixel of the whole picture from others.
    pub(crate) fn pixel_key(&self, pixel: [u32; 2]) -> PixelKey {
        PixelKey::new(self.seed, self.frame, pixel)
    }

    /// Memory held, for the worker's budget.
    pub fn memory_bytes(&self) -> usize {
        self.geometry.memory_bytes()
            + self.media.memory_bytes()
            + self.lights.lights.len() * size_of::<Light>()
            + self.stream.memory_bytes()
            + self.guide.as_ref().map_or(0, |guide| guide.memory_bytes())
    }

    /// Whether a hit surface is the border of a medium.
    #[inline]
    pub fn leads_to_media(&self, hit: &Hit) -> bool {
        self.has_media && self.geometry.surface_of(hit).media.is_some()
    }

    /// The closest hit.
    #[inline]
    pub fn intersect(&self, ray: &Ray) -> Option<Hit> {
        let hit = self.geometry.closest(ray);
        hit.is_some().then_some(hit)
    }

    /// Whether anything is hit before the ray's end.
    #[inline]
    pub fn occluded(&self, ray: &Ray) -> bool {
        self.geometry.occluded(ray)
    }

    /// Everything about the point of a hit.
    #[inline]
    pub fn interaction(&self, ray: &Ray, hit: &Hit) -> Interaction {
        let mut it = Interaction::NONE;
        self.find(ray, hit, &mut it);
        it
    }

    /// [`Scene::interaction`] in place.
    #[inline(always)]
    pub fn find(&self, ray: &Ray, hit: &Hit, it: &mut Interaction) {
        let materials = &self.materials.list;
        it.find(&self.geometry, &self.lights.light_of, ray, hit, |surface| {
            let material = &materials[surface.material as usize];
            Needs {
                coordinates: material.needs_coordinates || surface.shines(),
                tangents: material.needs_tangents || material.needs_footprint,
            }
        });
        if materials[it.material as usize].needs_footprint {
            self.view.cover(it, ray);
        }
    }

    /// Radiance that a surface gives off towards `wo`.
    #[inline]
    pub fn emitted(&self, it: &Interaction, wo: Vec3) -> Rgb {
        if it.emission == NONE {
            return Rgb::ZERO;
        }
        self.lights.emissions[it.emission as usize].le(&self.textures, &it.point, it.ng.dot(wo))
    }
}
