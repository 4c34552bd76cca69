//! What a clear dielectric layer lets through, in tables.
//!
//! pbrt-v4 finds the value of a coated surface by a random walk between the layer's boundary and the
//! base, which makes the value itself noisy [PharrJakobHumphreys23, section 14.3]. Over a Lambertian base
//! the mean of that walk has a closed form, because the base forgets where light came from:
//!
//! f(wo, wi) = f_boundary(wo, wi) + T(wo) T(wi) / eta^2 * r / pi * sum over k < K of (r rho)^k
//!
//! T(w) is the part of the light from outside direction w that the boundary lets in and that reaches
//! the base: with a layer of optical depth t every traversal costs exp(-t / cos), also in a clear
//! medium (pbrt's layers always have an extinction of 1). By reciprocity the same T serves the way out.
//! rho is the part of the light leaving the base diffusely that the boundary reflects back to it, both
//! traversals included. K is the number of base hits within the depth limit. The boundary is a single
//! GGX boundary as in [`super::Dielectric`]; what it loses by shadowing is lost here too.
//!
//! What is matched is the walk. The estimator that pbrt evaluates for a given pair of directions
//! weights its two strategies with the density of leaving by `wi` where that of entering from `wi`
//! belongs, so over a rough boundary its mean exceeds that of its own walk: by 1 to 17 % at alpha 0.1,
//! most where `wi` grazes. A smooth boundary is not affected.
//!
//! T and rho are integrated once per layer by a fixed rule; anisotropic widths are replaced by their
//! geometric mean. A scattering medium (albedo > 0) is treated to first order in t: single scattering
//! exactly for smooth boundaries, and what scatters forward continues as if nothing had happened.

use super::ggx::mirrored;
use super::{Ggx, fresnel_dielectric};
use crate::math::{INV_4PI, Rgb, dot, exp, lerp, safe_sqrt, sqr};
use glam::{Vec2, Vec3};

/// Cells over the cosine. Linear interpolation of T is worst near the horizon of a smooth boundary.
const CELLS: usize = 128;
/// Directions for one entry of a rough layer's table.
const POINTS: u32 = 224;
/// Widths of a metal base.
const WIDTHS: usize = 9;
/// Cosines inside the layer for a metal base.
const COSINES: usize = 16;

/// One entry, for one cosine outside.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
struct Cell {
    /// T.
    t: f32,
    /// T without attenuation.
    t_clear: f32,
    /// Albedo of the boundary's reflection.
    spec: f32,
    /// See [`CoatTable::mirror_factor`].
    mirror: f32,
}

/// A dielectric layer, tabulated; see the module's documentation.
#[derive(Clone, Debug, PartialEq)]
pub struct CoatTable {
    cells: Box<[Cell]>,
    /// Mean of T over the hemisphere, weighted by the cosine.
    t_mean: f32,
    rho: Rgb,
    ior: f32,
    thickness: f32,
    g: f32,
    medium: Rgb,
    /// Hits of the base that the depth limit allows: K.
    hits: u32,
    /// See [`CoatTable::again`]; over cosines from `critical` to 1.
    again: Box<[[Again; COSINES + 1]; WIDTHS]>,
    /// Cosine inside of the direction that leaves along the surface.
    critical: f32,
}

/// What further hits of a metal base add; see [`CoatTable::again`].
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct Again {
    /// Light that escapes after the second hit, over what the widened lobe lets escape.
    pub second: f32,
    /// Light that escapes after the third hit over that after the second.
    pub ratio: f32,
}

/// The i-th of n points of the unit square: Hammersley's.
pub(super) fn hammersley(i: u32, n: u32) -> Vec2 {
    Vec2::new(
        (i as f32 + 0.5) / n as f32,
        (i.reverse_bits() >> 8) as f32 / 16_777_216.0 + 0.5 / n as f32,
    )
}

/// Direction above with this cosine.
pub(super) fn at_cosine(cos: f32) -> Vec3 {
    Vec3::new(safe_sqrt(1.0 - cos * cos), 0.0, cos)
}

#[inline]
fn refracted(w: Vec3, ior: f32) -> Option<Vec3> {
    let inv = 1.0 / ior;
    let z2 = 1.0 - (1.0 - w.z * w.z) * (inv * inv);
    if z2 <= 0.0 {
        return None;
    }
    Some(Vec3::new(w.x * inv, w.y * inv, z2.sqrt()))
}

/// How far a tilt of the boundary's facet turns the refracted direction, squared, in the plane of
/// incidence: 1 - cos / (eta cos inside).
#[inline]
pub(super) fn bend(w: Vec3, inner: Vec3, ior: f32) -> f32 {
    sqr(1.0 - w.z / (ior * inner.z))
}

/// A metal's lobe, widened by what crossing a rough boundary twice bends; half of it tilts the half vector.
#[inline]
pub(super) fn spread(base: Ggx, boundary: Ggx, bend: f32) -> Ggx {
    if boundary.is_smooth() {
        return base;
    }
    let (cx, cy) = boundary.widths();
    let s = 0.5 * bend;
    base.widened(1.0, s * cx * cx, s * cy * cy)
}

/// Attenuation of one traversal.
#[inline]
fn attenuation(thickness: f32, cos: f32) -> f32 {
    if cos > 0.0 {
        exp(-thickness / cos)
    } else {
        0.0
    }
}

impl CoatTable {
    /// With the index of refraction inside over outside, the GGX widths of the boundary, the optical
    /// depth of the layer, the asymmetry g and albedo of its medium, and the depth limit of pbrt's
    /// walk (in crossings of the layer). Takes a few milliseconds; deterministic.
    pub fn new(
        ior: f32,
        alpha_x: f32,
        alpha_y: f32,
        thickness: f32,
        g: f32,
        medium_albedo: Rgb,
        max_depth: u32,
    ) -> Self {
        let ior = if ior > 0.0 { ior } else { 1.0 };
        let alpha = if ior == 1.0 {
            0.0
        } else {
            (alpha_x * alpha_y)
                .sqrt()
                .max(if alpha_x.max(alpha_y) < super::ggx::SMOOTH {
                    0.0
                } else {
                    super::ggx::SMOOTH
                })
        };
        let boundary = Boundary {
            ior,
            ggx: Ggx::new(alpha, alpha),
            thickness: thickness.max(0.0),
        };
        let inside = boundary.splits_inside();
        let mut cells: Box<[Cell]> = (0..=CELLS)
            .map(|i| boundary.seen_from_outside(i as f32 / CELLS as f32, &inside))
            .collect();
        boundary.compare_mirrors(&mut cells);
        let mut t_mean = 0.0;
        for i in 0..CELLS {
            // 2 t(c) c over a cell, t linear in it.
            let (a, b) = (cells[i].t, cells[i + 1].t);
            let (x, h) = (i as f32 / CELLS as f32, 1.0 / CELLS as f32);
            t_mean += h * (x * (a + b) + h * (a + 2.0 * b) * (1.0 / 3.0));
        }
        let (rho, rho_clear, passed) = boundary.seen_from_inside();
        let forward = 0.5 * (1.0 + g.clamp(-1.0, 1.0));
        // Scattered forward counts as not scattered; scattered back, from the base to the base.
        let rho = Rgb::splat(rho)
            + medium_albedo * (forward * (rho_clear - rho) + (1.0 - forward) * (1.0 - passed));
        CoatTable {
            cells,
            t_mean,
            rho,
            ior,
            thickness: boundary.thickness,
            g: g.clamp(-0.99, 0.99),
            medium: medium_albedo,
            hits: max_depth.div_ceil(2),
            again: boundary.again(&inside),
            critical: boundary.critical(),
        }
    }

    #[inline]
    fn cell(&self, cos: f32) -> Cell {
        let x = cos * CELLS as f32;
        let i = (x as usize).min(CELLS - 1);
        let f = x - i as f32;
        let (a, b) = (self.cells[i], self.cells[i + 1]);
        Cell {
            t: a.t + (b.t - a.t) * f,
            t_clear: a.t_clear + (b.t_clear - a.t_clear) * f,
            spec: a.spec + (b.spec - a.spec) * f,
            mirror: a.mirror + (b.mirror - a.mirror) * f,
        }
    }

    /// T for a direction with this cosine outside.
    #[inline]
    pub(super) fn transmittance(&self, cos: f32) -> f32 {
        self.cell(cos).t
    }

    /// T, and the albedo of the boundary's own reflection.
    #[inline]
    pub(super) fn transmittance_and_reflection(&self, cos: f32) -> (f32, f32) {
        let c = self.cell(cos);
        (c.t, c.spec)
    }

    /// What T for a direction has to be multiplied by where the base is a mirror: if the boundary is rough,
    /// T(wo) T(wi) is not what gets in, is mirrored and gets out, because the base does not forget; 1
    /// for a smooth boundary.
    #[inline]
    pub(super) fn mirror_factor(&self, cos: f32) -> f32 {
        self.cell(cos).mirror
    }

    /// Cosine-weighted mean of T.
    #[inline]
    pub(super) fn transmittance_mean(&self) -> f32 {
        self.t_mean
    }

    /// Index of refraction inside over outside.
    #[inline]
    pub(super) fn ior(&self) -> f32 {
        self.ior
    }

    /// Hits of the base within the depth limit.
    #[inline]
    pub(super) fn hits(&self) -> u32 {
        self.hits
    }

    /// Attenuation of one traversal in a direction with this cosine inside.
    #[inline]
    pub(super) fn attenuation(&self, cos: f32) -> f32 {
        attenuation(self.thickness, cos)
    }

    /// Whether the layer's medium scatters.
    #[inline]
    pub(super) fn is_hazy(&self) -> bool {
        self.medium != Rgb::ZERO
    }

    /// r times the sum over k < K of (r rho)^k.
    #[inline]
    pub(super) fn base(&self, r: Rgb) -> Rgb {
        // Where it is long, the series has converged.
        let q = r * self.rho;
        let mut sum = Rgb::ZERO;
        for _ in 0..self.hits.min(24) {
            sum = sum * q + Rgb::ONE;
        }
        r * sum
    }

    /// The direction inside the layer that an outside direction refracts to, both pointing up.
    #[inline]
    pub(super) fn refracted(&self, w: Vec3) -> Option<Vec3> {
        refracted(w, self.ior)
    }

    /// T for both directions of a hazy layer, by channel, and the medium's own single scattering
    /// (without the cosine of `wi`).
    ///
    /// Single scattering of a slab with extinction 1 [Chandrasekhar60, section 5.2]: with o, i the cosines
    /// inside, p / (o + i) (1 - exp(-t (1/o + 1/i))), p the phase function.
    pub(super) fn hazy(&self, wo: Vec3, wi: Vec3) -> (Rgb, Rgb) {
        let (o, i) = (self.cell(wo.z), self.cell(wi.z));
        let forward = self.medium * (0.5 * (1.0 + self.g));
        let through = |c: Cell| Rgb::splat(c.t) + forward * (c.t_clear - c.t);
        let single = match (self.refracted(wo), self.refracted(wi)) {
            (Some(a), Some(b)) => {
                // Both point up, light goes down along -wi and up along wo.
                let cos = -dot(a, b);
                let g = self.g;
                let d = 1.0 + g * g - 2.0 * g * cos;
                let phase = INV_4PI * (1.0 - g * g) / (d * d.sqrt());
                let lost = 1.0 - exp(-self.thickness * (1.0 / a.z + 1.0 / b.z));
                let s = o.t_clear * i.t_clear / sqr(self.ior) * phase * lost / (a.z + b.z);
                self.medium * s
            }
            _ => Rgb::ZERO,
        };
        (through(o) * through(i), single)
    }

    /// Light that hits a perfectly reflecting metal base of width `alpha` more than once, having come from
    /// the direction with this cosine inside the layer.
    #[inline]
    pub(super) fn again(&self, alpha: f32, cos: f32) -> Again {
        let a = alpha.min(1.0) * (WIDTHS - 1) as f32;
        let ia = (a as usize).min(WIDTHS - 2);
        let fa = a - ia as f32;
        let c = ((cos - self.critical) / (1.0 - self.critical)).max(0.0) * COSINES as f32;
        let ic = (c as usize).min(COSINES - 1);
        let fc = c - ic as f32;
        let mix = |a: Again, b: Again, t: f32| Again {
            second: lerp(a.second, b.second, t),
            ratio: lerp(a.ratio, b.ratio, t),
        };
        let row = |i: usize| mix(self.again[i][ic], self.again[i][ic + 1], fc);
        mix(row(ia), row(ia + 1), fa)
    }
}

/// Cells over the cosine inside.
const INSIDE: usize = 32;

/// How the boundary splits light from inside, for cosines from 0 to 1: reflected and transmitted.
struct Inside {
    reflected: [f32; INSIDE + 1],
    transmitted: [f32; INSIDE + 1],
}

/// Linear interpolation in a table over [0, 1].
fn interpolate(table: &[f32; INSIDE + 1], x: f32) -> f32 {
    let x = x * INSIDE as f32;
    let i = (x as usize).min(INSIDE - 1);
    lerp(table[i], table[i + 1], x - i as f32)
}

/// The layer while its tables are made.
struct Boundary {
    ior: f32,
    ggx: Ggx,
    thickness: f32,
}

impl Boundary {
    /// The table's entry for light from outside.
    fn seen_from_outside(&self, cos: f32, inside: &Inside) -> Cell {
        if self.ggx.is_smooth() {
            let (r, cos_t) = fresnel_dielectric(cos, self.ior);
            return Cell {
                t: (1.0 - r) * attenuation(self.thickness, cos_t),
                t_clear: 1.0 - r,
                spec: r,
                mirror: 1.0,
            };
        }
        let wo = at_cosine(cos.max(1e-3));
        let mut sum = Cell::default();
        for i in 0..POINTS {
            let m = self.ggx.sample_visible(wo, hammersley(i, POINTS));
            let c = dot(wo, m);
            let (r, cos_t) = fresnel_dielectric(c, self.ior);
            let up = mirrored(wo, m);
            if up.z > 0.0 {
                sum.spec += r * self.ggx.shadowing(wo, up);
            }
            let down = m * (c / self.ior - cos_t) - wo * (1.0 / self.ior);
            if r < 1.0 && down.z < 0.0 {
                let t = (1.0 - r) * self.ggx.shadowing(wo, -down);
                let a = attenuation(self.thickness, -down.z);
                sum.t_clear += t;
                sum.t += t * a;
                sum.mirror += t * a * a * interpolate(&inside.transmitted, -down.z);
            }
        }
        let n = 1.0 / POINTS as f32;
        let t = sum.t * n;
        Cell {
            mirror: sum.mirror * n,
            t,
            t_clear: sum.t_clear * n,
            spec: sum.spec * n,
        }
    }

    /// For light that leaves the base diffusely: rho, rho without attenuation, and the part that
    /// reaches the boundary.
    fn seen_from_inside(&self) -> (f32, f32, f32) {
        let eta = 1.0 / self.ior;
        let (mut rho, mut rho_clear, mut passed) = (0.0, 0.0, 0.0);
        let strata = if self.ggx.is_smooth() { 1024 } else { 64 };
        for j in 0..strata {
            // Cosine-weighted: cos^2 is uniform.
            let cos = ((j as f32 + 0.5) / strata as f32).sqrt();
            let a = attenuation(self.thickness, cos);
            passed += a;
            if self.ggx.is_smooth() {
                let (r, _) = fresnel_dielectric(cos, eta);
                rho += r * a * a;
                rho_clear += r;
                continue;
            }
            let wo = at_cosine(cos);
            let (mut sum, mut clear) = (0.0, 0.0);
            for i in 0..POINTS {
                let m = self.ggx.sample_visible(wo, hammersley(i, POINTS));
                let back = mirrored(wo, m);
                if back.z > 0.0 {
                    let (r, _) = fresnel_dielectric(dot(wo, m), eta);
                    let r = r * self.ggx.shadowing(wo, back);
                    clear += r;
                    sum += r * attenuation(self.thickness, back.z);
                }
            }
            rho += sum * a / POINTS as f32;
            rho_clear += clear / POINTS as f32;
        }
        let n = 1.0 / strata as f32;
        (rho * n, rho_clear * n, passed * n)
    }

    /// Turns what a mirror below a rough boundary sends out into the factor that makes T(wo) T(wi) times
    /// the widened lobe of [`super::CoatedConductor`] send out as much.
    fn compare_mirrors(&self, cells: &mut [Cell]) {
        const N: u32 = 96;
        if self.ggx.is_smooth() {
            return;
        }
        let t: Vec<f32> = cells.iter().map(|c| c.t).collect();
        for (i, cell) in cells.iter_mut().enumerate() {
            let wo = at_cosine((i as f32 / CELLS as f32).max(1e-3));
            let mut sum = 0.0;
            if let Some(inner) = refracted(wo, self.ior) {
                let lobe = spread(Ggx::new(0.0, 0.0), self.ggx, bend(wo, inner, self.ior));
                for k in 0..N {
                    let w = mirrored(inner, lobe.sample_visible(inner, hammersley(k, N)));
                    let z2 = 1.0 - (1.0 - w.z * w.z) * sqr(self.ior);
                    if w.z > 0.0 && z2 > 0.0 {
                        let x = z2.sqrt() * CELLS as f32;
                        let j = (x as usize).min(CELLS - 1);
                        sum += lobe.shadowing(inner, w) * lerp(t[j], t[j + 1], x - j as f32);
                    }
                }
            }
            let ours = cell.t * sum / N as f32;
            cell.mirror = if ours > 0.0 {
                (cell.mirror / ours).sqrt().min(2.0)
            } else {
                1.0
            };
        }
    }

    fn critical(&self) -> f32 {
        safe_sqrt(1.0 - 1.0 / sqr(self.ior)).min(0.999)
    }

    fn splits_inside(&self) -> Inside {
        let eta = 1.0 / self.ior;
        let mut inside = Inside {
            reflected: [0.0; INSIDE + 1],
            transmitted: [0.0; INSIDE + 1],
        };
        for j in 0..=INSIDE {
            let cos = (j as f32 / INSIDE as f32).max(1e-3);
            let (r, t) = (&mut inside.reflected[j], &mut inside.transmitted[j]);
            if self.ggx.is_smooth() {
                *r = fresnel_dielectric(cos, eta).0;
                *t = 1.0 - *r;
                continue;
            }
            let wo = at_cosine(cos);
            for i in 0..POINTS {
                let m = self.ggx.sample_visible(wo, hammersley(i, POINTS));
                let c = dot(wo, m);
                let (f, cos_t) = fresnel_dielectric(c, eta);
                let back = mirrored(wo, m);
                if back.z > 0.0 {
                    *r += f * self.ggx.shadowing(wo, back) / POINTS as f32;
                }
                let out = m * (c / eta - cos_t) - wo * (1.0 / eta);
                if f < 1.0 && out.z < 0.0 {
                    *t += (1.0 - f) * self.ggx.shadowing(wo, -out) / POINTS as f32;
                }
            }
        }
        inside
    }

    /// See [`CoatTable::again`]. Only cosines matter for the energy: with e what escapes, r what returns
    /// (both with attenuation) and K the lobe, the escaping light after hits 1, 2, 3 is K e, K r K e,
    /// K r K r K e.
    fn again(&self, inside: &Inside) -> Box<[[Again; COSINES + 1]; WIDTHS]> {
        const N: u32 = 64;
        let mut table = Box::new([[Again::default(); COSINES + 1]; WIDTHS]);
        let split = |cos: f32| {
            if self.ggx.is_smooth() {
                fresnel_dielectric(cos, 1.0 / self.ior).0
            } else {
                interpolate(&inside.reflected, cos)
            }
        };
        let returns = |cos: f32| split(cos) * sqr(attenuation(self.thickness, cos));
        let escapes = |cos: f32| {
            let t = if self.ggx.is_smooth() {
                1.0 - split(cos)
            } else {
                interpolate(&inside.transmitted, cos)
            };
            t * attenuation(self.thickness, cos)
        };
        for (i, row) in table.iter_mut().enumerate() {
            let alpha = i as f32 / (WIDTHS - 1) as f32;
            let ggx = Ggx::new(alpha, alpha);
            // K f at one cosine.
            let scatter = |ggx: Ggx, cos: f32, f: &dyn Fn(f32) -> Vec2| {
                if ggx.is_smooth() {
                    return f(cos);
                }
                let wo = at_cosine(cos);
                let mut sum = Vec2::ZERO;
                for k in 0..N {
                    let w = mirrored(wo, ggx.sample_visible(wo, hammersley(k, N)));
                    if w.z > 0.0 {
                        sum += f(w.z) * ggx.shadowing(wo, w);
                    }
                }
                sum / N as f32
            };
            let nodes = |f: &dyn Fn(f32) -> f32| {
                let mut out = [0.0; INSIDE + 1];
                for (j, v) in out.iter_mut().enumerate() {
                    let cos = (j as f32 / INSIDE as f32).max(1e-3);
                    *v = scatter(ggx, cos, &|cos| Vec2::splat(f(cos))).x;
                }
                out
            };
            let first = nodes(&escapes);
            let second = nodes(&|cos| returns(cos) * interpolate(&first, cos));
            let wide = ggx.widened(2.0, 0.0, 0.0);
            for (j, entry) in row.iter_mut().enumerate() {
                let cos = lerp(self.critical(), 1.0, j as f32 / COSINES as f32).max(1e-3);
                let after = scatter(ggx, cos, &|cos| {
                    Vec2::new(interpolate(&first, cos), interpolate(&second, cos)) * returns(cos)
                });
                let shape = scatter(wide, cos, &|cos| Vec2::splat(escapes(cos))).x;
                *entry = Again {
                    second: after.x / shape.max(1e-3),
                    ratio: (after.y / after.x.max(1e-6)).min(1.0),
                };
            }
        }
        table
    }
}
