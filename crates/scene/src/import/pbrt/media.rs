//! Participating media: `MakeNamedMedium`, `MediumInterface`, and the inside of "subsurface" surfaces.

use super::params::{Kind, Params};
use super::presets::preset;
use super::spectra::Role;
use super::volume::Glowing;
use super::{Importer, nearest};
use crate::color;
use crate::context::Issue;
use crate::diagnostic::Place;
use crate::limits::MAX_CLOUDS;
use crate::model::{ColorTex, Grid, GridValues, Medium, MediumGrid, MediumId, Rgb};
use crate::noise;
use glam::{DAffine3, DVec3};
use std::sync::Arc;

pub(super) const MEDIA: [&str; 5] = ["cloud", "homogeneous", "nanovdb", "rgbgrid", "uniformgrid"];

/// Cells along an axis that a procedural cloud is tabulated in.
const CLOUD_CELLS: u32 = if cfg!(any(test, fuzzing)) { 16 } else { 96 };
/// What a body reflects whose reflectance is a texture, where that is not darker.
const BRIGHT: f32 = 0.9;
/// Most cells of a grid along one axis.
const SIDE_MAX: u32 = 4096;

/// Names of the media on both sides; empty is vacuum.
#[derive(Clone, Debug, Default, PartialEq)]
pub(super) struct Sides {
    pub inside: Arc<str>,
    pub outside: Arc<str>,
}

fn times(color: Rgb, factor: f64) -> Rgb {
    color.map(|c| (f64::from(c) * factor) as f32)
}

impl Importer<'_, '_> {
    pub(super) fn define_medium(&mut self, name: String, params: &Params) -> Result<(), Issue> {
        let Some(kind) = params.text_opt("type")? else {
            return params.fail(format!("medium {name:?} has no \"string type\""));
        };
        let place = params.place.clone();
        let ctm = self.graphics.ctm;
        if ctm[0] != ctm[1] {
            self.cx
                .warn(&place, "a moving medium stands still at its start");
        }
        let transform = super::matrix::affine(&ctm[0]).map_err(|e| Issue::new(&place, e))?;
        let mut medium = match kind {
            "homogeneous" => self.homogeneous(params)?,
            "uniformgrid" => self.uniform_grid(params, transform)?,
            "rgbgrid" => self.rgb_grid(params, transform)?,
            "cloud" => self.cloud(params, transform)?,
            "nanovdb" => self.nanovdb(params, transform)?,
            "heterogeneous" => {
                return params.fail(
                    "medium type \"heterogeneous\" is of pbrt-v3; pbrt-v4 has \"uniformgrid\"",
                );
            }
            other => {
                let near = crate::suggest::did_you_mean(other, MEDIA);
                return params.fail(format!("unknown medium type {other:?}{near}"));
            }
        };
        let numbers = [medium.sigma_a, medium.sigma_s, medium.emission];
        if !numbers.as_flattened().iter().all(|c| c.is_finite()) {
            return params.fail("a medium with coefficients too large for a number");
        }
        self.warn_unused(params, &format!("medium {kind:?}"));
        medium.name.clone_from(&name);
        if self.media_names.contains_key(&name) {
            return params.fail(format!("medium {name:?} is defined twice"));
        }
        let id = MediumId(self.media.len() as u32);
        self.media.push(medium);
        self.media_names.insert(name, id);
        Ok(())
    }

    /// A named medium; none for the empty name.
    pub(super) fn medium(&mut self, name: &str, place: &Place) -> Result<Option<MediumId>, Issue> {
        if name.is_empty() {
            return Ok(None);
        }
        match self.media_names.get(name) {
            Some(&id) => Ok(Some(id)),
            None => {
                let near = nearest(name, self.media_names.keys());
                Err(Issue::new(place, format!("unknown medium {name:?}{near}")))
            }
        }
    }

    /// A constant coefficient by name.
    fn coefficient(&mut self, params: &Params, name: &str) -> Result<Option<Rgb>, Issue> {
        match params.find(name, &super::spectra::SPECTRUM)? {
            Some(param) => self.color(params, param, Role::Unbounded).map(Some),
            None => Ok(None),
        }
    }

    fn asymmetry(params: &Params) -> Result<f32, Issue> {
        let g = params.float("g", 0.0)?;
        if g > -1.0 && g < 1.0 {
            Ok(g as f32)
        } else {
            params.fail(format!(
                "a phase function with asymmetry {g}; it lies between -1 and 1"
            ))
        }
    }

    /// `sigma_a`, `sigma_s`, `scale` and `g`, as all kinds but "rgbgrid" have them.
    pub(super) fn basic(&mut self, params: &Params) -> Result<Medium, Issue> {
        let scale = params.float("scale", 1.0)?;
        if scale < 0.0 {
            return params.fail("\"scale\" is negative");
        }
        let a = self.coefficient(params, "sigma_a")?.unwrap_or([1.0; 3]);
        let s = self.coefficient(params, "sigma_s")?.unwrap_or([1.0; 3]);
        Ok(Medium {
            name: String::new(),
            sigma_a: times(a, scale),
            sigma_s: times(s, scale),
            emission: [0.0; 3],
            g: Self::asymmetry(params)?,
            grid: None,
            translucent: None,
        })
    }

    fn homogeneous(&mut self, params: &Params) -> Result<Medium, Issue> {
        let mut medium = self.basic(params)?;
        if let Some(name) = params.text_opt("preset")? {
            match preset(name) {
                Some((sigma_a, sigma_s)) => {
                    let scale = params.float("scale", 1.0)?;
                    if params.has("sigma_a") || params.has("sigma_s") {
                        self.cx.warn(
                            &params.place,
                            "\"preset\" replaces \"sigma_a\" and \"sigma_s\", as in pbrt",
                        );
                    }
                    medium.sigma_a = times(sigma_a, scale);
                    medium.sigma_s = times(sigma_s, scale);
                }
                None => self.unknown_preset(params, name),
            }
        }
        if let Some(le) = self.emission(params, "Le")? {
            medium.emission = times(le, params.float("Lescale", 1.0)?.max(0.0));
        } else {
            params.ignore(&["Lescale"]);
        }
        Ok(medium)
    }

    fn unknown_preset(&mut self, params: &Params, name: &str) {
        let near = crate::suggest::did_you_mean(name, super::presets::names());
        self.cx.warn(
            &params.place,
            format!("unknown preset {name:?}{near}: sigma_a and sigma_s are used, as in pbrt"),
        );
    }

    /// Size of a grid and the box that it fills.
    fn grid_frame(params: &Params, cells: usize) -> Result<([u32; 3], [[f32; 3]; 2]), Issue> {
        let size = [
            params.count("nx", 1, 1..=SIDE_MAX)?,
            params.count("ny", 1, 1..=SIDE_MAX)?,
            params.count("nz", 1, 1..=SIDE_MAX)?,
        ];
        let wanted: u64 = size.iter().map(|&n| u64::from(n)).product();
        if wanted != cells as u64 {
            return params.fail(format!(
                "{cells} values for a grid of {} x {} x {} cells",
                size[0], size[1], size[2]
            ));
        }
        Ok((size, Self::bounds(params)?))
    }

    fn bounds(params: &Params) -> Result<[[f32; 3]; 2], Issue> {
        let p0 = DVec3::from_array(params.vector("p0", Kind::Point3, [0.0; 3])?);
        let p1 = DVec3::from_array(params.vector("p1", Kind::Point3, [1.0; 3])?);
        let corner = |p: DVec3| p.to_array().map(|x| x as f32);
        let (least, most) = (corner(p0.min(p1)), corner(p0.max(p1)));
        let open = least.iter().zip(most).all(|(a, b)| *a < b && b.is_finite());
        if !open {
            return params.fail("the box of the medium, \"p0\" to \"p1\", is empty");
        }
        Ok([least, most])
    }

    /// Numbers of a grid that must not be negative.
    fn values(params: &Params, name: &str) -> Result<Option<Vec<f32>>, Issue> {
        let Some(param) = params.floats(name)? else {
            return Ok(None);
        };
        if let Some(bad) = param.numbers().iter().find(|&&x| x < 0.0) {
            return param.fail(format!("has the negative value {bad}"));
        }
        let values = param.rows::<1>()?;
        Ok(Some(values.into_iter().map(|[x]| x).collect()))
    }

    fn uniform_grid(&mut self, params: &Params, transform: DAffine3) -> Result<Medium, Issue> {
        let mut medium = self.basic(params)?;
        let Some(density) = Self::values(params, "density")? else {
            return params.fail("a medium of type \"uniformgrid\" needs \"density\"");
        };
        let cells = density.len();
        let (size, bounds) = Self::grid_frame(params, cells)?;
        self.cx.charge(&params.place, cells as u64 * 4)?;
        let temperature = params.floats("temperature")?;
        let le = self.emission(params, "Le")?;
        if le.is_some() && temperature.is_some() {
            return params.fail("a medium has either \"Le\" or \"temperature\", not both");
        }
        let scale = Self::values(params, "Lescale")?;
        for (name, count) in [
            ("temperature", temperature.map(|t| t.numbers().len())),
            ("Lescale", scale.as_ref().map(Vec::len)),
        ] {
            if let Some(count) = count.filter(|&count| count != cells) {
                return params.fail(format!("{count} of {name:?} for {cells} of \"density\""));
            }
        }
        let level = |i: usize| scale.as_ref().map_or(1.0, |s| s[i]);
        let emission = if let Some(temperature) = temperature {
            let old = params.float("temperaturecutoff", 0.0)?;
            let offset = params.float("temperatureoffset", old)?;
            let factor = params.float("temperaturescale", 1.0)?;
            self.cx
                .charge(&params.place, Glowing::bytes(cells as u64))?;
            medium.emission = [1.0; 3];
            let glow = Glowing {
                size,
                kelvin: (temperature.numbers().iter())
                    .map(|t| ((t - offset) * factor) as f32)
                    .collect(),
                level: (0..cells).map(level).collect(),
            };
            Some(glow.grid())
        } else {
            params.ignore(&["temperaturecutoff", "temperatureoffset", "temperaturescale"]);
            medium.emission = le.unwrap_or([0.0; 3]);
            scale.map(|values| Grid {
                size,
                values: GridValues::Scalar(values),
            })
        };
        let density = Arc::new(Grid {
            size,
            values: GridValues::Scalar(density),
        });
        medium.grid = Some(MediumGrid {
            transform,
            bounds,
            absorption: density.clone(),
            scattering: density,
            emission: emission.map(Arc::new),
        });
        Ok(medium)
    }

    /// Colours of a grid that must not be negative.
    fn colors(params: &Params, name: &str) -> Result<Option<Vec<Rgb>>, Issue> {
        let Some(rows) = params.rows::<3>(name, &[Kind::Rgb])? else {
            return Ok(None);
        };
        if rows.as_flattened().iter().any(|&x| x < 0.0) {
            return params.fail(format!("{name:?} has a negative component"));
        }
        let convert = |row: Rgb| params.space.to_rec709(row.map(f64::from)).map(|c| c as f32);
        Ok(Some(rows.into_iter().map(convert).collect()))
    }

    fn rgb_grid(&mut self, params: &Params, transform: DAffine3) -> Result<Medium, Issue> {
        let scale = params.float("scale", 1.0)?;
        if scale < 0.0 {
            return params.fail("\"scale\" is negative");
        }
        let (a, s) = (
            Self::colors(params, "sigma_a")?,
            Self::colors(params, "sigma_s")?,
        );
        let le = Self::colors(params, "Le")?;
        let Some(cells) = a.as_ref().or(s.as_ref()).map(Vec::len) else {
            return params.fail("a medium of type \"rgbgrid\" needs \"sigma_a\" or \"sigma_s\"");
        };
        if le.is_some() && a.is_none() {
            return params.fail("\"Le\" of a medium of type \"rgbgrid\" needs \"sigma_a\"");
        }
        let (size, bounds) = Self::grid_frame(params, cells)?;
        for (name, list) in [("sigma_s", &s), ("Le", &le)] {
            if let Some(count) = list.as_ref().map(Vec::len).filter(|&n| n != cells) {
                return params.fail(format!("{count} of {name:?} for a grid of {cells} cells"));
            }
        }
        let lists = [&a, &s, &le].iter().filter(|l| l.is_some()).count() as u64;
        self.cx.charge(&params.place, cells as u64 * 12 * lists)?;
        let grid = |list: Option<Vec<Rgb>>| match list {
            Some(list) => Arc::new(Grid {
                size,
                values: GridValues::Rgb(list),
            }),
            // What is not given is 1 everywhere in the box, as in pbrt.
            None => Arc::new(Grid {
                size: [1; 3],
                values: GridValues::Scalar(vec![1.0]),
            }),
        };
        // Everywhere else pbrt divides a colour that shines by what its white stands for; here it does not.
        let level = params.float("Lescale", 1.0)?.max(0.0) * color::WHITE_Y;
        Ok(Medium {
            name: String::new(),
            sigma_a: times([1.0; 3], scale),
            sigma_s: times([1.0; 3], scale),
            emission: times([f32::from(u8::from(le.is_some())); 3], level),
            g: Self::asymmetry(params)?,
            grid: Some(MediumGrid {
                transform,
                bounds,
                absorption: grid(a),
                scattering: grid(s),
                emission: le.map(|le| grid(Some(le))),
            }),
            translucent: None,
        })
    }

    fn cloud(&mut self, params: &Params, transform: DAffine3) -> Result<Medium, Issue> {
        self.clouds += 1;
        if self.clouds > MAX_CLOUDS {
            return params.fail(format!(
                "more procedural clouds than the limit of {MAX_CLOUDS}"
            ));
        }
        let mut medium = self.basic(params)?;
        let density = params.float("density", 1.0)?;
        let wispiness = params.float("wispiness", 1.0)?;
        let frequency = params.float("frequency", 5.0)?;
        let bounds = Self::bounds(params)?;
        self.warn_once(
            &params.place,
            "a procedural cloud is tabulated in 96 x 96 x 96 cells: its finest wisps are lost",
        );
        let n = CLOUD_CELLS;
        self.cx.charge(&params.place, u64::from(n * n * n) * 4)?;
        let [least, most] = bounds.map(|p| DVec3::from_array(p.map(f64::from)));
        let center = |i: u32| (f64::from(i) + 0.5) / f64::from(n);
        let mut values = Vec::with_capacity((n * n * n) as usize);
        for z in 0..n {
            for y in 0..n {
                for x in 0..n {
                    let p = least + (most - least) * DVec3::new(center(x), center(y), center(z));
                    values.push(noise::cloud(p, density, wispiness, frequency) as f32);
                }
            }
        }
        let density = Arc::new(Grid {
            size: [n; 3],
            values: GridValues::Scalar(values),
        });
        medium.grid = Some(MediumGrid {
            transform,
            bounds,
            absorption: density.clone(),
            scattering: density,
            emission: None,
        });
        Ok(medium)
    }

    /// What a "subsurface" surface is filled with: pbrt's four ways to say it. Where a texture says what
    /// is reflected, the inside is the same everywhere, and light is tinted where it enters: by the
    /// texture times the factor.
    pub(super) fn interior(
        &mut self,
        params: &Params,
        ior: f32,
    ) -> Result<(MediumId, Option<(ColorTex, f32)>), Issue> {
        let scale = params.float("scale", 1.0)?;
        if scale < 0.0 {
            return params.fail("\"scale\" is negative");
        }
        let mut g = Self::asymmetry(params)?;
        let named = match params.text_opt("name")? {
            None => None,
            Some(name) => match preset(name) {
                Some(found) => {
                    if g != 0.0 {
                        self.cx.warn(
                            &params.place,
                            "\"g\" is left out: the coefficients of named media are reduced ones",
                        );
                    }
                    g = 0.0;
                    Some(found)
                }
                None => {
                    let near = crate::suggest::did_you_mean(name, super::presets::names());
                    return params.fail(format!("unknown named medium {name:?}{near}"));
                }
            },
        };
        let (a, s) = (
            self.interior_color(params, "sigma_a", Role::Unbounded)?,
            self.interior_color(params, "sigma_s", Role::Unbounded)?,
        );
        let reflectance = self.color_tex(params, "reflectance", Role::Albedo)?;
        let mfp = self.interior_color(params, "mfp", Role::Unbounded)?;
        let mut tint = None;
        let (sigma_a, sigma_s) = match (named, a, s, reflectance) {
            (Some((a, s)), ..) => (times(a, scale), times(s, scale)),
            (None, Some(a), Some(s), _) => (times(a, scale), times(s, scale)),
            (None, Some(_), None, _) => {
                return params.fail("\"sigma_a\" needs \"sigma_s\" beside it");
            }
            (None, None, Some(_), _) => {
                return params.fail("\"sigma_s\" needs \"sigma_a\" beside it");
            }
            (None, None, None, Some(reflectance)) => {
                let reflectance = match reflectance {
                    ColorTex::Const(color) => color,
                    texture => {
                        tint = Some((texture, 1.0 / BRIGHT));
                        [BRIGHT; 3]
                    }
                };
                // The free path is scaled, not the coefficients.
                let path = times(mfp.unwrap_or([1.0; 3]), scale);
                if path.iter().any(|&p| p <= 0.0) {
                    return params.fail("a mean free path of zero");
                }
                let albedo =
                    reflectance.map(|r| single_albedo(f64::from(r), f64::from(ior), f64::from(g)));
                let part = |f: &dyn Fn(usize) -> f64| -> Rgb {
                    std::array::from_fn(|i| (f(i) / f64::from(path[i])) as f32)
                };
                (part(&|i| 1.0 - albedo[i]), part(&|i| albedo[i]))
            }
            (None, None, None, None) => (
                times([0.0011, 0.0024, 0.014], scale),
                times([2.55, 3.21, 3.77], scale),
            ),
        };
        let mut name = format!("inside at {}", params.place);
        while self.media_names.contains_key(&name) {
            name.push('\'');
        }
        let id = MediumId(self.media.len() as u32);
        self.media_names.insert(name.clone(), id);
        self.media.push(Medium {
            name,
            sigma_a,
            sigma_s,
            emission: [0.0; 3],
            g,
            grid: None,
            translucent: Some(ior),
        });
        Ok((id, tint))
    }

    /// A colour that pbrt looks up on the surface; a medium is the same everywhere inside.
    fn interior_color(
        &mut self,
        params: &Params,
        name: &str,
        role: Role,
    ) -> Result<Option<Rgb>, Issue> {
        Ok(match self.color_tex(params, name, role)? {
            None => None,
            Some(ColorTex::Const(color)) => Some(color),
            Some(ColorTex::Texture(_)) => {
                self.cx.warn(
                    &params.place,
                    format!("{name:?} of a subsurface material as a texture is not supported: 0.5 is used everywhere"),
                );
                Some([0.5; 3])
            }
        })
    }
}

/// Diffuse reflectance of a semi-infinite medium by diffusion theory [Jensen01, eq. 14], which knows
/// that part of the light is thrown back inside by the border.
fn diffuse_reflectance(albedo: f64, ior: f64) -> f64 {
    // Mean Fresnel reflectance of the inside, a fit [Jensen01].
    let f = (-1.440 / (ior * ior) + 0.710 / ior + 0.668 + 0.0636 * ior).clamp(0.0, 0.99);
    let a = (1.0 + f) / (1.0 - f);
    let root = libm::sqrt(3.0 * (1.0 - albedo));
    0.5 * albedo * (1.0 + libm::exp(-4.0 / 3.0 * a * root)) * libm::exp(-root)
}

/// Single scattering albedo of the medium that shows a reflectance, by bisection: reflectance rises
/// with it. By similarity, an asymmetry `g` only changes what scattering counts for.
fn single_albedo(reflectance: f64, ior: f64, g: f64) -> f64 {
    let (mut low, mut high) = (0.0f64, 1.0f64);
    for _ in 0..60 {
        let middle = 0.5 * (low + high);
        if diffuse_reflectance(middle, ior) < reflectance {
            low = middle;
        } else {
            high = middle;
        }
    }
    let reduced = 0.5 * (low + high);
    reduced / (reduced + (1.0 - g) * (1.0 - reduced))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn albedos_invert_the_reflectance() {
        for ior in [1.0, 1.33, 1.5] {
            assert_eq!(diffuse_reflectance(1.0, ior), 1.0);
            for r in [0.0, 0.01, 0.3, 0.8, 0.99, 1.0] {
                let albedo = single_albedo(r, ior, 0.0);
                let back = diffuse_reflectance(albedo, ior);
                assert!((back - r).abs() < 1e-9, "{ior}, {r}: {albedo}, {back}");
            }
        }
        // The reduced albedo of a forward scattering medium is that of the isotropic one.
        let (isotropic, forward) = (single_albedo(0.5, 1.33, 0.0), single_albedo(0.5, 1.33, 0.8));
        let reduced = 0.2 * forward / (0.2 * forward + 1.0 - forward);
        assert!((reduced - isotropic).abs() < 1e-12);
    }
}
