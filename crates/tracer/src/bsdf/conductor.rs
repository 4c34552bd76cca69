//! Metal: GGX with the Fresnel reflectance of a complex index of refraction [CookTorrance82],
//! [Walter07]. Single scattering: what bounces between facets is lost, up to 40 % at alpha 1.

use super::ggx::{GgxLanes, mirrored, mirrored_lanes};
use super::lanes::{self, AimOf, Lanes, Params, Samples};
use super::{BsdfSample, Ggx, above, fresnel_conductor, to_side_of};
use crate::lanes::{Float, Row, V3, Wide};
use crate::math::Rgb;
use glam::{Vec2, Vec3};

/// f = D G F / (4 cos cos), or a delta lobe where the widths are below 1e-3.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Conductor {
    eta: Rgb,
    k: Rgb,
    ggx: Ggx,
}

impl Conductor {
    /// With the optical constants relative to the medium outside and the GGX widths.
    #[inline]
    pub fn new(eta: Rgb, k: Rgb, alpha_x: f32, alpha_y: f32) -> Self {
        Conductor {
            eta,
            k,
            ggx: Ggx::new(alpha_x, alpha_y),
        }
    }

    #[inline]
    pub(super) fn is_delta(&self) -> bool {
        self.ggx.is_smooth()
    }

    #[inline]
    pub(super) fn narrowness(&self) -> u32 {
        self.ggx.narrowness()
    }

    #[inline]
    pub(super) fn eval_pdf(&self, wo: Vec3, wi: Vec3) -> (Rgb, f32) {
        let (false, Some((wo, wi))) = (self.is_delta(), above(wo, wi)) else {
            return (Rgb::ZERO, 0.0);
        };
        let (f, pdf, cos) = self.ggx.reflection(wo, wi);
        (fresnel_conductor(cos, self.eta, self.k) * f, pdf)
    }

    #[inline]
    pub(super) fn sample(&self, wo: Vec3, u: Vec2) -> Option<BsdfSample> {
        if wo.z == 0.0 {
            return None;
        }
        let wo_up = wo.with_z(wo.z.abs());
        if self.is_delta() {
            return Some(BsdfSample {
                delta: true,
                ..BsdfSample::reflected(
                    Vec3::new(-wo.x, -wo.y, wo.z),
                    fresnel_conductor(wo_up.z, self.eta, self.k),
                    1.0,
                )
            });
        }
        let wi = mirrored(wo_up, self.ggx.sample_visible(wo_up, u));
        if wi.z <= 0.0 {
            return None;
        }
        let (_, pdf, cos) = self.ggx.reflection(wo_up, wi);
        let weight = fresnel_conductor(cos, self.eta, self.k) * self.ggx.shadowing(wo_up, wi);
        Some(BsdfSample::reflected(to_side_of(wo, wi), weight, pdf))
    }

    /// Fresnel at the shading normal; leaves out shadowing.
    #[inline]
    pub(super) fn albedo(&self, wo: Vec3) -> Rgb {
        fresnel_conductor(wo.z.abs(), self.eta, self.k)
    }

    /// For lanes: eta, k, the widths; how narrow the lobe is (bits).
    pub(crate) fn params(&self) -> Params {
        let ([er, eg, eb], [kr, kg, kb]) = (self.eta.to_array(), self.k.to_array());
        let (ax, ay) = self.ggx.widths();
        let narrow = f32::from_bits(self.narrowness());
        [
            Row([er, eg, eb, kr, kg, kb, ax, ay]),
            Row([narrow, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0]),
        ]
    }
}

/// One a lane.
#[derive(Clone, Copy)]
pub(crate) struct ConductorLanes<W: Wide<N>, const N: usize> {
    eta: V3<W, N>,
    k: V3<W, N>,
    ggx: GgxLanes<W, N>,
    narrow: W::F,
}

impl<W: Wide<N>, const N: usize> Lanes<W, N> for ConductorLanes<W, N> {
    const AIM: AimOf = AimOf::Mirrored;

    #[inline(always)]
    fn new([[er, eg, eb, kr, kg, kb, ax, ay], [narrow, ..]]: [[W::F; 8]; 2]) -> Self {
        ConductorLanes {
            eta: V3::new(er, eg, eb),
            k: V3::new(kr, kg, kb),
            ggx: GgxLanes { ax, ay },
            narrow,
        }
    }

    #[inline(always)]
    fn is_delta(&self) -> W::M {
        self.ggx.is_smooth()
    }

    #[inline(always)]
    fn eval_pdf(&self, wo: V3<W, N>, wi: V3<W, N>) -> (V3<W, N>, W::F) {
        let zero = W::F::splat(0.0);
        let nothing = self.is_delta() | (wo.z * wi.z).le(zero);
        let (wo, wi) = (wo.with_z(wo.z.abs()), wi.with_z(wi.z.abs()));
        let (f, pdf, cos) = self.ggx.reflection(wo, wi);
        let f = lanes::fresnel_conductor(cos, self.eta, self.k) * f;
        (
            V3::select(nothing, V3::new(zero, zero, zero), f),
            W::F::select(nothing, zero, pdf),
        )
    }

    #[inline(always)]
    fn sample(&self, wo: V3<W, N>, _: W::F, u: (W::F, W::F)) -> Samples<W, N> {
        let (zero, one) = (W::F::splat(0.0), W::F::splat(1.0));
        let delta = self.is_delta();
        let up = wo.with_z(wo.z.abs());
        let facet = self.ggx.sample_visible(up, u);
        let wi = mirrored_lanes(up, facet);
        let wi = V3::select(delta, V3::new(-wo.x, -wo.y, up.z), wi);
        let (_, pdf, cos) = self.ggx.reflection(up, wi);
        let cos = W::F::select(delta, up.z, cos);
        let fresnel = lanes::fresnel_conductor(cos, self.eta, self.k);
        let rough = fresnel * self.ggx.shadowing(up, wi);
        Samples {
            wi: lanes::to_side_of(wo, wi),
            weight: V3::select(delta, fresnel, rough),
            pdf: W::F::select(delta, one, pdf),
            eta: one,
            delta,
            any: !wo.z.eq(zero) & (delta | !wi.z.le(zero)),
        }
    }

    #[inline(always)]
    fn albedo(&self, wo: V3<W, N>) -> V3<W, N> {
        lanes::fresnel_conductor(wo.z.abs(), self.eta, self.k)
    }

    #[inline(always)]
    fn narrowness(&self) -> W::F {
        self.narrow
    }
}
