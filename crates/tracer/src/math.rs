//! Numbers that come out the same on every machine: our own elementary functions, frames, small
//! helpers.
//!
//! The functions of `std` call the system's mathematical library, which differs between machines.
//! Those used for every ray ([`sin_cos_2pi`], [`exp`], [`ln`], [`powf`], [`atan2`], [`asin`],
//! [`acos`]) are polynomials of our own: Chebyshev fits on the reduced range, evaluated in plain
//! multiplications and additions (never fused). The rest go to the crate `libm`. The tests state
//! and check the errors against `libm` in double precision.

use glam::Vec3;

/// A colour: linear Rec. 709 red, green, blue.
pub type Rgb = Vec3;

/// pi
pub const PI: f32 = std::f32::consts::PI;
/// 2 pi
pub const TWO_PI: f32 = 2.0 * PI;
/// pi / 2
pub const FRAC_PI_2: f32 = std::f32::consts::FRAC_PI_2;
/// pi / 4
pub const FRAC_PI_4: f32 = std::f32::consts::FRAC_PI_4;
/// 1 / pi
pub const INV_PI: f32 = std::f32::consts::FRAC_1_PI;
/// 1 / (2 pi)
pub const INV_2PI: f32 = 0.5 * INV_PI;
/// 1 / (4 pi)
pub const INV_4PI: f32 = 0.25 * INV_PI;
/// The largest number below 1: upper end of every uniform number.
pub const ONE_MINUS_EPSILON: f32 = 1.0 - f32::EPSILON / 2.0;

/// Adding and subtracting it rounds a small number to the nearest integer: 1.5 * 2^23.
const ROUND_F32: f32 = 12_582_912.0;
/// The same in double precision: 1.5 * 2^52.
const ROUND_F64: f64 = 6_755_399_441_055_744.0;
/// Upper half of the bits of sqrt(1/2): where mantissas are cut before a logarithm.
const SQRT_HALF_BITS: u64 = 0x3fe6_a09e_0000_0000;

/// Weights of the channels in luminance.
pub const LUMINANCE: [f32; 3] = [0.212_639, 0.715_168_7, 0.072_192_3];

/// Luminance of linear Rec. 709.
#[inline]
pub fn luminance(c: Rgb) -> f32 {
    let [r, g, b] = LUMINANCE;
    r * c.x + g * c.y + b * c.z
}

/// Mean of the three channels.
#[inline]
pub fn mean(c: Rgb) -> f32 {
    (c.x + c.y + c.z) * (1.0 / 3.0)
}

/// Square.
#[inline]
pub fn sqr(x: f32) -> f32 {
    x * x
}

/// `a` at t = 0, `b` at t = 1.
#[inline]
pub fn lerp(a: f32, b: f32, t: f32) -> f32 {
    (1.0 - t) * a + t * b
}

/// Square root; zero for what rounding made negative.
#[inline]
pub fn safe_sqrt(x: f32) -> f32 {
    x.max(0.0).sqrt()
}

/// Euclidean length.
#[inline]
pub fn length(v: Vec3) -> f32 {
    dot(v, v).sqrt()
}

/// Scalar product, summed from x to z.
#[inline]
pub fn dot(a: Vec3, b: Vec3) -> f32 {
    a.x * b.x + a.y * b.y + a.z * b.z
}

/// `v` with length 1; not finite for the zero vector.
#[inline]
pub fn normalize(v: Vec3) -> Vec3 {
    v * (1.0 / length(v))
}

/// `v` turned to the side of `towards`.
#[inline]
pub fn faceforward(v: Vec3, towards: Vec3) -> Vec3 {
    if dot(v, towards) < 0.0 { -v } else { v }
}

/// Sine and cosine of 2 pi u for u in [0, 1], error below 1.2e-7.
#[inline]
pub fn sin_cos_2pi(u: f32) -> (f32, f32) {
    // Quarter turns, and what is left of u: in [-1/8, 1/8], without rounding.
    let quarter = (u * 4.0 + 0.5) as i32;
    let (s, c) = sin_cos_small((u - 0.25 * quarter as f32) * TWO_PI);
    let (sin, cos) = if quarter & 1 == 0 { (s, c) } else { (c, s) };
    // sin is negative in turns 2 and 3, cos in 1 and 2 (the swap above included).
    let sin = if quarter & 2 == 0 { sin } else { -sin };
    let cos = if (quarter + 1) & 2 == 0 { cos } else { -cos };
    (sin, cos)
}

/// Coefficients of sin x = x + x^3 (..) for [`sin_cos_small`], in x^2.
pub(crate) const SIN: [f32; 3] = [-0.166_666_64, 0.008_332_748, -0.000_195_878_9];
/// Coefficients of cos x = 1 - x^2 / 2 + x^4 (..).
pub(crate) const COS: [f32; 3] = [0.041_666_664, -0.001_388_830_3, 0.000_024_547_942];

/// Sine and cosine of x in [-pi/4, pi/4], error below 1.2e-7.
#[inline]
pub fn sin_cos_small(x: f32) -> (f32, f32) {
    let z = x * x;
    let s = x + x * z * (SIN[0] + z * (SIN[1] + z * SIN[2]));
    let c = (1.0 - 0.5 * z) + z * z * (COS[0] + z * (COS[1] + z * COS[2]));
    (s, c)
}

/// e^x, relative error below 2e-7; 0 below -87.3, infinite above 88.7.
#[inline]
pub fn exp(x: f32) -> f32 {
    if x < -87.3 {
        return 0.0;
    }
    if x > 88.72 {
        return f32::INFINITY;
    }
    let k = (x * std::f32::consts::LOG2_E + ROUND_F32) - ROUND_F32;
    // ln 2 in two parts, the first short enough for exact products.
    let r = (x - k * 0.693_359_4) - k * -0.000_212_194_44;
    let p =
        0.5 + r * (0.166_665_78 + r * (0.041_666_556 + r * (0.008_363_173 + r * 0.001_392_617_6)));
    let y = 1.0 + (r + r * r * p);
    // In two steps, as 2^128 is no float; NaN gives k = 0 as an integer and stays NaN.
    let k = k as i32;
    let half = k >> 1;
    y * pow2(half) * pow2(k - half)
}

/// 2^k for k in [-126, 127].
#[inline]
fn pow2(k: i32) -> f32 {
    f32::from_bits(((k + 127) << 23) as u32)
}

/// Natural logarithm, error below 1.5e-7 of the larger of 1 and the result; -inf at 0, NaN below.
#[inline]
pub fn ln(x: f32) -> f32 {
    if x <= 0.0 || !x.is_finite() {
        return if x == 0.0 {
            f32::NEG_INFINITY
        } else if x > 0.0 {
            x
        } else {
            f32::NAN
        };
    }
    let (x, bias) = if x < f32::MIN_POSITIVE {
        (x * 8_388_608.0, 23)
    } else {
        (x, 0)
    };
    // x = 2^e m with m in [sqrt(1/2), sqrt(2)): then ln m = 2 artanh((m - 1) / (m + 1)).
    let bits = x.to_bits().wrapping_sub(0x3f35_04f3);
    let e = (bits as i32) >> 23;
    let m = f32::from_bits((bits & 0x007f_ffff).wrapping_add(0x3f35_04f3));
    let s = (m - 1.0) / (m + 1.0);
    let q = s * s;
    let tail = s * q * (0.666_666_85 + q * (0.399_887_8 + q * 0.295_799_5));
    let e = (e - bias) as f32;
    e * 0.693_359_4 + (2.0 * s + (tail + e * -0.000_212_194_44))
}

/// x^y for x >= 0, relative error below 1e-7; 1 for y = 0, NaN for x < 0.
#[inline]
pub fn powf(x: f32, y: f32) -> f32 {
    pow_wide(x, y) as f32
}

/// [`powf`] before the last rounding, relative error below 1e-9 for |y| up to 1e6. It works in double
/// precision, as the error of a single-precision logarithm grows with y, and so that 1 - x^y can be
/// formed where x^y is near 1.
#[inline]
pub fn pow_wide(x: f32, y: f32) -> f64 {
    if y == 0.0 || x == 1.0 {
        return 1.0;
    }
    if x <= 0.0 || !x.is_finite() {
        return if x == 0.0 {
            if y > 0.0 { 0.0 } else { f64::INFINITY }
        } else if x > 0.0 {
            if y > 0.0 { f64::INFINITY } else { 0.0 }
        } else {
            f64::NAN
        };
    }
    // log2 of x as in `ln`; numbers that are denormal in single precision are normal here.
    let bits = f64::from(x).to_bits().wrapping_sub(SQRT_HALF_BITS);
    let e = (bits as i64) >> 52;
    let m = f64::from_bits((bits & 0x000f_ffff_ffff_ffff).wrapping_add(SQRT_HALF_BITS));
    let s = (m - 1.0) / (m + 1.0);
    let q = s * s;
    let tail = 0.666_666_666_666_620_8
        + q * (0.400_000_000_112_065_05
            + q * (0.285_714_241_383_241_6
                + q * (0.222_228_622_801_087_16
                    + q * (0.181_401_938_028_659_92 + q * 0.166_218_171_528_589_78))));
    let log2 = e as f64 + (2.0 * s + s * q * tail) * std::f64::consts::LOG2_E;
    let t = log2 * f64::from(y);
    if t < -1000.0 {
        return 0.0;
    }
    if t > 1000.0 {
        return f64::INFINITY;
    }
    if t.is_nan() {
        return t;
    }
    let k = (t + ROUND_F64) - ROUND_F64;
    let r = t - k;
    let p = 1.0
        + r * (0.693_147_180_545_933_5
            + r * (0.240_226_506_958_129_9
                + r * (0.055_504_109_412_059_33
                    + r * (0.009_618_129_159_402_558
                        + r * (0.001_333_345_056_800_064_5
                            + r * (0.000_154_034_555_524_538_48
                                + r * (0.000_015_310_079_402_249_296
                                    + r * 0.000_001_325_522_487_866_881_7)))))));
    p * f64::from_bits(((k as i64 + 1023) << 52) as u64)
}

/// Angle of the point (x, y) from the +x axis in [-pi, pi], error below 3e-7; 0 at the origin.
#[inline]
pub fn atan2(y: f32, x: f32) -> f32 {
    let (ax, ay) = (x.abs(), y.abs());
    let (small, large) = if ax < ay { (ax, ay) } else { (ay, ax) };
    if large == 0.0 {
        return 0.0;
    }
    let t = small / large;
    let q = t * t;
    let p = -0.333_333_3
        + q * (0.199_997_4
            + q * (-0.142_785_69
                + q * (0.110_337_645
                    + q * (-0.086_568_8
                        + q * (0.062_501_69
                            + q * (-0.035_871_54 + q * (0.013_507_771 + q * -0.002_386_997_2)))))));
    let a = t + t * q * p;
    let a = if ax < ay { FRAC_PI_2 - a } else { a };
    let a = if x < 0.0 { PI - a } else { a };
    if y < 0.0 { -a } else { a }
}

/// arcsin x = x + x^3 P(x^2) on [0, 1/2].
#[inline]
fn asin_small(x: f32) -> f32 {
    let q = x * x;
    let p = 0.166_666_73
        + q * (0.074_988_55 + q * (0.045_001_38 + q * (0.026_554_542 + q * 0.038_085_025)));
    x + x * q * p
}

/// Arc sine, the argument clamped to [-1, 1]; error below 3e-7.
#[inline]
pub fn asin(x: f32) -> f32 {
    let a = x.abs().min(1.0);
    // arcsin x = pi/2 - 2 arcsin(sqrt((1 - x) / 2)) keeps the argument small.
    let r = if a <= 0.5 {
        asin_small(a)
    } else {
        FRAC_PI_2 - 2.0 * asin_small((0.5 * (1.0 - a)).sqrt())
    };
    if x < 0.0 { -r } else { r }
}

/// Arc cosine, the argument clamped to [-1, 1]; error below 4e-7.
#[inline]
pub fn acos(x: f32) -> f32 {
    let a = x.abs().min(1.0);
    if a <= 0.5 {
        let r = asin_small(a);
        return if x < 0.0 {
            FRAC_PI_2 + r
        } else {
            FRAC_PI_2 - r
        };
    }
    let r = 2.0 * asin_small((0.5 * (1.0 - a)).sqrt());
    if x < 0.0 { PI - r } else { r }
}

/// Sine; for preparation, not for the hot loop.
pub fn sin(x: f32) -> f32 {
    libm::sinf(x)
}

/// Cosine; for preparation, not for the hot loop.
pub fn cos(x: f32) -> f32 {
    libm::cosf(x)
}

/// Tangent; for preparation, not for the hot loop.
pub fn tan(x: f32) -> f32 {
    libm::tanf(x)
}

/// Two unit vectors that make a right-handed frame (s, t, n) with the unit vector `n`, without a
/// branch and without a square root [Duff17, listing 3].
#[inline]
pub fn coordinate_system(n: Vec3) -> (Vec3, Vec3) {
    let sign = 1.0f32.copysign(n.z);
    let a = -1.0 / (sign + n.z);
    let b = n.x * n.y * a;
    (
        Vec3::new(1.0 + sign * n.x * n.x * a, sign * b, -sign * n.x),
        Vec3::new(b, sign + n.y * n.y * a, -n.y),
    )
}

/// An orthonormal right-handed frame; z of local vectors is along `n`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Frame {
    /// Local x.
    pub s: Vec3,
    /// Local y.
    pub t: Vec3,
    /// Local z.
    pub n: Vec3,
}

impl Frame {
    /// Any frame about the unit vector `n`.
    #[inline]
    pub fn from_normal(n: Vec3) -> Self {
        let (s, t) = coordinate_system(n);
        Frame { s, t, n }
    }

    /// The frame about the unit vector `n` whose x axis is `tangent` made perpendicular; any frame
    /// where the two are parallel or the tangent is zero or not finite.
    #[inline]
    pub fn from_normal_tangent(n: Vec3, tangent: Vec3) -> Self {
        let s = tangent - n * dot(n, tangent);
        let len2 = dot(s, s);
        // Below, what is left of the tangent is mostly rounding. NaN fails the test too.
        if len2 > 1e-10 * dot(tangent, tangent) && len2 > f32::MIN_POSITIVE && len2.is_finite() {
            let s = s * (1.0 / len2.sqrt());
            let t = Vec3::new(
                n.y * s.z - n.z * s.y,
                n.z * s.x - n.x * s.z,
                n.x * s.y - n.y * s.x,
            );
            Frame { s, t, n }
        } else {
            Self::from_normal(n)
        }
    }

    /// World to local.
    #[inline]
    pub fn to_local(&self, v: Vec3) -> Vec3 {
        Vec3::new(dot(v, self.s), dot(v, self.t), dot(v, self.n))
    }

    /// Local to world.
    #[inline]
    pub fn to_world(&self, v: Vec3) -> Vec3 {
        self.s * v.x + self.t * v.y + self.n * v.z
    }
}

#[cfg(test)]
mod tests;
