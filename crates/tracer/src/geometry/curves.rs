//! Hair, fur, grass: cubic Bezier pieces with a width, intersected without tessellation.
//!
//! A piece is halved until it is straight to a fraction of its width, seen along the ray [Nakamaru02]; halves
//! that the ray does not come near are dropped on the way. What is left is tested as a flat strip
//! facing the ray. A piece of a strand is in the tree several times, each time with a part of its
//! parameter, as boxes around long diagonal hairs are mostly empty.

use crate::accel::build::Bounds;
use crate::math::{Frame, dot, length, normalize, safe_sqrt};
use glam::{DAffine3, DVec3, Vec2, Vec3};
use scene::model::{CurveKind, CurveSegment, Curves};

/// Strands in the space of their tree.
#[derive(Clone, Debug)]
pub struct CurveSet {
    /// Cross-section.
    pub kind: CurveKind,
    /// Pieces.
    pub pieces: Vec<Piece>,
}

/// One cubic Bezier piece.
#[derive(Clone, Copy, Debug)]
pub struct Piece {
    /// Control points.
    pub points: [Vec3; 4],
    /// Full width at the ends.
    pub width: [f32; 2],
    /// Texture coordinate along the strand at the ends.
    pub u: [f32; 2],
    /// Of a ribbon, at the ends.
    pub normals: [Vec3; 2],
}

/// A part of a piece, as it lies in a tree.
#[derive(Clone, Copy, Debug)]
pub struct CurvePart {
    /// Index into the curve sets.
    pub set: u32,
    /// Piece of the set.
    pub piece: u32,
    /// Primitive of the tree.
    pub prim: u32,
    /// From where to where, of [0, 1].
    pub range: [f32; 2],
}

/// Everything about a point of a curve that a ray hits, in the space of its tree.
pub struct CurvePoint {
    /// Unit length, towards the ray (for ribbons: where the strand has it, on the ray's side).
    pub n: Vec3,
    /// Along the strand and across it.
    pub uv: Vec2,
    /// Derivative of the position by u.
    pub dpdu: Vec3,
    /// Across, as wide as the strand.
    pub dpdv: Vec3,
    /// Full width.
    pub width: f32,
}

/// Parts of one piece at most.
const PARTS_MAX: u32 = 8;
/// Halvings at most.
const DEPTH_MAX: u32 = 10;
/// Deviation from a straight line that is accepted, in widths.
const STRAIGHT: f32 = 0.05;

impl CurveSet {
    /// Places strands. Widths are scaled by the cube root of the determinant. Pieces that are not made of
    /// finite numbers cannot be hit and are left out.
    pub fn new(desc: &Curves, transform: &DAffine3) -> CurveSet {
        let scale = libm::cbrt(transform.matrix3.determinant().abs()) as f32;
        let to_normal = transform.matrix3.inverse().transpose();
        let double = |p: [f32; 3]| DVec3::new(f64::from(p[0]), f64::from(p[1]), f64::from(p[2]));
        let single = |p: DVec3| Vec3::new(p.x as f32, p.y as f32, p.z as f32);
        let place = |s: &CurveSegment| Piece {
            points: s
                .points
                .map(|p| single(transform.transform_point3(double(p)))),
            width: s.width.map(|w| w.max(0.0) * scale),
            u: s.u,
            normals: s.normals.map(|n| single(to_normal * double(n))),
        };
        let fits = |p: &Piece| {
            p.points.iter().all(|p| p.is_finite()) && p.width.iter().all(|w| w.is_finite())
        };
        CurveSet {
            kind: desc.kind,
            pieces: desc.segments.iter().map(place).filter(fits).collect(),
        }
    }

    /// Memory held.
    pub fn memory_bytes(&self) -> usize {
        self.pieces.len() * size_of::<Piece>()
    }
}

impl Piece {
    /// Into how many parts it is cut for the tree: the longer and thinner, the more.
    pub fn parts(&self) -> u32 {
        let [a, b, c, d] = self.points;
        let long = length(b - a) + length(c - b) + length(d - c);
        let wide = self.width[0].max(self.width[1]) * 10.0;
        let mut parts = 1;
        while parts < PARTS_MAX && long > wide * parts as f32 {
            parts *= 2;
        }
        parts
    }

    /// Control points of a part.
    fn cut(&self, range: [f32; 2]) -> [Vec3; 4] {
        let [from, to] = range;
        if from <= 0.0 && to >= 1.0 {
            return self.points;
        }
        let p = &self.points;
        [
            blossom(p, from, from, from),
            blossom(p, from, from, to),
            blossom(p, from, to, to),
            blossom(p, to, to, to),
        ]
    }

    /// Box of a part.
    pub fn bounds(&self, range: [f32; 2]) -> Bounds {
        Bounds::of(self.cut(range)).padded(0.5 * self.width[0].max(self.width[1]))
    }

    fn width_at(&self, u: f32) -> f32 {
        self.width[0] + (self.width[1] - self.width[0]) * u
    }

    /// Derivative of the position by the parameter; along the chord where it vanishes.
    fn tangent(&self, u: f32) -> Vec3 {
        let [a, b, c, d] = self.points;
        let w = 1.0 - u;
        let t = (b - a) * (w * w) + (c - b) * (2.0 * u * w) + (d - c) * (u * u);
        if t.dot(t) > 0.0 {
            return t * 3.0;
        }
        let chord = d - a;
        if chord.dot(chord) > 0.0 {
            chord
        } else {
            Vec3::X
        }
    }

    /// Normal of a ribbon, interpolated.
    fn normal(&self, u: f32) -> Vec3 {
        self.normals[0] * (1.0 - u) + self.normals[1] * u
    }

    /// Where a ray hits a part first: (t, parameter of the whole piece, place across in [0, 1]).
    pub fn intersect(
        &self,
        kind: CurveKind,
        range: [f32; 2],
        origin: Vec3,
        direction: Vec3,
        t_max: f32,
    ) -> Option<(f32, f32, f32)> {
        let speed = length(direction);
        if !(speed > 0.0 && speed.is_finite()) {
            return None;
        }
        // Seen along the ray: it runs along z, through the origin.
        let frame = Frame::from_normal(direction * (1.0 / speed));
        let widest = self.width[0].max(self.width[1]);
        let mut z_max = t_max * speed;
        let whole = self.cut(range);
        let start = Seen {
            p: whole.map(|p| frame.to_local(p - origin)),
            range,
            depth: 0,
        };
        let depth = halvings(&start.p, widest);
        let mut stack = [start; DEPTH_MAX as usize + 1];
        let mut height = 1;
        let mut best = None;
        while height > 0 {
            height -= 1;
            let seen = stack[height];
            if !near(&seen.p, 0.5 * widest, z_max) {
                continue;
            }
            if seen.depth < depth {
                let middle = 0.5 * (seen.range[0] + seen.range[1]);
                let (a, b) = halve(&seen.p);
                stack[height] = Seen {
                    p: b,
                    range: [middle, seen.range[1]],
                    depth: seen.depth + 1,
                };
                stack[height + 1] = Seen {
                    p: a,
                    range: [seen.range[0], middle],
                    depth: seen.depth + 1,
                };
                height += 2;
                continue;
            }
            if let Some((z, u, v)) = self.strip(kind, &seen, frame.n, z_max) {
                z_max = z;
                best = Some((z / speed, u, v));
            }
        }
        best.filter(|(t, ..)| *t > 0.0 && *t <= t_max)
    }

    /// Tests what is straight as a strip facing the ray, between the perpendiculars at its ends.
    fn strip(&self, kind: CurveKind, seen: &Seen, d: Vec3, z_max: f32) -> Option<(f32, f32, f32)> {
        let [a, b, c, e] = seen.p;
        if flat_dot(b - a, -a) < 0.0 || flat_dot(c - e, -e) < 0.0 {
            return None;
        }
        let chord = e - a;
        let length2 = flat_dot(chord, chord);
        let w = if length2 > 0.0 {
            (flat_dot(-a, chord) / length2).clamp(0.0, 1.0)
        } else {
            0.0
        };
        let u = seen.range[0] + (seen.range[1] - seen.range[0]) * w;
        let mut width = self.width_at(u);
        if kind == CurveKind::Ribbon {
            let n = self.normal(u);
            let size = length(n);
            width *= if size > 0.0 {
                dot(n, d).abs() / size
            } else {
                1.0
            };
        }
        let p = blossom(&seen.p, w, w, w);
        let off2 = flat_dot(p, p);
        if off2 > 0.25 * width * width || p.z <= 0.0 || p.z > z_max || width <= 0.0 {
            return None;
        }
        // v grows along n x tangent, n being the side that the ray sees.
        let side = p.y * chord.x - p.x * chord.y;
        let across = off2.sqrt() / width;
        let v = if side > 0.0 {
            0.5 + across
        } else {
            0.5 - across
        };
        Some((p.z, u, v))
    }

    /// Works out a hit. `direction` is the ray's, in the space of the tree.
    pub fn point(&self, kind: CurveKind, u: f32, v: f32, direction: Vec3) -> CurvePoint {
        let tangent = self.tangent(u);
        let along = normalize(tangent);
        let back = -direction;
        let mut facing = back - along * along.dot(back);
        if kind == CurveKind::Ribbon {
            let n = self.normal(u);
            let n = n - along * along.dot(n);
            if n.dot(n) > 0.0 {
                facing = if n.dot(back) < 0.0 { -n } else { n };
            }
        }
        let flat = if facing.dot(facing) > 1e-12 * back.dot(back) {
            normalize(facing)
        } else {
            // Seen along the strand: any side.
            Frame::from_normal(along).s
        };
        let across = flat.cross(along);
        let width = self.width_at(u);
        let n = if kind == CurveKind::Cylinder {
            // A circle's normal at this distance from its middle.
            let sin = (2.0 * v - 1.0).clamp(-1.0, 1.0);
            normalize(across * sin + flat * safe_sqrt(1.0 - sin * sin).max(0.01))
        } else {
            flat
        };
        let du = self.u[1] - self.u[0];
        CurvePoint {
            n,
            uv: self.uv(u, v),
            dpdu: if du != 0.0 {
                tangent * (1.0 / du)
            } else {
                tangent
            },
            dpdv: across * width,
            width,
        }
    }

    /// Texture coordinates.
    pub fn uv(&self, u: f32, v: f32) -> Vec2 {
        Vec2::new(self.u[0] + (self.u[1] - self.u[0]) * u, v)
    }
}

/// A part of a piece in the space of the ray.
#[derive(Clone, Copy)]
struct Seen {
    p: [Vec3; 4],
    range: [f32; 2],
    depth: u32,
}

/// The polar form of a cubic: with three equal parameters its point.
#[inline]
fn blossom(p: &[Vec3; 4], s: f32, t: f32, u: f32) -> Vec3 {
    let mix = |a: Vec3, b: Vec3, x: f32| a * (1.0 - x) + b * x;
    let (a, b, c) = (mix(p[0], p[1], s), mix(p[1], p[2], s), mix(p[2], p[3], s));
    mix(mix(a, b, t), mix(b, c, t), u)
}

/// Both halves.
#[inline]
fn halve(p: &[Vec3; 4]) -> ([Vec3; 4], [Vec3; 4]) {
    let (a, b, c) = (
        (p[0] + p[1]) * 0.5,
        (p[1] + p[2]) * 0.5,
        (p[2] + p[3]) * 0.5,
    );
    let (d, e) = ((a + b) * 0.5, (b + c) * 0.5);
    let m = (d + e) * 0.5;
    ([p[0], a, d, m], [m, e, c, p[3]])
}

/// Scalar product across the ray.
#[inline]
fn flat_dot(a: Vec3, b: Vec3) -> f32 {
    a.x * b.x + a.y * b.y
}

/// How often a piece has to be halved: each time a quarter of the second differences is left.
#[inline]
fn halvings(p: &[Vec3; 4], width: f32) -> u32 {
    let (a, b) = (p[0] - p[1] * 2.0 + p[2], p[1] - p[2] * 2.0 + p[3]);
    let most = a.abs().max(b.abs());
    let mut bend = most.x.max(most.y);
    let mut depth = 0;
    while depth < DEPTH_MAX && bend > STRAIGHT * width {
        bend *= 0.25;
        depth += 1;
    }
    depth
}

/// Whether the ray may come within `reach` of a piece before `z_max`.
#[inline]
fn near(p: &[Vec3; 4], reach: f32, z_max: f32) -> bool {
    let lo = p[0].min(p[1]).min(p[2].min(p[3]));
    let hi = p[0].max(p[1]).max(p[2].max(p[3]));
    lo.x <= reach
        && hi.x >= -reach
        && lo.y <= reach
        && hi.y >= -reach
        && hi.z >= 0.0
        && lo.z <= z_max
}

#[cfg(test)]
mod tests;
