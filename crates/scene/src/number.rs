//! Decimal numbers in text, fast: scenes are mostly numbers, and the general parser of the standard
//! library needs to be handed text that was already checked and cut.

/// Powers of ten that a double holds exactly.
const EXACT: [f64; 23] = [
    1e0, 1e1, 1e2, 1e3, 1e4, 1e5, 1e6, 1e7, 1e8, 1e9, 1e10, 1e11, 1e12, 1e13, 1e14, 1e15, 1e16,
    1e17, 1e18, 1e19, 1e20, 1e21, 1e22,
];

/// The number at the start of `bytes`, correctly rounded, and how many bytes it takes. Too large
/// numbers come out as infinity; the caller refuses them.
pub(crate) fn number(bytes: &[u8]) -> Option<(f64, usize)> {
    let mut at = 0;
    let negative = match bytes.first() {
        Some(b'-') => {
            at = 1;
            true
        }
        Some(b'+') => {
            at = 1;
            false
        }
        _ => false,
    };
    let (mut mantissa, mut digits, mut significant, mut exponent) = (0u64, 0u32, 0u32, 0i32);
    while let Some(d) = bytes
        .get(at)
        .map(|b| b.wrapping_sub(b'0'))
        .filter(|&d| d < 10)
    {
        digits += 1;
        significant += u32::from(significant > 0 || d > 0);
        mantissa = mantissa.wrapping_mul(10).wrapping_add(u64::from(d));
        at += 1;
    }
    if bytes.get(at) == Some(&b'.') {
        at += 1;
        while let Some(d) = bytes
            .get(at)
            .map(|b| b.wrapping_sub(b'0'))
            .filter(|&d| d < 10)
        {
            digits += 1;
            significant += u32::from(significant > 0 || d > 0);
            mantissa = mantissa.wrapping_mul(10).wrapping_add(u64::from(d));
            exponent = exponent.saturating_sub(1);
            at += 1;
        }
    }
    if digits == 0 {
        return None;
    }
    if let Some(b'e' | b'E') = bytes.get(at) {
        let mut after = at + 1;
        let down = match bytes.get(after) {
            Some(b'-') => {
                after += 1;
                true
            }
            Some(b'+') => {
                after += 1;
                false
            }
            _ => false,
        };
        let first = after;
        let mut value = 0i32;
        while let Some(d) = bytes
            .get(after)
            .map(|b| b.wrapping_sub(b'0'))
            .filter(|&d| d < 10)
        {
            value = value.saturating_mul(10).saturating_add(i32::from(d));
            after += 1;
        }
        // An `e` without digits is no exponent; what is left makes the caller stumble over it.
        if after > first {
            exponent = exponent.saturating_add(if down { -value } else { value });
            at = after;
        }
    }
    // [Clinger90]: both factors exact, so the one operation rounds correctly.
    if significant <= 19 && mantissa <= 1 << 53 && exponent.unsigned_abs() <= 22 {
        let scale = EXACT[exponent.unsigned_abs() as usize];
        let value = if exponent < 0 {
            mantissa as f64 / scale
        } else {
            mantissa as f64 * scale
        };
        return Some((if negative { -value } else { value }, at));
    }
    let text = std::str::from_utf8(&bytes[..at]).ok()?;
    Some((text.parse().ok()?, at))
}

#[cfg(test)]
mod tests {
    use super::number;
    use proptest::prelude::*;

    #[test]
    fn numbers_end_where_they_end() {
        let check = |text: &str, expect: Option<(f64, usize)>| {
            assert_eq!(number(text.as_bytes()), expect, "{text}")
        };
        check("1 2", Some((1.0, 1)));
        check("-.5]", Some((-0.5, 3)));
        check("+3.", Some((3.0, 3)));
        check("1e3", Some((1000.0, 3)));
        check("1e", Some((1.0, 1)));
        check("1e+x", Some((1.0, 1)));
        check("-0", Some((-0.0, 2)));
        check("1e999", Some((f64::INFINITY, 5)));
        check(
            "123456789012345678901234567890",
            Some((123456789012345678901234567890.0, 30)),
        );
        check("0.1e-320", Some((0.1e-320, 8)));
        check(".", None);
        check("-", None);
        check("", None);
        check("nan", None);
        check("inf", None);
    }

    proptest! {
        #[test]
        fn agrees_with_the_standard_library(value: f64, digits in 0usize..25) {
            prop_assume!(value.is_finite());
            for text in [format!("{value}"), format!("{value:e}"), format!("{:.digits$}", value % 1e6)] {
                let (got, used) = number(text.as_bytes()).unwrap();
                prop_assert_eq!(got.to_bits(), text.parse::<f64>().unwrap().to_bits());
                prop_assert_eq!(used, text.len());
            }
        }
        #[test]
        fn never_panics(bytes: Vec<u8>) {
            let _ = number(&bytes);
        }
    }
}
