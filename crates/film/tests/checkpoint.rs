//! A film comes back from its checkpoint as it was, and only what changed is written.

mod support;

use film::checkpoint::SavedTile;
use film::{
    CheckpointError, ENGINE_VERSION, EngineVersion, Film, Manifest, Merged, Receipt, SampleRange,
    Square, TileGrid, Unit, UnitResult, decode_tile, encode_tile, encode_unit,
};
use std::collections::BTreeMap;
use support::unit;

const GRID: TileGrid = TileGrid {
    width: 140,
    height: 70,
};

type Blobs = BTreeMap<[u8; 32], Vec<u8>>;

fn merge(film: &mut Film, tile: u32, begin: u32, end: u32) -> Merged {
    let samples = SampleRange { begin, end };
    let one = unit(
        film.grid(),
        Unit {
            frame: film.frame(),
            tile,
            samples,
        },
    );
    // As a worker of the film's engine version sends it.
    let one = UnitResult {
        engine: film.engine(),
        ..one
    };
    let bytes = encode_unit(one.unit, &one.buffer, &one.counters, one.engine);
    film.merge(&one, Receipt::of(&bytes, format!("worker-{}", begin % 3)))
        .unwrap()
}

fn save(film: &Film, previous: Option<&Manifest>, log_pos: u64, blobs: &mut Blobs) -> Manifest {
    film.checkpoint(previous, log_pos, |digest, bytes| {
        blobs.insert(digest, bytes);
        Ok::<_, std::io::Error>(())
    })
    .unwrap()
}

fn load(manifest: &Manifest, blobs: &Blobs) -> Result<Film, CheckpointError> {
    Film::from_checkpoint(manifest, |digest| {
        blobs.get(&digest).cloned().ok_or("no such blob")
    })
}

#[test]
fn only_what_changed_is_written() {
    let mut blobs = Blobs::new();
    let mut film = Film::new(GRID, 2);
    for tile in [0, 1, 5] {
        merge(&mut film, tile, 0, 1);
    }
    merge(&mut film, 1, 4, 8);
    assert_eq!(film.changed_since(None), [0, 1, 5]);
    let first = save(&film, None, 17, &mut blobs);
    assert_eq!(blobs.len(), 3);
    assert_eq!(film.changed_since(Some(&first)), [0u32; 0]);

    merge(&mut film, 1, 1, 2);
    film.clear(5);
    assert_eq!(film.changed_since(Some(&first)), [1, 5]);
    let second = save(&film, Some(&first), 21, &mut blobs);
    assert_eq!((blobs.len(), second.log_pos), (5, 21));
    assert_eq!(second.tiles[0], first.tiles[0]);

    let back = load(&Manifest::decode(&second.encode()).unwrap(), &blobs).unwrap();
    assert_eq!(back.digest(), film.digest());
    assert_eq!(back.counters(), film.counters());
    assert_eq!(
        save(&back, None, 21, &mut Blobs::new()),
        second,
        "and again the same blobs"
    );
    for (old, new) in film.tiles().iter().zip(back.tiles()) {
        assert_eq!(
            (old.version(), old.merged_units()),
            (new.version(), new.merged_units())
        );
    }
    // What is merged stays merged.
    let mut back = back;
    assert_eq!(merge(&mut back, 1, 4, 8), Merged::AlreadyMerged);
    assert_eq!(merge(&mut back, 1, 2, 4), Merged::Added);
    merge(&mut film, 1, 2, 4);
    assert_eq!(back.digest(), film.digest());
    assert_eq!(load(&first, &blobs).unwrap().tiles()[1].ranges().len(), 2);
}

#[test]
fn damage_is_refused() {
    let mut blobs = Blobs::new();
    let mut film = Film::new(
        TileGrid {
            width: 3,
            height: 2,
        },
        2,
    );
    merge(&mut film, 0, 0, 1);
    let manifest = save(&film, None, 1, &mut blobs);
    let bytes = manifest.encode();
    let blob = blobs.values().next().unwrap().clone();
    for at in 0..blob.len() {
        let mut bad = blob.clone();
        bad[at] ^= 0x20;
        assert!(
            decode_tile(&bad).is_err() && decode_tile(&blob[..at]).is_err(),
            "byte {at}"
        );
        let named = blobs.keys().map(|&digest| (digest, bad.clone())).collect();
        assert!(matches!(
            load(&manifest, &named),
            Err(CheckpointError::Digest { tile: 0 })
        ));
    }
    for at in 0..bytes.len() {
        let mut bad = bytes.clone();
        bad[at] ^= 0x20;
        assert!(Manifest::decode(&bad).is_err() && Manifest::decode(&bytes[..at]).is_err());
    }
    assert!(matches!(
        load(&manifest, &Blobs::new()),
        Err(CheckpointError::Fetch { tile: 0, .. })
    ));
    let foreign = Manifest {
        frame: 3,
        ..manifest.clone()
    };
    assert!(matches!(
        load(&foreign, &blobs),
        Err(CheckpointError::Foreign { tile: 0 })
    ));
    let other = Manifest {
        engine: EngineVersion(99),
        ..manifest
    };
    assert!(matches!(
        load(&other, &blobs),
        Err(CheckpointError::Foreign { tile: 0 })
    ));
    for bytes in [bytes, blob] {
        let mut old = bytes.clone();
        old[4] = 0;
        let error = match bytes[3] {
            b'M' => Manifest::decode(&old).unwrap_err(),
            _ => decode_tile(&old).unwrap_err(),
        };
        assert!(
            error.to_string().contains("format 0 is not known"),
            "{error}"
        );
    }
}

/// Sums of every width come back.
#[test]
fn wide_sums_round_trip() {
    let grid = TileGrid {
        width: 64,
        height: 20,
    };
    let mut film = Film::new(grid, 0);
    for (begin, end) in [(0, 1), (1, 2)] {
        let samples = SampleRange { begin, end };
        let mut one = unit(
            grid,
            Unit {
                frame: 0,
                tile: 0,
                samples,
            },
        );
        for (i, pixel) in one.buffer.pixels_mut().iter_mut().enumerate() {
            let bits = (i / 64 * 7) as u32;
            pixel.beauty[0] = -(1 << (bits % 72));
            pixel.square[1] = Square {
                whole: 1 << (bits % 65),
                fraction: i as u64,
            };
            pixel.depth = if i < 900 { 5 } else { 6 };
            pixel.hits = (i > 300) as u32;
        }
        film.merge(
            &one,
            Receipt {
                digest: [begin as u8; 32],
                worker: "w".into(),
            },
        )
        .unwrap();
        let bytes = encode_tile(&film.tiles()[0], 0, ENGINE_VERSION);
        let SavedTile { tile, .. } = decode_tile(&bytes).unwrap();
        assert_eq!(tile.digest(), film.tiles()[0].digest());
        assert_eq!(encode_tile(&tile, 0, ENGINE_VERSION), bytes);
    }
}

/// Written by format 1, and to be read for ever.
#[test]
fn golden_files_still_read() {
    let folder = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/golden");
    let mut film = Film::for_engine(
        TileGrid {
            width: 5,
            height: 3,
        },
        6,
        EngineVersion(1),
    );
    merge(&mut film, 0, 0, 1);
    merge(&mut film, 0, 4, 8);
    let mut blobs = Blobs::new();
    let manifest = save(&film, None, 12345, &mut blobs);
    let blob = blobs.values().next().unwrap();
    if std::env::var_os("BLESS").is_some() {
        std::fs::create_dir_all(folder).unwrap();
        std::fs::write(format!("{folder}/manifest-v1.bin"), manifest.encode()).unwrap();
        std::fs::write(format!("{folder}/tile-v1.bin"), blob).unwrap();
    }
    let read = |name: &str| std::fs::read(format!("{folder}/{name}")).unwrap();
    let golden = Manifest::decode(&read("manifest-v1.bin")).unwrap();
    let tile = decode_tile(&read("tile-v1.bin")).unwrap();
    assert_eq!((golden.log_pos, golden.frame), (12345, 6));
    assert_eq!((tile.frame, tile.tile.ranges().len()), (6, 2));
    assert_eq!(tile.tile.merged_units(), film.tiles()[0].merged_units());
    assert_eq!(tile.tile.digest(), film.tiles()[0].digest());
}
