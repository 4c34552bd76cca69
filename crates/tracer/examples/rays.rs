//! Traces rays that are read from files through a scene's geometry on one thread and prints how many
//! a second, best of five (those by packets suit rays in the order of a camera's): what other tracers of rays are compared with on the same rays.
//!
//! `cargo run --release -p brolly-tracer --example rays -- SCENE FILE...`
//!
//! A file is a list of rays of 32 bytes: origin, smallest t, direction, largest t, each a
//! little-endian f32. The smallest t has to be 0.

use glam::Vec3;
use std::path::Path;
use std::time::Instant;
use tracer::ray::{Hit, Ray};
use tracer::{PrepareSettings, StopFlag, prepare};

/// Rays are traced by arrays of this size, as the renderer does.
const ARRAY: usize = 1024;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let args: Vec<String> = std::env::args().skip(1).collect();
    let (path, files) = args.split_first().ok_or("usage: rays SCENE FILE...")?;
    let (assets, main) = scene::assets::open(Path::new(path))?;
    let (desc, _) = scene::load(&main, assets.as_ref(), &scene::Overrides::default())?;
    let begin = Instant::now();
    let settings = PrepareSettings {
        seed: 0,
        frame: 0,
        clamp_indirect: None,
        threads: 1,
        picture_bytes: u64::MAX,
    };
    let scene = prepare(&desc, assets.as_ref(), &settings, &StopFlag::default())?;
    println!("prepared in {:.3} s", begin.elapsed().as_secs_f64());
    for file in files {
        let bytes = std::fs::read(file)?;
        let rays: Vec<Ray> = bytes
            .chunks_exact(32)
            .map(|ray| {
                let x = |i: usize| {
                    let at: [u8; 4] = std::array::from_fn(|k| ray[4 * i + k]);
                    f32::from_le_bytes(at)
                };
                Ray {
                    t_max: x(7),
                    ..Ray::new(
                        Vec3::new(x(0), x(1), x(2)),
                        Vec3::new(x(4), x(5), x(6)),
                        0.0,
                    )
                }
            })
            .collect();
        let (mut closest, mut coherent, mut any) = (f64::INFINITY, f64::INFINITY, f64::INFINITY);
        let mut found = vec![Hit::none(0.0); rays.len()];
        let mut alike = found.clone();
        let mut shadows = vec![false; rays.len()];
        for _ in 0..5 {
            let begin = Instant::now();
            for (rays, hits) in rays.chunks(ARRAY).zip(found.chunks_mut(ARRAY)) {
                scene.geometry.closest_many(rays, hits);
            }
            closest = closest.min(begin.elapsed().as_secs_f64());
            let begin = Instant::now();
            for (rays, hits) in rays.chunks(ARRAY).zip(alike.chunks_mut(ARRAY)) {
                scene.geometry.closest_coherent(rays, hits);
            }
            coherent = coherent.min(begin.elapsed().as_secs_f64());
            let begin = Instant::now();
            for (rays, blocked) in rays.chunks(ARRAY).zip(shadows.chunks_mut(ARRAY)) {
                scene.geometry.occluded_many(rays, blocked);
            }
            any = any.min(begin.elapsed().as_secs_f64());
        }
        if found != alike {
            return Err("packets find other hits".into());
        }
        let hits = found.iter().filter(|hit| hit.is_some()).count();
        let sum: f64 = found
            .iter()
            .filter(|hit| hit.is_some())
            .map(|hit| hit.t as f64)
            .sum();
        let blocked = shadows.iter().filter(|blocked| **blocked).count();
        let rate = |seconds: f64| rays.len() as f64 / seconds / 1e6;
        println!(
            "{file}: {} rays, {hits} hits, sum of t {sum:.4}, {blocked} blocked: \
             {:.2} Mrays/s closest, {:.2} by packets, {:.2} any",
            rays.len(),
            rate(closest),
            rate(coherent),
            rate(any),
        );
    }
    Ok(())
}
