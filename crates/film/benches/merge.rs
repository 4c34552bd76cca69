//! Speed of the codec and of merging, in bytes of the encoded results.
//! `cargo bench -p brolly-film` prints also the bytes a pixel.

use divan::{Bencher, counter::BytesCount};
use film::{UnitResult, decode_unit, encode_unit};

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
