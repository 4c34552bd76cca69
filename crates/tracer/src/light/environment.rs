//! Light from all around: a constant, or a picture.
//!
//! Directions are drawn where the light is brighter than its mean, in proportion to the excess, and
//! scattering alone finds the rest [Karlik19]: under multiple importance sampling a density that
//! covers what the other strategy does well anyway is wasted. A constant sky is not sampled at all.

use super::octahedral;
use super::portal::Portal;
use crate::geometry::transform::Affine;
use crate::math::{self, Rgb};
use crate::sampling::Piecewise2d;
use crate::texture::image::{self, Image};
use glam::{Vec2, Vec3};
use scene::model::{SphereMapping, Wrap};

/// An environment ready for use.
pub struct Environment {
    /// Light to world (a rotation, perhaps mirrored).
    to_world: Affine,
    from_world: Affine,
    /// Radiance, or factor on the picture.
    radiance: Rgb,
    picture: Option<Picture>,
    /// The rectangle that it comes in through; none is everywhere.
    portal: Option<Portal>,
    /// Alpha is 0 where it is seen directly.
    pub hidden: bool,
}

struct Picture {
    image: usize,
    mapping: SphereMapping,
    /// None where no pixel exceeds the mean.
    distribution: Option<Piecewise2d>,
    mean: Rgb,
}

impl Environment {
    /// Tabulates the picture's brightness.
    pub fn new(
        transform: &glam::DAffine3,
        radiance: Rgb,
        image: Option<(usize, SphereMapping)>,
        images: &[Image],
        hidden: bool,
        illuminance: Option<f32>,
        portal: Option<&[glam::DVec3; 4]>,
    ) -> Environment {
        let linear = glam::DAffine3 {
            matrix3: transform.matrix3,
            translation: glam::DVec3::ZERO,
        };
        let mut radiance = radiance;
        if let (Some(wanted), Some((index, mapping))) = (illuminance, image) {
            let has = received(&images[index], mapping);
            radiance *= if has > 0.0 {
                (f64::from(wanted) / has) as f32
            } else {
                0.0
            };
        }
        let picture = image.map(|(index, mapping)| {
            let picture = &images[index];
            let (w, h) = (picture.width as usize, picture.height as usize);
            let mut values = Vec::with_capacity(w * h);
            let mut mean = [0.0f64; 3];
            let (mut total, mut bright) = (0.0f64, 0.0f64);
            let mut areas = Vec::with_capacity(h);
            for y in 0..h {
                // Solid angle of a row's pixels.
                let area = match mapping {
                    SphereMapping::LatLong => {
                        libm::sin(std::f64::consts::PI * (y as f64 + 0.5) / h as f64)
                    }
                    SphereMapping::OctahedralEqualArea => 1.0,
                };
                areas.push(area);
                for x in 0..w {
                    // What a lookup in the pixel can return: for filtered pictures its neighbours too.
                    let texel = match mapping {
                        SphereMapping::OctahedralEqualArea => rgb(picture.texel(x, y)),
                        SphereMapping::LatLong => {
                            let at = |dx: i64, dy: i64| {
                                let i = (x as i64 + dx).rem_euclid(w as i64) as usize;
                                let j = (y as i64 + dy).clamp(0, h as i64 - 1) as usize;
                                rgb(picture.texel(i, j))
                            };
                            at(0, 0) * 0.5 + (at(-1, 0) + at(1, 0) + at(0, -1) + at(0, 1)) * 0.125
                        }
                    };
                    let value = (texel * radiance).max_element().max(0.0);
                    values.push(value);
                    bright += value as f64 * area;
                    for (sum, c) in mean.iter_mut().zip(texel.to_array()) {
                        *sum += c as f64 * area;
                    }
                    total += area;
                }
            }
            let mean = Rgb::from_array(mean.map(|c| (c / total) as f32));
            let level = bright / total;
            let mut excess = 0.0;
            for (row, area) in values.chunks_exact_mut(w).zip(areas) {
                for value in row {
                    let more = (*value as f64 - level).max(0.0) * area;
                    excess += more;
                    *value = more as f32;
                }
            }
            // Less than rounding leaves: the picture is one colour.
            let distribution = (excess > 1e-4 * bright).then(|| Piecewise2d::new(&values, w, h));
            Picture {
                image: index,
                mapping,
                distribution,
                mean,
            }
        });
        let mut environment = Environment {
            to_world: Affine::new(&linear),
            from_world: Affine::new(&linear.inverse()),
            radiance,
            picture,
            portal: None,
            hidden,
        };
        environment.portal = portal.map(|corners| {
            let side = image.map_or(1, |(index, _)| {
                images[index].width.max(images[index].height)
            });
            Portal::new(corners, side, |w| environment.everywhere(images, w))
        });
        environment
    }

    /// Mean radiance over the sphere.
    pub fn mean(&self) -> Rgb {
        self.picture
            .as_ref()
            .map_or(self.radiance, |p| p.mean * self.radiance)
    }

    /// The radiance of all directions, if it is the same and the sky is seen.
    pub(crate) fn constant(&self) -> Option<Rgb> {
        let is_plain = self.picture.is_none() && self.portal.is_none() && !self.hidden;
        is_plain.then_some(self.radiance)
    }

    /// Radiance that arrives at a point from a direction.
    #[inline]
    pub fn le(&self, images: &[Image], from: Vec3, direction: Vec3) -> Rgb {
        match &self.portal {
            Some(portal) if !portal.shows(from, direction) => Rgb::ZERO,
            _ => self.everywhere(images, direction),
        }
    }

    /// Radiance from a direction, portal or not.
    fn everywhere(&self, images: &[Image], direction: Vec3) -> Rgb {
        let Some(picture) = &self.picture else {
            return self.radiance;
        };
        let w = math::normalize(self.from_world.vector(direction));
        let uv = square(picture.mapping, w);
        self.radiance * look(&images[picture.image], picture.mapping, uv)
    }

    /// Whether directions are drawn from it: not where it is the same all around.
    pub fn is_sampled(&self) -> bool {
        self.portal.is_some()
            || self
                .picture
                .as_ref()
                .is_some_and(|p| p.distribution.is_some())
    }

    /// A direction that light may come from to a point, the radiance from there and its density per
    /// solid angle.
    #[inline]
    pub fn sample(&self, images: &[Image], from: Vec3, u: Vec2) -> Option<(Vec3, Rgb, f32)> {
        if let Some(portal) = &self.portal {
            let (w, pdf) = portal.sample(from, u)?;
            return Some((w, self.everywhere(images, w), pdf));
        }
        let picture = self.picture.as_ref()?;
        let (uv, pdf) = picture.distribution.as_ref()?.sample(u);
        let (w, jacobian) = match picture.mapping {
            SphereMapping::OctahedralEqualArea => (octahedral::to_sphere(uv), 0.25 / math::PI),
            SphereMapping::LatLong => {
                let (sin_theta, cos_theta) = math::sin_cos_2pi((uv.y * 0.5).min(0.499_999_97));
                // u = .5 + atan2(z, x) / 2 pi.
                let (s, c) = math::sin_cos_2pi(uv.x - uv.x.floor());
                (
                    Vec3::new(-c * sin_theta, cos_theta, -s * sin_theta),
                    latlong_jacobian(sin_theta),
                )
            }
        };
        let pdf = pdf * jacobian;
        if !(pdf > 0.0 && pdf < f32::INFINITY) {
            return None;
        }
        let radiance = self.radiance * look(&images[picture.image], picture.mapping, uv);
        Some((math::normalize(self.to_world.vector(w)), radiance, pdf))
    }

    /// Density of [`Environment::sample`] per solid angle.
    #[inline]
    pub fn pdf(&self, from: Vec3, direction: Vec3) -> f32 {
        if let Some(portal) = &self.portal {
            return portal.pdf(from, direction);
        }
        let Some(picture) = &self.picture else {
            return 0.0;
        };
        let Some(distribution) = &picture.distribution else {
            return 0.0;
        };
        let w = math::normalize(self.from_world.vector(direction));
        let uv = square(picture.mapping, w);
        let jacobian = match picture.mapping {
            SphereMapping::OctahedralEqualArea => 0.25 / math::PI,
            SphereMapping::LatLong => latlong_jacobian(math::safe_sqrt(1.0 - w.y * w.y)),
        };
        let pdf = distribution.pdf(uv) * jacobian;
        if pdf < f32::INFINITY { pdf } else { 0.0 }
    }
}

fn latlong_jacobian(sin_theta: f32) -> f32 {
    1.0 / (2.0 * math::PI * math::PI * sin_theta)
}

fn rgb(t: [f32; 4]) -> Rgb {
    Rgb::new(t[0], t[1], t[2])
}

/// Picture coordinates of a direction in light space, y from the top row.
fn square(mapping: SphereMapping, w: Vec3) -> Vec2 {
    match mapping {
        SphereMapping::OctahedralEqualArea => octahedral::to_square(w),
        SphereMapping::LatLong => Vec2::new(
            0.5 + math::atan2(w.z, w.x) * (0.5 / math::PI),
            math::acos(w.y.clamp(-1.0, 1.0)) / math::PI,
        ),
    }
}

/// Octahedral pictures are not filtered (as in pbrt); lat-long ones are, across the seam too.
fn look(image: &Image, mapping: SphereMapping, uv: Vec2) -> Rgb {
    match mapping {
        SphereMapping::OctahedralEqualArea => {
            let x = ((uv.x * image.width as f32) as usize).min(image.width as usize - 1);
            let y = ((uv.y * image.height as f32) as usize).min(image.height as usize - 1);
            rgb(image.texel(x, y))
        }
        SphereMapping::LatLong => rgb(image.lookup(
            Vec2::new(uv.x, 1.0 - uv.y),
            (Wrap::Repeat, Wrap::Clamp),
            false,
        )),
    }
}

/// Luminance that a surface facing +Z of light space receives, as pbrt-v4 sums it: each pixel counts
/// with half of its solid angle.
fn received(picture: &Image, mapping: SphereMapping) -> f64 {
    let (w, h) = (picture.width as usize, picture.height as usize);
    let mut sum = 0.0;
    for y in 0..h {
        for x in 0..w {
            let uv = Vec2::new((x as f32 + 0.5) / w as f32, (y as f32 + 0.5) / h as f32);
            let (cos, area) = match mapping {
                SphereMapping::OctahedralEqualArea => (octahedral::to_sphere(uv).z as f64, 1.0),
                SphereMapping::LatLong => {
                    let theta = std::f64::consts::PI * uv.y as f64;
                    let phi = std::f64::consts::TAU * (uv.x as f64 - 0.5);
                    let sin = libm::sin(theta);
                    (sin * libm::sin(phi), sin * std::f64::consts::FRAC_PI_2)
                }
            };
            if cos > 0.0 {
                sum += image::luminance(picture.texel(x, y)) * cos * area;
            }
        }
    }
    sum * std::f64::consts::TAU / (w * h) as f64
}
