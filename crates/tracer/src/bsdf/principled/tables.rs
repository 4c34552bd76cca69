//! Directional albedos of microfacet lobes, tabulated once while a scene is prepared.
//!
//! A layer passes on what it does not reflect, so its albedo has to be known for every direction and
//! width. All integrals are of the form of the single-scattering GGX lobe with a factor for each facet,
//! taken by a fixed rule over visible normals [DupuyBenyoub23], and so the same on every machine. With
//! E(f) the albedo of a lobe whose facets reflect f(cos), a Fresnel curve f = f0 + (f90 - f0) t gives
//! E = f0 (E(1) - E(t)) + f90 E(t): one table of E(t) for each curve serves every colour.
//!
//! Widths are tabulated over the artist's roughness r = sqrt(alpha), cosines over their square roots:
//! both are where the albedo bends most. Anisotropic lobes look up the geometric mean of their widths.

use super::super::coat::{at_cosine, hammersley};
use super::super::fresnel_dielectric;
use super::super::ggx::{Ggx, mirrored};
use super::sheen;
use crate::math::{dot, lerp, sqr};
use glam::Vec3;
use rayon::prelude::*;
use std::sync::Arc;

/// Cells over the square root of the cosine.
const COSINES: usize = 64;
/// Cells over the roughness.
const WIDTHS: usize = 32;
/// Directions for one entry.
const POINTS: u32 = 160;

/// A function of the cosine and the roughness, bilinear.
#[derive(Clone, Debug, PartialEq)]
pub struct Albedo {
    cells: Box<[[f32; COSINES + 1]; WIDTHS + 1]>,
    /// Means over the hemisphere, weighted by the cosine.
    means: [f32; WIDTHS + 1],
}

/// Where a cosine or roughness lies in a table: cell and fraction.
#[inline]
fn place(x: f32, cells: usize) -> (usize, f32) {
    let x = x.clamp(0.0, 1.0) * cells as f32;
    let i = (x as usize).min(cells - 1);
    (i, x - i as f32)
}

impl Albedo {
    /// From its values at (cosine, roughness).
    fn new(f: impl Fn(f32, f32) -> f32 + Sync) -> Albedo {
        let mut cells = Box::new([[0.0; COSINES + 1]; WIDTHS + 1]);
        let mut means = [0.0; WIDTHS + 1];
        let rows = cells.par_iter_mut().zip(&mut means).enumerate();
        rows.for_each(|(i, (row, mean))| {
            let r = i as f32 / WIDTHS as f32;
            for (j, cell) in row.iter_mut().enumerate() {
                // Along the surface nothing is seen; the limit is taken a little above.
                let x = (j as f32 / COSINES as f32).max(0.2 / COSINES as f32);
                *cell = f(x * x, r);
            }
            // Simpson's rule for the integral of 2 c E(c) dc, c = x^2: 4 x^3 E dx.
            let mut sum = 0.0;
            for (j, cell) in row.iter().enumerate() {
                let x = j as f32 / COSINES as f32;
                let weight = match j {
                    0 | COSINES => 1.0,
                    _ if j % 2 == 1 => 4.0,
                    _ => 2.0,
                };
                sum += weight * 4.0 * x * x * x * cell;
            }
            *mean = sum / (3.0 * COSINES as f32);
        });
        Albedo { cells, means }
    }

    /// At a cosine and a roughness.
    #[inline]
    pub fn at(&self, cos: f32, roughness: f32) -> f32 {
        let (i, fi) = place(roughness, WIDTHS);
        let (j, fj) = place(cos.max(0.0).sqrt(), COSINES);
        let (a, b) = (&self.cells[i], &self.cells[i + 1]);
        lerp(lerp(a[j], a[j + 1], fj), lerp(b[j], b[j + 1], fj), fi)
    }

    /// Cosine-weighted mean over the hemisphere, [0, 1].
    #[inline]
    pub fn mean(&self, roughness: f32) -> f32 {
        let (i, fi) = place(roughness, WIDTHS);
        lerp(self.means[i], self.means[i + 1], fi)
    }
}

/// Albedo of a reflecting lobe whose facets reflect `f(cos)`.
fn reflected(cos: f32, roughness: f32, f: impl Fn(f32) -> f32) -> f32 {
    let ggx = Ggx::new(sqr(roughness), sqr(roughness));
    if ggx.is_smooth() {
        return f(cos);
    }
    let wo = at_cosine(cos);
    let mut sum = 0.0;
    for k in 0..POINTS {
        let m = ggx.sample_visible(wo, hammersley(k, POINTS));
        let wi = mirrored(wo, m);
        if wi.z > 0.0 {
            sum += f(dot(wo, m)) * ggx.shadowing(wo, wi);
        }
    }
    sum / POINTS as f32
}

/// Power that facets send to the other side, `f(cos)` each, bent by `eta` (far side over near side).
fn refracted(cos: f32, roughness: f32, eta: f32, f: impl Fn(f32) -> f32) -> f32 {
    let ggx = Ggx::new(sqr(roughness), sqr(roughness));
    let wo = at_cosine(cos);
    let one = |m: Vec3| {
        let c = dot(wo, m);
        let (r, cos_t) = fresnel_dielectric(c, eta);
        let down = m * (c / eta - cos_t) - wo * (1.0 / eta);
        if r >= 1.0 || down.z >= 0.0 {
            0.0
        } else if ggx.is_smooth() {
            f(c)
        } else {
            f(c) * ggx.shadowing(wo, -down)
        }
    };
    if ggx.is_smooth() {
        return one(Vec3::Z);
    }
    let sum: f32 = (0..POINTS)
        .map(|k| one(ggx.sample_visible(wo, hammersley(k, POINTS))))
        .sum();
    sum / POINTS as f32
}

/// Schlick's curve (1 - cos)^5 [Schlick94].
#[inline]
pub fn schlick(cos: f32) -> f32 {
    let m = (1.0 - cos).clamp(0.0, 1.0);
    let m2 = m * m;
    m2 * m2 * m
}

/// What depends on no material.
#[derive(Clone, Debug, PartialEq)]
pub struct Facets {
    /// Of perfectly reflecting facets: E(1).
    pub white: Albedo,
    /// E of Schlick's curve.
    pub schlick: Albedo,
    /// E of the term that darkens a metal's edge, cos (1 - cos)^6 [Kutz21].
    pub darkening: Albedo,
    /// Of the sheen, over its own roughness.
    pub sheen: Option<Albedo>,
}

impl Facets {
    /// Integrates, for some tens of milliseconds; the sheen's table, half of the work, only if it is needed.
    pub fn new(with_sheen: bool) -> Facets {
        Facets {
            white: Albedo::new(|cos, r| reflected(cos, r, |_| 1.0)),
            schlick: Albedo::new(|cos, r| reflected(cos, r, schlick)),
            darkening: Albedo::new(|cos, r| reflected(cos, r, |c| c * (1.0 - c) * schlick(c))),
            sheen: with_sheen.then(|| Albedo::new(sheen::albedo)),
        }
    }
}

/// A boundary seen from the side with the lower index of refraction, where nothing is totally reflected.
#[derive(Clone, Debug, PartialEq)]
pub struct Rare {
    /// Power bent through by facets that let through 1 - t.
    pub low: Albedo,
    /// The same for t.
    pub high: Albedo,
    /// E(t).
    pub reflected: Albedo,
}

/// How the reflectance of a boundary rises from normal incidence (0) to the horizon (1).
#[derive(Clone, Debug, PartialEq)]
pub struct Curve {
    /// Index of refraction inside over outside; infinite where the surface is described by its colours.
    eta: f32,
    /// Both faces of a sheet.
    pane: bool,
    /// Reflectance at normal incidence.
    pub f0: f32,
    /// E of the curve.
    pub albedo: Albedo,
    /// Where light is bent into a solid, or out of one that is thinner than its surroundings (`Rare`).
    pub rare: Option<Rare>,
    /// What facets reflect and transmit together from the denser side of a solid, where total reflection
    /// makes their shares steep.
    pub dense: Option<Albedo>,
}

impl Curve {
    /// With the index of refraction (0 stands for infinity), whether the surface is a sheet, and whether
    /// light passes into a solid.
    pub fn new(ior: f32, pane: bool, solid: bool) -> Curve {
        let eta = if ior > 0.0 { ior } else { f32::INFINITY };
        let r = if ior > 0.0 {
            sqr((ior - 1.0) / (ior + 1.0))
        } else {
            1.0
        };
        let mut curve = Curve {
            eta,
            pane,
            f0: if pane { 2.0 * r / (1.0 + r) } else { r },
            albedo: Albedo {
                cells: Box::new([[0.0; COSINES + 1]; WIDTHS + 1]),
                means: [0.0; WIDTHS + 1],
            },
            rare: None,
            dense: None,
        };
        curve.albedo = Albedo::new(|cos, r| reflected(cos, r, |c| curve.rise(c)));
        if solid && ior > 0.0 && !pane {
            let dense = ior.max(1.0 / ior);
            let f0 = curve.f0;
            let rise = move |c: f32| ((fresnel_dielectric(c, dense).0 - f0) / (1.0 - f0)).max(-1.0);
            curve.rare = Some(Rare {
                low: Albedo::new(|cos, r| refracted(cos, r, dense, |c| 1.0 - rise(c))),
                high: Albedo::new(|cos, r| refracted(cos, r, dense, rise)),
                reflected: Albedo::new(|cos, r| reflected(cos, r, rise)),
            });
            let eta = if ior > 1.0 { 1.0 / ior } else { ior };
            curve.dense = Some(Albedo::new(|cos, r| {
                let f = |c: f32| fresnel_dielectric(c, eta).0;
                reflected(cos, r, f) + refracted(cos, r, eta, |c| 1.0 - f(c))
            }));
        }
        curve
    }

    /// Inside over outside.
    #[inline]
    pub fn eta(&self) -> f32 {
        self.eta
    }

    /// t(cos), from outside.
    #[inline]
    pub fn rise(&self, cos: f32) -> f32 {
        if self.eta == f32::INFINITY {
            return schlick(cos);
        }
        let (r, _) = fresnel_dielectric(cos, self.eta);
        let r = if self.pane { 2.0 * r / (1.0 + r) } else { r };
        // Nothing rises where all is reflected, or nothing.
        if self.f0 < 1.0 {
            ((r - self.f0) / (1.0 - self.f0)).clamp(-1.0, 1.0)
        } else {
            0.0
        }
    }

    /// t(cos) from inside (1 under total reflection) and the cosine of the refracted direction.
    #[inline]
    pub fn rise_inside(&self, cos: f32) -> (f32, f32) {
        let (r, cos_t) = fresnel_dielectric(cos, 1.0 / self.eta);
        (((r - self.f0) / (1.0 - self.f0)).min(1.0), cos_t)
    }
}

/// Tables of one principled material; curves are shared between materials.
#[derive(Clone, Debug)]
pub struct PrincipledTables {
    /// What depends on no material.
    pub facets: Arc<Facets>,
    /// The dielectric's boundary.
    pub base: Arc<Curve>,
    /// The coat's.
    pub coat: Arc<Curve>,
}
