//! Rays by kind and size of the mesh, and the building of trees.

use crate::{Numbers, SETTINGS, described};
use ::scene::assets::MemorySource;
use ::scene::model::*;
use divan::counter::ItemsCount;
use divan::{Bencher, black_box};
use glam::Vec3;
use std::sync::Arc;
use tracer::ray::Ray;
use tracer::{Scene, StopFlag, prepare};

/// Triangles of a terrain, about.
const SIZES: [usize; 2] = [70_000, 1_000_000];
const RAYS: usize = 1 << 16;

#[derive(Clone, Copy, Debug)]
enum Kind {
    /// Row by row from a camera.
    Camera,
    /// Diffusely from where those hit.
    Bounce,
    /// The same in no order.
    Shuffled,
}

const KINDS: [Kind; 3] = [Kind::Camera, Kind::Bounce, Kind::Shuffled];

fn cases() -> impl Iterator<Item = (usize, &'static Kind)> {
    SIZES
        .into_iter()
        .flat_map(|size| KINDS.iter().map(move |kind| (size, kind)))
}

/// Hills over the unit square.
fn terrain(triangles: usize) -> SceneDesc {
    let n = ((triangles / 2) as f64).sqrt() as u32;
    let wave = |turns: f32| tracer::math::sin_cos_2pi(turns - turns.floor()).0;
    let height = |x: f32, z: f32| {
        0.06 * wave(x * 1.4) * wave(z * 1.1) + 0.01 * wave(x * 9.7) * wave(z * 8.4)
    };
    let positions = (0..=n)
        .flat_map(|j| (0..=n).map(move |i| (i as f32 / n as f32, j as f32 / n as f32)))
        .map(|(x, z)| [x, height(x, z), z])
        .collect();
    let indices = (0..n)
        .flat_map(|j| (0..n).map(move |i| j * (n + 1) + i))
        .flat_map(|a| [[a, a + n + 1, a + 1], [a + 1, a + n + 1, a + n + 2]])
        .collect();
    let (mut desc, _) = described("furnace");
    desc.meshes = vec![Mesh {
        positions: Arc::new(positions),
        indices: Arc::new(indices),
        ..Mesh::default()
    }];
    desc.groups.clear();
    desc.instances.clear();
    desc.primitives.truncate(1);
    let only = desc
        .primitives
        .first_mut()
        .expect("the furnace has a surface");
    only.shape = Shape::Mesh(MeshId(0));
    only.transform = Motion::identity();
    only.emission = None;
    desc
}

fn build(desc: &SceneDesc) -> Scene {
    let none = MemorySource::new();
    prepare(desc, &none, &SETTINGS, &StopFlag::default()).expect("a terrain is prepared")
}

fn rays(scene: &Scene, kind: Kind) -> Vec<Ray> {
    let side = (RAYS as f32).sqrt() as usize;
    let eye = Vec3::new(0.5, 0.4, -0.4);
    let camera = (0..RAYS).map(|i| {
        let (x, y) = (
            (i % side) as f32 / side as f32,
            (i / side) as f32 / side as f32,
        );
        let to = Vec3::new(x, 0.0, 0.1 + 0.8 * y);
        Ray::new(eye, (to - eye).normalize(), 0.0)
    });
    if let Kind::Camera = kind {
        return camera.collect();
    }
    let mut numbers = Numbers(7);
    let mut bounced: Vec<Ray> = camera
        .filter_map(|ray| {
            let t = scene.intersect(&ray)?.t;
            let mut up = numbers.direction() + Vec3::Y;
            if up.length_squared() < 1e-6 {
                up = Vec3::Y;
            }
            let from = ray.origin + ray.direction * t + Vec3::Y * 1e-4;
            Some(Ray::new(from, up.normalize(), 0.0))
        })
        .collect();
    if let Kind::Shuffled = kind {
        for i in (1..bounced.len()).rev() {
            let j = (numbers.one() * (i + 1) as f32) as usize;
            bounced.swap(i, j.min(i));
        }
    }
    bounced
}

#[divan::bench(args = cases(), sample_count = 10)]
fn closest(bencher: Bencher, (size, kind): (usize, &Kind)) {
    let scene = build(&terrain(size));
    let rays = rays(&scene, *kind);
    bencher
        .counter(ItemsCount::new(rays.len()))
        .bench_local(|| {
            let hits = rays
                .iter()
                .filter_map(|ray| scene.intersect(black_box(ray)));
            hits.map(|hit| hit.t).sum::<f32>()
        });
}

#[divan::bench(args = cases(), sample_count = 10)]
fn occluded(bencher: Bencher, (size, kind): (usize, &Kind)) {
    let scene = build(&terrain(size));
    let rays = rays(&scene, *kind);
    bencher
        .counter(ItemsCount::new(rays.len()))
        .bench_local(|| {
            rays.iter()
                .filter(|ray| scene.occluded(black_box(ray)))
                .count()
        });
}

/// The whole preparation.
#[divan::bench(args = SIZES, sample_count = 5)]
fn tree(bencher: Bencher, size: usize) {
    let desc = terrain(size);
    let triangles = desc.meshes[0].indices.len();
    bencher
        .counter(ItemsCount::new(triangles))
        .bench_local(|| build(&desc));
}

/// The same where every triangle is a lamp, so that there is a tree of lights, too.
#[divan::bench(args = [70_000], sample_count = 5)]
fn tree_of_lights(bencher: Bencher, size: usize) {
    let mut desc = terrain(size);
    desc.primitives[0].emission = Some(Emission {
        radiance: ColorTex::Const([1.0; 3]),
        scale: 1.0,
        two_sided: false,
    });
    let triangles = desc.meshes[0].indices.len();
    bencher
        .counter(ItemsCount::new(triangles))
        .bench_local(|| build(&desc));
}
