//! The wide tree as it lies in memory.

use crate::geometry::curves::CurvePart;
use crate::geometry::quadric::Quadric;

/// A node with up to eight children, 256 bytes.
#[derive(Clone, Debug)]
#[repr(C, align(64))]
pub struct Node {
    /// Bounds of the children: min x, max x, min y, max y, min z, max z. An empty slot holds an
    /// inverted box, which no ray enters.
    pub bounds: [[f32; 8]; 6],
    /// What the children are; see [`leaf`].
    pub children: [u32; 8],
    /// Nothing yet; there so that every byte has a value.
    pub spare: [u32; 8],
}

impl Node {
    /// Eight empty slots.
    pub fn empty() -> Node {
        let (lo, hi) = ([f32::MAX; 8], [-f32::MAX; 8]);
        Node {
            bounds: [lo, hi, lo, hi, lo, hi],
            children: [EMPTY; 8],
            spare: [0; 8],
        }
    }
}

/// Marks a leaf; the other bits of a word without it are the index of a node.
pub const LEAF: u32 = 1 << 31;
/// A leaf with nothing in it.
pub const EMPTY: u32 = u32::MAX;
/// Index of what a leaf holds, within the list for its kind.
pub const INDEX_MASK: u32 = (1 << 28) - 1;
/// Where the kind is in a leaf's word.
const KIND_SHIFT: u32 = 28;

/// What a leaf holds.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u32)]
pub enum LeafKind {
    /// One block of up to four triangles.
    Triangles = 0,
    /// One sphere or disk.
    Quadric = 1,
    /// One placed group.
    Instance = 2,
    /// One deforming triangle.
    Deforming = 3,
    /// One part of a curve.
    Curve = 4,
    /// Two blocks of triangles, one after the other.
    Pair = 5,
    /// One block of up to four round spheres.
    Balls = 6,
}

/// The word of a leaf.
pub fn leaf(kind: LeafKind, index: usize) -> u32 {
    LEAF | (kind as u32) << KIND_SHIFT | index as u32
}

/// The kind in a leaf's word (as the number of a [`LeafKind`]).
#[inline(always)]
pub fn leaf_kind(word: u32) -> u32 {
    (word >> KIND_SHIFT) & 7
}

/// Four triangles, one coordinate of one corner at a time. Unused lanes repeat a point, which no ray
/// hits.
#[derive(Clone, Debug)]
#[repr(C, align(32))]
pub struct TriBlock {
    /// Corner, axis, lane.
    pub corners: [[[f32; 4]; 3]; 3],
    /// Primitive of each lane.
    pub prims: [u32; 4],
}

impl TriBlock {
    /// Nothing in any lane.
    pub fn empty() -> TriBlock {
        TriBlock {
            corners: [[[0.0; 4]; 3]; 3],
            prims: [u32::MAX; 4],
        }
    }
    /// Puts a triangle into a lane.
    pub fn set(&mut self, lane: usize, corners: [glam::Vec3; 3], prim: u32) {
        for (to, from) in self.corners.iter_mut().zip(corners) {
            for (axis, x) in from.to_array().into_iter().enumerate() {
                to[axis][lane] = x;
            }
        }
        self.prims[lane] = prim;
    }
}

/// Four round spheres, one number at a time. Unused lanes have squared radii below zero, which
/// no ray meets.
#[derive(Clone, Debug)]
#[repr(C, align(16))]
pub struct BallBlock {
    /// Centres, by axis.
    pub centers: [[f32; 4]; 3],
    /// Squares of the radii; negative where there is no sphere.
    pub squares: [f32; 4],
    /// Primitive of each lane.
    pub prims: [u32; 4],
}

impl BallBlock {
    /// Nothing in any lane.
    pub fn empty() -> BallBlock {
        BallBlock {
            centers: [[0.0; 4]; 3],
            squares: [-1.0; 4],
            prims: [u32::MAX; 4],
        }
    }
    /// Puts a sphere into a lane.
    pub fn set(&mut self, lane: usize, center: glam::Vec3, radius: f32, prim: u32) {
        for (to, x) in self.centers.iter_mut().zip(center.to_array()) {
            to[lane] = x;
        }
        self.squares[lane] = radius * radius;
        self.prims[lane] = prim;
    }
}

/// What surface a primitive of a tree is part of.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct PrimRef {
    /// Index into the surfaces.
    pub surface: u32,
    /// Triangle of the surface's mesh, piece of its curves, index of its quadric.
    pub index: u32,
}

/// A tree over the world or over a group.
#[derive(Clone, Debug, Default)]
pub struct Tree {
    /// Inner nodes; node 0 is the root unless the root is a leaf.
    pub nodes: Vec<Node>,
    /// Word of the root.
    pub root: u32,
    /// Leaves of [`LeafKind::Triangles`].
    pub blocks: Vec<TriBlock>,
    /// Leaves of [`LeafKind::Balls`].
    pub balls: Vec<BallBlock>,
    /// Leaves of [`LeafKind::Quadric`], and all spheres of [`Tree::balls`].
    pub quadrics: Vec<(Quadric, u32)>,
    /// Leaves of [`LeafKind::Deforming`]: primitives.
    pub deforming: Vec<u32>,
    /// Leaves of [`LeafKind::Curve`].
    pub curves: Vec<CurvePart>,
    /// Leaves of [`LeafKind::Instance`]: instances.
    pub instances: Vec<u32>,
    /// What a primitive is part of.
    pub prims: Vec<PrimRef>,
    /// Bounds over the shutter interval.
    pub bounds: super::build::Bounds,
}

impl Tree {
    /// Memory held.
    pub fn memory_bytes(&self) -> usize {
        self.nodes.len() * size_of::<Node>()
            + self.blocks.len() * size_of::<TriBlock>()
            + self.balls.len() * size_of::<BallBlock>()
            + self.prims.len() * size_of::<PrimRef>()
            + self.quadrics.len() * size_of::<(Quadric, u32)>()
            + self.curves.len() * size_of::<CurvePart>()
    }
}
