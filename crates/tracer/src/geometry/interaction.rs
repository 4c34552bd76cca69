//! What is known about the point where a ray hits.

use crate::accel::Geometry;
use crate::geometry::transform::Affine;
use crate::geometry::{Surface, TriMesh};
use crate::math::{self, Frame};
use crate::ray::{Hit, NONE, Ray};
use crate::texture::Point;
use glam::{Vec2, Vec3};

/// What is asked of an [`Interaction`] beyond the place and the normals.
#[derive(Clone, Copy, Debug)]
pub struct Needs {
    /// Texture coordinates and vertex colours.
    pub coordinates: bool,
    /// `dpdu` and `dpdv`.
    pub tangents: bool,
}

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
    /// How far rays start from the surface: safely more than what the rounding of `p`, and of
    /// intersecting the same surface once more, can amount to.
    pub error: f32,
    /// Seconds.
    pub time: f32,
}

/// [`Interaction::error`] over the size of the point's coordinates: 64 roundings of 2^-24.
pub(crate) const ROUNDING: f32 = 1.0 / 262_144.0;

/// The same over the size of the triangle: the corners that point and distance are computed from err by
/// a few roundings (as in [Pbrt4, 6.8]). No more than that, or a ground plane that is a thousand times
/// larger than what stands on it would lose contact.
pub(crate) const ROUNDING_OF_CORNERS: f32 = 1.0 / 4_194_304.0;

impl Interaction {
    /// Nowhere.
    pub const NONE: Interaction = Interaction {
        p: Vec3::ZERO,
        ng: Vec3::Z,
        ns: Vec3::Z,
        dpdu: Vec3::ZERO,
        dpdv: Vec3::ZERO,
        tangent: Vec3::ZERO,
        bitangent: Vec3::ZERO,
        point: Point::NONE,
        material: NONE,
        emission: NONE,
        light: NONE,
        error: 0.0,
        time: 0.0,
    };

    /// Works out a hit, in place: this is too large to be handed about. `self` is [`Interaction::NONE`].
    #[inline]
    pub fn find(
        &mut self,
        geometry: &Geometry,
        light_of: &[u32],
        ray: &Ray,
        hit: &Hit,
        needs: impl Fn(&Surface) -> Needs,
    ) {
        let tree = geometry.tree(hit.instance);
        let at = tree.prims[hit.prim as usize];
        let surface = &geometry.surfaces[at.surface as usize];
        let needs = needs(surface);
        self.material = surface.material;
        self.emission = surface.emission;
        self.time = ray.time;
        if surface.mesh != NONE {
            let mesh = &geometry.meshes[surface.mesh as usize];
            self.on_triangle(mesh, surface, at.index, hit, needs);
            if hit.instance != NONE {
                self.place(
                    geometry.instances[hit.instance as usize]
                        .placement
                        .at(ray.time),
                );
            }
        } else {
            self.on_other(geometry, surface, at.index, ray, hit, needs);
        }
        self.point.p = self.p;
        self.point.n = self.ng;
        if surface.first_light != NONE && hit.instance == NONE {
            let index = if surface.mesh == NONE { 0 } else { at.index };
            self.light = light_of[(surface.first_light + index) as usize];
        }
    }

    #[inline(always)]
    fn on_triangle(
        &mut self,
        mesh: &TriMesh,
        surface: &Surface,
        index: u32,
        hit: &Hit,
        needs: Needs,
    ) {
        let [a, b, c] = if mesh.keys.is_empty() {
            mesh.corners(index)
        } else {
            mesh.corners_at(index, self.time)
        };
        let w = 1.0 - hit.u - hit.v;
        let (e1, e2) = (b - a, c - a);
        self.p = a * w + b * hit.u + c * hit.v;
        let size = largest(e1) + largest(e2);
        self.error = largest(self.p) * ROUNDING + size * ROUNDING_OF_CORNERS;
        self.ng = math::normalize(e1.cross(e2));
        if surface.flip {
            self.ng = -self.ng;
        }
        self.ns = self.ng;
        if !mesh.normals.is_empty()
            && let Some([na, nb, nc]) = mesh.normals_at(index, self.time)
        {
            let n = na * w + nb * hit.u + nc * hit.v;
            let length2 = n.dot(n);
            if length2 > 0.0 {
                self.ns = n * (1.0 / length2.sqrt());
                // Vertex normals decide which side is outside.
                if self.ng.dot(self.ns) < 0.0 {
                    self.ng = -self.ng;
                }
            }
        }
        if needs.coordinates {
            self.point.fill(mesh, index, hit.u, hit.v);
        }
        if needs.tangents {
            (self.dpdu, self.dpdv) = derivatives(mesh, index, [a, b, c], self.ng);
            (self.tangent, self.bitangent) = mesh.tangents_at(index, [hit.u, hit.v], self.ns);
        }
    }

    /// Curves, spheres, disks.
    #[inline(never)]
    fn on_other(
        &mut self,
        geometry: &Geometry,
        surface: &Surface,
        index: u32,
        ray: &Ray,
        hit: &Hit,
        needs: Needs,
    ) {
        let transforms = (hit.instance != NONE).then(|| {
            geometry.instances[hit.instance as usize]
                .placement
                .at(ray.time)
        });
        let (o, d) = match &transforms {
            None => (ray.origin, ray.direction),
            Some((_, from)) => (from.point(ray.origin), from.vector(ray.direction)),
        };
        if surface.curves != NONE {
            let set = &geometry.curves[surface.curves as usize];
            let q = set.pieces[index as usize].point(set.kind, hit.u, hit.v, d);
            self.p = o + d * hit.t;
            // Always the side that the ray sees: curves have no inside.
            (self.ng, self.ns) = (q.n, q.n);
            self.point.uv = [q.uv; 2];
            (self.dpdu, self.dpdv) = (q.dpdu, q.dpdv);
            // Rays start outside of the strand, which turns towards each of them.
            self.error = q.width + largest(self.p) * ROUNDING;
        } else {
            let (shape, _) = &geometry.tree(hit.instance).quadrics[index as usize];
            let (p, n) = shape.point(o, d, hit.t);
            self.p = p;
            self.ng = if surface.flip { -n } else { n };
            self.ns = self.ng;
            if needs.coordinates {
                let q = shape.parameters(p);
                self.point.uv = [q.uv; 2];
                (self.dpdu, self.dpdv) = (q.dpdu, q.dpdv);
            }
            let center = shape.to_parent.t;
            self.error = (largest(p) + largest(center) + largest(p - center)) * ROUNDING;
        }
        if let Some(transforms) = transforms {
            self.place(transforms);
        }
    }

    /// From the space of a group to the world.
    #[inline]
    fn place(&mut self, (to, from): (Affine, Affine)) {
        self.p = to.point(self.p);
        // Nothing is stretched more than by this sum.
        let scale =
            largest(to.vector(Vec3::X)) + largest(to.vector(Vec3::Y)) + largest(to.vector(Vec3::Z));
        self.error = self.error * scale + (largest(to.t) + largest(self.p)) * ROUNDING;
        self.ng = math::normalize(from.transposed_vector(self.ng));
        self.ns = math::normalize(from.transposed_vector(self.ns));
        self.dpdu = to.vector(self.dpdu);
        self.dpdv = to.vector(self.dpdv);
        self.tangent = to.vector(self.tangent);
        self.bitangent = to.vector(self.bitangent);
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
        self.p + self.ng * self.error.copysign(math::dot(w, self.ng))
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

/// The largest magnitude of a component.
#[inline(always)]
pub(crate) fn largest(v: Vec3) -> f32 {
    let a = v.abs();
    let b = if a.x > a.y { a.x } else { a.y };
    if b > a.z { b } else { a.z }
}

/// Derivatives of the position by the texture coordinates of a triangle; any two directions in the
/// plane where there are no usable coordinates.
fn derivatives(mesh: &TriMesh, triangle: u32, [a, b, c]: [Vec3; 3], ng: Vec3) -> (Vec3, Vec3) {
    let uv = mesh.uvs_of(0, triangle);
    let uv = uv.unwrap_or([Vec2::ZERO, Vec2::X, Vec2::ONE]);
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
