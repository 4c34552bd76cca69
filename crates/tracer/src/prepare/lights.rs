//! Shining surfaces as lights that can be sampled.

use super::trees::Placing;
use crate::accel::node::PrimRef;
use crate::geometry::quadric::QuadricKind;
use crate::geometry::{Surface, TriMesh};
use crate::light::{AreaLight, AreaShape, Light};
use crate::math;
use crate::ray::NONE;
use ::scene::model::{ColorTex, FloatTex, SceneDesc};
use glam::{Vec2, Vec3};

/// Lights of the shining surfaces of the world, the light of each of their primitives, and the
/// surfaces with `first_light` filled in. What shines inside a group, has holes, or is a sphere that
/// is not round, is found by scattered rays alone; what cannot be seen at all, by sampling alone.
pub fn areas(_desc: &SceneDesc, placed: &Placing) -> (Vec<Light>, Vec<u32>, Vec<Surface>) {
    let mut surfaces = placed.surfaces.clone();
    let mut lights = vec![];
    let mut light_of = vec![];
    let prims = &placed.world.prims;
    let mut i = 0;
    while i < prims.len() {
        let surface_index = prims[i].surface as usize;
        let count = prims[i..]
            .iter()
            .take_while(|p| p.surface as usize == surface_index)
            .count();
        let run = &prims[i..i + count];
        i += count;
        let surface = &mut surfaces[surface_index];
        let holes = surface.alpha.is_some_and(|a| a != FloatTex::Const(0.0));
        if surface.emission == NONE || holes {
            continue;
        }
        let emission = &placed.emissions[surface.emission as usize];
        let dark =
            emission.scale == 0.0 || matches!(emission.radiance, ColorTex::Const([0.0, 0.0, 0.0]));
        if dark {
            continue;
        }
        let plain = matches!(emission.radiance, ColorTex::Const(_));
        surface.first_light = light_of.len() as u32;
        if surface.mesh == NONE {
            light_of.push(quadric(placed, surface, run[0], plain, &mut lights));
        } else {
            let mesh = &placed.meshes[surface.mesh as usize];
            triangles(mesh, surface, plain, &mut lights, &mut light_of);
        }
    }
    (lights, light_of, surfaces)
}

fn quadric(
    placed: &Placing,
    surface: &Surface,
    prim: PrimRef,
    plain: bool,
    lights: &mut Vec<Light>,
) -> u32 {
    let (shape, _) = &placed.world.quadrics[prim.index as usize];
    let sampled = match shape.kind {
        QuadricKind::Sphere { .. } => {
            shape
                .as_round_sphere()
                .map(|(center, radius)| AreaShape::Sphere {
                    center,
                    radius,
                    inward: surface.flip,
                    local: (!plain).then(|| Box::new(shape.from_parent)),
                })
        }
        QuadricKind::Disk {
            radius,
            inner,
            height,
        } => {
            let m = &shape.to_parent;
            let (a, b) = (m.m[0] * radius, m.m[1] * radius);
            let normal = shape.from_parent.transposed_vector(Vec3::Z);
            let n = math::normalize(normal) * if surface.flip { -1.0 } else { 1.0 };
            let hole = inner / radius;
            let area = math::length(a.cross(b)) * math::PI * (1.0 - hole * hole);
            let center = m.point(Vec3::new(0.0, 0.0, height));
            Some(AreaShape::Disk {
                center,
                a,
                b,
                n,
                area,
                hole,
            })
        }
    };
    match sampled {
        None => NONE,
        Some(shape) => {
            lights.push(Light::Area(AreaLight {
                shape,
                emission: surface.emission,
                unseen: surface.alpha.is_some(),
            }));
            lights.len() as u32 - 1
        }
    }
}

fn triangles(
    mesh: &TriMesh,
    surface: &Surface,
    plain: bool,
    lights: &mut Vec<Light>,
    light_of: &mut Vec<u32>,
) {
    if !mesh.keys.is_empty() {
        light_of.extend(std::iter::repeat_n(NONE, mesh.indices.len()));
        return;
    }
    let count = mesh.indices.len() as u32;
    let mut t = 0;
    while t < count {
        let (n, area) = normal(mesh, surface, t);
        let shape = if plain && t + 1 < count {
            parallelogram(mesh, surface, t)
        } else {
            None
        };
        let covered = if shape.is_some() { 2 } else { 1 };
        let shape = shape.unwrap_or_else(|| {
            let [a, b, c] = mesh.corners(t);
            let uv = mesh.uvs_of(0, t);
            let uv = uv.unwrap_or([Vec2::ZERO, Vec2::X, Vec2::ONE]);
            AreaShape::Triangle {
                p: a,
                e1: b - a,
                e2: c - a,
                n,
                area,
                uv,
            }
        });
        let light = if area > 0.0 {
            lights.push(Light::Area(AreaLight {
                shape,
                emission: surface.emission,
                unseen: surface.alpha.is_some(),
            }));
            lights.len() as u32 - 1
        } else {
            NONE
        };
        light_of.extend(std::iter::repeat_n(light, covered as usize));
        t += covered;
    }
}

/// Geometric normal on the outside, as hits see it, and the area.
fn normal(mesh: &TriMesh, surface: &Surface, t: u32) -> (Vec3, f32) {
    let [a, b, c] = mesh.corners(t);
    let cross = (b - a).cross(c - a);
    let length = math::length(cross);
    if length == 0.0 {
        return (Vec3::Z, 0.0);
    }
    let mut n = cross * (1.0 / length);
    if surface.flip {
        n = -n;
    }
    if let Some([na, nb, nc]) = mesh.normals_at(t, 0.0)
        && n.dot(na + nb + nc) < 0.0
    {
        n = -n;
    }
    (n, 0.5 * length)
}

/// Triangles `t` and `t + 1` as one parallelogram, if they are one: one light of two triangles is
/// sampled with better spread points than two.
fn parallelogram(mesh: &TriMesh, surface: &Surface, t: u32) -> Option<AreaShape> {
    let (first, second) = (mesh.corners(t), mesh.corners(t + 1));
    let lone = |of: &[Vec3; 3], other: &[Vec3; 3]| {
        let alone: Vec<usize> = (0..3).filter(|i| !other.contains(&of[*i])).collect();
        if let [one] = alone[..] {
            Some(one)
        } else {
            None
        }
    };
    let (i, j) = (lone(&first, &second)?, lone(&second, &first)?);
    let p = first[i];
    let (e1, e2) = (first[(i + 1) % 3] - p, first[(i + 2) % 3] - p);
    let far = second[j];
    let size = e1.abs().max(e2.abs()).max_element();
    let closes = (p + e1 + e2 - far).abs().max_element() <= size * 1e-5;
    let ((n, a), (m, b)) = (normal(mesh, surface, t), normal(mesh, surface, t + 1));
    let flat = n.dot(m) > 0.999_99 && (a - b).abs() <= 1e-4 * a;
    (closes && flat && a > 0.0).then_some(AreaShape::Parallelogram {
        p,
        e1,
        e2,
        n,
        area: a + b,
    })
}
