//! Cameras: from a point of the picture, a point of the lens and a moment to a ray.

pub mod filter;

use crate::geometry::transform::Placement;
use crate::math;
use crate::ray::Ray;
use crate::sampling::{self, RegularPolygon};
use glam::{Vec2, Vec3};
use scene::model::{self, Aperture, FovAxis, Projection, ShutterCurve, SphereMapping};

/// A camera ready for use.
pub struct Camera {
    placement: Placement,
    kind: Kind,
    /// Picture (0 to 1, y down) to the plane at distance 1, or to scene units: (x, y) = a + b uv.
    origin: Vec2,
    extent: Vec2,
    lens: Option<Lens>,
    /// Opening and closing.
    pub shutter: (f32, f32),
    curve: ShutterCurve,
}

enum Kind {
    Perspective,
    Orthographic,
    Spherical(SphereMapping),
}

struct Lens {
    radius: f32,
    focus: f32,
    polygon: Option<RegularPolygon>,
    squeeze: f32,
}

impl Camera {
    /// `size` is the full picture in pixels, before any crop; `open_at` is added to the shutter's times.
    pub fn new(desc: &model::Camera, size: [u32; 2], open_at: f64) -> Camera {
        let aspect = size[0] as f64 / size[1] as f64;
        let (kind, window, lens) = match &desc.projection {
            Projection::Perspective {
                fov,
                fov_axis,
                window,
                lens,
            } => {
                let tan = libm::tan(fov.to_radians() * 0.5);
                let (sx, sy) = match window {
                    Some(w) => ((w.x.0 * tan, w.x.1 * tan), (w.y.0 * tan, w.y.1 * tan)),
                    None => {
                        let horizontal = match fov_axis {
                            FovAxis::Horizontal => true,
                            FovAxis::Vertical => false,
                            FovAxis::Shorter => aspect < 1.0,
                        };
                        let (hx, hy) = if horizontal {
                            (tan, tan / aspect)
                        } else {
                            (tan * aspect, tan)
                        };
                        ((-hx, hx), (-hy, hy))
                    }
                };
                (Kind::Perspective, (sx, sy), lens)
            }
            Projection::Orthographic {
                half_height,
                window,
                lens,
            } => {
                let (sx, sy) = match window {
                    Some(w) => (w.x, w.y),
                    None => (
                        (-half_height * aspect, half_height * aspect),
                        (-*half_height, *half_height),
                    ),
                };
                (Kind::Orthographic, (sx, sy), lens)
            }
            Projection::Spherical { mapping } => {
                (Kind::Spherical(*mapping), ((0.0, 1.0), (0.0, 1.0)), &None)
            }
        };
        let (sx, sy) = window;
        Camera {
            placement: Placement::new(&[&desc.transform]),
            kind,
            origin: Vec2::new(sx.0 as f32, sy.1 as f32),
            extent: Vec2::new((sx.1 - sx.0) as f32, (sy.0 - sy.1) as f32),
            lens: lens.as_ref().filter(|l| l.radius > 0.0).map(|l| Lens {
                radius: l.radius as f32,
                focus: l.focus_distance as f32,
                polygon: match l.aperture {
                    Aperture::Disk => None,
                    Aperture::Blades { count, rotation } => {
                        Some(RegularPolygon::new(count, rotation as f32))
                    }
                },
                squeeze: (1.0 / l.anamorphic) as f32,
            }),
            shutter: (
                (desc.shutter.0 + open_at) as f32,
                (desc.shutter.1 + open_at) as f32,
            ),
            curve: desc.shutter_curve.clone(),
        }
    }

    /// A moment, distributed as the shutter lets light through.
    #[inline]
    pub fn time(&self, u: f32) -> f32 {
        let x = match self.curve {
            ShutterCurve::Box => u,
            ShutterCurve::Trapezoid { open, close } => trapezoid(u, open as f32, close as f32),
        };
        self.shutter.0 + (self.shutter.1 - self.shutter.0) * x
    }

    /// The ray through a point of the picture (0 to 1, from the top left). `lens` is uniform in the
    /// unit square; `None` is the centre of the lens.
    #[inline]
    pub fn ray(&self, at: Vec2, lens: Option<Vec2>, time: f32) -> Ray {
        let film = self.origin + self.extent * at;
        let (mut o, mut d) = match self.kind {
            Kind::Perspective => (Vec3::ZERO, Vec3::new(film.x, film.y, -1.0)),
            Kind::Orthographic => (Vec3::new(film.x, film.y, 0.0), Vec3::new(0.0, 0.0, -1.0)),
            Kind::Spherical(mapping) => (Vec3::ZERO, spherical(mapping, at)),
        };
        if let (Some(l), Some(u)) = (&self.lens, lens) {
            // All rays through the lens that belong to a point of the picture meet where the ray
            // through its centre crosses the plane in focus.
            let focus = o + d * l.focus;
            let p = match &l.polygon {
                None => sampling::uniform_disk_concentric(u),
                Some(polygon) => polygon.sample(u),
            } * l.radius;
            o += Vec3::new(p.x * l.squeeze, p.y, 0.0);
            d = focus - o;
        }
        let (to, _) = self.placement.at(time);
        Ray::new(to.point(o), math::normalize(to.vector(d)), time)
    }

    /// Solid angle that a pixel covers at the centre of the picture, roughly; for ray footprints.
    pub fn pixel_spread(&self, height: u32) -> f32 {
        self.extent.y.abs() / height as f32
    }
}

/// Direction of a picture of the whole sphere, in camera space: the centre looks along -Z.
fn spherical(mapping: SphereMapping, at: Vec2) -> Vec3 {
    match mapping {
        SphereMapping::LatLong => {
            let (sin_theta, cos_theta) = math::sin_cos_2pi((at.y * 0.5).min(0.499_999_97));
            let (sin_phi, cos_phi) = math::sin_cos_2pi(at.x - at.x.floor());
            Vec3::new(-sin_theta * sin_phi, cos_theta, sin_theta * cos_phi)
        }
        SphereMapping::OctahedralEqualArea => {
            let w = crate::light::octahedral::to_sphere(at);
            Vec3::new(w.x, w.z, -w.y)
        }
    }
}

/// Inverse of the distribution of a trapezoid over [0, 1] that rises over the first `open` and falls
/// over the last `close`.
fn trapezoid(u: f32, open: f32, close: f32) -> f32 {
    let area = 1.0 - 0.5 * (open + close);
    let a = u * area;
    if a < 0.5 * open {
        (2.0 * a * open).sqrt()
    } else if a > area - 0.5 * close {
        1.0 - math::safe_sqrt(2.0 * (area - a) * close)
    } else {
        a + 0.5 * open
    }
}
