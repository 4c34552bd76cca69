//! Which nodes of a binary tree become nodes and leaves of the wide one.
//!
//! The least surface area cost over all ways to merge the binary nodes, by dynamic programming from the
//! leaves up, as in [Ylitie17]: what a subtree costs as a forest of at most i trees, for i from 1 to 7, follows
//! from what its two halves cost. Against opening the largest child until there are eight, nodes are fuller,
//! so there are fewer of them, on the way of a ray as well.

use super::build::{BinaryNode, half_area};
use super::node::LeafKind;

/// Cost of a block of triangles beside that of a node.
const BLOCK: f32 = 0.6;
/// Cost of another block in the same leaf.
const NEXT_BLOCK: f32 = 0.5;
/// Triangles or spheres in a block.
const LANES: u32 = 4;
/// Blocks of triangles in a leaf; of spheres there is one.
const BLOCKS_MAX: u32 = 2;

/// What becomes of each binary node.
pub struct Plan {
    /// Bits 3 (i - 2) and up, for i from 2 to 8: how many of at most i trees the left half is given; 0 if they
    /// are better one fewer. Bit [`LEAF`]: the node is a leaf if it is a tree of its own.
    choices: Vec<u32>,
}

const LEAF: u32 = 1 << 31;

impl Plan {
    /// For a tree whose root is node 0.
    pub fn new(nodes: &[BinaryNode]) -> Plan {
        let mut choices = vec![0; nodes.len()];
        let mut todo = vec![(0u32, false)];
        // Of the finished subtrees that wait for their parents: cost as at most 1, ..., 7 trees.
        let mut costs: Vec<[f32; 7]> = vec![];
        while let Some((at, halves_done)) = todo.pop() {
            let node = &nodes[at as usize];
            let area = half_area(&node.bounds);
            if node.is_leaf {
                choices[at as usize] = LEAF;
                costs.push([area * BLOCK; 7]);
            } else if !halves_done {
                todo.extend([(at, true), (node.first + 1, false), (node.first, false)]);
            } else if let (Some(right), Some(left)) = (costs.pop(), costs.pop()) {
                let (cost, choice) = join(node, area, &left, &right);
                choices[at as usize] = choice;
                costs.push(cost);
            }
        }
        Plan { choices }
    }

    /// Whether a node is a leaf of the wide tree, given that it is not merged into its parent.
    pub fn is_leaf(&self, at: u32) -> bool {
        self.choices[at as usize] & LEAF != 0
    }

    /// The children of a node that is not a leaf: two to eight nodes, in the order of the binary tree.
    pub fn children(&self, nodes: &[BinaryNode], at: u32) -> Vec<u32> {
        let mut children = Vec::with_capacity(8);
        let mut todo = vec![(at, 8, true)];
        while let Some((at, trees, is_top)) = todo.pop() {
            let mut trees = trees;
            let mut left = 0;
            while trees > 1 && left == 0 {
                left = self.choices[at as usize] >> (3 * (trees - 2)) & 7;
                if left == 0 {
                    trees -= 1;
                }
            }
            debug_assert!(left > 0 || !is_top);
            if left == 0 {
                children.push(at);
            } else {
                let first = nodes[at as usize].first;
                todo.push((first + 1, trees - left, false));
                todo.push((first, left, false));
            }
        }
        children
    }
}

/// Costs and choices of a node from the costs of its halves.
fn join(node: &BinaryNode, area: f32, left: &[f32; 7], right: &[f32; 7]) -> ([f32; 7], u32) {
    // The best split of i trees among the halves, i from 2 to 8.
    let mut split = [(f32::INFINITY, 0); 7];
    for (i, best) in split.iter_mut().enumerate() {
        for k in 0..=i {
            let cost = left[k] + right[i - k];
            if cost < best.0 {
                *best = (cost, k as u32 + 1);
            }
        }
    }
    let mut choice = split[6].1 << 18;
    let as_node = area + split[6].0;
    let blocks = node.count.div_ceil(LANES);
    let fits = match node.all {
        Some(LeafKind::Triangles) => blocks <= BLOCKS_MAX,
        Some(LeafKind::Balls) => blocks == 1,
        _ => false,
    };
    let as_leaf = if fits {
        area * (BLOCK + (blocks - 1) as f32 * NEXT_BLOCK)
    } else {
        f32::INFINITY
    };
    let mut cost = [as_node.min(as_leaf); 7];
    if as_leaf <= as_node {
        choice |= LEAF;
    }
    for i in 0..6 {
        cost[i + 1] = cost[i];
        if split[i].0 < cost[i] {
            cost[i + 1] = split[i].0;
            choice |= split[i].1 << (3 * i);
        }
    }
    (cost, choice)
}
