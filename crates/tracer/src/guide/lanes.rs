//! [`Directions`](super::Directions) for as many vertices at once as there are lanes.

use crate::lanes::{Float, Mask, Row, V3, Wide};
use crate::math::ONE_MINUS_EPSILON;

/// Goes down the quadtrees of some lanes, to where uniform numbers lead (`is_drawn`) or to where given directions
/// lie: the directions and their densities per solid angle. Lanes without a root (0) get nothing of use.
#[inline(always)]
pub(crate) fn draw<W: Wide<N>, const N: usize>(
    quads: &[Row],
    roots: &[u32; N],
    is_drawn: W::M,
    numbers: (W::F, W::F),
    given: V3<W, N>,
) -> (V3<W, N>, W::F) {
    let (zero, half, one) = (W::F::splat(0.0), W::F::splat(0.5), W::F::splat(1.0));
    let two = W::F::splat(2.0);
    let (at, length) = to_square::<W, N>(given);
    let mut x = W::F::select(is_drawn, numbers.0, at.0);
    let mut y = W::F::select(is_drawn, numbers.1, at.1);
    let (mut left, mut low, mut size) = (zero, zero, one);
    let mut density = W::F::splat(0.25);
    let mut rows = *roots;
    let mut going = 0;
    for (lane, row) in rows.iter().enumerate() {
        going |= u32::from(*row != 0) << lane;
    }
    while going != 0 {
        let is_going = W::M::from_bits(going);
        let [q, q_left, q_right, _, ll, lr, ul, ur] = W::gather(quads, &rows);
        let (right, new_x, by_x) = divide::<W, N>(x, q, is_drawn);
        let q = W::F::select(right, q_right, q_left);
        let (up, new_y, by_y) = divide::<W, N>(y, q, is_drawn);
        x = W::F::select(is_going, new_x, x);
        y = W::F::select(is_going, new_y, y);
        density = W::F::select(is_going, density * (two * by_x) * (two * by_y), density);
        size = W::F::select(is_going, size * half, size);
        left = left + W::F::select(is_going & right, size, zero);
        low = low + W::F::select(is_going & up, size, zero);
        let lower = W::F::select(right, lr, ll);
        let upper = W::F::select(right, ur, ul);
        let mut children = Row::<N>::default();
        W::F::select(up, upper, lower).store(&mut children);
        let mut goes_on = 0;
        for (lane, row) in rows.iter_mut().enumerate() {
            let child = children.0[lane].to_bits();
            *row = child;
            goes_on |= u32::from(child != 0) << lane;
        }
        going &= goes_on;
    }
    let (drawn, of_drawn) = to_sphere::<W, N>(left + size * x, low + size * y);
    let length = W::F::select(is_drawn, of_drawn, length);
    (
        V3::select(is_drawn, drawn, given),
        density * (length * length * length),
    )
}

#[inline(always)]
fn divide<W: Wide<N>, const N: usize>(u: W::F, first: W::F, is_drawn: W::M) -> (W::M, W::F, W::F) {
    let one = W::F::splat(1.0);
    let border = W::F::select(is_drawn, first, W::F::splat(0.5));
    let second = border.le(u);
    let over = W::F::select(second, u - border, u);
    let width = W::F::select(second, one - border, border);
    let left = (over / width).min(W::F::splat(ONE_MINUS_EPSILON));
    (second, left, W::F::select(second, one - first, first))
}

#[inline(always)]
fn to_sphere<W: Wide<N>, const N: usize>(x: W::F, y: W::F) -> (V3<W, N>, W::F) {
    let (zero, one, two) = (W::F::splat(0.0), W::F::splat(1.0), W::F::splat(2.0));
    let (u, v) = (two * x - one, two * y - one);
    let z = one - (u.abs() + v.abs());
    let behind = z.lt(zero);
    let p = V3::<W, N> {
        x: W::F::select(behind, (one - v.abs()).copysign(u), u),
        y: W::F::select(behind, (one - u.abs()).copysign(v), v),
        z,
    };
    let length = (p.x * p.x + p.y * p.y + p.z * p.z).sqrt();
    (p * (one / length), length)
}

#[inline(always)]
fn to_square<W: Wide<N>, const N: usize>(w: V3<W, N>) -> ((W::F, W::F), W::F) {
    let (zero, half, one) = (W::F::splat(0.0), W::F::splat(0.5), W::F::splat(1.0));
    let most = W::F::splat(ONE_MINUS_EPSILON);
    let length = one / (w.x.abs() + w.y.abs() + w.z.abs());
    let (x, y) = (w.x * length, w.y * length);
    let behind = w.z.lt(zero);
    let u = W::F::select(behind, (one - y.abs()).copysign(x), x);
    let v = W::F::select(behind, (one - x.abs()).copysign(y), y);
    let (u, v) = (half * u + half, half * v + half);
    ((u.min(most), v.min(most)), length)
}
