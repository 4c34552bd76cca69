//! Fresnel's equations for unpolarised light.

use crate::math::Rgb;

/// Reflectance of a smooth boundary for light arriving at `cos` >= 0, and the cosine of the refracted
/// direction (0 under total reflection, where all is reflected). `eta` is the index of refraction of
/// the far side over that of the near side.
#[inline]
pub fn fresnel_dielectric(cos: f32, eta: f32) -> (f32, f32) {
    if eta == 1.0 {
        return (0.0, cos);
    }
    let cos = cos.min(1.0);
    // Snell: sin t = sin i / eta.
    let sin2_t = (1.0 - cos * cos) / (eta * eta);
    if sin2_t >= 1.0 {
        return (1.0, 0.0);
    }
    let cos_t = (1.0 - sin2_t).sqrt();
    let parallel = (eta * cos - cos_t) / (eta * cos + cos_t);
    let perpendicular = (cos - eta * cos_t) / (cos + eta * cos_t);
    // At the horizon rounding may exceed 1, and 1 - F must not become negative.
    let r = 0.5 * (parallel * parallel + perpendicular * perpendicular);
    (r.min(1.0), cos_t)
}

/// Reflectance of a metal with the complex index of refraction eta + i k, relative to the medium in
/// front of it, for light arriving at `cos` >= 0.
///
/// With a^2 + b^2 = |m|, m = (eta^2 - k^2 - sin^2) + 2 i eta k, and a the real part of its root:
/// Rs = (|m| + cos^2 - 2 a cos) / (|m| + cos^2 + 2 a cos), Rp = Rs times the same with |m| cos^2 +
/// sin^4 and 2 a cos sin^2.
#[inline]
pub fn fresnel_conductor(cos: f32, eta: Rgb, k: Rgb) -> Rgb {
    let cos = cos.clamp(0.0, 1.0);
    let cos2 = cos * cos;
    let sin2 = 1.0 - cos2;
    let channel = |eta: f32, k: f32| {
        let re = eta * eta - k * k - sin2;
        let im = 2.0 * eta * k;
        let m = (re * re + im * im).sqrt();
        let a = (0.5 * (m + re)).max(0.0).sqrt();
        let s = 2.0 * a * cos;
        let rs = (m + cos2 - s) / (m + cos2 + s);
        let p = m * cos2 + sin2 * sin2;
        let q = s * sin2;
        let rp = rs * (p - q) / (p + q);
        0.5 * (rs + rp)
    };
    Rgb::new(
        channel(eta.x, k.x),
        channel(eta.y, k.y),
        channel(eta.z, k.z),
    )
}

/// Optical constants (eta, k) of a metal that reflects `r` at normal incidence: eta = 1 and
/// k = 2 sqrt(r / (1 - r)), with r clamped to [0, 0.9999].
#[inline]
pub fn conductor_k_from_reflectance(r: Rgb) -> (Rgb, Rgb) {
    let k = |r: f32| {
        let r = r.clamp(0.0, 0.9999);
        2.0 * (r / (1.0 - r)).sqrt()
    };
    (Rgb::ONE, Rgb::new(k(r.x), k(r.y), k(r.z)))
}
