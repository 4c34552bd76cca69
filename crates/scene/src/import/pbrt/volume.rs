//! Media of type "nanovdb": the sparse grids of a file become regular ones.

use super::Importer;
use super::params::Params;
use crate::assets::AssetError;
use crate::color;
use crate::context::Issue;
use crate::diagnostic::Place;
use crate::import::nanovdb::{self, IndexBox, Stored, Volume, cells};
use crate::limits::{MAX_GRID_SIDE, MAX_VOLUME_BYTES};
use crate::model::{Grid, GridValues, Medium, MediumGrid, Rgb};
use glam::{DAffine3, DVec3};
use std::sync::Arc;

/// A regular grid among the indices of voxels.
struct Cells {
    space: IndexBox,
    step: i64,
    size: [u32; 3],
}

impl Cells {
    /// The centre of a cell.
    fn center(&self, cell: [u32; 3]) -> DVec3 {
        let half = 0.5 * (self.step - 1) as f64;
        DVec3::from_array(std::array::from_fn(|i| {
            self.space[0][i] as f64 + f64::from(cell[i]) * self.step as f64 + half
        }))
    }

    /// Trilinear at a place among the indices of voxels; `outside` beyond the outermost cells.
    fn lookup(&self, values: &[f32], p: DVec3, outside: f32) -> f32 {
        let q = (p - self.center([0; 3])) / self.step as f64;
        let floor = q.floor();
        let mut sum = 0.0;
        for corner in 0..8u32 {
            let mut weight = 1.0;
            let mut index = Some(0usize);
            for axis in (0..3).rev() {
                let high = f64::from(corner >> axis & 1);
                let x = floor[axis] + high;
                let f = q[axis] - floor[axis];
                weight *= if high == 1.0 { f } else { 1.0 - f };
                let n = self.size[axis];
                let inside = x >= 0.0 && x < f64::from(n);
                index = index
                    .filter(|_| inside)
                    .map(|i| i * n as usize + x as usize);
            }
            if weight > 0.0 {
                sum += weight * f64::from(index.map_or(outside, |i| values[i]));
            }
        }
        sum as f32
    }
}

/// What temperatures glow like, tabulated: a grid has too many to compute each.
struct Glow {
    hottest: f64,
    colors: Vec<Rgb>,
}

impl Glow {
    const STEPS: usize = 4096;

    fn new(hottest: f64) -> Glow {
        let kelvin = |i: usize| hottest * i as f64 / Glow::STEPS as f64;
        Glow {
            hottest,
            colors: (0..=Glow::STEPS)
                .map(|i| color::blackbody_peak_one(kelvin(i)))
                .collect(),
        }
    }
    fn at(&self, kelvin: f64) -> Rgb {
        // As in pbrt, what is no warmer than this does not glow.
        if !kelvin.is_finite() || kelvin <= 100.0 {
            return [0.0; 3];
        }
        let x = (kelvin / self.hottest * Glow::STEPS as f64).min(Glow::STEPS as f64);
        let i = (x as usize).min(Glow::STEPS - 1);
        let (a, b, f) = (self.colors[i], self.colors[i + 1], (x - i as f64) as f32);
        std::array::from_fn(|c| a[c] + (b[c] - a[c]) * f)
    }
}

/// Cells up to which a grid of temperatures is refined before it becomes colours.
const FINE_CELLS: u64 = 1 << 21;

/// A grid of temperatures, and of factors on what they give off.
pub(super) struct Glowing {
    pub size: [u32; 3],
    pub kelvin: Vec<f32>,
    pub level: Vec<f32>,
}

impl Glowing {
    /// How often each cell is halved: half way between a hot cell and a cold one lies the mean of the
    /// temperatures, which glows far less than the mean of the colours.
    fn halvings(cells: u64) -> u32 {
        (0..=2)
            .rev()
            .find(|n| cells << (3 * n) <= FINE_CELLS)
            .unwrap_or(0)
    }
    /// Memory of [`Glowing::grid`].
    pub fn bytes(cells: u64) -> u64 {
        (cells << (3 * Glowing::halvings(cells))) * 12
    }
    /// What is given off.
    pub fn grid(&self) -> Grid {
        let finite = self.kelvin.iter().copied().filter(|t| t.is_finite());
        let hottest = finite.fold(0.0, f32::max);
        let factor = 1u32 << Glowing::halvings(self.kelvin.len() as u64);
        let size = self.size.map(|n| n * factor);
        let glow = Glow::new(f64::from(hottest.max(100.0)));
        let color = |kelvin: f32, level: f32| glow.at(f64::from(kelvin)).map(|c| c * level);
        if factor == 1 {
            let pairs = self.kelvin.iter().zip(&self.level);
            let colors = pairs.map(|(&t, &level)| color(t, level)).collect();
            return Grid {
                size,
                values: GridValues::Rgb(colors),
            };
        }
        let cells = Cells {
            space: [[0; 3], self.size.map(|n| i64::from(n) - 1)],
            step: 1,
            size: self.size,
        };
        let mut colors = Vec::with_capacity(size.iter().map(|&n| n as usize).product());
        for z in 0..size[2] {
            for y in 0..size[1] {
                for x in 0..size[0] {
                    let fine = [x, y, z].map(|i| (f64::from(i) + 0.5) / f64::from(factor) - 0.5);
                    let inside = DVec3::from_array(std::array::from_fn(|i| {
                        fine[i].clamp(0.0, f64::from(self.size[i] - 1))
                    }));
                    let kelvin = cells.lookup(&self.kelvin, inside, 0.0);
                    let level = cells.lookup(&self.level, inside, 0.0);
                    colors.push(color(kelvin, level));
                }
            }
        }
        Grid {
            size,
            values: GridValues::Rgb(colors),
        }
    }
}

/// The smallest power of two at which so many bytes a cell fit.
fn step_for(space: &IndexBox, bytes: u64, budget: u64) -> i64 {
    let mut step = 1;
    loop {
        let n = cells(space, step);
        let all = n
            .iter()
            .fold(bytes, |product, &n| product.saturating_mul(n));
        if all <= budget && n.iter().all(|&n| n <= u64::from(MAX_GRID_SIDE)) {
            return step;
        }
        // A single cell always fits a budget of some bytes.
        if n == [1; 3] {
            return step;
        }
        step *= 2;
    }
}

/// A grid by name.
fn open<'a>(list: &[Stored<'a>], name: &str) -> Result<Option<Volume<'a>>, String> {
    let Some(stored) = list.iter().find(|grid| grid.name == name) else {
        return Ok(None);
    };
    let volume = stored.open().map_err(|e| format!("grid {name:?}: {e}"))?;
    if volume.no_density {
        return Err(format!("grid {name:?} is not declared as a fog volume"));
    }
    Ok(Some(volume))
}

impl Importer<'_, '_> {
    pub(super) fn nanovdb(
        &mut self,
        params: &Params,
        transform: DAffine3,
    ) -> Result<Medium, Issue> {
        let mut medium = self.basic(params)?;
        let Some(filename) = params.text_opt("filename")? else {
            return params.fail("a medium of type \"nanovdb\" needs \"filename\"");
        };
        let density_name = params.text("gridname", "density")?;
        let heat_name = params.text("temperaturename", "temperature")?;
        // Older files write it so.
        let level = params.float("LeScale", 1.0)?;
        let level = params.float("Lescale", level)?.max(0.0);
        let old = params.float("temperaturecutoff", 0.0)?;
        let offset = params.float("temperatureoffset", old)?;
        let factor = params.float("temperaturescale", 1.0)?;
        let path = self.cx.path(&params.place, filename)?;
        let bytes = match self.cx.assets.read(&path) {
            Ok(bytes) => bytes,
            Err(AssetError::NotFound { .. }) if self.cx.allows_missing() => {
                self.cx.warn(
                    &params.place,
                    format!(
                        "{path}: no such file; a medium of density 1 everywhere stands in for it"
                    ),
                );
                return Ok(medium);
            }
            Err(error) => return params.fail(error.to_string()),
        };
        let here = Place {
            file: path,
            ..Place::default()
        };
        let damaged = |e: String| Issue::new(&here, format!("{e} (used at {})", params.place));
        self.cx.charge(&params.place, bytes.len() as u64)?;
        let list = nanovdb::grids(&bytes).map_err(damaged)?;
        let mut unpacked = 0;
        for grid in &list {
            if grid.name == density_name || grid.name == heat_name {
                unpacked += grid.memory_bytes();
            }
        }
        self.cx.charge(&params.place, unpacked)?;
        let Some(density) = open(&list, density_name).map_err(damaged)? else {
            let names: Vec<&str> = list.iter().map(|grid| grid.name.as_str()).collect();
            return Err(damaged(format!(
                "no grid {density_name:?}; the file has {names:?}"
            )));
        };
        let heat = if level > 0.0 {
            open(&list, heat_name).map_err(damaged)?
        } else {
            None
        };
        if heat.is_none() && params.has("temperaturename") {
            self.cx.warn(
                &params.place,
                format!("no grid {heat_name:?} in the file: the medium does not glow"),
            );
        }
        let Some(mut space) = density.active else {
            self.cx.warn(&here, "a grid without active voxels");
            self.cx.release(bytes.len() as u64 + unpacked);
            medium.sigma_a = [0.0; 3];
            medium.sigma_s = [0.0; 3];
            return Ok(medium);
        };
        // The density falls off up to the voxels beyond the last ones, as in pbrt.
        space[1] = space[1].map(|x| x + 1);
        let own = if heat.is_some() { 16 } else { 4 };
        // A small file with a voxel at each end of the world is not worth a large grid.
        let worth = (bytes.len() as u64).saturating_mul(256).max(64 << 20);
        let budget = MAX_VOLUME_BYTES.min(self.cx.remaining()).min(worth);
        let step = step_for(&space, own, budget);
        if step > 1 {
            let [x, y, z] = cells(&space, 1);
            self.cx.warn(
                &params.place,
                format!(
                    "a volume of {x} x {y} x {z} voxels is read at 1/{step} of its resolution: whole, it \
                     would need more than the limit of {} MiB",
                    budget >> 20
                ),
            );
        }
        let (size, mut values) = density.dense(&space, step).map_err(damaged)?;
        let cells = values.len() as u64;
        let shine = if heat.is_some() {
            Glowing::bytes(cells)
        } else {
            0
        };
        self.cx.charge(&params.place, cells * 4 + shine)?;
        let mut unfit = 0usize;
        for value in &mut values {
            if !(*value >= 0.0 && value.is_finite()) {
                unfit += 1;
                *value = 0.0;
            }
        }
        if unfit > 0 {
            self.cx.warn(
                &here,
                format!("{unfit} densities that are negative or not finite count as 0"),
            );
        }
        let emission = match heat {
            None => None,
            Some(heat) => {
                let own = Cells { space, step, size };
                let all = temperatures(&heat, &density, &own, budget).map_err(damaged)?;
                let glowing = Glowing {
                    size,
                    level: vec![1.0; all.len()],
                    kelvin: (all.iter())
                        .map(|&t| ((f64::from(t) - offset) * factor) as f32)
                        .collect(),
                };
                medium.emission = [level as f32; 3];
                Some(Arc::new(glowing.grid()))
            }
        };
        let to_medium = density.to_medium;
        self.cx.release(bytes.len() as u64 + unpacked);
        let low = space[0].map(|x| x as f32 - 0.5);
        let high = std::array::from_fn(|i| low[i] + (i64::from(size[i]) * step) as f32);
        let density = Arc::new(Grid {
            size,
            values: GridValues::Scalar(values),
        });
        medium.grid = Some(MediumGrid {
            transform: transform * to_medium,
            bounds: [low, high],
            absorption: density.clone(),
            scattering: density,
            emission,
        });
        Ok(medium)
    }
}

/// Temperatures at the cells of the density, which are all that count: nothing else glows.
fn temperatures(
    heat: &Volume<'_>,
    density: &Volume<'_>,
    own: &Cells,
    budget: u64,
) -> Result<Vec<f32>, String> {
    if heat.to_medium == density.to_medium {
        return Ok(heat.dense(&own.space, own.step)?.1);
    }
    // Of a grid without voxels, the background is everywhere.
    let space = heat.active.unwrap_or_default();
    let step = step_for(&space, 4, budget);
    let (size, values) = heat.dense(&space, step)?;
    let there = Cells { space, step, size };
    let map = heat.to_medium.inverse() * density.to_medium;
    let mut out = Vec::new();
    for z in 0..own.size[2] {
        for y in 0..own.size[1] {
            for x in 0..own.size[0] {
                let p = map.transform_point3(own.center([x, y, z]));
                out.push(there.lookup(&values, p, heat.background()));
            }
        }
    }
    Ok(out)
}
