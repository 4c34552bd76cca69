//! Path guiding: where light comes from, learned before the picture is begun, so that paths look there.
//!
//! Space is cut in halves until few places that paths have been to are left in each cell, and for each of six ways
//! that surfaces face a cell holds a density of directions [Mueller17], in proportion to radiance times
//! cosine. A vertex draws its direction from that or from the scattering function and divides by the density of
//! the mixture, so that what is learned badly costs no more than half of the samples. What is
//! learned is the light that sampling lights does not bring.
//!
//! The guide is trained in preparation ([`train`]), from a fixed number of paths with numbers of their own: a
//! function of the scene and the frame, like the number of paths that samples are split into. Every worker
//! makes the same, bit for bit, so nothing has to be sent, stored or found again after a restart.

mod cells;
mod directions;
pub(crate) mod lanes;
mod train;

pub(crate) use directions::Directions;
pub(crate) use train::Step;

use crate::bsdf::BsdfSample;
use crate::geometry::Interaction;
use crate::lanes::Row;
use crate::material::Shading;
use crate::math::{self, Rgb};
use crate::sampler::BounceNumbers;
use cells::Cells;
use directions::Quads;
use glam::Vec3;

/// Chance that a direction is drawn from the guide where there is one.
pub(crate) const SHARE: f32 = 0.5;

/// A path's chance to go on is what it is expected to bring, as a fraction of what the camera is expected to see,
/// times this.
pub(crate) const BRINGS_FACTOR: f32 = 4.0;

/// Ways that a surface may face: along an axis or against it.
const WAYS: u32 = 6;

/// What is known of the light in a scene.
pub(crate) struct Guide {
    cells: Cells,
    /// Root of the directions for each way that a surface faces in each cell; 0 where nothing is known.
    roots: Vec<u32>,
    quads: Quads,
    /// Luminance sent by surfaces on average, for each way in each spot.
    sent: Vec<f32>,
    /// More is to be learned: paths have to be remembered.
    pub learns: bool,
}

/// A place of a surface as seen from one side, in one number: in its lowest three bits which way it faces, from 1, and
/// above them the root of its [`Directions`], 0 where nothing is known. 0: nothing is to be known there.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Mark(pub u32);

impl Mark {
    /// Of a vertex that takes no guidance.
    pub(crate) const NONE: Mark = Mark(0);

    /// Which way the surface faces.
    #[inline(always)]
    pub(crate) fn way(self) -> Option<u32> {
        (self.0 & 7).checked_sub(1)
    }

    /// The root of its directions, or 0.
    #[inline(always)]
    pub(crate) fn root(self) -> u32 {
        self.0 >> 3
    }
}

/// Which way a surface faces for somebody who looks at it along `direction`: the axis of its normal, and three more
/// if against it.
#[inline(always)]
fn way_of(ng: Vec3, direction: Vec3) -> u32 {
    let n = math::faceforward(ng, -direction);
    let (x, y, z) = (n.x.abs(), n.y.abs(), n.z.abs());
    let (axis, along) = if x >= y && x >= z {
        (0, n.x)
    } else if y >= z {
        (1, n.y)
    } else {
        (2, n.z)
    };
    if along < 0.0 { axis + 3 } else { axis }
}

impl Guide {
    /// Knows nothing, and is to learn.
    pub(crate) fn new() -> Guide {
        let (cells, _) = Cells::new(&[]);
        Guide {
            cells,
            roots: vec![0; WAYS as usize],
            quads: Quads::new(),
            sent: vec![0.0; WAYS as usize],
            learns: true,
        }
    }

    /// What is known at a point with a geometric normal, for a ray that arrives in some direction.
    #[inline(always)]
    pub(crate) fn mark(&self, p: Vec3, ng: Vec3, direction: Vec3) -> Mark {
        let way = way_of(ng, direction);
        let root = self.roots[(WAYS * self.cells.cell(p) + way) as usize];
        Mark(root << 3 | (way + 1))
    }

    /// Luminance that a surface is expected to send from a point, facing some way.
    #[inline(always)]
    pub(crate) fn sent(&self, p: Vec3, way: u32) -> f32 {
        self.sent[(WAYS * self.cells.spot(p) + way) as usize]
    }

    /// The directions of a mark, if any are known.
    #[inline(always)]
    pub(crate) fn directions(&self, mark: Mark) -> Option<Directions<'_>> {
        let (quads, root) = (&self.quads.0[..], mark.root());
        (root != 0).then_some(Directions { quads, root })
    }

    /// The rows of all directions.
    #[inline(always)]
    pub(crate) fn quads(&self) -> &[Row] {
        &self.quads.0
    }

    /// Memory held.
    pub(crate) fn memory_bytes(&self) -> usize {
        self.cells.memory_bytes()
            + size_of_val(&self.roots[..])
            + size_of_val(&self.quads.0[..])
            + size_of_val(&self.sent[..])
    }
}

/// A direction drawn with guidance.
pub(crate) struct Guided {
    /// Weighted by the density of the mixture; its `pdf` is that of the scattering function, which is what light sampling is
    /// weighed against.
    pub s: BsdfSample,
    /// Density that it was drawn with.
    pub drawn: f32,
    /// Radiance that is expected from there, if there was guidance.
    pub comes: Option<f32>,
}

impl Guided {
    /// A direction drawn without.
    #[inline(always)]
    pub(crate) fn without(s: Option<BsdfSample>) -> Option<Guided> {
        s.map(|s| Guided {
            s,
            drawn: s.pdf,
            comes: None,
        })
    }
}

impl Directions<'_> {
    /// Draws a direction from the mixture; see [`Shading::sample`].
    #[inline]
    pub(crate) fn guide(
        self,
        shading: &Shading,
        wo: Vec3,
        numbers: &BounceNumbers,
    ) -> Option<Guided> {
        let by_guide = numbers.lobe < SHARE;
        let (mut s, density) = if by_guide {
            let (w, density) = self.sample(numbers.bsdf);
            let wi = shading.frame.to_local(w);
            let (f, pdf) = shading.eval_pdf(wo, wi);
            if f == Rgb::ZERO {
                return None;
            }
            let s = BsdfSample {
                wi,
                weight: f,
                pdf,
                eta: 1.0,
                delta: false,
                transmitted: wo.z * wi.z < 0.0,
            };
            (s, density)
        } else {
            let lobe = (numbers.lobe - SHARE) * (1.0 / (1.0 - SHARE));
            let mut s = shading.sample(wo, lobe, numbers.bsdf)?;
            s.weight *= s.pdf;
            (s, self.pdf(shading.frame.to_world(s.wi)))
        };
        let drawn = SHARE * density + (1.0 - SHARE) * s.pdf;
        s.weight *= 1.0 / drawn;
        let comes = Some(comes(self.irradiance(), density, s.wi.z));
        Some(Guided { s, drawn, comes })
    }
}

/// Radiance expected from a direction with a cosine to the normal.
#[inline(always)]
fn comes(irradiance: f32, density: f32, cos: f32) -> f32 {
    irradiance * density / cos.abs().max(COS_MIN)
}

/// What is expected along a surface is not to be trusted.
pub(crate) const COS_MIN: f32 = 0.01;

/// Chance of a path to go on, given its throughput (luminance, times the number of paths of the sample), the radiance that is
/// expected from where it goes and the luminance that the camera is expected to see [Vorba16]. It is no less than the
/// throughput: as what is expected may be wrong, no path that goes on is to carry more than one from the camera.
#[inline(always)]
pub(crate) fn keep(throughput: f32, comes: f32, expected: f32) -> f32 {
    let brings = throughput * comes;
    (BRINGS_FACTOR * brings / expected).max(throughput).min(1.0)
}

/// What is known where a surface scatters, if it can be made use of there.
#[inline]
pub(crate) fn mark_of(guide: &Guide, it: &Interaction, shading: &Shading, wo: Vec3) -> Mark {
    if shading.bsdf.takes_guidance() {
        guide.mark(it.p, it.ng, -wo)
    } else {
        Mark::NONE
    }
}

#[cfg(test)]
mod tests;
