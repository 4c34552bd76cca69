//! Clusters against the tree, bit for bit.

use super::sort::WORTH;
use super::*;
use crate::accel::Geometry;
use crate::accel::tests::{Tri, levels, of_both, point, rays};
use crate::ray::{Hit, Ray};
use rand::{Rng, SeedableRng, rngs::StdRng};

/// Triangles anywhere, those of a grid with its shared edges, and spheres, two of them in one place.
fn world(rng: &mut StdRng, triangles: usize, spheres: usize) -> Geometry {
    let mut soup: Vec<Tri> = (0..triangles / 2)
        .map(|_| {
            let p = point(rng, 2.0);
            [p, p + point(rng, 0.6), p + point(rng, 0.6)]
        })
        .collect();
    for i in soup.len()..triangles {
        let at = |i: usize| Vec3::new((i % 5) as f32 - 2.0, (i / 5 % 5) as f32 * 0.5 - 1.0, -0.5);
        let (x, y) = (Vec3::X, Vec3::Y * 0.5);
        let p = at(i / 2);
        soup.push(if i % 2 == 0 {
            [p, p + x, p + x + y]
        } else {
            [p, p + x + y, p + y]
        });
    }
    let mut balls: Vec<(Vec3, f32)> = (0..spheres)
        .map(|_| (point(rng, 2.0), rng.random_range(0.02..0.4)))
        .collect();
    if spheres > 1 {
        balls[1] = balls[0];
    }
    of_both(&soup, &balls, SimdLevel::best(), 1000)
}

/// Rays from around and from within, some with ends, some along axes or with parts of nothing.
fn arrays(rng: &mut StdRng, count: usize) -> Vec<Ray> {
    let aims: Vec<Tri> = (0..40)
        .map(|_| [point(rng, 2.0), point(rng, 2.0), point(rng, 2.0)])
        .collect();
    let mut rays = rays(rng, count, &aims);
    for (i, ray) in rays.iter_mut().enumerate() {
        if i % 3 == 0 {
            ray.t_max = 0.25 * (i % 7) as f32;
        }
        if i % 50 == 7 {
            ray.direction = [Vec3::X, Vec3::NEG_Y, Vec3::Z, Vec3::ZERO][i / 50 % 4];
        }
    }
    rays.truncate(count);
    rays
}

/// At every level, plain arrays included.
#[test]
fn clusters_are_hit_as_trees_are() {
    let mut rng = StdRng::seed_from_u64(31);
    for (triangles, spheres) in [
        (1, 0),
        (0, 1),
        (12, 6),
        (20, 0),
        (21, 0),
        (36, 5),
        (0, 70),
        (150, 40),
        (400, 90),
        (0, 900),
    ] {
        let mut geometry = world(&mut rng, triangles, spheres);
        let rays = arrays(&mut rng, 3000);
        let hits: Vec<Hit> = rays.iter().map(|r| geometry.closest(r)).collect();
        let blocked: Vec<bool> = rays.iter().map(|r| geometry.occluded(r)).collect();
        let few = Few::new(&geometry.world).expect("primitives are few");
        let name = format!("{triangles} triangles and {spheres} spheres");
        let mut lanes = 0;
        for level in levels() {
            for count in [0, 1, WORTH, 13, 100, MOST_RAYS] {
                let rays = &rays[..count];
                let mut many = vec![Hit::none(0.0); count];
                let rest = closest(level, &few, rays, &mut many);
                let mut any = vec![true; count];
                let any_rest = occluded(level, &few, rays, &mut any);
                assert_eq!(rest.rays(), any_rest.rays());
                for i in (0..count).filter(|i| !rest.rays().contains(&(*i as u32))) {
                    let case = format!("{name} at {level:?}, ray {i} of {count} {:?}", rays[i]);
                    assert_eq!(many[i], hits[i], "{case}");
                    assert_eq!(any[i], blocked[i], "{case}");
                    lanes += 1;
                }
            }
        }
        assert!(lanes > 1000 * levels().len(), "{lanes} rays in lanes");
        // However many rays, through the front door.
        geometry.few = Some(few);
        for level in levels() {
            geometry.level = level;
            let mut many = vec![Hit::none(0.0); rays.len()];
            geometry.closest_many(&rays, &mut many);
            assert_eq!(many, hits, "{name} at {level:?}");
            let mut any = vec![false; rays.len()];
            geometry.occluded_many(&rays, &mut any);
            assert_eq!(any, blocked, "{name} at {level:?}");
        }
    }
}

#[test]
fn clusters_hold_every_primitive_once_and_lie_in_order() {
    let mut rng = StdRng::seed_from_u64(32);
    for (triangles, spheres) in [(20, 0), (21, 0), (400, 90)] {
        let geometry = world(&mut rng, triangles, spheres);
        let few = Few::new(&geometry.world).expect("primitives are few");
        let count = triangles + spheres;
        if count <= ALONE {
            assert_eq!(few.clusters.len(), 1);
        } else {
            assert!(few.clusters.len() <= 2 * count.div_ceil(CLUSTER));
        }
        let mut prims = vec![];
        for cluster in &few.clusters {
            let triangles = &few.triangles[trace::of(&cluster.triangles)];
            let spheres = &few.spheres[trace::of(&cluster.spheres)];
            assert!(triangles.len() + spheres.len() <= ALONE);
            for corner in &few.corners[trace::of(&cluster.corners)] {
                let p = Vec3::from(*corner);
                let b = &cluster.bounds;
                assert!(b.min.cmple(p).all() && p.cmple(b.max).all(), "{p} in {b:?}");
            }
            prims.extend(triangles.iter().map(|t| t.prim as usize));
            prims.extend(spheres.iter().map(|s| s.prim as usize));
        }
        prims.sort_unstable();
        assert!(prims.into_iter().eq(0..count));
        for (direction, order) in few.orders.iter().enumerate() {
            let along = |c: &u32| {
                let at = few.clusters[*c as usize].bounds.center()[direction / 2];
                if direction % 2 == 0 { at } else { -at }
            };
            assert!(order.is_sorted_by_key(along), "{direction}");
            assert_eq!(order.len(), few.clusters.len());
        }
    }
}

#[test]
fn worlds_of_many_or_of_other_things_have_no_clusters() {
    let mut rng = StdRng::seed_from_u64(33);
    assert!(Few::new(&world(&mut rng, FEW + 1, 0).world).is_none());
    assert!(Few::new(&Tree::default()).is_none());
    let few = Few::new(&world(&mut rng, FEW_AVX2, 0).world).expect("they are few");
    assert!(few.pays(SimdLevel::Avx512));
    assert!(
        !few.pays(SimdLevel::Avx2),
        "the tree is faster with eight lanes"
    );
    assert!(!few.pays(SimdLevel::Scalar));
}
