//! Meshes: counts, indices, numbers.

use super::Findings;
use crate::model::{Mesh, SceneDesc};
use std::sync::Arc;

fn finite<const N: usize>(rows: &[[f32; N]]) -> bool {
    rows.iter().flatten().all(|x| x.is_finite())
}

pub(super) fn meshes(desc: &SceneDesc, found: &mut Findings) {
    // A mesh that lost all its triangles is no longer used by anything.
    let mut used = vec![false; desc.meshes.len()];
    let groups = desc.groups.iter().flat_map(|g| &g.primitives);
    for primitive in desc.primitives.iter().chain(groups) {
        if let crate::model::Shape::Mesh(id) = primitive.shape
            && let Some(used) = used.get_mut(id.index())
        {
            *used = true;
        }
    }
    for (mesh, used) in desc.meshes.iter().zip(used) {
        check(mesh, used, found);
    }
}

fn check(mesh: &Mesh, used: bool, found: &mut Findings) {
    let name = &mesh.name;
    let count = mesh.positions.len();
    found.check(!used || !mesh.indices.is_empty(), || {
        format!("mesh {name:?} is empty")
    });
    let mut length = |what: &str, length: usize| {
        found.check(length == 0 || length == count, || {
            format!("mesh {name:?}: {length} {what} for {count} vertices")
        });
    };
    length("normals", mesh.normals.len());
    length("tangents", mesh.tangents.len());
    length("colours", mesh.colors.len());
    mesh.uvs
        .iter()
        .for_each(|uvs| length("texture coordinates", uvs.len()));
    let numbers = finite(&mesh.positions)
        && finite(&mesh.normals)
        && finite(&mesh.tangents)
        && finite(&mesh.colors)
        && mesh.uvs.iter().all(|uvs| finite(uvs));
    found.check(numbers, || {
        format!("mesh {name:?}: numbers that are not finite")
    });
    if let Some(bad) = mesh
        .indices
        .iter()
        .flatten()
        .find(|&&i| i as usize >= count)
    {
        found.error(format!(
            "mesh {name:?}: index {bad}, but there are only {count} vertices"
        ));
    }
    if let Some(deformation) = &mesh.deformation {
        let mut before = deformation.first_time;
        for key in &deformation.keys {
            found.check(before < key.time && key.time.is_finite(), || {
                format!("mesh {name:?}: the times of its keys do not rise")
            });
            before = key.time;
            let lengths = key.positions.len() == count && [0, count].contains(&key.normals.len());
            found.check(lengths, || {
                format!("mesh {name:?}: a key with another number of vertices")
            });
            found.check(finite(&key.positions) && finite(&key.normals), || {
                format!("mesh {name:?}: a key with numbers that are not finite")
            });
        }
    }
}

/// Removes triangles without area; returns how many.
pub(super) fn drop_degenerate(mesh: &mut Mesh) -> usize {
    let positions = &mesh.positions;
    let moves = mesh.deformation.is_some();
    let flat = |&[a, b, c]: &[u32; 3]| -> bool {
        if a == b || b == c || c == a {
            return true;
        }
        let point = |i: u32| {
            positions
                .get(i as usize)
                .map(|p| glam::DVec3::from_array(p.map(f64::from)))
        };
        match (point(a), point(b), point(c)) {
            // Differences and products of singles are exact enough in double that only true zeros give zero.
            (Some(a), Some(b), Some(c)) => !moves && (b - a).cross(c - a) == glam::DVec3::ZERO,
            _ => false,
        }
    };
    let dropped = mesh.indices.iter().filter(|t| flat(t)).count();
    if dropped > 0 {
        let kept = mesh.indices.iter().copied().filter(|t| !flat(t)).collect();
        mesh.indices = Arc::new(kept);
    }
    dropped
}
