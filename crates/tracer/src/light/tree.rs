//! Choosing among many lights: a binary tree whose nodes know where their lights are, how strong they
//! are and where they shine. On the way down each child is taken in proportion to a bound on what it
//! can send to the point in question [ConEstevez18] (`cluster.rs`).
//!
//! Strength is peak intensity instead of power, so that a lamp that shines one way competes fairly
//! with one that shines all around.

use super::cluster::{Aim, Cluster};
use super::pairs::Pairs;
use crate::accel::simd::{self, SimdLevel};
use glam::Vec3;

/// What is known of a light or of all lights below a node.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LightBounds {
    /// Box.
    pub min: Vec3,
    /// Box.
    pub max: Vec3,
    /// Axis of the normals, unit length.
    pub axis: Vec3,
    /// Peak intensity, summed.
    pub strength: f32,
    /// Cosine of the largest angle between a normal and the axis.
    pub cos_normals: f32,
    /// Cosine of the largest angle from its normal at which a light shines.
    pub cos_emission: f32,
    /// Both sides of the surfaces shine.
    pub two_sided: bool,
}

#[derive(Clone, Copy, Debug)]
pub(super) struct Node {
    pub(super) bounds: LightBounds,
    /// Left child (the right one follows) of an inner node, light of a leaf.
    pub(super) first: u32,
    pub(super) is_leaf: bool,
}

/// Three levels of the binary tree in one, so that the bounds of a level are computed side by side.
#[derive(Clone, Debug)]
struct Wide {
    /// Lanes 0 and 1: the children; lanes 2 to 5: theirs.
    upper: Cluster,
    /// The third level.
    lower: Cluster,
    /// The third level holds more than what the second has already.
    is_deep: bool,
    /// By the turns of the three levels, first turn highest: a node, or a light with [`LEAF`] set. What
    /// ends above the third level turns left from there on.
    words: [u32; 8],
}

/// Marks a light in a node's words.
pub(super) const LEAF: u32 = 1 << 31;

/// The tree.
pub struct LightTree {
    /// Empty if there is only one light.
    nodes: Vec<Wide>,
    /// For each light: the turns from the root to its leaf, lowest bit first (1 is right), three for
    /// each node; `u64::MAX` for a light that is not in the tree.
    trails: Vec<u64>,
    /// The light of a tree of one.
    only: u32,
    /// The same for many points at once, where there are lanes for it.
    pub(super) pairs: Option<Pairs>,
    level: SimdLevel,
}

/// The binary tree is at most this deep, so that a trail fits.
const DEPTH_MAX: u32 = 60;
/// Cells along an axis that splits are tried between.
const BUCKETS: usize = 12;

impl LightTree {
    /// Over lights given with their indices; `count` is that of all lights. `None` if there is none.
    pub fn new(lights: &[(u32, LightBounds)], count: usize, level: SimdLevel) -> Option<LightTree> {
        let only = lights.first()?.0;
        let mut tree = LightTree {
            nodes: vec![],
            trails: vec![u64::MAX; count],
            only,
            pairs: None,
            level,
        };
        if lights.len() == 1 {
            tree.trails[only as usize] = 0;
            return Some(tree);
        }
        let binary = binary(lights);
        tree.pairs = (level >= SimdLevel::Avx2).then(|| Pairs::new(&binary));
        // Node of the binary tree, the place that waits for it, its trail and the length of that.
        let mut todo = vec![(0u32, None, 0u64, 0u32)];
        while let Some((root, place, trail, length)) = todo.pop() {
            let at = tree.nodes.len() as u32;
            if let Some((node, lane)) = place {
                let above: &mut Wide = &mut tree.nodes[node];
                above.words[lane] = at;
            }
            let one: [_; 2] = children(&binary, [Some(root)]);
            let two: [_; 4] = children(&binary, one);
            let three: [_; 8] = children(&binary, two);
            let mut words = [LEAF; 8];
            for (turns, child) in three.into_iter().enumerate() {
                let Some(child) = child else { continue };
                // The first turn is the highest bit of the place, but the lowest of the trail.
                let turned = [0, 4, 2, 6, 1, 5, 3, 7][turns];
                let (trail, length) = (trail | turned << length, length + 3);
                let node = &binary[child as usize];
                if node.is_leaf {
                    words[turns] = node.first | LEAF;
                    tree.trails[node.first as usize] = trail;
                } else {
                    todo.push((child, Some((at as usize, turns)), trail, length));
                }
            }
            let bounds = |i: Option<u32>| i.map(|i| binary[i as usize].bounds);
            tree.nodes.push(Wide {
                upper: Cluster::new(one.into_iter().chain(two).map(bounds)),
                lower: Cluster::new(three.into_iter().map(bounds)),
                is_deep: two
                    .into_iter()
                    .flatten()
                    .any(|i| !binary[i as usize].is_leaf),
                words,
            });
        }
        Some(tree)
    }

    /// The light of a tree of one.
    pub fn only(&self) -> Option<u32> {
        self.nodes.is_empty().then_some(self.only)
    }

    /// A light and its probability, for a point with a normal; `None` if no light reaches it.
    #[inline]
    pub fn sample(&self, p: Vec3, aim: Aim, mut u: f32) -> Option<(u32, f32)> {
        if self.nodes.is_empty() {
            return Some((self.only, 1.0));
        }
        let mut pmf = 1.0;
        let mut word = 0;
        while word & LEAF == 0 {
            let node = &self.nodes[word as usize];
            let upper = simd::importances(self.level, &node.upper, p, aim);
            let one = turn(upper[0], upper[1], &mut u, &mut pmf)?;
            let two = one * 2 + turn(upper[2 + one * 2], upper[3 + one * 2], &mut u, &mut pmf)?;
            let three = if node.is_deep {
                let lower = simd::importances(self.level, &node.lower, p, aim);
                two * 2 + turn(lower[two * 2], lower[two * 2 + 1], &mut u, &mut pmf)?
            } else {
                two * 2
            };
            word = node.words[three];
        }
        (pmf > 0.0).then_some((word & !LEAF, pmf))
    }

    /// Probability that [`LightTree::sample`] gives a light.
    #[inline]
    pub fn pmf(&self, p: Vec3, aim: Aim, light: u32) -> f32 {
        let mut trail = self.trails[light as usize];
        if trail == u64::MAX {
            return 0.0;
        }
        if self.nodes.is_empty() {
            return 1.0;
        }
        let mut pmf = 1.0;
        let mut word = 0;
        while word & LEAF == 0 {
            let node = &self.nodes[word as usize];
            let upper = simd::importances(self.level, &node.upper, p, aim);
            let one = (trail & 1) as usize;
            let two = one * 2 + (trail >> 1 & 1) as usize;
            let three = two * 2 + (trail >> 2 & 1) as usize;
            pmf *= share(upper[0], upper[1], one == 1);
            pmf *= share(upper[2 + one * 2], upper[3 + one * 2], two & 1 == 1);
            if node.is_deep {
                let lower = simd::importances(self.level, &node.lower, p, aim);
                pmf *= share(lower[two * 2], lower[two * 2 + 1], three & 1 == 1);
            }
            if pmf <= 0.0 {
                return 0.0;
            }
            trail >>= 3;
            word = node.words[three];
        }
        pmf
    }
}

/// Turns left (0) or right (1) in proportion to two bounds; `None` where both are zero.
#[inline(always)]
fn turn(a: f32, b: f32, u: &mut f32, pmf: &mut f32) -> Option<usize> {
    let sum = a + b;
    if sum.is_nan() || sum <= 0.0 {
        return None;
    }
    let share = a / sum;
    if *u < share {
        *u = (*u / share).min(crate::math::ONE_MINUS_EPSILON);
        *pmf *= share;
        Some(0)
    } else {
        *u = ((*u - share) / (1.0 - share)).min(crate::math::ONE_MINUS_EPSILON);
        *pmf *= 1.0 - share;
        Some(1)
    }
}

/// Probability of a turn of [`turn`].
#[inline(always)]
fn share(a: f32, b: f32, right: bool) -> f32 {
    let sum = a + b;
    if sum.is_nan() || sum <= 0.0 {
        return 0.0;
    }
    let share = a / sum;
    if right { 1.0 - share } else { share }
}

/// Children of a level: those of inner nodes, a leaf itself and nothing.
fn children<const N: usize, const M: usize>(
    binary: &[Node],
    level: [Option<u32>; N],
) -> [Option<u32>; M] {
    std::array::from_fn(|i| {
        let above = level[i / 2]?;
        let node = &binary[above as usize];
        if node.is_leaf {
            (i % 2 == 0).then_some(above)
        } else {
            Some(node.first + (i % 2) as u32)
        }
    })
}

/// Bounds and the angle of their cone of normals, which nearly every use would have to find again.
#[derive(Clone, Copy, Debug)]
struct Known {
    bounds: LightBounds,
    /// Largest angle between a normal and the axis.
    normals: f64,
}

impl Known {
    fn new(bounds: LightBounds) -> Known {
        Known {
            bounds,
            normals: angle(bounds.cos_normals),
        }
    }
}

fn angle(cos: f32) -> f64 {
    libm::acos(cos.clamp(-1.0, 1.0) as f64)
}

/// Below so many lights another thread is not worth asking.
const ALONE: usize = 1 << 10;

/// The binary tree; node 0 is the root.
fn binary(lights: &[(u32, LightBounds)]) -> Vec<Node> {
    let mut lights: Vec<(u32, Known)> = lights.iter().map(|l| (l.0, Known::new(l.1))).collect();
    let mut spare = lights.clone();
    let blank = Node {
        bounds: lights[0].1.bounds,
        first: 0,
        is_leaf: true,
    };
    let mut nodes = vec![blank; 2 * lights.len() - 1];
    if let Some((root, below)) = nodes.split_first_mut() {
        grow(&mut lights, &mut spare, root, below, 1, 0);
    }
    nodes
}

/// Makes the node over some lights, and those below it in a list that has just enough places and whose
/// first one has the index `first`. `spare` is as long as `lights`.
fn grow(
    lights: &mut [(u32, Known)],
    spare: &mut [(u32, Known)],
    root: &mut Node,
    below: &mut [Node],
    first: u32,
    depth: u32,
) {
    let all = lights[1..]
        .iter()
        .fold(lights[0].1, |all, l| union(&all, &l.1));
    if lights.len() == 1 {
        *root = Node {
            bounds: all.bounds,
            first: lights[0].0,
            is_leaf: true,
        };
        return;
    }
    *root = Node {
        bounds: all.bounds,
        first,
        is_leaf: false,
    };
    let middle = split(lights, spare, &all.bounds, depth);
    let alone = lights.len() < ALONE;
    let (lights, spare) = (lights.split_at_mut(middle), spare.split_at_mut(middle));
    let (pair, rest) = below.split_at_mut(2);
    let (left, right) = pair.split_at_mut(1);
    let below_left = 2 * middle - 2;
    let (rest_left, rest_right) = rest.split_at_mut(below_left);
    let next = first + 2;
    let (left_first, right_first) = (next, next + below_left as u32);
    let depth = depth + 1;
    let mut left = || {
        grow(
            lights.0,
            spare.0,
            &mut left[0],
            rest_left,
            left_first,
            depth,
        )
    };
    let mut right = || {
        grow(
            lights.1,
            spare.1,
            &mut right[0],
            rest_right,
            right_first,
            depth,
        )
    };
    if alone {
        left();
        right();
    } else {
        rayon::join(left, right);
    }
}

/// Around both.
fn union(a: &Known, b: &Known) -> Known {
    let (axis, cos_normals, normals) = union_cones(a, b);
    let (a, b) = (&a.bounds, &b.bounds);
    Known {
        bounds: LightBounds {
            min: a.min.min(b.min),
            max: a.max.max(b.max),
            axis,
            strength: a.strength + b.strength,
            cos_normals,
            cos_emission: a.cos_emission.min(b.cos_emission),
            two_sided: a.two_sided || b.two_sided,
        },
        normals,
    }
}

/// The smallest cone around the cones of two: axis, cosine of the half angle and that angle; widened by a
/// hair so that rounding leaves nothing outside.
fn union_cones(a: &Known, b: &Known) -> (Vec3, f32, f64) {
    let first = (a.bounds.axis, a.bounds.cos_normals, a.normals);
    let second = (b.bounds.axis, b.bounds.cos_normals, b.normals);
    let cos = first.0.dot(second.0);
    // A single direction within the other cone, which is nearly always so, needs no angles.
    if second.1 >= 1.0 && cos >= first.1 {
        return first;
    }
    if first.1 >= 1.0 && cos >= second.1 {
        return second;
    }
    let pi = std::f64::consts::PI;
    let (ta, tb) = (first.2, second.2);
    let between = angle(cos);
    if (between + tb).min(pi) <= ta {
        return first;
    }
    if (between + ta).min(pi) <= tb {
        return second;
    }
    let half = (ta + between + tb) / 2.0 + 1e-4;
    let across = first.0.cross(second.0);
    if half >= pi || across.dot(across) < 1e-12 {
        return (first.0, -1.0, pi);
    }
    // Turn a's axis towards b's by what a's cone lacks (Rodrigues).
    let turn = half - ta;
    let k = crate::math::normalize(across);
    let (s, c) = (libm::sin(turn) as f32, libm::cos(turn) as f32);
    let axis = first.0 * c + k.cross(first.0) * s + k * (k.dot(first.0) * (1.0 - c));
    let cos = libm::cos(half) as f32;
    (crate::math::normalize(axis), cos, angle(cos))
}

/// Box and strength of the lights in a cell: what a cut costs at least follows from them without any
/// angles.
#[derive(Clone, Copy)]
struct Cell {
    min: Vec3,
    max: Vec3,
    strength: f32,
}

impl Cell {
    const EMPTY: Cell = Cell {
        min: Vec3::INFINITY,
        max: Vec3::NEG_INFINITY,
        strength: 0.0,
    };
    fn add(&mut self, other: &Cell) {
        self.min = self.min.min(other.min);
        self.max = self.max.max(other.max);
        self.strength += other.strength;
    }
    fn is_empty(&self) -> bool {
        self.min.x > self.max.x
    }
    fn size(&self) -> f64 {
        size(self.strength, self.min, self.max)
    }
}

/// The least of `Cell::size` of both sides over the cuts between cells.
fn least_size(cells: &[Cell; BUCKETS]) -> f64 {
    let mut right = *cells;
    for i in (0..BUCKETS - 1).rev() {
        let next = right[i + 1];
        right[i].add(&next);
    }
    let mut left = Cell::EMPTY;
    let mut least = f64::INFINITY;
    for cut in 1..BUCKETS {
        left.add(&cells[cut - 1]);
        if !left.is_empty() && !right[cut].is_empty() {
            least = least.min(left.size() + right[cut].size());
        }
    }
    least
}

/// Reorders lights and says how many go left: the cheapest of the splits between buckets along each
/// axis, halves where there is none.
fn split(
    lights: &mut [(u32, Known)],
    spare: &mut [(u32, Known)],
    bounds: &LightBounds,
    depth: u32,
) -> usize {
    if lights.len() == 2 {
        return 1;
    }
    let center = |l: &Known| (l.bounds.min + l.bounds.max) * 0.5;
    let (lo, hi) = lights
        .iter()
        .fold((Vec3::INFINITY, Vec3::NEG_INFINITY), |(lo, hi), l| {
            (lo.min(center(&l.1)), hi.max(center(&l.1)))
        });
    let extent = bounds.max - bounds.min;
    let bucket = |l: &Known, axis: usize| {
        let x = (center(l)[axis] - lo[axis]) / (hi[axis] - lo[axis]) * BUCKETS as f32;
        (x as usize).min(BUCKETS - 1)
    };
    let axes = (0..3).filter(|&axis| hi[axis] > lo[axis]);
    let mut best: Option<(f64, usize, usize)> = None;
    if depth < DEPTH_MAX - 32 {
        // No cone of lights is narrower than that of one of them; a cut costs what its sides do at least
        // with that. Only along axes that may have the cheapest cut are cones put together.
        let narrowest = lights
            .iter()
            .fold(-1.0f32, |cos, l| cos.max(l.1.bounds.cos_normals));
        let is_usual = lights.iter().all(|l| l.1.bounds.cos_emission == 0.0);
        let least_angle = if is_usual {
            lit_angle(narrowest, angle(narrowest), 0.0) * (1.0 - 1e-9)
        } else {
            0.0
        };
        let mut order: Vec<(f64, usize)> = axes
            .map(|axis| {
                let mut cells = [Cell::EMPTY; BUCKETS];
                for (_, l) in lights.iter() {
                    cells[bucket(l, axis)].add(&Cell {
                        min: l.bounds.min,
                        max: l.bounds.max,
                        strength: l.bounds.strength,
                    });
                }
                let least = least_size(&cells) * least_angle * regular(extent, axis);
                (least, axis)
            })
            .collect();
        order.sort_by(|a, b| a.0.total_cmp(&b.0));
        for (least, axis) in order {
            if best.is_some_and(|(cost, ..)| least > cost) {
                continue;
            }
            cheapest(
                lights,
                |l| bucket(l, axis),
                |cut, cost| {
                    let cost = cost * regular(extent, axis);
                    let this = (cost, axis, cut);
                    // Of equals the first axis, and the first cut along it.
                    if best.is_none_or(|(c, a, _)| cost < c || (cost == c && axis < a)) {
                        best = Some(this);
                    }
                },
            );
        }
    }
    if let Some((_, axis, cut)) = best {
        // Stable, so that the order within a side does not depend on the algorithm.
        let (mut left, mut right) = (0, 0);
        for i in 0..lights.len() {
            let light = lights[i];
            if bucket(&light.1, axis) < cut {
                lights[left] = light;
                left += 1;
            } else {
                spare[right] = light;
                right += 1;
            }
        }
        lights[left..].copy_from_slice(&spare[..right]);
        if left > 0 && right > 0 {
            return left;
        }
    }
    lights.len() / 2
}

/// Thin boxes should be cut across.
fn regular(extent: Vec3, axis: usize) -> f64 {
    (extent.max_element() / extent[axis].max(1e-30)) as f64
}

/// Goes through the cuts along an axis and what they cost.
fn cheapest(
    lights: &[(u32, Known)],
    bucket: impl Fn(&Known) -> usize,
    mut found: impl FnMut(usize, f64),
) {
    let mut cells: [Option<Known>; BUCKETS] = [None; BUCKETS];
    for (_, l) in lights {
        let cell = &mut cells[bucket(l)];
        *cell = Some(cell.map_or(*l, |c| union(&c, l)));
    }
    // What lies right of each cut.
    let mut right = cells;
    for i in (0..BUCKETS - 1).rev() {
        right[i] = match (cells[i], right[i + 1]) {
            (Some(a), Some(b)) => Some(union(&b, &a)),
            (a, b) => a.or(b),
        };
    }
    let mut left: Option<Known> = None;
    for cut in 1..BUCKETS {
        // A cut after an empty cell is the one before it once more.
        let Some(cell) = &cells[cut - 1] else {
            continue;
        };
        let a = left.map_or(*cell, |l| union(&l, cell));
        left = Some(a);
        let Some(b) = &right[cut] else { break };
        found(cut, cost(&a) + cost(b));
    }
}

/// Strength times the solid angle that is lit times the surface of the box [ConEstevez18, section 4.4].
fn cost(known: &Known) -> f64 {
    let b = &known.bounds;
    let d = (b.max - b.min).max(Vec3::splat(1e-12));
    let area = (d.x * d.y + d.y * d.z + d.z * d.x) as f64;
    b.strength as f64 * lit_angle(b.cos_normals, known.normals, b.cos_emission) * area
}

/// [`cost`] without the angle.
fn size(strength: f32, min: Vec3, max: Vec3) -> f64 {
    let d = (max - min).max(Vec3::splat(1e-12));
    strength as f64 * (d.x * d.y + d.y * d.z + d.z * d.x) as f64
}

/// Solid angle that is lit by normals within an angle, given with its cosine, and the cosine of the angle
/// of emission.
fn lit_angle(cos_normals: f32, normals: f64, cos_emission: f32) -> f64 {
    let pi = std::f64::consts::PI;
    let cos = cos_normals.clamp(-1.0, 1.0) as f64;
    let sin = libm::sqrt(1.0 - cos * cos);
    let lit = (normals + angle(cos_emission)).min(pi);
    2.0 * pi * (1.0 - cos)
        + pi / 2.0 * (2.0 * lit * sin - libm::cos(normals - 2.0 * lit) - 2.0 * normals * sin + cos)
}

#[cfg(test)]
mod tests;
