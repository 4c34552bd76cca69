//! Transforms as pbrt builds them: everything multiplies the current matrix from the right.

use crate::model::{Motion, MotionKey};
use glam::{DAffine3, DMat4, DVec3, DVec4};

/// The 16 numbers of `Transform`, which come column by column.
pub(super) fn columns(m: &[f64; 16]) -> DMat4 {
    DMat4::from_cols_array(m)
}

/// `Rotate`: degrees about an axis.
pub(super) fn rotate(degrees: f64, axis: DVec3) -> Option<DMat4> {
    let a = axis.try_normalize()?;
    let (s, c) = (
        libm::sin(degrees.to_radians()),
        libm::cos(degrees.to_radians()),
    );
    let row = |i: usize| {
        let e = [DVec3::X, DVec3::Y, DVec3::Z][i];
        // Column i is what the rotation does to axis i [Rodrigues].
        (a * a.dot(e) * (1.0 - c) + e * c + a.cross(e) * s).extend(0.0)
    };
    Some(DMat4::from_cols(row(0), row(1), row(2), DVec4::W))
}

/// `LookAt`: camera from world, in pbrt's left-handed camera space.
pub(super) fn look_at(eye: DVec3, at: DVec3, up: DVec3) -> Option<DMat4> {
    let direction = (at - eye).try_normalize()?;
    let right = up.try_normalize()?.cross(direction).try_normalize()?;
    let new_up = direction.cross(right);
    let world_from_camera = DMat4::from_cols(
        right.extend(0.0),
        new_up.extend(0.0),
        direction.extend(0.0),
        eye.extend(1.0),
    );
    Some(world_from_camera.inverse())
}

/// An affine transform, if the matrix is one and can be inverted.
pub(super) fn affine(m: &DMat4) -> Result<DAffine3, &'static str> {
    if !m.is_finite() {
        return Err("the transform has numbers that are not finite");
    }
    let w = m.row(3);
    if w.truncate().length() > 1e-6 * libm::fabs(w.w) || w.w == 0.0 {
        return Err("the transform is not affine");
    }
    let m = DAffine3::from_mat4(*m * (1.0 / w.w));
    let scale = m.matrix3.x_axis.length() * m.matrix3.y_axis.length() * m.matrix3.z_axis.length();
    // Relative to the axes' lengths, so that tiny scenes are not refused.
    if libm::fabs(m.matrix3.determinant()) <= scale * 1e-12 || !m.inverse().is_finite() {
        return Err("the transform is singular: it flattens what it places");
    }
    Ok(m)
}

/// The two current matrices as a motion between the transform times.
pub(super) fn motion(ctm: &[DMat4; 2], times: (f64, f64)) -> Result<Motion, &'static str> {
    let start = affine(&ctm[0])?;
    if ctm[0] == ctm[1] || times.0 >= times.1 {
        return Ok(Motion::fixed(start));
    }
    let end = affine(&ctm[1])?;
    Ok(Motion {
        keys: vec![
            MotionKey {
                time: times.0,
                transform: start,
            },
            MotionKey {
                time: times.1,
                transform: end,
            },
        ],
    })
}
