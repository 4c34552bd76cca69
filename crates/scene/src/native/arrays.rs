//! Grids and curves as binary files: a magic word, then counts and numbers, little-endian, as
//! [`super::buffer`] has them for meshes.

use super::buffer::{Reader, put};
use crate::model::{CurveSegment, Grid, GridValues};

const GRID: &[u8; 8] = b"brgrid01";
const CURVES: &[u8; 8] = b"brcurv01";

/// Numbers of a segment.
const SEGMENT: usize = 22;

fn open<'a>(bytes: &'a [u8], magic: &[u8; 8], what: &str) -> Result<Reader<'a>, String> {
    match bytes.strip_prefix(magic) {
        Some(rest) => Ok(Reader {
            rest,
            size: bytes.len(),
        }),
        None => Err(format!("not a {what} of this version")),
    }
}

pub(super) fn write_grid(grid: &Grid) -> Vec<u8> {
    let mut out = GRID.to_vec();
    for side in grid.size {
        out.extend_from_slice(&side.to_le_bytes());
    }
    match &grid.values {
        GridValues::Scalar(values) => {
            out.extend_from_slice(&1u32.to_le_bytes());
            put(&mut out, values.as_chunks::<1>().0);
        }
        GridValues::Rgb(values) => {
            out.extend_from_slice(&3u32.to_le_bytes());
            put(&mut out, values);
        }
    }
    out
}

/// The grid of a file. Whether its counts agree is for `validate` to say.
pub(super) fn read_grid(bytes: &[u8]) -> Result<Grid, String> {
    let mut reader = open(bytes, GRID, "grid file")?;
    let mut size = [0; 3];
    for side in &mut size {
        *side = u32::from_le_bytes(reader.bytes()?);
    }
    let values = match u32::from_le_bytes(reader.bytes()?) {
        1 => GridValues::Scalar(reader.floats::<1>()?.into_iter().flatten().collect()),
        3 => GridValues::Rgb(reader.floats::<3>()?),
        other => return reader.fail(&format!("{other} channels; 1 and 3 are possible")),
    };
    if !reader.rest.is_empty() {
        return reader.fail("bytes are left over");
    }
    Ok(Grid { size, values })
}

pub(super) fn write_curves(segments: &[CurveSegment]) -> Vec<u8> {
    let mut out = CURVES.to_vec();
    out.extend_from_slice(&(segments.len() as u64).to_le_bytes());
    for s in segments {
        let points = s.points.as_flattened();
        let normals = s.normals.as_flattened();
        for x in points.iter().chain(&s.width).chain(&s.u).chain(normals) {
            out.extend_from_slice(&x.to_le_bytes());
        }
    }
    out
}

/// The segments of a file.
pub(super) fn read_curves(bytes: &[u8]) -> Result<Vec<CurveSegment>, String> {
    let mut reader = open(bytes, CURVES, "curves file")?;
    let rows = reader.floats::<SEGMENT>()?;
    if !reader.rest.is_empty() {
        return reader.fail("bytes are left over");
    }
    let point = |row: &[f32; SEGMENT], at: usize| [row[at], row[at + 1], row[at + 2]];
    Ok(rows
        .iter()
        .map(|row| CurveSegment {
            points: [point(row, 0), point(row, 3), point(row, 6), point(row, 9)],
            width: [row[12], row[13]],
            u: [row[14], row[15]],
            normals: [point(row, 16), point(row, 19)],
        })
        .collect())
}
