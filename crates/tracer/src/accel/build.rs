//! From boxes to the wide tree: a binary tree by `obvhs` (PLOC and reinsertion), then the
//! cheapest collapse to eight children (`collapse.rs`).
//!
//! Each binary tree is built on one thread: parallel builds of `obvhs` are not known to give the same
//! tree every time. Different trees, and the parts of a large one (`parts.rs`), are built at the same
//! time.

use super::collapse::Plan;
use super::node::{BallBlock, EMPTY, INDEX_MASK, LEAF, LeafKind, Node, TriBlock, leaf, leaf_kind};
use super::parts::{self, Division};
use glam::Vec3;
use obvhs::bvh2::Bvh2;
use obvhs::bvh2::node::Bvh2Node;
use obvhs::bvh2::reinsertion::ReinsertionOptimizer;
use obvhs::ploc::PlocBuilder;
use obvhs::{Boundable, BvhBuildParams};
use rayon::prelude::*;
use std::ops::Range;

/// An axis-aligned box; empty while `min` is above `max`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Bounds {
    /// Lower corner.
    pub min: Vec3,
    /// Upper corner.
    pub max: Vec3,
}

impl Default for Bounds {
    fn default() -> Self {
        Bounds {
            min: Vec3::splat(f32::INFINITY),
            max: Vec3::splat(f32::NEG_INFINITY),
        }
    }
}

impl Bounds {
    /// Of some points.
    pub fn of(points: impl IntoIterator<Item = Vec3>) -> Bounds {
        points.into_iter().fold(Bounds::default(), |b, p| Bounds {
            min: b.min.min(p),
            max: b.max.max(p),
        })
    }
    /// Around both.
    pub fn union(self, other: Bounds) -> Bounds {
        Bounds {
            min: self.min.min(other.min),
            max: self.max.max(other.max),
        }
    }
    /// Whether nothing is inside.
    pub fn is_empty(&self) -> bool {
        !(self.min.x <= self.max.x && self.min.y <= self.max.y && self.min.z <= self.max.z)
    }
    /// The eight corners.
    pub fn corners(&self) -> [Vec3; 8] {
        let (a, b) = (self.min, self.max);
        std::array::from_fn(|i| {
            Vec3::new(
                if i & 1 == 0 { a.x } else { b.x },
                if i & 2 == 0 { a.y } else { b.y },
                if i & 4 == 0 { a.z } else { b.z },
            )
        })
    }
    /// Centre.
    pub fn center(&self) -> Vec3 {
        self.min * 0.5 + self.max * 0.5
    }
    /// Distance from the centre to a corner.
    pub fn radius(&self) -> f32 {
        if self.is_empty() {
            0.0
        } else {
            crate::math::length(self.max - self.min) * 0.5
        }
    }
    /// Larger by a few units in the last place of the largest coordinate, so that what was computed
    /// from rounded numbers is inside.
    pub fn padded(self, by: f32) -> Bounds {
        let size = self.min.abs().max(self.max.abs()).max_element();
        let pad = Vec3::splat(by + size * 1e-6);
        Bounds {
            min: self.min - pad,
            max: self.max + pad,
        }
    }
}

/// What a tree is built over.
#[derive(Clone, Copy, Debug)]
pub struct Item {
    /// Its box.
    pub bounds: Bounds,
    /// What it becomes.
    pub kind: LeafKind,
    /// Primitive (triangles), else index into the list of its kind.
    pub id: u32,
}

impl Boundable for Item {
    fn aabb(&self) -> obvhs::aabb::Aabb {
        let b = self.bounds;
        obvhs::aabb::Aabb::new(
            glam::Vec3A::new(b.min.x, b.min.y, b.min.z),
            glam::Vec3A::new(b.max.x, b.max.y, b.max.z),
        )
    }
}

/// Inner nodes on the way down are at most this many, so that a traversal stack of
/// `7 * DEPTH_MAX + 1` entries never overflows.
pub const DEPTH_MAX: usize = 40;
const _: () = assert!(7 * DEPTH_MAX < super::simd::STACK_SIZE);

/// Nodes, root word and triangle blocks over some items.
pub struct Built {
    /// Inner nodes.
    pub nodes: Vec<Node>,
    /// Word of the root.
    pub root: u32,
    /// Triangle blocks.
    pub blocks: Vec<TriBlock>,
    /// Blocks of spheres.
    pub balls: Vec<BallBlock>,
}

/// What the items of blocks look like.
#[derive(Clone, Copy)]
pub struct Shapes<'a> {
    /// Gives the corners of a triangle by its primitive.
    pub corners: &'a (dyn Fn(u32) -> [Vec3; 3] + Sync),
    /// Gives centre, radius and primitive of a round sphere by its index in the list of quadrics.
    pub sphere: &'a (dyn Fn(u32) -> (Vec3, f32, u32) + Sync),
}

/// Builds a tree.
pub fn build(items: Vec<Item>, shapes: Shapes) -> Built {
    build_in_parts(items, shapes, parts::PART_MAX)
}

/// Builds a tree from parts of at most `part` items.
pub(super) fn build_in_parts(items: Vec<Item>, shapes: Shapes, part: usize) -> Built {
    if items.is_empty() {
        Built {
            nodes: vec![],
            root: EMPTY,
            blocks: vec![],
            balls: vec![],
        }
    } else if items.len() <= part {
        build_below(&items, shapes, 0, &mut Scratch::default())
    } else {
        join(items, shapes, part)
    }
}

/// A tree whose root lies below `depth` others.
fn build_below(items: &[Item], shapes: Shapes, depth: usize, scratch: &mut Scratch) -> Built {
    let binary = if items.len() == 1 {
        Binary::balanced(items)
    } else {
        Binary::ploc(items, scratch)
    };
    // Coincident or nested boxes by the thousand can make a chain of a tree.
    let built = Collapse::run(&binary, items, shapes, depth)
        .or_else(|| Collapse::run(&Binary::balanced(items), items, shapes, depth));
    match built {
        Some(built) => built,
        None => unreachable!("a balanced tree over 2^28 items is at most 28 deep"),
    }
}

// Halving 2^28 items, below the cuts that are free, stays above the deepest node.
const _: () = assert!(parts::FREE_DEPTH + 28 < DEPTH_MAX);

/// A tree over each part of the items and one that joins them.
fn join(mut items: Vec<Item>, shapes: Shapes, part: usize) -> Built {
    let division = parts::divide(&mut items, part);
    let mut ranges = vec![];
    let binary = Binary::over(&division, &mut ranges);
    // While the joining tree is made, a part stands in it as a thing that is placed.
    let stand_ins: Vec<Item> = ranges
        .iter()
        .enumerate()
        .map(|(i, (_, bounds))| Item {
            bounds: *bounds,
            kind: LeafKind::Instance,
            id: i as u32,
        })
        .collect();
    let Some(mut out) = Collapse::run(&binary, &stand_ins, shapes, 0) else {
        unreachable!("a division is shallow");
    };
    let mut places = vec![(0, 0); ranges.len()];
    let mut depths = vec![0; out.nodes.len()];
    for (at, node) in out.nodes.iter().enumerate() {
        for (slot, &word) in node.children.iter().enumerate() {
            if word & LEAF == 0 {
                depths[word as usize] = depths[at] + 1;
            } else if word != EMPTY {
                places[(word & INDEX_MASK) as usize] = (at, slot);
            }
        }
    }
    let parts: Vec<_> = ranges.into_iter().zip(places).collect();
    // Some at a time, so that what waits to be appended is bounded. From the back, so that items can go
    // as their nodes come; in this order however many are built at a time.
    let at_once = 4 * rayon::current_num_threads();
    for some in parts.rchunks(at_once) {
        let built: Vec<Built> = some
            .par_iter()
            .map_init(Scratch::default, |scratch, ((range, _), (above, _))| {
                build_below(&items[range.clone()], shapes, depths[*above] + 1, scratch)
            })
            .collect();
        for (built, (_, (above, slot))) in built.into_iter().zip(some).rev() {
            out.nodes[*above].children[*slot] = out.append(built);
        }
        if let Some(((range, _), _)) = some.first() {
            items.truncate(range.start);
            items.shrink_to_fit();
        }
    }
    out
}

/// Whether leaves of a kind are found in the list of blocks.
fn is_in_blocks(kind: u32) -> bool {
    kind == LeafKind::Triangles as u32 || kind == LeafKind::Pair as u32
}

impl Built {
    /// Takes in another tree and returns the word of its root here.
    fn append(&mut self, other: Built) -> u32 {
        let (nodes, blocks) = (self.nodes.len() as u32, self.blocks.len() as u32);
        let balls = self.balls.len() as u32;
        let moved = |word: u32| {
            if word & LEAF == 0 {
                word + nodes
            } else if word != EMPTY && is_in_blocks(leaf_kind(word)) {
                word + blocks
            } else if word != EMPTY && leaf_kind(word) == LeafKind::Balls as u32 {
                word + balls
            } else {
                word
            }
        };
        self.nodes.extend(other.nodes.into_iter().map(|mut node| {
            node.children = node.children.map(moved);
            node
        }));
        self.blocks.extend(other.blocks);
        self.balls.extend(other.balls);
        moved(other.root)
    }
}

/// What building binary trees one after the other has allocated.
#[derive(Default)]
struct Scratch {
    ploc: PlocBuilder,
    bvh: Bvh2,
    reinsertion: ReinsertionOptimizer,
}

/// A binary tree with one item in each leaf.
struct Binary {
    nodes: Vec<BinaryNode>,
}

/// Of the tree that becomes the wide one.
#[derive(Clone, Copy)]
pub struct BinaryNode {
    /// Around what is below.
    pub bounds: Bounds,
    /// Left child (the right one follows) of an inner node, item of a leaf.
    pub first: u32,
    /// Whether this is a leaf.
    pub is_leaf: bool,
    /// Items below.
    pub count: u32,
    /// What all of them are, if they are alike.
    pub all: Option<LeafKind>,
}

impl Binary {
    fn ploc(items: &[Item], scratch: &mut Scratch) -> Binary {
        let Scratch {
            ploc,
            bvh,
            reinsertion,
        } = scratch;
        let params = BvhBuildParams::medium_build();
        ploc.build_with_bvh(
            bvh,
            params.ploc_search_distance,
            items,
            (0..items.len() as u32).collect(),
            params.sort_precision,
            params.search_depth_threshold,
        );
        reinsertion.run(bvh, params.reinsertion_batch_ratio, None);
        let from = |n: &Bvh2Node| {
            let (lo, hi) = (n.aabb.min, n.aabb.max);
            let is_leaf = n.prim_count > 0;
            BinaryNode {
                bounds: Bounds {
                    min: Vec3::new(lo.x, lo.y, lo.z),
                    max: Vec3::new(hi.x, hi.y, hi.z),
                },
                first: if is_leaf {
                    bvh.primitive_indices[n.first_index as usize]
                } else {
                    n.first_index
                },
                is_leaf,
                count: 0,
                all: None,
            }
        };
        let mut tree = Binary {
            nodes: bvh.nodes.iter().map(from).collect(),
        };
        tree.count(items);
        tree
    }

    /// Over the parts of a division, which are listed as they come.
    fn over(division: &Division, parts: &mut Vec<(Range<usize>, Bounds)>) -> Binary {
        let blank = BinaryNode {
            bounds: Bounds::default(),
            first: 0,
            is_leaf: true,
            count: 0,
            all: None,
        };
        let mut nodes = vec![blank];
        let mut order = vec![];
        let mut todo = vec![(0, division)];
        while let Some((at, division)) = todo.pop() {
            match division {
                Division::Part(range, bounds) => {
                    nodes[at] = BinaryNode {
                        bounds: *bounds,
                        first: parts.len() as u32,
                        count: 1,
                        ..blank
                    };
                    parts.push((range.clone(), *bounds));
                }
                Division::Pair(pair) => {
                    let left = nodes.len();
                    nodes.extend([blank, blank]);
                    nodes[at].first = left as u32;
                    nodes[at].is_leaf = false;
                    order.push(at);
                    todo.extend([(left + 1, &pair[1]), (left, &pair[0])]);
                }
            }
        }
        // Children come after their parents.
        for at in order.into_iter().rev() {
            let first = nodes[at].first as usize;
            let (a, b) = (nodes[first], nodes[first + 1]);
            nodes[at].bounds = a.bounds.union(b.bounds);
            nodes[at].count = a.count + b.count;
        }
        Binary { nodes }
    }

    /// Halves by index: never deeper than the logarithm.
    fn balanced(items: &[Item]) -> Binary {
        let mut tree = Binary { nodes: vec![] };
        let blank = BinaryNode {
            bounds: Bounds::default(),
            first: 0,
            is_leaf: true,
            count: 0,
            all: None,
        };
        tree.nodes.push(blank);
        let mut todo = vec![(0usize, 0usize, items.len())];
        while let Some((at, from, to)) = todo.pop() {
            let bounds = items[from..to]
                .iter()
                .fold(Bounds::default(), |b, i| b.union(i.bounds));
            if to - from == 1 {
                tree.nodes[at] = BinaryNode {
                    bounds,
                    first: from as u32,
                    ..blank
                };
            } else {
                let left = tree.nodes.len();
                tree.nodes.extend([blank, blank]);
                tree.nodes[at] = BinaryNode {
                    bounds,
                    first: left as u32,
                    is_leaf: false,
                    ..blank
                };
                let middle = from + (to - from) / 2;
                todo.push((left, from, middle));
                todo.push((left + 1, middle, to));
            }
        }
        tree.count(items);
        tree
    }

    /// Fills in `count` and `all`, children before parents.
    fn count(&mut self, items: &[Item]) {
        let mut order = vec![0u32];
        let mut i = 0;
        while i < order.len() {
            let node = self.nodes[order[i] as usize];
            if !node.is_leaf {
                order.extend([node.first, node.first + 1]);
            }
            i += 1;
        }
        for &at in order.iter().rev() {
            let node = self.nodes[at as usize];
            let (count, all) = if node.is_leaf {
                (1, Some(items[node.first as usize].kind))
            } else {
                let (a, b) = (
                    self.nodes[node.first as usize],
                    self.nodes[node.first as usize + 1],
                );
                (a.count + b.count, a.all.filter(|_| a.all == b.all))
            };
            self.nodes[at as usize].count = count;
            self.nodes[at as usize].all = all;
        }
    }
}

struct Collapse<'a> {
    binary: &'a Binary,
    plan: Plan,
    items: &'a [Item],
    shapes: Shapes<'a>,
    out: Built,
}

impl<'a> Collapse<'a> {
    /// `None` if the wide tree, below `depth` others, would be deeper than [`DEPTH_MAX`].
    fn run(
        binary: &'a Binary,
        items: &'a [Item],
        shapes: Shapes<'a>,
        depth: usize,
    ) -> Option<Built> {
        let out = Built {
            nodes: vec![],
            root: EMPTY,
            blocks: vec![],
            balls: vec![],
        };
        let mut collapse = Collapse {
            binary,
            plan: Plan::new(&binary.nodes),
            items,
            shapes,
            out,
        };
        collapse.out.root = collapse.emit(0, depth)?;
        Some(collapse.out)
    }

    /// Emits the subtree below a binary node and returns its word.
    fn emit(&mut self, at: u32, depth: usize) -> Option<u32> {
        if self.plan.is_leaf(at) {
            return Some(self.emit_leaf(at));
        }
        if depth >= DEPTH_MAX {
            return None;
        }
        let index = self.out.nodes.len();
        self.out.nodes.push(Node::empty());
        let children = self.plan.children(&self.binary.nodes, at);
        for (slot, &child) in children.iter().enumerate() {
            let word = self.emit(child, depth + 1)?;
            let b = self.binary.nodes[child as usize].bounds;
            let node = &mut self.out.nodes[index];
            node.children[slot] = word;
            for axis in 0..3 {
                node.bounds[2 * axis][slot] = b.min[axis];
                node.bounds[2 * axis + 1][slot] = b.max[axis];
            }
        }
        Some(index as u32)
    }

    fn emit_leaf(&mut self, at: u32) -> u32 {
        let node = self.binary.nodes[at as usize];
        if !matches!(node.all, Some(LeafKind::Triangles | LeafKind::Balls)) {
            let item = &self.items[node.first as usize];
            return leaf(item.kind, item.id as usize);
        }
        let mut ids = vec![];
        let mut todo = vec![at];
        while let Some(n) = todo.pop() {
            let node = self.binary.nodes[n as usize];
            if node.is_leaf {
                ids.push(self.items[node.first as usize].id);
            } else {
                todo.extend([node.first, node.first + 1]);
            }
        }
        ids.sort_unstable();
        if node.all == Some(LeafKind::Balls) {
            let mut block = BallBlock::empty();
            for (lane, &id) in ids.iter().enumerate() {
                let (center, radius, prim) = (self.shapes.sphere)(id);
                block.set(lane, center, radius, prim);
            }
            self.out.balls.push(block);
            return leaf(LeafKind::Balls, self.out.balls.len() - 1);
        }
        let index = self.out.blocks.len();
        for prims in ids.chunks(4) {
            let mut block = TriBlock::empty();
            for (lane, &prim) in prims.iter().enumerate() {
                block.set(lane, (self.shapes.corners)(prim), prim);
            }
            self.out.blocks.push(block);
        }
        let kind = if ids.len() > 4 {
            LeafKind::Pair
        } else {
            LeafKind::Triangles
        };
        leaf(kind, index)
    }
}

/// Half the surface of a box.
pub fn half_area(b: &Bounds) -> f32 {
    let d = b.max - b.min;
    d.x * d.y + d.y * d.z + d.z * d.x
}

const _: () = assert!(EMPTY & LEAF != 0);
