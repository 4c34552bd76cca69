//! Loop subdivision [Loop87]: triangles are split in four and smoothed, and at the end every vertex
//! moves to the limit surface, whose normals come from the tangent masks. Borders are smoothed as
//! curves. Normals point to the side from which the triangles run counterclockwise.

use glam::DVec3;
use std::collections::BTreeMap;
use std::f64::consts::PI;

type Triangles = Vec<[u32; 3]>;
type Refined = (Vec<[f32; 3]>, Vec<[f32; 3]>, Triangles);

/// Positions on the limit surface, normals, triangles.
pub(super) fn loop_subdivide(
    positions: &[[f32; 3]],
    triangles: &[[u32; 3]],
    levels: u32,
) -> Result<Refined, &'static str> {
    let mut points: Vec<DVec3> = positions
        .iter()
        .map(|p| DVec3::from_array(p.map(f64::from)))
        .collect();
    let mut triangles = triangles.to_vec();
    for _ in 0..levels {
        (points, triangles) = split(&points, &triangles)?;
    }
    let rings = rings(points.len(), &triangles)?;
    let limit: Vec<DVec3> = points
        .iter()
        .zip(&rings)
        .map(|(&p, ring)| match ring.border() {
            Some((a, b)) => p * 0.6 + (points[a] + points[b]) * 0.2,
            None if ring.around.is_empty() => p,
            None => {
                let n = ring.around.len();
                let weight = 1.0 / (n as f64 + 3.0 / (8.0 * beta(n)));
                p * (1.0 - n as f64 * weight) + ring.sum(&points) * weight
            }
        })
        .collect();
    let normals = limit
        .iter()
        .zip(&rings)
        .map(|(&p, ring)| normal(p, ring, &limit))
        .collect();
    let single = |p: DVec3| p.to_array().map(|x| x as f32);
    Ok((
        limit.iter().copied().map(single).collect(),
        normals,
        triangles,
    ))
}

/// The neighbours of a vertex, counterclockwise; a border vertex begins and ends at the border.
struct Ring {
    around: Vec<usize>,
    open: bool,
}

impl Ring {
    fn sum(&self, points: &[DVec3]) -> DVec3 {
        self.around.iter().map(|&i| points[i]).sum()
    }
    fn border(&self) -> Option<(usize, usize)> {
        match (self.open, self.around.first(), self.around.last()) {
            (true, Some(&a), Some(&b)) => Some((a, b)),
            _ => None,
        }
    }
}

fn beta(valence: usize) -> f64 {
    if valence == 3 {
        3.0 / 16.0
    } else {
        3.0 / (8.0 * valence as f64)
    }
}

const NOT_A_SURFACE: &str = "a loopsubdiv whose triangles do not form a surface: an edge belongs to more than two, or a \
    vertex to separate parts, or neighbours have different orientation";

fn rings(count: usize, triangles: &[[u32; 3]]) -> Result<Vec<Ring>, &'static str> {
    // For every vertex: each neighbour and the one that follows it counterclockwise.
    let mut next: Vec<BTreeMap<usize, usize>> = vec![BTreeMap::new(); count];
    for &[a, b, c] in triangles {
        let [a, b, c] = [a, b, c].map(|i| i as usize);
        if a == b || b == c || c == a {
            return Err("a loopsubdiv with a triangle that uses a vertex twice");
        }
        for (at, from, to) in [(a, b, c), (b, c, a), (c, a, b)] {
            if next[at].insert(from, to).is_some() {
                return Err(NOT_A_SURFACE);
            }
        }
    }
    next.iter()
        .map(|next| {
            let entered: std::collections::BTreeSet<usize> = next.values().copied().collect();
            // A border begins where nothing leads to.
            let start = next.keys().copied().find(|from| !entered.contains(from));
            let open = start.is_some();
            let mut around = Vec::with_capacity(next.len() + 1);
            let mut at = start.or_else(|| next.keys().next().copied());
            while let Some(here) = at {
                around.push(here);
                at = next
                    .get(&here)
                    .copied()
                    .filter(|&to| open || to != around[0]);
                if around.len() > next.len() + 1 {
                    return Err(NOT_A_SURFACE);
                }
            }
            if around.len() != next.len() + usize::from(open) {
                return Err(NOT_A_SURFACE);
            }
            Ok(Ring { around, open })
        })
        .collect()
}

fn split(
    points: &[DVec3],
    triangles: &[[u32; 3]],
) -> Result<(Vec<DVec3>, Triangles), &'static str> {
    let rings = rings(points.len(), triangles)?;
    let mut out: Vec<DVec3> = points
        .iter()
        .zip(&rings)
        .map(|(&p, ring)| match ring.border() {
            Some((a, b)) => p * 0.75 + (points[a] + points[b]) * 0.125,
            None => {
                let n = ring.around.len();
                if n == 0 {
                    return p;
                }
                p * (1.0 - n as f64 * beta(n)) + ring.sum(points) * beta(n)
            }
        })
        .collect();
    // The vertices opposite an edge: one at a border, else two.
    let mut opposite: BTreeMap<(u32, u32), [Option<u32>; 2]> = BTreeMap::new();
    let key = |a: u32, b: u32| (a.min(b), a.max(b));
    for &[a, b, c] in triangles {
        for (a, b, c) in [(a, b, c), (b, c, a), (c, a, b)] {
            let slots = opposite.entry(key(a, b)).or_default();
            match slots.iter_mut().find(|s| s.is_none()) {
                Some(slot) => *slot = Some(c),
                None => return Err(NOT_A_SURFACE),
            }
        }
    }
    let mut middle = BTreeMap::new();
    for (&(a, b), sides) in &opposite {
        let (pa, pb) = (points[a as usize], points[b as usize]);
        let point = match *sides {
            [Some(c), Some(d)] => {
                (pa + pb) * 0.375 + (points[c as usize] + points[d as usize]) * 0.125
            }
            _ => (pa + pb) * 0.5,
        };
        middle.insert(
            (a, b),
            u32::try_from(out.len()).map_err(|_| "too many vertices")?,
        );
        out.push(point);
    }
    let mut finer = Vec::with_capacity(triangles.len() * 4);
    for &[a, b, c] in triangles {
        let (Some(&ab), Some(&bc), Some(&ca)) = (
            middle.get(&key(a, b)),
            middle.get(&key(b, c)),
            middle.get(&key(c, a)),
        ) else {
            return Err(NOT_A_SURFACE);
        };
        finer.extend([[a, ab, ca], [ab, b, bc], [ca, bc, c], [ab, bc, ca]]);
    }
    Ok((out, finer))
}

/// The normal of the limit surface, from the two tangent masks.
fn normal(p: DVec3, ring: &Ring, points: &[DVec3]) -> [f32; 3] {
    let n = ring.around.len();
    let at = |i: usize| points[ring.around[i]];
    let (mut s, mut t) = (DVec3::ZERO, DVec3::ZERO);
    if !ring.open {
        for i in 0..n {
            let angle = 2.0 * PI * i as f64 / n as f64;
            s += at(i) * libm::cos(angle);
            t += at(i) * libm::sin(angle);
        }
    } else if n >= 2 {
        s = at(0) - at(n - 1);
        t = match n {
            2 => at(0) + at(1) - p * 2.0,
            3 => at(1) - p,
            4 => at(1) * 2.0 + at(2) * 2.0 - at(0) - at(3) - p * 2.0,
            _ => {
                let theta = PI / (n - 1) as f64;
                let mut sum = (at(0) + at(n - 1)) * libm::sin(theta);
                for i in 1..n - 1 {
                    sum += at(i) * ((2.0 * libm::cos(theta) - 2.0) * libm::sin(i as f64 * theta));
                }
                -sum
            }
        };
    }
    s.cross(t)
        .normalize_or(DVec3::Z)
        .to_array()
        .map(|x| x as f32)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_octahedron_becomes_round_and_points_outwards() {
        let p = [
            [1., 0., 0.],
            [-1., 0., 0.],
            [0., 1., 0.],
            [0., -1., 0.],
            [0., 0., 1.],
            [0., 0., -1.],
        ];
        let mut triangles = Vec::new();
        for (i, j, k) in [
            (0, 2, 4),
            (2, 1, 4),
            (1, 3, 4),
            (3, 0, 4),
            (2, 0, 5),
            (1, 2, 5),
            (3, 1, 5),
            (0, 3, 5),
        ] {
            triangles.push([i, j, k]);
        }
        let (points, normals, fine) = loop_subdivide(&p, &triangles, 3).unwrap();
        assert_eq!(fine.len(), 8 * 64);
        let radius: Vec<f32> = points
            .iter()
            .map(|p| p.iter().map(|x| x * x).sum::<f32>().sqrt())
            .collect();
        let (least, most) = radius
            .iter()
            .fold((9.0f32, 0.0f32), |(l, m), &r| (l.min(r), m.max(r)));
        assert!(most / least < 1.2, "{least} {most}");
        for (p, n) in points.iter().zip(&normals) {
            assert!(
                p.iter().zip(n).map(|(p, n)| p * n).sum::<f32>() > 0.0,
                "{p:?} {n:?}"
            );
        }
    }

    #[test]
    fn a_flat_square_stays_flat_and_keeps_its_side() {
        let p = [[0., 0., 0.], [1., 0., 0.], [1., 1., 0.], [0., 1., 0.]];
        let (points, normals, fine) = loop_subdivide(&p, &[[0, 1, 2], [0, 2, 3]], 2).unwrap();
        assert_eq!(fine.len(), 32);
        assert!(points.iter().all(|p| p[2] == 0.0));
        for n in &normals {
            assert!(n[2] > 0.99, "{n:?}");
        }
    }

    #[test]
    fn what_is_no_surface_is_refused() {
        let p = [
            [0., 0., 0.],
            [1., 0., 0.],
            [1., 1., 0.],
            [0., 1., 0.],
            [0., 0., 1.],
        ];
        assert!(loop_subdivide(&p, &[[0, 1, 2], [0, 1, 3]], 1).is_err());
        assert!(loop_subdivide(&p, &[[0, 1, 2], [1, 0, 3], [0, 1, 4]], 1).is_err());
        assert!(loop_subdivide(&p, &[[0, 0, 1]], 1).is_err());
        assert!(loop_subdivide(&p, &[[0, 1, 2], [0, 3, 4]], 1).is_err());
    }
}
