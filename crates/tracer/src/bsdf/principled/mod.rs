//! Everyday surfaces in one: sheen over a clear coat over a base of metal, glass, translucent and opaque
//! dielectric, in the manner of OpenPBR, with the parameters of glTF.
//!
//! From the outside in, with E the albedo of a layer for `wo` (tables, see [`tables`]):
//!
//! f = sheen + (1 - E sheen) (coat + (1 - E coat) base)
//! base = metallic metal + (1 - metallic) (specular + (1 - transmission) diffuse + transmission glass)
//!
//! - Layers weaken what is below by the view's albedo alone, as glTF's clearcoat does: energy is kept
//!   exactly for every base, light may not travel backwards quite.
//! - Metal, specular and glass share their facets: one GGX lobe [Walter07], [Heitz14], whose facets
//!   reflect and transmit what the mixture of the three says.
//! - What bounces between the facets of a metal comes back in the lobe of [KullaConty17]. Of a
//!   dielectric it goes through: diffuse light below is scaled by (1 - E(o)) (1 - E(i)) / (1 - mean E),
//!   which is reciprocal and loses nothing, transmission by (1 - E(o)) over what the facets let through
//!   at once; inside glass both parts are scaled to lose nothing [Turquin19].
//! - Glass bends light and scales its radiance by 1 / eta^2; a thin surface is a sheet with two faces that
//!   spreads light by its roughness without bending it. Both tint by the base colour at each crossing.
//! - The dielectric's reflectance follows Fresnel's equations from f0 to f90, coloured and weighted as
//!   KHR_materials_specular says; an index of 0 stands for infinity, with Schlick's curve and no bending.
//! - Below a GGX width of 1e-3 facets and coat are perfect mirrors (delta lobes): smooth glass then has no
//!   noise of its own. Densities of all other lobes are added up (one-sample model [Veach95]).
//!
//! Seen from below, a solid that transmits is seen from inside, without coat and sheen; every other
//! surface looks the same from both sides.

mod film;
mod lobes;
mod sheen;
mod tables;

pub use tables::{Curve, Facets, PrincipledTables};

use super::Reach;
use super::ggx::Ggx;
use crate::math::{Rgb, mean, normalize, sqr};
use glam::Vec3;
use tables::schlick;

/// Parameters at a point; see [`scene::model::Principled`]. What is out of range is clamped.
#[derive(Clone, Copy, Debug)]
pub struct PrincipledParams {
    /// Albedo, metal's reflectance, tint of transmission.
    pub base_color: Rgb,
    /// [0, 1]
    pub metallic: f32,
    /// [0, 1]
    pub roughness: f32,
    /// [0, 1]; along x of the shading frame.
    pub anisotropy: f32,
    /// Weight of the dielectric reflection.
    pub specular: f32,
    /// Colour of it at normal incidence.
    pub specular_color: Rgb,
    /// Tint of a metal at 82 degrees.
    pub metal_edge: Rgb,
    /// [0, 1]
    pub transmission: f32,
    /// A sheet.
    pub thin: bool,
    /// [0, 1]
    pub diffuse_transmission: f32,
    /// Colour of it.
    pub diffuse_transmission_color: Rgb,
    /// Normal of the diffuse base, unit length, in the shading frame: where that was turned so that
    /// mirrored light leaves the surface, this one need not be.
    pub base_normal: Vec3,
    /// [0, 1]
    pub coat: f32,
    /// [0, 1]
    pub coat_roughness: f32,
    /// Unit length, in the shading frame.
    pub coat_normal: Vec3,
    /// Colour and strength, [0, 1].
    pub sheen_color: Rgb,
    /// [0, 1]
    pub sheen_roughness: f32,
    /// [0, 1]
    pub iridescence: f32,
    /// Of the film.
    pub iridescence_ior: f32,
    /// Nanometres.
    pub iridescence_thickness: f32,
}

impl Default for PrincipledParams {
    fn default() -> Self {
        PrincipledParams {
            base_color: Rgb::ONE,
            metallic: 0.0,
            roughness: 0.5,
            anisotropy: 0.0,
            specular: 1.0,
            specular_color: Rgb::ONE,
            metal_edge: Rgb::ONE,
            transmission: 0.0,
            thin: false,
            diffuse_transmission: 0.0,
            diffuse_transmission_color: Rgb::ONE,
            base_normal: Vec3::Z,
            coat: 0.0,
            coat_roughness: 0.0,
            coat_normal: Vec3::Z,
            sheen_color: Rgb::ZERO,
            sheen_roughness: 0.0,
            iridescence: 0.0,
            iridescence_ior: 1.3,
            iridescence_thickness: 400.0,
        }
    }
}

/// A layered surface at a point; see the module's documentation.
#[derive(Clone, Copy, Debug)]
pub struct Principled<'s> {
    tables: &'s PrincipledTables,
    /// Base colour.
    base: Rgb,
    /// Dielectric at normal incidence.
    f0: Rgb,
    /// At the horizon.
    f90: f32,
    /// Factor of the darkening term of a metal's curve [Kutz21, eq. 2].
    edge: Rgb,
    below: Rgb,
    sheen: Rgb,
    base_normal: Vec3,
    coat_normal: Vec3,
    ggx: Ggx,
    roughness: f32,
    metallic: f32,
    transmission: f32,
    /// Share of diffuse transmission in the diffuse base.
    passing: f32,
    coat: f32,
    coat_roughness: f32,
    sheen_roughness: f32,
    film: f32,
    film_ior: f32,
    film_thickness: f32,
    thin: bool,
}

/// What follows from the view direction alone.
struct View {
    /// The dielectric is seen from inside.
    inside: bool,
    /// What the sheen leaves.
    under_sheen: f32,
    /// What sheen and coat leave.
    under_coat: f32,
    /// Factor on what is transmitted, to make up for losses between facets.
    through: Rgb,
    /// The same for what glass reflects.
    back: f32,
    /// Normals of the base and of the coat on this side; the coat's bent so far that its mirror direction
    /// lies above the base.
    base_normal: Vec3,
    coat_normal: Vec3,
    /// 1 - albedo of the dielectric's reflection, and of perfectly reflecting facets.
    diffuse: f32,
    lost: f32,
    /// Probabilities of the lobes, see [`Lobe`].
    p: [f32; 5],
    /// Albedo.
    albedo: Rgb,
}

/// Lobes in the order in which the uniform number chooses: what transmits comes last.
#[derive(Clone, Copy, PartialEq)]
enum Lobe {
    Coat = 0,
    Sheen = 1,
    /// Diffuse reflection, and light that has bounced between a metal's facets.
    Up = 2,
    /// The facets of metal, specular and glass.
    Facets = 3,
    /// Diffuse transmission.
    Down = 4,
}

/// How a facet splits light.
struct Split {
    reflect: Rgb,
    /// Without the scaling of radiance.
    transmit: Rgb,
    /// Probability of reflection.
    pr: f32,
}

/// A normal turned so far towards `up` that the mirror direction of `wo` lies above the plane of `up`:
/// what is mirrored below it would be lost. `wo` and `normal` lie on the same side.
#[inline]
pub(crate) fn lifted(wo: Vec3, normal: Vec3, up: Vec3) -> Vec3 {
    const LEAST: f32 = 0.01;
    let mirror = normal * (2.0 * wo.dot(normal)) - wo;
    let height = mirror.dot(up);
    if height >= LEAST {
        return normal;
    }
    let half = wo + normalize(mirror + up * (LEAST - height));
    if half.dot(up) > 1e-4 {
        normalize(half)
    } else {
        up
    }
}

/// cos (1 - cos)^6 at the cosine 1/7, where the darkening term is largest, and (1 - cos)^5 there.
const DARKEST: (f32, f32) = (0.056_652_83, 0.462_664_37);

/// Indices closer to 1 bend nothing.
const BEND_MIN: f32 = 1e-3;

impl<'s> Principled<'s> {
    /// With the parameters at a point.
    pub fn new(tables: &'s PrincipledTables, p: &PrincipledParams) -> Self {
        let unit = |x: f32| x.clamp(0.0, 1.0);
        let colour = |c: Rgb| c.clamp(Rgb::ZERO, Rgb::ONE);
        let base = colour(p.base_color);
        let roughness = unit(p.roughness);
        let across = sqr(roughness);
        let along = across + (1.0 - across) * sqr(unit(p.anisotropy));
        let ggx = Ggx::new(along, across);
        let specular = unit(p.specular);
        let transmission = unit(p.transmission);
        let r = if p.thin {
            // The table's curve is that of two faces; the colour counts for one.
            tables.base.f0 / (2.0 - tables.base.f0)
        } else {
            tables.base.f0
        };
        let one_face = (p.specular_color.max(Rgb::ZERO) * r).min(Rgb::ONE) * specular;
        let (mut f0, mut f90) = (one_face, specular);
        if p.thin {
            // Both faces, as far as light gets to the second: R + T^2 R / (1 - R^2) = 2 R / (1 + R).
            let two = one_face * 2.0 / (Rgb::ONE + one_face);
            f0 = one_face + (two - one_face) * transmission;
            f90 += (2.0 * f90 / (1.0 + f90) - f90) * transmission;
        }
        let at_edge = base + (Rgb::ONE - base) * DARKEST.1;
        Principled {
            tables,
            base,
            f0,
            f90,
            edge: at_edge * (Rgb::ONE - colour(p.metal_edge)) / DARKEST.0,
            below: colour(p.diffuse_transmission_color),
            sheen: colour(p.sheen_color),
            base_normal: p.base_normal,
            coat_normal: p.coat_normal,
            roughness: if ggx.is_smooth() {
                0.0
            } else {
                (along * across).sqrt().sqrt()
            },
            ggx,
            metallic: unit(p.metallic),
            transmission,
            passing: unit(p.diffuse_transmission),
            coat: unit(p.coat),
            coat_roughness: unit(p.coat_roughness),
            sheen_roughness: unit(p.sheen_roughness),
            film: unit(p.iridescence),
            film_ior: p.iridescence_ior.max(1.0),
            film_thickness: p.iridescence_thickness.max(0.0),
            thin: p.thin || tables.base.eta() == f32::INFINITY,
        }
    }

    /// Share of glass.
    #[inline]
    fn glass(&self) -> f32 {
        (1.0 - self.metallic) * self.transmission
    }

    /// Share of the diffuse base.
    #[inline]
    fn opaque(&self) -> f32 {
        (1.0 - self.metallic) * (1.0 - self.transmission)
    }

    #[inline]
    fn coat_ggx(&self) -> Ggx {
        let alpha = sqr(self.coat_roughness);
        Ggx::new(alpha, alpha)
    }

    pub(super) fn is_delta(&self) -> bool {
        self.ggx.is_smooth()
            && self.opaque() == 0.0
            && self.sheen == Rgb::ZERO
            && (self.coat == 0.0 || self.coat_ggx().is_smooth())
    }

    /// Whether light passes to the other side.
    pub(super) fn transmits(&self) -> bool {
        self.glass() > 0.0 || (self.opaque() > 0.0 && self.passing > 0.0)
    }

    /// Which lights matter.
    pub(super) fn reach(&self) -> Reach {
        if self.transmits() {
            Reach::Anywhere
        } else if self.opaque() == 0.0 && self.sheen == Rgb::ZERO {
            Reach::Mirrored(self.ggx.narrowness())
        } else {
            Reach::Cosine
        }
    }

    /// What is transmitted is a delta lobe.
    #[inline]
    fn passes_straight(&self) -> bool {
        self.ggx.is_smooth() || (!self.thin && (self.tables.base.eta() - 1.0).abs() < BEND_MIN)
    }

    /// Far side over near side.
    #[inline]
    fn eta(&self, inside: bool) -> f32 {
        if self.thin {
            1.0
        } else if inside {
            1.0 / self.tables.base.eta()
        } else {
            self.tables.base.eta()
        }
    }

    /// Reflectance of the dielectric at a facet seen from outside.
    #[inline]
    fn dielectric(&self, cos: f32) -> Rgb {
        let t = self.tables.base.rise(cos);
        let plain = (self.f0 + (Rgb::splat(self.f90) - self.f0) * t).clamp(Rgb::ZERO, Rgb::ONE);
        self.filmed(cos, plain, self.f0)
    }

    /// Reflectance of the dielectric at a facet seen from inside.
    #[inline]
    fn dielectric_inside(&self, cos: f32) -> Rgb {
        let (t, cos_t) = self.tables.base.rise_inside(cos);
        if cos_t == 0.0 {
            return Rgb::ONE;
        }
        (self.f0 + (Rgb::splat(self.f90) - self.f0) * t).clamp(Rgb::ZERO, Rgb::ONE)
    }

    /// Reflectance of the metal at a facet: Schlick's curve, darkened towards the horizon [Kutz21].
    #[inline]
    fn metal(&self, cos: f32) -> Rgb {
        let s = schlick(cos);
        let plain = self.base + (Rgb::ONE - self.base) * s - self.edge * (cos * (1.0 - cos) * s);
        self.filmed(cos, plain.clamp(Rgb::ZERO, Rgb::ONE), self.base)
    }

    /// A reflectance under the film, if there is one.
    #[inline]
    fn filmed(&self, cos: f32, plain: Rgb, f0: Rgb) -> Rgb {
        if self.film == 0.0 {
            return plain;
        }
        let film = film::reflectance(cos, self.film_ior, self.film_thickness, f0);
        plain + (film - plain) * self.film
    }

    /// Albedo of the dielectric's reflection for a cosine outside.
    #[inline]
    fn specular_albedo(&self, cos: f32, white: f32) -> Rgb {
        let t = self.tables.base.albedo.at(cos, self.roughness);
        let plain = self.f0 * (white - t) + Rgb::splat(self.f90 * t);
        if self.film == 0.0 {
            return plain;
        }
        let film = film::reflectance(cos, self.film_ior, self.film_thickness, self.f0);
        plain + (film * white - plain) * self.film
    }

    /// Factor on the diffuse base: what the specular layer lets through on both ways.
    #[inline]
    fn coupling(&self, from: f32, to: f32) -> f32 {
        if self.film > 0.0 {
            // Of a film's colours only the bound 1 - E for either direction is known.
            return from.min(to);
        }
        let white = self.tables.facets.white.mean(self.roughness);
        let t = self.tables.base.albedo.mean(self.roughness);
        let mean = (self.f0 * (white - t)).max_element() + self.f90 * t;
        if mean < 0.9999 {
            from * to / (1.0 - mean)
        } else {
            0.0
        }
    }

    /// Colour of the light that has bounced between a metal's facets, all orders together
    /// [KullaConty17].
    #[inline]
    fn bounced(&self) -> Rgb {
        let average = self.filmed(
            2.0 / 3.0,
            self.base + (Rgb::ONE - self.base) * (1.0 / 21.0) - self.edge * (1.0 / 126.0),
            self.base,
        );
        let average = average.clamp(Rgb::ZERO, Rgb::ONE);
        let white = self.tables.facets.white.mean(self.roughness);
        average * average * white / (Rgb::ONE - average * (1.0 - white))
    }

    /// Works out a view direction above (`below`: it was turned there).
    fn view(&self, wo: Vec3, below: bool) -> View {
        let facets = &self.tables.facets;
        let cos = wo.z;
        let glass = self.glass();
        // From inside, what is above the base is not seen.
        let inside = below && glass > 0.0 && !self.thin;
        let (mut sheen, mut coat) = (0.0, 0.0);
        // The other side of a surface is turned against this one.
        let facing = |n: Vec3| if below { Vec3::new(-n.x, -n.y, n.z) } else { n };
        let base_normal = facing(self.base_normal);
        let mut coat_normal = facing(self.coat_normal);
        if !inside {
            if let (true, Some(table)) = (self.sheen != Rgb::ZERO, &facets.sheen) {
                sheen = table.at(cos, self.sheen_roughness);
            }
            if coat_normal != Vec3::Z {
                coat_normal = lifted(wo, coat_normal, Vec3::Z);
            }
            let cos_coat = wo.dot(coat_normal);
            if self.coat > 0.0 && cos_coat > 0.0 {
                let curve = &self.tables.coat;
                let r = if self.coat_ggx().is_smooth() {
                    0.0
                } else {
                    self.coat_roughness
                };
                let white = facets.white.at(cos_coat, r);
                let t = curve.albedo.at(cos_coat, r);
                coat = self.coat * (curve.f0 * (white - t) + t);
            }
        }
        let under_sheen = 1.0 - self.sheen.max_element() * sheen;
        let under_coat = under_sheen * (1.0 - coat);

        let white = facets.white.at(cos, self.roughness);
        let specular = self.specular_albedo(cos, white);
        let diffuse = 1.0 - specular.max_element();
        let lost = 1.0 - white;
        let one = Rgb::ONE;
        let (mut through, mut back) = (one, 1.0);
        if glass > 0.0 && !self.ggx.is_smooth() {
            let base = &self.tables.base;
            let from_dense = !self.thin && (inside == (base.eta() > 1.0));
            if from_dense {
                back = base
                    .dense
                    .as_ref()
                    .map_or(1.0, |t| 1.0 / t.at(cos, self.roughness).max(0.1));
                through = Rgb::splat(back);
            } else if self.film > 0.0 && !inside {
                // (1 - E) / (E(1) - E) is smallest for E = 0: what a film's facets reflect is not known.
                if self.thin {
                    through = Rgb::splat(1.0 / white.max(0.25));
                }
            } else {
                let rise = Rgb::splat(self.f90) - self.f0;
                let (reflected, at_once) = match &base.rare {
                    Some(rare) if !self.thin => {
                        let high = rare.high.at(cos, self.roughness);
                        let all = rare.low.at(cos, self.roughness) + high;
                        let t = rare.reflected.at(cos, self.roughness);
                        (
                            self.f0 * white + rise * t,
                            (one - self.f0) * all - rise * high,
                        )
                    }
                    _ => (specular, Rgb::splat(white) - specular),
                };
                through =
                    ((one - reflected) / at_once.max(Rgb::splat(1e-3))).clamp(one, Rgb::splat(4.0));
            }
        }

        let s = facets.schlick.at(cos, self.roughness);
        let mut metal = self.base * (white - s) + Rgb::splat(s);
        if self.edge != Rgb::ZERO {
            metal -= self.edge * facets.darkening.at(cos, self.roughness);
        }
        let opaque = self.opaque();
        let up = if opaque > 0.0 {
            self.base * (opaque * (1.0 - self.passing) * diffuse)
        } else {
            Rgb::ZERO
        };
        let bounced = if self.metallic > 0.0 && lost > 0.0 {
            self.bounced() * (self.metallic * lost)
        } else {
            Rgb::ZERO
        };
        let of_facets = if inside {
            let r = self.dielectric_inside(cos);
            metal * self.metallic + specular * opaque + (r + (one - r) * self.base) * glass
        } else {
            metal * self.metallic
                + specular * (1.0 - self.metallic)
                + (one - specular).max(Rgb::ZERO) * self.base * glass
        };
        let down = self.below * (opaque * self.passing * diffuse);
        let shares = [
            Rgb::splat(under_sheen * coat),
            self.sheen * sheen,
            (up + bounced) * under_coat,
            of_facets * under_coat,
            down * under_coat,
        ];
        let albedo = shares.iter().fold(Rgb::ZERO, |a, s| a + *s);
        let sum = mean(albedo);
        let scale = if sum > 0.0 { 1.0 / sum } else { 0.0 };
        View {
            inside,
            under_sheen,
            under_coat,
            through,
            back,
            base_normal,
            coat_normal,
            diffuse,
            lost,
            p: shares.map(|s| mean(s).max(0.0) * scale),
            albedo,
        }
    }

    /// See [`super::Bsdf::albedo`]; from the tables, so exact but for colours of films and edges.
    pub(super) fn albedo(&self, wo: Vec3) -> Rgb {
        self.view(wo.with_z(wo.z.abs()), wo.z < 0.0).albedo
    }
}
