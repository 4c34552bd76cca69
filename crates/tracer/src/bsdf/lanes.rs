//! Scattering for many vertices at once: the contract. Each model's lanes are beside the model, do what
//! it does and round as it rounds.

use crate::lanes::{Float, Row, V3, Wide};

/// Numbers that describe a model at a vertex, as materials keep them.
pub(crate) type Params = [Row; 2];

/// Sampled directions, one a lane; see [`BsdfSample`](super::BsdfSample).
pub(crate) struct Samples<W: Wide<N>, const N: usize> {
    /// Where light comes from.
    pub wi: V3<W, N>,
    /// f |cos| / pdf.
    pub weight: V3<W, N>,
    /// Density.
    pub pdf: W::F,
    /// What roulette multiplies throughputs by, the square of it.
    pub eta: W::F,
    /// Drawn from a delta lobe.
    pub delta: W::M,
    /// There is a direction at all.
    pub any: W::M,
}

/// A scattering model in lanes.
pub(crate) trait Lanes<W: Wide<N>, const N: usize>: Copy {
    /// From columns of parameters ([`Params`]).
    fn new(params: [[W::F; 8]; 2]) -> Self;
    /// Whether there are only delta lobes.
    fn is_delta(&self) -> W::M;
    /// [`Bsdf::eval_pdf`](super::Bsdf::eval_pdf).
    fn eval_pdf(&self, wo: V3<W, N>, wi: V3<W, N>) -> (V3<W, N>, W::F);
    /// [`Bsdf::sample`](super::Bsdf::sample).
    fn sample(&self, wo: V3<W, N>, lobe: W::F, u: (W::F, W::F)) -> Samples<W, N>;
    /// [`Bsdf::albedo`](super::Bsdf::albedo).
    fn albedo(&self, wo: V3<W, N>) -> V3<W, N>;
    /// Which lights matter.
    const AIM: AimOf;
    /// Of a lobe about the mirrored view: how often the cosine is squared (bits); see
    /// [`Reach`](super::Reach).
    fn narrowness(&self) -> W::F {
        W::F::splat(0.0)
    }
}

/// Which lights matter to a model; see [`Reach`](super::Reach).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum AimOf {
    /// By the cosine to the normal.
    Normal,
    /// By a power of the cosine to the mirrored view.
    Mirrored,
    /// All alike.
    Anywhere,
}

/// With the z of both directions turned so that `wo` lies above.
#[inline(always)]
pub(super) fn upright<W: Wide<N>, const N: usize>(
    wo: V3<W, N>,
    wi: V3<W, N>,
) -> (V3<W, N>, V3<W, N>) {
    let below = wo.z.lt(W::F::splat(0.0));
    (
        wo.with_z(wo.z.abs()),
        wi.with_z(W::F::select(below, -wi.z, wi.z)),
    )
}

/// [`super::to_side_of`].
#[inline(always)]
pub(super) fn to_side_of<W: Wide<N>, const N: usize>(wo: V3<W, N>, wi: V3<W, N>) -> V3<W, N> {
    let below = wo.z.lt(W::F::splat(0.0));
    wi.with_z(W::F::select(below, -wi.z, wi.z))
}

/// One channel of [`super::fresnel_conductor`].
#[inline(always)]
fn conductor_channel<W: Wide<N>, const N: usize>(
    eta: W::F,
    k: W::F,
    cos: W::F,
    cos2: W::F,
    sin2: W::F,
) -> W::F {
    let (half, two) = (W::F::splat(0.5), W::F::splat(2.0));
    let re = eta * eta - k * k - sin2;
    let im = two * eta * k;
    let m = (re * re + im * im).sqrt();
    let a = (half * (m + re)).max(W::F::splat(0.0)).sqrt();
    let s = two * a * cos;
    let rs = (m + cos2 - s) / (m + cos2 + s);
    let p = m * cos2 + sin2 * sin2;
    let q = s * sin2;
    let rp = rs * (p - q) / (p + q);
    half * (rs + rp)
}

/// [`super::fresnel_conductor`].
#[inline(always)]
pub(super) fn fresnel_conductor<W: Wide<N>, const N: usize>(
    cos: W::F,
    eta: V3<W, N>,
    k: V3<W, N>,
) -> V3<W, N> {
    let (zero, one) = (W::F::splat(0.0), W::F::splat(1.0));
    let cos = cos.max(zero).min(one);
    let cos2 = cos * cos;
    let sin2 = one - cos2;
    V3 {
        x: conductor_channel::<W, N>(eta.x, k.x, cos, cos2, sin2),
        y: conductor_channel::<W, N>(eta.y, k.y, cos, cos2, sin2),
        z: conductor_channel::<W, N>(eta.z, k.z, cos, cos2, sin2),
    }
}

/// [`super::fresnel_dielectric`].
#[inline(always)]
pub(super) fn fresnel_dielectric<W: Wide<N>, const N: usize>(
    given: W::F,
    eta: W::F,
) -> (W::F, W::F) {
    let (zero, one, half) = (W::F::splat(0.0), W::F::splat(1.0), W::F::splat(0.5));
    let cos = given.min(one);
    let sin2_t = (one - cos * cos) / (eta * eta);
    let total = one.le(sin2_t);
    let cos_t = (one - sin2_t).sqrt();
    let parallel = (eta * cos - cos_t) / (eta * cos + cos_t);
    let perpendicular = (cos - eta * cos_t) / (cos + eta * cos_t);
    let r = (half * (parallel * parallel + perpendicular * perpendicular)).min(one);
    let r = W::F::select(total, one, r);
    let cos_t = W::F::select(total, zero, cos_t);
    let same = eta.eq(one);
    (
        W::F::select(same, zero, r),
        W::F::select(same, given, cos_t),
    )
}
