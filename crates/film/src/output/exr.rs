//! 32-bit float EXR with all layers in one part: R, G, B, A first, the others as `layer.channel`.
//! One part, because viewers that know layers group channels by their prefix, and those that do
//! not still find R, G, B, A.

use super::{OutputError, PictureInfo};
use crate::film::Film;
use crate::layer::{Layer, channel};
use ::exr::meta::attribute::Chromaticities;
use ::exr::prelude::*;

/// The channels of the file.
const CHANNELS: [(&str, Layer, usize); 15] = [
    ("R", Layer::Beauty, 0),
    ("G", Layer::Beauty, 1),
    ("B", Layer::Beauty, 2),
    ("A", Layer::Alpha, 0),
    ("albedo.R", Layer::Albedo, 0),
    ("albedo.G", Layer::Albedo, 1),
    ("albedo.B", Layer::Albedo, 2),
    ("normal.X", Layer::Normal, 0),
    ("normal.Y", Layer::Normal, 1),
    ("normal.Z", Layer::Normal, 2),
    ("depth.Z", Layer::Depth, 0),
    ("variance.R", Layer::Variance, 0),
    ("variance.G", Layer::Variance, 1),
    ("variance.B", Layer::Variance, 2),
    ("samples.N", Layer::Samples, 0),
];

/// Primaries and white of Rec. 709.
const REC709: Chromaticities = Chromaticities {
    red: Vec2(0.64, 0.33),
    green: Vec2(0.30, 0.60),
    blue: Vec2(0.15, 0.06),
    white: Vec2(0.3127, 0.3290),
};

/// An EXR of a film. The same film and info are the same bytes: blocks are written from the top
/// whoever compressed them, and nothing tells the time.
pub fn write_exr(film: &Film, info: &PictureInfo) -> std::result::Result<Vec<u8>, OutputError> {
    let size = Vec2(film.grid().width as usize, film.grid().height as usize);
    let list = CHANNELS
        .iter()
        .map(|&(name, layer, c)| AnyChannel::new(name, FlatSamples::F32(channel(film, layer, c))));
    let encoding = Encoding {
        compression: Compression::ZIP16,
        blocks: Blocks::ScanLines,
        line_order: LineOrder::Increasing,
    };
    let attributes = LayerAttributes::default();
    let layer = ::exr::image::Layer::new(
        size,
        attributes,
        encoding,
        AnyChannels::sort(list.collect()),
    );
    let mut image = Image::from_layer(layer);
    image.attributes.chromaticities = Some(REC709);
    let mut bytes = std::io::Cursor::new(Vec::new());
    image
        .write()
        .to_buffered(&mut bytes)
        .map_err(OutputError::Exr)?;
    insert_texts(&bytes.into_inner(), &info.fields()).ok_or(OutputError::ExrHead)
}

/// Adds text attributes at the end of the head of a file of one part. The crate keeps such
/// attributes in a hash map and writes them in another order in every run.
fn insert_texts(file: &[u8], texts: &[(&str, String)]) -> Option<Vec<u8>> {
    let end = head_end(file)?;
    let mut out = file[..end].to_vec();
    for (name, text) in texts {
        out.extend_from_slice(name.as_bytes());
        out.extend_from_slice(b"\0string\0");
        out.extend_from_slice(&(text.len() as u32).to_le_bytes());
        out.extend_from_slice(text.as_bytes());
    }
    let added = (out.len() - end) as u64;
    out.push(0);
    // After the head: where each block is, up to where the first one is.
    let mut rest = &file[end + 1..];
    let mut first = u64::MAX;
    while ((file.len() - rest.len()) as u64) < first {
        let (offset, after) = rest.split_first_chunk()?;
        let offset = u64::from_le_bytes(*offset);
        first = first.min(offset);
        out.extend_from_slice(&(offset + added).to_le_bytes());
        rest = after;
    }
    out.extend_from_slice(rest);
    Some(out)
}

/// Where the zero byte stands that ends the attributes: magic and version, then attributes as name,
/// type, length, value.
fn head_end(file: &[u8]) -> Option<usize> {
    let mut at = 8;
    while *file.get(at)? != 0 {
        for _ in ["name", "type"] {
            at += file.get(at..)?.iter().position(|&byte| byte == 0)? + 1;
        }
        let length = u32::from_le_bytes(*file.get(at..)?.first_chunk()?);
        at += 4 + length as usize;
    }
    Some(at)
}
