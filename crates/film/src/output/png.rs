//! 8-bit PNG of one layer.

use super::color::{false_color, linear_byte, srgb_byte};
use super::tonemap::ToneMap;
use super::{OutputError, PictureInfo};
use crate::film::Film;
use crate::layer::{Layer, channel};

/// What to show and how.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Look {
    /// Which layer.
    pub layer: Layer,
    /// Stops.
    pub exposure: f32,
    /// Curve for [`Layer::Beauty`].
    pub tonemap: ToneMap,
}

impl Default for Look {
    fn default() -> Look {
        Look {
            layer: Layer::Beauty,
            exposure: 0.0,
            tonemap: ToneMap::None,
        }
    }
}

/// Bytes of 8 bits a channel.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Bytes8 {
    /// In pixels.
    pub width: u32,
    /// In pixels.
    pub height: u32,
    /// 3 or 4, interleaved.
    pub channels: usize,
    /// Row by row from the top.
    pub data: Vec<u8>,
}

/// A PNG of a film, with its data in text chunks.
pub fn write_png(film: &Film, look: Look, info: &PictureInfo) -> Result<Vec<u8>, OutputError> {
    encode_png(&shown(film, look), &info.fields())
}

/// A picture as PNG. The same picture and texts are the same bytes.
pub fn encode_png(picture: &Bytes8, texts: &[(&str, String)]) -> Result<Vec<u8>, OutputError> {
    let mut out = Vec::new();
    let mut encoder = ::png::Encoder::new(&mut out, picture.width, picture.height);
    encoder.set_color(if picture.channels == 4 {
        ::png::ColorType::Rgba
    } else {
        ::png::ColorType::Rgb
    });
    encoder.set_depth(::png::BitDepth::Eight);
    encoder.set_compression(::png::Compression::Fast);
    encoder.set_source_srgb(::png::SrgbRenderingIntent::RelativeColorimetric);
    for (keyword, text) in texts {
        encoder
            .add_text_chunk((*keyword).into(), text.clone())
            .map_err(OutputError::Png)?;
    }
    let mut writer = encoder.write_header().map_err(OutputError::Png)?;
    writer
        .write_image_data(&picture.data)
        .map_err(OutputError::Png)?;
    writer.finish().map_err(OutputError::Png)?;
    Ok(out)
}

/// A layer in display colours.
pub fn shown(film: &Film, look: Look) -> Bytes8 {
    let gain = libm::exp2f(look.exposure);
    let one = |c| channel(film, look.layer, c);
    let three = || [one(0), one(1), one(2)];
    match look.layer {
        Layer::Beauty => beauty(film, look.tonemap, gain),
        Layer::Albedo | Layer::Variance => rgb(film, three(), |x| srgb_byte(x * gain)),
        Layer::Normal => {
            let planes = three();
            // Zero is no normal, and black.
            let data = (0..planes[0].len())
                .map(|i| planes.each_ref().map(|plane| plane[i]))
                .flat_map(|n| match n {
                    [0.0, 0.0, 0.0] => [0; 3],
                    n => n.map(|x| linear_byte(0.5 + 0.5 * x)),
                })
                .collect();
            picture(film, 3, data)
        }
        Layer::Alpha => grey(film, one(0), linear_byte),
        Layer::Depth => depth(film, one(0)),
        Layer::Samples => {
            let most = film.spp_span().1.max(1) as f32;
            colored(film, one(0), |x| x / most)
        }
        // Three decades up to 100 %. NaN stays: what is not known is white, not quiet.
        Layer::Error => colored(film, one(0), |x| {
            if x > 1e-3 {
                1.0 + libm::log10f(x) / 3.0
            } else {
                x * 0.0
            }
        }),
    }
}

fn picture(film: &Film, channels: usize, data: Vec<u8>) -> Bytes8 {
    Bytes8 {
        width: film.grid().width,
        height: film.grid().height,
        channels,
        data,
    }
}

/// With alpha only where something is see-through or missing, so that most files open everywhere
/// as what they are. Alpha in PNG is not premultiplied.
fn beauty(film: &Film, tonemap: ToneMap, gain: f32) -> Bytes8 {
    let planes = [0, 1, 2].map(|c| channel(film, Layer::Beauty, c));
    let byte = |x: f32| srgb_byte(tonemap.apply(x * gain));
    let alpha = channel(film, Layer::Alpha, 0);
    if alpha.iter().all(|&a| a == 1.0) {
        return rgb(film, planes, byte);
    }
    let mut data = Vec::with_capacity(4 * alpha.len());
    for (i, &a) in alpha.iter().enumerate() {
        let scale = if a > 0.0 { 1.0 / a } else { 1.0 };
        data.extend(planes.each_ref().map(|plane| byte(plane[i] * scale)));
        data.push(linear_byte(a));
    }
    picture(film, 4, data)
}

fn rgb(film: &Film, planes: [Vec<f32>; 3], byte: impl Fn(f32) -> u8) -> Bytes8 {
    let all = 0..planes[0].len();
    picture(
        film,
        3,
        all.flat_map(|i| planes.each_ref().map(|plane| byte(plane[i])))
            .collect(),
    )
}

fn grey(film: &Film, plane: Vec<f32>, byte: impl Fn(f32) -> u8) -> Bytes8 {
    picture(
        film,
        3,
        plane.into_iter().flat_map(|x| [byte(x); 3]).collect(),
    )
}

fn colored(film: &Film, plane: Vec<f32>, scale: impl Fn(f32) -> f32) -> Bytes8 {
    picture(
        film,
        3,
        plane
            .into_iter()
            .flat_map(|x| false_color(scale(x)))
            .collect(),
    )
}

/// Near is bright; where nothing was hit is black.
fn depth(film: &Film, plane: Vec<f32>) -> Bytes8 {
    let hit = |x: f32| x > 0.0 && x.is_finite();
    let hits = || plane.iter().copied().filter(|&x| hit(x));
    let near = hits().fold(f32::INFINITY, f32::min);
    let far = hits().fold(0.0, f32::max);
    let span = (far - near).max(1e-6 * far);
    let byte = |x: f32| {
        if hit(x) {
            linear_byte(1.0 - 0.9 * (x - near) / span)
        } else {
            0
        }
    };
    let data = plane.iter().flat_map(|&x| [byte(x); 3]).collect();
    picture(film, 3, data)
}
