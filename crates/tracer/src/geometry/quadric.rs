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
    /// Centre and radius in the space of the tree, where that is a sphere too: no transform is then
    /// needed to intersect it.
    round: Option<(Vec3, f32)>,
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

/// The parameters of a point on a quadric, in the space of its tree.
pub struct QuadricParameters {
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

/// Where a ray meets a sphere about the origin; see [`Quadric::intersect`]. The discriminant is taken
/// from the point closest to the centre, which loses fewer digits than b^2 - ac [Haines19].
#[inline(always)]
fn sphere(o: Vec3, d: Vec3, radius: f32) -> [f32; 2] {
    let a = math::dot(d, d);
    let b = -math::dot(o, d);
    let c = math::dot(o, o) - radius * radius;
    let l = o + d * (b / a);
    let discriminant = radius * radius - math::dot(l, l);
    if discriminant < 0.0 {
        return [-1.0; 2];
    }
    let q = b + (discriminant * a).sqrt().copysign(b);
    let (t0, t1) = (c / q, q / a);
    if t0 < t1 { [t0, t1] } else { [t1, t0] }
}

impl Quadric {
    /// With the transform from local to the space of the tree and its inverse.
    pub fn new(to_parent: Affine, from_parent: Affine, kind: QuadricKind) -> Quadric {
        let mut quadric = Quadric {
            to_parent,
            from_parent,
            kind,
            round: None,
        };
        quadric.round = quadric.as_round_sphere();
        quadric
    }

    /// Centre and radius in the space of the tree, if it is met as a sphere there.
    pub(crate) fn sphere(&self) -> Option<(Vec3, f32)> {
        self.round
    }

    /// Centre and radius in the space of the tree, if it is a sphere there whose centre is exactly where its
    /// own origin comes to lie.
    pub(crate) fn round(&self) -> Option<(Vec3, f32)> {
        self.round.filter(|(center, _)| *center == self.to_parent.t)
    }

    /// Up to two parameters of intersection, rising; NaN or a negative number where there is none.
    #[inline(always)]
    pub fn intersect(&self, origin: Vec3, direction: Vec3) -> [f32; 2] {
        if let Some((center, radius)) = self.round {
            return sphere(origin - center, direction, radius);
        }
        let o = self.from_parent.point(origin);
        let d = self.from_parent.vector(direction);
        match self.kind {
            QuadricKind::Sphere { radius } => sphere(o, d, radius),
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

    /// Position, on the surface up to rounding, and outward unit normal (along +Z for a disk, through the
    /// transform) where a ray in the space of the tree hits at `t`.
    #[inline]
    pub fn point(&self, origin: Vec3, direction: Vec3, t: f32) -> (Vec3, Vec3) {
        if let Some((center, radius)) = self.round {
            let n = math::normalize(origin + direction * t - center);
            return (center + n * radius, n);
        }
        let local = self.from_parent.point(origin) + self.from_parent.vector(direction) * t;
        let (p, n) = match self.kind {
            QuadricKind::Sphere { radius } => {
                let n = math::normalize(local);
                (n * radius, n)
            }
            QuadricKind::Disk { height, .. } => (Vec3::new(local.x, local.y, height), Vec3::Z),
        };
        (
            self.to_parent.point(p),
            math::normalize(self.from_parent.transposed_vector(n)),
        )
    }

    /// Texture coordinates of the surface point at `p` in the space of the tree, and what they change.
    pub fn parameters(&self, p: Vec3) -> QuadricParameters {
        let local = self.from_parent.point(p);
        let (uv, dpdu, dpdv) = match self.kind {
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
                (uv, dpdu, dpdv)
            }
            QuadricKind::Disk { radius, inner, .. } => {
                let p = local;
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
                (uv, dpdu, out * (inner - radius))
            }
        };
        QuadricParameters {
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
