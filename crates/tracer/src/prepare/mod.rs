//! The compile step: from a description to a [`Scene`] with trees, tables and decoded pictures.
//!
//! Static shapes are placed once and for all; what moves becomes an instance. Work is spread over
//! threads by pictures, meshes, trees and parts of large trees, none of which depends on how many threads
//! there are: their number changes no bit.

mod lights;
mod trees;

use crate::accel::{Few, Geometry, SimdLevel};
use crate::camera::Camera;
use crate::camera::filter::FilterSampler;
use crate::geometry::Surface;
use crate::guide::Guide;
use crate::integrator::stream::Tables;
use crate::light::{Goniometric, Light, Lights, Projection, environment::Environment};
use crate::material::Materials;
use crate::math::{self, Rgb};
use crate::medium::Media;
use crate::scene::Scene;
use crate::split::Splits;
use crate::texture::Textures;
use crate::texture::image::Image;
use crate::{PrepareError, PrepareSettings, StopFlag};
use ::scene::AssetSource;
use ::scene::model::{self, Integrator, SceneDesc};
use film::TileGrid;
use glam::{DVec3, Vec3};
use std::sync::Arc;

/// From so many lights on it matters more to a highlight that lights are chosen for it than to a mix that
/// it is a sum: with 16 lamps above painted plastic the sum is a tenth better, with 1,800 a quarter worse.
const MANY_LIGHTS: usize = 32;

/// Compiles a description into a [`Scene`].
pub fn prepare(
    desc: &SceneDesc,
    assets: &dyn AssetSource,
    settings: &PrepareSettings,
    stop: &StopFlag,
) -> Result<Scene, PrepareError> {
    let pool = rayon::ThreadPoolBuilder::new()
        .num_threads(settings.threads.max(1))
        .build()
        .map_err(|e| {
            PrepareError::Scene(format!(
                "the threads for the preparation did not start: {e}"
            ))
        })?;
    pool.install(|| compile(desc, assets, settings, stop))
}

fn compile(
    desc: &SceneDesc,
    assets: &dyn AssetSource,
    settings: &PrepareSettings,
    stop: &StopFlag,
) -> Result<Scene, PrepareError> {
    let open_at = desc
        .animation
        .map_or(0.0, |a| a.start + settings.frame as f64 / a.fps);
    let film = &desc.film;
    let camera = Camera::new(&desc.camera, [film.width, film.height], open_at);

    let mut of_lights = vec![false; desc.images.len()];
    for light in &desc.lights {
        if let Some(image) = image_of(light) {
            of_lights[image.index()] = true;
        }
    }
    let in_groups = desc.groups.iter().flat_map(|g| &g.primitives);
    let coverage: Vec<_> = (desc.primitives.iter().chain(in_groups))
        .filter_map(|p| p.alpha)
        .collect();
    let textures = Textures::load(
        desc.textures.clone(),
        &desc.images,
        &of_lights,
        &coverage,
        settings.picture_bytes,
        assets,
        stop,
    )?;

    let mut materials = Materials::new(&desc.materials, &textures);
    if desc.integrator == Integrator::Uv {
        materials.show_coordinates();
    }
    check_media(desc)?;
    let media = Media::new(desc);
    let placed = trees::build(desc, camera.shutter, stop)?;
    let (mut lights, light_of, surfaces) = lights::areas(desc, &placed);
    for light in &desc.lights {
        lights.push(convert(light, &textures.images));
    }
    let emissions = placed.emissions;
    let lights = Lights::new(lights, light_of, emissions, &textures, crate::simd());
    materials.find_sums(lights.lights.len() > MANY_LIGHTS);
    // What the preparation looked at need not stay.
    let textures = textures.view();
    let has_media = media.camera.is_some() || surfaces.iter().any(|s| s.media.is_some());
    let lets_in = |s: &Surface| match s.media {
        Some(_) => materials.may_be_nothing(s.material),
        // It may shine. Where rays know about media they go on to lamps behind it.
        None => materials.is_interface(s.material),
    };
    let is_foggy = has_media && (media.camera.is_some() || surfaces.iter().any(lets_in));
    let has_alpha = surfaces.iter().any(|s| s.alpha.is_some());
    let few = if has_alpha {
        None
    } else {
        Few::new(&placed.world)
    };
    let geometry = Geometry {
        level: SimdLevel::Scalar,
        few,
        world: placed.world,
        groups: placed.groups,
        instances: placed.instances,
        surfaces,
        meshes: placed.meshes,
        curves: placed.curves,
        textures: textures.view(),
        has_alpha,
    };
    let [x0, y0, x1, y1] = film.crop.unwrap_or([0, 0, film.width, film.height]);
    let (integrator, is_guided) = match desc.integrator {
        Integrator::Guided { max_depth } => (Integrator::Path { max_depth }, !is_foggy),
        other => (other, false),
    };
    let tables = Tables::new(&geometry, &materials, &lights);
    let mut scene = Scene {
        geometry: Arc::new(Geometry {
            level: crate::simd(),
            ..geometry
        }),
        textures,
        materials: Arc::new(materials),
        lights: Arc::new(lights),
        media: Arc::new(media),
        has_media,
        is_foggy,
        view: camera.pixel_view([film.width, film.height]),
        camera: Arc::new(camera),
        filter: Arc::new(FilterSampler::new(&film.filter)),
        integrator,
        guide: None,
        stream: Arc::new(tables),
        sampler: desc.sampler,
        splits: Arc::default(),
        seed: settings.seed,
        frame: settings.frame,
        grid: TileGrid {
            width: x1 - x0,
            height: y1 - y0,
        },
        full_size: [film.width, film.height],
        crop_origin: [x0, y0],
        exposure: Rgb::from_array(film.exposure),
        max_component: film.max_component.unwrap_or(f32::INFINITY),
        clamp_indirect: settings.clamp_indirect.unwrap_or(f32::INFINITY),
    };
    if let (Integrator::Path { max_depth }, true) = (integrator, is_guided) {
        Guide::train(&mut scene, max_depth, stop)?;
    }
    scene.splits = Arc::new(Splits::choose(&scene, stop)?);
    Ok(scene)
}

/// Refuses grids whose values are not those of their cells.
fn check_media(desc: &SceneDesc) -> Result<(), PrepareError> {
    for medium in &desc.media {
        let Some(grid) = &medium.grid else { continue };
        let parts = [
            ("absorption", Some(&grid.absorption)),
            ("scattering", Some(&grid.scattering)),
            ("emission", grid.emission.as_ref()),
        ];
        for (what, part) in parts {
            let Some(part) = part else { continue };
            let cells = part
                .size
                .iter()
                .try_fold(1u64, |n, s| n.checked_mul(u64::from(*s)));
            let values = match &part.values {
                model::GridValues::Scalar(v) => v.len(),
                model::GridValues::Rgb(v) => v.len(),
            };
            if values == 0 || cells != Some(values as u64) {
                return Err(PrepareError::Scene(format!(
                    "medium {:?}: the grid of {what} has {} x {} x {} cells and {values} values",
                    medium.name, part.size[0], part.size[1], part.size[2],
                )));
            }
        }
    }
    Ok(())
}

/// The picture that a light shines through.
fn image_of(light: &model::Light) -> Option<model::ImageId> {
    match light {
        model::Light::Environment { image, .. } => image.map(|(id, _)| id),
        model::Light::Goniometric { image, .. } | model::Light::Projection { image, .. } => {
            Some(*image)
        }
        _ => None,
    }
}

fn convert(light: &model::Light, images: &[Image]) -> Light {
    let v = |d: DVec3| Vec3::new(d.x as f32, d.y as f32, d.z as f32);
    match light {
        model::Light::Point {
            transform,
            intensity,
        } => Light::Point {
            p: v(transform.translation),
            intensity: Rgb::from_array(*intensity),
        },
        model::Light::Spot {
            transform,
            intensity,
            cone_angle,
            full_angle,
            falloff,
        } => Light::Spot {
            p: v(transform.translation),
            axis: math::normalize(v(transform.matrix3.z_axis)),
            intensity: Rgb::from_array(*intensity),
            cos_outer: libm::cos(cone_angle.to_radians()) as f32,
            cos_inner: libm::cos(full_angle.to_radians()) as f32,
            falloff: *falloff,
        },
        model::Light::Distant {
            direction,
            irradiance,
        } => Light::Distant {
            towards: math::normalize(v(-*direction)),
            irradiance: Rgb::from_array(*irradiance),
        },
        model::Light::Environment {
            transform,
            radiance,
            image,
            hidden,
            illuminance,
            portal,
        } => Light::Environment(Environment::new(
            transform,
            Rgb::from_array(*radiance),
            image.map(|(id, mapping)| (id.index(), mapping)),
            images,
            *hidden,
            *illuminance,
            portal.as_ref(),
        )),
        model::Light::Goniometric {
            transform,
            intensity,
            image,
            power,
        } => Light::Goniometric(Goniometric::new(
            transform,
            Rgb::from_array(*intensity),
            image.index(),
            *power,
            images,
        )),
        model::Light::Projection {
            transform,
            intensity,
            image,
            fov,
            power,
        } => Light::Projection(Projection::new(
            transform,
            Rgb::from_array(*intensity),
            image.index(),
            *fov,
            *power,
            images,
        )),
    }
}
