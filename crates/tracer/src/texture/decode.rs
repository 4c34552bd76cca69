//! From the bytes of a file to pixels: png, jpg, tga, webp, bmp, hdr, exr by the crate `image`, ktx2 (Basis
//! Universal) by `basisu`, pfm here.

use image::{DynamicImage, ImageFormat, ImageReader, Limits};

/// Longest side of a picture in pixels.
const SIDE_MAX: u32 = 65_536;
/// Most bytes that decoding one picture may take.
const DECODE_BYTES_MAX: u64 = 2 << 30;
/// Kinds that are read.
const FORMATS: [ImageFormat; 7] = [
    ImageFormat::Png,
    ImageFormat::Jpeg,
    ImageFormat::Tga,
    ImageFormat::WebP,
    ImageFormat::Bmp,
    ImageFormat::Hdr,
    ImageFormat::OpenExr,
];

/// Pixels as the file has them, top row first.
pub(super) struct Raw {
    /// Pixels.
    pub width: u32,
    /// Pixels.
    pub height: u32,
    /// Grey 1, grey and alpha 2, RGB 3, RGBA 4.
    pub channels: u8,
    /// Row by row, channels side by side.
    pub pixels: Pixels,
}

/// Numbers of a picture.
pub(super) enum Pixels {
    Bytes(Box<[u8]>),
    Words(Box<[u16]>),
    /// All finite.
    Floats(Box<[f32]>),
}

impl Raw {
    pub fn memory_bytes(&self) -> usize {
        match &self.pixels {
            Pixels::Bytes(data) => data.len(),
            Pixels::Words(data) => data.len() * 2,
            Pixels::Floats(data) => data.len() * 4,
        }
    }
}

/// The ending of a file's name, in small letters.
pub(super) fn ending(path: &str) -> String {
    let name = path.rsplit('/').next().unwrap_or_default();
    name.rsplit_once('.')
        .map(|(_, e)| e.to_ascii_lowercase())
        .unwrap_or_default()
}

/// Decodes a picture. The content decides of what kind it is; only TGA has no mark to go by.
pub(super) fn decode(path: &str, bytes: &[u8]) -> Result<Raw, String> {
    if bytes.starts_with(b"PF") || bytes.starts_with(b"Pf") {
        return decode_pfm(bytes);
    }
    if bytes.starts_with(&scene::picture::KTX2) {
        return decode_ktx2(bytes);
    }
    let format = match image::guess_format(bytes) {
        Ok(format) if FORMATS.contains(&format) => format,
        _ if ending(path) == "tga" => ImageFormat::Tga,
        Ok(other) => {
            return Err(format!(
                "a picture of a kind that is not supported ({other:?})"
            ));
        }
        Err(_) => {
            return Err(
                "not a picture of a known kind (png, jpg, tga, webp, bmp, ktx2, hdr, exr, pfm)"
                    .into(),
            );
        }
    };
    let mut reader = ImageReader::with_format(std::io::Cursor::new(bytes), format);
    let mut limits = Limits::default();
    limits.max_image_width = Some(SIDE_MAX);
    limits.max_image_height = Some(SIDE_MAX);
    limits.max_alloc = Some(DECODE_BYTES_MAX);
    reader.limits(limits);
    let picture = reader.decode().map_err(|e| e.to_string())?;
    let (width, height) = (picture.width(), picture.height());
    if width == 0 || height == 0 {
        return Err("the picture has no pixels".into());
    }
    let (channels, pixels) = match picture {
        DynamicImage::ImageLuma8(p) => (1, Pixels::Bytes(p.into_raw().into())),
        DynamicImage::ImageLumaA8(p) => (2, Pixels::Bytes(p.into_raw().into())),
        DynamicImage::ImageRgb8(p) => (3, Pixels::Bytes(p.into_raw().into())),
        DynamicImage::ImageRgba8(p) => (4, Pixels::Bytes(p.into_raw().into())),
        DynamicImage::ImageLuma16(p) => (1, Pixels::Words(p.into_raw().into())),
        DynamicImage::ImageLumaA16(p) => (2, Pixels::Words(p.into_raw().into())),
        DynamicImage::ImageRgb16(p) => (3, Pixels::Words(p.into_raw().into())),
        DynamicImage::ImageRgba16(p) => (4, Pixels::Words(p.into_raw().into())),
        DynamicImage::ImageRgb32F(p) => (3, Pixels::Floats(p.into_raw().into())),
        DynamicImage::ImageRgba32F(p) => (4, Pixels::Floats(p.into_raw().into())),
        other => (4, Pixels::Floats(other.into_rgba32f().into_raw().into())),
    };
    if let Pixels::Floats(data) = &pixels
        && let Some(i) = data.iter().position(|x| !x.is_finite())
    {
        let i = i / usize::from(channels);
        let (x, y) = (i as u32 % width, i as u32 / width);
        return Err(format!("the pixel at column {x}, row {y} is not finite"));
    }
    Ok(Raw {
        width,
        height,
        channels,
        pixels,
    })
}

/// The largest picture of a Basis Universal file, as RGBA.
fn decode_ktx2(bytes: &[u8]) -> Result<Raw, String> {
    use basisu::{DecodeFlags, TargetFormat, Transcoder};
    // What is promised is bounded before anything is unpacked.
    let info = scene::picture::probe_bytes("picture.ktx2", bytes)?;
    let unpack = || {
        let picture = Transcoder::new(bytes)?;
        picture.transcode(0, TargetFormat::Rgba32, DecodeFlags::NONE)
    };
    // The decoder is young; whatever it trips over is a broken picture and no more.
    let pixels = std::panic::catch_unwind(unpack)
        .map_err(|_| "not a readable KTX2: its data contradict each other".to_string())?
        .map_err(|e| format!("not a readable KTX2: {e:?}"))?;
    let promised = u64::from(info.width) * u64::from(info.height) * 4;
    if pixels.len() as u64 != promised {
        return Err(format!(
            "{} bytes of pixels where the header promises {promised}",
            pixels.len()
        ));
    }
    Ok(Raw {
        width: info.width,
        height: info.height,
        channels: 4,
        pixels: Pixels::Bytes(pixels.into()),
    })
}

/// A word of a header: what stands between blanks. Returns where the next begins.
fn word(bytes: &[u8], at: usize) -> Result<(&str, usize), String> {
    let rest = bytes.get(at..).unwrap_or_default();
    let blank = rest.iter().take_while(|b| b.is_ascii_whitespace()).count();
    let rest = &rest[blank..];
    let length = rest
        .iter()
        .take(32)
        .take_while(|b| !b.is_ascii_whitespace())
        .count();
    let text =
        std::str::from_utf8(&rest[..length]).map_err(|_| "the header is not text".to_string())?;
    Ok((text, at + blank + length + 1))
}

/// Portable float map: `PF` or `Pf`, size, scale (negative: little endian), rows from the bottom up.
fn decode_pfm(bytes: &[u8]) -> Result<Raw, String> {
    let (mark, at) = word(bytes, 0)?;
    let channels = match mark {
        "PF" => 3,
        "Pf" => 1,
        other => return Err(format!("'{other}' is not the mark of a PFM picture")),
    };
    let size = |text: &str| {
        text.parse::<u32>()
            .map_err(|_| format!("'{text}' is not a size"))
    };
    let (width, at) = word(bytes, at)?;
    let (height, at) = word(bytes, at)?;
    let (width, height) = (size(width)?, size(height)?);
    let (scale_text, at) = word(bytes, at)?;
    let scale: f32 = scale_text
        .parse()
        .map_err(|_| format!("'{scale_text}' is not a scale"))?;
    if width == 0 || height == 0 || width > SIDE_MAX || height > SIDE_MAX {
        return Err(format!(
            "{width} x {height} pixels; a side must have 1 to {SIDE_MAX}"
        ));
    }
    let row = width as usize * channels;
    let count = row * height as usize;
    let data = bytes.get(at..).unwrap_or(&[]);
    if data.len() / 4 < count {
        return Err(format!(
            "{} bytes of pixels where the header promises {}",
            data.len(),
            count as u64 * 4
        ));
    }
    let (numbers, _) = data[..count * 4].as_chunks::<4>();
    let value = |b: &[u8; 4]| {
        if scale < 0.0 {
            f32::from_le_bytes(*b)
        } else {
            f32::from_be_bytes(*b)
        }
    };
    let pixels: Box<[f32]> = numbers.chunks(row).rev().flatten().map(value).collect();
    if let Some(i) = pixels.iter().position(|v| !v.is_finite()) {
        let (x, y) = (i % row / channels, height as usize - 1 - i / row);
        return Err(format!(
            "the pixel at column {x}, row {y} from below is not finite"
        ));
    }
    Ok(Raw {
        width,
        height,
        channels: channels as u8,
        pixels: Pixels::Floats(pixels),
    })
}
