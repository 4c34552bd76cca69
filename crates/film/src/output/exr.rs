//! 32-bit float EXR with all layers in one part: R, G, B, A first, the others as `layer.channel`.
//! One part, because viewers that know layers group channels by their prefix, and those that do
//! not still find R, G, B, A.
//!
//! Written by hand, after the OpenEXR file layout, because the crate `exr` (which reads these files,
//! here and in tests) keeps text attributes in a hash map, so that their order differs in every
//! run, and deflates at a level that takes eight times as long for the same size on noisy floats.

use super::{OutputError, PictureInfo};
use crate::film::Film;
use crate::layer::{Layer, channel};
use rayon::prelude::*;
use std::io::Write;

/// The channels of the file, sorted by name as the format wants it.
const CHANNELS: [(&str, Layer, usize); 15] = [
    ("A", Layer::Alpha, 0),
    ("B", Layer::Beauty, 2),
    ("G", Layer::Beauty, 1),
    ("R", Layer::Beauty, 0),
    ("albedo.B", Layer::Albedo, 2),
    ("albedo.G", Layer::Albedo, 1),
    ("albedo.R", Layer::Albedo, 0),
    ("depth.Z", Layer::Depth, 0),
    ("normal.X", Layer::Normal, 0),
    ("normal.Y", Layer::Normal, 1),
    ("normal.Z", Layer::Normal, 2),
    ("samples.N", Layer::Samples, 0),
    ("variance.B", Layer::Variance, 2),
    ("variance.G", Layer::Variance, 1),
    ("variance.R", Layer::Variance, 0),
];

/// Primaries and white of Rec. 709: x and y of red, green, blue, white.
const REC709: [f32; 8] = [0.64, 0.33, 0.30, 0.60, 0.15, 0.06, 0.3127, 0.3290];
/// Rows of a block, fixed by the compression.
const BLOCK_ROWS: usize = 16;
const ZIP_BLOCKS: u8 = 3;
const FLOAT: u32 = 2;

/// All channels of a film as they are at one moment: what takes long, packing them, needs the film
/// no more.
pub struct Channels {
    width: u32,
    height: u32,
    planes: Vec<Vec<f32>>,
}

impl Channels {
    /// Of a film as it stands.
    pub fn of(film: &Film) -> Channels {
        Channels {
            width: film.grid().width,
            height: film.grid().height,
            planes: CHANNELS
                .par_iter()
                .map(|&(_, layer, c)| channel(film, layer, c))
                .collect(),
        }
    }
}

/// An EXR of a film.
pub fn write_exr(film: &Film, info: &PictureInfo) -> Result<Vec<u8>, OutputError> {
    encode_exr(&Channels::of(film), info)
}

/// Channels as EXR. The same channels and info are the same bytes: blocks follow each other from the
/// top whoever compressed them, and nothing tells the time.
pub fn encode_exr(channels: &Channels, info: &PictureInfo) -> Result<Vec<u8>, OutputError> {
    let (width, height) = (channels.width as usize, channels.height as usize);
    let planes = &channels.planes;
    let blocks: Vec<Vec<u8>> = (0..height.div_ceil(BLOCK_ROWS))
        .into_par_iter()
        .map(|block| {
            let rows = block * BLOCK_ROWS..height.min((block + 1) * BLOCK_ROWS);
            let mut raw = Vec::with_capacity(rows.len() * width * planes.len() * 4);
            for row in rows {
                for plane in planes {
                    let row = &plane[row * width..(row + 1) * width];
                    let start = raw.len();
                    raw.resize(start + row.len() * 4, 0);
                    for (bytes, value) in raw[start..].chunks_exact_mut(4).zip(row) {
                        bytes.copy_from_slice(&value.to_le_bytes());
                    }
                }
            }
            compress(raw)
        })
        .collect::<std::io::Result<_>>()
        .map_err(OutputError::Deflate)?;
    let mut out = head(channels, info);
    let mut offset = (out.len() + blocks.len() * 8) as u64;
    for block in &blocks {
        out.extend_from_slice(&offset.to_le_bytes());
        offset += 8 + block.len() as u64;
    }
    for (at, block) in blocks.iter().enumerate() {
        out.extend_from_slice(&((at * BLOCK_ROWS) as u32).to_le_bytes());
        out.extend_from_slice(&(block.len() as u32).to_le_bytes());
        out.extend_from_slice(block);
    }
    Ok(out)
}

/// Magic, version and attributes, each as name, type, length, value.
fn head(channels: &Channels, info: &PictureInfo) -> Vec<u8> {
    let mut out = vec![0x76, 0x2f, 0x31, 0x01, 2, 0, 0, 0];
    let mut put = |name: &str, kind: &str, value: &[u8]| {
        out.extend_from_slice(name.as_bytes());
        out.push(0);
        out.extend_from_slice(kind.as_bytes());
        out.push(0);
        out.extend_from_slice(&(value.len() as u32).to_le_bytes());
        out.extend_from_slice(value);
    };
    let mut list = Vec::new();
    for (name, _, _) in CHANNELS {
        list.extend_from_slice(name.as_bytes());
        list.push(0);
        // Sample type, a hint to lossy compression and three unused bytes, every column, every row.
        list.extend([FLOAT, 0, 1, 1].map(u32::to_le_bytes).concat());
    }
    list.push(0);
    let floats =
        |values: &[f32]| -> Vec<u8> { values.iter().flat_map(|v| v.to_le_bytes()).collect() };
    // The last column and row count as inside.
    let window = [0, 0, channels.width - 1, channels.height - 1]
        .map(u32::to_le_bytes)
        .concat();
    put("channels", "chlist", &list);
    put("chromaticities", "chromaticities", &floats(&REC709));
    put("compression", "compression", &[ZIP_BLOCKS]);
    put("dataWindow", "box2i", &window);
    put("displayWindow", "box2i", &window);
    put("lineOrder", "lineOrder", &[0]);
    put("pixelAspectRatio", "float", &floats(&[1.0]));
    put("screenWindowCenter", "v2f", &floats(&[0.0, 0.0]));
    put("screenWindowWidth", "float", &floats(&[1.0]));
    for (name, text) in info.fields() {
        put(name, "string", text.as_bytes());
    }
    out.push(0);
    out
}

/// Even bytes before odd ones, differences of neighbours, deflate; or as it was if that is smaller.
fn compress(raw: Vec<u8>) -> std::io::Result<Vec<u8>> {
    let mut apart = vec![0; raw.len()];
    let (even, odd) = apart.split_at_mut(raw.len().div_ceil(2));
    for ((even, odd), pair) in even.iter_mut().zip(odd).zip(raw.chunks_exact(2)) {
        [*even, *odd] = [pair[0], pair[1]];
    }
    // From one array to another: in place each byte would wait for the one before.
    let mut bytes = apart.clone();
    for (byte, pair) in bytes.iter_mut().skip(1).zip(apart.windows(2)) {
        *byte = pair[1].wrapping_sub(pair[0]).wrapping_add(128);
    }
    let room = Vec::with_capacity(raw.len());
    let mut encoder = flate2::write::ZlibEncoder::new(room, flate2::Compression::fast());
    encoder.write_all(&bytes)?;
    let packed = encoder.finish()?;
    Ok(if packed.len() < raw.len() {
        packed
    } else {
        raw
    })
}
