//! Values, densities and samples of the lobes of [`Principled`].

use super::super::ggx::mirrored;
use super::super::{BsdfSample, fresnel_dielectric};
use super::{Lobe, Principled, Split, View, sheen};
use crate::math::{Frame, INV_2PI, INV_PI, ONE_MINUS_EPSILON, Rgb, dot, length, mean};
use crate::sampling;
use glam::{Vec2, Vec3};

const NOTHING: (Rgb, f32) = (Rgb::ZERO, 0.0);

impl Principled<'_> {
    /// What a facet reflects and transmits of light at this cosine.
    #[inline]
    fn split(&self, view: &View, cos: f32) -> Split {
        let cos = cos.clamp(0.0, 1.0);
        let glass = self.glass();
        let mut reflect = Rgb::ZERO;
        if self.metallic > 0.0 {
            reflect += self.metal(cos) * self.metallic;
        }
        let mut transmit = Rgb::ZERO;
        if view.inside {
            if self.transmission < 1.0 {
                reflect += self.dielectric(cos) * self.opaque();
            }
            let r = self.dielectric_inside(cos);
            reflect += r * (glass * view.back);
            transmit = (Rgb::ONE - r) * self.base * view.through * glass;
        } else if self.metallic < 1.0 {
            let r = self.dielectric(cos);
            reflect += r * (self.opaque() + glass * view.back);
            if glass > 0.0 {
                transmit = (Rgb::ONE - r) * self.base * view.through * glass;
            }
        }
        let (r, t) = (mean(reflect), mean(transmit));
        Split {
            reflect,
            transmit,
            pr: if r + t > 0.0 { r / (r + t) } else { 1.0 },
        }
    }

    pub(crate) fn eval_pdf(&self, wo: Vec3, wi: Vec3) -> (Rgb, f32) {
        // Along the surface; products of smaller cosines would vanish.
        if wo.z.abs() < 1e-16 || wi.z.abs() < 1e-16 {
            return NOTHING;
        }
        let below = wo.z < 0.0;
        let view = self.view(wo.with_z(wo.z.abs()), below);
        let wi = if below { wi.with_z(-wi.z) } else { wi };
        self.value(&view, wo.with_z(wo.z.abs()), wi)
    }

    /// With `wo` above.
    fn value(&self, view: &View, wo: Vec3, wi: Vec3) -> (Rgb, f32) {
        if wi.z > 0.0 {
            self.reflected(view, wo, wi)
        } else {
            self.transmitted(view, wo, wi)
        }
    }

    fn reflected(&self, view: &View, wo: Vec3, wi: Vec3) -> (Rgb, f32) {
        let p = |lobe: Lobe| view.p[lobe as usize];
        let mut f = Rgb::ZERO;
        let mut pdf = 0.0;
        if p(Lobe::Coat) > 0.0 {
            let ggx = self.coat_ggx();
            if !ggx.is_smooth() {
                let frame = Frame::from_normal(view.coat_normal);
                let (o, i) = (frame.to_local(wo), frame.to_local(wi));
                if o.z > 0.0 && i.z > 0.0 {
                    let (d, density, cos) = ggx.reflection(o, i);
                    let (r, _) = fresnel_dielectric(cos, self.tables.coat.eta());
                    f += Rgb::splat(d * r * self.coat * view.under_sheen);
                    pdf += p(Lobe::Coat) * density;
                }
            }
        }
        if p(Lobe::Sheen) > 0.0 {
            let s = sheen::eval(wo, wi, sheen::width(self.sheen_roughness));
            f += self.sheen * s;
            pdf += p(Lobe::Sheen) * INV_2PI;
        }
        if !self.ggx.is_smooth() && p(Lobe::Facets) > 0.0 {
            let (d, density, cos) = self.ggx.reflection(wo, wi);
            let split = self.split(view, cos);
            f += split.reflect * (d * view.under_coat);
            pdf += p(Lobe::Facets) * split.pr * density;
        }
        if p(Lobe::Up) > 0.0 {
            let mut up = Rgb::ZERO;
            let white = self.tables.facets.white.at(wi.z, self.roughness);
            let opaque = self.opaque() * (1.0 - self.passing);
            if opaque > 0.0 {
                let to = 1.0 - self.specular_albedo(wi.z, white).max_element();
                up += self.base * (opaque * self.coupling(view.diffuse, to));
            }
            let lost = 1.0 - self.tables.facets.white.mean(self.roughness);
            if self.metallic > 0.0 && lost > 1e-5 {
                up += self.bounced() * (self.metallic * view.lost * (1.0 - white) / lost);
            }
            let cos = dot(view.base_normal, wi).max(0.0);
            f += up.max(Rgb::ZERO) * (cos * INV_PI * view.under_coat);
            pdf += p(Lobe::Up) * cos * INV_PI;
        }
        (f, pdf)
    }

    fn transmitted(&self, view: &View, wo: Vec3, wi: Vec3) -> (Rgb, f32) {
        let p = |lobe: Lobe| view.p[lobe as usize];
        let mut f = Rgb::ZERO;
        let mut pdf = 0.0;
        let zi = -wi.z;
        if p(Lobe::Down) > 0.0 {
            let white = self.tables.facets.white.at(zi, self.roughness);
            let to = 1.0 - self.specular_albedo(zi, white).max_element();
            let share = self.opaque() * self.passing * self.coupling(view.diffuse, to);
            f += self.below * (share * zi * INV_PI * view.under_coat).max(0.0);
            pdf += p(Lobe::Down) * zi * INV_PI;
        }
        if p(Lobe::Facets) == 0.0 || self.glass() == 0.0 || self.passes_straight() {
            return (f, pdf);
        }
        if self.thin {
            let (d, density, cos) = self.ggx.reflection(wo, wi.with_z(zi));
            let split = self.split(view, cos);
            f += split.transmit * (d * view.under_coat);
            pdf += p(Lobe::Facets) * (1.0 - split.pr) * density;
            return (f, pdf);
        }
        // The facet that refracts wo into wi: along wo + eta wi [Walter07, eq. 16].
        let eta = self.eta(view.inside);
        let h = wo + wi * eta;
        let len = length(h);
        if len == 0.0 {
            return (f, pdf);
        }
        let m = h * (if h.z < 0.0 { -1.0 } else { 1.0 } / len);
        let (cos_o, cos_i) = (dot(wo, m), dot(wi, m));
        if cos_o <= 0.0 || cos_i >= 0.0 {
            return (f, pdf);
        }
        let split = self.split(view, cos_o);
        let (lo, li) = (self.ggx.l(wo), self.ggx.l(wi));
        // Solid angle of normals per solid angle of wi, times wo.m [Walter07, eq. 17].
        let denom = cos_i + cos_o / eta;
        let dm = self.ggx.d(m) * cos_o * -cos_i / (denom * denom);
        let g = 2.0 * zi / ((zi * lo + wo.z * li) * eta * eta);
        f += split.transmit * (dm * g * view.under_coat);
        pdf += p(Lobe::Facets) * (1.0 - split.pr) * dm * 2.0 / (wo.z + lo);
        (f, pdf)
    }

    pub(crate) fn sample(&self, wo: Vec3, u_lobe: f32, u: Vec2) -> Option<BsdfSample> {
        if wo.z.abs() < 1e-16 {
            return None;
        }
        let below = wo.z < 0.0;
        let up = wo.with_z(wo.z.abs());
        let view = self.view(up, below);
        let (lobe, rest) = choose(&view.p, u_lobe)?;
        let p = view.p[lobe as usize];
        let s = match lobe {
            Lobe::Coat => self.sample_coat(&view, up, p, u)?,
            Lobe::Sheen => Picked::density(sampling::uniform_hemisphere(u)),
            Lobe::Up => {
                let w = sampling::cosine_hemisphere(u);
                if view.base_normal == Vec3::Z {
                    Picked::density(w)
                } else {
                    let wi = Frame::from_normal(view.base_normal).to_world(w);
                    if wi.z <= 0.0 {
                        return None;
                    }
                    Picked::density(wi)
                }
            }
            Lobe::Down => {
                let w = sampling::cosine_hemisphere(u);
                Picked::density(w.with_z(-w.z))
            }
            Lobe::Facets => self.sample_facets(&view, up, p, rest, u)?,
        };
        let (weight, pdf) = match s.known {
            Some(known) => known,
            None => {
                let (f, pdf) = self.value(&view, up, s.wi);
                if s.wi.z.abs() < 1e-16 || pdf <= 0.0 || !pdf.is_finite() {
                    return None;
                }
                (f * (1.0 / pdf), pdf)
            }
        };
        let transmitted = s.wi.z < 0.0;
        Some(BsdfSample {
            wi: if below { s.wi.with_z(-s.wi.z) } else { s.wi },
            weight,
            pdf,
            eta: if s.bent { self.eta(view.inside) } else { 1.0 },
            delta: s.known.is_some(),
            transmitted,
        })
    }

    fn sample_coat(&self, view: &View, wo: Vec3, p: f32, u: Vec2) -> Option<Picked> {
        let ggx = self.coat_ggx();
        if ggx.is_smooth() {
            let wi = mirrored(wo, view.coat_normal);
            let cos = dot(wo, view.coat_normal);
            let (r, _) = fresnel_dielectric(cos, self.tables.coat.eta());
            let weight = Rgb::splat(r * self.coat * view.under_sheen / p);
            return (wi.z > 0.0).then_some(Picked::mirror(wi, weight, p));
        }
        let frame = Frame::from_normal(view.coat_normal);
        let o = frame.to_local(wo);
        let i = mirrored(o, ggx.sample_visible(o, u));
        let wi = frame.to_world(i);
        (i.z > 0.0 && wi.z > 0.0).then_some(Picked::density(wi))
    }

    fn sample_facets(&self, view: &View, wo: Vec3, p: f32, u: f32, v: Vec2) -> Option<Picked> {
        let smooth = self.ggx.is_smooth();
        let m = if smooth {
            Vec3::Z
        } else {
            self.ggx.sample_visible(wo, v)
        };
        let cos = dot(wo, m);
        let split = self.split(view, cos);
        if u < split.pr {
            let wi = mirrored(wo, m);
            if wi.z <= 0.0 {
                return None;
            }
            if !smooth {
                return Some(Picked::density(wi));
            }
            let pdf = p * split.pr;
            return Some(Picked::mirror(
                wi,
                split.reflect * (view.under_coat / pdf),
                pdf,
            ));
        }
        let pdf = p * (1.0 - split.pr);
        let eta = self.eta(view.inside);
        let wi = if self.thin {
            let up = mirrored(wo, m);
            up.with_z(-up.z)
        } else {
            let (_, cos_t) = fresnel_dielectric(cos, eta);
            m * (cos / eta - cos_t) - wo * (1.0 / eta)
        };
        // Light that would leave on the wrong side is lost, as total reflection is not sampled.
        if wi.z >= 0.0 || pdf <= 0.0 {
            return None;
        }
        let mut picked = if self.passes_straight() {
            let shadowing = if smooth {
                1.0
            } else {
                self.ggx.shadowing(wo, -wi)
            };
            let scale = view.under_coat * shadowing / (pdf * eta * eta);
            Picked::mirror(wi, split.transmit * scale, pdf)
        } else {
            Picked::density(wi)
        };
        picked.bent = true;
        Some(picked)
    }
}

/// A direction that a lobe gave, above or below.
struct Picked {
    wi: Vec3,
    /// Of a delta lobe: weight and probability.
    known: Option<(Rgb, f32)>,
    /// It went into glass or out of it.
    bent: bool,
}

impl Picked {
    fn density(wi: Vec3) -> Picked {
        Picked {
            wi,
            known: None,
            bent: false,
        }
    }
    fn mirror(wi: Vec3, weight: Rgb, pdf: f32) -> Picked {
        Picked {
            known: Some((weight, pdf)),
            ..Picked::density(wi)
        }
    }
}

/// A lobe, and what the choice leaves of the uniform number.
#[inline]
fn choose(p: &[f32; 5], u: f32) -> Option<(Lobe, f32)> {
    const LOBES: [Lobe; 5] = [Lobe::Coat, Lobe::Sheen, Lobe::Up, Lobe::Facets, Lobe::Down];
    let mut rest = u;
    let mut last = None;
    for lobe in LOBES {
        let share = p[lobe as usize];
        if share <= 0.0 {
            continue;
        }
        if rest < share {
            return Some((lobe, (rest / share).min(ONE_MINUS_EPSILON)));
        }
        rest -= share;
        last = Some(lobe);
    }
    // Rounding left the number beyond the sum.
    last.map(|lobe| (lobe, ONE_MINUS_EPSILON))
}
