//! Pictures back from files, to compare them: EXR, PNG, Radiance HDR and PFM, told apart by how
//! they begin.

use super::color::srgb_to_linear;
use crate::unit::{PIXELS_MAX, SIDE_MAX};
use ::exr::prelude::{FlatSamples, ReadChannels, ReadLayers};
use image::ImageFormat;

/// A linear Rec. 709 picture.
#[derive(Clone, Debug, PartialEq)]
pub struct Picture {
    /// In pixels.
    pub width: usize,
    /// In pixels.
    pub height: usize,
    /// Row by row from the top left, as seen against black.
    pub rgb: Vec<[f32; 3]>,
}

/// Why a file is no picture.
#[derive(Debug, thiserror::Error)]
pub enum ReadError {
    /// Another kind of file.
    #[error("not an EXR, PNG, HDR or PFM file")]
    UnknownFormat,
    /// Larger than any picture of ours.
    #[error(
        "{width}x{height} is above the limits of {SIDE_MAX} pixels a side and {PIXELS_MAX} in all"
    )]
    TooLarge {
        /// In pixels.
        width: u64,
        /// In pixels.
        height: u64,
    },
    /// The EXR is broken.
    #[error("the EXR cannot be read")]
    Exr(#[source] ::exr::error::Error),
    /// No colours in the EXR.
    #[error("no R, G, B channels among {0}")]
    NoColor(String),
    /// The PNG or HDR is broken.
    #[error("the picture cannot be decoded")]
    Image(#[source] image::ImageError),
    /// The PFM is broken.
    #[error("malformed PFM: {0}")]
    Pfm(&'static str),
}

/// Reads a picture.
pub fn read_picture(bytes: &[u8]) -> Result<Picture, ReadError> {
    match bytes {
        [0x76, 0x2f, 0x31, 0x01, ..] => read_exr(bytes),
        [0x89, b'P', b'N', b'G', ..] => read_png(bytes),
        [b'#', b'?', ..] => read_hdr(bytes),
        [b'P', b'F' | b'f', b'\n' | b'\r' | b' ', ..] => read_pfm(bytes),
        _ => Err(ReadError::UnknownFormat),
    }
}

fn check_size(width: u64, height: u64) -> Result<(), ReadError> {
    let side = SIDE_MAX as u64;
    if width > side || height > side || width * height > PIXELS_MAX {
        return Err(ReadError::TooLarge { width, height });
    }
    Ok(())
}

/// R, G, B of the first part that has them; else the first layer with such a suffix (Blender writes
/// `ViewLayer.Combined.R`); else Y as grey.
fn read_exr(bytes: &[u8]) -> Result<Picture, ReadError> {
    let meta = ::exr::meta::MetaData::read_from_buffered(bytes, false).map_err(ReadError::Exr)?;
    for header in &meta.headers {
        check_size(header.layer_size.x() as u64, header.layer_size.y() as u64)?;
    }
    let image = ::exr::prelude::read()
        .no_deep_data()
        .largest_resolution_level()
        .all_channels()
        .all_layers()
        .all_attributes()
        .from_buffered(std::io::Cursor::new(bytes))
        .map_err(ReadError::Exr)?;
    let mut names = Vec::new();
    let mut prefixes = vec![String::new()];
    for channel in image
        .layer_data
        .iter()
        .flat_map(|part| &part.channel_data.list)
    {
        let name = channel.name.to_string();
        if let Some(prefix) = name
            .strip_suffix('R')
            .filter(|prefix| prefix.ends_with('.'))
        {
            prefixes.push(prefix.to_owned());
        }
        names.push(name);
    }
    let wanted = prefixes
        .iter()
        .map(|prefix| ["R", "G", "B"].map(|channel| format!("{prefix}{channel}")))
        .chain([["Y"; 3].map(String::from)]);
    for wanted in wanted {
        for part in &image.layer_data {
            let list = &part.channel_data.list;
            let find = |name: &String| list.iter().find(|c| c.name.to_string() == *name);
            if let [Some(r), Some(g), Some(b)] = wanted.each_ref().map(find) {
                let [r, g, b] = [r, g, b].map(|channel| floats(&channel.sample_data));
                let rgb = r
                    .iter()
                    .zip(&g)
                    .zip(&b)
                    .map(|((&r, &g), &b)| [r, g, b])
                    .collect();
                return Ok(Picture {
                    width: part.size.x(),
                    height: part.size.y(),
                    rgb,
                });
            }
        }
    }
    Err(ReadError::NoColor(names.join(", ")))
}

fn floats(samples: &FlatSamples) -> Vec<f32> {
    samples.values_as_f32().collect()
}

fn read_png(bytes: &[u8]) -> Result<Picture, ReadError> {
    let decoded = decode(bytes, ImageFormat::Png)?.into_rgba16();
    let table: Vec<f32> = (0..=u16::MAX)
        .map(|x| srgb_to_linear(x as f32 / 65_535.0))
        .collect();
    let rgb = decoded
        .pixels()
        .map(|p| {
            let alpha = p.0[3] as f32 / 65_535.0;
            [0, 1, 2].map(|c| table[p.0[c] as usize] * alpha)
        })
        .collect();
    Ok(Picture {
        width: decoded.width() as usize,
        height: decoded.height() as usize,
        rgb,
    })
}

fn read_hdr(bytes: &[u8]) -> Result<Picture, ReadError> {
    let decoded = decode(bytes, ImageFormat::Hdr)?.into_rgb32f();
    let rgb = decoded.pixels().map(|p| p.0).collect();
    Ok(Picture {
        width: decoded.width() as usize,
        height: decoded.height() as usize,
        rgb,
    })
}

fn decode(bytes: &[u8], format: ImageFormat) -> Result<image::DynamicImage, ReadError> {
    let reader = || image::ImageReader::with_format(std::io::Cursor::new(bytes), format);
    let (width, height) = reader().into_dimensions().map_err(ReadError::Image)?;
    check_size(width as u64, height as u64)?;
    let mut reader = reader();
    reader.no_limits(); // checked above
    reader.decode().map_err(ReadError::Image)
}

/// `PF` or `Pf`, width, height, scale (negative: little endian), then rows from the bottom.
fn read_pfm(bytes: &[u8]) -> Result<Picture, ReadError> {
    let mut rest = bytes;
    let mut word = || -> Option<&str> {
        let begin = rest.iter().position(|b| !b.is_ascii_whitespace())?;
        let end = begin + rest[begin..].iter().position(|b| b.is_ascii_whitespace())?;
        let word = str::from_utf8(&rest[begin..end]).ok()?;
        rest = &rest[end + 1..];
        Some(word)
    };
    let channels = if word() == Some("PF") { 3 } else { 1 };
    let mut number = || word()?.parse::<f64>().ok();
    let (width, height, scale) = match (number(), number(), number()) {
        (Some(w), Some(h), Some(s)) if w >= 1.0 && h >= 1.0 && s != 0.0 => (w as u64, h as u64, s),
        _ => return Err(ReadError::Pfm("head")),
    };
    check_size(width, height)?;
    let (width, height) = (width as usize, height as usize);
    if rest.len() < width * height * channels * 4 {
        return Err(ReadError::Pfm("too short"));
    }
    let value = |i: usize| {
        let four = [0, 1, 2, 3].map(|k| rest[i * 4 + k]);
        if scale < 0.0 {
            f32::from_le_bytes(four)
        } else {
            f32::from_be_bytes(four)
        }
    };
    let rows = (0..height)
        .rev()
        .flat_map(|y| (0..width).map(move |x| y * width + x));
    let rgb = match channels {
        3 => rows.map(|i| [0, 1, 2].map(|c| value(3 * i + c))).collect(),
        _ => rows.map(|i| [value(i); 3]).collect(),
    };
    Ok(Picture { width, height, rgb })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pfm_rows_come_from_the_bottom() {
        let mut file = b"PF\n1 2\n-1.0\n".to_vec();
        for value in [1f32, 2.0, 3.0, 4.0, 5.0, 6.0] {
            file.extend_from_slice(&value.to_le_bytes());
        }
        let picture = read_picture(&file).unwrap();
        assert_eq!(picture.rgb, [[4.0, 5.0, 6.0], [1.0, 2.0, 3.0]]);
        let short = read_picture(&file[..file.len() - 1]);
        assert!(matches!(short, Err(ReadError::Pfm("too short"))));
        assert!(matches!(
            read_picture(b"PF\n-1 2\n-1\n"),
            Err(ReadError::Pfm("head"))
        ));
        assert!(matches!(
            read_picture(b"PF\n99999 2\n-1\n"),
            Err(ReadError::TooLarge { .. })
        ));
        assert!(matches!(
            read_picture(b"GIF89a"),
            Err(ReadError::UnknownFormat)
        ));
    }

    #[test]
    fn junk_is_no_picture() {
        for head in [
            &b"\x76\x2f\x31\x01"[..],
            b"\x89PNG\r\n\x1a\n",
            b"#?RADIANCE\n",
            b"PF\n",
        ] {
            for junk in [
                &b""[..],
                b"\0\0\0\0\0\0\0\0",
                b"xxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxx",
            ] {
                assert!(read_picture(&[head, junk].concat()).is_err());
            }
        }
    }
}
