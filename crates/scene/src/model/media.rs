//! What fills space.

use super::{MediumId, Rgb};
use glam::DAffine3;
use std::sync::Arc;

/// What lies on the two sides of a surface; `None` is vacuum.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct MediumInterface {
    /// Against the geometric normal.
    pub inside: Option<MediumId>,
    /// Where the geometric normal points.
    pub outside: Option<MediumId>,
}

/// A participating medium. Coefficients are per scene unit of world space.
#[derive(Clone, Debug, PartialEq)]
pub struct Medium {
    /// For messages and sharing.
    pub name: String,
    /// Absorption coefficient.
    pub sigma_a: Rgb,
    /// Scattering coefficient.
    pub sigma_s: Rgb,
    /// Radiance given off per absorption: the medium adds `sigma_a * emission` per unit of length.
    pub emission: Rgb,
    /// Asymmetry of the phase function [HenyeyGreenstein41], in (-1, 1); positive is forward.
    pub g: f32,
    /// Variation in space; `None` is the same everywhere.
    pub grid: Option<MediumGrid>,
    /// Of what fills a translucent body: the index of refraction of its glass border. What happens
    /// inside, and leaving it, then counts as one event of a path with entering it, and light leaves as
    /// from a diffuse surface, so that lights outside are sampled where it does.
    pub translucent: Option<f32>,
}

/// How a medium varies: factors on its coefficients, trilinear between the centres of cells, zero
/// outside the bounds.
#[derive(Clone, Debug, PartialEq)]
pub struct MediumGrid {
    /// Medium space to world.
    pub transform: DAffine3,
    /// Two corners of the box in medium space that the grids fill.
    pub bounds: [[f32; 3]; 2],
    /// Factor on `sigma_a`.
    pub absorption: Arc<Grid>,
    /// Factor on `sigma_s`; the same `Arc` as `absorption` where one density drives both.
    pub scattering: Arc<Grid>,
    /// Factor on `emission`.
    pub emission: Option<Arc<Grid>>,
}

/// Values on a regular grid, x fastest.
#[derive(Clone, Debug, PartialEq)]
pub struct Grid {
    /// Cells by axis.
    pub size: [u32; 3],
    /// As many as cells.
    pub values: GridValues,
}

impl Grid {
    /// Memory of the values.
    pub fn memory_bytes(&self) -> u64 {
        match &self.values {
            GridValues::Scalar(v) => v.len() as u64 * 4,
            GridValues::Rgb(v) => v.len() as u64 * 12,
        }
    }
}

/// What a [`Grid`] holds.
#[derive(Clone, Debug, PartialEq)]
pub enum GridValues {
    /// One number a cell.
    Scalar(Vec<f32>),
    /// One colour a cell.
    Rgb(Vec<Rgb>),
}
