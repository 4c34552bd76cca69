//! The two containers: JSON text, and GLB, which is a header and chunks.

use crate::assets::AssetBytes;
use crate::context::{Context, Issue};
use crate::diagnostic::Place;
use std::ops::Range;

const MAGIC: &[u8; 4] = b"glTF";
const JSON: u32 = 0x4e4f_534a;
const BIN: u32 = 0x004e_4942;

/// Some bytes of a file that is held as a whole.
#[derive(Clone, Debug)]
pub(super) struct Slice {
    whole: AssetBytes,
    range: Range<usize>,
}

impl Slice {
    pub fn all(whole: AssetBytes) -> Self {
        let range = 0..whole.len();
        Slice { whole, range }
    }
    pub fn bytes(&self) -> &[u8] {
        self.whole.get(self.range.clone()).unwrap_or_default()
    }
    pub fn len(&self) -> usize {
        self.range.len()
    }
    /// A part of it, if it is long enough.
    pub fn part(&self, offset: u64, length: u64) -> Option<Slice> {
        let end = offset.checked_add(length)?;
        if end > self.len() as u64 {
            return None;
        }
        let start = self.range.start + offset as usize;
        Some(Slice {
            whole: self.whole.clone(),
            range: start..start + length as usize,
        })
    }
}

/// JSON text and the binary chunk of a file.
pub(super) struct Parts {
    pub json: Slice,
    pub bin: Option<Slice>,
}

/// Takes a file apart; its first bytes say which container it is.
pub(super) fn open(place: &Place, file: AssetBytes, cx: &mut Context<'_>) -> Result<Parts, Issue> {
    let all = Slice::all(file);
    if !all.bytes().starts_with(MAGIC) {
        return Ok(Parts {
            json: all,
            bin: None,
        });
    }
    let fail = |at: u64, reason: String| Issue::new(place, format!("{reason}, at byte {at}"));
    let word = |at: u64| {
        let four = all.part(at, 4)?;
        four.bytes()
            .first_chunk::<4>()
            .copied()
            .map(u32::from_le_bytes)
    };
    let (Some(version), Some(length)) = (word(4), word(8)) else {
        return Err(fail(all.len() as u64, "the file ends in its header".into()));
    };
    if version != 2 {
        let reason = format!("a GLB of version {version}; only version 2 (glTF 2.0) is read");
        return Err(fail(4, reason));
    }
    let (length, size) = (u64::from(length), all.len() as u64);
    if length > size {
        return Err(fail(
            8,
            format!("the header says {length} bytes, but the file has {size}"),
        ));
    }
    if length < size {
        cx.warn(
            place,
            format!(
                "{} bytes after the end of the GLB are ignored",
                size - length
            ),
        );
    }
    let mut parts: Vec<(u32, Slice)> = Vec::new();
    let mut at = 12u64;
    while at < length {
        let (Some(size), Some(kind)) = (word(at), word(at + 4)) else {
            return Err(fail(at, "the file ends in the header of a chunk".into()));
        };
        let end = at + 8 + u64::from(size);
        let body = all.part(at + 8, u64::from(size)).filter(|_| end <= length);
        let Some(body) = body else {
            return Err(fail(
                at,
                format!(
                    "a chunk of {size} bytes, but only {} are left",
                    length.saturating_sub(at + 8)
                ),
            ));
        };
        let known = kind == JSON || kind == BIN;
        if parts.is_empty() && kind != JSON {
            return Err(fail(at, "the first chunk is not JSON".into()));
        }
        if known && parts.iter().any(|(k, _)| *k == kind) {
            return Err(fail(at, "a second chunk of the same kind".into()));
        }
        if known {
            parts.push((kind, body));
        } else {
            cx.warn(
                place,
                format!("a chunk of an unknown kind ({kind:#010x}) at byte {at} is skipped"),
            );
        }
        at = end;
    }
    let mut find = |kind: u32| {
        let index = parts.iter().position(|(k, _)| *k == kind)?;
        Some(parts.swap_remove(index).1)
    };
    let bin = find(BIN);
    match find(JSON) {
        Some(json) => Ok(Parts { json, bin }),
        None => Err(fail(12, "a GLB without a JSON chunk".into())),
    }
}
