//! Tangents by MikkTSpace, the method that normal maps are baked with. It works on the corners of
//! triangles; vertices whose corners disagree are split.

use crate::model::Mesh;
use bevy_mikktspace::{Geometry, Ops, TangentSpace, generate_tangents};
use std::collections::BTreeMap;
use std::sync::Arc;

/// Coordinates as they are: what [`generate`] takes where no map turns them.
pub(crate) const PLAIN: [f64; 6] = [1.0, 0.0, 0.0, 0.0, 1.0, 0.0];

/// Arithmetic that every machine does alike.
struct Software;

impl Ops for Software {
    fn sqrt(x: f32) -> f32 {
        // IEEE 754 fixes the square root.
        x.sqrt()
    }
    fn acos(x: f32) -> f32 {
        libm::acos(f64::from(x)) as f32
    }
}

struct Corners<'m> {
    mesh: &'m Mesh,
    /// By vertex; v points up.
    uvs: Vec<[f32; 2]>,
    /// By corner.
    tangents: Vec<[f32; 4]>,
}

impl Corners<'_> {
    fn vertex(&self, face: usize, corner: usize) -> usize {
        self.mesh.indices[face][corner] as usize
    }
}

impl Geometry<Software> for Corners<'_> {
    fn num_faces(&self) -> usize {
        self.mesh.indices.len()
    }
    fn num_vertices_of_face(&self, _: usize) -> usize {
        3
    }
    fn position(&self, face: usize, corner: usize) -> [f32; 3] {
        self.mesh.positions[self.vertex(face, corner)]
    }
    fn normal(&self, face: usize, corner: usize) -> [f32; 3] {
        self.mesh.normals[self.vertex(face, corner)]
    }
    fn tex_coord(&self, face: usize, corner: usize) -> [f32; 2] {
        self.uvs[self.vertex(face, corner)]
    }
    fn set_tangent(&mut self, space: Option<TangentSpace>, face: usize, corner: usize) {
        if let Some(space) = space {
            self.tangents[face * 3 + corner] = space.tangent_encoded();
        }
    }
}

/// Gives a mesh with texture coordinates tangents from one of its sets, seen through a matrix as in
/// [`crate::model::UvMap::Uv`]; one without normals becomes flat explicitly, each triangle with vertices
/// of its own. Returns which vertex each new one was.
pub(crate) fn generate(mesh: &mut Mesh, set: usize, m: &[f64; 6]) -> Vec<u32> {
    let flat = mesh.normals.is_empty().then(|| flatten(mesh));
    let placed = |uv: &[f32; 2]| {
        let [u, v] = uv.map(f64::from);
        [
            (m[0] * u + m[1] * v + m[2]) as f32,
            (m[3] * u + m[4] * v + m[5]) as f32,
        ]
    };
    let mut corners = Corners {
        uvs: match mesh.uvs.get(set) {
            Some(uvs) => uvs.iter().map(placed).collect(),
            None => vec![[0.0; 2]; mesh.positions.len()],
        },
        tangents: vec![[1.0, 0.0, 0.0, 1.0]; mesh.indices.len() * 3],
        mesh,
    };
    // Its error type has no values.
    let _ = generate_tangents(&mut corners);
    let by_corner = corners.tangents;
    // Bits, not numbers: zeros of either sign may differ, and nothing else compares wrongly.
    let mut made: BTreeMap<(u32, [u32; 4]), u32> = BTreeMap::new();
    let mut from: Vec<u32> = Vec::with_capacity(mesh.positions.len());
    let mut tangents = Vec::with_capacity(mesh.positions.len());
    let mut indices = mesh.indices.to_vec();
    for (corner, tangent) in indices.as_flattened_mut().iter_mut().zip(by_corner) {
        let key = (*corner, tangent.map(f32::to_bits));
        let next = from.len() as u32;
        let vertex = *made.entry(key).or_insert(next);
        if vertex == next {
            from.push(*corner);
            tangents.push(tangent);
        }
        *corner = vertex;
    }
    gather(mesh, &from);
    mesh.tangents = Arc::new(tangents);
    mesh.indices = Arc::new(indices);
    match flat {
        Some(flat) => from.iter().map(|&i| flat[i as usize]).collect(),
        None => from,
    }
}

/// Every corner its own vertex, with the normal of its triangle. Returns which vertex each was.
fn flatten(mesh: &mut Mesh) -> Vec<u32> {
    let from = mesh.indices.as_flattened().to_vec();
    let mut normals = Vec::with_capacity(from.len());
    for triangle in mesh.indices.iter() {
        let point = |i: u32| glam::Vec3::from_array(mesh.positions[i as usize]);
        let [a, b, c] = triangle.map(point);
        let normal = (b - a).cross(c - a).normalize_or_zero();
        normals.extend([normal.to_array(); 3]);
    }
    gather(mesh, &from);
    mesh.normals = Arc::new(normals);
    let triangles = from.len() as u32 / 3;
    mesh.indices = Arc::new(
        (0..triangles)
            .map(|i| [3 * i, 3 * i + 1, 3 * i + 2])
            .collect(),
    );
    from
}

/// New vertices from old ones.
fn gather(mesh: &mut Mesh, from: &[u32]) {
    fn rows<T: Copy>(list: &mut Arc<Vec<T>>, from: &[u32]) {
        if !list.is_empty() {
            *list = Arc::new(from.iter().map(|&i| list[i as usize]).collect());
        }
    }
    rows(&mut mesh.positions, from);
    rows(&mut mesh.normals, from);
    rows(&mut mesh.colors, from);
    for uv in &mut mesh.uvs {
        rows(uv, from);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Two triangles of a square; the second has its texture mirrored.
    fn square(mirrored: bool) -> Mesh {
        let flip = |u: f32| if mirrored { 2.0 - u } else { u };
        Mesh {
            positions: Arc::new(vec![
                [0.0, 0.0, 0.0],
                [1.0, 0.0, 0.0],
                [1.0, 1.0, 0.0],
                [0.0, 1.0, 0.0],
                [2.0, 0.0, 0.0],
            ]),
            normals: Arc::new(vec![[0.0, 0.0, 1.0]; 5]),
            uvs: vec![Arc::new(vec![
                [0.0, 0.0],
                [1.0, 0.0],
                [1.0, 1.0],
                [0.0, 1.0],
                [flip(2.0), 0.0],
            ])],
            indices: Arc::new(vec![[0, 1, 2], [0, 2, 3], [1, 4, 2]]),
            ..Mesh::default()
        }
    }

    #[test]
    fn tangents_follow_u_and_their_sign_follows_v() {
        let mut mesh = square(false);
        generate(&mut mesh, 0, &PLAIN);
        assert_eq!(mesh.positions.len(), 5);
        assert_eq!(*mesh.tangents, vec![[1.0, 0.0, 0.0, 1.0]; 5]);
        // u runs back in the third triangle: the corners that it shares are split.
        let mut mesh = square(true);
        generate(&mut mesh, 0, &PLAIN);
        assert_eq!(mesh.positions.len(), 7);
        let [a, _, _] = mesh.indices[2];
        assert_eq!(mesh.tangents[a as usize], [-1.0, 0.0, 0.0, -1.0]);
        assert_eq!(mesh.positions[a as usize], [1.0, 0.0, 0.0]);
    }

    #[test]
    fn tangents_follow_the_chosen_set_through_its_matrix() {
        let mut mesh = square(false);
        let first = mesh.uvs[0].clone();
        mesh.uvs = vec![Arc::new(vec![[0.0; 2]; 5]), first];
        // u' = v, v' = -u: the coordinates are turned by a quarter.
        generate(&mut mesh, 1, &[0.0, 1.0, 0.0, -1.0, 0.0, 0.0]);
        assert_eq!(*mesh.tangents, vec![[0.0, 1.0, 0.0, 1.0]; 5]);
    }

    #[test]
    fn flat_meshes_get_normals_of_their_own() {
        let mut mesh = square(false);
        mesh.normals = Arc::default();
        generate(&mut mesh, 0, &PLAIN);
        assert_eq!(mesh.positions.len(), 9);
        assert_eq!(*mesh.normals, vec![[0.0, 0.0, 1.0]; 9]);
    }
}
