//! Lambert: the same radiance in all directions.

use super::lanes::{self, AimOf, Lanes, Params, Samples};
use super::{BsdfSample, above, to_side_of};
use crate::lanes::{Float, Mask, Row, V3, Wide};
use crate::math::{INV_PI, Rgb};
use crate::sampling::{self, cosine_hemisphere};
use glam::{Vec2, Vec3};

/// f = r / pi.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Diffuse {
    r: Rgb,
}

impl Diffuse {
    /// With the albedo `r`.
    #[inline]
    pub fn new(r: Rgb) -> Self {
        Diffuse { r }
    }

    #[inline]
    pub(super) fn eval_pdf(&self, wo: Vec3, wi: Vec3) -> (Rgb, f32) {
        if wo.z * wi.z <= 0.0 {
            return (Rgb::ZERO, 0.0);
        }
        let pdf = wi.z.abs() * INV_PI;
        (self.r * pdf, pdf)
    }

    #[inline]
    pub(super) fn sample(&self, wo: Vec3, u: Vec2) -> Option<BsdfSample> {
        let wi = cosine_hemisphere(u);
        above(wo, to_side_of(wo, wi))?;
        Some(BsdfSample::reflected(
            to_side_of(wo, wi),
            self.r,
            wi.z * INV_PI,
        ))
    }

    /// The albedo.
    #[inline]
    pub(crate) fn albedo(&self) -> Rgb {
        self.r
    }

    /// For lanes: the albedo.
    pub(crate) fn params(&self) -> Params {
        let [r, g, b] = self.r.to_array();
        [Row([r, g, b, 0.0, 0.0, 0.0, 0.0, 0.0]), Row::default()]
    }
}

/// One a lane.
#[derive(Clone, Copy)]
pub(crate) struct DiffuseLanes<W: Wide<N>, const N: usize> {
    r: V3<W, N>,
}

impl<W: Wide<N>, const N: usize> Lanes<W, N> for DiffuseLanes<W, N> {
    const AIM: AimOf = AimOf::Normal;

    #[inline(always)]
    fn new([[r, g, b, ..], _]: [[W::F; 8]; 2]) -> Self {
        DiffuseLanes {
            r: V3::new(r, g, b),
        }
    }

    #[inline(always)]
    fn is_delta(&self) -> W::M {
        W::M::from_bits(0)
    }

    #[inline(always)]
    fn eval_pdf(&self, wo: V3<W, N>, wi: V3<W, N>) -> (V3<W, N>, W::F) {
        let zero = W::F::splat(0.0);
        let pdf = wi.z.abs() * W::F::splat(INV_PI);
        let pdf = W::F::select((wo.z * wi.z).le(zero), zero, pdf);
        (self.r * pdf, pdf)
    }

    #[inline(always)]
    fn sample(&self, wo: V3<W, N>, _: W::F, (ux, uy): (W::F, W::F)) -> Samples<W, N> {
        let (x, y, z) = sampling::lanes::cosine_hemisphere::<W, N>(ux, uy);
        let wi = lanes::to_side_of(wo, V3::new(x, y, z));
        Samples {
            wi,
            weight: self.r,
            pdf: z * W::F::splat(INV_PI),
            eta: W::F::splat(1.0),
            delta: W::M::from_bits(0),
            any: !(wo.z * wi.z).le(W::F::splat(0.0)),
        }
    }

    #[inline(always)]
    fn albedo(&self, _: V3<W, N>) -> V3<W, N> {
        self.r
    }
}
