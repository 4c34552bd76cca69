//! Cameras: from a point of the picture, a point of the lens and a moment to a ray.

pub mod filter;

use crate::geometry::Interaction;
use crate::geometry::transform::Placement;
use crate::lanes::{Float, V3, Wide};
use crate::math;
use crate::ray::Ray;
use crate::sampling::{self, RegularPolygon};
use crate::texture::Footprint;
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

/// Share of a pixel that a texture is averaged over: the rest is done by samples, which lie all over the
/// pixel filter. pbrt-v4 takes 1 / sqrt(spp) but not less than this; it cannot depend on the number of
/// samples here, as a picture may be extended.
const FOOTPRINT: f32 = 0.125;

/// How much of a surface a pixel covers, as a cone from the eye: exact enough for what is seen
/// directly, and for what is seen after bounces what it would be if it were seen directly (as pbrt-v4
/// takes it): no path has to remember its width, and nothing is blurred that a mirror shows close up.
#[derive(Clone, Copy, Debug)]
pub struct PixelView {
    eye: Vec3,
    /// Width per distance.
    spread: f32,
    /// Width anywhere.
    width: f32,
}

impl PixelView {
    /// Fills in the footprint of a point that a ray hit. The cone cuts the surface in an ellipse.
    pub fn cover(&self, it: &mut Interaction, ray: &Ray) {
        let radius = self.width + self.spread * math::length(it.p - self.eye);
        let d = math::normalize(ray.direction);
        let cos = d.dot(it.ng);
        // A grazing view covers any length: cut it where filters stop following.
        let cos = if cos.abs() < GRAZING {
            GRAZING.copysign(cos)
        } else {
            cos
        };
        let (a, b) = math::coordinate_system(d);
        let on_surface = |v: Vec3| (v - d * (v.dot(it.ng) / cos)) * radius;
        let dp = [on_surface(a), on_surface(b)];
        // Least squares: the offset of the texture coordinates that moves the point by dp.
        let (u, v) = (it.dpdu, it.dpdv);
        let (uu, uv, vv) = (u.dot(u), u.dot(v), v.dot(v));
        let det = uu * vv - uv * uv;
        let duv = dp.map(|p| {
            let (pu, pv) = (p.dot(u), p.dot(v));
            let inv = 1.0 / det;
            let at = Vec2::new((vv * pu - uv * pv) * inv, (uu * pv - uv * pu) * inv);
            if at.is_finite() { at } else { Vec2::ZERO }
        });
        it.point.footprint = Footprint { dp, duv };
    }
}

/// Smallest cosine that footprints grow by.
const GRAZING: f32 = 0.02;

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

    /// Whether [`Camera::ray_in_lanes`] can be used.
    pub(crate) fn suits_lanes(&self) -> bool {
        let is_flat = !matches!(self.kind, Kind::Spherical(_));
        let is_round = self.lens.as_ref().is_none_or(|l| l.polygon.is_none());
        let is_fixed = matches!(self.placement, Placement::Fixed(..));
        is_flat && is_round && is_fixed && matches!(self.curve, ShutterCurve::Box)
    }

    /// [`Camera::time`] and [`Camera::ray`] for a point of the picture in each lane: origins, directions, times.
    #[inline(always)]
    pub(crate) fn ray_in_lanes<W: Wide<N>, const N: usize>(
        &self,
        at: [W::F; 2],
        lens: [W::F; 2],
        moment: W::F,
    ) -> (V3<W, N>, V3<W, N>, W::F) {
        let (zero, minus) = (W::F::splat(0.0), W::F::splat(-1.0));
        let (open, close) = self.shutter;
        let time = W::F::splat(open) + W::F::splat(close - open) * moment;
        let x = W::F::splat(self.origin.x) + W::F::splat(self.extent.x) * at[0];
        let y = W::F::splat(self.origin.y) + W::F::splat(self.extent.y) * at[1];
        let (mut o, mut d) = match self.kind {
            Kind::Orthographic => (
                V3::<W, N>::new(x, y, zero),
                V3::<W, N>::new(zero, zero, minus),
            ),
            _ => (
                V3::<W, N>::new(zero, zero, zero),
                V3::<W, N>::new(x, y, minus),
            ),
        };
        if let Some(l) = &self.lens {
            let focus = o + d * W::F::splat(l.focus);
            let (px, py, _) = sampling::lanes::concentric::<W, N>(lens[0], lens[1]);
            let radius = W::F::splat(l.radius);
            o = o + V3::<W, N>::new(px * radius * W::F::splat(l.squeeze), py * radius, zero);
            d = focus - o;
        }
        let (to, _) = self.placement.at(open);
        let [m0, m1, m2] = [
            V3::<W, N>::splat(to.m[0]),
            V3::<W, N>::splat(to.m[1]),
            V3::<W, N>::splat(to.m[2]),
        ];
        let origin = m0 * o.x + m1 * o.y + m2 * o.z + V3::<W, N>::splat(to.t);
        let direction = m0 * d.x + m1 * d.y + m2 * d.z;
        (origin, direction.normalized(), time)
    }

    /// How large pixels are on what they show, for a picture of `size` pixels.
    pub fn pixel_view(&self, size: [u32; 2]) -> PixelView {
        let (to, _) = self.placement.at(self.shutter.0);
        // A pixel at distance 1 along the longer of its sides (or in the scene, without perspective).
        let side = |extent: f32, pixels: u32| extent.abs() / pixels as f32;
        let pixel = side(self.extent.x, size[0]).max(side(self.extent.y, size[1]));
        let (spread, width) = match self.kind {
            Kind::Perspective => (pixel, 0.0),
            Kind::Orthographic => (0.0, pixel),
            Kind::Spherical(_) => (math::PI / size[1] as f32, 0.0),
        };
        PixelView {
            eye: to.point(Vec3::ZERO),
            spread: spread * FOOTPRINT,
            width: width * FOOTPRINT,
        }
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
