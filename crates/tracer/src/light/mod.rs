//! Lights: choosing one, sampling a point or direction of it, and the density of that choice.

mod area;
pub(crate) mod cluster;
pub mod environment;
pub mod octahedral;
mod pairs;
mod pictured;
mod portal;
mod tree;

pub use area::{AreaLight, AreaShape, Emission};
pub(crate) use area::{CONE_MIN, INSIDE};
pub use cluster::Aim;
pub(crate) use pairs::Asking;
pub use pictured::{Goniometric, Projection};

use crate::accel::SimdLevel;
use crate::geometry::Interaction;
use crate::lanes::{Float, Int, Row, Wide};
use crate::math::Rgb;
use crate::texture::Textures;
use environment::Environment;
use glam::{Vec2, Vec3};
use scene::model::SpotFalloff;
use tree::{LightBounds, LightTree};

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
    /// From a point, by a picture of all directions.
    Goniometric(Goniometric),
    /// From a point, a picture.
    Projection(Projection),
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
    /// Radiance (for lights without extent: irradiance on a surface that faces `wi`).
    pub li: Rgb,
    /// Density per solid angle of the direction, given the light; 1 for lights without extent.
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
    /// Those at infinity that are sampled, each with the same share of the choice.
    infinite: Vec<u32>,
    /// The others, which share what is left.
    tree: Option<LightTree>,
    /// Share of one light at infinity.
    share: f32,
}

impl Lights {
    /// Prepares the choice. A light at infinity cannot be weighed against the others (its power grows
    /// with the scene, however little of the scene is seen): each gets one share, and all lights in the
    /// scene together one.
    pub fn new(
        lights: Vec<Light>,
        light_of: Vec<u32>,
        emissions: Vec<Emission>,
        textures: &Textures,
        level: SimdLevel,
    ) -> Self {
        let mut infinite = vec![];
        let mut finite = vec![];
        for (i, light) in lights.iter().enumerate() {
            match light.bounds(&emissions, textures) {
                Some(bounds) if bounds.strength > 0.0 => finite.push((i as u32, bounds)),
                Some(_) => {}
                None if light.is_dark() || light.is_found_by_scattering() => {}
                None => infinite.push(i as u32),
            }
        }
        // A light whose strength rounds to nothing beside the others can still be met.
        let sum: f64 = finite.iter().map(|(_, b)| b.strength as f64).sum();
        let floor = (sum / finite.len().max(1) as f64 * 1e-4) as f32;
        for (_, bounds) in &mut finite {
            bounds.strength = bounds.strength.max(floor).min(f32::MAX);
        }
        let tree = LightTree::new(&finite, lights.len(), level);
        let shares = infinite.len() + tree.is_some() as usize;
        let environments = (0..lights.len() as u32)
            .filter(|i| matches!(lights[*i as usize], Light::Environment(_)))
            .collect();
        Lights {
            lights,
            environments,
            light_of,
            emissions,
            infinite,
            tree,
            share: 1.0 / shares.max(1) as f32,
        }
    }

    /// A light and its probability, for a point with a normal.
    #[inline]
    pub fn choose(&self, p: Vec3, aim: Aim, u: f32) -> Option<(&Light, f32)> {
        let (light, pmf) = self.choose_index(p, aim, u)?;
        Some((&self.lights[light as usize], pmf))
    }

    /// The light that [`Lights::choose`] always gives, if there is one.
    pub(crate) fn only(&self) -> Option<u32> {
        match (&self.infinite[..], &self.tree) {
            ([], Some(tree)) => tree.only(),
            ([light], None) => Some(*light),
            _ => None,
        }
    }

    /// Index of a light and its probability; see [`Lights::choose`].
    #[inline]
    pub(crate) fn choose_index(&self, p: Vec3, aim: Aim, u: f32) -> Option<(u32, f32)> {
        let count = self.infinite.len();
        if count == 0 {
            return self.tree.as_ref()?.sample(p, aim, u);
        }
        let scaled = u / self.share;
        let which = scaled as usize;
        match &self.tree {
            Some(tree) if which >= count => {
                let rest = (scaled - count as f32).clamp(0.0, crate::math::ONE_MINUS_EPSILON);
                let (light, pmf) = tree.sample(p, aim, rest)?;
                Some((light, pmf * self.share))
            }
            _ => Some((self.infinite[which.min(count - 1)], self.share)),
        }
    }

    /// Whether lights can be chosen in lanes.
    pub(crate) fn suit_lanes(&self) -> bool {
        self.tree.as_ref().is_some_and(|tree| tree.pairs.is_some())
    }

    /// [`Lights::choose_index`] in lanes, if they suit; the probability is 0 where no light is chosen.
    #[inline(always)]
    pub(crate) fn choose_in_lanes<W: Wide<N>, const N: usize>(
        &self,
        asking: &Asking<W, N>,
        u: W::F,
    ) -> (W::I, W::F) {
        let none = (W::I::splat(0), W::F::splat(0.0));
        let Some(pairs) = self.tree.as_ref().and_then(|tree| tree.pairs.as_ref()) else {
            return none;
        };
        if self.infinite.is_empty() {
            return pairs.sample::<W, N>(asking, u);
        }
        let count = W::F::splat(self.infinite.len() as f32);
        let scaled = u / W::F::splat(self.share);
        let rest = (scaled - count).max(none.1);
        let rest = rest.min(W::F::splat(crate::math::ONE_MINUS_EPSILON));
        let (light, pmf) = pairs.sample::<W, N>(asking, rest);
        let is_finite = count.le(scaled);
        let mut which = Row::<N>::default();
        scaled.store(&mut which);
        for lane in 0..N {
            let at = (which.0[lane] as usize).min(self.infinite.len() - 1);
            which.0[lane] = f32::from_bits(self.infinite[at]);
        }
        let light = W::F::select(is_finite, W::F::from_bits(light), W::F::load(&which));
        let pmf = W::F::select(is_finite, pmf, W::F::splat(1.0)) * W::F::splat(self.share);
        (light.bits(), pmf)
    }

    /// Probability that [`Lights::choose`] gives a light at infinity.
    #[inline]
    pub fn pmf_infinite(&self) -> f32 {
        self.share
    }

    /// Density per solid angle with which a direction from `from` to a point `on` a shining surface
    /// is sampled, the choice of the light included.
    #[inline]
    pub fn pdf_area(&self, from: Vec3, aim: Aim, on: &Interaction) -> f32 {
        match (&self.lights[on.light as usize], &self.tree) {
            (Light::Area(area), Some(tree)) => {
                tree.pmf(from, aim, on.light) * self.share * area.pdf_li(from, on)
            }
            _ => 0.0,
        }
    }
}

impl Light {
    /// A light at infinity that sends nothing.
    fn is_dark(&self) -> bool {
        match self {
            Light::Distant { irradiance, .. } => irradiance.max_element() <= 0.0,
            Light::Environment(e) => e.mean().max_element() <= 0.0,
            _ => false,
        }
    }

    /// A light at infinity that scattered rays meet often enough without any help.
    fn is_found_by_scattering(&self) -> bool {
        matches!(self, Light::Environment(e) if !e.is_sampled())
    }

    /// What the light tree needs to know; `None` for lights at infinity.
    fn bounds(&self, emissions: &[Emission], textures: &Textures) -> Option<LightBounds> {
        let at = |p: Vec3, intensity: Rgb| LightBounds {
            min: p,
            max: p,
            axis: Vec3::Z,
            strength: intensity.max_element(),
            cos_normals: -1.0,
            cos_emission: 0.0,
            two_sided: false,
        };
        match self {
            Light::Point { p, intensity } => Some(at(*p, *intensity)),
            Light::Spot {
                p,
                axis,
                intensity,
                cos_outer,
                ..
            } => {
                // As one normal with a cone of light about it; what the tree subtracts is the angle
                // beyond the cone, so the cone itself counts as spread of normals.
                Some(LightBounds {
                    axis: *axis,
                    cos_normals: *cos_outer,
                    ..at(*p, *intensity)
                })
            }
            Light::Goniometric(g) => Some(at(g.p, g.strongest(&textures.images))),
            Light::Projection(p) => Some(LightBounds {
                axis: p.axis(),
                cos_normals: p.cos_corner(),
                ..at(p.p, p.strongest(&textures.images))
            }),
            Light::Area(area) => Some(area.bounds(emissions, textures)),
            Light::Distant { .. } | Light::Environment(_) => None,
        }
    }

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
            Light::Spot {
                p,
                axis,
                intensity,
                cos_outer,
                cos_inner,
                falloff,
            } => {
                let mut sample = point_sample(*p, *intensity, from)?;
                let cos = -axis.dot(sample.wi);
                sample.li *= spot_factor(cos, *cos_outer, *cos_inner, *falloff);
                (sample.li != Rgb::ZERO).then_some(sample)
            }
            Light::Distant {
                towards,
                irradiance,
            } => Some(LightSample {
                wi: *towards,
                target: None,
                li: *irradiance,
                pdf: 1.0,
                delta: true,
            }),
            Light::Goniometric(g) => {
                let mut sample = point_sample(g.p, Rgb::ONE, from)?;
                sample.li *= g.intensity(&textures.images, -sample.wi);
                (sample.li != Rgb::ZERO).then_some(sample)
            }
            Light::Projection(p) => {
                let mut sample = point_sample(p.p, Rgb::ONE, from)?;
                sample.li *= p.intensity(&textures.images, -sample.wi);
                (sample.li != Rgb::ZERO).then_some(sample)
            }
            Light::Environment(e) => {
                let (wi, li, pdf) = e.sample(&textures.images, from, u)?;
                Some(LightSample {
                    wi,
                    target: None,
                    li,
                    pdf,
                    delta: false,
                })
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
