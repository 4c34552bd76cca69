//! Shining surfaces: triangles, parallelograms, spheres, disks. Spheres are sampled by solid angle
//! (the cone that they fill), the others by area.

use super::LightSample;
use super::tree::LightBounds;
use crate::accel::build::Bounds;
use crate::geometry::Interaction;
use crate::geometry::quadric::sphere_uv;
use crate::geometry::transform::Affine;
use crate::math::{self, Frame, Rgb};
use crate::sampling;
use crate::texture::{Point, Textures};
use glam::{Vec2, Vec3};
use scene::model::ColorTex;

/// What a surface gives off.
#[derive(Clone, Copy, Debug)]
pub struct Emission {
    /// Radiance.
    pub radiance: ColorTex,
    /// Factor.
    pub scale: f32,
    /// Both sides shine.
    pub two_sided: bool,
}

impl Emission {
    /// Whether the side `cos` > 0 of the geometric normal shines, or the other.
    #[inline]
    fn shines(&self, cos: f32) -> bool {
        cos > 0.0 || (self.two_sided && cos < 0.0)
    }

    /// Radiance at a point on the side `cos` > 0 of the geometric normal, or the other.
    #[inline]
    pub fn le(&self, textures: &Textures, at: &Point, cos: f32) -> Rgb {
        if self.shines(cos) {
            textures.color(&self.radiance, at) * self.scale
        } else {
            Rgb::ZERO
        }
    }
}

/// A shining shape in world space.
pub struct AreaLight {
    /// Geometry.
    pub shape: AreaShape,
    /// Index into the emissions.
    pub emission: u32,
    /// Whether no ray ever meets the shape (a surface of opacity 0): then only sampling finds it.
    pub unseen: bool,
}

/// Geometry of a shining shape. Normals are unit vectors on the outside.
pub enum AreaShape {
    /// A triangle with the texture coordinates of its corners.
    Triangle {
        /// First corner and the edges from it.
        p: Vec3,
        /// To the second corner.
        e1: Vec3,
        /// To the third corner.
        e2: Vec3,
        /// Normal.
        n: Vec3,
        /// Area.
        area: f32,
        /// Texture coordinates of the corners.
        uv: [Vec2; 3],
    },
    /// p + a e1 + b e2 for a, b in [0, 1].
    Parallelogram {
        /// Corner.
        p: Vec3,
        /// One edge.
        e1: Vec3,
        /// The other.
        e2: Vec3,
        /// Normal.
        n: Vec3,
        /// Area.
        area: f32,
    },
    /// A round sphere.
    Sphere {
        /// Centre.
        center: Vec3,
        /// Radius.
        radius: f32,
        /// The inside is the outside.
        inward: bool,
        /// World to its own space, where its texture coordinates matter.
        local: Option<Box<Affine>>,
    },
    /// A disk with two half axes, maybe with a hole.
    Disk {
        /// Centre.
        center: Vec3,
        /// Half axis.
        a: Vec3,
        /// Half axis.
        b: Vec3,
        /// Normal.
        n: Vec3,
        /// Area, without the hole.
        area: f32,
        /// Radius of the hole over the radius.
        hole: f32,
    },
}

/// Below this 1 - cos a cone is so narrow that its sphere is sampled like a distant disk.
pub(crate) const CONE_MIN: f32 = 1e-9;

/// A point counts as inside of a sphere up to this square of the distance over that of the radius.
pub(crate) const INSIDE: f32 = 1.000_01;

impl AreaLight {
    /// Surface area.
    pub fn area(&self) -> f32 {
        match &self.shape {
            AreaShape::Triangle { area, .. }
            | AreaShape::Parallelogram { area, .. }
            | AreaShape::Disk { area, .. } => *area,
            AreaShape::Sphere { radius, .. } => 4.0 * math::PI * radius * radius,
        }
    }

    /// What the light tree needs to know.
    pub(super) fn bounds(&self, emissions: &[Emission], textures: &Textures) -> LightBounds {
        let emission = &emissions[self.emission as usize];
        // A texture is averaged over a few points.
        const GRID: usize = 4;
        let mut sum = Rgb::ZERO;
        for i in 0..GRID * GRID {
            let u = Vec2::new((i % GRID) as f32 + 0.5, (i / GRID) as f32 + 0.5) / GRID as f32;
            let point = Point {
                uv: [self.uv_at(u); 2],
                ..Point::default()
            };
            sum += textures.color(&emission.radiance, &point);
        }
        let radiance = (sum * (emission.scale / (GRID * GRID) as f32)).max_element();
        let (points, axis, area) = match &self.shape {
            AreaShape::Triangle {
                p, e1, e2, n, area, ..
            } => (vec![*p, *p + *e1, *p + *e2], Some(*n), *area),
            AreaShape::Parallelogram { p, e1, e2, n, area } => (
                vec![*p, *p + *e1, *p + *e2, *p + *e1 + *e2],
                Some(*n),
                *area,
            ),
            AreaShape::Disk {
                center,
                a,
                b,
                n,
                area,
                ..
            } => {
                let corners = [*a + *b, *a - *b, *b - *a, -*a - *b];
                (corners.map(|c| *center + c).to_vec(), Some(*n), *area)
            }
            AreaShape::Sphere { center, radius, .. } => {
                let r = Vec3::splat(*radius);
                (
                    vec![*center - r, *center + r],
                    None,
                    math::PI * radius * radius,
                )
            }
        };
        let bounds = Bounds::of(points);
        LightBounds {
            min: bounds.min,
            max: bounds.max,
            axis: axis.unwrap_or(Vec3::Z),
            strength: (radiance * area).max(0.0),
            cos_normals: if axis.is_some() { 1.0 } else { -1.0 },
            cos_emission: 0.0,
            two_sided: emission.two_sided,
        }
    }

    fn uv_at(&self, u: Vec2) -> Vec2 {
        match &self.shape {
            AreaShape::Triangle { uv, .. } => {
                let b = sampling::uniform_triangle(u);
                uv[0] * (1.0 - b.x - b.y) + uv[1] * b.x + uv[2] * b.y
            }
            _ => u,
        }
    }

    /// Samples a point that may shine on `from`.
    #[inline]
    pub fn sample_li(
        &self,
        textures: &Textures,
        emissions: &[Emission],
        from: Vec3,
        u: Vec2,
    ) -> Option<LightSample> {
        let emission = &emissions[self.emission as usize];
        let (q, n, pdf_area) = match &self.shape {
            AreaShape::Triangle {
                p, e1, e2, n, area, ..
            } => {
                let b = sampling::uniform_triangle(u);
                (*p + *e1 * b.x + *e2 * b.y, *n, 1.0 / area)
            }
            AreaShape::Parallelogram { p, e1, e2, n, area } => {
                (*p + *e1 * u.x + *e2 * u.y, *n, 1.0 / area)
            }
            AreaShape::Disk {
                center,
                a,
                b,
                n,
                area,
                hole,
            } => {
                let d = disk_point(u, *hole);
                (*center + *a * d.x + *b * d.y, *n, 1.0 / area)
            }
            AreaShape::Sphere {
                center,
                radius,
                inward,
                ..
            } => {
                let (wi, q, n, pdf) = sphere_sample(*center, *radius, *inward, from, u)?;
                let li = self.sent(textures, emission, u, q, n, -math::dot(n, wi));
                return (li != Rgb::ZERO && pdf > 0.0 && pdf < f32::INFINITY).then_some(
                    LightSample {
                        wi,
                        target: Some(q),
                        li,
                        pdf,
                        delta: self.unseen,
                    },
                );
            }
        };
        let d = q - from;
        let distance2 = math::dot(d, d);
        if distance2 == 0.0 {
            return None;
        }
        let wi = d * (1.0 / distance2.sqrt());
        let cos = -math::dot(n, wi);
        let li = self.sent(textures, emission, u, q, n, cos);
        let pdf = pdf_area * distance2 / cos.abs();
        (li != Rgb::ZERO && pdf < f32::INFINITY).then_some(LightSample {
            wi,
            target: Some(q),
            li,
            pdf,
            delta: self.unseen,
        })
    }

    /// Radiance of the point `q` that was sampled with `u`.
    #[inline(always)]
    fn sent(
        &self,
        textures: &Textures,
        emission: &Emission,
        u: Vec2,
        q: Vec3,
        n: Vec3,
        cos: f32,
    ) -> Rgb {
        if let ColorTex::Const(radiance) = emission.radiance {
            return if emission.shines(cos) {
                Rgb::from_array(radiance) * emission.scale
            } else {
                Rgb::ZERO
            };
        }
        self.sent_by_texture(textures, emission, u, q, n, cos)
    }

    #[inline(never)]
    fn sent_by_texture(
        &self,
        textures: &Textures,
        emission: &Emission,
        u: Vec2,
        q: Vec3,
        n: Vec3,
        cos: f32,
    ) -> Rgb {
        let mut point = Point {
            p: q,
            n,
            ..Point::default()
        };
        point.uv = match &self.shape {
            AreaShape::Triangle { .. } => [self.uv_at(u); 2],
            AreaShape::Parallelogram { .. } => point.uv,
            AreaShape::Disk { hole, .. } => [disk_uv(disk_point(u, *hole), *hole); 2],
            AreaShape::Sphere { center, local, .. } => match local {
                Some(local) => [sphere_uv(math::normalize(local.vector(q - *center))); 2],
                None => point.uv,
            },
        };
        emission.le(textures, &point, cos)
    }

    /// Density per solid angle, from `from`, of the point `on` this light.
    #[inline]
    pub fn pdf_li(&self, from: Vec3, on: &Interaction) -> f32 {
        if let AreaShape::Sphere { center, radius, .. } = &self.shape
            && let Some(one_minus_cos) = cone(*center, *radius, from)
        {
            return sampling::uniform_cone_pdf(one_minus_cos);
        }
        let d = on.p - from;
        let distance2 = d.dot(d);
        let cos = on.ng.dot(d).abs() / distance2.sqrt();
        if cos > 0.0 {
            distance2 / (cos * self.area())
        } else {
            0.0
        }
    }
}

/// 1 - cos of the half angle that a sphere fills as seen from outside; `None` from inside.
fn cone(center: Vec3, radius: f32, from: Vec3) -> Option<f32> {
    let d = center - from;
    let (d2, r2) = (d.dot(d), radius * radius);
    if d2 <= r2 * INSIDE {
        return None;
    }
    let sin2 = r2 / d2;
    let one_minus_cos = sin2 / (1.0 + (1.0 - sin2).sqrt());
    Some(one_minus_cos.max(CONE_MIN))
}

/// Uniform point of the unit disk without the hole.
#[inline]
fn disk_point(u: Vec2, hole: f32) -> Vec2 {
    let d = sampling::uniform_disk_concentric(u);
    let r2 = d.dot(d);
    // Area-preserving push out of the hole.
    let r = (hole * hole + (1.0 - hole * hole) * r2).sqrt();
    if r2 > 0.0 {
        d * (r / r2.sqrt())
    } else {
        Vec2::new(r, 0.0)
    }
}

/// Texture coordinates of a point of a disk; `d` is in units of the radius.
fn disk_uv(d: Vec2, hole: f32) -> Vec2 {
    let phi = math::atan2(d.y, d.x);
    let phi = if phi < 0.0 { phi + 2.0 * math::PI } else { phi };
    let r = d.dot(d).sqrt();
    Vec2::new(phi * (0.5 / math::PI), (1.0 - r) / (1.0 - hole))
}

/// Direction to a point of a sphere, the point, its normal, density per solid angle.
fn sphere_sample(
    center: Vec3,
    radius: f32,
    inward: bool,
    from: Vec3,
    u: Vec2,
) -> Option<(Vec3, Vec3, Vec3, f32)> {
    let to_center = center - from;
    let (wi, q, pdf) = match cone(center, radius, from) {
        Some(one_minus_cos) => {
            let distance = math::length(to_center);
            let frame = Frame::from_normal(to_center * (1.0 / distance));
            let local = sampling::uniform_cone(u, one_minus_cos);
            let wi = frame.to_world(local);
            // Distance to the near side along wi.
            let sin2 = (1.0 - local.z * local.z).max(0.0);
            let t =
                distance * local.z - math::safe_sqrt(radius * radius - distance * distance * sin2);
            let on = from + wi * t;
            let n = math::normalize(on - center);
            (
                wi,
                center + n * radius,
                sampling::uniform_cone_pdf(one_minus_cos),
            )
        }
        None => {
            let n = sampling::uniform_sphere(u);
            let q = center + n * radius;
            let d = q - from;
            let distance2 = d.dot(d);
            if distance2 == 0.0 {
                return None;
            }
            let wi = d * (1.0 / distance2.sqrt());
            let pdf = distance2 / (n.dot(wi).abs() * 4.0 * math::PI * radius * radius);
            (wi, q, pdf)
        }
    };
    let n = math::normalize(q - center) * if inward { -1.0 } else { 1.0 };
    Some((wi, q, n, pdf))
}
