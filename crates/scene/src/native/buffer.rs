//! Meshes that PLY cannot hold (tangents, colours, several sets of texture coordinates, keys), as a
//! binary file: a magic word, then each array as a count and its numbers, little-endian.

use crate::model::{Deformation, DeformationKey, Mesh};
use std::sync::Arc;

const MAGIC: &[u8; 8] = b"brmesh01";

/// The most sets of texture coordinates, and of keys.
const MAX_SETS: u64 = 4096;

pub(super) fn put<const N: usize>(out: &mut Vec<u8>, rows: &[[f32; N]]) {
    out.extend_from_slice(&(rows.len() as u64).to_le_bytes());
    for x in rows.as_flattened() {
        out.extend_from_slice(&x.to_le_bytes());
    }
}

pub(super) fn write(mesh: &Mesh) -> Vec<u8> {
    let mut out = MAGIC.to_vec();
    put(&mut out, &mesh.positions);
    put(&mut out, &mesh.normals);
    put(&mut out, &mesh.tangents);
    put(&mut out, &mesh.colors);
    out.extend_from_slice(&(mesh.uvs.len() as u64).to_le_bytes());
    for uvs in &mesh.uvs {
        put(&mut out, uvs);
    }
    out.extend_from_slice(&(mesh.indices.len() as u64).to_le_bytes());
    for i in mesh.indices.as_flattened() {
        out.extend_from_slice(&i.to_le_bytes());
    }
    // One more than the further keys, so that none at all differs from no deformation.
    let keys = mesh
        .deformation
        .as_ref()
        .map_or(0, |d| d.keys.len() as u64 + 1);
    out.extend_from_slice(&keys.to_le_bytes());
    if let Some(deformation) = &mesh.deformation {
        out.extend_from_slice(&deformation.first_time.to_le_bytes());
        for key in &deformation.keys {
            out.extend_from_slice(&key.time.to_le_bytes());
            put(&mut out, &key.positions);
            put(&mut out, &key.normals);
        }
    }
    out
}

pub(super) struct Reader<'a> {
    pub(super) rest: &'a [u8],
    pub(super) size: usize,
}

impl Reader<'_> {
    pub(super) fn fail<T>(&self, reason: &str) -> Result<T, String> {
        Err(format!("{reason}, at byte {}", self.size - self.rest.len()))
    }
    pub(super) fn bytes<const N: usize>(&mut self) -> Result<[u8; N], String> {
        match self.rest.split_first_chunk::<N>() {
            Some((bytes, rest)) => {
                self.rest = rest;
                Ok(*bytes)
            }
            None => self.fail("the file ends too early"),
        }
    }
    pub(super) fn count(&mut self) -> Result<u64, String> {
        self.bytes().map(u64::from_le_bytes)
    }
    pub(super) fn rows<const N: usize, T>(
        &mut self,
        from: impl Fn([u8; 4]) -> T + Copy,
    ) -> Result<Vec<[T; N]>, String> {
        let count = self.count()?;
        let bytes = count.saturating_mul(4 * N as u64);
        if bytes > self.rest.len() as u64 {
            return self.fail(&format!(
                "{count} rows are promised, more than the bytes that are left can hold"
            ));
        }
        let (now, rest) = self.rest.split_at(bytes as usize);
        self.rest = rest;
        let (words, _) = now.as_chunks::<4>();
        Ok(words
            .chunks_exact(N)
            .map(|row| std::array::from_fn(|i| from(row[i])))
            .collect())
    }
    pub(super) fn floats<const N: usize>(&mut self) -> Result<Vec<[f32; N]>, String> {
        self.rows(f32::from_le_bytes)
    }
}

pub(super) fn read(bytes: &[u8]) -> Result<Mesh, String> {
    let Some(rest) = bytes.strip_prefix(MAGIC) else {
        return Err("not a mesh buffer of this version".into());
    };
    let mut reader = Reader {
        rest,
        size: bytes.len(),
    };
    let positions = Arc::new(reader.floats::<3>()?);
    let normals = Arc::new(reader.floats::<3>()?);
    let tangents = Arc::new(reader.floats::<4>()?);
    let colors = Arc::new(reader.floats::<4>()?);
    let sets = reader.count()?;
    if sets > MAX_SETS {
        return reader.fail(&format!(
            "{sets} sets of texture coordinates; the limit is {MAX_SETS}"
        ));
    }
    let uvs = (0..sets)
        .map(|_| reader.floats::<2>().map(Arc::new))
        .collect::<Result<_, _>>()?;
    let indices = Arc::new(reader.rows::<3, u32>(u32::from_le_bytes)?);
    let keys = reader.count()?;
    if keys > MAX_SETS {
        return reader.fail(&format!("{keys} keys; the limit is {MAX_SETS}"));
    }
    let deformation = if keys == 0 {
        None
    } else {
        let first_time = f64::from_le_bytes(reader.bytes()?);
        let mut further = Vec::new();
        for _ in 1..keys {
            let time = f64::from_le_bytes(reader.bytes()?);
            further.push(DeformationKey {
                time,
                positions: reader.floats()?,
                normals: reader.floats()?,
            });
        }
        Some(Arc::new(Deformation {
            first_time,
            keys: further,
        }))
    };
    if !reader.rest.is_empty() {
        return reader.fail("bytes are left over");
    }
    Ok(Mesh {
        name: String::new(),
        positions,
        normals,
        tangents,
        uvs,
        colors,
        indices,
        deformation,
    })
}
