//! Space cut in halves for as long as paths have been to many places in a part of it.
//!
//! Places are numbered along each axis of a box about all of them, and cuts go by the bits of these numbers. So a
//! coarse grid of the same box tells where to start from in the tree: most look-ups of cells end where they begin.

use glam::Vec3;
use std::ops::Range;

/// A part with at most so many places is a cell: directions are told apart by cells.
const CELL: usize = 40_000;
/// A part with at most so many is a spot: what surfaces send is told apart by spots.
const SPOT: usize = 128;

/// Bits of a place's number along an axis,
const BITS: u32 = 16;
/// and how many of them, from the top, the grid goes by.
const GRID_BITS: u32 = 5;

/// Of a part that belongs to no cell.
const NONE: u32 = u32::MAX;

/// Space, cut.
pub(super) struct Cells {
    /// Lower corner of the box, and numbers in a unit of length.
    corner: Vec3,
    scale: f32,
    /// The first is the whole of space.
    nodes: Vec<Node>,
    /// By box of the grid, x fastest: the smallest part that holds all of it.
    starts: Vec<u32>,
}

/// Numbers of a place along the axes.
type Numbers = [u16; 3];

/// A part of space.
#[derive(Clone, Copy, Debug)]
struct Node {
    /// By which bit of the numbers along which axis it is cut.
    axis: u8,
    bit: u8,
    is_cut: bool,
    /// Its lower half, which the upper one follows; of a spot which one.
    first: u32,
    /// Which cell it belongs to, if to one.
    cell: u32,
}

/// Where somebody has been.
#[derive(Clone, Copy, Debug)]
pub(super) struct Visit {
    at: Numbers,
    /// What for.
    pub index: u32,
}

/// Visits in the order of cells and spots.
#[derive(Default)]
pub(super) struct Order {
    pub visits: Vec<Visit>,
    /// Those of every cell.
    pub cells: Vec<Range<usize>>,
    /// Those of every spot.
    pub spots: Vec<Range<usize>>,
}

/// A part that is being cut.
enum Branch {
    Cut {
        axis: u8,
        bit: u8,
        below: usize,
        sides: Box<[Branch; 2]>,
    },
    Spot,
}

impl Cells {
    /// From places; visits are numbered in their order.
    pub(super) fn new(places: &[Vec3]) -> (Cells, Order) {
        let (mut low, mut high) = (Vec3::INFINITY, Vec3::NEG_INFINITY);
        for p in places {
            (low, high) = (low.min(*p), high.max(*p));
        }
        // All in one place: without places, with one or with places too far from each other for numbers.
        let scale = (1u32 << BITS) as f32 / (high - low).max_element();
        let is_of_use = 0.0 < scale && scale < f32::INFINITY;
        let mut cells = Cells {
            corner: if is_of_use { low } else { Vec3::ZERO },
            scale: if is_of_use { scale } else { 0.0 },
            nodes: vec![Node::SPOT],
            starts: vec![],
        };
        let visit = |(index, p): (usize, &Vec3)| Visit {
            at: cells.numbers(*p),
            index: index as u32,
        };
        let mut visits: Vec<Visit> = places.iter().enumerate().map(visit).collect();
        let branch = cut(&mut visits);
        let all = 0..visits.len();
        let mut order = Order {
            visits,
            ..Order::default()
        };
        cells.add(0, &branch, all, NONE, &mut order);
        cells.make_grid();
        (cells, order)
    }

    /// Fills a node.
    fn add(
        &mut self,
        node: usize,
        branch: &Branch,
        of: Range<usize>,
        mut cell: u32,
        order: &mut Order,
    ) {
        if cell == NONE && (of.len() <= CELL || matches!(branch, Branch::Spot)) {
            cell = order.cells.len() as u32;
            order.cells.push(of.clone());
        }
        self.nodes[node].cell = cell;
        match branch {
            Branch::Spot => {
                self.nodes[node].first = order.spots.len() as u32;
                order.spots.push(of);
            }
            Branch::Cut {
                axis,
                bit,
                below,
                sides,
            } => {
                let first = self.nodes.len();
                self.nodes.extend([Node::SPOT; 2]);
                self.nodes[node] = Node {
                    axis: *axis,
                    bit: *bit,
                    is_cut: true,
                    first: first as u32,
                    cell,
                };
                let middle = of.start + below;
                self.add(first, &sides[0], of.start..middle, cell, order);
                self.add(first + 1, &sides[1], middle..of.end, cell, order);
            }
        }
    }

    fn make_grid(&mut self) {
        let side = 1u32 << GRID_BITS;
        let corner = |box_: u32, axis: u32| box_ >> (GRID_BITS * axis) & (side - 1);
        for box_ in 0..side * side * side {
            let at = [0, 1, 2].map(|axis| (corner(box_, axis) << (BITS - GRID_BITS)) as u16);
            let mut node = 0;
            while self.nodes[node].is_cut && u32::from(self.nodes[node].bit) >= BITS - GRID_BITS {
                node = self.nodes[node].side(at);
            }
            self.starts.push(node as u32);
        }
    }

    #[inline(always)]
    fn numbers(&self, p: Vec3) -> Numbers {
        let most = f32::from(u16::MAX);
        // Not a number is at the lower end.
        let at = ((p - self.corner) * self.scale)
            .max(Vec3::ZERO)
            .min(Vec3::splat(most));
        [at.x as u16, at.y as u16, at.z as u16]
    }

    /// The part to start from.
    #[inline(always)]
    fn start(&self, at: Numbers) -> Node {
        let [x, y, z] = at.map(|n| u32::from(n) >> (BITS - GRID_BITS));
        let start = self.starts[(x | y << GRID_BITS | z << (2 * GRID_BITS)) as usize];
        self.nodes[start as usize]
    }

    /// The cell that a point lies in.
    #[inline(always)]
    pub(super) fn cell(&self, p: Vec3) -> u32 {
        let at = self.numbers(p);
        let mut node = self.start(at);
        while node.cell == NONE {
            node = self.nodes[node.side(at)];
        }
        node.cell
    }

    /// The spot that a point lies in.
    #[inline(always)]
    pub(super) fn spot(&self, p: Vec3) -> u32 {
        let at = self.numbers(p);
        let mut node = self.start(at);
        while node.is_cut {
            node = self.nodes[node.side(at)];
        }
        node.first
    }

    /// Memory held.
    pub(super) fn memory_bytes(&self) -> usize {
        size_of_val(&self.nodes[..]) + size_of_val(&self.starts[..])
    }
}

impl Node {
    const SPOT: Node = Node {
        axis: 0,
        bit: 0,
        is_cut: false,
        first: 0,
        cell: NONE,
    };

    /// The half that a place lies in.
    #[inline(always)]
    fn side(&self, at: Numbers) -> usize {
        (self.first + bit_of(at, self.axis, self.bit)) as usize
    }
}

#[inline(always)]
fn bit_of([x, y, z]: Numbers, axis: u8, bit: u8) -> u32 {
    let number = [x, y, z, 0][usize::from(axis & 3)];
    u32::from(number) >> (bit & 15) & 1
}

/// Cuts across the longest side of where places are.
fn cut(visits: &mut [Visit]) -> Branch {
    if visits.len() <= SPOT {
        return Branch::Spot;
    }
    let (mut low, mut high) = ([u16::MAX; 3], [0; 3]);
    for visit in visits.iter() {
        for axis in 0..3 {
            low[axis] = low[axis].min(visit.at[axis]);
            high[axis] = high[axis].max(visit.at[axis]);
        }
    }
    let mut longest = None;
    for axis in 0..3 {
        let size = high[axis] - low[axis];
        if size > 0 && longest.is_none_or(|(_, most)| size > most) {
            longest = Some((axis, size));
        }
    }
    let Some((axis, _)) = longest else {
        return Branch::Spot;
    };
    // Where they differ first: the bits above say nothing.
    let bit = 15 - (low[axis] ^ high[axis]).leading_zeros() as u8;
    let axis = axis as u8;
    let below = partition(visits, |visit| bit_of(visit.at, axis, bit) == 0);
    let (lower, upper) = visits.split_at_mut(below);
    let (lower, upper) = rayon::join(|| cut(lower), || cut(upper));
    Branch::Cut {
        axis,
        bit,
        below,
        sides: Box::new([lower, upper]),
    }
}

/// Moves those that are first before the others; how many.
pub(super) fn partition<P>(all: &mut [P], is_first: impl Fn(&P) -> bool) -> usize {
    let (mut begin, mut end) = (0, all.len());
    while begin < end {
        if is_first(&all[begin]) {
            begin += 1;
        } else {
            end -= 1;
            all.swap(begin, end);
        }
    }
    begin
}
