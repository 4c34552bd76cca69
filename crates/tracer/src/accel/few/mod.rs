//! Worlds of few primitives: they lie in clusters, and rays that run alike are tested together, one a lane, against
//! all that a cluster holds, without a tree.
//!
//! The tests are those of the kernel, a ray in each lane instead of a triangle, and round as they do.

mod sort;
mod trace;

use super::SimdLevel;
use super::build::Bounds;
use super::node::Tree;
use crate::ray::NONE;
use glam::Vec3;
use std::ops::Range;

pub use sort::MOST_RAYS;
pub use trace::{closest, occluded};

/// Primitives of a cluster where there are several.
const CLUSTER: usize = 10;

/// Primitives up to which they are one cluster, which is not looked at from outside.
const ALONE: usize = 2 * CLUSTER;

/// What a world may cost at most; a sphere costs 1, a triangle 2.
const FEW: usize = 900;

/// The same with eight lanes.
const FEW_AVX2: usize = 400;

/// All primitives of a world.
#[derive(Clone, Debug)]
pub struct Few {
    /// Of the triangles of one cluster after another: each place once, as most are shared.
    corners: Vec<[f32; 3]>,
    triangles: Vec<Triangle>,
    spheres: Vec<Sphere>,
    clusters: Vec<Cluster>,
    /// Clusters from front to back, for rays that run mainly to greater x, smaller x, greater y ...
    orders: [Vec<u32>; 6],
}

/// Primitives that lie together.
#[derive(Clone, Debug)]
struct Cluster {
    bounds: Bounds,
    corners: Range<u32>,
    triangles: Range<u32>,
    spheres: Range<u32>,
}

#[derive(Clone, Copy, Debug)]
struct Triangle {
    /// Among the corners of the cluster.
    corners: [u32; 3],
    /// A small number, as a float, so that it fits into a lane.
    prim: f32,
}

#[derive(Clone, Copy, Debug)]
struct Sphere {
    center: Vec3,
    radius: f32,
    /// See [`Triangle::prim`].
    prim: f32,
}

/// A primitive that is yet to be put into a cluster.
#[derive(Clone, Copy)]
struct Item {
    bounds: Bounds,
    shape: Shape,
    prim: u32,
}

#[derive(Clone, Copy)]
enum Shape {
    Triangle([Vec3; 3]),
    Sphere(Vec3, f32),
}

impl Few {
    /// Of a tree of few solid triangles and round spheres; `None` for any other.
    pub fn new(tree: &Tree) -> Option<Few> {
        let is_simple =
            tree.deforming.is_empty() && tree.curves.is_empty() && tree.instances.is_empty();
        if !is_simple || tree.prims.len() > FEW || tree.prims.is_empty() {
            return None;
        }
        let mut items = vec![];
        for block in &tree.blocks {
            for (lane, &prim) in block.prims.iter().enumerate().filter(|(_, p)| **p != NONE) {
                let corners = [0, 1, 2]
                    .map(|c| Vec3::from([0, 1, 2].map(|axis| block.corners[c][axis][lane])));
                items.push(Item {
                    bounds: Bounds::of(corners),
                    shape: Shape::Triangle(corners),
                    prim,
                });
            }
        }
        for (shape, prim) in &tree.quadrics {
            let (center, radius) = shape.sphere()?;
            items.push(Item {
                bounds: shape.bounds(),
                shape: Shape::Sphere(center, radius),
                prim: *prim,
            });
        }
        // A primitive may lie in several leaves.
        items.sort_by_key(|item| item.prim);
        items.dedup_by_key(|item| item.prim);
        let mut few = Few {
            corners: vec![],
            triangles: vec![],
            spheres: vec![],
            clusters: vec![],
            orders: Default::default(),
        };
        if items.len() <= ALONE {
            few.gather(&mut items);
        } else {
            few.divide(&mut items);
        }
        few.orders = std::array::from_fn(|direction| few.order(direction / 2, direction % 2 == 1));
        Some(few)
    }

    /// Clusters by their centres along an axis.
    fn order(&self, axis: usize, backward: bool) -> Vec<u32> {
        let along = |c: &u32| self.clusters[*c as usize].bounds.center()[axis];
        let mut order: Vec<u32> = (0..self.clusters.len() as u32).collect();
        order.sort_by(|a, b| along(a).total_cmp(&along(b)));
        if backward {
            order.reverse();
        }
        order
    }

    /// Whether it is faster than a tree, as it is with lanes.
    #[inline]
    pub fn pays(&self, level: SimdLevel) -> bool {
        let cost = 2 * self.triangles.len() + self.spheres.len();
        match level {
            SimdLevel::Scalar | SimdLevel::Sse2 => false,
            SimdLevel::Avx2 => cost <= FEW_AVX2,
            SimdLevel::Avx512 => cost <= FEW,
        }
    }

    /// Makes clusters of primitives, dividing what is too many where the surfaces of the boxes, each for as many clusters
    /// as it will hold, are least.
    fn divide(&mut self, items: &mut [Item]) {
        if items.len() <= CLUSTER {
            return self.gather(items);
        }
        let mut best = (f32::INFINITY, 0, items.len() / 2);
        for axis in 0..3 {
            sort_along(items, axis);
            let mut right = Bounds::default();
            let mut areas = vec![0.0; items.len()];
            for at in (1..items.len()).rev() {
                right = right.union(items[at].bounds);
                areas[at] = area(&right);
            }
            let mut left = Bounds::default();
            for at in 1..items.len() {
                left = left.union(items[at - 1].bounds);
                let count = |n: usize| n.div_ceil(CLUSTER) as f32;
                let cost = area(&left) * count(at) + areas[at] * count(items.len() - at);
                if cost < best.0 {
                    best = (cost, axis, at);
                }
            }
        }
        let (_, axis, at) = best;
        sort_along(items, axis);
        let (left, right) = items.split_at_mut(at);
        self.divide(left);
        self.divide(right);
    }

    /// Makes a cluster.
    fn gather(&mut self, items: &mut [Item]) {
        // Of equal hits that of the first primitive counts, which has to come last here.
        items.sort_by_key(|item| std::cmp::Reverse(item.prim));
        let [first, triangle, sphere] =
            [self.corners.len(), self.triangles.len(), self.spheres.len()];
        for item in &*items {
            let prim = item.prim as f32;
            match item.shape {
                Shape::Triangle(corners) => {
                    let corners = corners.map(|p| self.corner(first, p.to_array()));
                    self.triangles.push(Triangle { corners, prim });
                }
                Shape::Sphere(center, radius) => self.spheres.push(Sphere {
                    center,
                    radius,
                    prim,
                }),
            }
        }
        self.clusters.push(Cluster {
            bounds: items
                .iter()
                .fold(Bounds::default(), |b, i| b.union(i.bounds)),
            corners: first as u32..self.corners.len() as u32,
            triangles: triangle as u32..self.triangles.len() as u32,
            spheres: sphere as u32..self.spheres.len() as u32,
        });
    }

    /// Index of a corner among those from `first` on, by the bits of its coordinates.
    fn corner(&mut self, first: usize, p: [f32; 3]) -> u32 {
        let bits = p.map(f32::to_bits);
        let known = self.corners[first..]
            .iter()
            .position(|q| q.map(f32::to_bits) == bits);
        known.unwrap_or_else(|| {
            self.corners.push(p);
            self.corners.len() - 1 - first
        }) as u32
    }
}

/// By the centres, equal ones by the primitive.
fn sort_along(items: &mut [Item], axis: usize) {
    items.sort_by(|a, b| {
        let at = |i: &Item| i.bounds.center()[axis];
        at(a).total_cmp(&at(b)).then(a.prim.cmp(&b.prim))
    });
}

/// Half the surface of a box.
fn area(bounds: &Bounds) -> f32 {
    let d = bounds.max - bounds.min;
    d.x * d.y + d.y * d.z + d.z * d.x
}

#[cfg(test)]
mod tests;
