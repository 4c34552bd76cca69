//! Polygons into triangles, concave ones by cutting off ears.

use glam::DVec3;

/// Longest outline whose ears are cut; longer ones are fanned, since cutting takes the cube of it.
const MAX_EARS: usize = 256;

/// Triangles of an outline, as indices into it.
pub(super) fn triangulate(outline: &[[f32; 3]]) -> Vec<[usize; 3]> {
    let count = outline.len();
    let fan = || (2..count).map(|i| [0, i - 1, i]).collect::<Vec<_>>();
    if count <= 3 || count > MAX_EARS {
        return fan();
    }
    let points: Vec<DVec3> = outline
        .iter()
        .map(|p| DVec3::from_array(p.map(f64::from)))
        .collect();
    // Newell's normal: the sum of the areas against the first corner.
    let normal = (2..count)
        .map(|i| (points[i - 1] - points[0]).cross(points[i] - points[0]))
        .sum::<DVec3>();
    let turn = |a: usize, b: usize, c: usize| {
        (points[b] - points[a])
            .cross(points[c] - points[b])
            .dot(normal)
    };
    if (0..count).all(|i| turn(i, (i + 1) % count, (i + 2) % count) >= 0.0) {
        return fan();
    }
    let mut left: Vec<usize> = (0..count).collect();
    let mut out = Vec::with_capacity(count - 2);
    while left.len() > 3 {
        let n = left.len();
        let corner = |i: usize| (left[(i + n - 1) % n], left[i], left[(i + 1) % n]);
        let is_ear = |i: usize| {
            let (a, b, c) = corner(i);
            turn(a, b, c) > 0.0
                && left.iter().all(|&p| {
                    p == a || p == b || p == c || {
                        let inside =
                            turn(a, b, p) >= 0.0 && turn(b, c, p) >= 0.0 && turn(c, a, p) >= 0.0;
                        !inside
                    }
                })
        };
        let Some(ear) = (0..n).find(|&i| is_ear(i)) else {
            // Crossing itself, or flat: whatever is cut is as wrong as anything else.
            break;
        };
        let (a, b, c) = corner(ear);
        out.push([a, b, c]);
        left.remove(ear);
    }
    out.extend((2..left.len()).map(|i| [left[0], left[i - 1], left[i]]));
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn areas_of_convex_and_concave_outlines() {
        let area = |outline: &[[f32; 3]]| -> f64 {
            let p = |i: usize| DVec3::from_array(outline[i].map(f64::from));
            triangulate(outline)
                .iter()
                .map(|&[a, b, c]| 0.5 * (p(b) - p(a)).cross(p(c) - p(a)).length())
                .sum()
        };
        let square = [
            [0.0, 0.0, 0.0],
            [2.0, 0.0, 0.0],
            [2.0, 2.0, 0.0],
            [0.0, 2.0, 0.0],
        ];
        assert_eq!(area(&square), 4.0);
        // An L, whichever corner it begins with: a fan would cover more than it has.
        let l = [
            [0.0, 0.0],
            [2.0, 0.0],
            [2.0, 1.0],
            [1.0, 1.0],
            [1.0, 2.0],
            [0.0, 2.0],
        ];
        for first in 0..6 {
            let outline: Vec<[f32; 3]> = (0..6)
                .map(|i| [l[(first + i) % 6][0], 5.0, l[(first + i) % 6][1]])
                .collect();
            assert!((area(&outline) - 3.0).abs() < 1e-9, "from {first}");
            assert_eq!(triangulate(&outline).len(), 4);
        }
        assert_eq!(triangulate(&[[0.0; 3]; 7]).len(), 5);
    }
}
