//! Points that throw a picture: by direction (goniometric) or through a frame (projection). Pixels are
//! not filtered, as in pbrt-v4: neighbouring ones may differ by orders of magnitude.

use super::octahedral;
use crate::geometry::transform::Affine;
use crate::math::{self, Rgb};
use crate::texture::image::{self, Image};
use glam::{DAffine3, Vec2, Vec3};

/// A point whose intensity depends on the direction.
pub struct Goniometric {
    /// Position.
    pub p: Vec3,
    from_world: Affine,
    intensity: Rgb,
    image: usize,
}

/// A point that throws a picture along +Z of light space.
pub struct Projection {
    /// Position.
    pub p: Vec3,
    from_world: Affine,
    intensity: Rgb,
    image: usize,
    /// Half width and height of the picture at distance 1.
    half: Vec2,
    axis: Vec3,
}

/// Mean of the three channels of a texel.
fn mean(t: [f32; 4]) -> f32 {
    (t[0] + t[1] + t[2]) * (1.0 / 3.0)
}

fn position(transform: &DAffine3) -> Vec3 {
    let t = transform.translation;
    Vec3::new(t.x as f32, t.y as f32, t.z as f32)
}

/// Only the directions.
fn linear(transform: &DAffine3) -> Affine {
    Affine::new(&DAffine3 {
        matrix3: transform.matrix3.inverse(),
        translation: glam::DVec3::ZERO,
    })
}

/// The pixel at a place of the unit square, y from the top.
fn nearest(picture: &Image, uv: Vec2) -> [f32; 4] {
    let cell = |x: f32, n: u32| ((x * n as f32) as usize).min(n as usize - 1);
    picture.texel(cell(uv.x, picture.width), cell(uv.y, picture.height))
}

/// Sum over all pixels of a picture, in double precision, row by row.
fn sum(picture: &Image, f: impl Fn(usize, usize, [f32; 4]) -> f64) -> f64 {
    let (w, h) = (picture.width as usize, picture.height as usize);
    let mut total = 0.0;
    for y in 0..h {
        for x in 0..w {
            total += f(x, y, picture.texel(x, y));
        }
    }
    total
}

/// Factor that brings `has` to what is wanted.
fn factor(wanted: Option<f32>, has: f64) -> f32 {
    match wanted {
        None => 1.0,
        Some(_) if has <= 0.0 => 0.0,
        Some(wanted) => (f64::from(wanted) / has) as f32,
    }
}

impl Goniometric {
    /// `image` is square and equal-area octahedral.
    pub fn new(
        transform: &DAffine3,
        intensity: Rgb,
        image: usize,
        power: Option<f32>,
        images: &[Image],
    ) -> Goniometric {
        let picture = &images[image];
        let pixels = picture.width as f64 * picture.height as f64;
        let total = sum(picture, |_, _, t| mean(t) as f64) / pixels;
        Goniometric {
            p: position(transform),
            from_world: linear(transform),
            intensity: intensity * factor(power, 4.0 * std::f64::consts::PI * total),
            image,
        }
    }

    /// Power per solid angle in a direction of the world.
    pub fn intensity(&self, images: &[Image], direction: Vec3) -> Rgb {
        let w = math::normalize(self.from_world.vector(direction));
        // y and z are swapped before the picture is looked up.
        let uv = octahedral::to_square(Vec3::new(w.x, w.z, w.y));
        self.intensity * mean(nearest(&images[self.image], uv)).max(0.0)
    }

    /// Largest power per solid angle.
    pub fn strongest(&self, images: &[Image]) -> Rgb {
        self.intensity * largest(&images[self.image], mean)
    }
}

/// Largest value of anything about a pixel, at least 0.
fn largest(picture: &Image, f: impl Fn([f32; 4]) -> f32) -> f32 {
    let (w, h) = (picture.width as usize, picture.height as usize);
    let all = (0..h).flat_map(|y| (0..w).map(move |x| (x, y)));
    all.fold(0.0, |most: f32, (x, y)| most.max(f(picture.texel(x, y))))
}

impl Projection {
    /// `fov` is in degrees, over the shorter side.
    pub fn new(
        transform: &DAffine3,
        intensity: Rgb,
        image: usize,
        fov: f64,
        power: Option<f32>,
        images: &[Image],
    ) -> Projection {
        let picture = &images[image];
        let (w, h) = (picture.width as f64, picture.height as f64);
        let tan = libm::tan(0.5 * fov.to_radians());
        let half = (tan * (w / h).max(1.0), tan * (h / w).max(1.0));
        // Solid angle of a pixel: its area at distance 1 by the cube of the cosine.
        let area = 4.0 * half.0 * half.1 / (w * h);
        let total = sum(picture, |x, y, t| {
            let px = half.0 * (2.0 * (x as f64 + 0.5) / w - 1.0);
            let py = half.1 * (2.0 * (y as f64 + 0.5) / h - 1.0);
            let distance2 = 1.0 + px * px + py * py;
            image::luminance(t) * area / (distance2 * libm::sqrt(distance2))
        });
        let z = transform.matrix3.z_axis;
        Projection {
            p: position(transform),
            from_world: linear(transform),
            intensity: intensity * factor(power, total),
            image,
            half: Vec2::new(half.0 as f32, half.1 as f32),
            axis: math::normalize(Vec3::new(z.x as f32, z.y as f32, z.z as f32)),
        }
    }

    /// Power per solid angle in a direction of the world.
    pub fn intensity(&self, images: &[Image], direction: Vec3) -> Rgb {
        let w = self.from_world.vector(direction);
        if w.z <= 0.0 {
            return Rgb::ZERO;
        }
        let at = Vec2::new(w.x, w.y) / (self.half * w.z);
        if !(at.x.abs() <= 1.0 && at.y.abs() <= 1.0) {
            return Rgb::ZERO;
        }
        let uv = Vec2::new(0.5 * (at.x + 1.0), 0.5 * (1.0 - at.y));
        let [r, g, b, _] = nearest(&images[self.image], uv);
        self.intensity * Rgb::new(r, g, b).max(Rgb::ZERO)
    }

    /// Where the picture is thrown.
    pub fn axis(&self) -> Vec3 {
        self.axis
    }

    /// Cosine of the angle from the axis to a corner.
    pub fn cos_corner(&self) -> f32 {
        1.0 / (1.0 + self.half.dot(self.half)).sqrt()
    }

    /// Largest power per solid angle.
    pub fn strongest(&self, images: &[Image]) -> Rgb {
        let most = |t: [f32; 4]| t[0].max(t[1]).max(t[2]);
        self.intensity * largest(&images[self.image], most)
    }
}
