//! Pyramids of halved pictures, and lookups over an area: trilinear [Williams83] and by an elliptical
//! Gaussian [Heckbert89].

use super::image::{Image, bilinear};
use super::mapping::pixel;
use crate::math;
use glam::Vec2;
use scene::model::{MipFilter, Wrap};

/// Thinner ellipses than this are fattened whatever the texture says: they would cost too much.
const ANISOTROPY_MAX: f32 = 32.0;

/// The levels after the picture itself, each half as large, down to one pixel.
pub(super) struct Pyramid {
    levels: Vec<Level>,
}

/// A halved picture, linear.
struct Level {
    width: u32,
    height: u32,
    texels: Texels,
}

enum Texels {
    /// Of pictures with 8 or 16 bits: 65,535 is 1.
    Words(Box<[[u16; 4]]>),
    Floats(Box<[[f32; 4]]>),
}

impl Level {
    fn texel(&self, x: usize, y: usize) -> [f32; 4] {
        let i = y * self.width as usize + x;
        match &self.texels {
            Texels::Words(data) => data[i].map(|v| v as f32 * (1.0 / 65_535.0)),
            Texels::Floats(data) => data[i],
        }
    }
}

/// Weights of the cells of `n` that a cell of `m` covers: the first, and how much of each.
fn covered(i: usize, n: usize, m: usize) -> (usize, Vec<f64>) {
    let (from, to) = (
        i as f64 * n as f64 / m as f64,
        (i + 1) as f64 * n as f64 / m as f64,
    );
    let first = from.floor() as usize;
    let last = (to.ceil() as usize).min(n);
    let share = |j: usize| (to.min((j + 1) as f64) - from.max(j as f64)) * m as f64 / n as f64;
    (first, (first..last).map(share).collect())
}

/// A picture of half the size (at least one pixel), each pixel the mean over what it covers.
fn halved(w: usize, h: usize, get: &dyn Fn(usize, usize) -> [f32; 4]) -> Vec<[f32; 4]> {
    let (nw, nh) = ((w / 2).max(1), (h / 2).max(1));
    let columns: Vec<_> = (0..nw).map(|x| covered(x, w, nw)).collect();
    let mut out = Vec::with_capacity(nw * nh);
    for y in 0..nh {
        let (top, rows) = covered(y, h, nh);
        for (left, column) in &columns {
            let mut sum = [0.0f64; 4];
            for (j, wy) in rows.iter().enumerate() {
                for (i, wx) in column.iter().enumerate() {
                    let texel = get(left + i, top + j);
                    for c in 0..4 {
                        sum[c] += texel[c] as f64 * wx * wy;
                    }
                }
            }
            out.push(sum.map(|s| s as f32));
        }
    }
    out
}

impl Pyramid {
    /// All levels of a picture. Levels of 8- and 16-bit pictures are kept in 16 bits.
    pub fn new(image: &Image) -> Pyramid {
        let mut levels: Vec<Level> = vec![];
        let (mut w, mut h) = (image.width as usize, image.height as usize);
        let compact = image.is_unit();
        // Each level is made from the one before in full precision.
        let mut last: Option<Vec<[f32; 4]>> = None;
        while w > 1 || h > 1 {
            let next = match &last {
                None => halved(w, h, &|x, y| image.texel(x, y)),
                Some(texels) => halved(w, h, &|x, y| texels[y * w + x]),
            };
            (w, h) = ((w / 2).max(1), (h / 2).max(1));
            let texels = if compact {
                let word = |v: f32| (v * 65_535.0 + 0.5) as u16;
                Texels::Words(next.iter().map(|t| t.map(word)).collect())
            } else {
                Texels::Floats(next.clone().into())
            };
            levels.push(Level {
                width: w as u32,
                height: h as u32,
                texels,
            });
            last = Some(next);
        }
        Pyramid { levels }
    }

    pub fn memory_bytes(&self) -> usize {
        let bytes = |level: &Level| match &level.texels {
            Texels::Words(data) => data.len() * 8,
            Texels::Floats(data) => data.len() * 16,
        };
        self.levels.iter().map(bytes).sum()
    }

    /// Over the ellipse about `st` that two offsets span. Level 0 is the picture itself.
    pub fn lookup(
        &self,
        image: &Image,
        st: Vec2,
        axes: [Vec2; 2],
        wrap: (Wrap, Wrap),
        filter: MipFilter,
    ) -> [f32; 4] {
        let top = self.levels.len();
        let size = Vec2::new(image.width as f32, image.height as f32);
        let [mut long, mut short] = axes;
        if !(long.is_finite() && short.is_finite()) {
            return self.bilinear(image, top, st, wrap);
        }
        match filter {
            MipFilter::Trilinear => {
                let widest = (long * size).abs().max((short * size).abs());
                let level = log2(2.0 * widest.max_element());
                if level <= 0.0 {
                    return self.bilinear(image, 0, st, wrap);
                }
                let below = (level as usize).min(top);
                if below == top {
                    return self.bilinear(image, top, st, wrap);
                }
                let (a, b) = (
                    self.bilinear(image, below, st, wrap),
                    self.bilinear(image, below + 1, st, wrap),
                );
                mix(a, b, level - below as f32)
            }
            MipFilter::Ewa { max_anisotropy } => {
                if (long * size).length_squared() < (short * size).length_squared() {
                    (long, short) = (short, long);
                }
                let (length, mut width) = ((long * size).length(), (short * size).length());
                if width == 0.0 {
                    return self.bilinear(image, 0, st, wrap);
                }
                let most = max_anisotropy.min(ANISOTROPY_MAX);
                if width * most < length {
                    let fatter = length / (width * most);
                    short *= fatter;
                    width *= fatter;
                }
                let level = log2(width).max(0.0);
                let below = level as usize;
                if below >= top {
                    return self.bilinear(image, top, st, wrap);
                }
                let (a, b) = (
                    self.ewa(image, below, st, [long, short], wrap),
                    self.ewa(image, below + 1, st, [long, short], wrap),
                );
                mix(a, b, level - below as f32)
            }
        }
    }

    fn size(&self, image: &Image, level: usize) -> (i64, i64) {
        match level.checked_sub(1) {
            None => (image.width as i64, image.height as i64),
            Some(i) => (self.levels[i].width as i64, self.levels[i].height as i64),
        }
    }

    #[inline]
    fn texel(
        &self,
        image: &Image,
        level: usize,
        (x, y): (i64, i64),
        wrap: (Wrap, Wrap),
    ) -> [f32; 4] {
        let (w, h) = self.size(image, level);
        match (pixel(x, y, w, h, wrap), level.checked_sub(1)) {
            (None, _) => [0.0; 4],
            (Some((x, y)), None) => image.texel(x, y),
            (Some((x, y)), Some(i)) => self.levels[i].texel(x, y),
        }
    }

    fn bilinear(&self, image: &Image, level: usize, st: Vec2, wrap: (Wrap, Wrap)) -> [f32; 4] {
        let (w, h) = self.size(image, level);
        bilinear(st, w, h, |x, y| self.texel(image, level, (x, y), wrap))
    }

    /// The Gaussian over an ellipse on one level.
    fn ewa(
        &self,
        image: &Image,
        level: usize,
        st: Vec2,
        [long, short]: [Vec2; 2],
        wrap: (Wrap, Wrap),
    ) -> [f32; 4] {
        let (w, h) = self.size(image, level);
        // Rows run down, texture coordinates up.
        let size = Vec2::new(w as f32, -h as f32);
        let center = Vec2::new(st.x * w as f32 - 0.5, (1.0 - st.y) * h as f32 - 0.5);
        if !center.is_finite() || center.abs().max_element() > 1e9 {
            return self.texel(image, level, (0, 0), wrap);
        }
        let (d0, d1) = (long * size, short * size);
        // a x^2 + b x y + c y^2 < 1 inside; the 1 is the width of the reconstruction filter.
        let (a, b, c) = (
            d0.y * d0.y + d1.y * d1.y + 1.0,
            -2.0 * (d0.x * d0.y + d1.x * d1.y),
            d0.x * d0.x + d1.x * d1.x + 1.0,
        );
        let f = 1.0 / (a * c - 0.25 * b * b);
        let (a, b, c) = (a * f, b * f, c * f);
        let det = 4.0 * a * c - b * b;
        let reach = Vec2::new((c / det).sqrt(), (a / det).sqrt()) * 2.0;
        let (low, high) = ((center - reach).ceil(), (center + reach).floor());
        let mut sum = [0.0f32; 4];
        let mut weights = 0.0f32;
        for y in low.y as i64..=high.y as i64 {
            let v = y as f32 - center.y;
            for x in low.x as i64..=high.x as i64 {
                let u = x as f32 - center.x;
                let r2 = a * u * u + b * u * v + c * v * v;
                if r2 < 1.0 {
                    // Lowered so that it ends at zero.
                    let weight = math::exp(-2.0 * r2) - 0.135_335_28;
                    let texel = self.texel(image, level, (x, y), wrap);
                    for i in 0..4 {
                        sum[i] += weight * texel[i];
                    }
                    weights += weight;
                }
            }
        }
        if weights > 0.0 {
            sum.map(|s| s / weights)
        } else {
            self.bilinear(image, level, st, wrap)
        }
    }
}

fn log2(x: f32) -> f32 {
    math::ln(x) * std::f32::consts::LOG2_E
}

fn mix(a: [f32; 4], b: [f32; 4], t: f32) -> [f32; 4] {
    std::array::from_fn(|i| a[i] * (1.0 - t) + b[i] * t)
}
