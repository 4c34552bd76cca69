//! Triangle meshes in the space of their tree.

use glam::{Vec2, Vec3};
use scene::model::{Deformation, Mesh};
use std::sync::Arc;

/// A mesh ready for use. Attributes are empty or one for every vertex.
#[derive(Clone, Debug, Default)]
pub struct TriMesh {
    /// In the space of the tree.
    pub positions: Vec<Vec3>,
    /// Shading normals, unit length.
    pub normals: Vec<Vec3>,
    /// Tangents with the sign of the bitangent n x t.
    pub tangents: Vec<(Vec3, f32)>,
    /// Texture coordinates by set.
    pub uvs: Vec<Vec<Vec2>>,
    /// Vertex colours.
    pub colors: Vec<[f32; 4]>,
    /// Corners.
    pub indices: Vec<[u32; 3]>,
    /// Further keys, already in the space of the tree.
    pub keys: Vec<MeshKey>,
    /// Time of `positions` where there are keys.
    pub first_time: f32,
}

/// One further key of a deforming mesh.
#[derive(Clone, Debug)]
pub struct MeshKey {
    /// Seconds.
    pub time: f32,
    /// One for every vertex.
    pub positions: Vec<Vec3>,
    /// One for every vertex, or empty.
    pub normals: Vec<Vec3>,
}

impl TriMesh {
    /// Places a mesh: positions and normals through `transform`, normals turned round where the
    /// orientation is reversed.
    pub fn new(mesh: &Mesh, transform: &glam::DAffine3, reverse: bool) -> TriMesh {
        let placed = *transform != glam::DAffine3::IDENTITY;
        let point = |p: &[f32; 3]| {
            if !placed {
                return Vec3::from_array(*p);
            }
            let q =
                transform.transform_point3(glam::DVec3::new(p[0] as f64, p[1] as f64, p[2] as f64));
            Vec3::new(q.x as f32, q.y as f32, q.z as f32)
        };
        let to_normal = transform.matrix3.inverse().transpose();
        let sign = if reverse { -1.0 } else { 1.0 };
        let normal = |n: &[f32; 3]| {
            let m = to_normal * glam::DVec3::new(n[0] as f64, n[1] as f64, n[2] as f64);
            let length = m.length_squared().sqrt();
            if length > 0.0 {
                let m = m / length * sign;
                Vec3::new(m.x as f32, m.y as f32, m.z as f32)
            } else {
                Vec3::ZERO
            }
        };
        // A mirror turns n x t round, and so do normals that are turned round themselves.
        let mirrored = transform.matrix3.determinant() < 0.0;
        let hand = if mirrored { -sign as f32 } else { sign as f32 };
        let tangent = |t: &[f32; 4]| {
            let m = transform.matrix3 * glam::DVec3::new(t[0] as f64, t[1] as f64, t[2] as f64);
            (Vec3::new(m.x as f32, m.y as f32, m.z as f32), t[3] * hand)
        };
        let deformation: Option<&Arc<Deformation>> = mesh.deformation.as_ref();
        TriMesh {
            positions: mesh.positions.iter().map(point).collect(),
            normals: mesh.normals.iter().map(normal).collect(),
            tangents: mesh.tangents.iter().map(tangent).collect(),
            uvs: mesh
                .uvs
                .iter()
                .map(|set| set.iter().map(|uv| Vec2::from_array(*uv)).collect())
                .collect(),
            colors: mesh.colors.to_vec(),
            indices: mesh.indices.to_vec(),
            first_time: deformation.map_or(0.0, |d| d.first_time as f32),
            keys: deformation.map_or(vec![], |d| {
                d.keys
                    .iter()
                    .map(|k| MeshKey {
                        time: k.time as f32,
                        positions: k.positions.iter().map(point).collect(),
                        normals: k.normals.iter().map(normal).collect(),
                    })
                    .collect()
            }),
        }
    }

    /// Corners of a triangle at rest.
    #[inline]
    pub fn corners(&self, triangle: u32) -> [Vec3; 3] {
        self.indices[triangle as usize].map(|i| self.positions[i as usize])
    }

    /// Corners of a triangle at a time.
    pub fn corners_at(&self, triangle: u32, time: f32) -> [Vec3; 3] {
        let (a, b, f) = self.keys_at(time);
        self.indices[triangle as usize].map(|i| {
            let at = |k: usize| self.key_positions(k)[i as usize];
            at(a) * (1.0 - f) + at(b) * f
        })
    }

    /// Normals of a triangle at a time; `None` without vertex normals.
    pub fn normals_at(&self, triangle: u32, time: f32) -> Option<[Vec3; 3]> {
        if self.normals.is_empty() {
            return None;
        }
        let corners = self.indices[triangle as usize];
        if self.keys.is_empty() {
            return Some(corners.map(|i| self.normals[i as usize]));
        }
        let (a, b, f) = self.keys_at(time);
        let at = |k: usize, i: u32| match k.checked_sub(1).map(|k| &self.keys[k].normals) {
            Some(normals) if !normals.is_empty() => normals[i as usize],
            _ => self.normals[i as usize],
        };
        Some(corners.map(|i| at(a, i) * (1.0 - f) + at(b, i) * f))
    }

    /// Tangent and bitangent at a point of a triangle with normal `n`, not of unit length; zero without
    /// tangents, and where the mesh deforms: its tangents are those of one moment.
    pub fn tangents_at(&self, triangle: u32, [u, v]: [f32; 2], n: Vec3) -> (Vec3, Vec3) {
        if self.tangents.is_empty() || !self.keys.is_empty() {
            return (Vec3::ZERO, Vec3::ZERO);
        }
        let corners = self.indices[triangle as usize];
        let [(a, sign), (b, _), (c, _)] = corners.map(|i| self.tangents[i as usize]);
        let t = a * (1.0 - u - v) + b * u + c * v;
        (t, n.cross(t) * sign)
    }

    /// Key before, key after and where between; key 0 is the mesh itself.
    fn keys_at(&self, time: f32) -> (usize, usize, f32) {
        let key_time = |k: usize| {
            if k == 0 {
                self.first_time
            } else {
                self.keys[k - 1].time
            }
        };
        let after = self.keys.partition_point(|k| k.time <= time) + 1;
        if time <= self.first_time || self.keys.is_empty() {
            (0, 0, 0.0)
        } else if after > self.keys.len() {
            (self.keys.len(), self.keys.len(), 0.0)
        } else {
            let (a, b) = (key_time(after - 1), key_time(after));
            (after - 1, after, (time - a) / (b - a))
        }
    }

    fn key_positions(&self, key: usize) -> &[Vec3] {
        if key == 0 {
            &self.positions
        } else {
            &self.keys[key - 1].positions
        }
    }

    /// Memory held.
    pub fn memory_bytes(&self) -> usize {
        self.positions.len() * 12
            + self.normals.len() * 12
            + self.tangents.len() * 16
            + self.uvs.iter().map(|u| u.len() * 8).sum::<usize>()
            + self.colors.len() * 16
            + self.indices.len() * 12
            + self
                .keys
                .iter()
                .map(|k| (k.positions.len() + k.normals.len()) * 12)
                .sum::<usize>()
    }
}
