//! What the header of a picture says: size and channels. Pixels are the tracer's business.

use crate::assets::{AssetError, AssetSource};
use crate::limits::{MAX_PIXELS, MAX_SIDE};
use image::ImageDecoder;
use std::io::{BufRead, Cursor, Seek};

/// Facts from a picture's header.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct PictureInfo {
    /// Pixels.
    pub width: u32,
    /// Pixels.
    pub height: u32,
    /// Grey 1, grey and alpha 2, RGB 3, RGBA 4.
    pub channels: u8,
}

/// What KTX2 files begin with.
pub const KTX2: [u8; 12] = *b"\xabKTX 20\xbb\r\n\x1a\n";

/// Enough for the headers of nearly all files; the whole file is the second try.
const PREFIX_BYTES: usize = 1 << 16;

/// Probes a picture of the scene. The outer error is about the file, the inner one about its content.
pub fn probe(
    assets: &dyn AssetSource,
    path: &str,
) -> Result<Result<PictureInfo, String>, AssetError> {
    let prefix = assets.read_prefix(path, PREFIX_BYTES)?;
    let first = header(path, &prefix);
    if first.is_ok() || prefix.len() < PREFIX_BYTES {
        return Ok(first.and_then(within_limits));
    }
    Ok(header(path, &assets.read(path)?).and_then(within_limits))
}

/// The ending that a picture of this content usually has.
pub(crate) fn ending(bytes: &[u8]) -> &'static str {
    use image::ImageFormat as Format;
    match image::guess_format(bytes) {
        _ if bytes.starts_with(b"PF") || bytes.starts_with(b"Pf") => "pfm",
        _ if bytes.starts_with(&KTX2) => "ktx2",
        Ok(Format::Png) => "png",
        Ok(Format::Jpeg) => "jpg",
        Ok(Format::WebP) => "webp",
        Ok(Format::Bmp) => "bmp",
        Ok(Format::Hdr) => "hdr",
        Ok(Format::OpenExr) => "exr",
        _ => "tga",
    }
}

/// Probes a picture that is in memory already; `label` stands for its file name.
pub fn probe_bytes(label: &str, bytes: &[u8]) -> Result<PictureInfo, String> {
    header(label, bytes).and_then(within_limits)
}

fn within_limits(info: PictureInfo) -> Result<PictureInfo, String> {
    let PictureInfo { width, height, .. } = info;
    if width == 0 || height == 0 {
        return Err(format!("a picture of {width} x {height} pixels"));
    }
    if width > MAX_SIDE || height > MAX_SIDE {
        return Err(format!(
            "a picture of {width} x {height} pixels; the limit is {MAX_SIDE} a side"
        ));
    }
    if u64::from(width) * u64::from(height) > MAX_PIXELS {
        return Err(format!(
            "a picture of {width} x {height} pixels; the limit is {MAX_PIXELS} in all"
        ));
    }
    Ok(info)
}

fn header(path: &str, bytes: &[u8]) -> Result<PictureInfo, String> {
    let ending = path
        .rsplit_once('.')
        .map(|(_, e)| e.to_ascii_lowercase())
        .unwrap_or_default();
    // The content decides; only TGA has nothing to recognise it by.
    if bytes.starts_with(b"PF") || bytes.starts_with(b"Pf") {
        return pfm(bytes);
    }
    if bytes.starts_with(&KTX2) {
        return ktx2(bytes);
    }
    let cursor = || Cursor::new(bytes);
    let fail = |e: image::ImageError| format!("not a readable picture: {e}");
    use image::ImageFormat as Format;
    match image::guess_format(bytes) {
        Ok(Format::Png) => describe(image::codecs::png::PngDecoder::new(cursor()).map_err(fail)?),
        Ok(Format::Jpeg) => {
            describe(image::codecs::jpeg::JpegDecoder::new(cursor()).map_err(fail)?)
        }
        Ok(Format::WebP) => {
            describe(image::codecs::webp::WebPDecoder::new(cursor()).map_err(fail)?)
        }
        Ok(Format::Bmp) => describe(image::codecs::bmp::BmpDecoder::new(cursor()).map_err(fail)?),
        Ok(Format::Hdr) => describe(image::codecs::hdr::HdrDecoder::new(cursor()).map_err(fail)?),
        Ok(Format::OpenExr) => exr(cursor()),
        _ if ending == "tga" => {
            describe(image::codecs::tga::TgaDecoder::new(cursor()).map_err(fail)?)
        }
        Ok(other) => Err(format!(
            "a picture of a kind that is not supported ({other:?})"
        )),
        Err(_) => Err(
            "not a picture of a known kind (png, jpg, tga, webp, bmp, ktx2, hdr, exr, pfm)".into(),
        ),
    }
}

fn describe(decoder: impl ImageDecoder) -> Result<PictureInfo, String> {
    let (width, height) = decoder.dimensions();
    Ok(PictureInfo {
        width,
        height,
        channels: decoder.color_type().channel_count(),
    })
}

fn exr(cursor: impl BufRead + Seek) -> Result<PictureInfo, String> {
    let meta = exr::meta::MetaData::read_from_buffered(cursor, false)
        .map_err(|e| format!("not a readable EXR: {e}"))?;
    let header = meta.headers.first().ok_or("an EXR without a part")?;
    let side = |n: usize| u32::try_from(n).map_err(|_| "an EXR of absurd size".to_owned());
    let has = |name: &str| {
        header
            .channels
            .list
            .iter()
            .any(|c| c.name.eq_case_insensitive(name))
    };
    let channels = match (has("R") && has("G") && has("B"), has("A")) {
        (true, true) => 4,
        (true, false) => 3,
        (false, true) => 2,
        (false, false) => 1,
    };
    Ok(PictureInfo {
        width: side(header.layer_size.0)?,
        height: side(header.layer_size.1)?,
        channels,
    })
}

/// `PF` or `Pf`, width, height, scale, each followed by one white space.
fn pfm(bytes: &[u8]) -> Result<PictureInfo, String> {
    let head = &bytes[..bytes.len().min(256)];
    let mut words = head
        .split(|b| b.is_ascii_whitespace())
        .map(|w| std::str::from_utf8(w).unwrap_or(""));
    let channels = if words.next() == Some("PF") { 3 } else { 1 };
    let mut side = || {
        words
            .next()
            .and_then(|w| w.parse::<u32>().ok())
            .ok_or("a PFM without a size")
    };
    let (width, height) = (side()?, side()?);
    Ok(PictureInfo {
        width,
        height,
        channels,
    })
}

/// A flat picture in a Basis Universal format, which decodes to RGBA [KTX 2.0, section 3].
fn ktx2(bytes: &[u8]) -> Result<PictureInfo, String> {
    let (words, _) = bytes[KTX2.len()..].as_chunks::<4>();
    let Some(&[format, _, width, height, depth, layers, faces]) = words
        .first_chunk::<7>()
        .map(|words| words.map(u32::from_le_bytes))
        .as_ref()
    else {
        return Err("a KTX2 without a whole header".into());
    };
    if format != 0 {
        return Err(format!(
            "a KTX2 of Vulkan's format {format}; those of Basis Universal (ETC1S, UASTC) are read, `gltf-transform ktxdecompress` converts others"
        ));
    }
    if depth > 1 || layers > 1 || faces != 1 {
        return Err(format!(
            "a KTX2 with {depth} slices, {layers} layers and {faces} faces; flat pictures are read"
        ));
    }
    Ok(PictureInfo {
        width,
        height,
        channels: 4,
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::assets::MemorySource;

    #[test]
    fn headers_are_read_and_checked() {
        let mut png = Vec::new();
        image::RgbaImage::new(3, 2)
            .write_to(&mut Cursor::new(&mut png), image::ImageFormat::Png)
            .unwrap();
        let mut exr = Vec::new();
        image::Rgb32FImage::new(5, 4)
            .write_to(&mut Cursor::new(&mut exr), image::ImageFormat::OpenExr)
            .unwrap();
        let mut huge = png.clone();
        huge[16..24].copy_from_slice(&[0, 1, 0, 1, 0, 0, 0, 2]);
        let check = |name: &str, bytes: &[u8], expect: Result<(u32, u32, u8), &str>| {
            let assets = MemorySource::new().with(name, bytes).unwrap();
            match (probe(&assets, name).unwrap(), expect) {
                (Ok(info), Ok(want)) => assert_eq!((info.width, info.height, info.channels), want),
                (Err(got), Err(want)) => assert!(got.contains(want), "{name}: {got}"),
                (got, _) => panic!("{name}: {got:?}, expected {expect:?}"),
            }
        };
        check("a.png", &png, Ok((3, 2, 4)));
        check("lies.tga", &png, Ok((3, 2, 4)));
        check("a.exr", &exr, Ok((5, 4, 3)));
        check("a.pfm", b"PF\n7 6\n-1.0\n", Ok((7, 6, 3)));
        check("a.pfm", b"PF\nx", Err("without a size"));
        check("a.pfm", b"PF 70000 2 -1 ", Err("65536 a side"));
        check("a.pfm", b"PF 60000 60000 -1 ", Err("in all"));
        check("a.pfm", b"PF 0 2 -1 ", Err("0 x 2"));
        check("huge.png", &huge, Err("not a readable"));
        let mut ktx = KTX2.to_vec();
        for word in [0, 1, 12, 8, 0, 0, 1] {
            ktx.extend(u32::to_le_bytes(word));
        }
        check("a.ktx2", &ktx, Ok((12, 8, 4)));
        check("a.png", &ktx, Ok((12, 8, 4)));
        check("a.ktx2", &ktx[..30], Err("whole header"));
        ktx[36] = 6;
        check("a.ktx2", &ktx, Err("6 faces"));
        ktx[12] = 37;
        check("a.ktx2", &ktx, Err("format 37"));
        check("a.png", &png[..20], Err("not a readable"));
        check("a.txt", b"hello", Err("not a picture"));
        check("a.tga", b"", Err("not a readable"));
    }
}
