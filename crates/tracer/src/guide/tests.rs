//! Densities against quadrature and statistics, lanes against one by one, cells against their contents.

use super::cells::Cells;
use super::directions::{Directions, Estimate, Quads, to_square};
use super::{WAYS, lanes, way_of};
use crate::hash;
use crate::lanes::{Float, Mask, Row, V3, Wide, entry};
use crate::{SimdLevel, sampling};
use glam::{Vec2, Vec3};

/// Uniform numbers by their number.
fn number(seed: u64, i: u64) -> f32 {
    hash::to_unit(hash::mix(hash::mix(seed) ^ i))
}

fn point(seed: u64, i: u64) -> Vec2 {
    Vec2::new(number(seed, 2 * i), number(seed, 2 * i + 1))
}

/// Densities of some lights: a small one, one that is spread, one of a single estimate a thousand times.
fn densities() -> (Quads, Vec<u32>) {
    let mut quads = Quads::new();
    let axis = Vec3::new(0.3, -0.8, -0.5).normalize();
    let sharp = |w: Vec3| if w.dot(axis) > 0.98 { 50.0 } else { 0.01 };
    let wide = |w: Vec3| w.x.max(0.0) + 0.2;
    let of = |seed: u64, light: &dyn Fn(Vec3) -> f32| -> Vec<Estimate> {
        (0..20_000)
            .map(|i| {
                let w = sampling::uniform_sphere(point(seed, i));
                let radiance = light(w);
                Estimate {
                    at: to_square(w).0,
                    light: radiance,
                    square: radiance * radiance,
                }
            })
            .collect()
    };
    let mut single = vec![of(1, &wide)[0]; 1000];
    let roots = vec![
        quads.add(&mut of(1, &sharp), 20_000),
        quads.add(&mut of(2, &wide), 20_000),
        quads.add(&mut single, 1000),
    ];
    (quads, roots)
}

#[test]
fn densities_have_an_integral_of_one() {
    let (quads, roots) = densities();
    for &root in &roots {
        assert_ne!(root, 0);
        let directions = Directions {
            quads: &quads.0,
            root,
        };
        // Over the square, where densities are piecewise smooth: 4 / r^3 of solid angle for each area.
        let side = if root == roots[2] { 1 << 12 } else { 1 << 10 };
        let mut sum = 0.0;
        for y in 0..side {
            for x in 0..side {
                let u = 2.0 * (x as f32 + 0.5) / side as f32 - 1.0;
                let v = 2.0 * (y as f32 + 0.5) / side as f32 - 1.0;
                let z = 1.0 - u.abs() - v.abs();
                let p = if z < 0.0 {
                    Vec3::new((1.0 - v.abs()).copysign(u), (1.0 - u.abs()).copysign(v), z)
                } else {
                    Vec3::new(u, v, z)
                };
                let r = f64::from(p.length());
                sum += f64::from(directions.pdf(p.normalize())) * 4.0 / (r * r * r);
            }
        }
        let integral = sum / f64::from(side * side);
        assert!((integral - 1.0).abs() < 2e-3, "root {root}: {integral}");
    }
}

#[test]
fn directions_are_drawn_with_the_density_that_they_have() {
    let (quads, roots) = densities();
    // Quadrature would not find the last one.
    for &root in &roots[..2] {
        let directions = Directions {
            quads: &quads.0,
            root,
        };
        // Means of functions under the density against quadrature with uniform directions.
        let n = 400_000;
        let of = |w: Vec3| [w.x, w.y, w.z, w.x * w.y, (w.z * 3.0).abs().min(1.0)];
        let (mut drawn, mut expected) = ([0.0f64; 5], [0.0f64; 5]);
        let mut differ = 0;
        for i in 0..n {
            let (w, density) = directions.sample(point(3, i));
            assert!((w.length() - 1.0).abs() < 1e-5);
            differ += u32::from((directions.pdf(w) / density - 1.0).abs() > 1e-3);
            let (x, y) = ((i % 632) as f32, (i / 632) as f32);
            let at = Vec2::new((x + 0.5) / 632.0, (y + 0.5) / 632.0) + Vec2::splat(1e-5);
            let uniform = sampling::uniform_sphere(at.min(Vec2::splat(0.999_999)));
            let pdf = f64::from(directions.pdf(uniform)) * 4.0 * std::f64::consts::PI;
            for k in 0..5 {
                drawn[k] += f64::from(of(w)[k]) / n as f64;
                expected[k] += pdf * f64::from(of(uniform)[k]) / n as f64;
            }
        }
        // Rounding may carry a direction over a border.
        assert!(differ < n as u32 / 1000, "root {root}: {differ} differ");
        for k in 0..5 {
            let off = (drawn[k] - expected[k]).abs();
            assert!(off < 6e-3, "root {root}: {drawn:?} against {expected:?}");
        }
    }
}

#[test]
fn no_light_is_no_density() {
    let mut quads = Quads::new();
    let estimate = |light: f32| Estimate {
        at: Vec2::splat(0.3),
        light,
        square: light * light,
    };
    assert_eq!(quads.add(&mut [estimate(0.0); 100], 100), 0);
    assert_eq!(quads.add(&mut [], 0), 0);
    assert_eq!(quads.add(&mut [estimate(f32::INFINITY); 100], 100), 0);
    assert_eq!(quads.add(&mut [estimate(f32::NAN); 100], 100), 0);
    // The squares of the smallest numbers vanish.
    assert_eq!(quads.add(&mut [estimate(1e-30); 100], 100), 0);
    assert_eq!(quads.0.len(), 1);
    assert_eq!(quads.add(&mut [estimate(1.0); 100], 100), 1);
}

/// Paths that ended have found nothing, and those that went on are worth more for it.
#[test]
fn irradiance_is_the_mean_of_all_paths() {
    let mut quads = Quads::new();
    let estimate = Estimate {
        at: Vec2::splat(0.3),
        light: 6.0,
        square: 36.0,
    };
    for (paths, expected) in [(100, 6.0), (400, 1.5)] {
        let root = quads.add(&mut [estimate; 100], paths);
        let directions = Directions {
            quads: &quads.0,
            root,
        };
        assert_eq!(directions.irradiance(), expected);
    }
}

#[test]
fn appended_densities_are_the_same() {
    let (quads, roots) = densities();
    let mut all = Quads::new();
    all.append(&quads);
    let before = all.append(&quads) - 1;
    for root in roots {
        let of = |quads, root| Directions { quads, root };
        for i in 0..1000 {
            let expected = of(&quads.0, root).sample(point(5, i));
            assert_eq!(of(&all.0, root + before).sample(point(5, i)), expected);
        }
    }
}

/// Draws for as many lanes as there are, from row 0 of each number on.
struct Drawn(Vec<(Vec3, f32)>);

entry! {
    /// [`lanes::draw`] at a level.
    fn draw(quads: &[Row], roots: &[u32], drawn: &[bool], out: &mut Drawn) -> () = this::draw_in;
}

mod this {
    pub(super) use super::draw_in;
}

#[inline(always)]
fn draw_in<W: Wide<N>, const N: usize>(
    quads: &[Row],
    roots: &[u32],
    drawn: &[bool],
    out: &mut Drawn,
) {
    for begin in (0..roots.len()).step_by(N) {
        let (mut x, mut y) = (Row::<N>::default(), Row::<N>::default());
        let mut given = [Row::<N>::default(); 3];
        let (mut of, mut is_drawn) = ([0; N], 0);
        for lane in 0..N {
            let i = (begin + lane) as u64;
            let u = point(7, i);
            (x.0[lane], y.0[lane]) = (u.x, u.y);
            let w = sampling::uniform_sphere(point(8, i));
            for axis in 0..3 {
                given[axis].0[lane] = w[axis];
            }
            of[lane] = roots[begin + lane];
            is_drawn |= u32::from(drawn[begin + lane]) << lane;
        }
        let numbers = (W::F::load(&x), W::F::load(&y));
        let (w, density) = lanes::draw::<W, N>(
            quads,
            &of,
            W::M::from_bits(is_drawn),
            numbers,
            V3::load(&given),
        );
        let mut columns = [Row::<N>::default(); 3];
        let mut densities = Row::<N>::default();
        w.store(&mut columns);
        density.store(&mut densities);
        for lane in 0..N {
            let [x, y, z] = [0, 1, 2].map(|axis| columns[axis].0[lane]);
            out.0.push((Vec3::new(x, y, z), densities.0[lane]));
        }
    }
}

#[test]
fn lanes_draw_the_same_bits() {
    let (quads, roots) = densities();
    let n = 4096;
    let roots: Vec<u32> = (0..n)
        .map(|i| match (4.0 * number(9, i)) as usize {
            3 => 0,
            k => roots[k],
        })
        .collect();
    let drawn: Vec<bool> = (0..n).map(|i| number(10, i) < 0.5).collect();
    for level in [SimdLevel::Scalar, SimdLevel::Avx2, SimdLevel::best()] {
        let mut out = Drawn(vec![]);
        draw(level.available(), &quads.0, &roots, &drawn, &mut out);
        for i in 0..n as usize {
            if roots[i] == 0 {
                continue;
            }
            let directions = Directions {
                quads: &quads.0,
                root: roots[i],
            };
            let expected = if drawn[i] {
                directions.sample(point(7, i as u64))
            } else {
                let w = sampling::uniform_sphere(point(8, i as u64));
                (w, directions.pdf(w))
            };
            let bits = |(w, pdf): (Vec3, f32)| (w.to_array().map(f32::to_bits), pdf.to_bits());
            assert_eq!(bits(out.0[i]), bits(expected), "{level:?}, lane {i}");
        }
    }
}

#[test]
fn every_place_is_in_its_cell_and_spot() {
    let flat = |i: u64| {
        let p = point(11, i);
        Vec3::new(3.0 * p.x - 100.0, 0.0, 0.01 * p.y * p.y)
    };
    let far = |i: u64| flat(i) * if i.is_multiple_of(1000) { 1e30 } else { 1.0 };
    let same = |_: u64| Vec3::ONE;
    let of: [(&dyn Fn(u64) -> Vec3, u64); 6] = [
        (&flat, 200_000),
        (&flat, 100),
        (&far, 50_000),
        (&same, 50_000),
        (&same, 1),
        (&same, 0),
    ];
    for (place, n) in of {
        let places: Vec<Vec3> = (0..n).map(place).collect();
        let (cells, order) = Cells::new(&places);
        assert!(!order.cells.is_empty() && !order.spots.is_empty());
        let mut seen = vec![false; places.len()];
        for (spot, range) in order.spots.iter().enumerate() {
            for visit in &order.visits[range.clone()] {
                let p = places[visit.index as usize];
                assert_eq!(cells.spot(p), spot as u32, "{p}");
                assert!(!std::mem::replace(&mut seen[visit.index as usize], true));
            }
        }
        assert!(seen.iter().all(|s| *s));
        for (cell, range) in order.cells.iter().enumerate() {
            for visit in &order.visits[range.clone()] {
                assert_eq!(cells.cell(places[visit.index as usize]), cell as u32);
            }
        }
        // Anywhere else is somewhere, too.
        for p in [Vec3::splat(1e38), Vec3::NEG_INFINITY, Vec3::NAN, Vec3::ZERO] {
            assert!((cells.cell(p) as usize) < order.cells.len());
            assert!((cells.spot(p) as usize) < order.spots.len());
        }
    }
}

#[test]
fn surfaces_face_whoever_looks_at_them() {
    for axis in 0..3 {
        let mut n = Vec3::splat(0.1);
        n[axis] = 0.9;
        let n = n.normalize();
        assert_eq!(way_of(n, -n), axis as u32);
        assert_eq!(way_of(-n, -n), axis as u32);
        assert_eq!(way_of(n, n), axis as u32 + 3);
    }
    assert!(way_of(Vec3::NAN, Vec3::X) < WAYS);
}
