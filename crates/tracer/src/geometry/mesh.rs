//! Triangle meshes in the space of their tree.

use glam::{Vec2, Vec3};
use rayon::prelude::*;
use scene::model::{Deformation, Mesh};
use std::collections::HashSet;
use std::sync::Arc;

/// A mesh ready for use. Attributes are empty or one for every vertex. Arrays that placing the mesh
/// leaves as they are belong to the description, too, and to every other placing of it.
#[derive(Clone, Debug, Default)]
pub struct TriMesh {
    /// In the space of the tree.
    pub positions: Arc<Vec<[f32; 3]>>,
    /// Shading normals, unit length.
    pub normals: Arc<Vec<[f32; 3]>>,
    /// Tangents with the sign of the bitangent n x t.
    pub tangents: Vec<(Vec3, f32)>,
    /// Texture coordinates by set.
    pub uvs: Vec<Arc<Vec<[f32; 2]>>>,
    /// Vertex colours.
    pub colors: Arc<Vec<[f32; 4]>>,
    /// Corners.
    pub indices: Arc<Vec<[u32; 3]>>,
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
    pub positions: Vec<[f32; 3]>,
    /// One for every vertex, or empty.
    pub normals: Vec<[f32; 3]>,
}

/// Vertices that one thread takes in one go.
const RUN: usize = 1 << 14;

/// Rows through a map; the same array where the map changes no bit.
fn through(
    rows: &Arc<Vec<[f32; 3]>>,
    map: impl Fn(&[f32; 3]) -> [f32; 3] + Sync + Send,
) -> Arc<Vec<[f32; 3]>> {
    let stays = |row: &[f32; 3]| map(row).map(f32::to_bits) == row.map(f32::to_bits);
    if rows.iter().all(stays) {
        return rows.clone();
    }
    Arc::new(rows.par_iter().with_min_len(RUN).map(map).collect())
}

impl TriMesh {
    /// Places a mesh: positions and normals through `transform`, normals turned round where the
    /// orientation is reversed.
    pub fn new(mesh: &Mesh, transform: &glam::DAffine3, reverse: bool) -> TriMesh {
        let placed = *transform != glam::DAffine3::IDENTITY;
        let point = |p: &[f32; 3]| {
            if !placed {
                return *p;
            }
            let q =
                transform.transform_point3(glam::DVec3::new(p[0] as f64, p[1] as f64, p[2] as f64));
            [q.x as f32, q.y as f32, q.z as f32]
        };
        let to_normal = transform.matrix3.inverse().transpose();
        let sign = if reverse { -1.0 } else { 1.0 };
        let normal = |n: &[f32; 3]| {
            let m = to_normal * glam::DVec3::new(n[0] as f64, n[1] as f64, n[2] as f64);
            let length = m.length_squared().sqrt();
            if length > 0.0 {
                let m = m / length * sign;
                [m.x as f32, m.y as f32, m.z as f32]
            } else {
                [0.0; 3]
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
            positions: through(&mesh.positions, point),
            normals: through(&mesh.normals, normal),
            tangents: mesh.tangents.iter().map(tangent).collect(),
            uvs: mesh.uvs.clone(),
            colors: mesh.colors.clone(),
            indices: mesh.indices.clone(),
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
        let positions = self.positions.as_slice();
        self.indices[triangle as usize].map(|i| Vec3::from_array(positions[i as usize]))
    }

    /// Texture coordinates of a triangle's corners; `None` without that set.
    #[inline]
    pub fn uvs_of(&self, set: usize, triangle: u32) -> Option<[Vec2; 3]> {
        let set = self.uvs.get(set)?.as_slice();
        Some(self.indices[triangle as usize].map(|i| Vec2::from_array(set[i as usize])))
    }

    /// Corners of a triangle at a time.
    pub fn corners_at(&self, triangle: u32, time: f32) -> [Vec3; 3] {
        let (a, b, f) = self.keys_at(time);
        self.indices[triangle as usize].map(|i| {
            let at = |k: usize| Vec3::from_array(self.key_positions(k)[i as usize]);
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
            return Some(corners.map(|i| Vec3::from_array(self.normals[i as usize])));
        }
        let (a, b, f) = self.keys_at(time);
        let at = |k: usize, i: u32| match k.checked_sub(1).map(|k| &self.keys[k].normals) {
            Some(normals) if !normals.is_empty() => Vec3::from_array(normals[i as usize]),
            _ => Vec3::from_array(self.normals[i as usize]),
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

    fn key_positions(&self, key: usize) -> &[[f32; 3]] {
        if key == 0 {
            &self.positions
        } else {
            &self.keys[key - 1].positions
        }
    }

    /// Memory held, without the arrays in `counted`, to which it adds its own: meshes share them.
    pub fn memory_bytes(&self, counted: &mut HashSet<usize>) -> usize {
        let mut shared = |at: usize, bytes: usize| if counted.insert(at) { bytes } else { 0 };
        let rows = [&self.positions, &self.normals];
        rows.map(|rows| shared(rows.as_ptr() as usize, rows.len() * 12))
            .iter()
            .sum::<usize>()
            + self.tangents.len() * 16
            + (self.uvs.iter())
                .map(|set| shared(set.as_ptr() as usize, set.len() * 8))
                .sum::<usize>()
            + shared(self.colors.as_ptr() as usize, self.colors.len() * 16)
            + shared(self.indices.as_ptr() as usize, self.indices.len() * 12)
            + self
                .keys
                .iter()
                .map(|k| (k.positions.len() + k.normals.len()) * 12)
                .sum::<usize>()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::{DAffine3, DVec3};

    fn described() -> Mesh {
        Mesh {
            positions: Arc::new(vec![[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, -0.0]]),
            normals: Arc::new(vec![[0.0, 0.0, 1.0]; 3]),
            uvs: vec![Arc::new(vec![[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]])],
            indices: Arc::new(vec![[0, 1, 2]]),
            ..Mesh::default()
        }
    }

    /// What placing does not change is shared, what it changes is not, and is placed.
    #[test]
    fn arrays_are_shared_where_placing_changes_nothing() {
        let mesh = described();
        let here = TriMesh::new(&mesh, &DAffine3::IDENTITY, false);
        assert!(Arc::ptr_eq(&here.positions, &mesh.positions));
        assert!(Arc::ptr_eq(&here.normals, &mesh.normals));

        let moved = DAffine3::from_translation(DVec3::new(1.0, 2.0, 3.0));
        let there = TriMesh::new(&mesh, &moved, true);
        assert_eq!(there.positions[1], [2.0, 2.0, 3.0]);
        assert_eq!(there.normals[0], [-0.0, -0.0, -1.0]);
        assert_eq!(mesh.positions[1], [1.0, 0.0, 0.0], "the description stays");
        for placed in [&here, &there] {
            assert!(Arc::ptr_eq(&placed.indices, &mesh.indices));
            assert!(Arc::ptr_eq(&placed.uvs[0], &mesh.uvs[0]));
        }

        let mut counted = HashSet::new();
        let (positions, normals, uvs, indices) = (36, 36, 24, 12);
        let first = here.memory_bytes(&mut counted);
        assert_eq!(first, positions + normals + uvs + indices);
        assert_eq!(here.memory_bytes(&mut counted), 0, "all of it is counted");
        assert_eq!(there.memory_bytes(&mut counted), positions + normals);
    }
}
