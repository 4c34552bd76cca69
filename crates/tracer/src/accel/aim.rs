//! Rays made ready for the kernel in lanes, with the bits of [`Aim::new`].

use super::SimdLevel;
use super::kernel::{Aim, FAR_SLACK, OTHERS, TINY};
use super::simd::Simd;
use crate::lanes::{Float, Int, Row, Wide, entry};
use crate::ray::Ray;
use bytemuck::Zeroable;

impl Aim {
    /// Of all rays.
    #[inline(always)]
    fn all<W: Wide<N>, const N: usize>(rays: &[Ray], aims: &mut [Aim]) {
        let rows: &[Row] = bytemuck::cast_slice(rays);
        for (rows, aims) in rows.chunks(N).zip(aims.chunks_mut(N)) {
            let mut at = [rows.len() as u32 - 1; N];
            for (lane, at) in at.iter_mut().enumerate().take(rows.len()) {
                *at = lane as u32;
            }
            let made = Aim::of::<W, N>(W::gather(rows, &at));
            // Row by row: what has been stored in parts is slow to load as a whole.
            let (to, _) = bytemuck::cast_slice_mut::<Aim, Row>(aims).as_chunks_mut::<3>();
            for (lane, to) in to.iter_mut().enumerate() {
                to[0] = made[0][lane];
                to[1] = made[1][lane];
                to[2] = made[2][lane];
            }
        }
    }

    /// Aims in three rows each, of the columns of rays.
    #[inline(always)]
    fn of<W: Wide<N>, const N: usize>(rays: [W::F; 8]) -> [[Row; N]; 3] {
        let [ox, oy, oz, dx, dy, dz, ..] = rays;
        let (x, y, z) = (dx.abs(), dy.abs(), dz.abs());
        let along = (y.lt(x) & z.lt(x), z.lt(y));
        let main = pick::<W, N>(along, [dx, dy, dz]);
        let one = W::F::splat(1.0);
        let shear = [
            pick::<W, N>(along, [dy, dz, dx]) / main,
            pick::<W, N>(along, [dz, dx, dy]) / main,
            one / main,
        ];
        let start = [
            pick::<W, N>(along, [oy, oz, ox]),
            pick::<W, N>(along, [oz, ox, oy]),
            pick::<W, N>(along, [ox, oy, oz]),
        ];
        let slack = W::F::splat(FAR_SLACK);
        let (sx, sy, sz) = (safe::<W, N>(dx), safe::<W, N>(dy), safe::<W, N>(dz));
        let (ix, iy, iz) = (one / sx, one / sy, one / sz);
        let [a, b, c] = OTHERS;
        let kx = axes::<W, N>(along, [a[0], b[0], c[0]]);
        let ky = axes::<W, N>(along, [a[1], b[1], c[1]]);
        let kz = axes::<W, N>(along, [0, 1, 2]);
        let near = [
            near::<W, N>(sx, 0),
            near::<W, N>(sy, 64),
            near::<W, N>(sz, 128),
        ];
        let none = W::F::splat(0.0);
        [
            W::records([ox, oy, oz, ix, iy, iz, ix * slack, iy * slack]),
            W::records([iz * slack, near[0], near[1], near[2], kx, ky, kz, start[0]]),
            W::records([
                start[1], start[2], shear[0], shear[1], shear[2], none, none, none,
            ]),
        ]
    }
}

/// See [`kernel::safe`](super::kernel::safe).
#[inline(always)]
pub fn safe<W: Wide<N>, const N: usize>(x: W::F) -> W::F {
    let tiny = W::F::splat(TINY);
    W::F::select(x.abs().lt(tiny), tiny.copysign(x), x)
}

/// What belongs to x, y or z, by where a direction is longest.
#[inline(always)]
pub fn pick<W: Wide<N>, const N: usize>((x, y): (W::M, W::M), of: [W::F; 3]) -> W::F {
    W::F::select(x, of[0], W::F::select(y, of[1], of[2]))
}

/// [`Aim::axes`] as bits.
#[inline(always)]
fn axes<W: Wide<N>, const N: usize>(along: (W::M, W::M), [a, b, c]: [usize; 3]) -> W::F {
    let of = [
        bits::<W, N>(16 * a as u32),
        bits::<W, N>(16 * b as u32),
        bits::<W, N>(16 * c as u32),
    ];
    pick::<W, N>(along, of)
}

/// [`Aim::near`] as bits.
#[inline(always)]
fn near<W: Wide<N>, const N: usize>(d: W::F, from: u32) -> W::F {
    let is_negative = d.lt(W::F::splat(0.0));
    W::F::select(is_negative, bits::<W, N>(from + 32), bits::<W, N>(from))
}

#[inline(always)]
fn bits<W: Wide<N>, const N: usize>(x: u32) -> W::F {
    W::F::from_bits(W::I::splat(x))
}

/// Rays that are made ready at a time.
pub const AHEAD: usize = 64;

/// The aims of rays that are taken one after another.
pub struct Ahead<'a> {
    rays: &'a [Ray],
    level: SimdLevel,
    aims: [Aim; AHEAD],
}

impl<'a> Ahead<'a> {
    /// Of rays.
    #[inline(always)]
    pub fn new(level: SimdLevel, rays: &'a [Ray]) -> Self {
        let aims = [Aim::zeroed(); AHEAD];
        Ahead { rays, level, aims }
    }

    /// That of a ray: the first, or the one after the last that was asked for.
    #[inline(always)]
    pub fn aim<S: Simd>(&mut self, index: usize) -> &Aim {
        if index.is_multiple_of(AHEAD) {
            let rays = &self.rays[index..];
            let rays = &rays[..rays.len().min(AHEAD)];
            let aims = &mut self.aims[..rays.len()];
            if self.level >= SimdLevel::Avx2 {
                all(self.level, rays, aims);
            } else {
                // Plain lanes are slower than one ray after another.
                for (ray, aim) in rays.iter().zip(aims) {
                    *aim = Aim::new::<S>(ray.origin, ray.direction);
                }
            }
        }
        &self.aims[index % AHEAD]
    }
}

entry! {
    /// Makes rays ready.
    pub fn all(rays: &[Ray], aims: &mut [Aim]) -> () = Aim::all;
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::accel::simd::Scalar;
    use crate::accel::tests::{levels, point};
    use glam::Vec3;
    use rand::{SeedableRng, rngs::StdRng};

    #[test]
    fn lanes_make_rays_ready_as_single_rays_are() {
        let mut rng = StdRng::seed_from_u64(41);
        let odd = [0.0, -0.0, 1e-30, -1e-30, 1.0, -1.0, f32::MAX];
        let mut rays = vec![];
        for i in 0..700 {
            let mut direction = point(&mut rng, 1.0);
            for axis in 0..3 {
                if i / 7 % 4 == axis {
                    direction[axis] = odd[i % 7];
                }
            }
            if i % 50 == 0 {
                direction = Vec3::splat(odd[i / 50 % 7]);
            }
            rays.push(Ray::new(point(&mut rng, 9.0), direction, 0.0));
        }
        let bits = |aim: &Aim| -> [u32; 24] { bytemuck::cast(*aim) };
        for level in levels() {
            for count in [1, 7, 8, 17, 63, 64, 65, rays.len()] {
                let mut ahead = Ahead::new(level, &rays[..count]);
                let mut aims = vec![Aim::zeroed(); count];
                all(level, &rays[..count], &mut aims);
                for (index, ray) in rays[..count].iter().enumerate() {
                    let expected = Aim::new::<Scalar>(ray.origin, ray.direction);
                    let made = &aims[index];
                    let same = |(a, b): (u32, u32)| {
                        a == b || (f32::from_bits(a).is_nan() && f32::from_bits(b).is_nan())
                    };
                    let mut pairs = bits(made).into_iter().zip(bits(&expected));
                    assert!(
                        pairs.all(same),
                        "{level:?}, {ray:?}: {made:?} instead of {expected:?}"
                    );
                    let mut pairs = bits(ahead.aim::<Scalar>(index)).into_iter().zip(bits(made));
                    assert!(pairs.all(same), "{level:?}, ray {index} of {count}");
                }
            }
        }
    }
}
