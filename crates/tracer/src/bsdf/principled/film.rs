//! Iridescence: the reflectance of a film thinner than a few wavelengths on a surface
//! [BelcourBarla17], by the approximations of glTF's KHR_materials_iridescence: Schlick's curve at both
//! faces, and the interference of successive reflections summed in closed form for each order through
//! Gaussian fits of the colour matching functions in the frequency of the path difference.

use super::tables::schlick;
use crate::math::{PI, Rgb, exp, safe_sqrt, sqr};
use glam::Vec3;

/// Orders of interference that are summed.
const ORDERS: u32 = 2;

/// Response of X, Y, Z (over the integral of Y) to a path difference in nanometres with a phase shift.
fn sensitivity(difference: f32, shift: Vec3) -> Vec3 {
    const VALUE: Vec3 = Vec3::new(5.4856e-13, 4.4201e-13, 5.2481e-13);
    const POSITION: Vec3 = Vec3::new(1.6810e+06, 1.7953e+06, 2.2084e+06);
    const VARIANCE: Vec3 = Vec3::new(4.3278e+09, 9.3046e+09, 6.6121e+09);
    let phase = 2.0 * PI * difference * 1e-9;
    let one = |c: usize| {
        VALUE[c]
            * (2.0 * PI * VARIANCE[c]).sqrt()
            * crate::math::cos(POSITION[c] * phase + shift[c])
            * exp(-phase * phase * VARIANCE[c])
    };
    let mut xyz = Vec3::new(one(0), one(1), one(2));
    // X has a second, shorter hump.
    xyz.x += 9.7470e-14
        * (2.0 * PI * 4.5282e+09f32).sqrt()
        * crate::math::cos(2.2399e+06 * phase + shift.x)
        * exp(-4.5282e+09 * phase * phase);
    xyz / 1.0685e-7
}

/// Linear Rec. 709 of CIE XYZ.
fn rec709(c: Vec3) -> Rgb {
    Rgb::new(
        3.240_454_2 * c.x - 1.537_138_5 * c.y - 0.498_531_4 * c.z,
        -0.969_266 * c.x + 1.876_010_8 * c.y + 0.041_556 * c.z,
        0.055_643_4 * c.x - 0.204_025_9 * c.y + 1.057_225_2 * c.z,
    )
}

/// Index of refraction that reflects this at normal incidence from air.
fn ior_of(f0: Rgb) -> Rgb {
    let index = |f: f32| {
        let s = f.clamp(0.0, 0.9999).sqrt();
        (1.0 + s) / (1.0 - s)
    };
    Rgb::new(index(f0.x), index(f0.y), index(f0.z))
}

/// Reflectance, by channel in [0, 1], for light arriving at `cos` from air, with the film's index of
/// refraction and thickness in nanometres and the reflectance of what is below at normal incidence.
pub fn reflectance(cos: f32, film_ior: f32, thickness: f32, base_f0: Rgb) -> Rgb {
    // A film that vanishes takes the index of the air, so that nothing jumps.
    let x = (thickness / 0.03).clamp(0.0, 1.0);
    let ior = 1.0 + (film_ior - 1.0) * x * x * (3.0 - 2.0 * x);
    let cos = cos.clamp(0.0, 1.0);
    let sin2 = (1.0 - cos * cos) / (ior * ior);
    if sin2 >= 1.0 {
        return Rgb::ONE;
    }
    let cos_film = safe_sqrt(1.0 - sin2);
    let r0 = sqr((1.0 - ior) / (1.0 + ior));
    let r12 = r0 + (1.0 - r0) * schlick(cos);
    let t121 = 1.0 - r12;
    let phi21 = if ior < 1.0 { 0.0 } else { PI };

    let base = ior_of(base_f0);
    let second = (base - Rgb::splat(ior)) / (base + Rgb::splat(ior));
    let r1 = second * second;
    let r23 = r1 + (Rgb::ONE - r1) * schlick(cos_film);
    let shift = |c: usize| if base[c] < ior { PI } else { 0.0 };
    let phi = Vec3::new(shift(0), shift(1), shift(2)) + Vec3::splat(phi21);

    let difference = 2.0 * ior * thickness.max(0.0) * cos_film;
    let product = (r23 * r12).clamp(Rgb::ZERO, Rgb::splat(0.9999));
    let amplitude = Rgb::new(product.x.sqrt(), product.y.sqrt(), product.z.sqrt());
    let round = r23 * (t121 * t121) / (Rgb::ONE - product);

    let mut sum = r12 + round;
    let mut term = round - Rgb::splat(t121);
    for order in 1..=ORDERS {
        term *= amplitude;
        let m = order as f32;
        sum += term * (rec709(sensitivity(m * difference, phi * m)) * 2.0);
    }
    sum.clamp(Rgb::ZERO, Rgb::ONE)
}
