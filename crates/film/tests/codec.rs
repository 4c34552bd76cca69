//! The bytes of a result: what goes in comes out, and nothing else is read.

mod support;

use film::codec::{encoded_len_max, unit_bytes_max};
use film::{
    CodecError, Counters, ENGINE_VERSION, LayerSample, PackedUnit, SampleBuffer, SampleRange,
    Square, TileGrid, Unit, UnitResult, decode_unit, encode_unit,
};
use proptest::prelude::*;
use support::{hash, tile_of, unit, whole_tile};

fn encode(result: &UnitResult) -> Vec<u8> {
    encode_unit(result.unit, &result.buffer, &result.counters, result.engine)
}

/// What both readers make of bytes, in which they must agree.
fn decode(bytes: &[u8]) -> Result<UnitResult, CodecError> {
    let result = decode_unit(bytes);
    match (&result, PackedUnit::read(bytes)) {
        (Ok(result), Ok(packed)) => assert_eq!(
            (result.unit, result.engine, result.tile, &result.counters),
            (
                packed.unit(),
                packed.engine(),
                packed.tile(),
                packed.counters()
            )
        ),
        (Err(error), Err(other)) => assert_eq!(*error, other),
        (result, packed) => panic!("{result:?} and {packed:?}"),
    }
    result
}

fn tiny() -> UnitResult {
    let tile = tile_of(5, 3);
    let samples = SampleRange { begin: 2, end: 4 };
    let mut buffer = SampleBuffer::new(tile, samples);
    for at in 0..15 {
        for index in 2..4 {
            let _ = buffer.add(at % 5, at / 5, index, &support::sample(at, 7, index));
        }
    }
    let nan = LayerSample {
        alpha: f32::NAN,
        ..LayerSample::EMPTY
    };
    assert!(buffer.add(1, 2, 3, &nan).is_err());
    let unit = Unit {
        frame: 9,
        tile: 0,
        samples,
    };
    let counters = Counters {
        samples: 30,
        rays: 77,
        shadow_rays: 12,
        bounces: 5,
        rejected: 1,
    };
    UnitResult {
        unit,
        engine: ENGINE_VERSION,
        tile,
        counters,
        buffer,
    }
}

#[test]
fn results_round_trip_at_every_size() {
    for (begin, end) in [(0, 1), (8, 16), (1024, 1100)] {
        let result = whole_tile(begin, end);
        assert_eq!(decode(&encode(&result)), Ok(result));
    }
    let grid = TileGrid {
        width: 65,
        height: 67,
    };
    for tile in 0..grid.count() {
        let result = unit(
            grid,
            Unit {
                frame: 3,
                tile,
                samples: SampleRange { begin: 1, end: 2 },
            },
        );
        assert_eq!(decode(&encode(&result)), Ok(result));
    }
    assert_eq!(decode(&encode(&tiny())), Ok(tiny()));
}

#[test]
fn every_changed_missing_or_added_byte_is_refused() {
    let bytes = encode(&tiny());
    for at in 0..bytes.len() {
        for flip in [1, 0x10, 0x80, 0xff] {
            let mut bad = bytes.clone();
            bad[at] ^= flip;
            assert!(decode(&bad).is_err(), "byte {at} ^ {flip}");
        }
        assert!(decode(&bytes[..at]).is_err(), "cut at {at}");
    }
    let longer = [&bytes[..], &[0]].concat();
    assert!(matches!(decode(&longer), Err(CodecError::Length { .. })));
    assert_eq!(decode(b"PNG"), Err(CodecError::NotAUnit));
}

/// A forger can compute checksums: fields must be checked on their own.
fn forged(at: usize, with: &[u8]) -> Result<UnitResult, CodecError> {
    let mut bytes = encode(&tiny());
    bytes[at..at + with.len()].copy_from_slice(with);
    reseal(&mut bytes);
    decode(&bytes)
}

fn reseal(bytes: &mut [u8]) {
    let body = bytes.len() - 4;
    let crc = crc32fast::hash(&bytes[..body]);
    bytes[body..].copy_from_slice(&crc.to_le_bytes());
}

#[test]
fn forged_fields_are_refused() {
    assert!(forged(0, b"BRLU").is_ok());
    assert_eq!(forged(4, &2u16.to_le_bytes()), Err(CodecError::Version(2)));
    for (begin, end) in [(4u32, 4u32), (5, 4), (2, 5), (1 << 24, (1 << 24) + 1)] {
        let range = [begin.to_le_bytes(), end.to_le_bytes()].concat();
        assert_eq!(
            forged(22, &range),
            Err(CodecError::Malformed("sample range"))
        );
    }
    for (at, bad) in [(30, 3u32), (34, 1 << 30)] {
        assert_eq!(
            forged(at, &bad.to_le_bytes()),
            Err(CodecError::Malformed("tile"))
        );
    }
    for size in [[0u16, 3], [65, 3], [5, 0]] {
        let bytes = size.map(u16::to_le_bytes).concat();
        assert_eq!(forged(38, &bytes), Err(CodecError::Malformed("tile")));
    }
    // A larger tile than the bytes can fill.
    let wide = [64u16, 64].map(u16::to_le_bytes).concat();
    assert_eq!(forged(38, &wide), Err(CodecError::Malformed("length")));
    let engine = forged(6, &7u32.to_le_bytes()).unwrap().engine;
    assert_eq!(
        engine.0, 7,
        "whether an engine will do is for the film to say"
    );
}

#[test]
fn sums_that_samples_cannot_have_are_refused() {
    let mut result = tiny();
    result.buffer.pixels_mut()[4].beauty[1] = (2 << 72) + 1;
    assert_eq!(
        decode(&encode(&result)),
        Err(CodecError::OutOfRange {
            plane: 1,
            samples: 2
        })
    );
    result.buffer.pixels_mut()[4].beauty[1] = 2 << 72;
    assert_eq!(decode(&encode(&result)), Ok(result.clone()));
    result.buffer.pixels_mut()[4].square[2] = Square {
        whole: 2 << 64,
        fraction: 1,
    };
    assert!(decode(&encode(&result)).is_err());
    result.buffer.pixels_mut()[4].square[2] = Square {
        whole: u128::MAX,
        fraction: 1,
    };
    assert!(decode(&encode(&result)).is_err());
    result.buffer.pixels_mut()[4].square[2] = Square {
        whole: 2 << 64,
        fraction: 0,
    };
    assert_eq!(decode(&encode(&result)), Ok(result.clone()));
    result.buffer.pixels_mut()[4].hits = 3;
    assert!(decode(&encode(&result)).is_err());
}

#[test]
fn the_worst_sums_stay_below_the_limit() {
    let mut result = whole_tile(0, 1);
    for (i, pixel) in result.buffer.pixels_mut().iter_mut().enumerate() {
        let sign = if i % 2 == 0 { 1 } else { -1 };
        pixel.beauty = [sign * (1 << 72); 3];
        pixel.half = sign * (1 << 72);
        pixel.depth = sign * (1 << 72) + 1;
        pixel.square = [Square {
            whole: (1 << 64) * (i % 2) as u128,
            fraction: 0,
        }; 3];
        pixel.square[0].fraction = (i % 3 == 0 && i % 2 == 0) as u64;
        pixel.albedo = [i as i64 * 997 % (1 << 30); 3];
    }
    let bytes = encode(&result);
    assert!(
        bytes.len() < encoded_len_max(result.tile),
        "{}",
        bytes.len()
    );
    assert!(unit_bytes_max() < 1 << 20);
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]

    #[test]
    fn any_sums_in_bounds_round_trip(seed in any::<u64>(), bits in 0u32..72) {
        let mut result = tiny();
        for (i, pixel) in result.buffer.pixels_mut().iter_mut().enumerate() {
            let at = |k: u64| hash(seed ^ (i as u64) << 8 ^ k);
            let value = |k| ((at(k) as i128) << 64 | at(k + 50) as i128) >> (127 - bits);
            pixel.beauty = [value(0), value(1), value(2)];
            pixel.half = value(3);
            pixel.depth = value(4);
            let square = |k| Square { whole: (at(k) as u128) >> (at(k) % 64), fraction: at(k + 1) };
            pixel.square = [square(5), square(7), square(9)];
            pixel.normal = [11, 12, 13].map(|k| at(k) as i64 >> 33);
            pixel.hits = (at(14) % 3) as u32;
        }
        let bytes = encode(&result);
        prop_assert_eq!(decode(&bytes), Ok(result));
    }

    #[test]
    fn junk_is_refused_without_panic(mut junk in proptest::collection::vec(any::<u8>(), 0..400),
                                     at in 0usize..300, byte in any::<u8>()) {
        prop_assert!(decode(&junk).is_err());
        // With the right head and checksum whatever is read back must write the same bytes.
        let mut bytes = encode(&tiny());
        let end = bytes.len() - 4;
        bytes[at.min(end - 1)] = byte;
        reseal(&mut bytes);
        if let Ok(result) = decode(&bytes) {
            prop_assert_eq!(encode(&result), bytes);
        }
        junk.splice(0..0, *b"BRLU");
        prop_assert!(decode(&junk).is_err());
    }
}
