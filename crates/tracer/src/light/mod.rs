//! Lights: choosing one, sampling a point or direction of it, and the density of that choice.

mod area;
pub mod environment;
pub mod octahedral;

pub use area::{AreaLight, AreaShape, Emission};

use crate::geometry::Interaction;
use crate::math::{self, Rgb};
use crate::sampling::Piecewise1d;
use crate::texture::Textures;
use environment::Environment;
use glam::{Vec2, Vec3};
use scene::model::SpotFalloff;

/// A light.
pub enum Light {
    /// From a point, equally in all directions.
    Point {
        /// Position.
        p: Vec3,
        /// Power per solid angle.
        intensity: Rgb,
    },
    /// From a point, in a cone.
    Spot {
        /// Position.
        p: Vec3,
        /// Axis, unit length, the way the light goes.
        axis: Vec3,
        /// Power per solid angle on the axis.
        intensity: Rgb,
        /// Cosine where it is dark.
        cos_outer: f32,
        /// Cosine up to which it has full strength.
        cos_inner: f32,
        /// Shape of the edge.
        falloff: SpotFalloff,
    },
    /// Parallel.
    Distant {
        /// Unit length, towards the light.
        towards: Vec3,
        /// On a surface that faces it.
        irradiance: Rgb,
    },
    /// From all around.
    Environment(Environment),
    /// A shining surface.
    Area(AreaLight),
}

/// Light that arrives at a point from a sampled point or direction of a light.
#[derive(Clone, Copy, Debug)]
pub struct LightSample {
    /// Towards the light, unit length.
    pub wi: Vec3,
    /// The point of the light; `None` at infinity.
    pub target: Option<Vec3>,
    /// Radiance (for delta lights: irradiance on a surface that faces `wi`).
    pub li: Rgb,
    /// Density per solid angle of the direction, given the light; 1 for delta lights.
    pub pdf: f32,
    /// No direction sampled otherwise ever meets this light.
    pub delta: bool,
}

/// All lights of a scene and how one is chosen.
pub struct Lights {
    /// All.
    pub lights: Vec<Light>,
    /// Those at infinity that rays can meet.
    pub environments: Vec<u32>,
    /// Light of a shining primitive; see `Surface::first_light`.
    pub light_of: Vec<u32>,
    /// What shining surfaces give off.
    pub emissions: Vec<Emission>,
    chooser: Option<Piecewise1d>,
}

impl Lights {
    /// Choice in proportion to power. `radius` is that of the scene, for what is at infinity.
    pub fn new(
        lights: Vec<Light>,
        light_of: Vec<u32>,
        emissions: Vec<Emission>,
        textures: &Textures,
        radius: f32,
    ) -> Self {
        let environments =
            (0..lights.len() as u32).filter(|i| matches!(lights[*i as usize], Light::Environment(_))).collect();
        let disk = math::PI * radius * radius;
        let power: Vec<f32> = lights
            .iter()
            .map(|light| {
                let flux = match light {
                    Light::Point { intensity, .. } => *intensity * (4.0 * math::PI),
                    Light::Spot { intensity, cos_outer, cos_inner, .. } => {
                        *intensity * (2.0 * math::PI * (1.0 - 0.5 * (cos_outer + cos_inner)))
                    }
                    Light::Distant { irradiance, .. } => *irradiance * disk,
                    Light::Environment(e) => e.mean() * (4.0 * math::PI * disk),
                    Light::Area(a) => a.power(&emissions, textures),
                };
                let l = math::luminance(flux);
                if l.is_finite() { l.max(0.0) } else { f32::MAX }
            })
            .collect();
        // A light whose brightness rounds to nothing can still be met: give everything a little.
        let sum: f64 = power.iter().map(|p| *p as f64).sum();
        let floor = (sum / lights.len().max(1) as f64 * 1e-3) as f32;
        let weights: Vec<f32> = power.iter().map(|p| if *p > 0.0 { p.max(floor) } else { 0.0 }).collect();
        let chooser = (sum > 0.0).then(|| Piecewise1d::new(&weights));
        Lights { lights, environments, light_of, emissions, chooser }
    }

    /// A light and its probability.
    #[inline]
    pub fn choose(&self, u: f32) -> Option<(&Light, f32)> {
        let chooser = self.chooser.as_ref()?;
        if self.lights.len() == 1 {
            return Some((&self.lights[0], 1.0));
        }
        let index = chooser.sample(u).index as usize;
        let pmf = chooser.pmf(index);
        (pmf > 0.0).then(|| (&self.lights[index], pmf))
    }

    /// Probability that [`Lights::choose`] gives a light.
    #[inline]
    pub fn pmf(&self, index: u32) -> f32 {
        if self.lights.len() == 1 {
            return if self.chooser.is_some() { 1.0 } else { 0.0 };
        }
        self.chooser.as_ref().map_or(0.0, |c| c.pmf(index as usize))
    }

    /// Density per solid angle with which a direction from `from` to a point `on` a shining surface
    /// is sampled, the choice of the light included.
    #[inline]
    pub fn pdf_area(&self, from: Vec3, on: &Interaction) -> f32 {
        match &self.lights[on.light as usize] {
            Light::Area(area) => self.pmf(on.light) * area.pdf_li(from, on),
            _ => 0.0,
        }
    }
}

impl Light {
    /// Samples light that may arrive at `from`; `None` where none can.
    #[inline]
    pub fn sample_li(
        &self,
        textures: &Textures,
        emissions: &[Emission],
        from: Vec3,
        u: Vec2,
    ) -> Option<LightSample> {
        match self {
            Light::Point { p, intensity } => point_sample(*p, *intensity, from),
            Light::Spot { p, axis, intensity, cos_outer, cos_inner, falloff } => {
                let mut sample = point_sample(*p, *intensity, from)?;
                let cos = -axis.dot(sample.wi);
                sample.li *= spot_factor(cos, *cos_outer, *cos_inner, *falloff);
                (sample.li != Rgb::ZERO).then_some(sample)
            }
            Light::Distant { towards, irradiance } => {
                Some(LightSample { wi: *towards, target: None, li: *irradiance, pdf: 1.0, delta: true })
            }
            Light::Environment(e) => {
                let (wi, li, pdf) = e.sample(&textures.images, u)?;
                Some(LightSample { wi, target: None, li, pdf, delta: false })
            }
            Light::Area(area) => area.sample_li(textures, emissions, from, u),
        }
    }
}

fn point_sample(p: Vec3, intensity: Rgb, from: Vec3) -> Option<LightSample> {
    let d = p - from;
    let distance2 = d.dot(d);
    (distance2 > 0.0).then(|| LightSample {
        wi: d * (1.0 / distance2.sqrt()),
        target: Some(p),
        li: intensity * (1.0 / distance2),
        pdf: 1.0,
        delta: true,
    })
}

/// See [`SpotFalloff`].
pub fn spot_factor(cos: f32, cos_outer: f32, cos_inner: f32, falloff: SpotFalloff) -> f32 {
    if cos <= cos_outer {
        return 0.0;
    }
    if cos >= cos_inner {
        return 1.0;
    }
    let x = (cos - cos_outer) / (cos_inner - cos_outer);
    match falloff {
        SpotFalloff::SmoothStep => x * x * (3.0 - 2.0 * x),
        SpotFalloff::Squared => x * x,
    }
}
