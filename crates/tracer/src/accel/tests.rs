//! The wide tree against brute force, on friendly and on nasty soups, at every SIMD level.

use super::build::{Bounds, Built, Item, Shapes, build_in_parts};
use super::node::{LeafKind, PrimRef, Tree};
use super::parts::PART_MAX;
use super::*;
use crate::geometry::quadric::{Quadric, QuadricKind};
use crate::geometry::transform::Affine;
use crate::ray::{Hit, Ray};
use glam::{DAffine3, Vec3};
use rand::{Rng, SeedableRng, rngs::StdRng};
use std::sync::Arc;

pub(super) type Tri = [Vec3; 3];

pub(super) fn geometry(triangles: &[Tri], level: SimdLevel) -> Geometry {
    geometry_in_parts(triangles, level, PART_MAX)
}

fn built(triangles: &[Tri], part: usize) -> Built {
    let items: Vec<Item> = triangles
        .iter()
        .enumerate()
        .map(|(i, t)| Item {
            bounds: Bounds::of(*t),
            kind: LeafKind::Triangles,
            id: i as u32,
        })
        .collect();
    let shapes = Shapes {
        corners: &|prim| triangles[prim as usize],
        sphere: &|_| unreachable!("there are none"),
    };
    build_in_parts(items, shapes, part)
}

fn geometry_in_parts(triangles: &[Tri], level: SimdLevel, part: usize) -> Geometry {
    let corners = triangles.iter().flatten();
    let of_triangle = |i: u32| [3 * i, 3 * i + 1, 3 * i + 2];
    let mesh = TriMesh {
        positions: Arc::new(corners.map(|p| p.to_array()).collect()),
        indices: Arc::new((0..triangles.len() as u32).map(of_triangle).collect()),
        ..TriMesh::default()
    };
    let built = built(triangles, part);
    let world = Tree {
        nodes: built.nodes,
        root: built.root,
        blocks: built.blocks,
        prims: (0..triangles.len() as u32)
            .map(|index| PrimRef { surface: 0, index })
            .collect(),
        ..Tree::default()
    };
    let surface = Surface {
        media: None,
        curves: NONE,
        mesh: 0,
        material: 0,
        alpha: None,
        flip: false,
        first_light: NONE,
        emission: NONE,
    };
    Geometry {
        level,
        world,
        groups: vec![],
        instances: vec![],
        surfaces: vec![surface],
        meshes: vec![mesh],
        curves: vec![],
        textures: Textures::default(),
        has_alpha: false,
        few: None,
    }
}

/// The same test as the kernel's, one triangle after the other, without a tree.
fn brute(triangles: &[Tri], ray: &Ray) -> Hit {
    let mut best = Hit::none(ray.t_max);
    for (i, t) in triangles.iter().enumerate() {
        let mut lone = geometry(std::slice::from_ref(t), SimdLevel::Scalar);
        lone.world.nodes.clear();
        let hit = lone.closest(&Ray {
            t_max: best.t,
            ..*ray
        });
        if hit.is_some() && hit.t < best.t {
            best = Hit {
                prim: i as u32,
                ..hit
            };
        }
    }
    best
}

pub(super) fn levels() -> Vec<SimdLevel> {
    [
        SimdLevel::Scalar,
        SimdLevel::Sse2,
        SimdLevel::Avx2,
        SimdLevel::Avx512,
    ]
    .into_iter()
    .filter(|l| *l <= SimdLevel::best())
    .collect()
}

pub(super) fn point(rng: &mut StdRng, size: f32) -> Vec3 {
    Vec3::new(
        rng.random_range(-size..size),
        rng.random_range(-size..size),
        rng.random_range(-size..size),
    )
}

pub(super) fn rays(rng: &mut StdRng, count: usize, triangles: &[Tri]) -> Vec<Ray> {
    (0..count)
        .map(|i| {
            let origin = point(rng, 3.0);
            let direction = match i % 4 {
                // Towards a random direction, along an axis, at a corner, at an edge.
                0 => point(rng, 1.0),
                1 => [Vec3::X, Vec3::NEG_Y, Vec3::Z][i / 4 % 3],
                2 => triangles[i % triangles.len()][i % 3] - origin,
                _ => {
                    (triangles[i % triangles.len()][0] + triangles[i % triangles.len()][1]) * 0.5
                        - origin
                }
            };
            Ray::new(
                origin,
                if direction == Vec3::ZERO {
                    Vec3::X
                } else {
                    direction
                },
                0.0,
            )
        })
        .collect()
}

fn check(name: &str, triangles: &[Tri], rays: &[Ray]) {
    let mut trees: Vec<Geometry> = levels()
        .into_iter()
        .map(|l| geometry(triangles, l))
        .collect();
    trees.extend([1, 7].map(|part| geometry_in_parts(triangles, SimdLevel::Scalar, part)));
    for (i, ray) in rays.iter().enumerate() {
        let expected = brute(triangles, ray);
        for tree in &trees {
            let hit = tree.closest(ray);
            assert_eq!(hit, expected, "{name}, ray {i} {ray:?} at {:?}", tree.level);
            assert_eq!(
                tree.occluded(ray),
                hit.is_some(),
                "{name}, ray {i} {ray:?} at {:?}",
                tree.level
            );
            if hit.is_some() {
                let short = Ray {
                    t_max: hit.t,
                    ..*ray
                };
                assert!(
                    !tree.occluded(&short),
                    "{name}, ray {i}: the end of a ray is not part of it"
                );
            }
        }
    }
}

#[test]
fn equals_brute_force_on_soups() {
    let mut rng = StdRng::seed_from_u64(1);
    for count in [1, 2, 3, 4, 5, 9, 36, 300] {
        let soup: Vec<Tri> = (0..count)
            .map(|_| {
                let p = point(&mut rng, 2.0);
                [p, p + point(&mut rng, 0.8), p + point(&mut rng, 0.8)]
            })
            .collect();
        let rays = rays(&mut rng, 400, &soup);
        check(&format!("soup of {count}"), &soup, &rays);
    }
}

#[test]
fn equals_brute_force_on_nasty_soups() {
    let mut rng = StdRng::seed_from_u64(2);
    let p = |x: f32, y: f32, z: f32| Vec3::new(x, y, z);
    let coincident = vec![[p(0.0, 0.0, 0.0), p(1.0, 0.0, 0.0), p(0.0, 1.0, 0.0)]; 70];
    let mut nested: Vec<Tri> = vec![];
    let mut slivers: Vec<Tri> = vec![];
    let mut flat: Vec<Tri> = vec![];
    for i in 0..60 {
        let s = crate::math::powf(1.3, i as f32 * -0.5);
        nested.push([p(-s, -s, s), p(s, -s, s), p(0.0, s, -s)]);
        let q = point(&mut rng, 2.0);
        slivers.push([q, q + p(1.0, 1e-6, 0.0), q + p(2.0, 0.0, 1e-6)]);
        flat.push([
            q * p(1.0, 1.0, 0.0),
            (q + p(0.5, 0.0, 0.0)) * p(1.0, 1.0, 0.0),
            (q + p(0.0, 0.5, 0.0)) * p(1.0, 1.0, 0.0),
        ]);
    }
    let points: Vec<Tri> = (0..20).map(|_| [point(&mut rng, 1.0); 3]).collect();
    for (name, soup) in [
        ("coincident", coincident),
        ("nested", nested),
        ("slivers", slivers),
        ("flat", flat),
        ("points", points),
    ] {
        let rays = rays(&mut rng, 300, &soup);
        check(name, &soup, &rays);
    }
}

/// Spheres by blocks are hit at the very bits that [`Quadric::intersect`] gives, from outside and from inside, by
/// rays that start on them, graze them or run through their centres.
#[test]
fn equals_brute_force_on_spheres() {
    let mut rng = StdRng::seed_from_u64(7);
    for (count, part) in [(1, PART_MAX), (3, PART_MAX), (70, PART_MAX), (70, 5)] {
        let mut spheres: Vec<(Vec3, f32)> = (0..count)
            .map(|_| (point(&mut rng, 2.0), rng.random_range(0.01..0.7)))
            .collect();
        // Two in the same place.
        if count > 3 {
            spheres[1] = spheres[0];
        }
        let trees: Vec<Geometry> = (levels().into_iter())
            .map(|level| of_spheres(&spheres, level, part))
            .collect();
        for i in 0..2000 {
            let (center, radius) = spheres[i % spheres.len()];
            let origin = match i % 3 {
                0 => point(&mut rng, 3.0),
                1 => center,
                _ => center + crate::math::normalize(point(&mut rng, 1.0)) * radius,
            };
            let direction = match i / 3 % 4 {
                0 => point(&mut rng, 1.0),
                1 => center - origin,
                2 => [Vec3::X, Vec3::NEG_Y, Vec3::Z][i / 12 % 3],
                _ => center + Vec3::X * radius - origin,
            };
            if direction == Vec3::ZERO {
                continue;
            }
            let ray = Ray::new(origin, direction, 0.0);
            let mut expected = Hit::none(ray.t_max);
            for (prim, (shape, _)) in trees[0].world.quadrics.iter().enumerate() {
                for t in shape.intersect(ray.origin, ray.direction) {
                    if t > 0.0 && t < expected.t {
                        let prim = prim as u32;
                        expected = Hit {
                            t,
                            prim,
                            ..Hit::none(0.0)
                        };
                    }
                }
            }
            for tree in &trees {
                assert!(!tree.world.balls.is_empty());
                let hit = tree.closest(&ray);
                assert_eq!(
                    hit.t.to_bits(),
                    expected.t.to_bits(),
                    "{i} at {:?}",
                    tree.level
                );
                assert_eq!(hit.prim, expected.prim, "{i} at {:?}", tree.level);
                assert_eq!(
                    tree.occluded(&ray),
                    hit.is_some(),
                    "{i} at {:?}",
                    tree.level
                );
            }
        }
    }
}

fn of_spheres(spheres: &[(Vec3, f32)], level: SimdLevel, part: usize) -> Geometry {
    of_both(&[], spheres, level, part)
}

/// Triangles and, after them, spheres.
pub(super) fn of_both(
    soup: &[Tri],
    spheres: &[(Vec3, f32)],
    level: SimdLevel,
    part: usize,
) -> Geometry {
    let first = soup.len() as u32;
    let quadrics: Vec<(Quadric, u32)> = (spheres.iter().enumerate())
        .map(|(i, (center, radius))| {
            let to_parent = DAffine3::from_translation(center.as_dvec3());
            let kind = QuadricKind::Sphere { radius: *radius };
            let from_parent = Affine::new(&to_parent.inverse());
            let shape = Quadric::new(Affine::new(&to_parent), from_parent, kind);
            (shape, first + i as u32)
        })
        .collect();
    let item = |(i, (shape, _)): (usize, &(Quadric, u32))| Item {
        bounds: shape.bounds(),
        kind: LeafKind::Balls,
        id: i as u32,
    };
    let triangle = |(i, corners): (usize, &Tri)| Item {
        bounds: Bounds::of(*corners),
        kind: LeafKind::Triangles,
        id: i as u32,
    };
    let triangles = soup.iter().enumerate().map(triangle);
    let items = triangles
        .chain(quadrics.iter().enumerate().map(item))
        .collect();
    let shapes = Shapes {
        corners: &|i| soup[i as usize],
        sphere: &|i| (spheres[i as usize].0, spheres[i as usize].1, first + i),
    };
    let built = build_in_parts(items, shapes, part);
    let mut geometry = geometry(&[], level);
    geometry.world = Tree {
        nodes: built.nodes,
        root: built.root,
        blocks: built.blocks,
        balls: built.balls,
        prims: (0..first + spheres.len() as u32)
            .map(|index| PrimRef { surface: 0, index })
            .collect(),
        quadrics,
        ..Tree::default()
    };
    geometry
}

/// Rays that are none hit something or nothing, but end.
#[test]
fn nonsense_does_no_harm() {
    let mut rng = StdRng::seed_from_u64(8);
    let corner = |rng: &mut StdRng| point(rng, 2.0);
    let soup: Vec<Tri> = (0..50)
        .map(|_| [corner(&mut rng), corner(&mut rng), corner(&mut rng)])
        .collect();
    let odd = [
        f32::INFINITY,
        f32::NEG_INFINITY,
        f32::NAN,
        f32::MAX,
        0.0,
        1.0,
    ];
    for mut tree in levels().into_iter().map(|level| geometry(&soup, level)) {
        let mut rays = vec![];
        for i in 0..odd.len().pow(3) {
            let n = odd.len();
            let strange = Vec3::new(odd[i % n], odd[i / n % n], odd[i / n / n]);
            rays.push(Ray::new(strange, Vec3::NEG_ONE, 0.0));
            rays.push(Ray::new(Vec3::ONE, strange, 0.0));
            rays.push(Ray::new(strange, strange, 0.0));
        }
        let mut hits = vec![Hit::none(0.0); rays.len()];
        tree.closest_coherent(&rays, &mut hits);
        for (ray, hit) in rays.iter().zip(hits) {
            assert_eq!(
                tree.closest(ray).prim,
                hit.prim,
                "{ray:?} at {:?}",
                tree.level
            );
            tree.occluded(ray);
        }
        let mut blocked = vec![false; rays.len()];
        tree.occluded_many(&rays, &mut blocked);
        // Without the tree.
        tree.few = Few::new(&tree.world);
        assert!(tree.few.is_some());
        let mut hits = vec![Hit::none(0.0); rays.len()];
        tree.closest_many(&rays, &mut hits);
        for (ray, hit) in rays.iter().zip(hits) {
            assert_eq!(
                tree.closest(ray).prim,
                hit.prim,
                "{ray:?} at {:?}",
                tree.level
            );
        }
        let mut found = vec![true; rays.len()];
        tree.occluded_many(&rays, &mut found);
        assert_eq!(blocked, found, "{:?}", tree.level);
    }
}

/// No ray from inside a closed mesh gets out, at edges and corners least of all.
#[test]
fn closed_meshes_do_not_leak() {
    for (scale, center) in [
        (1.0, Vec3::ZERO),
        (1e-3, Vec3::splat(0.5)),
        (1e4, Vec3::new(-7e4, 0.0, 3e4)),
    ] {
        let mut sphere: Vec<Tri> = vec![];
        let (rows, columns) = (24u32, 48u32);
        let at = |i: u32, j: u32| {
            let (s, c) = crate::math::sin_cos_2pi((j % columns) as f32 / columns as f32);
            let (r, z) = crate::math::sin_cos_2pi(i as f32 / rows as f32 * 0.499_999_9);
            let r = if i == 0 || i == rows { 0.0 } else { r };
            center + Vec3::new(r * c, r * s, z) * scale
        };
        for i in 0..rows {
            for j in 0..columns {
                let (a, b, c, d) = (at(i, j), at(i + 1, j), at(i + 1, j + 1), at(i, j + 1));
                sphere.extend([[a, b, c], [a, c, d]]);
            }
        }
        let tree = geometry(&sphere, SimdLevel::best());
        let mut rng = StdRng::seed_from_u64(3);
        for i in 0..200_000usize {
            let origin = center + point(&mut rng, 0.3 * scale);
            let t = &sphere[i % sphere.len()];
            let target = match i % 5 {
                0 => t[i % 3],
                1 => (t[0] + t[1]) * 0.5,
                2 => t[0] * 0.25 + t[2] * 0.75,
                3 => (t[1] + t[2]) * 0.5,
                _ => center + point(&mut rng, scale),
            };
            let ray = Ray::new(origin, target - origin, 0.0);
            if target != origin {
                assert!(
                    tree.closest(&ray).is_some(),
                    "leak {i} at scale {scale}: {ray:?}"
                );
                assert!(
                    tree.occluded(&ray),
                    "shadow leak {i} at scale {scale}: {ray:?}"
                );
            }
        }
    }
}

#[test]
fn nothing_is_hit_in_nothing() {
    let empty = geometry(&[], SimdLevel::best());
    let ray = Ray::new(Vec3::ZERO, Vec3::X, 0.0);
    assert!(!empty.closest(&ray).is_some() && !empty.occluded(&ray));
}

/// Arrays of rays, one after the other and in flight, have the hits of single rays.
fn check_many(name: &str, geometry: &Geometry, rays: &[Ray]) {
    let hits: Vec<Hit> = rays.iter().map(|r| geometry.closest(r)).collect();
    let blocked: Vec<bool> = rays.iter().map(|r| geometry.occluded(r)).collect();
    for level in levels() {
        for in_flight in [false, true] {
            // Fewer than are in flight, and more.
            for count in [0, 1, 3, 8, 9, rays.len()] {
                let some = &rays[..count.min(rays.len())];
                let mut many = vec![Hit::none(0.0); some.len()];
                simd::closest_many(level, geometry, some, &mut many, in_flight);
                let mut any = vec![true; some.len()];
                simd::occluded_many(level, geometry, some, &mut any, in_flight);
                let case = format!("{name} at {level:?}, {count} rays, in flight {in_flight}");
                for i in 0..some.len() {
                    assert_eq!(many[i], hits[i], "{case}, ray {i} {:?}", some[i]);
                    assert_eq!(any[i], blocked[i], "{case}, ray {i} {:?}", some[i]);
                }
            }
        }
    }
}

#[test]
fn arrays_of_rays_are_as_single_rays_on_soups() {
    let mut rng = StdRng::seed_from_u64(4);
    for count in [0, 1, 4, 7, 40, 3000] {
        let soup: Vec<Tri> = (0..count)
            .map(|_| {
                let p = point(&mut rng, 2.0);
                [p, p + point(&mut rng, 0.4), p + point(&mut rng, 0.4)]
            })
            .collect();
        let aims = if soup.is_empty() {
            vec![[Vec3::ZERO, Vec3::X, Vec3::Y]]
        } else {
            soup.clone()
        };
        let mut rays = rays(&mut rng, 1000, &aims);
        for (i, ray) in rays.iter_mut().enumerate().filter(|(i, _)| i % 3 == 0) {
            ray.t_max = 0.25 * (i % 7) as f32;
        }
        let geometry = geometry(&soup, SimdLevel::best());
        check_many(&format!("soup of {count}"), &geometry, &rays);
    }
}

/// The same with whatever is not a block of triangles: instances, what moves and deforms, spheres and
/// disks, holes.
#[test]
fn arrays_of_rays_are_as_single_rays_in_scenes() {
    let scenes = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("../../scenes");
    for name in ["instances", "motion-blur", "textures", "whitted"] {
        let (assets, main) = ::scene::assets::open(&scenes.join(name)).expect("a scene");
        let overrides = ::scene::Overrides::default();
        let (desc, _) = ::scene::load(&main, assets.as_ref(), &overrides).expect("a scene");
        let settings = crate::PrepareSettings {
            seed: 0,
            frame: 0,
            clamp_indirect: None,
            threads: 1,
            picture_bytes: u64::MAX,
        };
        let stop = crate::StopFlag::default();
        let prepared =
            crate::prepare(&desc, assets.as_ref(), &settings, &stop).expect("a scene prepares");
        let geometry = &prepared.geometry;
        let mut rng = StdRng::seed_from_u64(5);
        let rays: Vec<Ray> = (0..2000)
            .map(|i| {
                let time = 0.001 * (i % 40) as f32;
                let target = point(&mut rng, 2.0);
                let origin = point(&mut rng, 6.0);
                Ray::new(origin, target - origin, time)
            })
            .collect();
        let hits = rays.iter().filter(|r| geometry.closest(r).is_some());
        assert!(hits.count() > 200, "{name} is hardly hit");
        check_many(name, geometry, &rays);
    }
}

/// Blocks hold every triangle once, nodes are full, leaves of two blocks occur.
#[test]
fn collapse_fills_nodes() {
    let mut rng = StdRng::seed_from_u64(6);
    let soup: Vec<Tri> = (0..5000)
        .map(|_| {
            let p = point(&mut rng, 2.0);
            [p, p + point(&mut rng, 0.1), p + point(&mut rng, 0.1)]
        })
        .collect();
    let tree = geometry(&soup, SimdLevel::best()).world;
    let mut prims: Vec<u32> = tree.blocks.iter().flat_map(|b| b.prims).collect();
    prims.retain(|p| *p != NONE);
    prims.sort_unstable();
    assert!(prims.iter().copied().eq(0..5000));
    let children = tree.nodes.iter().flat_map(|n| n.children);
    let children = children.filter(|c| *c != super::node::EMPTY).count();
    assert!(
        children > 6 * tree.nodes.len(),
        "{children} children of {} nodes",
        tree.nodes.len()
    );
}

/// However many threads build the parts of a tree, the tree is the same.
#[test]
fn threads_change_no_bit_of_a_tree() {
    let mut rng = StdRng::seed_from_u64(4);
    let soup: Vec<Tri> = (0..20_000)
        .map(|_| {
            let p = point(&mut rng, 2.0);
            [p, p + point(&mut rng, 0.1), p + point(&mut rng, 0.1)]
        })
        .collect();
    let [one, three] = [1, 3].map(|threads| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build();
        pool.expect("threads start").install(|| built(&soup, 100))
    });
    assert_eq!(one.root, three.root);
    let nodes = |tree: &Built| format!("{:?}", tree.nodes);
    let blocks = |tree: &Built| format!("{:?}", tree.blocks);
    assert_eq!(nodes(&one), nodes(&three));
    assert_eq!(blocks(&one), blocks(&three));
    let held: usize = one
        .blocks
        .iter()
        .flat_map(|b| b.prims)
        .filter(|p| *p != u32::MAX)
        .count();
    assert_eq!(held, soup.len());
}
