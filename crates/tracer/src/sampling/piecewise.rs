//! Tabulated densities that are constant in each cell: pictures of the sky, light tables.
//!
//! Sums are taken in double precision from the first cell to the last, so they do not depend on
//! anything but the values. The density that is reported is the one that is sampled: it is taken
//! from the rounded cumulative table and not from the values. A cell with less than about 1e-7 of
//! its row may round to nothing; estimators have to be combined with one that reaches it (MIS does).

use crate::math::ONE_MINUS_EPSILON;
use glam::Vec2;

/// Cells for each entry of the guide that narrows the search.
const CELLS_PER_GUIDE: usize = 4;

/// A drawn point of a one-dimensional table.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PiecewiseSample {
    /// In [0, 1).
    pub x: f32,
    /// Density over [0, 1].
    pub pdf: f32,
    /// Cell.
    pub index: usize,
}

/// A density over [0, 1], constant in each of n equal cells.
#[derive(Clone, Debug, PartialEq)]
pub struct Piecewise1d {
    /// n + 1 values from 0 to 1.
    cdf: Box<[f32]>,
    /// For each of g equal parts of [0, 1]: the cell its start falls into.
    guide: Box<[u32]>,
    integral: f64,
}

impl Piecewise1d {
    /// Proportional to `values` (at least one); what is negative or not a number counts as zero.
    /// Uniform if nothing is left.
    pub fn new(values: &[f32]) -> Self {
        let mut cdf = vec![0.0; values.len() + 1];
        let mut guide = vec![0; guide_len(values.len())];
        let integral = fill(values, &mut cdf, &mut guide);
        Piecewise1d {
            cdf: cdf.into(),
            guide: guide.into(),
            integral,
        }
    }

    /// Number of cells.
    pub fn len(&self) -> usize {
        self.cdf.len() - 1
    }

    /// Whether there is no cell; there always is one.
    pub fn is_empty(&self) -> bool {
        false
    }

    /// Integral of the values over [0, 1]: their mean.
    pub fn integral(&self) -> f64 {
        self.integral
    }

    /// Point for a uniform number.
    #[inline]
    pub fn sample(&self, u: f32) -> PiecewiseSample {
        let (index, within, width) = search(&self.cdf, &self.guide, u);
        let n = self.len() as f32;
        PiecewiseSample {
            x: ((index as f32 + within) / n).min(ONE_MINUS_EPSILON),
            pdf: width * n,
            index,
        }
    }

    /// Density at x in [0, 1).
    #[inline]
    pub fn pdf(&self, x: f32) -> f32 {
        self.pmf(cell(x, self.len())) * self.len() as f32
    }

    /// Probability of a cell.
    #[inline]
    pub fn pmf(&self, index: usize) -> f32 {
        self.cdf[index + 1] - self.cdf[index]
    }

    /// Inverse of [`Piecewise1d::sample`]: the cumulative distribution at x.
    pub fn inverse(&self, x: f32) -> f32 {
        inverse(&self.cdf, x)
    }
}

/// A density over the unit square, constant in each of `width` x `height` cells.
#[derive(Clone, Debug, PartialEq)]
pub struct Piecewise2d {
    rows: Piecewise1d,
    width: usize,
    /// `width + 1` values a row.
    cdf: Box<[f32]>,
    guide: Box<[u32]>,
}

impl Piecewise2d {
    /// Proportional to `values`, row by row, the first row at y = 0.
    ///
    /// # Panics
    /// If there are not `width * height` > 0 values.
    pub fn new(values: &[f32], width: usize, height: usize) -> Self {
        assert!(width > 0 && height > 0 && values.len() == width * height);
        let g = guide_len(width);
        let mut cdf = vec![0.0; (width + 1) * height];
        let mut guide = vec![0; g * height];
        let mut sums = Vec::with_capacity(height);
        for y in 0..height {
            sums.push(fill(
                &values[y * width..][..width],
                &mut cdf[y * (width + 1)..][..width + 1],
                &mut guide[y * g..][..g],
            ));
        }
        let mut row_cdf = vec![0.0; height + 1];
        let mut row_guide = vec![0; guide_len(height)];
        let integral = fill_f64(&sums, &mut row_cdf, &mut row_guide);
        Piecewise2d {
            rows: Piecewise1d {
                cdf: row_cdf.into(),
                guide: row_guide.into(),
                integral,
            },
            width,
            cdf: cdf.into(),
            guide: guide.into(),
        }
    }

    /// Columns and rows.
    pub fn size(&self) -> (usize, usize) {
        (self.width, self.rows.len())
    }

    /// Integral of the values over the square: their mean.
    pub fn integral(&self) -> f64 {
        self.rows.integral
    }

    /// Memory held.
    pub fn memory_bytes(&self) -> usize {
        4 * (self.cdf.len() + self.guide.len() + self.rows.cdf.len() + self.rows.guide.len())
    }

    #[inline]
    fn row(&self, y: usize) -> (&[f32], &[u32]) {
        let g = guide_len(self.width);
        (
            &self.cdf[y * (self.width + 1)..][..self.width + 1],
            &self.guide[y * g..][..g],
        )
    }

    /// Point of [0, 1)^2 and its density for two uniform numbers: u.y picks the row.
    #[inline]
    pub fn sample(&self, u: Vec2) -> (Vec2, f32) {
        let y = self.rows.sample(u.y);
        let (cdf, guide) = self.row(y.index);
        let (index, within, width) = search(cdf, guide, u.x);
        let n = self.width as f32;
        let x = ((index as f32 + within) / n).min(ONE_MINUS_EPSILON);
        (Vec2::new(x, y.x), y.pdf * (width * n))
    }

    /// Density at a point of [0, 1)^2.
    #[inline]
    pub fn pdf(&self, p: Vec2) -> f32 {
        let y = cell(p.y, self.rows.len());
        let (cdf, _) = self.row(y);
        let x = cell(p.x, self.width);
        self.rows.pmf(y) * self.rows.len() as f32 * ((cdf[x + 1] - cdf[x]) * self.width as f32)
    }

    /// Inverse of [`Piecewise2d::sample`].
    pub fn inverse(&self, p: Vec2) -> Vec2 {
        let (cdf, _) = self.row(cell(p.y, self.rows.len()));
        Vec2::new(inverse(cdf, p.x), self.rows.inverse(p.y))
    }
}

fn guide_len(n: usize) -> usize {
    n.div_ceil(CELLS_PER_GUIDE)
}

#[inline]
fn cell(x: f32, n: usize) -> usize {
    ((x * n as f32) as usize).min(n - 1)
}

/// Fills a cumulative table and its guide; returns the mean of the values.
fn fill(values: &[f32], cdf: &mut [f32], guide: &mut [u32]) -> f64 {
    let wide: Vec<f64> = values.iter().map(|&v| f64::from(v)).collect();
    fill_f64(&wide, cdf, guide)
}

fn fill_f64(values: &[f64], cdf: &mut [f32], guide: &mut [u32]) -> f64 {
    let n = values.len();
    let clean = |v: f64| if v > 0.0 && v.is_finite() { v } else { 0.0 };
    let total: f64 = values.iter().fold(0.0, |sum, &v| sum + clean(v));
    let mut sum = 0.0;
    for (i, &v) in values.iter().enumerate() {
        cdf[i] = if total > 0.0 {
            (sum / total) as f32
        } else {
            (i as f64 / n as f64) as f32
        };
        sum += clean(v);
    }
    cdf[n] = 1.0;
    // Cells of no width at the end must start at 1, or the last of them would be drawn.
    let mut i = n;
    while total > 0.0 && i > 0 && clean(values[i - 1]) == 0.0 {
        i -= 1;
        cdf[i] = 1.0;
    }
    let mut at = 0;
    for (k, entry) in guide.iter_mut().enumerate() {
        let start = k as f32 / guide_len(n) as f32;
        while at + 1 < n && cdf[at + 1] <= start {
            at += 1;
        }
        *entry = at as u32;
    }
    total / n as f64
}

/// Cell that holds u, where in it, and its probability.
#[inline]
fn search(cdf: &[f32], guide: &[u32], u: f32) -> (usize, f32, f32) {
    let n = cdf.len() - 1;
    let k = ((u * guide.len() as f32) as usize).min(guide.len() - 1);
    // Rounding of u * len may land one part too far.
    let k = if k > 0 && (k as f32 / guide.len() as f32) > u {
        k - 1
    } else {
        k
    };
    let mut lo = guide[k] as usize;
    let mut hi = guide.get(k + 1).map_or(n - 1, |&v| v as usize);
    // The last cell with cdf[cell] <= u; it has a width, as the next one starts beyond u.
    while lo < hi {
        let mid = (lo + hi).div_ceil(2);
        if cdf[mid] <= u {
            lo = mid;
        } else {
            hi = mid - 1;
        }
    }
    let width = cdf[lo + 1] - cdf[lo];
    let within = if width > 0.0 {
        (u - cdf[lo]) / width
    } else {
        0.0
    };
    (lo, within.min(ONE_MINUS_EPSILON), width)
}

fn inverse(cdf: &[f32], x: f32) -> f32 {
    let n = cdf.len() - 1;
    let i = cell(x, n);
    let t = x * n as f32 - i as f32;
    cdf[i] + (cdf[i + 1] - cdf[i]) * t.clamp(0.0, 1.0)
}
