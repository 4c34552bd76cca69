//! Reconstruction filters, importance sampled: a sample's place in its pixel's neighbourhood is drawn
//! in proportion to the filter's magnitude, so that it counts for its own pixel only [Ernst06].

use crate::sampling;
use glam::Vec2;
use scene::model::Filter;

/// Cells of a tabulated filter over its full width.
const CELLS: usize = 256;

/// One axis of a separable filter.
enum Axis {
    /// Constant over [-r, r].
    Box(f32),
    /// Tent over [-r, r].
    Tent(f32),
    /// Anything else: the inverse of the distribution of the magnitude, tabulated.
    Table(Table),
}

struct Table {
    radius: f32,
    /// Cumulative magnitude at cell borders, from 0 to 1.
    cdf: Vec<f32>,
    /// Integral of the magnitude over the integral of the filter, signed by the filter in the cell.
    weight: Vec<f32>,
}

/// A filter ready for sampling.
pub struct FilterSampler {
    x: Axis,
    y: Axis,
}

impl FilterSampler {
    /// Tabulates what has no closed inverse.
    pub fn new(filter: &Filter) -> FilterSampler {
        let table = |radius: f64, f: &dyn Fn(f64) -> f64| Axis::Table(Table::new(radius, f));
        let (x, y) = match *filter {
            Filter::Box { radius: (x, y) } => (Axis::Box(x as f32), Axis::Box(y as f32)),
            Filter::Tent { radius: (x, y) } => (Axis::Tent(x as f32), Axis::Tent(y as f32)),
            Filter::Gaussian {
                radius: (x, y),
                sigma,
            } => {
                let gauss = |t: f64| libm::exp(-t * t / (2.0 * sigma * sigma));
                let axis = |r: f64| table(r, &|t| (gauss(t) - gauss(r)).max(0.0));
                (axis(x), axis(y))
            }
            Filter::Mitchell {
                radius: (x, y),
                b,
                c,
            } => {
                let axis = |r: f64| table(r, &|t| mitchell(2.0 * t / r, b, c));
                (axis(x), axis(y))
            }
            Filter::BlackmanHarris { radius: (x, y) } => {
                let axis = |r: f64| table(r, &|t| blackman_harris(t / r));
                (axis(x), axis(y))
            }
            Filter::LanczosSinc {
                radius: (x, y),
                tau,
            } => {
                let axis = |r: f64| {
                    table(r, &|t| {
                        if t.abs() > r {
                            0.0
                        } else {
                            sinc(t) * sinc(t / tau)
                        }
                    })
                };
                (axis(x), axis(y))
            }
        };
        FilterSampler { x, y }
    }

    /// Offset from the pixel's centre in pixels, and the weight of the sample: 1 for filters without
    /// negative parts, of mean 1 for all.
    #[inline]
    pub fn sample(&self, u: Vec2) -> (Vec2, f32) {
        let (x, wx) = self.x.sample(u.x);
        let (y, wy) = self.y.sample(u.y);
        (Vec2::new(x, y), wx * wy)
    }
}

impl FilterSampler {
    /// Radii, if the filter is constant.
    pub(crate) fn is_box(&self) -> Option<(f32, f32)> {
        match (&self.x, &self.y) {
            (Axis::Box(x), Axis::Box(y)) => Some((*x, *y)),
            _ => None,
        }
    }
}

impl Axis {
    #[inline]
    fn sample(&self, u: f32) -> (f32, f32) {
        match self {
            Axis::Box(r) => ((2.0 * u - 1.0) * r, 1.0),
            Axis::Tent(r) => (sampling::tent(u, *r), 1.0),
            Axis::Table(table) => table.sample(u),
        }
    }
}

impl Table {
    fn new(radius: f64, f: &dyn Fn(f64) -> f64) -> Table {
        let cell = 2.0 * radius / CELLS as f64;
        // The middle of a cell stands for it: exact enough at 256 cells, and the weights make up for
        // the rest of the sign.
        let values: Vec<f64> = (0..CELLS)
            .map(|i| f(-radius + (i as f64 + 0.5) * cell))
            .collect();
        let total: f64 = values.iter().map(|v| v.abs()).sum();
        let signed: f64 = values.iter().sum();
        let mut sum = 0.0;
        let mut cdf = vec![0.0];
        for v in &values {
            sum += v.abs() / total;
            cdf.push(sum as f32);
        }
        cdf[CELLS] = 1.0;
        let weight = values
            .iter()
            .map(|v| (total / signed * if *v < 0.0 { -1.0 } else { 1.0 }) as f32)
            .collect();
        Table {
            radius: radius as f32,
            cdf,
            weight,
        }
    }

    #[inline]
    fn sample(&self, u: f32) -> (f32, f32) {
        let i = self.cdf.partition_point(|c| *c <= u).clamp(1, CELLS) - 1;
        let (a, b) = (self.cdf[i], self.cdf[i + 1]);
        let f = if b > a { (u - a) / (b - a) } else { 0.5 };
        (
            (2.0 * (i as f32 + f) / CELLS as f32 - 1.0) * self.radius,
            self.weight[i],
        )
    }
}

/// [Mitchell88], for x in [-2, 2].
fn mitchell(x: f64, b: f64, c: f64) -> f64 {
    let x = x.abs();
    if x <= 1.0 {
        ((12.0 - 9.0 * b - 6.0 * c) * x * x * x
            + (-18.0 + 12.0 * b + 6.0 * c) * x * x
            + (6.0 - 2.0 * b))
            / 6.0
    } else if x <= 2.0 {
        ((-b - 6.0 * c) * x * x * x
            + (6.0 * b + 30.0 * c) * x * x
            + (-12.0 * b - 48.0 * c) * x
            + (8.0 * b + 24.0 * c))
            / 6.0
    } else {
        0.0
    }
}

/// Four-term Blackman-Harris window [Harris78], for x in [-1, 1].
fn blackman_harris(x: f64) -> f64 {
    let t = std::f64::consts::PI * (x + 1.0);
    0.35875 - 0.48829 * libm::cos(t) + 0.14128 * libm::cos(2.0 * t) - 0.01168 * libm::cos(3.0 * t)
}

fn sinc(x: f64) -> f64 {
    let t = std::f64::consts::PI * x;
    if t.abs() < 1e-5 {
        1.0
    } else {
        libm::sin(t) / t
    }
}
