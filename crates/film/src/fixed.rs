//! Fixed-point numbers: a sample's value is rounded once, then only integers are added.
//!
//! | quantity | step | bound of one sample | sum of 2^24 samples fits |
//! |---|---|---|---|
//! | radiance, distance | 2^-40 | 2^32 | 2^96, in i128 |
//! | square of radiance | 2^-64 | 2^64 | 2^152, in 192 bits |
//! | alpha, albedo, normal | 2^-20 | 2^10 | 2^54, in i64 |
//!
//! A starlit wall at 1e-5 still has 23 bits of its value and 30 of its square, and a sun at 4e9
//! beside it does not overflow.

/// Binary places of [`to_fixed`].
pub const VALUE_BITS: u32 = 40;
/// Binary places of [`Square`].
pub const SQUARE_BITS: u32 = 64;
/// Binary places of [`to_bounded`].
pub const BOUNDED_BITS: u32 = 20;
/// Largest magnitude of a radiance or distance.
pub const VALUE_MAX: f32 = 4_294_967_296.0;
/// Largest magnitude of a bounded quantity.
pub const BOUNDED_MAX: f32 = 1024.0;

/// Rounds to the nearest multiple of 2^-40, ties to even. The caller has checked that the
/// magnitude is at most [`VALUE_MAX`].
#[inline(always)]
pub fn to_fixed(value: f32) -> i128 {
    // An f32 times 2^40 is exact in f64 and below 2^72. Up to 2^22 the magic-number conversion is
    // exact and fast; the rest is rare.
    let scaled = value as f64 * (1u64 << VALUE_BITS) as f64;
    if scaled.abs() < 2_251_799_813_685_248.0 {
        round_small(scaled) as i128
    } else {
        // At 2^51 and above the last place of a number with 24 significant bits is above 1.
        scaled as i128
    }
}

/// [`to_fixed`] of a magnitude below 2^11.
#[inline(always)]
pub(crate) fn to_fixed_small(value: f32) -> i64 {
    round_small(value as f64 * (1u64 << VALUE_BITS) as f64)
}

/// Rounds a magnitude below 2^51 to the nearest integer, ties to even.
#[inline(always)]
fn round_small(x: f64) -> i64 {
    const MAGIC: f64 = 6_755_399_441_055_744.0; // 1.5 * 2^52: the fraction's bits fall off the end
    let y = x + MAGIC;
    (y.to_bits() as i64).wrapping_sub(MAGIC.to_bits() as i64)
}

/// A sum of values back as a number.
pub fn from_fixed(sum: i128) -> f64 {
    sum as f64 / (1u64 << VALUE_BITS) as f64
}

/// Rounds to the nearest multiple of 2^-20, ties to even. The caller has checked the bound.
#[inline(always)]
pub fn to_bounded(value: f32) -> i64 {
    round_small(value as f64 * (1u64 << BOUNDED_BITS) as f64)
}

/// A sum of bounded values back as a number.
pub fn from_bounded(sum: i64) -> f64 {
    sum as f64 / (1u64 << BOUNDED_BITS) as f64
}

/// A sum of squares: an unsigned 192-bit integer in steps of 2^-64.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord)]
pub struct Square {
    /// Whole part.
    pub whole: u128,
    /// Fraction, in steps of 2^-64.
    pub fraction: u64,
}

impl Square {
    /// The square of a value, rounded to the nearest step, ties away from zero. The caller has checked
    /// that its magnitude is at most [`VALUE_MAX`].
    #[inline(always)]
    pub fn of(value: f32) -> Square {
        // value = mantissa x 2^(exponent - 150), so its square in steps is mantissa^2 x
        // 2^(2 exponent - 236).
        let bits = value.to_bits() & 0x7FFF_FFFF;
        let exponent = bits >> 23;
        let mantissa = (bits & 0x007F_FFFF | 0x0080_0000) as u64;
        let square = mantissa * mantissa;
        if exponent < 118 {
            // A subnormal number lands here without its missing first bit mattering.
            let shift = 236 - 2 * exponent;
            let fraction = if shift < 64 {
                (square + (1 << (shift - 1))) >> shift
            } else {
                0
            };
            return Square { whole: 0, fraction };
        }
        let shift = 2 * (exponent - 118);
        if shift < 64 {
            let wide = (square as u128) << shift;
            Square {
                whole: wide >> 64,
                fraction: wide as u64,
            }
        } else {
            Square {
                whole: (square as u128) << (shift - 64),
                fraction: 0,
            }
        }
    }

    /// [`Square::of`] of a magnitude below 2^11, in steps of 2^-64.
    #[inline(always)]
    pub(crate) fn of_small(value: f32) -> u128 {
        let bits = value.to_bits() & 0x7FFF_FFFF;
        let exponent = bits >> 23;
        if exponent < 118 {
            return Square::of(value).fraction as u128;
        }
        // At most 2 (138 - 118) places: the product stays below 2^88.
        let mantissa = (bits & 0x007F_FFFF | 0x0080_0000) as u64;
        ((mantissa * mantissa) as u128) << (2 * (exponent - 118))
    }

    /// As a number.
    pub fn to_f64(self) -> f64 {
        self.whole as f64 + self.fraction as f64 / 18_446_744_073_709_551_616.0
    }
}

impl std::ops::AddAssign for Square {
    #[inline(always)]
    fn add_assign(&mut self, other: Square) {
        let (fraction, carry) = self.fraction.overflowing_add(other.fraction);
        self.fraction = fraction;
        self.whole += other.whole + carry as u128;
    }
}
