//! Camera rays, in lanes where the camera is of the usual kind.

use super::Wave;
use super::paths::{self, Paths};
use crate::lanes::{Float, Int, Row, V3, Wide};
use crate::render::camera_ray;
use crate::sampler::CAMERA;
use crate::sampler::{self, PixelPoints, Sampler};
use glam::Vec2;
use scene::model::SamplerKind;

/// Makes the rays of all samples, and the weights of the pixel filter.
#[inline(always)]
pub(super) fn rays<W: Wide<N>, const N: usize>(wave: &Wave, paths: &mut Paths) {
    let scene = wave.scene;
    if scene.sampler != SamplerKind::Lattice || !scene.camera.suits_lanes() {
        for sample in 0..paths.samples() {
            let at = paths.slot_of(sample);
            let whole = paths.pixel(at).whole;
            let mut points = PixelPoints::new(scene.sampler, paths.pixel_key(at as u32));
            let mut sampler = Sampler::start(&mut points, paths.index(at));
            let (ray, weight) = camera_ray(scene, whole, &mut sampler);
            paths.rays_mut()[sample] = bytemuck::cast(ray);
            paths.radiance[at] = Row([0.0, 0.0, 0.0, weight, 0.0, 0.0, 0.0, 0.0]);
        }
        return;
    }
    let one = W::F::splat(1.0);
    paths.make_keys(CAMERA, paths.samples());
    for begin in (0..paths.samples()).step_by(N) {
        let rays: [u32; N] = paths::in_turn(begin, paths.samples());
        let mut slots = rays;
        for slot in &mut slots {
            *slot = paths.slot_of(*slot as usize) as u32;
        }
        let mut shifts = [Row::ZERO; N];
        let mut reversed = [0; N];
        let mut center = [Row::default(); 2];
        for lane in 0..N {
            let slot = slots[lane];
            shifts[lane] = Row(bytemuck::cast(paths.keys(slot, CAMERA).shift));
            reversed[lane] = paths.index(slot as usize).reverse_bits();
            let [x, y] = paths.pixel(slot as usize).whole;
            center[0].0[lane] = x as f32 + 0.5;
            center[1].0[lane] = y as f32 + 0.5;
        }
        let shifts = W::turn(&shifts);
        let reversed = W::I::load(&reversed);
        let [fx, fy, lx, ly, moment] = sampler::camera_in_lanes::<W, N>(reversed, shifts);
        let (dx, dy, weight) = match scene.filter.is_box() {
            Some((rx, ry)) => {
                let two = W::F::splat(2.0);
                let dx = (two * fx - one) * W::F::splat(rx);
                let dy = (two * fy - one) * W::F::splat(ry);
                (dx, dy, one)
            }
            None => offsets::<W, N>(wave, fx, fy),
        };
        let x = (W::F::load(&center[0]) + dx) / W::F::splat(scene.full_size[0] as f32);
        let y = (W::F::load(&center[1]) + dy) / W::F::splat(scene.full_size[1] as f32);
        let (o, d, time): (V3<W, N>, V3<W, N>, W::F) =
            scene.camera.ray_in_lanes::<W, N>([x, y], [lx, ly], moment);
        let end = W::F::splat(f32::INFINITY);
        paths::scatter::<W, N>(
            paths.rays_mut(),
            &rays,
            [o.x, o.y, o.z, d.x, d.y, d.z, end, time],
        );
        let zero = W::F::splat(0.0);
        paths::scatter::<W, N>(
            &mut paths.radiance,
            &slots,
            [zero, zero, zero, weight, zero, zero, zero, zero],
        );
    }
}

/// Offsets in the pixel and weights, one lane after another: tables do not come in lanes.
#[inline(always)]
fn offsets<W: Wide<N>, const N: usize>(wave: &Wave, fx: W::F, fy: W::F) -> (W::F, W::F, W::F) {
    let (mut x, mut y, mut weights) = (Row::default(), Row::default(), Row::default());
    fx.store(&mut x);
    fy.store(&mut y);
    for lane in 0..N {
        let (offset, weight) = wave.scene.filter.sample(Vec2::new(x.0[lane], y.0[lane]));
        x.0[lane] = offset.x;
        y.0[lane] = offset.y;
        weights.0[lane] = weight;
    }
    (W::F::load(&x), W::F::load(&y), W::F::load(&weights))
}
