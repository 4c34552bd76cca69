//! One file of the result log.
//!
//! ```text
//! magic "BRLSEG01"  base u64          the position of the byte after this head
//! then frames:
//!   magic "BRLF"  length u32  crc32 of the payload u32  synced u64  crc32 of this head u32
//!   payload: job 16  frame, tile, begin, end u32  worker 16  digest 32  result
//! ```
//! All little endian. `synced` is the position up to which the log was known to be on disk when the
//! frame was written. It tells a torn tail from damage: frames that were written together may reach
//! the disk in any order, so what follows a hole proves nothing, unless it says that the hole had
//! been synced before.

use crate::{LogEntry, StoreError};
use bytes::Bytes;
use film::{SampleRange, Unit};
use std::fs::File;
use std::os::unix::fs::FileExt;
use std::path::Path;
use uuid::Uuid;

const SEGMENT_MAGIC: &[u8; 8] = b"BRLSEG01";
/// Bytes before the first frame.
pub const SEGMENT_HEAD: u64 = 16;
const FRAME_MAGIC: &[u8; 4] = b"BRLF";
const FRAME_HEAD: usize = 24;
const PAYLOAD_HEAD: usize = 16 + 16 + 16 + 32;
/// No result is longer: what claims more is damage.
const RESULT_BYTES_MAX: usize = 64 << 20;

/// The head of a new segment.
pub fn segment_head(base: u64) -> [u8; SEGMENT_HEAD as usize] {
    let mut head = [0; SEGMENT_HEAD as usize];
    head[..8].copy_from_slice(SEGMENT_MAGIC);
    head[8..].copy_from_slice(&base.to_le_bytes());
    head
}

/// The bytes of a frame before the result.
pub fn frame_head(entry: &LogEntry, synced: u64) -> Vec<u8> {
    let mut out = Vec::with_capacity(FRAME_HEAD + PAYLOAD_HEAD);
    out.resize(FRAME_HEAD, 0);
    out.extend_from_slice(entry.job.as_bytes());
    let Unit {
        frame,
        tile,
        samples,
    } = entry.unit;
    for value in [frame, tile, samples.begin, samples.end] {
        out.extend_from_slice(&value.to_le_bytes());
    }
    out.extend_from_slice(entry.worker.as_bytes());
    out.extend_from_slice(&entry.digest);
    let mut crc = crc32fast::Hasher::new();
    crc.update(&out[FRAME_HEAD..]);
    crc.update(&entry.bytes);
    out[..4].copy_from_slice(FRAME_MAGIC);
    out[4..8].copy_from_slice(&((PAYLOAD_HEAD + entry.bytes.len()) as u32).to_le_bytes());
    out[8..12].copy_from_slice(&crc.finalize().to_le_bytes());
    out[12..20].copy_from_slice(&synced.to_le_bytes());
    let crc = crc32fast::hash(&out[..20]);
    out[20..24].copy_from_slice(&crc.to_le_bytes());
    out
}

/// Bytes that an entry takes.
pub fn frame_len(entry: &LogEntry) -> u64 {
    (FRAME_HEAD + PAYLOAD_HEAD + entry.bytes.len()) as u64
}

struct Head {
    length: usize,
    crc: u32,
    synced: u64,
}

fn parse_head(head: &[u8; FRAME_HEAD]) -> Option<Head> {
    let word = |at: usize| u32::from_le_bytes([head[at], head[at + 1], head[at + 2], head[at + 3]]);
    if &head[..4] != FRAME_MAGIC || word(20) != crc32fast::hash(&head[..20]) {
        return None;
    }
    let length = word(4) as usize;
    (PAYLOAD_HEAD..=PAYLOAD_HEAD + RESULT_BYTES_MAX)
        .contains(&length)
        .then(|| Head {
            length,
            crc: word(8),
            synced: u64::from(word(12)) | u64::from(word(16)) << 32,
        })
}

fn parse_payload(payload: Bytes) -> Option<LogEntry> {
    let id = |at: usize| Some(Uuid::from_bytes(payload.get(at..at + 16)?.try_into().ok()?));
    let word = |at: usize| {
        Some(u32::from_le_bytes(
            payload.get(at..at + 4)?.try_into().ok()?,
        ))
    };
    let samples = SampleRange {
        begin: word(24)?,
        end: word(28)?,
    };
    Some(LogEntry {
        job: id(0)?,
        unit: Unit {
            frame: word(16)?,
            tile: word(20)?,
            samples,
        },
        worker: id(32)?,
        digest: payload.get(48..80)?.try_into().ok()?,
        bytes: payload.slice(PAYLOAD_HEAD..),
    })
}

/// Reads the frame at an offset of the file; its length beside it.
pub fn read_frame(file: &File, at: u64, end: u64) -> Result<Option<(LogEntry, u64)>, StoreError> {
    let io = |e: std::io::Error| StoreError::io("the result log", &e);
    if at + FRAME_HEAD as u64 > end {
        return Ok(None);
    }
    let mut head = [0; FRAME_HEAD];
    file.read_exact_at(&mut head, at).map_err(io)?;
    let Some(head) = parse_head(&head) else {
        return Ok(None);
    };
    let from = at + FRAME_HEAD as u64;
    if from + head.length as u64 > end {
        return Ok(None);
    }
    let mut payload = vec![0; head.length];
    file.read_exact_at(&mut payload, from).map_err(io)?;
    if crc32fast::hash(&payload) != head.crc {
        return Ok(None);
    }
    Ok(parse_payload(payload.into()).map(|e| (e, (FRAME_HEAD + head.length) as u64)))
}

/// What [`scan`] found.
pub struct Scanned {
    /// Position of the first byte after the head.
    pub base: u64,
    /// Offset behind the last frame that can be used.
    pub end: u64,
    /// Whether something unusable follows, which is a torn tail and may be cut.
    pub torn: bool,
}

/// Reads a segment from its beginning. `last` says that no segment follows: only there may the
/// tail be torn. None: the file was created but its head never reached the disk.
pub fn scan(
    path: &Path,
    file: &File,
    last: bool,
    each: &mut dyn FnMut(u64, LogEntry),
) -> Result<Option<Scanned>, StoreError> {
    let name = || path.display().to_string();
    let io = |e: std::io::Error| StoreError::io(&name(), &e);
    let size = file.metadata().map_err(io)?.len();
    let mut head = [0; SEGMENT_HEAD as usize];
    let whole = size >= SEGMENT_HEAD && {
        file.read_exact_at(&mut head, 0).map_err(io)?;
        head.starts_with(SEGMENT_MAGIC)
    };
    if !whole {
        if last && size <= SEGMENT_HEAD {
            return Ok(None);
        }
        return Err(StoreError::Damaged {
            what: format!("{} has no head", name()),
        });
    }
    let (_, base) = head.split_at(8);
    let base = u64::from_le_bytes(base.try_into().unwrap_or_default());
    let mut at = SEGMENT_HEAD;
    while let Some((entry, length)) = read_frame(file, at, size)? {
        each(base + at - SEGMENT_HEAD, entry);
        at += length;
    }
    if at < size {
        let hole = base + at - SEGMENT_HEAD;
        if !last || synced_after(file, at, size)? > hole {
            return Err(StoreError::Damaged {
                what: format!("{} at byte {at}: a result that was on disk is gone", name()),
            });
        }
    }
    Ok(Some(Scanned {
        base,
        end: at,
        torn: at < size,
    }))
}

/// The largest `synced` that any frame behind a hole carries.
fn synced_after(file: &File, hole: u64, size: u64) -> Result<u64, StoreError> {
    let io = |e: std::io::Error| StoreError::io("the result log", &e);
    let mut rest = vec![0; usize::try_from(size - hole).unwrap_or(0)];
    file.read_exact_at(&mut rest, hole).map_err(io)?;
    // The head has a checksum of its own: noise does not pass for one.
    Ok(rest
        .windows(FRAME_HEAD)
        .filter(|w| w.starts_with(FRAME_MAGIC))
        .filter_map(|w| parse_head(w.try_into().ok()?))
        .map(|head| head.synced)
        .max()
        .unwrap_or(0))
}
