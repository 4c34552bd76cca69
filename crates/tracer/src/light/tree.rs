//! Choosing among many lights: a binary tree whose nodes know where their lights are, how strong they
//! are and where they shine. On the way down each child is taken in proportion to a bound on what it
//! can send to the point in question [ConEstevez18], in the form of [Pbrt4, 12.6.3].
//!
//! Strength is peak intensity instead of power, so that a lamp that shines one way competes fairly
//! with one that shines all around.

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
struct Node {
    bounds: LightBounds,
    /// Left child (the right one follows) of an inner node, light of a leaf.
    first: u32,
    is_leaf: bool,
}

/// The tree.
pub struct LightTree {
    nodes: Vec<Node>,
    /// For each light: the turns from the root to its leaf, lowest bit first (1 is right); `u64::MAX`
    /// for a light that is not in the tree.
    trails: Vec<u64>,
}

/// A tree is at most this deep, so that a trail fits.
const DEPTH_MAX: u32 = 60;
/// Cells along an axis that splits are tried between.
const BUCKETS: usize = 12;

impl LightTree {
    /// Over lights given with their indices; `count` is that of all lights. `None` if there is none.
    pub fn new(lights: &[(u32, LightBounds)], count: usize) -> Option<LightTree> {
        if lights.is_empty() {
            return None;
        }
        let mut tree = LightTree {
            nodes: vec![],
            trails: vec![u64::MAX; count],
        };
        let mut lights = lights.to_vec();
        let blank = Node {
            bounds: lights[0].1,
            first: 0,
            is_leaf: true,
        };
        tree.nodes.push(blank);
        let mut todo = vec![(0usize, 0usize, lights.len(), 0u64, 0u32)];
        while let Some((at, from, to, trail, depth)) = todo.pop() {
            let part = &mut lights[from..to];
            let bounds = part[1..].iter().fold(part[0].1, |b, l| union(&b, &l.1));
            if part.len() == 1 {
                tree.trails[part[0].0 as usize] = trail;
                tree.nodes[at] = Node {
                    bounds,
                    first: part[0].0,
                    is_leaf: true,
                };
                continue;
            }
            let middle = from + split(part, &bounds, depth);
            let left = tree.nodes.len();
            tree.nodes.extend([blank, blank]);
            tree.nodes[at] = Node {
                bounds,
                first: left as u32,
                is_leaf: false,
            };
            todo.push((left, from, middle, trail, depth + 1));
            todo.push((left + 1, middle, to, trail | 1 << depth, depth + 1));
        }
        Some(tree)
    }

    /// A light and its probability, for a point with a normal; `None` if no light reaches it.
    #[inline]
    pub fn sample(&self, p: Vec3, n: Vec3, mut u: f32) -> Option<(u32, f32)> {
        let mut node = &self.nodes[0];
        let mut pmf = 1.0;
        while !node.is_leaf {
            let (left, right) = (
                &self.nodes[node.first as usize],
                &self.nodes[node.first as usize + 1],
            );
            let (a, b) = (left.bounds.importance(p, n), right.bounds.importance(p, n));
            let sum = a + b;
            if sum.is_nan() || sum <= 0.0 {
                return None;
            }
            let share = a / sum;
            if u < share {
                u = (u / share).min(crate::math::ONE_MINUS_EPSILON);
                pmf *= share;
                node = left;
            } else {
                u = ((u - share) / (1.0 - share)).min(crate::math::ONE_MINUS_EPSILON);
                pmf *= 1.0 - share;
                node = right;
            }
        }
        (pmf > 0.0).then_some((node.first, pmf))
    }

    /// Probability that [`LightTree::sample`] gives a light.
    #[inline]
    pub fn pmf(&self, p: Vec3, n: Vec3, light: u32) -> f32 {
        let mut trail = self.trails[light as usize];
        if trail == u64::MAX {
            return 0.0;
        }
        let mut node = &self.nodes[0];
        let mut pmf = 1.0;
        while !node.is_leaf {
            let (left, right) = (
                &self.nodes[node.first as usize],
                &self.nodes[node.first as usize + 1],
            );
            let (a, b) = (left.bounds.importance(p, n), right.bounds.importance(p, n));
            let sum = a + b;
            if sum.is_nan() || sum <= 0.0 {
                return 0.0;
            }
            let share = a / sum;
            if trail & 1 == 0 {
                pmf *= share;
                node = left;
            } else {
                pmf *= 1.0 - share;
                node = right;
            }
            trail >>= 1;
        }
        pmf
    }
}

impl LightBounds {
    /// Bound on what the lights can send to a point with a normal, up to a factor.
    #[inline]
    fn importance(&self, p: Vec3, n: Vec3) -> f32 {
        let center = (self.min + self.max) * 0.5;
        let half = self.max - center;
        let radius2 = half.dot(half);
        let d = p - center;
        let distance2 = d.dot(d);
        // Inside the sphere around the box every direction is possible.
        let inv = 1.0 / distance2.max(1e-30).sqrt();
        let wi = d * inv;
        let cos_box = if distance2 <= radius2 {
            -1.0
        } else {
            (1.0 - radius2 / distance2).max(0.0).sqrt()
        };
        let sin_box = (1.0 - cos_box * cos_box).max(0.0).sqrt();
        let mut cos_axis = self.axis.dot(wi);
        if self.two_sided {
            cos_axis = cos_axis.abs();
        }
        // Angle to the nearest normal, as seen from the nearest point of the box.
        let sin_axis = (1.0 - cos_axis * cos_axis).max(0.0).sqrt();
        let sin_normals = (1.0 - self.cos_normals * self.cos_normals).max(0.0).sqrt();
        let (cos_x, sin_x) = subtract(cos_axis, sin_axis, self.cos_normals, sin_normals);
        let (cos_out, _) = subtract(cos_x, sin_x, cos_box, sin_box);
        if cos_out <= self.cos_emission {
            return 0.0;
        }
        // In a medium there is no normal, and all directions count alike.
        let cos_in = if n == Vec3::ZERO {
            1.0
        } else {
            wi.dot(n).abs()
        };
        let sin_in = (1.0 - cos_in * cos_in).max(0.0).sqrt();
        let (cos_in, _) = subtract(cos_in, sin_in, cos_box, sin_box);
        // Lights close to the point must not make the bound infinite.
        let falloff = distance2.max(radius2.sqrt());
        (self.strength * cos_out * cos_in / falloff.max(1e-30)).max(0.0)
    }
}

/// Cosine and sine of max(0, a - b).
#[inline(always)]
fn subtract(cos_a: f32, sin_a: f32, cos_b: f32, sin_b: f32) -> (f32, f32) {
    if cos_a > cos_b {
        return (1.0, 0.0);
    }
    (cos_a * cos_b + sin_a * sin_b, sin_a * cos_b - cos_a * sin_b)
}

/// Around both.
fn union(a: &LightBounds, b: &LightBounds) -> LightBounds {
    let (axis, cos_normals) = union_cones((a.axis, a.cos_normals), (b.axis, b.cos_normals));
    LightBounds {
        min: a.min.min(b.min),
        max: a.max.max(b.max),
        axis,
        strength: a.strength + b.strength,
        cos_normals,
        cos_emission: a.cos_emission.min(b.cos_emission),
        two_sided: a.two_sided || b.two_sided,
    }
}

/// The smallest cone around two cones, given by axis and cosine of the half angle; widened by a hair
/// so that rounding leaves nothing outside.
fn union_cones(a: (Vec3, f32), b: (Vec3, f32)) -> (Vec3, f32) {
    let pi = std::f64::consts::PI;
    let angle = |c: f32| libm::acos(c.clamp(-1.0, 1.0) as f64);
    let (ta, tb) = (angle(a.1), angle(b.1));
    let between = angle(a.0.dot(b.0));
    if (between + tb).min(pi) <= ta {
        return a;
    }
    if (between + ta).min(pi) <= tb {
        return b;
    }
    let half = (ta + between + tb) / 2.0 + 1e-4;
    let across = a.0.cross(b.0);
    if half >= pi || across.dot(across) < 1e-12 {
        return (a.0, -1.0);
    }
    // Turn a's axis towards b's by what a's cone lacks (Rodrigues).
    let turn = half - ta;
    let k = crate::math::normalize(across);
    let (s, c) = (libm::sin(turn) as f32, libm::cos(turn) as f32);
    let axis = a.0 * c + k.cross(a.0) * s + k * (k.dot(a.0) * (1.0 - c));
    (crate::math::normalize(axis), libm::cos(half) as f32)
}

/// Reorders lights and says how many go left: the cheapest of the splits between buckets along each
/// axis, halves where there is none.
fn split(lights: &mut [(u32, LightBounds)], bounds: &LightBounds, depth: u32) -> usize {
    let center = |l: &LightBounds| (l.min + l.max) * 0.5;
    let (lo, hi) = lights
        .iter()
        .fold((Vec3::INFINITY, Vec3::NEG_INFINITY), |(lo, hi), l| {
            (lo.min(center(&l.1)), hi.max(center(&l.1)))
        });
    let extent = bounds.max - bounds.min;
    let bucket = |l: &LightBounds, axis: usize| {
        let x = (center(l)[axis] - lo[axis]) / (hi[axis] - lo[axis]) * BUCKETS as f32;
        (x as usize).min(BUCKETS - 1)
    };
    let mut best: Option<(f64, usize, usize)> = None;
    if depth < DEPTH_MAX - 32 {
        for axis in 0..3 {
            if hi[axis] <= lo[axis] {
                continue;
            }
            let mut cells: [Option<LightBounds>; BUCKETS] = [None; BUCKETS];
            for (_, l) in lights.iter() {
                let cell = &mut cells[bucket(l, axis)];
                *cell = Some(cell.map_or(*l, |c| union(&c, l)));
            }
            // Thin boxes should be cut across.
            let regular = (extent.max_element() / extent[axis].max(1e-30)) as f64;
            for cut in 1..BUCKETS {
                let side = |range: &[Option<LightBounds>]| {
                    range
                        .iter()
                        .flatten()
                        .fold(None, |s: Option<LightBounds>, c| {
                            Some(s.map_or(*c, |s| union(&s, c)))
                        })
                };
                if let (Some(a), Some(b)) = (side(&cells[..cut]), side(&cells[cut..])) {
                    let cost = (cost(&a) + cost(&b)) * regular;
                    if best.is_none_or(|(c, _, _)| cost < c) {
                        best = Some((cost, axis, cut));
                    }
                }
            }
        }
    }
    if let Some((_, axis, cut)) = best {
        // Stable, so that the order within a side does not depend on the algorithm.
        let (left, right): (Vec<_>, Vec<_>) = lights.iter().partition(|l| bucket(&l.1, axis) < cut);
        if !left.is_empty() && !right.is_empty() {
            let n = left.len();
            lights.copy_from_slice(&[left, right].concat());
            return n;
        }
    }
    lights.len() / 2
}

/// Strength times the solid angle that is lit times the surface of the box [ConEstevez18, section 4.4].
fn cost(b: &LightBounds) -> f64 {
    let pi = std::f64::consts::PI;
    let normals = libm::acos(b.cos_normals.clamp(-1.0, 1.0) as f64);
    let emission = libm::acos(b.cos_emission.clamp(-1.0, 1.0) as f64);
    let lit = (normals + emission).min(pi);
    let angle = 2.0 * pi * (1.0 - libm::cos(normals))
        + pi / 2.0
            * (2.0 * lit * libm::sin(normals)
                - libm::cos(normals - 2.0 * lit)
                - 2.0 * normals * libm::sin(normals)
                + libm::cos(normals));
    let d = (b.max - b.min).max(Vec3::splat(1e-12));
    b.strength as f64 * angle * (d.x * d.y + d.y * d.z + d.z * d.x) as f64
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::{Rng, SeedableRng, rngs::StdRng};

    fn random(rng: &mut StdRng, count: usize) -> Vec<(u32, LightBounds)> {
        let mut v = |s: f32| {
            Vec3::new(
                rng.random_range(-s..s),
                rng.random_range(-s..s),
                rng.random_range(-s..s),
            )
        };
        (0..count as u32)
            .map(|i| {
                let (p, size, axis) = (
                    v(10.0),
                    v(0.3).abs(),
                    crate::math::normalize(v(1.0) + Vec3::splat(1e-3)),
                );
                let around = i % 5 == 0;
                let bounds = LightBounds {
                    min: p,
                    max: p + size,
                    axis,
                    strength: 1.0 + (i % 17) as f32,
                    cos_normals: if around { -1.0 } else { 1.0 },
                    cos_emission: 0.0,
                    two_sided: i % 7 == 0,
                };
                (i, bounds)
            })
            .collect()
    }

    /// Probabilities of all lights and of no light at all (a node may promise what neither of its
    /// children can keep) add to one, and are those with which lights come.
    #[test]
    fn probabilities_add_up_and_are_those_of_the_samples() {
        let mut rng = StdRng::seed_from_u64(5);
        for count in [1, 2, 3, 17, 400] {
            let lights = random(&mut rng, count);
            let tree = LightTree::new(&lights, count).expect("there are lights");
            for _ in 0..8 {
                let p = Vec3::new(
                    rng.random_range(-20.0..20.0),
                    rng.random_range(-20.0..20.0),
                    rng.random_range(-20.0..20.0),
                );
                let n = crate::math::normalize(Vec3::new(
                    rng.random_range(-1.0..1.0),
                    0.3,
                    rng.random_range(-1.0..1.0),
                ));
                let sum: f64 = (0..count as u32).map(|l| tree.pmf(p, n, l) as f64).sum();
                assert!(sum < 1.0 + 1e-4, "{count} lights at {p}: {sum}");
                let mut missed = 0;
                for i in 0..2000 {
                    if let Some((light, pmf)) = tree.sample(p, n, i as f32 / 2000.0) {
                        assert_eq!(
                            pmf,
                            tree.pmf(p, n, light),
                            "light {light} of {count} at {p}"
                        );
                        assert!(pmf > 0.0);
                    } else {
                        missed += 1;
                    }
                }
                let share = missed as f64 / 2000.0;
                assert!(
                    (1.0 - sum - share).abs() < 0.01,
                    "{count} lights at {p}: {sum} chosen, {share} missed"
                );
            }
        }
    }

    /// A light that can reach a point is never given up: the bound of each node on the way is positive
    /// wherever the light's own is.
    #[test]
    fn what_can_reach_a_point_can_be_chosen() {
        let mut rng = StdRng::seed_from_u64(6);
        let lights = random(&mut rng, 300);
        let tree = LightTree::new(&lights, 300).expect("there are lights");
        for _ in 0..200 {
            let p = Vec3::new(
                rng.random_range(-20.0..20.0),
                rng.random_range(-20.0..20.0),
                rng.random_range(-20.0..20.0),
            );
            let n = crate::math::normalize(Vec3::new(
                rng.random_range(-1.0..1.0),
                0.3,
                rng.random_range(-1.0..1.0),
            ));
            for (i, l) in &lights {
                let own = l.importance(p, n);
                if own > 1e-4 * l.strength {
                    assert!(
                        tree.pmf(p, n, *i) > 0.0,
                        "light {i} with bound {own} at {p}"
                    );
                }
            }
        }
    }
}
