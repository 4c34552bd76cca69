//! Eight clusters of lights side by side: bounds on what each can send to a point, in lanes.

use super::tree::LightBounds;
use crate::accel::simd::{Lanes, Simd};
use glam::Vec3;

/// What lights are chosen for at a point: light counts by the cosine of its angle to an axis, or by a
/// power of it, whatever side it comes from.
#[derive(Clone, Copy, Debug)]
pub struct Aim {
    /// Unit length; zero where all directions count alike (in a medium there is no normal).
    pub axis: Vec3,
    /// How often the cosine is squared.
    pub narrow: u32,
}

impl Aim {
    /// All directions count alike.
    pub const ANYWHERE: Aim = Aim {
        axis: Vec3::ZERO,
        narrow: 0,
    };

    /// By the cosine to a normal.
    #[inline]
    pub fn cosine(axis: Vec3) -> Aim {
        Aim { axis, narrow: 0 }
    }
}

/// What directions far off a narrow axis count at least: a lobe has a tail.
pub(super) const LEAST: f32 = 0.02;

/// What is known of eight clusters of lights.
#[derive(Clone, Debug)]
#[repr(C, align(64))]
pub struct Cluster {
    /// Centres of the boxes.
    pub(super) center: [[f32; 8]; 3],
    /// Half diagonals of the boxes.
    pub(super) radius: [f32; 8],
    /// Axes of the normals, unit length.
    pub(super) axis: [[f32; 8]; 3],
    /// Largest angle between a normal and the axis.
    pub(super) cos_normals: [f32; 8],
    pub(super) sin_normals: [f32; 8],
    /// Cosine of the largest angle from its normal at which a light shines.
    pub(super) cos_emission: [f32; 8],
    /// -1 where both sides of the surfaces shine, else 1.
    pub(super) sided: [f32; 8],
    /// Peak intensities, summed; 0 in an empty lane.
    pub(super) strength: [f32; 8],
}

impl Cluster {
    /// Of up to eight clusters; an empty lane has the bound 0.
    pub fn new(clusters: impl Iterator<Item = Option<LightBounds>>) -> Cluster {
        let mut out = Cluster {
            center: [[0.0; 8]; 3],
            radius: [0.0; 8],
            axis: [[0.0; 8], [0.0; 8], [1.0; 8]],
            cos_normals: [1.0; 8],
            sin_normals: [0.0; 8],
            cos_emission: [1.0; 8],
            sided: [1.0; 8],
            strength: [0.0; 8],
        };
        for (lane, b) in clusters.take(8).enumerate() {
            let Some(b) = b else { continue };
            let center = (b.min + b.max) * 0.5;
            for axis in 0..3 {
                out.center[axis][lane] = center[axis];
                out.axis[axis][lane] = b.axis[axis];
            }
            out.radius[lane] = crate::math::length(b.max - center);
            out.cos_normals[lane] = b.cos_normals;
            out.sin_normals[lane] = crate::math::safe_sqrt(1.0 - b.cos_normals * b.cos_normals);
            out.cos_emission[lane] = b.cos_emission;
            out.sided[lane] = if b.two_sided { -1.0 } else { 1.0 };
            out.strength[lane] = b.strength;
        }
        out
    }
}

/// For each cluster a bound on what its lights can send to a point with a normal, up to a common
/// factor [ConEstevez18], in the form of [Pbrt4, 12.6.3].
///
/// No closure and no `map` over arrays here: they are functions of their own, compiled without the
/// instructions of the level, and are then not inlined.
#[inline(always)]
pub fn importances<S: Simd>(cluster: &Cluster, p: Vec3, aim: Aim) -> [f32; 8] {
    let (zero, one) = (S::F8::splat(0.0), S::F8::splat(1.0));
    let d = [
        S::F8::splat(p.x).sub(S::F8::load(&cluster.center[0])),
        S::F8::splat(p.y).sub(S::F8::load(&cluster.center[1])),
        S::F8::splat(p.z).sub(S::F8::load(&cluster.center[2])),
    ];
    let distance2 = dot::<S>(d, d).max(S::F8::splat(1e-30));
    let distance = distance2.sqrt();
    let inverse = one.div(distance);
    let wi = [d[0].mul(inverse), d[1].mul(inverse), d[2].mul(inverse)];
    // The cone that the sphere around the box fills; inside of it every direction is possible.
    let radius = S::F8::load(&cluster.radius);
    let sin = radius.mul(inverse);
    let sin_box = distance.select_le(radius, zero, sin);
    let cos_box = distance.select_le(radius, S::F8::splat(-1.0), cosine::<S>(sin));
    // Angle to the nearest normal, as seen from the nearest point of the box.
    let axis = [
        S::F8::load(&cluster.axis[0]),
        S::F8::load(&cluster.axis[1]),
        S::F8::load(&cluster.axis[2]),
    ];
    let cos_axis = dot::<S>(wi, axis);
    let cos_axis = zero.select_le(S::F8::load(&cluster.sided), cos_axis, cos_axis.abs());
    let sin_axis = cosine::<S>(cos_axis);
    let (cos_x, sin_x) = subtract::<S>(
        (cos_axis, sin_axis),
        (
            S::F8::load(&cluster.cos_normals),
            S::F8::load(&cluster.sin_normals),
        ),
    );
    let (cos_out, _) = subtract::<S>((cos_x, sin_x), (cos_box, sin_box));
    let Aim { axis, narrow } = aim;
    let cos_in = if axis == Vec3::ZERO {
        one
    } else {
        let axis = [
            S::F8::splat(axis.x),
            S::F8::splat(axis.y),
            S::F8::splat(axis.z),
        ];
        let cos = dot::<S>(wi, axis).abs();
        let (mut cos, _) = subtract::<S>((cos, cosine::<S>(cos)), (cos_box, sin_box));
        if narrow > 0 {
            for _ in 0..narrow {
                cos = cos.mul(cos);
            }
            cos = cos.max(S::F8::splat(LEAST));
        }
        cos
    };
    // Lights close to the point must not make the bound infinite.
    let falloff = distance2.max(radius);
    let bound = S::F8::load(&cluster.strength)
        .mul(cos_out)
        .mul(cos_in)
        .div(falloff);
    cos_out
        .select_le(S::F8::load(&cluster.cos_emission), zero, bound)
        .max(zero)
        .store()
}

#[inline(always)]
fn dot<S: Simd>(a: [S::F8; 3], b: [S::F8; 3]) -> S::F8 {
    a[0].mul(b[0]).add(a[1].mul(b[1])).add(a[2].mul(b[2]))
}

/// The cosine to a sine, or the other way round.
#[inline(always)]
fn cosine<S: Simd>(sin: S::F8) -> S::F8 {
    S::F8::splat(1.0)
        .sub(sin.mul(sin))
        .max(S::F8::splat(0.0))
        .sqrt()
}

/// Cosine and sine of max(0, a - b), both given as (cosine, sine).
#[inline(always)]
fn subtract<S: Simd>(a: (S::F8, S::F8), b: (S::F8, S::F8)) -> (S::F8, S::F8) {
    let cos = a.0.mul(b.0).add(a.1.mul(b.1));
    let sin = a.1.mul(b.0).sub(a.0.mul(b.1));
    (
        a.0.select_le(b.0, cos, S::F8::splat(1.0)),
        a.0.select_le(b.0, sin, S::F8::splat(0.0)),
    )
}
