//! From a point on a surface to texture coordinates, and what happens outside of a picture.

use super::{Point, wide};
use crate::light::octahedral;
use crate::math;
use glam::{DAffine3, Vec2, Vec3};
use scene::model::{UvMap, Wrap};

/// Texture coordinates at a point.
#[inline]
pub(super) fn locate(map: &UvMap, at: &Point) -> Vec2 {
    match map {
        UvMap::Uv { set, matrix: m } => {
            let uv = at.uv[(*set as usize).min(1)];
            let (u, v) = (uv.x as f64, uv.y as f64);
            Vec2::new(
                (m[0] * u + m[1] * v + m[2]) as f32,
                (m[3] * u + m[4] * v + m[5]) as f32,
            )
        }
        UvMap::Planar { matrix } => {
            let p = placed(matrix, at);
            Vec2::new(p.x, p.y)
        }
        UvMap::Spherical { matrix } => {
            let p = placed(matrix, at);
            let length = math::length(p);
            let cos = if length > 0.0 { p.z / length } else { 1.0 };
            // From 0 to 2 pi, beginning at +X.
            let phi = math::atan2(p.y, p.x);
            let phi = if phi < 0.0 { phi + math::TWO_PI } else { phi };
            Vec2::new(math::acos(cos) * math::INV_PI, phi * math::INV_2PI)
        }
        UvMap::Cylindrical { matrix } => {
            let p = placed(matrix, at);
            let turn = (math::PI + math::atan2(p.y, p.x)) * math::INV_2PI;
            Vec2::new(turn, p.z)
        }
    }
}

fn placed(matrix: &DAffine3, at: &Point) -> Vec3 {
    let p = matrix.transform_point3(wide(at.p));
    Vec3::new(p.x as f32, p.y as f32, p.z as f32)
}

/// How far the texture coordinates of another point are from `st`, the short way round.
pub(super) fn offset(map: &UvMap, st: Vec2, other: &Point) -> Vec2 {
    let d = locate(map, other) - st;
    let short = |x: f32| x - (x + 0.5).floor();
    match map {
        UvMap::Uv { .. } | UvMap::Planar { .. } => d,
        UvMap::Spherical { .. } => Vec2::new(d.x, short(d.y)),
        UvMap::Cylindrical { .. } => Vec2::new(short(d.x), d.y),
    }
}

/// A pixel index with something done about indices outside, along one axis.
#[inline]
fn wrapped(i: i64, size: i64, wrap: Wrap) -> Option<usize> {
    let j = match wrap {
        Wrap::Repeat => i.rem_euclid(size),
        // Across an edge is a matter of both axes: see `pixel`.
        Wrap::Clamp | Wrap::Octahedral => i.clamp(0, size - 1),
        Wrap::Mirror => {
            let k = i.rem_euclid(2 * size);
            if k < size { k } else { 2 * size - 1 - k }
        }
        Wrap::Black => {
            if i < 0 || i >= size {
                return None;
            }
            i
        }
    };
    Some(j as usize)
}

/// The pixel that stands for a position, which may lie outside; `None` is black.
#[inline]
pub(super) fn pixel(x: i64, y: i64, w: i64, h: i64, wrap: (Wrap, Wrap)) -> Option<(usize, usize)> {
    if wrap.0 == Wrap::Octahedral {
        return Some(octahedral::pixel(x, y, w, h));
    }
    Some((wrapped(x, w, wrap.0)?, wrapped(y, h, wrap.1)?))
}
