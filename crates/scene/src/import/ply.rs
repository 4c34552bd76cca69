//! PLY meshes: ASCII and both byte orders, also gzipped. Positions, normals, one set of texture
//! coordinates and colours are taken, other elements and properties are skipped. Polygons are cut into fans.
//!
//! Nothing is allocated that the header merely claims: every count is held against the bytes that
//! are there.

mod body;
mod header;

use header::{Encoding, Header};
use std::io::Read;

/// The largest gzipped mesh, unpacked.
const MAX_UNPACKED_BYTES: u64 = 1 << 30;

/// A mesh as the file has it.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct PlyMesh {
    /// Vertex positions.
    pub positions: Vec<[f32; 3]>,
    /// Normals, or empty.
    pub normals: Vec<[f32; 3]>,
    /// Texture coordinates, or empty.
    pub uvs: Vec<[f32; 2]>,
    /// Colours of the vertices, sRGB from 0 to 1, or empty.
    pub colors: Vec<[f32; 3]>,
    /// Triangles.
    pub indices: Vec<[u32; 3]>,
}

/// Why a file was refused.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("{reason}")]
pub struct PlyError {
    /// Line, in the header and in ASCII files.
    pub line: Option<u32>,
    /// The reason; names the byte offset in binary files.
    pub reason: String,
}

impl PlyError {
    fn at_line(line: u32, reason: impl Into<String>) -> Self {
        PlyError {
            line: Some(line),
            reason: reason.into(),
        }
    }
    fn new(reason: impl Into<String>) -> Self {
        PlyError {
            line: None,
            reason: reason.into(),
        }
    }
}

/// Reads a mesh. The second part names what was done differently from what the file says.
pub fn read(bytes: &[u8]) -> Result<(PlyMesh, Vec<String>), PlyError> {
    if bytes.starts_with(&[0x1f, 0x8b]) {
        let mut unpacked = Vec::new();
        flate2::read::MultiGzDecoder::new(bytes)
            .take(MAX_UNPACKED_BYTES + 1)
            .read_to_end(&mut unpacked)
            .map_err(|e| PlyError::new(format!("damaged gzip data: {e}")))?;
        if unpacked.len() as u64 > MAX_UNPACKED_BYTES {
            return Err(PlyError::new(format!(
                "unpacks to more than the limit of {MAX_UNPACKED_BYTES} bytes"
            )));
        }
        return read_plain(&unpacked);
    }
    read_plain(bytes)
}

fn read_plain(bytes: &[u8]) -> Result<(PlyMesh, Vec<String>), PlyError> {
    let (header, start) = Header::read(bytes)?;
    let data = &bytes[start..];
    let mut mesh = match header.encoding {
        Encoding::Ascii => body::read(&header, body::Ascii::new(data, header.lines + 1))?,
        Encoding::Little => body::read(&header, body::Binary::<false>::new(data, start))?,
        Encoding::Big => body::read(&header, body::Binary::<true>::new(data, start))?,
    };
    let mut notes = Vec::new();
    let vertices = mesh.positions.len();
    if let Some(bad) = mesh
        .indices
        .iter()
        .flatten()
        .find(|&&i| i as usize >= vertices)
    {
        return Err(PlyError::new(format!(
            "a face uses vertex {bad}, but there are only {vertices}"
        )));
    }
    if mesh.indices.is_empty() {
        return Err(PlyError::new("a mesh without faces"));
    }
    if !finite(&mesh.positions) {
        return Err(PlyError::new(
            "a vertex position that is not a finite number",
        ));
    }
    if !finite(&mesh.normals) {
        notes.push(
            "a normal that is not a finite number: all normals of the mesh are left out".to_owned(),
        );
        mesh.normals = Vec::new();
    }
    if !finite(&mesh.uvs) {
        notes.push(
            "a texture coordinate that is not a finite number: all of them are left out".to_owned(),
        );
        mesh.uvs = Vec::new();
    }
    if !finite(&mesh.colors) {
        notes.push("a colour that is not a finite number: all of them are left out".to_owned());
        mesh.colors = Vec::new();
    }
    Ok((mesh, notes))
}

fn finite<const N: usize>(rows: &[[f32; N]]) -> bool {
    rows.iter().flatten().all(|x| x.is_finite())
}

/// A binary PLY file of a mesh, little-endian, as [`read`] takes it back bit for bit; without colours.
pub fn write(mesh: &PlyMesh) -> Vec<u8> {
    let mut out = String::from("ply\nformat binary_little_endian 1.0\n");
    out += &format!("element vertex {}\n", mesh.positions.len());
    let mut names = vec!["x", "y", "z"];
    if !mesh.normals.is_empty() {
        names.extend(["nx", "ny", "nz"]);
    }
    if !mesh.uvs.is_empty() {
        names.extend(["u", "v"]);
    }
    for name in names {
        out += &format!("property float {name}\n");
    }
    out += &format!(
        "element face {}\nproperty list uchar int vertex_indices\nend_header\n",
        mesh.indices.len()
    );
    let mut out = out.into_bytes();
    for (i, position) in mesh.positions.iter().enumerate() {
        let normal = mesh.normals.get(i).into_iter().flatten();
        let uv = mesh.uvs.get(i).into_iter().flatten();
        for x in position.iter().chain(normal).chain(uv) {
            out.extend_from_slice(&x.to_le_bytes());
        }
    }
    for triangle in &mesh.indices {
        out.push(3);
        for i in triangle {
            out.extend_from_slice(&i.to_le_bytes());
        }
    }
    out
}

#[cfg(test)]
mod tests;
