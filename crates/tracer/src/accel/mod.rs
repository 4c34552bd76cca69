//! What a ray can hit, and finding it.

pub mod aim;
pub mod build;
pub mod collapse;
pub mod few;
pub mod kernel;
pub mod node;
pub mod packet;
mod parts;
pub mod simd;
pub mod stream;

pub use few::Few;
use few::MOST_RAYS;
pub use simd::SimdLevel;

use crate::geometry::curves::CurveSet;
use crate::geometry::transform::Placement;
use crate::geometry::{Surface, TriMesh};
use crate::hash;
use crate::ray::{Hit, NONE, Ray};
use crate::texture::{Point, Textures};
use node::{Tree, TriBlock};
use std::collections::HashSet;

/// A placed group.
#[derive(Clone, Debug)]
pub struct Placed {
    /// Index into the groups.
    pub group: u32,
    /// Group to world.
    pub placement: Placement,
}

/// Everything that rays meet.
pub struct Geometry {
    /// Instructions of the kernels.
    pub level: SimdLevel,
    /// What is in the world directly, and the instances.
    pub world: Tree,
    /// Groups.
    pub groups: Vec<Tree>,
    /// Instances.
    pub instances: Vec<Placed>,
    /// Surfaces of all trees.
    pub surfaces: Vec<Surface>,
    /// Meshes of the surfaces.
    pub meshes: Vec<TriMesh>,
    /// Sets of curves of the surfaces.
    pub curves: Vec<CurveSet>,
    /// Textures (coverage is looked up while rays are traced).
    pub textures: Textures,
    /// Whether any surface has holes.
    pub has_alpha: bool,
    /// The world's primitives, if they are so few (and without holes) that arrays of rays need no tree.
    pub few: Option<Few>,
}

impl Geometry {
    /// The closest hit within the ray's end.
    #[inline]
    pub fn closest(&self, ray: &Ray) -> Hit {
        let mut hit = Hit::none(ray.t_max);
        simd::closest(self.level, self, ray, &mut hit);
        hit
    }

    /// Whether anything is hit before the ray's end.
    #[inline]
    pub fn occluded(&self, ray: &Ray) -> bool {
        simd::occluded(self.level, self, ray)
    }

    /// [`Geometry::closest`] for each of many rays, into as many hits.
    #[inline]
    pub fn closest_many(&self, rays: &[Ray], hits: &mut [Hit]) {
        if let Some(few) = self.few() {
            for (rays, hits) in rays.chunks(MOST_RAYS).zip(hits.chunks_mut(MOST_RAYS)) {
                for &at in few::closest(self.level, few, rays, hits).rays() {
                    hits[at as usize] = self.closest(&rays[at as usize]);
                }
            }
            return;
        }
        let in_flight = stream::pays(&self.world);
        simd::closest_many(self.level, self, rays, hits, in_flight);
    }

    /// [`Geometry::closest_many`] for rays that run much the same way as their neighbours, as a camera's do. The hits
    /// are the same.
    #[inline]
    pub fn closest_coherent(&self, rays: &[Ray], hits: &mut [Hit]) {
        if self.few().is_some() {
            return self.closest_many(rays, hits);
        }
        let in_flight = stream::pays(&self.world);
        simd::closest_coherent(self.level, self, rays, hits, in_flight);
    }

    /// [`Geometry::occluded`] for each of many rays.
    #[inline]
    pub fn occluded_many(&self, rays: &[Ray], blocked: &mut [bool]) {
        if let Some(few) = self.few() {
            let blocked = blocked.chunks_mut(MOST_RAYS);
            for (rays, blocked) in rays.chunks(MOST_RAYS).zip(blocked) {
                for &at in few::occluded(self.level, few, rays, blocked).rays() {
                    blocked[at as usize] = self.occluded(&rays[at as usize]);
                }
            }
            return;
        }
        let in_flight = stream::pays(&self.world);
        simd::occluded_many(self.level, self, rays, blocked, in_flight);
    }

    /// The primitives without a tree, where that is faster.
    #[inline]
    fn few(&self) -> Option<&Few> {
        self.few.as_ref().filter(|few| few.pays(self.level))
    }

    /// The tree that a hit's primitive belongs to.
    #[inline]
    pub fn tree(&self, instance: u32) -> &Tree {
        if instance == NONE {
            &self.world
        } else {
            &self.groups[self.instances[instance as usize].group as usize]
        }
    }

    /// The surface of a hit.
    #[inline]
    pub fn surface_of(&self, hit: &Hit) -> &Surface {
        let at = self.tree(hit.instance).prims[hit.prim as usize];
        &self.surfaces[at.surface as usize]
    }

    /// A block with one deforming triangle as it is at a time.
    #[cold]
    pub fn deformed_block(&self, tree: &Tree, prim: u32, time: f32) -> TriBlock {
        let at = tree.prims[prim as usize];
        let mesh = &self.meshes[self.surfaces[at.surface as usize].mesh as usize];
        let mut block = TriBlock::empty();
        block.set(0, mesh.corners_at(at.index, time), prim);
        block
    }

    /// Whether a surface with holes is there at a hit. The random number is keyed by the ray and the
    /// primitive, so that it depends neither on the visiting order nor on the tree.
    #[cold]
    #[inline(never)]
    pub fn is_solid(&self, tree: &Tree, hit: &Hit, ray: &Ray) -> bool {
        let at = tree.prims[hit.prim as usize];
        let surface = &self.surfaces[at.surface as usize];
        let Some(alpha) = surface.alpha else {
            return true;
        };
        let mut point = Point::default();
        if surface.curves != NONE {
            let piece = &self.curves[surface.curves as usize].pieces[at.index as usize];
            point.uv = [piece.uv(hit.u, hit.v); 2];
        } else if surface.mesh == NONE {
            let (shape, _) = &tree.quadrics[at.index as usize];
            let (origin, direction) = if hit.instance == NONE {
                (ray.origin, ray.direction)
            } else {
                let (_, from) = self.instances[hit.instance as usize].placement.at(ray.time);
                (from.point(ray.origin), from.vector(ray.direction))
            };
            let (p, n) = shape.point(origin, direction, hit.t);
            point.uv = [shape.parameters(p).uv; 2];
            point.n = n;
        } else {
            let mesh = &self.meshes[surface.mesh as usize];
            point.fill(mesh, at.index, hit.u, hit.v);
            if self.textures.directional {
                let [a, b, c] = if mesh.keys.is_empty() {
                    mesh.corners(at.index)
                } else {
                    mesh.corners_at(at.index, ray.time)
                };
                point.n = (b - a).cross(c - a);
            }
        }
        if self.textures.directional {
            if hit.instance != NONE {
                let (_, from) = self.instances[hit.instance as usize].placement.at(ray.time);
                point.n = from.transposed_vector(point.n);
            }
            point.n = crate::math::normalize(point.n);
        }
        point.p = ray.origin + ray.direction * hit.t;
        let alpha = self.textures.float(&alpha, &point);
        if alpha >= 1.0 {
            return true;
        }
        let mut key = hash::mix(hit.prim as u64 | (hit.instance as u64) << 32);
        for x in ray
            .origin
            .to_array()
            .into_iter()
            .chain(ray.direction.to_array())
        {
            key = hash::mix(key ^ x.to_bits() as u64);
        }
        hash::to_unit(key) < alpha
    }

    /// Memory held.
    pub fn memory_bytes(&self) -> usize {
        let mut counted = HashSet::new();
        self.world.memory_bytes()
            + self.groups.iter().map(Tree::memory_bytes).sum::<usize>()
            + self
                .meshes
                .iter()
                .map(|mesh| mesh.memory_bytes(&mut counted))
                .sum::<usize>()
            + self
                .curves
                .iter()
                .map(CurveSet::memory_bytes)
                .sum::<usize>()
            + self.instances.len() * size_of::<Placed>()
            + self.textures.memory_bytes()
    }
}

#[cfg(test)]
mod tests;
