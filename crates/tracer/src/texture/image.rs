//! Pictures: decoding and lookup.

use super::wrapped;
use crate::PrepareError;
use glam::Vec2;
use image::{DynamicImage, ImageReader, Limits};
use scene::AssetSource;
use scene::model::{Encoding, ImageDesc, Wrap};

/// Longest side of a picture in pixels.
const SIDE_MAX: u32 = 65_536;
/// Most bytes that decoding one picture may take.
const DECODE_BYTES_MAX: u64 = 2 << 30;

/// A decoded picture, top row first.
pub struct Image {
    /// Pixels.
    pub width: u32,
    /// Pixels.
    pub height: u32,
    texels: Texels,
}

enum Texels {
    /// 8 bits through a table (alpha is always linear).
    Bytes {
        rgba: Vec<[u8; 4]>,
        to_linear: Box<[f32; 256]>,
    },
    /// Linear numbers.
    Floats(Vec<[f32; 4]>),
}

impl Image {
    /// A stand-in that nobody overlooks.
    pub fn stand_in() -> Image {
        let (on, off) = ([255, 0, 255, 255], [20, 20, 20, 255]);
        let rgba = (0..64)
            .map(|i| if (i % 8 + i / 8) % 2 == 0 { on } else { off })
            .collect();
        Image {
            width: 8,
            height: 8,
            texels: Texels::Bytes {
                rgba,
                to_linear: table(Encoding::Srgb),
            },
        }
    }

    /// Reads and decodes a picture.
    pub fn load(desc: &ImageDesc, assets: &dyn AssetSource) -> Result<Image, PrepareError> {
        if desc.missing {
            return Ok(Image::stand_in());
        }
        let bytes = match &desc.bytes {
            Some(inside) => inside.clone(),
            None => assets.read(&desc.path)?,
        };
        decode(&desc.path, &bytes, desc.encoding).map_err(|reason| PrepareError::Decode {
            path: desc.path.clone(),
            reason,
        })
    }

    /// The texel at a pixel.
    #[inline]
    pub fn texel(&self, x: usize, y: usize) -> [f32; 4] {
        let i = y * self.width as usize + x;
        match &self.texels {
            Texels::Bytes { rgba, to_linear } => {
                let [r, g, b, a] = rgba[i];
                let c = |v: u8| to_linear[v as usize];
                [c(r), c(g), c(b), a as f32 * (1.0 / 255.0)]
            }
            Texels::Floats(rgba) => rgba[i],
        }
    }

    /// At texture coordinates: (0, 0) is the bottom left.
    pub fn lookup(&self, st: Vec2, wrap: (Wrap, Wrap), nearest: bool) -> [f32; 4] {
        let (w, h) = (self.width as i64, self.height as i64);
        let get = |x: i64, y: i64| match (wrapped(x, w, wrap.0), wrapped(y, h, wrap.1)) {
            (Some(x), Some(y)) => self.texel(x, y),
            _ => [0.0; 4],
        };
        let (x, y) = (st.x * w as f32, (1.0 - st.y) * h as f32);
        if !(x.abs() < 1e9 && y.abs() < 1e9) {
            return get(0, 0);
        }
        if nearest {
            return get(x.floor() as i64, y.floor() as i64);
        }
        let (x, y) = (x - 0.5, y - 0.5);
        let (x0, y0) = (x.floor(), y.floor());
        let (fx, fy) = (x - x0, y - y0);
        let (x0, y0) = (x0 as i64, y0 as i64);
        let (a, b, c, d) = (
            get(x0, y0),
            get(x0 + 1, y0),
            get(x0, y0 + 1),
            get(x0 + 1, y0 + 1),
        );
        std::array::from_fn(|i| {
            (a[i] * (1.0 - fx) + b[i] * fx) * (1.0 - fy) + (c[i] * (1.0 - fx) + d[i] * fx) * fy
        })
    }

    /// Memory held.
    pub fn memory_bytes(&self) -> usize {
        match &self.texels {
            Texels::Bytes { rgba, .. } => rgba.len() * 4,
            Texels::Floats(rgba) => rgba.len() * 16,
        }
    }
}

fn decode(path: &str, bytes: &[u8], encoding: Encoding) -> Result<Image, String> {
    let lower = path.to_ascii_lowercase();
    if lower.ends_with(".pfm") {
        return decode_pfm(bytes);
    }
    let mut reader = ImageReader::new(std::io::Cursor::new(bytes));
    // TGA has no magic number, so the name decides where it can.
    match image::ImageFormat::from_path(path) {
        Ok(format) => reader.set_format(format),
        Err(_) => {
            reader = reader.with_guessed_format().map_err(|e| e.to_string())?;
        }
    }
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
    let texels = match picture {
        DynamicImage::ImageRgb32F(_) | DynamicImage::ImageRgba32F(_) => {
            let apply = transfer(encoding, true);
            let rgba = picture.into_rgba32f();
            Texels::Floats(
                rgba.pixels()
                    .map(|p| [apply(p.0[0]), apply(p.0[1]), apply(p.0[2]), p.0[3]])
                    .collect(),
            )
        }
        DynamicImage::ImageLuma16(_)
        | DynamicImage::ImageLumaA16(_)
        | DynamicImage::ImageRgb16(_)
        | DynamicImage::ImageRgba16(_) => {
            let apply = transfer(encoding, false);
            let unit = |v: u16| v as f32 * (1.0 / 65_535.0);
            let rgba = picture.into_rgba16();
            Texels::Floats(
                rgba.pixels()
                    .map(|p| {
                        [
                            apply(unit(p.0[0])),
                            apply(unit(p.0[1])),
                            apply(unit(p.0[2])),
                            unit(p.0[3]),
                        ]
                    })
                    .collect(),
            )
        }
        _ => Texels::Bytes {
            rgba: picture.into_rgba8().pixels().map(|p| p.0).collect(),
            to_linear: table(encoding),
        },
    };
    if let Texels::Floats(rgba) = &texels
        && let Some(i) = rgba.iter().position(|t| t.iter().any(|x| !x.is_finite()))
    {
        let (x, y) = (i as u32 % width, i as u32 / width);
        return Err(format!("the pixel at column {x}, row {y} is not finite"));
    }
    Ok(Image {
        width,
        height,
        texels,
    })
}

/// From stored to linear.
fn transfer(encoding: Encoding, float: bool) -> impl Fn(f32) -> f32 {
    move |x| match encoding {
        Encoding::Linear => x,
        Encoding::Auto if float => x,
        Encoding::Auto | Encoding::Srgb => from_srgb(x),
        Encoding::GammaMicros(g) => libm::pow(x.max(0.0) as f64, g as f64 * 1e-6) as f32,
    }
}

fn table(encoding: Encoding) -> Box<[f32; 256]> {
    let apply = transfer(encoding, false);
    Box::new(std::array::from_fn(|i| apply(i as f32 / 255.0)))
}

/// sRGB transfer function [IEC 61966-2-1].
fn from_srgb(x: f32) -> f32 {
    let x = x as f64;
    let y = if x <= 0.04045 {
        x / 12.92
    } else {
        libm::pow((x + 0.055) / 1.055, 2.4)
    };
    y as f32
}

/// Portable float map: `PF` or `Pf`, size, scale (negative: little endian), rows from the bottom up.
fn decode_pfm(bytes: &[u8]) -> Result<Image, String> {
    let mut at = 0;
    let mut word = || -> Result<&str, String> {
        let start = at
            + bytes[at.min(bytes.len())..]
                .iter()
                .take_while(|b| b.is_ascii_whitespace())
                .count();
        let end = start
            + bytes[start..]
                .iter()
                .take(32)
                .take_while(|b| !b.is_ascii_whitespace())
                .count();
        at = end + 1;
        std::str::from_utf8(&bytes[start..end]).map_err(|_| "the header is not text".to_string())
    };
    let channels = match word()? {
        "PF" => 3,
        "Pf" => 1,
        other => return Err(format!("'{other}' is not the mark of a PFM picture")),
    };
    let size = |text: &str| {
        text.parse::<u32>()
            .map_err(|_| format!("'{text}' is not a size"))
    };
    let (width, height) = (size(word()?)?, size(word()?)?);
    let scale_text = word()?.to_string();
    let scale: f32 = scale_text
        .parse()
        .map_err(|_| format!("'{scale_text}' is not a scale"))?;
    if width == 0 || height == 0 || width > SIDE_MAX || height > SIDE_MAX {
        return Err(format!(
            "{width} x {height} pixels; a side must have 1 to {SIDE_MAX}"
        ));
    }
    let count = width as usize * height as usize * channels;
    let data = bytes.get(at..).unwrap_or(&[]);
    if data.len() < count * 4 {
        return Err(format!(
            "{} bytes of pixels where the header promises {}",
            data.len(),
            count * 4
        ));
    }
    let value = |i: usize| {
        let b = [
            data[4 * i],
            data[4 * i + 1],
            data[4 * i + 2],
            data[4 * i + 3],
        ];
        if scale < 0.0 {
            f32::from_le_bytes(b)
        } else {
            f32::from_be_bytes(b)
        }
    };
    let mut rgba = Vec::with_capacity(width as usize * height as usize);
    for y in (0..height as usize).rev() {
        for x in 0..width as usize {
            let i = (y * width as usize + x) * channels;
            let texel = if channels == 3 {
                [value(i), value(i + 1), value(i + 2), 1.0]
            } else {
                [value(i), value(i), value(i), 1.0]
            };
            if texel.iter().any(|v| !v.is_finite()) {
                return Err(format!(
                    "the pixel at column {x}, row {y} from below is not finite"
                ));
            }
            rgba.push(texel);
        }
    }
    Ok(Image {
        width,
        height,
        texels: Texels::Floats(rgba),
    })
}
