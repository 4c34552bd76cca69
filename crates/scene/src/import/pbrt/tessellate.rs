//! Triangles for shapes that the model has no word for. Normals are exact, positions lie on the
//! surface, so only the outline shows corners.

use crate::model::Mesh;
use std::sync::Arc;

/// Steps around a full turn: corners are 3e-4 of the radius off the circle.
const AROUND: u32 = 128;

struct Vertex {
    position: [f64; 3],
    normal: Option<[f64; 3]>,
    uv: [f64; 2],
}

/// A grid over [0, 1]^2; the normal is that of dp/du x dp/dv.
fn grid(nu: u32, nv: u32, at: impl Fn(f64, f64) -> Vertex) -> Mesh {
    let (mut positions, mut normals, mut uvs, mut indices) =
        (Vec::new(), Vec::new(), Vec::new(), Vec::new());
    for j in 0..=nv {
        for i in 0..=nu {
            let vertex = at(f64::from(i) / f64::from(nu), f64::from(j) / f64::from(nv));
            positions.push(vertex.position.map(|x| x as f32));
            normals.extend(vertex.normal.map(|n| n.map(|x| x as f32)));
            uvs.push(vertex.uv.map(|x| x as f32));
        }
    }
    for j in 0..nv {
        for i in 0..nu {
            let a = j * (nu + 1) + i;
            let (b, c, d) = (a + 1, a + nu + 2, a + nu + 1);
            // Rows that meet in a pole give triangles without area.
            let differ = |x: u32, y: u32| positions[x as usize] != positions[y as usize];
            if differ(a, b) && differ(b, c) {
                indices.push([a, b, c]);
            }
            if differ(c, d) && differ(d, a) {
                indices.push([a, c, d]);
            }
        }
    }
    Mesh {
        positions: Arc::new(positions),
        normals: Arc::new(normals),
        uvs: vec![Arc::new(uvs)],
        indices: Arc::new(indices),
        ..Mesh::default()
    }
}

fn steps(phi_max: f64) -> u32 {
    (libm::ceil(phi_max.min(360.0) / 360.0 * f64::from(AROUND)) as u32).max(3)
}

fn turn(u: f64, phi_max: f64) -> (f64, f64) {
    let phi = (u * phi_max.min(360.0)).to_radians();
    (libm::cos(phi), libm::sin(phi))
}

/// A part of a sphere; v goes from the south.
pub(super) fn sphere(radius: f64, z: (f64, f64), phi_max: f64) -> Mesh {
    let theta = |z: f64| libm::acos((z / radius).clamp(-1.0, 1.0));
    let (south, north) = (theta(z.0), theta(z.1));
    grid(steps(phi_max), AROUND / 2, |u, v| {
        let (cos_phi, sin_phi) = turn(u, phi_max);
        let t = south + (north - south) * v;
        let mut sin_t = libm::sin(t);
        if libm::fabs(sin_t) < 1e-12 {
            sin_t = 0.0;
        }
        let normal = [sin_t * cos_phi, sin_t * sin_phi, libm::cos(t)];
        Vertex {
            position: normal.map(|n| n * radius),
            normal: Some(normal),
            uv: [u, v],
        }
    })
}

/// A part of a disk; v is 0 at the rim.
pub(super) fn disk(radius: f64, inner: f64, height: f64, phi_max: f64) -> Mesh {
    grid(steps(phi_max), 1, |u, v| {
        let (cos_phi, sin_phi) = turn(u, phi_max);
        let r = radius + (inner - radius) * v;
        // dp/du x dp/dv points up: v runs inwards.
        Vertex {
            position: [r * cos_phi, r * sin_phi, height],
            normal: None,
            uv: [u, v],
        }
    })
}

/// A cylinder without caps.
pub(super) fn cylinder(radius: f64, z: (f64, f64), phi_max: f64) -> Mesh {
    grid(steps(phi_max), 1, |u, v| {
        let (cos_phi, sin_phi) = turn(u, phi_max);
        Vertex {
            position: [radius * cos_phi, radius * sin_phi, z.0 + (z.1 - z.0) * v],
            normal: Some([cos_phi, sin_phi, 0.0]),
            uv: [u, v],
        }
    })
}

fn lerp<const N: usize>(corners: [[f32; N]; 4], u: f64, v: f64) -> [f64; N] {
    let weights = [(1.0 - u) * (1.0 - v), u * (1.0 - v), (1.0 - u) * v, u * v];
    std::array::from_fn(|axis| {
        corners
            .iter()
            .zip(weights)
            .map(|(c, w)| f64::from(c[axis]) * w)
            .sum()
    })
}

/// Bilinear patches: corners at (0,0), (1,0), (0,1), (1,1). Flat ones become two triangles. The second
/// part says whether there was one that is not flat.
pub(super) fn bilinear(
    patches: &[[u32; 4]],
    positions: &[[f32; 3]],
    normals: &[[f32; 3]],
    uvs: &[[f32; 2]],
) -> (Mesh, bool) {
    let mut out = (Vec::new(), Vec::new(), Vec::new(), Vec::new());
    let mut any_bent = false;
    for patch in patches {
        let corner = |rows: &[[f32; 3]]| patch.map(|i| rows[i as usize]);
        let p = corner(positions);
        let bent = is_bent(&p);
        any_bent |= bent;
        let uv = if uvs.is_empty() {
            [[0.0, 0.0], [1.0, 0.0], [0.0, 1.0], [1.0, 1.0]]
        } else {
            patch.map(|i| uvs[i as usize])
        };
        let n = (!normals.is_empty()).then(|| corner(normals));
        let cells = if bent { 8 } else { 1 };
        let mesh = grid(cells, cells, |u, v| Vertex {
            position: lerp(p, u, v),
            normal: n
                .map(|n| lerp(n, u, v))
                .or_else(|| bent.then(|| patch_normal(&p, u, v))),
            uv: lerp(uv, u, v),
        });
        let base = out.0.len() as u32;
        // Normals are for all patches or for none; flat ones among bent ones get theirs too.
        let own: Vec<[f32; 3]> = if mesh.normals.is_empty() {
            mesh.uvs[0]
                .iter()
                .map(|_| patch_normal(&p, 0.5, 0.5).map(|x| x as f32))
                .collect()
        } else {
            mesh.normals.to_vec()
        };
        out.0.extend(mesh.positions.iter());
        out.1.extend(own);
        out.2.extend(mesh.uvs[0].iter());
        out.3
            .extend(mesh.indices.iter().map(|t| t.map(|i| i + base)));
    }
    if normals.is_empty() && !any_bent {
        out.1.clear();
    }
    let mesh = Mesh {
        positions: Arc::new(out.0),
        normals: Arc::new(out.1),
        uvs: vec![Arc::new(out.2)],
        indices: Arc::new(out.3),
        ..Mesh::default()
    };
    (mesh, any_bent)
}

fn edges(p: &[[f32; 3]; 4]) -> [glam::DVec3; 4] {
    p.map(|p| glam::DVec3::from_array(p.map(f64::from)))
}

fn is_bent(p: &[[f32; 3]; 4]) -> bool {
    let [a, b, c, d] = edges(p);
    let (u, v, w) = (b - a, c - a, d - a);
    // The volume of the corner tetrahedron against the size of its edges.
    libm::fabs(u.cross(v).dot(w)) > 1e-5 * u.length() * v.length() * w.length()
}

fn patch_normal(p: &[[f32; 3]; 4], u: f64, v: f64) -> [f64; 3] {
    let [a, b, c, d] = edges(p);
    let du = (b - a) * (1.0 - v) + (d - c) * v;
    let dv = (c - a) * (1.0 - u) + (d - b) * u;
    du.cross(dv).normalize_or(glam::DVec3::Z).to_array()
}
