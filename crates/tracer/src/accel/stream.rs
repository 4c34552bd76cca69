//! Many rays at a time: several are in flight, each with a stack of its own.
//!
//! What a ray visits next depends on what it has just computed, so on a tree that is larger than the caches it
//! waits for memory most of the time. Here what it visits next is asked for before the other rays have
//! their turn. That takes more instructions than one ray after the other, so on smaller trees it is slower.

use super::Geometry;
use super::aim::Ahead;
use super::kernel::{self, Aim, FAR_SLACK, Walk};
use super::node::{EMPTY, LEAF, Tree};
use super::simd::{Lanes, STACK_SIZE, Simd};
use crate::ray::{Hit, Ray};
use bytemuck::Zeroable;

/// Rays in flight.
const RAYS: usize = 8;

/// Blocks of a tree that is larger than the caches.
const LARGE: usize = 1 << 16;

/// Whether rays are traced faster through a tree with several in flight.
pub fn pays(tree: &Tree) -> bool {
    tree.blocks.len() >= LARGE
}

/// A ray in flight.
struct Flight<'a> {
    aim: Aim,
    at: Walk<'a>,
    hit: Hit,
    /// Of the ray in the array.
    index: usize,
    /// What is visited next.
    word: u32,
    /// Entries of the stack. At its bottom is an [`EMPTY`], which is never behind a hit.
    height: usize,
    /// What remains to be visited and where it is entered. Eight entries are written at a time, however many
    /// count.
    words: [u32; STACK_SIZE + 8],
    ts: [f32; STACK_SIZE + 8],
}

impl<'a> Flight<'a> {
    #[inline(always)]
    fn new(geometry: &'a Geometry, ray: &'a Ray) -> Self {
        Flight {
            aim: Aim::zeroed(),
            at: Walk::world(geometry, ray),
            hit: Hit::none(ray.t_max),
            index: 0,
            word: geometry.world.root,
            height: 1,
            words: [EMPTY; STACK_SIZE + 8],
            ts: [f32::NEG_INFINITY; STACK_SIZE + 8],
        }
    }

    #[inline(always)]
    fn start(&mut self, geometry: &'a Geometry, ray: &'a Ray, aim: &Aim, index: usize) {
        self.aim = *aim;
        self.at = Walk::world(geometry, ray);
        self.hit = Hit::none(ray.t_max);
        self.index = index;
        self.word = geometry.world.root;
        self.height = 1;
    }

    /// Puts the children of its node that are entered on the stack and takes what is visited next from it. No
    /// branch depends on which children these are.
    #[inline(always)]
    fn descend<S: Simd, const ANY: bool>(&mut self, tree: &Tree) {
        let node = &tree.nodes[self.word as usize];
        let (enter, leave) = kernel::boxes::<S>(node, &self.aim, self.hit.t);
        let keys = enter.select_le(leave, enter, S::F8::splat(f32::from_bits(!0)));
        let mask = enter.le(leave);
        let height = self.height;
        let (words, ts) = (&mut self.words[height..], &mut self.ts[height..]);
        let (Some(words), Some(ts)) = (words.first_chunk_mut(), ts.first_chunk_mut()) else {
            unreachable!("the builders bound the depth of a tree")
        };
        let count = mask.count_ones() as usize;
        if ANY {
            S::pack::<false>(keys, mask, &node.children, words, ts);
            self.height += count;
            self.pop::<ANY>();
        } else {
            let nearest = S::pack::<true>(keys, mask, &node.children, words, ts);
            // The nearest from among them, the last into its place.
            let last = height + count - 1;
            let from = if count == 0 { last } else { height + nearest };
            let (word, t) = (self.words[from], self.ts[from]);
            self.words[from] = self.words[last];
            self.ts[from] = self.ts[last];
            self.height = last;
            self.word = word;
            if t > self.hit.t * FAR_SLACK {
                self.pop::<ANY>();
            }
        }
    }

    /// Takes what is visited next from the stack.
    #[inline(always)]
    fn pop<const ANY: bool>(&mut self) {
        loop {
            self.height -= 1;
            self.word = self.words[self.height];
            // What begins behind the closest hit cannot hold a closer one.
            if ANY || self.ts[self.height] <= self.hit.t * FAR_SLACK {
                return;
            }
        }
    }
}

/// Closest or any hits of an array of rays; one of the two outputs is used.
#[inline(always)]
pub fn many<S: Simd, const ANY: bool>(
    geometry: &Geometry,
    rays: &[Ray],
    hits: &mut [Hit],
    blocked: &mut [bool],
) {
    let tree = &geometry.world;
    let Some(first) = rays.first() else { return };
    if tree.root == EMPTY {
        if ANY {
            blocked[..rays.len()].fill(false);
        } else {
            for (ray, hit) in rays.iter().zip(hits) {
                *hit = Hit::none(ray.t_max);
            }
        }
        return;
    }
    let mut flights: [Flight; RAYS] = [
        Flight::new(geometry, first),
        Flight::new(geometry, first),
        Flight::new(geometry, first),
        Flight::new(geometry, first),
        Flight::new(geometry, first),
        Flight::new(geometry, first),
        Flight::new(geometry, first),
        Flight::new(geometry, first),
    ];
    let mut ahead = Ahead::new(geometry.level, rays);
    let mut next = 0;
    // Flights at a node and flights at a leaf.
    let (mut at_nodes, mut at_leaves) = ([0u8; RAYS], [0u8; RAYS]);
    let (mut nodes, mut leaves) = (0, 0);
    let root_is_leaf = tree.root & LEAF != 0;
    while next < RAYS.min(rays.len()) {
        flights[next].start(geometry, &rays[next], ahead.aim::<S>(next), next);
        if root_is_leaf {
            at_leaves[next] = next as u8;
        } else {
            at_nodes[next] = next as u8;
        }
        next += 1;
    }
    if root_is_leaf {
        leaves = next;
    } else {
        nodes = next;
    }
    while nodes + leaves > 0 {
        let (now_nodes, now_leaves) = (nodes, leaves);
        let (nodes_now, leaves_now) = (at_nodes, at_leaves);
        (nodes, leaves) = (0, 0);
        for turn in 0..now_nodes + now_leaves {
            let is_node = turn < now_nodes;
            let i = if is_node {
                nodes_now[turn % RAYS]
            } else {
                leaves_now[(turn - now_nodes) % RAYS]
            };
            let flight = &mut flights[i as usize % RAYS];
            let mut found = false;
            if is_node {
                flight.descend::<S, ANY>(tree);
            } else {
                found = kernel::visit_leaf::<S, ANY>(
                    &flight.at,
                    &flight.aim,
                    flight.word,
                    &mut flight.hit,
                );
                if ANY && found {
                    flight.word = EMPTY;
                } else {
                    flight.pop::<ANY>();
                }
            }
            if flight.word == EMPTY {
                if ANY {
                    blocked[flight.index] = found;
                } else {
                    hits[flight.index] = flight.hit;
                }
                if next == rays.len() {
                    continue;
                }
                flight.start(geometry, &rays[next], ahead.aim::<S>(next), next);
                next += 1;
            }
            let word = flight.word;
            kernel::prefetch::<S>(tree, true, word);
            let is_leaf = (word & LEAF != 0) as usize;
            at_leaves[leaves % RAYS] = i;
            leaves += is_leaf;
            at_nodes[nodes % RAYS] = i;
            nodes += 1 - is_leaf;
        }
    }
}
