//! The tree of lights for many points at once: each lane goes its own way down, two clusters at a time.
//!
//! What a lane computes is what [`importances`](super::cluster::importances) and [`LightTree::sample`] compute, in
//! the same order.
//!
//! [`LightTree::sample`]: super::tree::LightTree::sample

#![allow(
    clippy::needless_range_loop,
    reason = "a lane is a place in several arrays at once"
)]

use super::cluster::{Cluster, LEAST};
use super::tree::{LEAF, Node};
use crate::lanes::{Float, Int, Mask, Row, V3, Wide};
use crate::math::ONE_MINUS_EPSILON;

/// Inner nodes of the binary tree, the root first.
#[derive(Clone, Debug, Default)]
pub struct Pairs(Vec<Pair>);

/// What is known of the children of a node; see [`Cluster`].
#[derive(Clone, Copy, Debug)]
#[repr(C, align(64))]
struct Pair([Member; 2]);

/// Centre, radius, axis, strength; cosine and sine of normals, cosine of emission, sides, and the word of the child
/// (bits): a pair, or a light with [`LEAF`] set.
type Member = [Row; 2];

/// Points that lights are chosen for, and what for; see [`Aim`](super::Aim).
#[derive(Clone, Copy)]
pub struct Asking<W: Wide<N>, const N: usize> {
    /// The points.
    pub p: V3<W, N>,
    /// Axes; zero where all directions count alike.
    pub axis: V3<W, N>,
    /// How often the cosine is squared.
    pub narrow: W::I,
}

impl Pairs {
    /// Of a binary tree with more than one node, node 0 the root.
    pub fn new(binary: &[Node]) -> Pairs {
        // Left children come right after their parents: they are visited soon.
        let mut pairs = Pairs(vec![]);
        let mut todo = vec![(0, None)];
        while let Some((node, place)) = todo.pop() {
            let at = pairs.0.len() as u32;
            if let Some((above, side)) = place {
                pairs.set_word(above, side, at);
            }
            let first = binary[node].first as usize;
            let children = [first, first + 1];
            pairs.0.push(Pair(children.map(|child| {
                let child = &binary[child];
                member(Cluster::new([Some(child.bounds)].into_iter()))
            })));
            for side in [1, 0] {
                let child = children[side];
                if binary[child].is_leaf {
                    pairs.set_word(at as usize, side, binary[child].first | LEAF);
                } else {
                    todo.push((child, Some((at as usize, side))));
                }
            }
        }
        pairs
    }

    fn set_word(&mut self, pair: usize, side: usize, word: u32) {
        self.0[pair].0[side][1].0[4] = f32::from_bits(word);
    }

    /// Lights and their probabilities, the latter 0 where no light reaches a point.
    #[inline(always)]
    pub fn sample<W: Wide<N>, const N: usize>(
        &self,
        asking: &Asking<W, N>,
        u: W::F,
    ) -> (W::I, W::F) {
        let (zero, one) = (W::F::splat(0.0), W::F::splat(1.0));
        let most = W::F::splat(ONE_MINUS_EPSILON);
        let leaf = W::I::splat(LEAF);
        let (mut u, mut pmf) = (u, one);
        let mut words = W::I::splat(0);
        let mut open = !W::M::from_bits(0);
        while open.to_bits() != 0 {
            // Lanes that have arrived look at the root.
            let at = places::<W, N>(words, open);
            let (left, left_word) = self.importance::<W, N>(&at, 0, asking);
            let (right, right_word) = self.importance::<W, N>(&at, 1, asking);
            let sum = left + right;
            let reached = zero.lt(sum);
            let share = left / sum;
            let rest = one - share;
            let goes_left = u.lt(share);
            let next = W::F::select(goes_left, u / share, (u - share) / rest).min(most);
            u = W::F::select(open, next, u);
            let part = W::F::select(goes_left, share, rest);
            let part = W::F::select(reached, part, zero);
            pmf = W::F::select(open, pmf * part, pmf);
            let word = W::F::select(goes_left, left_word, right_word);
            words = W::F::select(open, word, W::F::from_bits(words)).bits();
            open = open & reached & !(words & leaf).eq(leaf);
        }
        // NaN where bounds overflow: no light, as for one point.
        let pmf = W::F::select(zero.lt(pmf), pmf, zero);
        (words & W::I::splat(!LEAF), pmf)
    }

    /// Bounds on what one child of each node can send, and the words of the children.
    #[inline(always)]
    fn importance<W: Wide<N>, const N: usize>(
        &self,
        at: &[u32; N],
        side: usize,
        asking: &Asking<W, N>,
    ) -> (W::F, W::F) {
        let mut records = [[&Row::ZERO; N]; 2];
        for lane in 0..N {
            let [first, second] = &self.0[at[lane] as usize].0[side];
            records[0][lane] = first;
            records[1][lane] = second;
        }
        let [cx, cy, cz, radius, ax, ay, az, strength] = W::columns(records[0]);
        let [cos_normals, sin_normals, cos_emission, sided, word, ..] = W::columns(records[1]);
        let (zero, one) = (W::F::splat(0.0), W::F::splat(1.0));
        let d = asking.p - V3::new(cx, cy, cz);
        let distance2 = d.dot(d).max(W::F::splat(1e-30));
        let distance = distance2.sqrt();
        let inverse = one / distance;
        let wi = d * inverse;
        let sin = radius * inverse;
        let is_inside = distance.le(radius);
        let sin_box = W::F::select(is_inside, zero, sin);
        let cos_box = W::F::select(is_inside, W::F::splat(-1.0), cosine::<W, N>(sin));
        let cos_axis = wi.dot(V3::new(ax, ay, az));
        let cos_axis = W::F::select(zero.le(sided), cos_axis, cos_axis.abs());
        let sin_axis = cosine::<W, N>(cos_axis);
        let (cos_x, sin_x) = subtract::<W, N>((cos_axis, sin_axis), (cos_normals, sin_normals));
        let (cos_out, _) = subtract::<W, N>((cos_x, sin_x), (cos_box, sin_box));
        let cos_in = asking.cosine((cos_box, sin_box), wi);
        let falloff = distance2.max(radius);
        let bound = strength * cos_out * cos_in / falloff;
        let bound = W::F::select(cos_out.le(cos_emission), zero, bound);
        (bound.max(zero), word)
    }
}

impl<W: Wide<N>, const N: usize> Asking<W, N> {
    /// What light that comes along a direction, or within a cone about it, counts at most.
    #[inline(always)]
    fn cosine(&self, cone: (W::F, W::F), wi: V3<W, N>) -> W::F {
        let one = W::F::splat(1.0);
        let cos = wi.dot(self.axis).abs();
        let (mut cos, _) = subtract::<W, N>((cos, cosine::<W, N>(cos)), cone);
        let is_wide = self.narrow.eq(W::I::splat(0));
        let mut left = self.narrow;
        let mut is_done = is_wide;
        while (!is_done).to_bits() != 0 {
            cos = W::F::select(is_done, cos, cos * cos);
            left = left + W::I::splat(u32::MAX);
            is_done = is_done | left.eq(W::I::splat(0));
        }
        let cos = W::F::select(is_wide, cos, cos.max(W::F::splat(LEAST)));
        W::F::select(self.axis.is_zero(), one, cos)
    }
}

/// Of a cluster's first lane.
fn member(c: Cluster) -> Member {
    let [cx, cy, cz] = c.center.map(|x| x[0]);
    let [ax, ay, az] = c.axis.map(|x| x[0]);
    let (cos_normals, sin_normals) = (c.cos_normals[0], c.sin_normals[0]);
    let (cos_emission, sided) = (c.cos_emission[0], c.sided[0]);
    [
        Row([cx, cy, cz, c.radius[0], ax, ay, az, c.strength[0]]),
        Row([
            cos_normals,
            sin_normals,
            cos_emission,
            sided,
            0.0,
            0.0,
            0.0,
            0.0,
        ]),
    ]
}

/// Words as indices; 0 where a lane is not open.
#[inline(always)]
fn places<W: Wide<N>, const N: usize>(words: W::I, open: W::M) -> [u32; N] {
    let mut row = Row::<N>::default();
    W::F::select(open, W::F::from_bits(words), W::F::splat(0.0)).store(&mut row);
    let mut places = [0; N];
    for lane in 0..N {
        places[lane] = row.0[lane].to_bits();
    }
    places
}

/// The cosine to a sine, or the other way round.
#[inline(always)]
fn cosine<W: Wide<N>, const N: usize>(sin: W::F) -> W::F {
    (W::F::splat(1.0) - sin * sin).max(W::F::splat(0.0)).sqrt()
}

/// Cosine and sine of max(0, a - b), both given as (cosine, sine).
#[inline(always)]
fn subtract<W: Wide<N>, const N: usize>(a: (W::F, W::F), b: (W::F, W::F)) -> (W::F, W::F) {
    let cos = a.0 * b.0 + a.1 * b.1;
    let sin = a.1 * b.0 - a.0 * b.1;
    let is_less = a.0.le(b.0);
    (
        W::F::select(is_less, cos, W::F::splat(1.0)),
        W::F::select(is_less, sin, W::F::splat(0.0)),
    )
}
