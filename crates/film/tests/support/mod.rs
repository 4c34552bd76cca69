//! Noisy samples that look like a rendered picture, the same in every run.
#![allow(missing_docs, dead_code)]

use film::{
    Counters, ENGINE_VERSION, LayerSample, SampleBuffer, SampleRange, Tile, TileGrid, Unit,
    UnitResult,
};

pub fn hash(mut x: u64) -> u64 {
    x = (x ^ (x >> 30)).wrapping_mul(0xbf58476d1ce4e5b9);
    x = (x ^ (x >> 27)).wrapping_mul(0x94d049bb133111eb);
    x ^ (x >> 31)
}

/// Sample `index` of a pixel of the picture: a smooth wall with exponentially distributed noise and
/// rare bright samples, and some sky at the top right.
pub fn sample(x: u32, y: u32, index: u32) -> LayerSample {
    let mut state = hash((x as u64) << 40 ^ (y as u64) << 20 ^ index as u64 ^ 0x9e3779b97f4a7c15);
    let mut next = || {
        state = hash(state.wrapping_add(0x9e3779b97f4a7c15));
        (state >> 40) as f32 / (1 << 24) as f32
    };
    let (u, v) = (x as f32 / 256.0, y as f32 / 256.0);
    let sky = u + next() / 64.0 > 0.9 && v < 0.3;
    if sky {
        let blue = [0.3, 0.5, 0.9 + 0.05 * v];
        return LayerSample {
            beauty: blue,
            alpha: 1.0,
            ..LayerSample::EMPTY
        };
    }
    let bright = if next() < 0.0005 { 60.0 } else { 1.0 };
    let light = -(1.0 - next()).ln() * (0.05 + 0.8 * u * v) * bright;
    let albedo = [0.7 - 0.3 * u, 0.5 + 0.2 * (9.0 * v).sin() * next(), 0.4];
    let tilt = 0.5 * (20.0 * u).sin() + 0.01 * next();
    LayerSample {
        beauty: albedo.map(|a| a * light),
        alpha: 1.0,
        albedo,
        normal: [tilt, 0.2 * next(), (1.0 - tilt * tilt).max(0.0).sqrt()],
        depth: 4.0 + 3.0 * v + 0.02 * next(),
    }
}

/// The result of a unit of that picture.
pub fn unit(grid: TileGrid, unit: Unit) -> UnitResult {
    let tile = grid.tile(unit.tile);
    let mut buffer = SampleBuffer::new(tile, unit.samples);
    let mut counters = Counters::default();
    for y in 0..tile.height {
        for x in 0..tile.width {
            for index in unit.samples.begin..unit.samples.end {
                let sample = sample(tile.x + x, tile.y + y, index);
                counters.samples += 1;
                counters.rejected += buffer.add(x, y, index, &sample).is_err() as u64;
            }
        }
    }
    UnitResult {
        unit,
        engine: ENGINE_VERSION,
        tile,
        counters,
        buffer,
    }
}

/// A whole tile of it.
pub fn whole_tile(begin: u32, end: u32) -> UnitResult {
    let tile = 5;
    unit(
        TileGrid {
            width: 256,
            height: 256,
        },
        Unit {
            frame: 0,
            tile,
            samples: SampleRange { begin, end },
        },
    )
}

pub fn tile_of(width: u32, height: u32) -> Tile {
    Tile {
        x: 0,
        y: 0,
        width,
        height,
    }
}
