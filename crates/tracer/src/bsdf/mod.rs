//! Scattering at surfaces: the contract, and one model a file.
//!
//! Directions are unit vectors in the shading frame (z is the shading normal `ns`) and point away
//! from the surface: `wo` to where the light goes, `wi` to where it comes from. A [`Bsdf`] is built
//! for a hit with its parameters looked up, is small and `Copy`, and is an enum because the calls
//! sit in the innermost loop.
//!
//! - Reflecting models reflect on both sides: with `wo` below, the z of both directions is turned.
//!   Dielectrics have their inside where z < 0.
//! - Light carries radiance, so transmission into a medium with the relative index eta is scaled by
//!   1 / eta^2.
//! - Densities are per solid angle of `wi`. What a lobe sends to the wrong side of the surface is
//!   lost, not renormalised: a density then integrates to less than 1 over the directions that
//!   count.
//! - Perfect mirrors and smooth glass are delta lobes: `eval` and `pdf` are zero for them, and
//!   `sample` returns their discrete probability.

mod coat;
mod coated_conductor;
mod coated_diffuse;
mod conductor;
mod dielectric;
mod diffuse;
mod diffuse_transmission;
mod fresnel;
mod ggx;
mod hair;
mod lafortune;
pub(crate) mod lanes;
mod mirror;
mod mixed;
mod oren_nayar;
mod phong;
mod principled;
mod thin_dielectric;

pub use coat::CoatTable;
pub use coated_conductor::CoatedConductor;
pub use coated_diffuse::CoatedDiffuse;
pub use conductor::Conductor;
pub(crate) use conductor::ConductorLanes;
pub use dielectric::Dielectric;
pub(crate) use dielectric::DielectricLanes;
pub use diffuse::Diffuse;
pub(crate) use diffuse::DiffuseLanes;
pub use diffuse_transmission::DiffuseTransmission;
pub use fresnel::{conductor_k_from_reflectance, fresnel_conductor, fresnel_dielectric};
pub use ggx::Ggx;
pub use hair::Hair;
pub use lafortune::{Lafortune, LobeParam};
pub use mirror::Mirror;
pub use mixed::{MIXED_MAX, Mixed};
pub use oren_nayar::OrenNayar;
pub use phong::Phong;
pub(crate) use principled::lifted;
pub use principled::{Curve, Facets, Principled, PrincipledParams, PrincipledTables};
pub use thin_dielectric::ThinDielectric;

use crate::math::Rgb;
use glam::{Vec2, Vec3};

/// A sampled direction.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BsdfSample {
    /// Where the light comes from.
    pub wi: Vec3,
    /// f |cos| / pdf.
    pub weight: Rgb,
    /// Density per solid angle, all lobes together; for a delta lobe the probability that it was
    /// chosen.
    pub pdf: f32,
    /// Index of refraction of the side of `wi` over that of `wo`; 1 for reflection. Roulette
    /// multiplies the throughput by its square, which undoes the scaling of radiance.
    pub eta: f32,
    /// Drawn from a delta lobe: no other strategy can find this direction.
    pub delta: bool,
    /// `wi` lies on the other side of the surface.
    pub transmitted: bool,
}

impl BsdfSample {
    /// A reflected direction of a lobe with a density.
    #[inline]
    fn reflected(wi: Vec3, weight: Rgb, pdf: f32) -> Self {
        BsdfSample {
            wi,
            weight,
            pdf,
            eta: 1.0,
            delta: false,
            transmitted: false,
        }
    }
}

/// Which lights matter to a surface.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Reach {
    /// Light counts by the cosine to the normal.
    Cosine,
    /// All lobes lie about the mirrored view; how often its cosine has to be squared to fall as they
    /// do.
    Mirrored(u32),
    /// Light may come from either side.
    Anywhere,
}

/// How a surface scatters at one point. `'s` is the scene that holds the tables.
#[derive(Clone, Copy, Debug)]
pub enum Bsdf<'s> {
    /// Lambert.
    Diffuse(Diffuse),
    /// Rough diffuse.
    OrenNayar(OrenNayar),
    /// Modified Phong.
    Phong(Phong),
    /// Generalised cosine lobes.
    Lafortune(Lafortune<'s>),
    /// Perfect mirror.
    Mirror(Mirror),
    /// Glass, smooth or rough.
    Dielectric(Dielectric),
    /// A pane of glass without thickness.
    ThinDielectric(ThinDielectric),
    /// Metal, smooth or rough.
    Conductor(Conductor),
    /// Lambert under a dielectric layer.
    CoatedDiffuse(CoatedDiffuse<'s>),
    /// Metal under a dielectric layer.
    CoatedConductor(CoatedConductor<'s>),
    /// Lambert on both sides.
    DiffuseTransmission(DiffuseTransmission),
    /// Everyday surfaces: sheen, coat, metal, glass, translucent and opaque dielectric.
    Principled(&'s Principled<'s>),
    /// A fibre.
    Hair(Hair),
    /// Several of these.
    Mixed(&'s Mixed<'s>),
    /// Nothing comes back.
    Black,
}

/// How narrow lobes about the mirrored view may be, see [`Reach::Mirrored`], for guidance to be of use.
pub(crate) const GUIDED_MOST: u32 = 3;

impl Bsdf<'_> {
    /// f |cos wi|; zero for delta lobes.
    #[inline]
    pub fn eval(&self, wo: Vec3, wi: Vec3) -> Rgb {
        self.eval_pdf(wo, wi).0
    }

    /// Density per solid angle with which [`Bsdf::sample`] draws `wi`; zero for delta lobes.
    #[inline]
    pub fn pdf(&self, wo: Vec3, wi: Vec3) -> f32 {
        self.eval_pdf(wo, wi).1
    }

    /// [`Bsdf::eval`] and [`Bsdf::pdf`] at once.
    #[inline]
    pub fn eval_pdf(&self, wo: Vec3, wi: Vec3) -> (Rgb, f32) {
        match self {
            Bsdf::Diffuse(b) => b.eval_pdf(wo, wi),
            Bsdf::OrenNayar(b) => b.eval_pdf(wo, wi),
            Bsdf::Phong(b) => b.eval_pdf(wo, wi),
            Bsdf::Lafortune(b) => b.eval_pdf(wo, wi),
            Bsdf::Dielectric(b) => b.eval_pdf(wo, wi),
            Bsdf::Conductor(b) => b.eval_pdf(wo, wi),
            Bsdf::CoatedDiffuse(b) => b.eval_pdf(wo, wi),
            Bsdf::CoatedConductor(b) => b.eval_pdf(wo, wi),
            Bsdf::DiffuseTransmission(b) => b.eval_pdf(wo, wi),
            Bsdf::Principled(b) => b.eval_pdf(wo, wi),
            Bsdf::Hair(b) => b.eval_pdf(wo, wi),
            Bsdf::Mixed(b) => b.eval_pdf(wo, wi),
            Bsdf::Mirror(_) | Bsdf::ThinDielectric(_) | Bsdf::Black => (Rgb::ZERO, 0.0),
        }
    }

    /// Draws `wi` for three uniform numbers in [0, 1); `u_lobe` decides between lobes and between
    /// reflection (low numbers) and transmission. `None` where nothing scatters or the direction
    /// is lost.
    #[inline]
    pub fn sample(&self, wo: Vec3, u_lobe: f32, u: Vec2) -> Option<BsdfSample> {
        match self {
            Bsdf::Diffuse(b) => b.sample(wo, u),
            Bsdf::OrenNayar(b) => b.sample(wo, u),
            Bsdf::Phong(b) => b.sample(wo, u_lobe, u),
            Bsdf::Lafortune(b) => b.sample(wo, u_lobe, u),
            Bsdf::Mirror(b) => b.sample(wo),
            Bsdf::Dielectric(b) => b.sample(wo, u_lobe, u),
            Bsdf::ThinDielectric(b) => b.sample(wo, u_lobe),
            Bsdf::Conductor(b) => b.sample(wo, u),
            Bsdf::CoatedDiffuse(b) => b.sample(wo, u_lobe, u),
            Bsdf::CoatedConductor(b) => b.sample(wo, u_lobe, u),
            Bsdf::DiffuseTransmission(b) => b.sample(wo, u_lobe, u),
            Bsdf::Principled(b) => b.sample(wo, u_lobe, u),
            Bsdf::Hair(b) => b.sample(wo, u_lobe, u),
            Bsdf::Mixed(b) => b.sample(wo, u_lobe, u),
            Bsdf::Black => None,
        }
    }

    /// Whether there are only delta lobes: sampling lights is then of no use.
    #[inline]
    pub fn is_delta(&self) -> bool {
        match self {
            Bsdf::Mirror(_) | Bsdf::ThinDielectric(_) | Bsdf::Black => true,
            Bsdf::Dielectric(b) => b.is_delta(),
            Bsdf::Conductor(b) => b.is_delta(),
            Bsdf::CoatedConductor(b) => b.is_delta(),
            Bsdf::Principled(b) => b.is_delta(),
            Bsdf::Mixed(b) => b.is_delta(),
            _ => false,
        }
    }

    /// What lights are best chosen by.
    #[inline]
    pub fn reach(&self) -> Reach {
        match self {
            Bsdf::Conductor(b) => Reach::Mirrored(b.narrowness()),
            Bsdf::CoatedConductor(b) => Reach::Mirrored(b.narrowness()),
            Bsdf::Principled(b) => b.reach(),
            Bsdf::Mixed(b) => b.reach(),
            Bsdf::Dielectric(_) | Bsdf::Hair(_) => Reach::Anywhere,
            _ => Reach::Cosine,
        }
    }

    /// Fraction of the light from direction `wo` that is scattered, for the albedo layer: exact for
    /// Lambert, Oren-Nayar and smooth surfaces, an estimate for the others (each model says what it
    /// leaves out).
    #[inline]
    pub fn albedo(&self, wo: Vec3) -> Rgb {
        match self {
            Bsdf::Diffuse(b) => b.albedo(),
            Bsdf::OrenNayar(b) => b.albedo(wo),
            Bsdf::Phong(b) => b.albedo(wo),
            Bsdf::Lafortune(b) => b.albedo(wo),
            Bsdf::Mirror(b) => b.albedo(),
            Bsdf::Dielectric(b) => b.albedo(wo),
            Bsdf::ThinDielectric(b) => b.albedo(),
            Bsdf::Conductor(b) => b.albedo(wo),
            Bsdf::CoatedDiffuse(b) => b.albedo(wo),
            Bsdf::CoatedConductor(b) => b.albedo(wo),
            Bsdf::DiffuseTransmission(b) => b.albedo(),
            Bsdf::Principled(b) => b.albedo(wo),
            Bsdf::Hair(b) => b.albedo(wo),
            Bsdf::Mixed(b) => b.albedo(wo),
            Bsdf::Black => Rgb::ZERO,
        }
    }

    /// Whether it pays to look where light comes from when a direction is drawn: where lobes are wide. Light
    /// must not be bent, as nobody would say by how much.
    #[inline]
    pub(crate) fn takes_guidance(&self) -> bool {
        let is_wide = match self.reach() {
            Reach::Mirrored(narrow) => narrow <= GUIDED_MOST,
            Reach::Cosine | Reach::Anywhere => true,
        };
        let bends = self.transmits() && !matches!(self, Bsdf::DiffuseTransmission(_));
        is_wide && !bends && !self.is_delta()
    }

    /// Whether light passes to the other side.
    #[inline]
    pub fn transmits(&self) -> bool {
        match self {
            Bsdf::Dielectric(_)
            | Bsdf::ThinDielectric(_)
            | Bsdf::DiffuseTransmission(_)
            | Bsdf::Hair(_) => true,
            Bsdf::Principled(b) => b.transmits(),
            Bsdf::Mixed(b) => b.transmits(),
            _ => false,
        }
    }
}

/// Both directions with `wo` above, or `None` if they lie on different sides or along the surface.
#[inline]
fn above(wo: Vec3, wi: Vec3) -> Option<(Vec3, Vec3)> {
    if wo.z * wi.z <= 0.0 {
        return None;
    }
    Some((wo.with_z(wo.z.abs()), wi.with_z(wi.z.abs())))
}

/// `wi`, found for `wo` above, on the side where `wo` really is.
#[inline]
fn to_side_of(wo: Vec3, wi: Vec3) -> Vec3 {
    if wo.z < 0.0 { wi.with_z(-wi.z) } else { wi }
}

#[cfg(test)]
mod tests;
