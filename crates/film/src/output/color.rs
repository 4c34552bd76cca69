//! The sRGB curve and a false-colour scale, the same on every machine: powers come from the crate
//! `libm`, not from the system.

use std::sync::LazyLock;

/// sRGB (0 to 1) to linear.
pub fn srgb_to_linear(x: f32) -> f32 {
    if x <= 0.04045 {
        x / 12.92
    } else {
        libm::powf((x + 0.055) / 1.055, 2.4)
    }
}

/// Linear (0 to 1) to sRGB.
pub fn linear_to_srgb(x: f32) -> f32 {
    if x <= 0.003_130_8 {
        12.92 * x
    } else {
        1.055 * libm::powf(x, 1.0 / 2.4) - 0.055
    }
}

/// Linear values at which the byte goes up by one.
static STEPS: LazyLock<[f32; 255]> =
    LazyLock::new(|| std::array::from_fn(|k| srgb_to_linear((k as f32 + 0.5) / 255.0)));

/// Linear to the nearest sRGB byte, clipped; NaN is black.
pub fn srgb_byte(x: f32) -> u8 {
    if x.is_nan() {
        0
    } else {
        STEPS.partition_point(|&step| step <= x) as u8
    }
}

/// 0 to 1 to a byte without a curve; NaN is 0.
pub fn linear_byte(x: f32) -> u8 {
    (x * 255.0 + 0.5) as u8
}

/// A false colour for 0 to 1: dark violet, blue, teal, green, yellow, each step about as much
/// brighter, so that it also reads in grey. NaN is white.
pub fn false_color(t: f32) -> [u8; 3] {
    const STOPS: [[f32; 3]; 6] = [
        [66.0, 4.0, 84.0],
        [64.0, 70.0, 135.0],
        [44.0, 113.0, 142.0],
        [36.0, 162.0, 132.0],
        [116.0, 204.0, 84.0],
        [253.0, 230.0, 40.0],
    ];
    if t.is_nan() {
        return [255; 3];
    }
    let at = t.clamp(0.0, 1.0) * (STOPS.len() - 1) as f32;
    let low = (at as usize).min(STOPS.len() - 2);
    let part = at - low as f32;
    [0, 1, 2].map(|c| (STOPS[low][c] + (STOPS[low + 1][c] - STOPS[low][c]) * part + 0.5) as u8)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bytes_are_the_nearest() {
        for byte in 0..=255u8 {
            assert_eq!(srgb_byte(srgb_to_linear(byte as f32 / 255.0)), byte);
        }
        for i in 0..=100_000 {
            let x = i as f32 / 100_000.0;
            let exact = linear_to_srgb(x) * 255.0;
            assert!((srgb_byte(x) as f32 - exact).abs() <= 0.501, "{x}");
        }
        assert_eq!(
            [-1.0, f32::NAN, 2.0, f32::INFINITY].map(srgb_byte),
            [0, 0, 255, 255]
        );
    }

    #[test]
    fn false_colors_get_brighter() {
        let luma = |c: [u8; 3]| 2 * c[0] as u32 + 7 * c[1] as u32 + c[2] as u32;
        let all: Vec<u32> = (0..=64)
            .map(|i| luma(false_color(i as f32 / 64.0)))
            .collect();
        assert!(all.is_sorted());
        assert_eq!(
            (false_color(-3.0), false_color(9.0)),
            ([66, 4, 84], [253, 230, 40])
        );
    }
}
