//! What stands before `WorldBegin`: camera, film, filter, sampler, integrator.

use super::params::{Kind, Params};
use super::{Frame, Importer, Setting, legacy, lens, matrix};
use crate::color;
use crate::context::Issue;
use crate::diagnostic::Place;
use crate::limits::{MAX_DEPTH, MAX_SPP};
use crate::model::{
    Aperture, Camera, FilmDesc, Filter, FovAxis, Integrator, Lens, Motion, Projection, SamplerKind,
    ScreenWindow, ShutterCurve, SphereMapping,
};
use glam::{DAffine3, DMat3, DMat4, DVec3};

pub(super) const CAMERAS: [&str; 4] = ["perspective", "orthographic", "spherical", "realistic"];
pub(super) const FILMS: [&str; 3] = ["rgb", "gbuffer", "spectral"];
pub(super) const FILTERS: [&str; 5] = ["box", "gaussian", "mitchell", "sinc", "triangle"];
pub(super) const SAMPLERS: [&str; 7] = [
    "zsobol",
    "paddedsobol",
    "halton",
    "sobol",
    "pmj02bn",
    "independent",
    "stratified",
];
pub(super) const INTEGRATORS: [&str; 11] = [
    "path",
    "volpath",
    "simplepath",
    "simplevolpath",
    "lightpath",
    "bdpt",
    "mlt",
    "sppm",
    "ambientocclusion",
    "randomwalk",
    "function",
];

impl Importer<'_, '_> {
    pub(super) fn frame(&mut self, place: &Place) -> Result<Frame, Issue> {
        let settings = std::mem::take(&mut self.settings);
        let or_default = |setting: Option<Setting>, kind: &str| {
            setting.unwrap_or_else(|| Setting {
                kind: kind.to_owned(),
                params: Params::empty(place.clone()),
            })
        };
        let (camera, ctm, around) = match settings.camera {
            Some(camera) => camera,
            None => (
                or_default(None, "perspective"),
                [DMat4::IDENTITY; 2],
                "".into(),
            ),
        };
        let filter = or_default(settings.filter, "gaussian");
        let film = or_default(settings.film, "rgb");
        let sampler = or_default(settings.sampler, "zsobol");
        let integrator = or_default(settings.integrator, "volpath");

        let filter_desc = self.filter(&filter);
        let filter_desc = self.checked(&filter, "the pixel filter", filter_desc);
        let film_desc = self.film(&film);
        let diagonal = film.params.positive("diagonal", 35.0);
        let diagonal = self.cx.keep(diagonal).unwrap_or(35.0);
        let film_desc = self.checked(&film, "Film", film_desc);
        let (kind, spp) = {
            let result = self.sampler(&sampler);
            self.checked(&sampler, "the sampler", result)
        }
        .unwrap_or((SamplerKind::default(), 16));
        let integrator_desc = self.integrator(&integrator);
        let integrator_desc = self
            .checked(&integrator, "the integrator", integrator_desc)
            .unwrap_or(Integrator::Path { max_depth: 5 });
        let mut film_desc = film_desc.unwrap_or(default_film());
        film_desc.filter = filter_desc.unwrap_or(film_desc.filter);
        let camera_desc = self.camera(&camera, &ctm, &mut film_desc, diagonal);
        let mut camera_desc = self
            .checked(&camera, "the camera", camera_desc)
            .unwrap_or(default_camera());

        let medium = self.medium(&around, &camera.params.place);
        camera_desc.medium = self.cx.keep(medium).flatten();

        // imaging ratio = exposure time x iso / 100
        let time = camera_desc.shutter.1 - camera_desc.shutter.0;
        film_desc.exposure = film_desc.exposure.map(|e| (f64::from(e) * time) as f32);
        Ok((camera_desc, film_desc, integrator_desc, kind, spp))
    }

    fn checked<T>(&mut self, setting: &Setting, what: &str, result: Result<T, Issue>) -> Option<T> {
        let value = self.cx.keep(result)?;
        self.warn_unused(&setting.params, what);
        Some(value)
    }

    fn camera(
        &mut self,
        setting: &Setting,
        ctm: &[DMat4; 2],
        film: &mut FilmDesc,
        diagonal: f64,
    ) -> Result<Camera, Issue> {
        let params = &setting.params;
        let world_from_camera = ctm.map(|m| m.inverse());
        let times = self.times;
        let transform = |own: DMat3| -> Result<Motion, Issue> {
            for m in ctm {
                matrix::affine(m).map_err(|e| Issue::new(&params.place, format!("camera: {e}")))?;
            }
            let mut motion = matrix::motion(&world_from_camera, times)
                .map_err(|e| Issue::new(&params.place, e))?;
            for key in &mut motion.keys {
                key.transform *= DAffine3::from_mat3(own);
            }
            Ok(motion)
        };
        let (mut open, mut close) = (
            params.float("shutteropen", 0.0)?,
            params.float("shutterclose", 1.0)?,
        );
        if close < open {
            self.cx.warn(
                &params.place,
                "the shutter closes before it opens: the times are swapped",
            );
            (open, close) = (close, open);
        }
        if close == open {
            return params.fail("the shutter does not open: shutteropen equals shutterclose");
        }
        let lens = |far: f64| -> Result<Option<Lens>, Issue> {
            let radius = params.float("lensradius", 0.0)?;
            let focus_distance = params.positive("focaldistance", far)?;
            if radius < 0.0 {
                return params.fail("the lens radius is negative");
            }
            let (aperture, anamorphic) = (Aperture::Disk, 1.0);
            Ok((radius > 0.0).then_some(Lens {
                radius,
                focus_distance,
                aperture,
                anamorphic,
            }))
        };
        let own_aspect = f64::from(film.width) / f64::from(film.height);
        let window = || -> Result<Option<ScreenWindow>, Issue> {
            if let Some(param) = params.floats("screenwindow")? {
                let &[x0, x1, y0, y1] = param.numbers() else {
                    return param.fail("needs four numbers");
                };
                if x0 == x1 || y0 == y1 {
                    return param.fail("is empty");
                }
                return Ok(Some(ScreenWindow {
                    x: (x0, x1),
                    y: (y0, y1),
                }));
            }
            let Some(aspect) = params
                .float_opt("frameaspectratio")?
                .filter(|&a| a != own_aspect)
            else {
                return Ok(None);
            };
            if aspect <= 0.0 {
                return params.fail("frameaspectratio must be above zero");
            }
            let (w, h) = if aspect > 1.0 {
                (aspect, 1.0)
            } else {
                (1.0, 1.0 / aspect)
            };
            Ok(Some(ScreenWindow {
                x: (-w, w),
                y: (-h, h),
            }))
        };
        // Camera space of pbrt: left-handed, +z forward. Ours looks along -Z.
        let flip = DMat3::from_diagonal(DVec3::new(1.0, 1.0, -1.0));
        let (transform, projection) = match setting.kind.as_str() {
            "realistic" => {
                let projection = self.thin_lens(params, film, diagonal)?;
                (transform(flip)?, projection)
            }
            "perspective" => {
                let fov = params.float("fov", 90.0)?;
                if !(fov > 0.0 && fov < 180.0) {
                    return params.fail(format!("a field of view of {fov} degrees"));
                }
                let (window, lens) = (window()?, lens(1e6)?);
                (
                    transform(flip)?,
                    Projection::Perspective {
                        fov,
                        fov_axis: FovAxis::Shorter,
                        window,
                        lens,
                    },
                )
            }
            "orthographic" => {
                let half_height = if own_aspect > 1.0 {
                    1.0
                } else {
                    1.0 / own_aspect
                };
                let (window, lens) = (window()?, lens(1e6)?);
                (
                    transform(flip)?,
                    Projection::Orthographic {
                        half_height,
                        window,
                        lens,
                    },
                )
            }
            "spherical" => {
                params.ignore(&[
                    "lensradius",
                    "focaldistance",
                    "frameaspectratio",
                    "screenwindow",
                ]);
                match params.text("mapping", "equalarea")? {
                    // pbrt swaps y and z behind the mapping.
                    "equalarea" => (
                        transform(DMat3::from_cols(DVec3::X, DVec3::Z, DVec3::Y))?,
                        Projection::Spherical {
                            mapping: SphereMapping::OctahedralEqualArea,
                        },
                    ),
                    // Its azimuth runs from +x towards +z over the whole width; ours has +x in the middle.
                    "equirectangular" => (
                        transform(DMat3::from_diagonal(DVec3::new(-1.0, 1.0, -1.0)))?,
                        Projection::Spherical {
                            mapping: SphereMapping::LatLong,
                        },
                    ),
                    other => return params.fail(format!("unknown spherical mapping {other:?}")),
                }
            }
            other => {
                let hint = legacy::hint("camera", other, &CAMERAS);
                return params.fail(format!("unknown camera {other:?}{hint}"));
            }
        };
        Ok(Camera {
            transform,
            projection,
            shutter: (open, close),
            shutter_curve: ShutterCurve::Box,
            medium: None,
        })
    }

    /// The thin lens that stands for the glass of a "realistic" camera. Its picture is as bright as
    /// the light that falls onto the film through the aperture; the fall-off to the corners is lost.
    fn thin_lens(
        &mut self,
        params: &Params,
        film: &mut FilmDesc,
        diagonal: f64,
    ) -> Result<Projection, Issue> {
        let Some(param) = params.find("lensfile", &[Kind::String])? else {
            return params.fail("a realistic camera needs a \"lensfile\"");
        };
        let numbers = self.number_file(param, param.text()?)?;
        let lens = lens::thin_lens(&numbers).map_err(|e| Issue::new(&params.place, e))?;
        let aperture_diameter = params.positive("aperturediameter", 1.0)?.min(lens.stop);
        let distance = params.positive("focusdistance", 10.0)?;
        // Everything about the glass is in millimetres, the scene in metres.
        let (f, d) = (lens.focal_length, distance * 1000.0);
        if d <= f {
            return params.fail(format!(
                "a lens of {f:.1} mm cannot focus at {distance} m: nothing in focus"
            ));
        }
        let image_distance = f * d / (d - f);
        let aspect = f64::from(film.width) / f64::from(film.height);
        let height = diagonal / libm::sqrt(1.0 + aspect * aspect);
        let shorter = height.min(height * aspect);
        let fov = 2.0 * libm::atan(0.5 * shorter / image_distance).to_degrees();
        let aperture = match params.text("aperture", "")? {
            "" => Aperture::Disk,
            "pentagon" => Aperture::Blades {
                count: 5,
                rotation: 90.0,
            },
            other => {
                let reason =
                    format!("aperture {other:?} of the lens is not supported: a disk is used");
                self.cx.warn(&params.place, reason);
                Aperture::Disk
            }
        };
        self.cx.warn(
            &params.place,
            format!(
                "camera \"realistic\" becomes a thin lens of {f:.1} mm: without distortion, vignetting and the fall-off to the corners"
            ),
        );
        let radius = 0.5 * aperture_diameter;
        let opening = std::f64::consts::PI * radius * radius / (image_distance * image_distance);
        film.exposure = film.exposure.map(|e| (f64::from(e) * opening) as f32);
        Ok(Projection::Perspective {
            fov,
            fov_axis: FovAxis::Shorter,
            window: None,
            lens: Some(Lens {
                radius: radius / 1000.0,
                focus_distance: distance,
                aperture,
                anamorphic: 1.0,
            }),
        })
    }

    fn film(&mut self, setting: &Setting) -> Result<FilmDesc, Issue> {
        let params = &setting.params;
        if !FILMS.contains(&setting.kind.as_str()) {
            let hint = legacy::hint("film", &setting.kind, &FILMS);
            return params.fail(format!("unknown film {:?}{hint}", setting.kind));
        }
        if setting.kind != "rgb" {
            self.cx.warn(
                &params.place,
                format!("film {:?}: only its colour is rendered", setting.kind),
            );
            params.ignore(match setting.kind.as_str() {
                "gbuffer" => &["coordinatesystem"],
                _ => &["nbuckets", "lambdamin", "lambdamax"],
            });
        }
        params.ignore(&["filename", "savefp16"]);
        let side = 1..=crate::limits::MAX_SIDE;
        let width = params.count("xresolution", 1280, side.clone())?;
        let height = params.count("yresolution", 720, side)?;
        let iso = params.positive("iso", 100.0)?;
        let sensor = params.text("sensor", "cie1931")?;
        if sensor != "cie1931" {
            self.cx.warn(
                &params.place,
                format!(
                    "sensor {sensor:?}: the standard observer is used, colours differ a little"
                ),
            );
        }
        let mut balance = [1.0; 3];
        let white = params.float("whitebalance", 0.0)?;
        if white != 0.0 {
            let Some(hue) = color::daylight(white) else {
                return params.fail(format!(
                    "white balance for {white} K; 100 to 25000 K are possible"
                ));
            };
            balance = hue.map(|c| 1.0 / f64::from(c).max(0.01));
            self.cx.warn(
                &params.place,
                "white balance is done channel by channel: saturated colours differ a little",
            );
        }
        let max_component = params.float_opt("maxcomponentvalue")?.map(|v| v as f32);
        if max_component.is_some_and(|v| v <= 0.0) {
            return params.fail("maxcomponentvalue must be above zero");
        }

        let mut crop = None;
        if let Some(param) = params.find("pixelbounds", &[Kind::Integer])? {
            let &[x0, x1, y0, y1] = param.numbers() else {
                return param.fail("needs four integers");
            };
            crop = Some([x0, y0, x1, y1]);
        }
        if let Some(param) = params.floats("cropwindow")? {
            let &[x0, x1, y0, y1] = param.numbers() else {
                return param.fail("needs four numbers");
            };
            let pixel = |a: f64, size: u32| libm::ceil(f64::from(size) * a.clamp(0.0, 1.0));
            crop = Some([
                pixel(x0.min(x1), width),
                pixel(y0.min(y1), height),
                pixel(x0.max(x1), width),
                pixel(y0.max(y1), height),
            ]);
        }
        let crop = match crop {
            None => None,
            Some([x0, y0, x1, y1]) => {
                let clamp = |v: f64, size: u32| v.clamp(0.0, f64::from(size)) as u32;
                let crop = [
                    clamp(x0, width),
                    clamp(y0, height),
                    clamp(x1, width),
                    clamp(y1, height),
                ];
                if crop[0] >= crop[2] || crop[1] >= crop[3] {
                    return params.fail("the part of the film that is rendered is empty");
                }
                (crop != [0, 0, width, height]).then_some(crop)
            }
        };
        let filter = Filter::Gaussian {
            radius: (1.5, 1.5),
            sigma: 0.5,
        };
        Ok(FilmDesc {
            width,
            height,
            crop,
            filter,
            exposure: balance.map(|b| (iso / 100.0 * b) as f32),
            max_component,
        })
    }

    fn filter(&mut self, setting: &Setting) -> Result<Filter, Issue> {
        let params = &setting.params;
        let radius = |default: f64| -> Result<(f64, f64), Issue> {
            let radius = (
                params.positive("xradius", default)?,
                params.positive("yradius", default)?,
            );
            if radius.0 > 64.0 || radius.1 > 64.0 {
                return params.fail("a filter radius above 64 pixels");
            }
            Ok(radius)
        };
        Ok(match setting.kind.as_str() {
            "box" => Filter::Box {
                radius: radius(0.5)?,
            },
            "triangle" => Filter::Tent {
                radius: radius(2.0)?,
            },
            "gaussian" => Filter::Gaussian {
                radius: radius(1.5)?,
                sigma: params.positive("sigma", 0.5)?,
            },
            "mitchell" => Filter::Mitchell {
                radius: radius(2.0)?,
                b: params.float("B", 1.0 / 3.0)?,
                c: params.float("C", 1.0 / 3.0)?,
            },
            "sinc" => Filter::LanczosSinc {
                radius: radius(4.0)?,
                tau: params.positive("tau", 3.0)?,
            },
            other => {
                let hint = legacy::hint("filter", other, &FILTERS);
                return params.fail(format!("unknown pixel filter {other:?}{hint}"));
            }
        })
    }

    fn sampler(&mut self, setting: &Setting) -> Result<(SamplerKind, u32), Issue> {
        let params = &setting.params;
        params.ignore(&["seed", "randomization"]);
        Ok(match setting.kind.as_str() {
            "independent" => (
                SamplerKind::Independent,
                params.count("pixelsamples", 4, 1..=MAX_SPP)?,
            ),
            "stratified" => {
                if !params.bool("jitter", true)? {
                    self.cx.warn(
                        &params.place,
                        "\"jitter\" false is not supported: samples are jittered",
                    );
                }
                let x = params.count("xsamples", 4, 1..=4096)?;
                let y = params.count("ysamples", 4, 1..=4096)?;
                (SamplerKind::Stratified, x * y)
            }
            kind if SAMPLERS.contains(&kind) => (
                SamplerKind::default(),
                params.count("pixelsamples", 16, 1..=MAX_SPP)?,
            ),
            other => {
                let hint = legacy::hint("sampler", other, &SAMPLERS);
                return params.fail(format!("unknown sampler {other:?}{hint}"));
            }
        })
    }

    fn integrator(&mut self, setting: &Setting) -> Result<Integrator, Issue> {
        let params = &setting.params;
        let kind = setting.kind.as_str();
        if !INTEGRATORS.contains(&kind) {
            let hint = legacy::hint("integrator", kind, &INTEGRATORS);
            return params.fail(format!("unknown integrator {kind:?}{hint}"));
        }
        let max_depth = params.count("maxdepth", 5, 0..=MAX_DEPTH)?;
        match kind {
            "path" | "volpath" | "simplepath" | "simplevolpath" => {
                // How light is found is ours; these change the noise, not the picture.
                params.ignore(&["lightsampler", "samplelights", "samplebsdf", "sampleBSDF"]);
                if params.bool("regularize", false)? {
                    self.cx.warn(&params.place, "\"regularize\" is not supported: the picture is not blurred for less noise");
                }
            }
            _ => {
                self.cx.warn(
                    &params.place,
                    format!("integrator {kind:?} is not supported: the path tracer stands in"),
                );
                params.ignore(match kind {
                    "bdpt" => &["regularize", "visualizestrategies", "visualizeweights"],
                    "mlt" => &[
                        "bootstrapsamples",
                        "chains",
                        "mutationsperpixel",
                        "largestepprobability",
                        "sigma",
                    ],
                    "sppm" => &["photonsperiteration", "radius", "seed", "regularize"],
                    "ambientocclusion" => &["cossample", "maxdistance"],
                    "function" => &["function", "filename", "skipbad"],
                    _ => &[],
                });
            }
        }
        Ok(Integrator::Path { max_depth })
    }
}

fn default_film() -> FilmDesc {
    let filter = Filter::Gaussian {
        radius: (1.5, 1.5),
        sigma: 0.5,
    };
    FilmDesc {
        width: 1280,
        height: 720,
        crop: None,
        filter,
        exposure: [1.0; 3],
        max_component: None,
    }
}

fn default_camera() -> Camera {
    Camera {
        transform: Motion::identity(),
        projection: Projection::Perspective {
            fov: 90.0,
            fov_axis: FovAxis::Shorter,
            window: None,
            lens: None,
        },
        shutter: (0.0, 1.0),
        shutter_curve: ShutterCurve::Box,
        medium: None,
    }
}
