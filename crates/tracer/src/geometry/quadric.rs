//! Spheres and disks, intersected exactly.

use super::transform::Affine;
use crate::accel::build::Bounds;
use crate::math;
use glam::{Vec2, Vec3};

/// A curved or flat shape with an equation of its own, in the space of its tree.
#[derive(Clone, Copy, Debug)]
pub struct Quadric {
    /// Local to tree and back.
    pub to_parent: Affine,
    /// See `to_parent`.
    pub from_parent: Affine,
    /// In local space.
    pub kind: QuadricKind,
}

/// Local shapes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum QuadricKind {
    /// About the origin.
    Sphere {
        /// Radius.
        radius: f32,
    },
    /// At z = height, between the radii.
    Disk {
        /// Outer radius.
        radius: f32,
        /// Radius of the hole.
        inner: f32,
        /// Along z.
        height: f32,
    },
}

/// A point on a quadric, in the space of its tree.
pub struct QuadricPoint {
    /// Position, on the surface up to rounding.
    pub p: Vec3,
    /// Unit normal, outward (along +Z for a disk, through the transform).
    pub n: Vec3,
    /// Texture coordinates.
    pub uv: Vec2,
    /// Derivative of the position by u.
    pub dpdu: Vec3,
    /// Derivative of the position by v.
    pub dpdv: Vec3,
}

/// Texture coordinates of the point of a sphere in a direction from its centre, in its own space.
#[inline]
pub(crate) fn sphere_uv(n: Vec3) -> Vec2 {
    let phi = math::atan2(n.y, n.x);
    let phi = if phi < 0.0 { phi + 2.0 * math::PI } else { phi };
    let theta = math::acos((-n.z).clamp(-1.0, 1.0));
    Vec2::new(phi * (0.5 / math::PI), theta / math::PI)
}

impl Quadric {
    /// Up to two parameters of intersection, rising; NaN or a negative number where there is none.
    #[inline(always)]
    pub fn intersect(&self, origin: Vec3, direction: Vec3) -> [f32; 2] {
        let o = self.from_parent.point(origin);
        let d = self.from_parent.vector(direction);
        match self.kind {
            QuadricKind::Sphere { radius } => {
                // With f = o: |f + t d|^2 = r^2. The discriminant is taken from the point closest to
                // the centre, which loses fewer digits than b^2 - ac [Haines19].
                let a = d.dot(d);
                let b = -o.dot(d);
                let c = o.dot(o) - radius * radius;
                let l = o + d * (b / a);
                let discriminant = radius * radius - l.dot(l);
                if discriminant < 0.0 {
                    return [-1.0; 2];
                }
                let q = b + (discriminant * a).sqrt().copysign(b);
                let (t0, t1) = (c / q, q / a);
                if t0 < t1 { [t0, t1] } else { [t1, t0] }
            }
            QuadricKind::Disk {
                radius,
                inner,
                height,
            } => {
                let t = (height - o.z) / d.z;
                let (x, y) = (o.x + t * d.x, o.y + t * d.y);
                let r2 = x * x + y * y;
                // NaN and infinity (a ray in the plane) compare false.
                if r2 <= radius * radius && r2 >= inner * inner {
                    [t, -1.0]
                } else {
                    [-1.0; 2]
                }
            }
        }
    }

    /// Everything about the point where a ray (in the space of the tree) hits at `t`.
    pub fn point(&self, origin: Vec3, direction: Vec3, t: f32) -> QuadricPoint {
        let local = self.from_parent.point(origin) + self.from_parent.vector(direction) * t;
        let (p, n, uv, dpdu, dpdv) = match self.kind {
            QuadricKind::Sphere { radius } => {
                let n = math::normalize(local);
                let p = n * radius;
                let uv = sphere_uv(n);
                let dpdu = Vec3::new(-p.y, p.x, 0.0) * (2.0 * math::PI);
                let r = math::safe_sqrt(n.x * n.x + n.y * n.y);
                let (c, s) = if r > 0.0 {
                    (n.x / r, n.y / r)
                } else {
                    (1.0, 0.0)
                };
                // v runs from the south pole up: d/dtheta with theta from -Z.
                let dpdv = Vec3::new(-n.z * c, -n.z * s, r) * (radius * math::PI);
                (p, n, uv, dpdu, dpdv)
            }
            QuadricKind::Disk {
                radius,
                inner,
                height,
            } => {
                let p = Vec3::new(local.x, local.y, height);
                let r = math::safe_sqrt(p.x * p.x + p.y * p.y);
                let phi = math::atan2(p.y, p.x);
                let phi = if phi < 0.0 { phi + 2.0 * math::PI } else { phi };
                let uv = Vec2::new(phi * (0.5 / math::PI), (radius - r) / (radius - inner));
                let dpdu = Vec3::new(-p.y, p.x, 0.0) * (2.0 * math::PI);
                let out = if r > 0.0 {
                    Vec3::new(p.x / r, p.y / r, 0.0)
                } else {
                    Vec3::X
                };
                (p, Vec3::Z, uv, dpdu, out * (inner - radius))
            }
        };
        QuadricPoint {
            p: self.to_parent.point(p),
            n: math::normalize(self.from_parent.transposed_vector(n)),
            uv,
            dpdu: self.to_parent.vector(dpdu),
            dpdv: self.to_parent.vector(dpdv),
        }
    }

    /// Box in the space of the tree.
    pub fn bounds(&self) -> Bounds {
        let local = match self.kind {
            QuadricKind::Sphere { radius } => {
                // Exact for a transformed sphere: the support in each axis is the length of a row.
                let m = &self.to_parent.m;
                let extent = Vec3::new(
                    math::length(Vec3::new(m[0].x, m[1].x, m[2].x)),
                    math::length(Vec3::new(m[0].y, m[1].y, m[2].y)),
                    math::length(Vec3::new(m[0].z, m[1].z, m[2].z)),
                ) * radius;
                return Bounds {
                    min: self.to_parent.t - extent,
                    max: self.to_parent.t + extent,
                }
                .padded(0.0);
            }
            QuadricKind::Disk { radius, height, .. } => Bounds {
                min: Vec3::new(-radius, -radius, height),
                max: Vec3::new(radius, radius, height),
            },
        };
        Bounds::of(local.corners().map(|p| self.to_parent.point(p))).padded(0.0)
    }

    /// Centre and radius in the space of the tree where the transform keeps it a sphere.
    pub fn as_round_sphere(&self) -> Option<(Vec3, f32)> {
        let QuadricKind::Sphere { radius } = self.kind else {
            return None;
        };
        let m = &self.to_parent.m;
        let s = m[0].dot(m[0]);
        let close = |a: f32, b: f32| (a - b).abs() <= s * 1e-4;
        let round = close(m[1].dot(m[1]), s)
            && close(m[2].dot(m[2]), s)
            && close(m[0].dot(m[1]), 0.0)
            && close(m[1].dot(m[2]), 0.0)
            && close(m[2].dot(m[0]), 0.0);
        round.then(|| (self.to_parent.t, radius * s.sqrt()))
    }
}
