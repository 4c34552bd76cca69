use super::*;
use scene::model::SamplerKind::{Independent, Lattice, OwenSobol, Stratified};

fn points(kind: SamplerKind, count: u32, dimension: u32, pixel: [u32; 2]) -> Vec<Vec2> {
    (0..count)
        .map(|i| {
            let mut pixel = PixelPoints::new(kind, PixelKey::new(7, 0, pixel));
            let mut s = Sampler::start(&mut pixel, i);
            let mut p = Vec2::ZERO;
            for _ in 0..=dimension {
                p = s.next_2d();
            }
            p
        })
        .collect()
}

/// Every pair of an aligned block of 2^m points is a (0, m, 2)-net: one point in each elementary
/// interval of area 2^-m.
#[test]
fn sobol_pairs_are_nets() {
    for dimension in [0, 1, 5, 40] {
        for m in [2u32, 4, 6, 8] {
            let n = 1 << m;
            let all = points(OwenSobol, 2 * n, dimension, [3, 9]);
            for block in all.chunks(n as usize) {
                for k in 0..=m {
                    let (nx, ny) = (1 << k, 1 << (m - k));
                    let mut seen = vec![0; n as usize];
                    for p in block {
                        let (x, y) = ((p.x * nx as f32) as usize, (p.y * ny as f32) as usize);
                        seen[y * nx + x] += 1;
                    }
                    assert!(
                        seen.iter().all(|c| *c == 1),
                        "dimension {dimension}, m {m}, k {k}: {seen:?}"
                    );
                }
            }
        }
    }
}

#[test]
fn stratified_blocks_fill_every_cell() {
    for (b, block) in points(Stratified, 64, 3, [1, 2]).chunks(16).enumerate() {
        let mut cells: Vec<usize> = block
            .iter()
            .map(|p| (p.y * 4.0) as usize * 4 + (p.x * 4.0) as usize)
            .collect();
        cells.sort_unstable();
        assert_eq!(cells, (0..16).collect::<Vec<_>>(), "block {b}");
    }
}

/// Mean and correlation of each sampler over many pixels are those of uniform numbers.
#[test]
fn numbers_are_uniform_and_uncorrelated() {
    for kind in [Lattice, OwenSobol, Stratified, Independent] {
        let (mut sum, mut product, mut cross, mut n) = (Vec2::ZERO, 0.0f64, 0.0f64, 0.0f64);
        for pixel in 0..4096u32 {
            let mut points = PixelPoints::new(kind, PixelKey::new(1, 0, [pixel % 64, pixel / 64]));
            let mut s = Sampler::start(&mut points, pixel % 7);
            let (a, b) = (s.next_2d(), s.next_2d());
            assert!(a.min_element() >= 0.0 && a.max_element() < 1.0);
            sum += a;
            product += ((a.x - 0.5) * (a.y - 0.5)) as f64;
            cross += ((a.x - 0.5) * (b.x - 0.5)) as f64;
            n += 1.0;
        }
        let sigma = (1.0 / 12.0f64 / n).sqrt();
        let mean = sum / n as f32;
        assert!(
            (mean.x as f64 - 0.5).abs() < 4.5 * sigma && (mean.y as f64 - 0.5).abs() < 4.5 * sigma,
            "{kind:?} {mean}"
        );
        let sigma = 1.0 / 12.0 / n.sqrt();
        assert!(
            (product / n).abs() < 4.5 * sigma,
            "{kind:?} x y {}",
            product / n
        );
        assert!(
            (cross / n).abs() < 4.5 * sigma,
            "{kind:?} across dimensions {}",
            cross / n
        );
    }
}

/// Both halves of the error estimate are well spread on their own: in each elementary interval of a
/// quarter of the points, half of them at most are missing.
#[test]
fn halves_are_of_equal_size() {
    for m in 1..12 {
        let n = 1u32 << m;
        let second = (0..n).filter(|i| film::buffer::in_second_half(*i)).count() as u32;
        assert_eq!(second, n / 2);
    }
}

/// What the lanes compute are nets too, and the same numbers at every SIMD level.
#[test]
fn four_pairs_are_nets_at_every_level() {
    use crate::accel::simd::{SimdLevel, four_pairs};
    for key in [1u64, 0xdead_beef_1234_5678] {
        for m in [3u32, 6] {
            let n = 1u32 << m;
            let all: Vec<[Vec2; 4]> = (0..n)
                .map(|i| four_pairs(SimdLevel::Scalar, i.reverse_bits(), key))
                .collect();
            for level in [SimdLevel::Sse2, SimdLevel::Avx2, SimdLevel::Avx512] {
                let again: Vec<_> = (0..n)
                    .map(|i| four_pairs(level.available(), i.reverse_bits(), key))
                    .collect();
                assert_eq!(all, again, "{level:?}");
            }
            for pair in 0..4 {
                for k in 0..=m {
                    let (nx, ny) = (1usize << k, 1usize << (m - k));
                    let mut seen = vec![0; n as usize];
                    for p in all.iter().map(|p| p[pair]) {
                        seen[(p.y * ny as f32) as usize * nx + (p.x * nx as f32) as usize] += 1;
                    }
                    assert!(
                        seen.iter().all(|c| *c == 1),
                        "pair {pair}, m {m}, k {k}: {seen:?}"
                    );
                }
            }
        }
    }
}

/// The numbers of the camera and of `events` scattering events, in order.
fn numbers(kind: SamplerKind, pixel: [u32; 2], index: u32, events: usize) -> Vec<f32> {
    let level = SimdLevel::Scalar;
    let mut pixel = PixelPoints::new(kind, PixelKey::new(7, 0, pixel));
    let mut s = Sampler::start(&mut pixel, index);
    let (film, lens, time) = s.camera(level);
    let mut all = vec![film.x, film.y, lens.x, lens.y, time];
    for _ in 0..events {
        let b = s.bounce(level);
        all.extend([b.light.x, b.light.y, b.bsdf.x, b.bsdf.y]);
        all.extend([b.light_choice, b.lobe, b.roulette, b.mix]);
    }
    all
}

/// Each dimension of an aligned block of 2^m points has one point in each of 2^m equal parts (but for
/// the shift): what extends a picture fills the gaps of what is there.
#[test]
fn blocks_of_the_lattice_are_evenly_spaced() {
    for m in [3u32, 6, 9] {
        let n = 1usize << m;
        let all: Vec<Vec<f32>> = (0..2 * n as u32)
            .map(|i| numbers(Lattice, [3, 9], i, 3))
            .collect();
        for block in all.chunks(n) {
            for dimension in 0..all[0].len() {
                let mut x: Vec<f32> = block.iter().map(|p| p[dimension]).collect();
                x.sort_by(f32::total_cmp);
                for (i, pair) in x.windows(2).enumerate() {
                    let gap = (pair[1] - pair[0]) * n as f32;
                    assert!(
                        (gap - 1.0).abs() < 1e-3,
                        "m {m}, dimension {dimension}, gap {i}: {gap}"
                    );
                }
            }
        }
    }
}

/// The figure that the generating vector was searched by: P2 of the two coordinates of each decision,
/// times N^2, stays small at every power of two (a bad vector gives hundreds; N ln N / N^2 falls
/// almost as fast as the best possible).
#[test]
fn pairs_of_the_lattice_are_well_spread() {
    let b2 = |x: f64| x * x - x + 1.0 / 6.0;
    let pi = std::f64::consts::PI;
    let omega = |x: f64| 1.0 + 2.0 * pi * pi * b2(x);
    for (a, b) in [(0, 1), (2, 3), (5, 6), (7, 8)] {
        for m in 2..=12 {
            let n = 1u64 << m;
            let coordinate =
                |k: u64, d: usize| (k * lattice::VECTOR[d] as u64 % n) as f64 / n as f64;
            let sum: f64 = (0..n)
                .map(|k| omega(coordinate(k, a)) * omega(coordinate(k, b)))
                .sum();
            let p2 = sum / n as f64 - 1.0;
            let scaled = p2 * (n * n) as f64 / (m * m) as f64;
            assert!(scaled < 20.0, "dimensions {a}, {b}, m {m}: {scaled:.2}");
        }
    }
}

/// All numbers of the lattice are uniform and, over pixels, uncorrelated with each other.
#[test]
fn lattice_dimensions_are_independent_over_pixels() {
    const PIXELS: u32 = 4096;
    let all: Vec<Vec<f32>> = (0..PIXELS)
        .map(|p| numbers(Lattice, [p % 64, p / 64], p % 5, 2))
        .collect();
    let sigma = 1.0 / 12.0 / f64::from(PIXELS).sqrt();
    for i in 0..all[0].len() {
        for j in 0..=i {
            let mean = all
                .iter()
                .map(|x| (f64::from(x[i]) - 0.5) * (f64::from(x[j]) - 0.5))
                .sum::<f64>()
                / f64::from(PIXELS);
            let expected = if i == j { 1.0 / 12.0 } else { 0.0 };
            assert!(
                (mean - expected).abs() < 5.0 * sigma,
                "dimensions {i}, {j}: {mean} in place of {expected}"
            );
        }
    }
}

#[test]
fn keys_of_several_pixels_are_those_of_each() {
    let pixels: [PixelKey; TOGETHER] =
        std::array::from_fn(|i| PixelKey::new(7, 1, [i as u32, 3 * i as u32]));
    for dimension in [0, 4, 400] {
        let together = PixelKey::lattice_keys_of(pixels, dimension);
        for (pixel, keys) in pixels.iter().zip(together) {
            let alone = pixel.lattice_keys(dimension);
            assert_eq!((alone.order, alone.shift), (keys.order, keys.shift));
        }
    }
}
