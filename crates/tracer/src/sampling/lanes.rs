//! Warps of the unit square in lanes, with the roundings of their twins for one point.

use crate::lanes::{Float, Int, V3, Wide};
use crate::math::{COS, FRAC_PI_4, SIN, TWO_PI};

/// [`super::uniform_disk_concentric`], and the signed distance from the centre.
#[inline(always)]
pub(crate) fn concentric<W: Wide<N>, const N: usize>(ux: W::F, uy: W::F) -> (W::F, W::F, W::F) {
    let (zero, one, two) = (W::F::splat(0.0), W::F::splat(1.0), W::F::splat(2.0));
    let x = two * ux - one;
    let y = two * uy - one;
    // Which coordinate of the square is the radius.
    let wide = y.abs().lt(x.abs());
    let r = W::F::select(wide, x, y);
    let ratio = W::F::select(wide, y, x) / r;
    let (sin, cos) = sin_cos_small::<W, N>(W::F::splat(FRAC_PI_4) * ratio);
    let is_center = r.eq(zero);
    let px = r * W::F::select(wide, cos, sin);
    let py = r * W::F::select(wide, sin, cos);
    (
        W::F::select(is_center, zero, px),
        W::F::select(is_center, zero, py),
        W::F::select(is_center, zero, r),
    )
}

/// [`super::cosine_hemisphere`].
#[inline(always)]
pub(crate) fn cosine_hemisphere<W: Wide<N>, const N: usize>(
    ux: W::F,
    uy: W::F,
) -> (W::F, W::F, W::F) {
    let one = W::F::splat(1.0);
    let (x, y, r) = concentric::<W, N>(ux, uy);
    let height2 = (one - r) * (one + r);
    (x, y, height2.max(W::F::splat(0.0)).sqrt())
}

/// [`sin_cos_small`](crate::math::sin_cos_small).
#[inline(always)]
pub(crate) fn sin_cos_small<W: Wide<N>, const N: usize>(x: W::F) -> (W::F, W::F) {
    let [s0, s1, s2] = SIN;
    let [c0, c1, c2] = COS;
    let z = x * x;
    let tail = W::F::splat(s0) + z * (W::F::splat(s1) + z * W::F::splat(s2));
    let sin = x + x * z * tail;
    let tail = W::F::splat(c0) + z * (W::F::splat(c1) + z * W::F::splat(c2));
    let cos = (W::F::splat(1.0) - W::F::splat(0.5) * z) + z * z * tail;
    (sin, cos)
}

/// [`sin_cos_2pi`](crate::math::sin_cos_2pi).
#[inline(always)]
pub(crate) fn sin_cos_2pi<W: Wide<N>, const N: usize>(u: W::F) -> (W::F, W::F) {
    let (none, one, two) = (W::I::splat(0), W::I::splat(1), W::I::splat(2));
    let quarter = (u * W::F::splat(4.0) + W::F::splat(0.5)).to_int();
    let left = u - W::F::splat(0.25) * W::F::from_int(quarter);
    let (s, c) = sin_cos_small::<W, N>(left * W::F::splat(TWO_PI));
    let is_even = (quarter & one).eq(none);
    let sin = W::F::select(is_even, s, c);
    let cos = W::F::select(is_even, c, s);
    let sin = W::F::select((quarter & two).eq(none), sin, -sin);
    let cos = W::F::select(((quarter + one) & two).eq(none), cos, -cos);
    (sin, cos)
}

/// [`super::uniform_cone`].
#[inline(always)]
pub(crate) fn uniform_cone<W: Wide<N>, const N: usize>(
    ux: W::F,
    uy: W::F,
    one_minus_cos: W::F,
) -> V3<W, N> {
    let zero = W::F::splat(0.0);
    let h = ux * one_minus_cos;
    let z = W::F::splat(1.0) - h;
    let sin = (h * (W::F::splat(2.0) - h)).max(zero).sqrt();
    let (s, c) = sin_cos_2pi::<W, N>(uy);
    V3::new(sin * c, sin * s, z)
}
