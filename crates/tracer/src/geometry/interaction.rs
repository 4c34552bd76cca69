//! What is known about the point where a ray hits.

use crate::accel::Geometry;
use crate::math::{self, Frame};
use crate::ray::{Hit, NONE, Ray};
use crate::texture::Point;
use glam::{Vec2, Vec3};

/// A point on a surface, in world space.
#[derive(Clone, Copy, Debug)]
pub struct Interaction {
    /// Position, on the surface up to `error`.
    pub p: Vec3,
    /// Geometric normal, unit length, on the outside.
    pub ng: Vec3,
    /// Shading normal, unit length, on the side of `ng` up to interpolation.
    pub ns: Vec3,
    /// Derivatives of the position by the first texture coordinates.
    pub dpdu: Vec3,
    /// See `dpdu`.
    pub dpdv: Vec3,
    /// The mesh's own tangent and bitangent, of any length; zero where it has none.
    pub tangent: Vec3,
    /// See `tangent`.
    pub bitangent: Vec3,
    /// What textures depend on.
    pub point: Point,
    /// Index into the materials.
    pub material: u32,
    /// Index into the emissions, or [`NONE`].
    pub emission: u32,
    /// Index into the lights, or [`NONE`].
    pub light: u32,
    /// How far `p` may be from the surface beyond the rounding of its own coordinates.
    pub error: f32,
    /// Seconds.
    pub time: f32,
}

impl Interaction {
    /// Works out a hit. `tangents` asks for `dpdu`, `dpdv` and the mesh's own tangents.
    #[inline]
    pub fn new(
        geometry: &Geometry,
        light_of: &[u32],
        ray: &Ray,
        hit: &Hit,
        tangents: impl Fn(u32) -> bool,
    ) -> Self {
        let tree = geometry.tree(hit.instance);
        let at = tree.prims[hit.prim as usize];
        let surface = &geometry.surfaces[at.surface as usize];
        let mut point = Point::default();
        let (mut p, mut ng, mut ns);
        let (mut dpdu, mut dpdv) = (Vec3::ZERO, Vec3::ZERO);
        let (mut tangent, mut bitangent) = (Vec3::ZERO, Vec3::ZERO);
        let mut error = 0.0;
        let transforms = (hit.instance != NONE).then(|| {
            geometry.instances[hit.instance as usize]
                .placement
                .at(ray.time)
        });
        if surface.curves != NONE {
            let set = &geometry.curves[surface.curves as usize];
            let d = match &transforms {
                None => ray.direction,
                Some((_, from)) => from.vector(ray.direction),
            };
            let o = match &transforms {
                None => ray.origin,
                Some((_, from)) => from.point(ray.origin),
            };
            let q = set.pieces[at.index as usize].point(set.kind, hit.u, hit.v, d);
            p = o + d * hit.t;
            // Always the side that the ray sees: curves have no inside.
            (ng, ns) = (q.n, q.n);
            point.uv = [q.uv; 2];
            (dpdu, dpdv) = (q.dpdu, q.dpdv);
            // Rays start outside of the strand, which turns towards each of them.
            error = q.width;
        } else if surface.mesh == NONE {
            let (shape, _) = &tree.quadrics[at.index as usize];
            let (o, d) = match &transforms {
                None => (ray.origin, ray.direction),
                Some((_, from)) => (from.point(ray.origin), from.vector(ray.direction)),
            };
            let q = shape.point(o, d, hit.t);
            p = q.p;
            ng = if surface.flip { -q.n } else { q.n };
            ns = ng;
            point.uv = [q.uv; 2];
            (dpdu, dpdv) = (q.dpdu, q.dpdv);
            error = (shape.to_parent.t.abs().max_element() + math::length(dpdu)) * 4e-7;
        } else {
            let mesh = &geometry.meshes[surface.mesh as usize];
            let [a, b, c] = if mesh.keys.is_empty() {
                mesh.corners(at.index)
            } else {
                mesh.corners_at(at.index, ray.time)
            };
            let w = 1.0 - hit.u - hit.v;
            p = a * w + b * hit.u + c * hit.v;
            ng = math::normalize((b - a).cross(c - a));
            if surface.flip {
                ng = -ng;
            }
            ns = ng;
            if let Some([na, nb, nc]) = mesh.normals_at(at.index, ray.time) {
                let n = na * w + nb * hit.u + nc * hit.v;
                let length2 = n.dot(n);
                if length2 > 0.0 {
                    ns = n * (1.0 / length2.sqrt());
                    // Vertex normals decide which side is outside.
                    if ng.dot(ns) < 0.0 {
                        ng = -ng;
                    }
                }
            }
            point.fill(mesh, at.index, hit.u, hit.v);
            if tangents(surface.material) {
                (dpdu, dpdv) = derivatives(mesh, at.index, [a, b, c], ng);
                (tangent, bitangent) = mesh.tangents_at(at.index, [hit.u, hit.v], ns);
            }
        }
        if let Some((to, from)) = &transforms {
            p = to.point(p);
            if surface.curves != NONE {
                error = math::length(to.vector(dpdv));
            }
            error += to.t.abs().max_element().max(p.abs().max_element()) * 4e-7;
            ng = math::normalize(from.transposed_vector(ng));
            ns = math::normalize(from.transposed_vector(ns));
            dpdu = to.vector(dpdu);
            dpdv = to.vector(dpdv);
            tangent = to.vector(tangent);
            bitangent = to.vector(bitangent);
        }
        point.p = p;
        point.n = ng;
        let light = if surface.first_light == NONE || hit.instance != NONE {
            NONE
        } else if surface.mesh == NONE {
            light_of[surface.first_light as usize]
        } else {
            light_of[(surface.first_light + at.index) as usize]
        };
        Interaction {
            p,
            ng,
            ns,
            dpdu,
            dpdv,
            tangent,
            bitangent,
            point,
            material: surface.material,
            emission: surface.emission,
            light,
            error,
            time: ray.time,
        }
    }

    /// Directions in which the two axes of tangent-space maps run: the mesh's own tangents, else those
    /// of the texture coordinates.
    #[inline]
    pub fn map_axes(&self) -> (Vec3, Vec3) {
        if self.tangent == Vec3::ZERO {
            (self.dpdu, self.dpdv)
        } else {
            (self.tangent, self.bitangent)
        }
    }

    /// Where a ray that leaves in direction `w` starts: off the surface, on the side it goes to.
    #[inline]
    pub fn origin_towards(&self, w: Vec3) -> Vec3 {
        let n = if w.dot(self.ng) < 0.0 {
            -self.ng
        } else {
            self.ng
        };
        offset(self.p + n * self.error, n)
    }

    /// A ray that leaves in direction `w`.
    #[inline]
    pub fn spawn(&self, w: Vec3) -> Ray {
        Ray::new(self.origin_towards(w), w, self.time)
    }

    /// A ray to a point, which ends just before it.
    #[inline]
    pub fn spawn_to(&self, q: Vec3) -> Ray {
        let origin = self.origin_towards(q - self.p);
        Ray {
            origin,
            direction: q - origin,
            t_max: 0.9999,
            time: self.time,
        }
    }
}

/// Moves a point off a surface by a distance that follows the rounding of its coordinates: some
/// units in the last place where they are large, a fixed distance near zero [Waechter19].
#[inline]
pub fn offset(p: Vec3, n: Vec3) -> Vec3 {
    let axis = |p: f32, n: f32| {
        if p.abs() < 1.0 / 32.0 {
            p + n * (1.0 / 65_536.0)
        } else {
            let steps = (n * 256.0) as i32;
            f32::from_bits((p.to_bits() as i32 + if p < 0.0 { -steps } else { steps }) as u32)
        }
    };
    Vec3::new(axis(p.x, n.x), axis(p.y, n.y), axis(p.z, n.z))
}

/// Derivatives of the position by the texture coordinates of a triangle; any two directions in the
/// plane where there are no usable coordinates.
fn derivatives(
    mesh: &crate::geometry::TriMesh,
    triangle: u32,
    [a, b, c]: [Vec3; 3],
    ng: Vec3,
) -> (Vec3, Vec3) {
    let uv = match mesh.uvs.first() {
        Some(set) => mesh.indices[triangle as usize].map(|i| set[i as usize]),
        None => [Vec2::ZERO, Vec2::X, Vec2::ONE],
    };
    let (d1, d2) = (uv[1] - uv[0], uv[2] - uv[0]);
    let (e1, e2) = (b - a, c - a);
    let det = d1.x * d2.y - d1.y * d2.x;
    if det.abs() > 1e-18 {
        let s = 1.0 / det;
        ((e1 * d2.y - e2 * d1.y) * s, (e2 * d1.x - e1 * d2.x) * s)
    } else {
        math::coordinate_system(ng)
    }
}

/// The shading frame about `n` with its first axis along `tangent` where that is usable.
#[inline]
pub fn shading_frame(n: Vec3, tangent: Vec3) -> Frame {
    let t = tangent - n * n.dot(tangent);
    if t.dot(t) > 1e-16 * tangent.dot(tangent) && t.dot(t) > 0.0 {
        Frame::from_normal_tangent(n, t)
    } else {
        Frame::from_normal(n)
    }
}
