//! Films to blobs and back. Writing: changed tiles, then the manifest, then the job record by
//! compare-and-set; the log is trimmed behind the *previous* checkpoint, so that either can be
//! replayed. Reading: the newest that is whole, then the log from its position.

use crate::farm::Farm;
use crate::record::{Checkpoint, FrameRecord, JobRecord, hex, parse_digest};
use film::{EngineVersion, Film, Manifest, MergeError, Merged, Receipt};
use std::collections::BTreeSet;
use store::{Digest, StoreError};
use uuid::Uuid;

/// Tile bytes that are written in one go: bounds memory, and lets the disk merge the syncs.
const GROUP_BYTES: usize = 32 << 20;

/// Blobs that a checkpoint consists of, itself among them.
pub fn blobs_of(farm: &Farm, checkpoint: &Checkpoint) -> Result<BTreeSet<Digest>, StoreError> {
    let (digest, manifest) = read_manifest(farm, checkpoint)?;
    let tiles = manifest.tiles.iter().flatten().map(|e| e.digest);
    Ok(tiles.chain([digest]).collect())
}

fn read_manifest(farm: &Farm, checkpoint: &Checkpoint) -> Result<(Digest, Manifest), StoreError> {
    let damaged = |what: String| StoreError::Damaged { what };
    let digest = parse_digest(&checkpoint.manifest)
        .ok_or_else(|| damaged(format!("'{}' names no manifest", checkpoint.manifest)))?;
    let bytes = farm.stores.blobs.get(&digest)?;
    let manifest = Manifest::decode(&bytes)
        .map_err(|e| damaged(format!("manifest {}: {e}", checkpoint.manifest)))?;
    Ok((digest, manifest))
}

/// Writes the changed tiles of a film and the manifest. Every blob is held once; so are those of
/// the tiles that did not change.
pub fn write(
    farm: &Farm,
    film: &Film,
    previous: Option<&Manifest>,
    log_pos: u64,
) -> Result<(Checkpoint, Manifest), StoreError> {
    let mut waiting: Vec<Vec<u8>> = Vec::new();
    let mut bytes = 0;
    let flush = |waiting: &mut Vec<Vec<u8>>| -> Result<(), StoreError> {
        let slices: Vec<&[u8]> = waiting.iter().map(Vec::as_slice).collect();
        farm.stores.blobs.put_many(&slices)?;
        waiting.clear();
        Ok(())
    };
    let mut held: Vec<Digest> = Vec::new();
    let result = film
        .checkpoint(previous, log_pos, |digest, blob| {
            farm.refs.hold([digest]);
            held.push(digest);
            bytes += blob.len();
            waiting.push(blob);
            if bytes >= GROUP_BYTES {
                bytes = 0;
                flush(&mut waiting)?;
            }
            Ok(())
        })
        .and_then(|manifest| {
            flush(&mut waiting)?;
            let encoded = manifest.encode();
            let digest = *blake3::hash(&encoded).as_bytes();
            farm.refs.hold([digest]);
            held.push(digest);
            farm.stores.blobs.put(&encoded)?;
            Ok((manifest, digest))
        });
    match result {
        Ok((manifest, digest)) => {
            let fresh: BTreeSet<Digest> = held.iter().copied().collect();
            let old: BTreeSet<Digest> = manifest.tiles.iter().flatten().map(|e| e.digest).collect();
            farm.refs.hold(old.difference(&fresh).copied());
            // Two tiles may be the same bytes: a checkpoint holds each blob once.
            let mut seen = BTreeSet::new();
            farm.refs
                .release(held.into_iter().filter(|d| !seen.insert(*d)));
            let manifest_name = hex(&digest);
            Ok((
                Checkpoint {
                    manifest: manifest_name,
                    log_pos,
                },
                manifest,
            ))
        }
        Err(error) => {
            farm.refs.release(held);
            Err(error)
        }
    }
}

/// A film as it was, and how: for the owner to go on from.
pub struct Restored {
    /// The film with everything that is known.
    pub film: Film,
    /// What is in the store of it.
    pub manifest: Option<Manifest>,
    /// Results merged from the log.
    pub replayed: u64,
}

/// Reads a frame back: checkpoint and log.
pub fn restore(farm: &Farm, record: &JobRecord, frame: u32) -> Result<Restored, StoreError> {
    let about = record.begun.get(&frame).cloned().unwrap_or_default();
    let (mut film, manifest) = read_film(farm, record, &about, frame)?;
    let log_pos = manifest.as_ref().map_or(0, |m| m.log_pos);
    for void in about.voids.iter().filter(|v| v.before >= log_pos) {
        film.clear(void.tile);
    }
    let mut replayed = 0;
    farm.stores.log.read(record.id, log_pos, &mut |position, entry| {
        let unit = entry.unit;
        let void = about
            .voids
            .iter()
            .any(|v| v.tile == unit.tile && position < v.before);
        if unit.frame != frame || void {
            return Ok(());
        }
        let receipt = Receipt {
            digest: entry.digest,
            worker: entry.worker.to_string(),
        };
        match film::PackedUnit::read(&entry.bytes) {
            Ok(result) => match film.merge_packed(&result, receipt) {
                Ok(Merged::Added) => replayed += 1,
                Ok(Merged::AlreadyMerged) | Err(MergeError::Overlap { .. }) => {}
                Err(error) => tracing::warn!(job.id = %record.id, unit.id = %unit, %error, "a logged result is not merged"),
            },
            // It was decoded before it was logged, and the log has checksums: only another version
            // of the format gets here. The samples are missing and are rendered again.
            Err(error) => tracing::warn!(job.id = %record.id, unit.id = %unit, %error, "a logged result cannot be read"),
        }
        Ok(())
    })?;
    // The film knows what counts. What the log has beyond that (a bad worker's results) must not
    // keep good ones out.
    farm.stores.log.forget_all(record.id);
    Ok(Restored {
        film,
        manifest,
        replayed,
    })
}

/// The newest checkpoint that is whole, else an empty film.
fn read_film(
    farm: &Farm,
    record: &JobRecord,
    about: &FrameRecord,
    frame: u32,
) -> Result<(Film, Option<Manifest>), StoreError> {
    let id = record.id;
    for checkpoint in [&about.current, &about.previous].into_iter().flatten() {
        match read_checkpoint(farm, checkpoint) {
            Ok((film, manifest)) => return Ok((film, Some(manifest))),
            // Storage that is merely away must not be taken for lost.
            Err(error @ StoreError::Unavailable { .. }) => return Err(error),
            Err(error) => {
                tracing::error!(job.id = %id, frame, manifest = checkpoint.manifest, %error,
                    "a checkpoint is damaged; trying the one before");
            }
        }
    }
    if about.current.is_some() {
        tracing::error!(job.id = %id, frame, "no checkpoint is left; what the log lacks is rendered again");
    }
    let film = Film::for_engine(record.grid(), frame, EngineVersion(record.engine));
    Ok((film, None))
}

fn read_checkpoint(farm: &Farm, checkpoint: &Checkpoint) -> Result<(Film, Manifest), StoreError> {
    let (_, manifest) = read_manifest(farm, checkpoint)?;
    let film = Film::from_checkpoint(&manifest, |digest| {
        farm.stores.blobs.get(&digest).map(|b| b.to_vec())
    })
    .map_err(|error| StoreError::Damaged {
        what: format!("checkpoint {}: {error}", checkpoint.manifest),
    })?;
    Ok((film, manifest))
}

/// A film for looking at: from memory, else from its checkpoint.
pub fn look(
    farm: &Farm,
    job: Uuid,
    frame: u32,
) -> Result<Option<crate::films::SharedFilm>, StoreError> {
    if let Some(film) = farm.films.get(job, frame) {
        return Ok(Some(film));
    }
    let Some(record) = farm.state().jobs.get(&job).map(|j| j.record.clone()) else {
        return Ok(None);
    };
    let about = match record.begun.get(&frame) {
        Some(about) if about.current.is_some() => about.clone(),
        _ => return Ok(None),
    };
    let (film, _) = read_film(farm, &record, &about, frame)?;
    Ok(Some(farm.films.insert(job, frame, film, false)))
}
