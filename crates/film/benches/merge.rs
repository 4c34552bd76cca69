//! Speed of the codec and of merging, in bytes of the encoded results.
//! `cargo bench -p brolly-film` prints also the bytes a pixel.

use divan::{Bencher, counter::BytesCount};
use film::{
    ENGINE_VERSION, Film, Receipt, SampleRange, TileGrid, UnitResult, decode_tile, decode_unit,
    encode_tile, encode_unit,
};

#[path = "../tests/support/mod.rs"]
mod support;

/// Samples of a result: the first pass, an early one, a late one.
const SAMPLES: [u32; 3] = [1, 16, 512];

fn result(samples: u32) -> UnitResult {
    let begin = if samples == 1 { 0 } else { samples };
    support::whole_tile(begin, begin + samples)
}

fn bytes(result: &UnitResult) -> Vec<u8> {
    encode_unit(result.unit, &result.buffer, &result.counters, result.engine)
}

fn main() {
    for samples in SAMPLES {
        let result = result(samples);
        let length = bytes(&result).len();
        println!(
            "{samples} spp: {:.1} bytes a pixel",
            length as f64 / result.tile.pixels() as f64
        );
    }
    divan::main();
}

#[divan::bench(args = SAMPLES)]
fn encode(bencher: Bencher, samples: u32) {
    let result = result(samples);
    let length = bytes(&result).len();
    bencher
        .counter(BytesCount::new(length))
        .bench(|| bytes(&result));
}

#[divan::bench(args = SAMPLES)]
fn decode(bencher: Bencher, samples: u32) {
    let bytes = bytes(&result(samples));
    bencher
        .counter(BytesCount::new(bytes.len()))
        .bench(|| decode_unit(&bytes));
}

#[divan::bench(args = SAMPLES)]
fn merge(bencher: Bencher, samples: u32) {
    let result = result(samples);
    let bytes = bytes(&result);
    let receipt = Receipt::of(&bytes, "worker");
    // The second unit of a tile: the first one only widens the planes.
    let mut film = Film::new(GRID, 0);
    let mut before = support::whole_tile(2048, 2048 + samples);
    before.unit.samples = SampleRange {
        begin: 2048,
        end: 2048 + samples,
    };
    film.merge(
        &before,
        Receipt {
            digest: [0; 32],
            worker: "worker".into(),
        },
    )
    .unwrap();
    bencher
        .counter(BytesCount::new(bytes.len()))
        .with_inputs(|| film.clone())
        .bench_local_refs(|film| film.merge(&result, receipt.clone()));
}

#[divan::bench(args = SAMPLES)]
fn save(bencher: Bencher, samples: u32) {
    let film = one_merged(samples);
    let length = encode_tile(&film.tiles()[TILE], 0, ENGINE_VERSION).len();
    bencher
        .counter(BytesCount::new(length))
        .bench(|| encode_tile(&film.tiles()[TILE], 0, ENGINE_VERSION));
}

#[divan::bench(args = SAMPLES)]
fn load(bencher: Bencher, samples: u32) {
    let film = one_merged(samples);
    let bytes = encode_tile(&film.tiles()[TILE], 0, ENGINE_VERSION);
    bencher
        .counter(BytesCount::new(bytes.len()))
        .bench(|| decode_tile(&bytes));
}

#[divan::bench(args = SAMPLES)]
fn error_of_a_tile(bencher: Bencher, samples: u32) {
    let film = one_merged(samples.max(2));
    bencher.bench(|| film::error::tile_errors(&film.tiles()[TILE]));
}

const GRID: TileGrid = TileGrid {
    width: 256,
    height: 256,
};
const TILE: usize = 5;

fn one_merged(samples: u32) -> Film {
    let mut film = Film::new(GRID, 0);
    let receipt = Receipt {
        digest: [0; 32],
        worker: "worker".into(),
    };
    film.merge(&result(samples), receipt).unwrap();
    film
}
