//! Results of workers and checkpoints.

use film::{
    Film, Manifest, Merged, PackedUnit, Receipt, TileGrid, decode_tile, decode_unit, encode_unit,
};

/// Whoever forges a file computes its checksum: without this no change would come past it.
fn resealed(bytes: &[u8]) -> Option<Vec<u8>> {
    let body = bytes.len().checked_sub(4)?;
    let mut out = bytes.to_vec();
    let crc = crc32fast::hash(&out[..body]);
    out[body..].copy_from_slice(&crc.to_le_bytes());
    Some(out)
}

/// The result of a unit, as bytes stand and with a length and a checksum that agree with them.
pub fn unit(bytes: &[u8]) {
    read_unit(bytes);
    let mut bytes = bytes.to_vec();
    if let Some(length) = bytes.get(10..14) {
        let said = (bytes.len() as u32).to_le_bytes();
        if length != said {
            bytes[10..14].copy_from_slice(&said);
        }
    }
    if let Some(sealed) = resealed(&bytes) {
        read_unit(&sealed);
    }
}

fn read_unit(bytes: &[u8]) {
    let packed = PackedUnit::read(bytes);
    let Ok(result) = decode_unit(bytes) else {
        assert!(packed.is_err(), "refused by one reader alone");
        return;
    };
    let packed = packed.expect("refused by one reader alone");
    let again = encode_unit(result.unit, &result.buffer, &result.counters, result.engine);
    assert_eq!(again, bytes, "other bytes for the same sums");
    // Where the unit belongs to this film, its sums are added once or refused.
    let grid = TileGrid {
        width: 100,
        height: 70,
    };
    let mut film = Film::for_engine(grid, result.unit.frame, result.engine);
    let receipt = Receipt::of(bytes, "worker");
    let mut other = film.clone();
    let by_bytes = other.merge_packed(&packed, receipt.clone());
    let first = film.merge(&result, receipt.clone());
    assert_eq!((&by_bytes, other.digest()), (&first, film.digest()));
    let second = film.merge(&result, receipt);
    match first {
        Ok(merged) => assert_eq!(
            (merged, second),
            (Merged::Added, Ok(Merged::AlreadyMerged)),
            "merged twice"
        ),
        Err(_) => assert!(second.is_err(), "refused, then merged"),
    }
    let _ = film.error();
}

/// The blob of a tile and the manifest of a frame.
pub fn checkpoint(bytes: &[u8]) {
    read_checkpoint(bytes);
    if let Some(sealed) = resealed(bytes) {
        read_checkpoint(&sealed);
    }
}

fn read_checkpoint(bytes: &[u8]) {
    if let Ok(manifest) = Manifest::decode(bytes) {
        assert_eq!(
            manifest.encode(),
            bytes,
            "other bytes for the same manifest"
        );
    }
    if let Ok(saved) = decode_tile(bytes) {
        // What the coordinator asks of a tile that it has restored.
        let _ = saved.tile.errors();
        let written = film::encode_tile(&saved.tile, saved.frame, saved.engine);
        let again = decode_tile(&written).expect("a tile that was read can be saved");
        assert_eq!(again.tile.digest(), saved.tile.digest());
    }
}
