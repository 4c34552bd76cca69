//! The numbers after a PLY header.

use super::header::{Element, Header, Kind, Scalar};
use super::{PlyError, PlyMesh};
use crate::limits::MAX_IMPORT_BYTES;
use crate::number::number;

/// The longest polygon.
const MAX_CORNERS: u64 = 1 << 16;
/// The most triangles: as many as half the memory of an import holds.
const MAX_TRIANGLES: usize = (MAX_IMPORT_BYTES / 2 / 12) as usize;

/// A reader of one number after the other.
pub(super) trait Numbers {
    /// The next number.
    fn next(&mut self, kind: Scalar) -> Result<f64, PlyError>;
    /// Skips numbers.
    fn skip(&mut self, kind: Scalar, count: u64) -> Result<(), PlyError>;
    /// The smallest number of bytes that a number takes.
    fn least_bytes(kind: Scalar) -> u64;
    /// Bytes that are left.
    fn left(&self) -> u64;
    /// An error at this place.
    fn fail(&self, reason: String) -> PlyError;
    /// The next `size` bytes as they are, if numbers are binary and in the machine-independent order
    /// that [`Numbers::float`] reads.
    fn block(&mut self, size: usize) -> Option<&[u8]>;
    /// Takes faces off the front as long as they are triangles of 32-bit indices after a count of one
    /// byte, at most `count` of them.
    fn triangles(&mut self, count: usize, into: &mut Vec<[u32; 3]>);
    /// A float of a block.
    fn float(bytes: &[u8], at: usize) -> f32;
    /// An integer of a block.
    fn integer(bytes: &[u8], at: usize) -> u32;
}

/// Binary numbers.
pub(super) struct Binary<'a, const BIG: bool> {
    data: &'a [u8],
    at: usize,
    /// Where `data` begins in the file, for messages.
    start: usize,
}

impl<'a, const BIG: bool> Binary<'a, BIG> {
    pub fn new(data: &'a [u8], start: usize) -> Self {
        Binary { data, at: 0, start }
    }
    fn bytes<const N: usize>(&mut self) -> Result<[u8; N], PlyError> {
        let Some(bytes) = self
            .data
            .get(self.at..)
            .and_then(|rest| rest.first_chunk::<N>())
        else {
            return Err(self.fail("the file ends too early".into()));
        };
        self.at += N;
        let mut bytes = *bytes;
        if BIG {
            bytes.reverse();
        }
        Ok(bytes)
    }
}

impl<const BIG: bool> Numbers for Binary<'_, BIG> {
    fn next(&mut self, kind: Scalar) -> Result<f64, PlyError> {
        Ok(match kind {
            Scalar::I8 => f64::from(i8::from_le_bytes(self.bytes()?)),
            Scalar::U8 => f64::from(u8::from_le_bytes(self.bytes()?)),
            Scalar::I16 => f64::from(i16::from_le_bytes(self.bytes()?)),
            Scalar::U16 => f64::from(u16::from_le_bytes(self.bytes()?)),
            Scalar::I32 => f64::from(i32::from_le_bytes(self.bytes()?)),
            Scalar::U32 => f64::from(u32::from_le_bytes(self.bytes()?)),
            Scalar::F32 => f64::from(f32::from_le_bytes(self.bytes()?)),
            Scalar::F64 => f64::from_le_bytes(self.bytes()?),
        })
    }
    fn skip(&mut self, kind: Scalar, count: u64) -> Result<(), PlyError> {
        let bytes = count.saturating_mul(kind.size() as u64);
        if bytes > self.left() {
            return Err(self.fail("the file ends too early".into()));
        }
        self.at += bytes as usize;
        Ok(())
    }
    fn least_bytes(kind: Scalar) -> u64 {
        kind.size() as u64
    }
    fn left(&self) -> u64 {
        (self.data.len() - self.at) as u64
    }
    fn fail(&self, reason: String) -> PlyError {
        PlyError::new(format!("{reason}, at byte {}", self.start + self.at))
    }
    fn block(&mut self, size: usize) -> Option<&[u8]> {
        let block = self.data.get(self.at..)?.get(..size)?;
        self.at += size;
        Some(block)
    }
    fn triangles(&mut self, count: usize, into: &mut Vec<[u32; 3]>) {
        let rest = self.data.get(self.at..).unwrap_or_default();
        let (records, _) = rest.as_chunks::<13>();
        let before = into.len();
        let triangles = records.iter().take(count).take_while(|r| r[0] == 3);
        into.extend(triangles.map(|r| [1, 5, 9].map(|at| Self::integer(r, at))));
        self.at += 13 * (into.len() - before);
    }
    fn float(bytes: &[u8], at: usize) -> f32 {
        f32::from_bits(Self::integer(bytes, at))
    }
    fn integer(bytes: &[u8], at: usize) -> u32 {
        let four = bytes
            .get(at..)
            .and_then(|rest| rest.first_chunk::<4>())
            .copied()
            .unwrap_or_default();
        if BIG {
            u32::from_be_bytes(four)
        } else {
            u32::from_le_bytes(four)
        }
    }
}

/// Numbers as text.
pub(super) struct Ascii<'a> {
    data: &'a [u8],
    at: usize,
    line: u32,
}

impl<'a> Ascii<'a> {
    pub fn new(data: &'a [u8], line: u32) -> Self {
        Ascii { data, at: 0, line }
    }
}

impl Numbers for Ascii<'_> {
    fn next(&mut self, kind: Scalar) -> Result<f64, PlyError> {
        while let Some(b) = self.data.get(self.at).filter(|b| b.is_ascii_whitespace()) {
            self.line += u32::from(*b == b'\n');
            self.at += 1;
        }
        if self.at == self.data.len() {
            return Err(self.fail("the file ends too early".into()));
        }
        let rest = &self.data[self.at..];
        let word = || {
            let end = rest
                .iter()
                .take(40)
                .position(|b| b.is_ascii_whitespace())
                .unwrap_or(rest.len().min(40));
            String::from_utf8_lossy(&rest[..end]).into_owned()
        };
        let (value, used) = match number(rest) {
            Some(found) => found,
            None => match word().to_ascii_lowercase().trim_start_matches('-') {
                // Written by several exporters; refused or left out later, by what it stands for.
                w @ ("nan" | "inf") => (f64::NAN, w.len() + usize::from(rest[0] == b'-')),
                _ => return Err(self.fail(format!("expected a number, found {:?}", word()))),
            },
        };
        if rest.get(used).is_some_and(|b| !b.is_ascii_whitespace()) {
            return Err(self.fail(format!("expected a number, found {:?}", word())));
        }
        self.at += used;
        if kind.is_integer() && libm::trunc(value) != value {
            return Err(self.fail(format!("expected an integer, found {value}")));
        }
        Ok(value)
    }
    fn skip(&mut self, kind: Scalar, count: u64) -> Result<(), PlyError> {
        for _ in 0..count {
            self.next(kind)?;
        }
        Ok(())
    }
    fn least_bytes(_: Scalar) -> u64 {
        2
    }
    fn left(&self) -> u64 {
        // The last number needs no white space after it.
        (self.data.len() - self.at) as u64 + 1
    }
    fn fail(&self, reason: String) -> PlyError {
        PlyError::at_line(self.line, reason)
    }
    fn block(&mut self, _: usize) -> Option<&[u8]> {
        None
    }
    fn triangles(&mut self, _: usize, _: &mut Vec<[u32; 3]>) {}
    fn float(_: &[u8], _: usize) -> f32 {
        0.0
    }
    fn integer(_: &[u8], _: usize) -> u32 {
        0
    }
}

/// Reads all elements.
pub(super) fn read<N: Numbers>(header: &Header, mut numbers: N) -> Result<PlyMesh, PlyError> {
    let mut mesh = PlyMesh::default();
    for element in &header.elements {
        // A record of nothing has no bytes to hold its count against.
        if element.properties.is_empty() {
            if element.count > 0 && (element.name == "vertex" || element.name == "face") {
                return Err(numbers.fail(format!("element {:?} has no properties", element.name)));
            }
            continue;
        }
        let least: u64 = element
            .properties
            .iter()
            .map(|p| match p.kind {
                Kind::Scalar(kind) => N::least_bytes(kind),
                Kind::List { count, .. } => N::least_bytes(count),
            })
            .sum();
        if element.count.saturating_mul(least) > numbers.left() {
            return Err(numbers.fail(format!(
                "the header promises {} of element {:?}, more than the {} bytes that are left can hold",
                element.count,
                element.name,
                numbers.left()
            )));
        }
        match element.name.as_str() {
            "vertex" => vertices(element, &mut numbers, &mut mesh)?,
            "face" => faces(element, &mut numbers, &mut mesh)?,
            _ => {
                for _ in 0..element.count {
                    for property in &element.properties {
                        skip(&property.kind, &mut numbers)?;
                    }
                }
            }
        }
    }
    Ok(mesh)
}

fn skip<N: Numbers>(kind: &Kind, numbers: &mut N) -> Result<(), PlyError> {
    match *kind {
        Kind::Scalar(kind) => numbers.skip(kind, 1),
        Kind::List { count, item } => {
            let length = list_length(numbers, count)?;
            numbers.skip(item, length)
        }
    }
}

fn list_length<N: Numbers>(numbers: &mut N, kind: Scalar) -> Result<u64, PlyError> {
    let length = numbers.next(kind)?;
    if !(0.0..=MAX_CORNERS as f64).contains(&length) {
        return Err(numbers.fail(format!(
            "a list of {length} items; the limit is {MAX_CORNERS}"
        )));
    }
    Ok(length as u64)
}

/// What a vertex property is for: x y z, nx ny nz, u v, red green blue, in this order.
const SLOTS: [&[&str]; 11] = [
    &["x"],
    &["y"],
    &["z"],
    &["nx"],
    &["ny"],
    &["nz"],
    &["u", "s", "texture_u", "texture_s"],
    &["v", "t", "texture_v", "texture_t"],
    &["red", "diffuse_red"],
    &["green", "diffuse_green"],
    &["blue", "diffuse_blue"],
];

fn vertices<N: Numbers>(
    element: &Element,
    numbers: &mut N,
    mesh: &mut PlyMesh,
) -> Result<(), PlyError> {
    let slot = |name: &str| SLOTS.iter().position(|names| names.contains(&name));
    let slots: Vec<Option<usize>> = element.properties.iter().map(|p| slot(&p.name)).collect();
    let has = |range: std::ops::Range<usize>| range.clone().all(|i| slots.contains(&Some(i)));
    if !has(0..3) {
        return Err(numbers.fail("vertices without x, y and z".into()));
    }
    let (has_normals, has_uvs, has_colors) = (has(3..6), has(6..8), has(8..11));
    let count =
        usize::try_from(element.count).map_err(|_| numbers.fail("too many vertices".into()))?;
    if u32::try_from(count).is_err() {
        return Err(numbers.fail("more vertices than 32 bits can count".into()));
    }
    let record = 12
        + if has_normals { 12 } else { 0 }
        + if has_uvs { 8 } else { 0 }
        + if has_colors { 12 } else { 0 };
    let bytes = count as u64 * record;
    if bytes > MAX_IMPORT_BYTES {
        return Err(numbers.fail(format!(
            "vertices of {bytes} bytes; the limit of an import is {MAX_IMPORT_BYTES}"
        )));
    }
    mesh.positions.reserve_exact(count);
    if has_normals {
        mesh.normals.reserve_exact(count);
    }
    if has_uvs {
        mesh.uvs.reserve_exact(count);
    }
    if has_colors {
        mesh.colors.reserve_exact(count);
    }

    // Records of plain floats are read as blocks: the usual case by far.
    if element
        .properties
        .iter()
        .all(|p| matches!(p.kind, Kind::Scalar(Scalar::F32)))
    {
        let offset = |wanted: usize| slots.iter().position(|s| *s == Some(wanted)).unwrap_or(0) * 4;
        let offsets: [usize; SLOTS.len()] = std::array::from_fn(offset);
        let size = element.properties.len() * 4;
        if let Some(block) = numbers.block(size * count) {
            for record in block.chunks_exact(size) {
                let at = |i: usize| N::float(record, offsets[i]);
                mesh.positions.push([at(0), at(1), at(2)]);
                if has_normals {
                    mesh.normals.push([at(3), at(4), at(5)]);
                }
                if has_uvs {
                    mesh.uvs.push([at(6), at(7)]);
                }
                if has_colors {
                    mesh.colors.push([at(8), at(9), at(10)]);
                }
            }
            return Ok(());
        }
    }
    for _ in 0..count {
        let mut values = [0.0f32; SLOTS.len()];
        for (property, slot) in element.properties.iter().zip(&slots) {
            match (&property.kind, slot) {
                // Colours are floats from 0 to 1 or fractions of the largest integer of their type.
                (Kind::Scalar(kind), Some(slot @ 8..)) => {
                    values[*slot] = (numbers.next(*kind)? / largest(*kind)) as f32;
                }
                (Kind::Scalar(kind), Some(slot)) => values[*slot] = numbers.next(*kind)? as f32,
                (kind, None) => skip(kind, numbers)?,
                (Kind::List { .. }, Some(_)) => {
                    return Err(
                        numbers.fail(format!("vertex property {:?} is a list", property.name))
                    );
                }
            }
        }
        let [x, y, z, nx, ny, nz, u, v, r, g, b] = values;
        mesh.positions.push([x, y, z]);
        if has_normals {
            mesh.normals.push([nx, ny, nz]);
        }
        if has_uvs {
            mesh.uvs.push([u, v]);
        }
        if has_colors {
            mesh.colors.push([r, g, b]);
        }
    }
    Ok(())
}

/// The largest number of an integer type, and 1 of floats.
fn largest(kind: Scalar) -> f64 {
    match kind {
        Scalar::I8 => f64::from(i8::MAX),
        Scalar::U8 => f64::from(u8::MAX),
        Scalar::I16 => f64::from(i16::MAX),
        Scalar::U16 => f64::from(u16::MAX),
        Scalar::I32 => f64::from(i32::MAX),
        Scalar::U32 => f64::from(u32::MAX),
        Scalar::F32 | Scalar::F64 => 1.0,
    }
}

fn faces<N: Numbers>(
    element: &Element,
    numbers: &mut N,
    mesh: &mut PlyMesh,
) -> Result<(), PlyError> {
    let corners = |name: &str| name == "vertex_indices" || name == "vertex_index";
    if !element
        .properties
        .iter()
        .any(|p| corners(&p.name) && matches!(p.kind, Kind::List { .. }))
    {
        return Err(numbers.fail("faces without a list vertex_indices".into()));
    }
    let count =
        usize::try_from(element.count).map_err(|_| numbers.fail("too many faces".into()))?;
    // A face takes four bytes or more, whatever the header says.
    mesh.indices
        .reserve(count.min((numbers.left() / 4) as usize));
    let mut polygon: Vec<u32> = Vec::new();
    let plain = match element.properties.as_slice() {
        [only] => matches!(
            only.kind,
            Kind::List {
                item: Scalar::I32 | Scalar::U32,
                ..
            }
        ),
        _ => false,
    };
    let before = mesh.indices.len();
    // The usual case by far.
    if plain
        && matches!(
            element.properties[0].kind,
            Kind::List {
                count: Scalar::U8,
                ..
            }
        )
    {
        let room = MAX_TRIANGLES.saturating_sub(before);
        numbers.triangles(count.min(room), &mut mesh.indices);
    }
    for _ in mesh.indices.len() - before..count {
        for property in &element.properties {
            let Kind::List { count, item } = property.kind else {
                skip(&property.kind, numbers)?;
                continue;
            };
            if !corners(&property.name) {
                skip(&property.kind, numbers)?;
                continue;
            }
            let length = list_length(numbers, count)?;
            if plain && let Some(block) = numbers.block(length as usize * 4) {
                polygon.clear();
                polygon.extend((0..length as usize).map(|i| N::integer(block, i * 4)));
            } else {
                polygon.clear();
                for _ in 0..length {
                    let index = numbers.next(item)?;
                    if !(0.0..=f64::from(u32::MAX)).contains(&index) {
                        return Err(numbers.fail(format!("a face uses vertex {index}")));
                    }
                    polygon.push(index as u32);
                }
            }
            if polygon.len() < 3 {
                return Err(numbers.fail(format!("a face with {} corners", polygon.len())));
            }
            if mesh.indices.len() > MAX_TRIANGLES {
                return Err(numbers.fail(format!(
                    "more triangles than the limit of an import, {MAX_IMPORT_BYTES} bytes, holds"
                )));
            }
            for pair in polygon[1..].windows(2) {
                mesh.indices.push([polygon[0], pair[0], pair[1]]);
            }
        }
    }
    Ok(())
}
