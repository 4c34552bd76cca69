//! Renders a scene with the tracer alone, without a farm: what the farm's overhead is measured
//! against. Prints one line with the rates.
//!
//! `cargo run --release -p brolly-tracer --example direct -- SCENE [spp] [threads] [out.pfm] [seed]`

use film::{SampleRange, Unit};
use std::path::Path;
use std::sync::Mutex;
use std::sync::atomic::{AtomicU32, Ordering};
use std::time::Instant;
use tracer::{PrepareSettings, StopFlag, prepare, render_unit};

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let args: Vec<String> = std::env::args().skip(1).collect();
    let path = args
        .first()
        .ok_or("usage: direct SCENE [spp] [threads] [out.pfm] [seed]")?;
    let spp: u32 = args.get(1).map_or(Ok(16), |s| s.parse())?;
    let threads: usize = args.get(2).map_or(Ok(2), |s| s.parse())?;
    let begin = Instant::now();
    let (assets, main) = scene::assets::open(Path::new(path))?;
    let (desc, diagnostics) = scene::load(&main, assets.as_ref(), &scene::Overrides::default())?;
    for d in &diagnostics {
        eprintln!("{d}");
    }
    let loaded = begin.elapsed();
    let settings = PrepareSettings {
        seed: args.get(4).map_or(Ok(0), |s| s.parse())?,
        frame: 0,
        clamp_indirect: None,
        threads,
        picture_bytes: u64::MAX,
    };
    let stop = StopFlag::default();
    let scene = prepare(&desc, assets.as_ref(), &settings, &stop)?;
    let prepared = begin.elapsed() - loaded;

    let grid = scene.grid();
    let next = AtomicU32::new(0);
    let picture = Mutex::new(vec![
        [0.0f32; 3];
        grid.width as usize * grid.height as usize
    ]);
    let total = Mutex::new(film::Counters::default());
    let begin = Instant::now();
    std::thread::scope(|scope| {
        for _ in 0..threads {
            scope.spawn(|| {
                loop {
                    let tile = next.fetch_add(1, Ordering::Relaxed);
                    if tile >= grid.count() {
                        break;
                    }
                    let unit = Unit {
                        frame: 0,
                        tile,
                        samples: SampleRange { begin: 0, end: spp },
                    };
                    let Some((buffer, counters)) = render_unit(&scene, &unit, &stop) else {
                        break;
                    };
                    let place = buffer.tile();
                    let mut picture = picture.lock().unwrap_or_else(|e| e.into_inner());
                    for (i, sums) in buffer.pixels().iter().enumerate() {
                        let (x, y) = (
                            place.x + i as u32 % place.width,
                            place.y + i as u32 / place.width,
                        );
                        picture[(y * grid.width + x) as usize] = sums
                            .beauty
                            .map(|s| (film::fixed::from_fixed(s) / spp as f64) as f32);
                    }
                    *total.lock().unwrap_or_else(|e| e.into_inner()) += counters;
                }
            });
        }
    });
    let seconds = begin.elapsed().as_secs_f64();
    let counters = total.into_inner().unwrap_or_else(|e| e.into_inner());
    println!(
        "{} {}: load {:.2} s, prepare {:.2} s, render {:.2} s, {:.2} Msamples/s, {:.2} Mrays/s ({:.2} rays and {:.2} shadow rays a sample), {} rejected",
        path,
        tracer::simd_level(),
        loaded.as_secs_f64(),
        prepared.as_secs_f64(),
        seconds,
        counters.samples as f64 / seconds * 1e-6,
        (counters.rays + counters.shadow_rays) as f64 / seconds * 1e-6,
        counters.rays as f64 / counters.samples as f64,
        counters.shadow_rays as f64 / counters.samples as f64,
        counters.rejected,
    );
    if let Some(out) = args.get(3) {
        let picture = picture.into_inner().unwrap_or_else(|e| e.into_inner());
        let mut bytes = format!("PF\n{} {}\n-1.0\n", grid.width, grid.height).into_bytes();
        for row in picture.chunks(grid.width as usize).rev() {
            for value in row.iter().flatten() {
                bytes.extend(value.to_le_bytes());
            }
        }
        std::fs::write(out, bytes)?;
    }
    Ok(())
}
