//! The microfacet distribution GGX (Trowbridge-Reitz), anisotropic, with height-correlated masking and
//! sampling of visible normals.
//!
//! D(m) = 1 / (pi ax ay (m.x^2 / ax^2 + m.y^2 / ay^2 + m.z^2)^2) [Walter07, eq. 33], [Burley12, eq. 13].
//! With l(w) = sqrt(ax^2 w.x^2 + ay^2 w.y^2 + w.z^2) Smith's function is Lambda = (l / |w.z| - 1) / 2 and
//! everything that is needed becomes a ratio without divisions by small cosines [Heitz14]:
//! G1(o) = 2 o.z / (o.z + l(o)), G(o, i) = 1 / (1 + Lambda(o) + Lambda(i)) = 2 o.z i.z / (i.z l(o) + o.z l(i)).
//! Directions in this file lie above; of a transmitted direction only z counts, so it may be mirrored.

use crate::lanes::{Float, V3, Wide};
use crate::math::{INV_PI, length, normalize, safe_sqrt, sin_cos_2pi};
use crate::sampling;
use glam::{Vec2, Vec3};

/// Below this width a surface counts as perfectly smooth.
pub(super) const SMOOTH: f32 = 1e-3;

/// Widths along the tangent and the bitangent.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Ggx {
    ax: f32,
    ay: f32,
}

/// Most squarings of [`Ggx::narrowness`].
const NARROWEST: u32 = 9;

impl Ggx {
    /// With the widths alpha.
    #[inline]
    pub fn new(ax: f32, ay: f32) -> Self {
        if ax.max(ay) < SMOOTH {
            return Ggx { ax: 0.0, ay: 0.0 };
        }
        // Where one direction is rough, the other cannot be perfectly smooth.
        Ggx {
            ax: ax.max(1e-4),
            ay: ay.max(1e-4),
        }
    }

    /// Whether it is a mirror.
    #[inline]
    pub fn is_smooth(&self) -> bool {
        self.ax == 0.0
    }

    /// How often the cosine to the mirrored direction has to be squared to fall about as fast as the
    /// reflected lobe: that is e^(-x^2 / (4 alpha^2)) for small angles x, and cos^n x is e^(-n x^2 / 2).
    #[inline]
    pub(super) fn narrowness(&self) -> u32 {
        let power = 0.5 / (self.ax * self.ay);
        // The exponent of a float is its logarithm, rounded down.
        (power.to_bits() >> 23).saturating_sub(127).min(NARROWEST)
    }

    /// The same distribution with both variances of slope added to: widths sqrt(s alpha^2 + t^2).
    #[inline]
    pub(super) fn widened(&self, s: f32, tx2: f32, ty2: f32) -> Self {
        Ggx {
            ax: (s * self.ax * self.ax + tx2).sqrt().clamp(SMOOTH, 1.0),
            ay: (s * self.ay * self.ay + ty2).sqrt().clamp(SMOOTH, 1.0),
        }
    }

    /// Widths along x and y.
    #[inline]
    pub(super) fn widths(&self) -> (f32, f32) {
        (self.ax, self.ay)
    }

    /// Density of microfacet normals: D(m) m.z integrates to 1 over the hemisphere.
    #[inline]
    pub fn d(&self, m: Vec3) -> f32 {
        let x = m.x / self.ax;
        let y = m.y / self.ay;
        let e = x * x + y * y + m.z * m.z;
        INV_PI / (self.ax * self.ay * e * e)
    }

    /// l(w) of the module's documentation.
    #[inline]
    pub(super) fn l(&self, w: Vec3) -> f32 {
        let x = self.ax * w.x;
        let y = self.ay * w.y;
        (x * x + y * y + w.z * w.z).sqrt()
    }

    /// A normal as `wo` sees them: density D(m) G1(wo) max(0, wo.m) / wo.z. In the space where the
    /// widths are 1 the mirror image of `wo` is uniform on a spherical cap [DupuyBenyoub23, listing 3].
    #[inline]
    pub fn sample_visible(&self, wo: Vec3, u: Vec2) -> Vec3 {
        let stretched = normalize(Vec3::new(self.ax * wo.x, self.ay * wo.y, wo.z));
        let (sin_phi, cos_phi) = sin_cos_2pi(u.x);
        let z = (1.0 - u.y) * (1.0 + stretched.z) - stretched.z;
        let sin = safe_sqrt((1.0 - z) * (1.0 + z));
        let h = Vec3::new(sin * cos_phi, sin * sin_phi, z) + stretched;
        normalize(Vec3::new(self.ax * h.x, self.ay * h.y, h.z.max(1e-6)))
    }

    /// D(m) G(wo, wi) / (4 wo.z), the density with which sampling visible normals and mirroring `wo`
    /// gives `wi`, and the cosine wo.m; the first is f |cos| for a perfectly reflecting facet.
    #[inline]
    pub(super) fn reflection(&self, wo: Vec3, wi: Vec3) -> (f32, f32, f32) {
        let h = wo + wi;
        let m = h * (1.0 / length(h));
        let d = self.d(m);
        let (lo, li) = (self.l(wo), self.l(wi));
        let cos = wo.x * m.x + wo.y * m.y + wo.z * m.z;
        (
            0.5 * d * wi.z / (wi.z * lo + wo.z * li),
            0.5 * d / (wo.z + lo),
            cos,
        )
    }

    /// G(wo, wi) / G1(wo): the weight of a sampled direction; wi.z > 0.
    #[inline]
    pub(super) fn shadowing(&self, wo: Vec3, wi: Vec3) -> f32 {
        let (lo, li) = (self.l(wo), self.l(wi));
        wi.z * (wo.z + lo) / (wi.z * lo + wo.z * li)
    }
}

/// `w` mirrored about the unit vector `m`.
#[inline]
pub(super) fn mirrored(w: Vec3, m: Vec3) -> Vec3 {
    let d = w.x * m.x + w.y * m.y + w.z * m.z;
    m * (2.0 * d) - w
}

/// A distribution in each lane.
#[derive(Clone, Copy)]
pub(super) struct GgxLanes<W: Wide<N>, const N: usize> {
    pub ax: W::F,
    pub ay: W::F,
}

impl<W: Wide<N>, const N: usize> GgxLanes<W, N> {
    #[inline(always)]
    pub fn is_smooth(&self) -> W::M {
        self.ax.eq(W::F::splat(0.0))
    }

    /// See [`Ggx::d`].
    #[inline(always)]
    pub fn d(&self, m: V3<W, N>) -> W::F {
        let x = m.x / self.ax;
        let y = m.y / self.ay;
        let e = x * x + y * y + m.z * m.z;
        W::F::splat(INV_PI) / (self.ax * self.ay * e * e)
    }

    /// See [`Ggx::l`].
    #[inline(always)]
    pub fn l(&self, w: V3<W, N>) -> W::F {
        let x = self.ax * w.x;
        let y = self.ay * w.y;
        (x * x + y * y + w.z * w.z).sqrt()
    }

    /// See [`Ggx::sample_visible`].
    #[inline(always)]
    pub fn sample_visible(&self, wo: V3<W, N>, (ux, uy): (W::F, W::F)) -> V3<W, N> {
        let (zero, one) = (W::F::splat(0.0), W::F::splat(1.0));
        let stretched = V3::<W, N>::new(self.ax * wo.x, self.ay * wo.y, wo.z).normalized();
        let (sin_phi, cos_phi) = sampling::lanes::sin_cos_2pi::<W, N>(ux);
        let z = (one - uy) * (one + stretched.z) - stretched.z;
        let sin = ((one - z) * (one + z)).max(zero).sqrt();
        let h = V3::<W, N>::new(sin * cos_phi, sin * sin_phi, z) + stretched;
        V3::<W, N>::new(self.ax * h.x, self.ay * h.y, h.z.max(W::F::splat(1e-6))).normalized()
    }

    /// See [`Ggx::reflection`].
    #[inline(always)]
    pub fn reflection(&self, wo: V3<W, N>, wi: V3<W, N>) -> (W::F, W::F, W::F) {
        let half = W::F::splat(0.5);
        let m = (wo + wi).normalized();
        let d = self.d(m);
        let (lo, li) = (self.l(wo), self.l(wi));
        (
            half * d * wi.z / (wi.z * lo + wo.z * li),
            half * d / (wo.z + lo),
            wo.dot(m),
        )
    }

    /// See [`Ggx::shadowing`].
    #[inline(always)]
    pub fn shadowing(&self, wo: V3<W, N>, wi: V3<W, N>) -> W::F {
        let (lo, li) = (self.l(wo), self.l(wi));
        wi.z * (wo.z + lo) / (wi.z * lo + wo.z * li)
    }
}

/// [`mirrored`] in lanes.
#[inline(always)]
pub(super) fn mirrored_lanes<W: Wide<N>, const N: usize>(w: V3<W, N>, m: V3<W, N>) -> V3<W, N> {
    let d = w.dot(m);
    m * (W::F::splat(2.0) * d) - w
}
