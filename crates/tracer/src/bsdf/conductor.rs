//! Metal: GGX with the Fresnel reflectance of a complex index of refraction [CookTorrance82],
//! [Walter07]. Single scattering: what bounces between facets is lost, up to 40 % at alpha 1.

use super::ggx::mirrored;
use super::{BsdfSample, Ggx, above, fresnel_conductor, to_side_of};
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
}
