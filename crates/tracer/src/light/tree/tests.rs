//! Trees of lights: probabilities, bounds, threads, lanes.

use super::*;
use crate::lanes::{Float, Int, Plain, Row, V3, Wide};
use crate::light::Asking;
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

/// However many threads build a tree, it is the same.
#[test]
fn threads_change_no_bit_of_a_tree() {
    let mut rng = StdRng::seed_from_u64(7);
    let lights = random(&mut rng, 3 * ALONE);
    let [one, three] = [1, 3].map(|threads| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build();
        let pool = pool.expect("threads start");
        format!("{:?}", pool.install(|| binary(&lights)))
    });
    assert!(one == three);
}

/// What is known of a cut without its cones never says that it costs more than it does.
#[test]
fn the_least_that_a_cut_costs_is_not_more_than_it_costs() {
    let mut rng = StdRng::seed_from_u64(8);
    for count in [3, 10, 300] {
        let lights = random(&mut rng, count);
        let known: Vec<Known> = lights.iter().map(|l| Known::new(l.1)).collect();
        let narrowest = known
            .iter()
            .map(|k| k.bounds.cos_normals)
            .fold(-1.0, f32::max);
        let least = lit_angle(narrowest, angle(narrowest), 0.0) * (1.0 - 1e-9);
        let mut all = known[0];
        for k in &known[1..] {
            all = union(&all, k);
            let b = &all.bounds;
            let bound = size(b.strength, b.min, b.max) * least;
            assert!(bound <= cost(&all), "{bound} of {all:?}");
        }
    }
}

/// Probabilities of all lights and of no light at all (a node may promise what neither of its
/// children can keep) add to one, and are those with which lights come.
#[test]
fn probabilities_add_up_and_are_those_of_the_samples() {
    let mut rng = StdRng::seed_from_u64(5);
    for count in [1, 2, 3, 17, 400] {
        let lights = random(&mut rng, count);
        let tree = LightTree::new(&lights, count, crate::simd()).expect("there are lights");
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
            let narrow = Aim { axis: n, narrow: 5 };
            for aim in [Aim::cosine(n), narrow, Aim::ANYWHERE] {
                let sum: f64 = (0..count as u32).map(|l| tree.pmf(p, aim, l) as f64).sum();
                assert!(sum < 1.0 + 1e-4, "{count} lights at {p}: {sum}");
                let mut missed = 0;
                for i in 0..2000 {
                    if let Some((light, pmf)) = tree.sample(p, aim, i as f32 / 2000.0) {
                        assert_eq!(
                            pmf,
                            tree.pmf(p, aim, light),
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
}

/// A light that can reach a point is never given up: the bound of each node on the way is positive
/// wherever the light's own is.
#[test]
fn what_can_reach_a_point_can_be_chosen() {
    let mut rng = StdRng::seed_from_u64(6);
    let lights = random(&mut rng, 300);
    let tree = LightTree::new(&lights, 300, crate::simd()).expect("there are lights");
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
            let own = simd::importances(
                SimdLevel::Scalar,
                &Cluster::new([Some(*l)].into_iter()),
                p,
                Aim::cosine(n),
            )[0];
            if own > 1e-4 * l.strength {
                assert!(
                    tree.pmf(p, Aim::cosine(n), *i) > 0.0,
                    "light {i} with bound {own} at {p}"
                );
            }
        }
    }
}

/// In lanes points get the lights, and these the probabilities, that they get one by one.
fn check_lanes<const N: usize>() {
    let mut rng = StdRng::seed_from_u64(9);
    let (mut chosen, mut missed) = (0, 0);
    for count in [2, 3, 4, 17, 400] {
        let mut lights = random(&mut rng, count);
        if count == 4 {
            // Sums of these overflow.
            for (_, bounds) in &mut lights {
                bounds.strength = f32::MAX;
            }
        }
        let tree = LightTree::new(&lights, count, SimdLevel::Scalar).expect("there are lights");
        let pairs = Pairs::new(&binary(&lights));
        for round in 0..200 {
            let mut rows = [Row::<N>::default(); 7];
            let mut narrow = [0; N];
            let asked: [(Vec3, Aim, f32); N] = std::array::from_fn(|lane| {
                let mut v = |s: f32| Vec3::from([(); 3].map(|()| rng.random_range(-s..s)));
                let (p, axis) = (v(20.0), crate::math::normalize(v(1.0)));
                let u = rng.random_range(0.0..1.0);
                let aim = match (round + lane) % 3 {
                    0 => Aim::cosine(axis),
                    1 => Aim::ANYWHERE,
                    _ => Aim {
                        axis,
                        narrow: (lane % 7) as u32,
                    },
                };
                let of = [p.x, p.y, p.z, aim.axis.x, aim.axis.y, aim.axis.z, u];
                for (row, x) in rows.iter_mut().zip(of) {
                    row.0[lane] = x;
                }
                narrow[lane] = aim.narrow;
                (p, aim, u)
            });
            let [x, y, z, ax, ay, az, u] = rows.map(|row| <Plain as Wide<N>>::F::load(&row));
            let asking = Asking::<Plain, N> {
                p: V3::new(x, y, z),
                axis: V3::new(ax, ay, az),
                narrow: <Plain as Wide<N>>::I::load(&narrow),
            };
            let (light, pmf) = pairs.sample::<Plain, N>(&asking, u);
            let (mut found, mut probability) = (Row::<N>::default(), Row::<N>::default());
            <Plain as Wide<N>>::F::from_bits(light).store(&mut found);
            pmf.store(&mut probability);
            for (lane, (p, aim, u)) in asked.into_iter().enumerate() {
                let expected = tree.sample(p, aim, u);
                let pmf = probability.0[lane];
                assert!(pmf >= 0.0, "{count} lights: {pmf}");
                let got = (pmf > 0.0).then(|| (found.0[lane].to_bits(), pmf));
                assert_eq!(got, expected, "{count} lights, {aim:?} at {p}, {u}");
                chosen += got.is_some() as u32;
                missed += got.is_none() as u32;
            }
        }
    }
    assert!(
        chosen > 5000 && missed > 50,
        "{chosen} chosen, {missed} missed"
    );
}

#[test]
fn lanes_choose_as_points_by_themselves() {
    check_lanes::<8>();
    check_lanes::<16>();
}
