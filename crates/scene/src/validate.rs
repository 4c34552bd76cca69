//! Everything that can be wrong with a scene whatever it was read from, in one pass: all problems,
//! not the first.

mod geometry;
mod materials;
mod media;
mod placement;

use crate::context::Context;
use crate::diagnostic::{Diagnostic, Place, Severity};
use crate::limits::{MAX_DEPTH, MAX_PIXELS, MAX_SIDE, MAX_SPP};
use crate::model::{
    Camera, FilmDesc, Filter, Integrator, Lens, Motion, Projection, SceneDesc, Shape,
};
use glam::DAffine3;

/// Findings of one pass.
struct Findings(Vec<Diagnostic>);

impl Findings {
    fn error(&mut self, reason: impl Into<String>) {
        self.0.push(Diagnostic {
            severity: Severity::Error,
            place: Place::default(),
            reason: reason.into(),
        });
    }
    fn warn(&mut self, reason: impl Into<String>) {
        self.0.push(Diagnostic {
            severity: Severity::Warning,
            place: Place::default(),
            reason: reason.into(),
        });
    }
    fn check(&mut self, fine: bool, reason: impl FnOnce() -> String) {
        if !fine {
            self.error(reason());
        }
    }

    /// A transform that can be inverted, at times that rise.
    fn motion(&mut self, what: &str, motion: &Motion) {
        self.check(!motion.keys.is_empty(), || {
            format!("{what}: a motion without keys")
        });
        for key in &motion.keys {
            self.check(key.time.is_finite(), || {
                format!("{what}: a key at a time that is not finite")
            });
            self.transform(what, &key.transform);
        }
        let rising = motion
            .keys
            .windows(2)
            .all(|pair| pair[0].time < pair[1].time);
        self.check(rising, || {
            format!("{what}: the times of its keys do not rise")
        });
    }

    fn transform(&mut self, what: &str, transform: &DAffine3) {
        let finite = transform.is_finite();
        self.check(finite, || {
            format!("{what}: a transform with numbers that are not finite")
        });
        let singular = finite && {
            let m = transform.matrix3;
            let volume = m.x_axis.length() * m.y_axis.length() * m.z_axis.length();
            libm::fabs(m.determinant()) <= volume * 1e-12 || !transform.inverse().is_finite()
        };
        self.check(!singular, || {
            format!("{what}: a singular transform: it flattens what it places")
        });
    }
}

/// All problems of a scene. Places are empty: a finished scene no longer knows its lines.
pub fn validate(desc: &SceneDesc) -> Vec<Diagnostic> {
    let mut found = Findings(Vec::new());
    camera(&desc.camera, &mut found);
    film(&desc.film, &mut found);
    settings(desc, &mut found);
    geometry::meshes(desc, &mut found);
    materials::check(desc, &mut found);
    media::check(desc, &mut found);
    placement::check(desc, &mut found);
    found.0
}

fn camera(camera: &Camera, found: &mut Findings) {
    found.motion("camera", &camera.transform);
    let (open, close) = camera.shutter;
    found.check(
        open.is_finite() && close.is_finite() && open <= close,
        || format!("camera: a shutter that opens at {open} and closes at {close}"),
    );
    if let crate::model::ShutterCurve::Trapezoid { open, close } = camera.shutter_curve {
        found.check(open >= 0.0 && close >= 0.0 && open + close <= 1.0, || {
            format!("camera: a shutter curve that opens over {open} and closes over {close} of its interval")
        });
    }
    let (window, lens) = match &camera.projection {
        Projection::Perspective {
            fov, window, lens, ..
        } => {
            found.check(*fov > 0.0 && *fov < 180.0, || {
                format!("camera: a field of view of {fov} degrees")
            });
            (window, lens)
        }
        Projection::Orthographic {
            half_height,
            window,
            lens,
        } => {
            found.check(*half_height > 0.0 && half_height.is_finite(), || {
                format!("camera: an orthographic view of half height {half_height}")
            });
            (window, lens)
        }
        Projection::Spherical { .. } => return,
    };
    if let Some(window) = window {
        let fine = |(a, b): (f64, f64)| a.is_finite() && b.is_finite() && a != b;
        found.check(fine(window.x) && fine(window.y), || {
            "camera: an empty screen window".into()
        });
    }
    if let Some(Lens {
        radius,
        focus_distance,
        aperture,
        anamorphic,
    }) = lens
    {
        let fine = |x: f64| x > 0.0 && x.is_finite();
        found.check(fine(*radius) && fine(*focus_distance) && fine(*anamorphic), || {
            format!("camera: a lens of radius {radius}, focus distance {focus_distance}, squeeze {anamorphic}")
        });
        if let crate::model::Aperture::Blades { count, rotation } = aperture {
            found.check((3..=1000).contains(count) && rotation.is_finite(), || {
                format!("camera: an aperture of {count} blades")
            });
        }
    }
}

fn film(film: &FilmDesc, found: &mut Findings) {
    let FilmDesc {
        width,
        height,
        crop,
        filter,
        exposure,
        max_component,
    } = film;
    let (w, h) = (*width, *height);
    found.check(w > 0 && h > 0 && w <= MAX_SIDE && h <= MAX_SIDE, || {
        format!("a picture of {w} x {h} pixels; a side is 1 to {MAX_SIDE}")
    });
    found.check(u64::from(w) * u64::from(h) <= MAX_PIXELS, || {
        format!("a picture of {w} x {h} pixels; the limit is {MAX_PIXELS} in all")
    });
    if let Some([x0, y0, x1, y1]) = *crop {
        found.check(x0 < x1 && y0 < y1 && x1 <= w && y1 <= h, || {
            format!("a crop from ({x0}, {y0}) to ({x1}, {y1}) of a picture of {w} x {h} pixels")
        });
    }
    let fine = |x: f64| x > 0.0 && x <= 64.0;
    let (Filter::Box { radius }
    | Filter::Tent { radius }
    | Filter::Gaussian { radius, .. }
    | Filter::Mitchell { radius, .. }
    | Filter::BlackmanHarris { radius }
    | Filter::LanczosSinc { radius, .. }) = *filter;
    found.check(fine(radius.0) && fine(radius.1), || {
        format!(
            "a filter radius of {} x {}; it is above 0 and at most 64",
            radius.0, radius.1
        )
    });
    match *filter {
        Filter::Gaussian { sigma: x, .. } | Filter::LanczosSinc { tau: x, .. } => {
            found.check(x > 0.0 && x.is_finite(), || {
                format!("a filter parameter of {x}")
            });
        }
        Filter::Mitchell { b, c, .. } => {
            found.check(b.is_finite() && c.is_finite(), || {
                "a filter parameter that is not finite".into()
            });
        }
        _ => {}
    }
    found.check(exposure.iter().all(|e| *e >= 0.0 && e.is_finite()), || {
        format!("an exposure of {exposure:?}")
    });
    found.check(max_component.is_none_or(|m| m > 0.0), || {
        "a bound of zero on the brightness of samples".into()
    });
}

fn settings(desc: &SceneDesc, found: &mut Findings) {
    if let Some(spp) = desc.spp {
        found.check((1..=MAX_SPP).contains(&spp), || {
            format!("{spp} samples per pixel; 1 to {MAX_SPP} are possible")
        });
    }
    if let Integrator::Path { max_depth }
    | Integrator::Guided { max_depth }
    | Integrator::Direct { max_depth }
    | Integrator::Whitted { max_depth } = desc.integrator
    {
        found.check(max_depth <= MAX_DEPTH, || {
            format!("a depth of {max_depth}; the limit is {MAX_DEPTH}")
        });
    }
    if matches!(desc.integrator, Integrator::Guided { .. }) && !desc.media.is_empty() {
        found.warn(
            "paths are not guided inside media, and not at all where camera rays may meet one first",
        );
    }
    if let Some(animation) = &desc.animation {
        let (first, last) = animation.frames;
        let fine = animation.fps > 0.0 && animation.fps.is_finite() && animation.start.is_finite();
        found.check(fine && first <= last, || {
            format!(
                "an animation of frames {first} to {last} at {} a second",
                animation.fps
            )
        });
    }
}

/// Takes out triangles without area and says how many there were. Meshes that change shape keep
/// theirs, since they may have area at another time.
pub(crate) fn drop_degenerate(desc: &mut SceneDesc, cx: &mut Context<'_>) {
    let mut emptied = vec![false; desc.meshes.len()];
    for (mesh, emptied) in desc.meshes.iter_mut().zip(&mut emptied) {
        let dropped = geometry::drop_degenerate(mesh);
        if dropped > 0 {
            let place = Place {
                file: mesh.name.clone(),
                ..Place::default()
            };
            cx.warn(
                &place,
                format!("{dropped} triangles without area are left out"),
            );
            *emptied = mesh.indices.is_empty();
        }
    }
    if emptied.contains(&true) {
        let keep = |p: &crate::model::Primitive| match p.shape {
            Shape::Mesh(id) => !emptied.get(id.index()).copied().unwrap_or(false),
            _ => true,
        };
        desc.primitives.retain(keep);
        for group in &mut desc.groups {
            group.primitives.retain(keep);
        }
    }
}

#[cfg(test)]
mod tests;
