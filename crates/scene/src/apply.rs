//! Overrides applied to a scene: size, integrator, camera, environment.

use crate::context::{Context, Issue};
use crate::diagnostic::Place;
use crate::limits::{MAX_PIXELS, MAX_SIDE};
use crate::model::{
    Camera, Encoding, FovAxis, Integrator, Light, Motion, Projection, SceneDesc, SphereMapping,
};
use crate::overrides::{Look, Overrides};
use glam::{DAffine3, DMat3, DVec3};

/// Integrators by the names that users write.
pub const INTEGRATORS: [&str; 8] = [
    "path", "guided", "direct", "whitted", "normals", "albedo", "depth", "uv",
];

/// Scattering events where nothing says how many.
pub const DEFAULT_DEPTH: u32 = 64;

/// The integrator of that name.
pub fn integrator(name: &str, max_depth: u32) -> Result<Integrator, String> {
    Ok(match name {
        "path" => Integrator::Path { max_depth },
        "guided" => Integrator::Guided { max_depth },
        "direct" => Integrator::Direct { max_depth },
        "whitted" => Integrator::Whitted { max_depth },
        "normals" => Integrator::Normals,
        "albedo" => Integrator::Albedo,
        "depth" => Integrator::Depth,
        "uv" => Integrator::Uv,
        _ => {
            let near = crate::suggest::did_you_mean(name, INTEGRATORS);
            return Err(format!(
                "unknown integrator {name:?}{near}; there are {}",
                INTEGRATORS.join(", ")
            ));
        }
    })
}

fn depth_of(integrator: Integrator) -> u32 {
    match integrator {
        Integrator::Path { max_depth }
        | Integrator::Guided { max_depth }
        | Integrator::Direct { max_depth }
        | Integrator::Whitted { max_depth } => max_depth,
        _ => DEFAULT_DEPTH,
    }
}

/// Camera to world for an eye, a target and an up direction.
pub fn look_at(from: DVec3, at: DVec3, up: DVec3) -> Result<DAffine3, String> {
    let back = (from - at)
        .try_normalize()
        .ok_or("the camera looks from where it looks at")?;
    let right = up
        .cross(back)
        .try_normalize()
        .ok_or("the camera's up points along its view")?;
    Ok(DAffine3::from_mat3_translation(
        DMat3::from_cols(right, back.cross(right), back),
        from,
    ))
}

/// Where settings come from, for messages about them.
pub(crate) fn settings_place() -> Place {
    Place {
        file: "job settings".into(),
        ..Place::default()
    }
}

/// What a reader has already done about settings.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Done {
    /// Cameras and variants were chosen by name.
    pub names: bool,
    /// What the camera looks at where settings move it without saying so; else the origin.
    pub target: DVec3,
}

pub(crate) fn apply(desc: &mut SceneDesc, overrides: &Overrides, done: Done, cx: &mut Context<'_>) {
    let place = settings_place();
    let keep = |result: Result<(), String>, cx: &mut Context<'_>| {
        if let Err(reason) = result {
            cx.error(Issue::new(&place, reason));
        }
    };
    keep(size(desc, overrides), cx);
    if let Some(name) = &overrides.integrator {
        let result = integrator(name, depth_of(desc.integrator)).map(|i| desc.integrator = i);
        keep(result, cx);
    }
    let look = &overrides.look;
    let result = camera(&mut desc.camera, look, done.target);
    keep(result, cx);
    if let Some(name) = look.camera.as_ref().filter(|_| !done.names) {
        keep(
            Err(format!(
                "the file has no camera {name:?}: it has one view only"
            )),
            cx,
        );
    }
    if let Some(name) = look.variant.as_ref().filter(|_| !done.names) {
        keep(Err(format!("the file has no variant {name:?}")), cx);
    }
    let result = environment(desc, look, cx);
    keep(result, cx);
}

fn size(desc: &mut SceneDesc, overrides: &Overrides) -> Result<(), String> {
    let Some([width, height]) = overrides.size else {
        return Ok(());
    };
    if width == 0 || height == 0 || width > MAX_SIDE || height > MAX_SIDE {
        return Err(format!(
            "a picture of {width} x {height} pixels; a side is 1 to {MAX_SIDE}"
        ));
    }
    if u64::from(width) * u64::from(height) > MAX_PIXELS {
        return Err(format!(
            "a picture of {width} x {height} pixels; the limit is {MAX_PIXELS} in all"
        ));
    }
    // The part that is rendered keeps its place in the picture.
    let film = &mut desc.film;
    let scale =
        |v: u32, old: u32, new: u32| (u64::from(v) * u64::from(new) / u64::from(old.max(1))) as u32;
    film.crop = film.crop.map(|[x0, y0, x1, y1]| {
        let (x0, y0) = (scale(x0, film.width, width), scale(y0, film.height, height));
        [
            x0,
            y0,
            scale(x1, film.width, width).max(x0 + 1),
            scale(y1, film.height, height).max(y0 + 1),
        ]
    });
    (film.width, film.height) = (width, height);
    Ok(())
}

fn camera(camera: &mut Camera, look: &Look, target: DVec3) -> Result<(), String> {
    let all = [look.look_from, look.look_at, look.up];
    if all
        .iter()
        .flatten()
        .flatten()
        .chain(look.vfov.iter())
        .any(|x| !x.is_finite())
    {
        return Err("a camera setting that is not a finite number".into());
    }
    if all.iter().any(Option::is_some) {
        let now = camera
            .transform
            .keys
            .first()
            .map(|k| k.transform)
            .unwrap_or(DAffine3::IDENTITY);
        let from = look.look_from.map_or(now.translation, DVec3::from_array);
        let at = look.look_at.map_or_else(
            || {
                if look.look_from.is_some() {
                    target
                } else {
                    from - now.matrix3.z_axis
                }
            },
            DVec3::from_array,
        );
        let up = look.up.map_or(DVec3::Y, DVec3::from_array);
        camera.transform = Motion::fixed(look_at(from, at, up)?);
    }
    if let Some(vfov) = look.vfov {
        if !(vfov > 0.0 && vfov < 180.0) {
            return Err(format!("a field of view of {vfov} degrees"));
        }
        let lens = match &mut camera.projection {
            Projection::Perspective { lens, .. } | Projection::Orthographic { lens, .. } => {
                lens.take()
            }
            Projection::Spherical { .. } => None,
        };
        camera.projection = Projection::Perspective {
            fov: vfov,
            fov_axis: FovAxis::Vertical,
            window: None,
            lens,
        };
    }
    Ok(())
}

fn environment(desc: &mut SceneDesc, look: &Look, cx: &mut Context<'_>) -> Result<(), String> {
    let strength = look.env_strength.unwrap_or(1.0);
    let rotate = look.env_rotate.unwrap_or(0.0);
    if !(strength >= 0.0 && strength.is_finite() && rotate.is_finite()) {
        return Err("the strength and rotation of the environment are finite numbers, the strength not negative".into());
    }
    let (s, c) = (
        libm::sin(rotate.to_radians()),
        libm::cos(rotate.to_radians()),
    );
    // About +Y, counterclockwise as seen from above.
    let turn = DAffine3::from_mat3(DMat3::from_cols(
        DVec3::new(c, 0.0, -s),
        DVec3::Y,
        DVec3::new(s, 0.0, c),
    ));
    if let Some(path) = &look.env {
        let place = settings_place();
        let image = cx
            .image_at(&place, path, Encoding::Auto)
            .map_err(|issue| issue.reason)?;
        desc.lights
            .retain(|light| !matches!(light, Light::Environment { .. }));
        desc.lights.push(Light::Environment {
            transform: turn,
            radiance: [strength as f32; 3],
            image: Some((image, SphereMapping::LatLong)),
            hidden: false,
            illuminance: None,
            portal: None,
        });
    } else if look.env_strength.is_some() || look.env_rotate.is_some() {
        for light in &mut desc.lights {
            if let Light::Environment {
                transform,
                radiance,
                ..
            } = light
            {
                *transform = turn * *transform;
                *radiance = radiance.map(|r| (f64::from(r) * strength) as f32);
            }
        }
    }
    if look.transparent {
        for light in &mut desc.lights {
            if let Light::Environment { hidden, .. } = light {
                *hidden = true;
            }
        }
    }
    Ok(())
}
