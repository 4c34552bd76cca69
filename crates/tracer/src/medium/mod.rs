//! Participating media: fog, smoke, milk, tinted glass.
//!
//! A medium has coefficients of absorption and scattering per unit of length in world space, light of its
//! own, and a phase function. It is homogeneous, or a grid that is tracked through a coarser grid of
//! upper bounds ([`grid`]). A path knows which medium it is in (an index, [`crate::ray::NONE`] for vacuum);
//! a surface that is a border says what lies on either side of it, so nested media need no priorities:
//! each surface states its inside and its outside, as in pbrt.

pub mod grid;
pub mod phase;
pub mod track;

use crate::bsdf::{Bsdf, DiffuseTransmission, fresnel_dielectric};
use crate::math::{Rgb, exp};
use grid::GridMedium;
use scene::model::{self, SceneDesc};

/// Distances are bounded by this, so that zero coefficients times infinity are never formed.
pub const FAR: f32 = 1e30;
/// And coefficients by this, so that their sums and products stay finite.
const DENSE: f32 = 1e12;

/// A medium ready for use.
pub struct Medium {
    /// Absorption coefficient, or what its grid is multiplied by.
    pub sigma_a: Rgb,
    /// Scattering coefficient, or what its grid is multiplied by.
    pub sigma_s: Rgb,
    /// Radiance per absorption: the medium gives off `sigma_a * emission` per unit of length.
    pub emission: Rgb,
    /// Asymmetry of the phase function.
    pub g: f32,
    /// Variation in space.
    pub grid: Option<GridMedium>,
    /// How light leaves a translucent body.
    pub border: Option<Border>,
}

/// The border of a translucent body as light from inside meets it, with the index of refraction of the
/// body over that of its surroundings.
///
/// Light that was scattered often comes from everywhere alike, so that the border sends back the mean
/// of Fresnel's reflectance over the hemisphere and lets the rest out as a diffuse surface does: lights
/// can be sampled where it leaves, which no smooth border allows. From outside it stays what it is.
pub struct Border {
    /// What is sent back and let out; the latter with the change of radiance.
    pub bsdf: Bsdf<'static>,
    /// Inside over outside, squared.
    pub eta2: f32,
}

impl Border {
    fn new(eta: f32) -> Border {
        // The integral of 2 F cos over the cosines, by midpoints.
        const STEPS: u32 = 256;
        let mut back = 0.0;
        for i in 0..STEPS {
            let cos = (i as f32 + 0.5) / STEPS as f32;
            back += 2.0 * cos * fresnel_dielectric(cos, 1.0 / eta).0 / STEPS as f32;
        }
        let out = (1.0 - back).max(0.0) * eta * eta;
        Border {
            bsdf: Bsdf::DiffuseTransmission(DiffuseTransmission::new(
                Rgb::splat(back),
                Rgb::splat(out),
            )),
            eta2: eta * eta,
        }
    }
}

/// Coefficients at a point.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Coefficients {
    /// Absorption.
    pub a: Rgb,
    /// Scattering.
    pub s: Rgb,
    /// Radiance given off per absorption.
    pub emission: Rgb,
}

impl Coefficients {
    /// Extinction.
    #[inline]
    pub fn t(&self) -> Rgb {
        self.a + self.s
    }
}

impl Medium {
    /// Compiles a description.
    fn new(desc: &model::Medium) -> Medium {
        // max(0) also turns NaN into 0; what is denser than the bound is opaque at any size.
        let some = |c: model::Rgb| Rgb::from_array(c).clamp(Rgb::ZERO, Rgb::splat(DENSE));
        let (sigma_a, sigma_s) = (some(desc.sigma_a), some(desc.sigma_s));
        Medium {
            sigma_a,
            sigma_s,
            emission: some(desc.emission),
            g: desc.g.clamp(-0.999, 0.999),
            grid: desc
                .grid
                .as_ref()
                .map(|g| GridMedium::new(g, sigma_a, sigma_s)),
            border: desc.translucent.map(Border::new),
        }
    }

    /// The coefficients of a homogeneous medium.
    #[inline]
    pub fn constant(&self) -> Coefficients {
        Coefficients {
            a: self.sigma_a,
            s: self.sigma_s,
            emission: self.emission,
        }
    }

    /// Memory held.
    pub fn memory_bytes(&self) -> usize {
        self.grid.as_ref().map_or(0, GridMedium::memory_bytes)
    }
}

/// All media of a scene, and what the camera is in.
#[derive(Default)]
pub struct Media {
    /// By [`model::MediumId`].
    pub list: Vec<Medium>,
    /// Around the camera.
    pub camera: Option<u32>,
}

impl Media {
    /// Compiles what is described.
    pub fn new(desc: &SceneDesc) -> Media {
        use rayon::prelude::*;
        Media {
            list: desc.media.par_iter().map(Medium::new).collect(),
            camera: desc.camera.medium.map(|m| m.0),
        }
    }

    /// A medium by index, `None` in vacuum.
    #[inline]
    pub fn get(&self, index: u32) -> Option<&Medium> {
        self.list.get(index as usize)
    }

    /// Memory held.
    pub fn memory_bytes(&self) -> usize {
        self.list.iter().map(Medium::memory_bytes).sum()
    }
}

/// exp(-sigma d) by channel.
#[inline]
pub fn beer(sigma: Rgb, distance: f32) -> Rgb {
    Rgb::new(
        exp(-sigma.x * distance),
        exp(-sigma.y * distance),
        exp(-sigma.z * distance),
    )
}

/// Rate at which collisions are looked for: r = s (1 + a / (a + s)).
///
/// Any rate is right where s > 0; the weight of a scattering event is then s exp(-t d) / (r exp(-r d)) with
/// t = a + s. This one is t where nothing is absorbed (weights are 1), and 0 where nothing scatters (the
/// medium is passed by Beer's law, without noise); it never exceeds t, and weights never exceed 1.
#[inline]
pub fn rate(c: &Coefficients) -> Rgb {
    let one = |a: f32, s: f32| {
        if s > 0.0 {
            s * (1.0 + a / (a + s))
        } else {
            0.0
        }
    };
    Rgb::new(one(c.a.x, c.s.x), one(c.a.y, c.s.y), one(c.a.z, c.s.z))
}

#[cfg(test)]
mod tests;
