//! Affine maps in single precision, and maps that move.
//!
//! Everything is composed and inverted in double precision while a scene is prepared; what is left
//! for rays is plain multiplication and, for moving things, an interpolation.

use crate::math;
use glam::{DAffine3, DMat3, DQuat, DVec3, Vec3};
use scene::model::Motion;

/// x -> m x + t, m by columns.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Affine {
    /// Columns of the linear part.
    pub m: [Vec3; 3],
    /// Translation.
    pub t: Vec3,
}

impl Affine {
    /// Rounds a double-precision map.
    pub fn new(a: &DAffine3) -> Affine {
        let c = |v: DVec3| Vec3::new(v.x as f32, v.y as f32, v.z as f32);
        let m = a.matrix3;
        Affine {
            m: [c(m.x_axis), c(m.y_axis), c(m.z_axis)],
            t: c(a.translation),
        }
    }
    /// Applies the map to a point.
    #[inline(always)]
    pub fn point(&self, p: Vec3) -> Vec3 {
        self.m[0] * p.x + self.m[1] * p.y + self.m[2] * p.z + self.t
    }
    /// Applies the linear part.
    #[inline(always)]
    pub fn vector(&self, v: Vec3) -> Vec3 {
        self.m[0] * v.x + self.m[1] * v.y + self.m[2] * v.z
    }
    /// Applies the transpose of the linear part; with the inverse map this transforms normals.
    #[inline(always)]
    pub fn transposed_vector(&self, v: Vec3) -> Vec3 {
        Vec3::new(self.m[0].dot(v), self.m[1].dot(v), self.m[2].dot(v))
    }
    /// Determinant of the linear part.
    pub fn determinant(&self) -> f32 {
        self.m[0].dot(self.m[1].cross(self.m[2]))
    }
    /// The inverse map, in single precision.
    pub fn inverse(&self) -> Affine {
        let [a, b, c] = self.m;
        let (r0, r1, r2) = (b.cross(c), c.cross(a), a.cross(b));
        let inv_det = 1.0 / a.dot(r0);
        let (r0, r1, r2) = (r0 * inv_det, r1 * inv_det, r2 * inv_det);
        let m = [
            Vec3::new(r0.x, r1.x, r2.x),
            Vec3::new(r0.y, r1.y, r2.y),
            Vec3::new(r0.z, r1.z, r2.z),
        ];
        let linear = Affine { m, t: Vec3::ZERO };
        Affine {
            m,
            t: -linear.vector(self.t),
        }
    }
    /// First `other`, then `self`.
    pub fn after(&self, other: &Affine) -> Affine {
        Affine {
            m: other.m.map(|c| self.vector(c)),
            t: self.point(other.t),
        }
    }
}

/// One key of a moving map, taken apart.
#[derive(Clone, Copy, Debug)]
struct Key {
    time: f32,
    translation: Vec3,
    rotation: [f32; 4],
    /// Symmetric scale and shear, by columns.
    stretch: [Vec3; 3],
    /// To the next key; see [`turn`].
    turn: Option<(f32, f32)>,
}

/// A map over time: translation and stretch are interpolated linearly, rotation spherically
/// [ShoemakeDuff92].
#[derive(Clone, Debug)]
pub struct MovingAffine {
    keys: Vec<Key>,
}

impl MovingAffine {
    /// Takes every key apart by polar decomposition.
    pub fn new(motion: &Motion) -> MovingAffine {
        let mut keys: Vec<Key> = Vec::with_capacity(motion.keys.len());
        for key in &motion.keys {
            let (rotation, stretch) = polar(key.transform.matrix3);
            let mut q = [
                rotation.x as f32,
                rotation.y as f32,
                rotation.z as f32,
                rotation.w as f32,
            ];
            // The shorter way round.
            if let Some(last) = keys.last() {
                let dot: f32 = (0..4).map(|i| last.rotation[i] * q[i]).sum();
                if dot < 0.0 {
                    q = q.map(|x| -x);
                }
            }
            let a = Affine::new(&DAffine3 {
                matrix3: stretch,
                translation: key.transform.translation,
            });
            keys.push(Key {
                time: key.time as f32,
                translation: a.t,
                rotation: q,
                stretch: a.m,
                turn: None,
            });
        }
        for at in 1..keys.len() {
            keys[at - 1].turn = turn(keys[at - 1].rotation, keys[at].rotation);
        }
        MovingAffine { keys }
    }

    /// Times of the keys.
    pub fn times(&self) -> impl Iterator<Item = f32> + '_ {
        self.keys.iter().map(|k| k.time)
    }

    /// The map at a time; the nearest key holds outside.
    pub fn at(&self, time: f32) -> Affine {
        let after = self.keys.partition_point(|k| k.time <= time);
        let (a, b, turn, f) = match after {
            0 => (&self.keys[0], &self.keys[0], None, 0.0),
            n if n == self.keys.len() => (&self.keys[n - 1], &self.keys[n - 1], None, 0.0),
            n => {
                let (a, b) = (&self.keys[n - 1], &self.keys[n]);
                (a, b, a.turn, (time - a.time) / (b.time - a.time))
            }
        };
        let mix = |x: Vec3, y: Vec3| x * (1.0 - f) + y * f;
        let turn = Affine {
            m: rotation_columns(slerp(a.rotation, b.rotation, turn, f)),
            t: Vec3::ZERO,
        };
        let stretch = [0, 1, 2].map(|i| mix(a.stretch[i], b.stretch[i]));
        Affine {
            m: stretch.map(|c| turn.vector(c)),
            t: mix(a.translation, b.translation),
        }
    }
}

/// A map that may move.
#[derive(Clone, Debug)]
pub enum Placement {
    /// Local to parent and back.
    Fixed(Affine, Affine),
    /// Outermost first.
    Moving(Vec<MovingAffine>),
}

impl Placement {
    /// The chain of motions from the outermost to the innermost.
    pub fn new(chain: &[&Motion]) -> Placement {
        if chain.iter().all(|m| !m.is_moving()) {
            let whole = chain
                .iter()
                .fold(DAffine3::IDENTITY, |a, m| a * m.keys[0].transform);
            Placement::Fixed(Affine::new(&whole), Affine::new(&whole.inverse()))
        } else {
            Placement::Moving(chain.iter().map(|m| MovingAffine::new(m)).collect())
        }
    }

    /// Local to parent and back at a time.
    #[inline]
    pub fn at(&self, time: f32) -> (Affine, Affine) {
        match self {
            Placement::Fixed(to, from) => (*to, *from),
            Placement::Moving(chain) => {
                let mut whole = chain[0].at(time);
                for inner in &chain[1..] {
                    whole = whole.after(&inner.at(time));
                }
                (whole, whole.inverse())
            }
        }
    }

    /// Times between which the map must be sampled to bound it: one for a fixed map.
    pub fn sample_times(&self, open: f32, close: f32) -> Vec<f32> {
        let Placement::Moving(chain) = self else {
            return vec![open];
        };
        let mut knots = vec![open, close];
        for m in chain {
            knots.extend(m.times().filter(|t| *t > open && *t < close));
        }
        knots.sort_by(f32::total_cmp);
        const STEPS: usize = 32;
        let mut times = Vec::new();
        for pair in knots.windows(2) {
            times.extend(
                (0..STEPS).map(|i| pair[0] + (pair[1] - pair[0]) * (i as f32 / STEPS as f32)),
            );
        }
        times.push(close);
        times
    }
}

/// M = R S with R a rotation and S symmetric (S takes a mirroring with it) [ShoemakeDuff92].
fn polar(m: DMat3) -> (DQuat, DMat3) {
    let mut r = if m.determinant() < 0.0 { m * -1.0 } else { m };
    for _ in 0..64 {
        let next = (r + r.inverse().transpose()) * 0.5;
        let change = (next - r)
            .to_cols_array()
            .iter()
            .fold(0.0f64, |a, x| a.max(x.abs()));
        r = next;
        if change < 1e-15 {
            break;
        }
    }
    (DQuat::from_mat3(&r), r.transpose() * m)
}

/// Angle between two rotations and the inverse of its sine; `None` if it is so small that they are as good as on a
/// line.
fn turn(a: [f32; 4], b: [f32; 4]) -> Option<(f32, f32)> {
    let dot: f32 = a[0] * b[0] + a[1] * b[1] + a[2] * b[2] + a[3] * b[3];
    (dot <= 0.9995).then(|| {
        let angle = math::acos(dot.clamp(-1.0, 1.0));
        (angle, 1.0 / math::sin(angle))
    })
}

fn slerp(a: [f32; 4], b: [f32; 4], turn: Option<(f32, f32)>, f: f32) -> [f32; 4] {
    let (wa, wb) = match turn {
        None => (1.0 - f, f),
        Some((angle, s)) => (math::sin((1.0 - f) * angle) * s, math::sin(f * angle) * s),
    };
    let q = [0, 1, 2, 3].map(|i| a[i] * wa + b[i] * wb);
    let n = 1.0 / (q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3]).sqrt();
    q.map(|x| x * n)
}

fn rotation_columns([x, y, z, w]: [f32; 4]) -> [Vec3; 3] {
    [
        Vec3::new(
            1.0 - 2.0 * (y * y + z * z),
            2.0 * (x * y + w * z),
            2.0 * (x * z - w * y),
        ),
        Vec3::new(
            2.0 * (x * y - w * z),
            1.0 - 2.0 * (x * x + z * z),
            2.0 * (y * z + w * x),
        ),
        Vec3::new(
            2.0 * (x * z + w * y),
            2.0 * (y * z - w * x),
            1.0 - 2.0 * (x * x + y * y),
        ),
    ]
}
