//! Colours from other descriptions: black bodies, spectra, sRGB notation. All arithmetic is software
//! (`libm`), so every machine gets the same numbers.

use crate::model::Rgb;
use std::sync::LazyLock;

/// Linear Rec. 709 from XYZ [IEC 61966-2-1].
const RGB_FROM_XYZ: [[f64; 3]; 3] = [
    [3.240_454_2, -1.537_138_5, -0.498_531_4],
    [-0.969_266_0, 1.876_010_8, 0.041_556_0],
    [0.055_643_4, -0.204_025_9, 1.057_225_2],
];

/// The integral over nanometres of the matching function of luminance: what pbrt's film measures of a
/// spectrum that is 1 everywhere, and of a white light before it is divided by it.
pub const WHITE_Y: f64 = 106.856_895;

/// Luminance of linear Rec. 709.
pub fn luminance(rgb: Rgb) -> f32 {
    0.2126 * rgb[0] + 0.7152 * rgb[1] + 0.0722 * rgb[2]
}

/// The CIE 1931 matching functions by the multi-lobe fit of [Wyman13], at a wavelength in nm.
fn matching(lambda: f64) -> [f64; 3] {
    let lobe = |height: f64, mean: f64, below: f64, above: f64| {
        let t = (lambda - mean) / if lambda < mean { below } else { above };
        height * libm::exp(-0.5 * t * t)
    };
    [
        lobe(1.056, 599.8, 37.9, 31.0)
            + lobe(0.362, 442.0, 16.0, 26.7)
            + lobe(-0.065, 501.1, 20.4, 26.2),
        lobe(0.821, 568.8, 46.9, 40.5) + lobe(0.286, 530.9, 16.3, 31.1),
        lobe(1.217, 437.0, 11.8, 36.0) + lobe(0.681, 459.0, 26.0, 13.8),
    ]
}

/// Planck's law, up to a constant factor.
fn planck(kelvin: f64, lambda: f64) -> f64 {
    let meters = lambda * 1e-9;
    let x = 0.014_387_768_775 / (meters * kelvin);
    let fifth = meters * meters * meters * meters * meters;
    1.0 / (fifth * libm::expm1(x))
}

fn rgb_of(xyz: [f64; 3]) -> [f64; 3] {
    RGB_FROM_XYZ.map(|row| row[0] * xyz[0] + row[1] * xyz[1] + row[2] * xyz[2])
}

fn wavelengths() -> impl Iterator<Item = f64> {
    (0..=94).map(|i| 360.0 + 5.0 * f64::from(i))
}

/// The colour of a light with this spectrum, at luminance 1; out-of-gamut parts are cut. Nothing if
/// it is dark.
pub fn emission_hue(spectrum: impl Fn(f64) -> f64) -> Option<Rgb> {
    let mut xyz = [0.0; 3];
    for lambda in wavelengths() {
        let value = spectrum(lambda);
        for (sum, m) in xyz.iter_mut().zip(matching(lambda)) {
            *sum += value * m;
        }
    }
    let rgb = rgb_of(xyz).map(|c| c.max(0.0));
    let y = 0.2126 * rgb[0] + 0.7152 * rgb[1] + 0.0722 * rgb[2];
    (y > 0.0 && y.is_finite()).then(|| rgb.map(|c| (c / y) as f32))
}

/// The colour of a black body, at luminance 1.
pub fn blackbody(kelvin: f64) -> Option<Rgb> {
    let scale = planck(kelvin, 560.0);
    emission_hue(|lambda| planck(kelvin, lambda) / scale)
}

/// The colour of a black body whose spectrum is 1 at its peak, with luminance summed over nanometres:
/// what pbrt's volumes give off. Black up to 100 K.
pub fn blackbody_peak_one(kelvin: f64) -> Rgb {
    // Wien's displacement, nm K.
    const DISPLACEMENT: f64 = 2_897_771.955;
    // A temperature that is no number gives no light either.
    let hue = match blackbody(kelvin) {
        Some(hue) if kelvin > 100.0 => hue,
        _ => return [0.0; 3],
    };
    let peak = planck(kelvin, DISPLACEMENT / kelvin);
    let seen = |lambda: f64| matching(lambda)[1] * planck(kelvin, lambda) / peak;
    let y = 5.0 * wavelengths().map(seen).sum::<f64>();
    hue.map(|c| (f64::from(c) * y) as f32)
}

/// The colour of a phase of daylight (CIE series D, 4000 to 25000 K; a black body below), at luminance 1.
pub fn daylight(kelvin: f64) -> Option<Rgb> {
    if kelvin < 4000.0 {
        return blackbody(kelvin).filter(|_| kelvin >= 100.0);
    }
    let t = 1000.0 / kelvin;
    let x = if kelvin <= 7000.0 {
        0.244_063 + t * (0.099_11 + t * (2.967_8 - t * 4.607))
    } else {
        0.237_040 + t * (0.247_48 + t * (1.901_8 - t * 2.006_4))
    };
    let y = -3.0 * x * x + 2.870 * x - 0.275;
    let rgb = rgb_of([x / y, 1.0, (1.0 - x - y) / y]);
    (kelvin <= 25_000.0).then(|| rgb.map(|c| c.max(0.0) as f32))
}

/// What a quantity over wavelengths is to each channel under daylight: its mean, weighted by what the
/// channel sees of it. For reflectances this is the colour that a white light shows.
pub fn weighted(spectrum: impl Fn(f64) -> f64) -> Rgb {
    weighted_signed(spectrum).map(|c| c.max(0.0) as f32)
}

/// The same with what lies outside the gamut, which is negative.
pub(crate) fn weighted_signed(spectrum: impl Fn(f64) -> f64) -> [f64; 3] {
    /// What the channels see of each wavelength.
    static SEEN: LazyLock<Vec<(f64, [f64; 3])>> = LazyLock::new(|| {
        let seen = |lambda| rgb_of(matching(lambda)).map(|c| c * planck(6504.0, lambda) * 1e-13);
        wavelengths().map(|lambda| (lambda, seen(lambda))).collect()
    });
    let (mut sum, mut all) = ([0.0; 3], [0.0; 3]);
    for (lambda, seen) in &*SEEN {
        let value = spectrum(*lambda);
        for i in 0..3 {
            sum[i] += value * seen[i];
            all[i] += seen[i];
        }
    }
    std::array::from_fn(|i| sum[i] / all[i])
}

/// A table of wavelengths (rising, nm) and values as a function: linear between, constant outside.
pub fn interpolate(table: &[(f64, f64)], lambda: f64) -> f64 {
    let after = table.partition_point(|&(l, _)| l < lambda);
    match (
        after.checked_sub(1).and_then(|i| table.get(i)),
        table.get(after),
    ) {
        (Some(&(l0, v0)), Some(&(l1, v1))) => v0 + (v1 - v0) * (lambda - l0) / (l1 - l0),
        (Some(&(_, v)), None) | (None, Some(&(_, v))) => v,
        (None, None) => 0.0,
    }
}

/// One sRGB number in [0, 1] as a linear one.
pub fn srgb_to_linear(x: f64) -> f64 {
    if x <= 0.04045 {
        x / 12.92
    } else {
        libm::pow((x + 0.055) / 1.055, 2.4)
    }
}

/// `srgb(#rrggbb)` or `blackbody(6500)`.
pub fn parse(text: &str) -> Result<Rgb, String> {
    let inside = |name: &str| {
        text.trim()
            .strip_prefix(name)?
            .trim_start()
            .strip_prefix('(')?
            .strip_suffix(')')
    };
    if let Some(inner) = inside("srgb") {
        let hex = inner
            .trim()
            .strip_prefix('#')
            .filter(|h| h.len() == 6 && h.bytes().all(|b| b.is_ascii_hexdigit()));
        let Some(value) = hex.and_then(|h| u32::from_str_radix(h, 16).ok()) else {
            return Err(format!(
                "{text:?}: expected six hexadecimal digits, as in \"srgb(#ff8000)\""
            ));
        };
        let channel = |shift: u32| srgb_to_linear(f64::from(value >> shift & 255) / 255.0) as f32;
        return Ok([channel(16), channel(8), channel(0)]);
    }
    if let Some(inner) = inside("blackbody") {
        let kelvin = inner
            .trim()
            .parse::<f64>()
            .ok()
            .filter(|k| (100.0..=1e6).contains(k));
        return kelvin
            .and_then(blackbody)
            .ok_or_else(|| format!("{text:?}: expected 100 to 1000000 kelvin"));
    }
    Err(format!(
        "{text:?} is no colour; write [r, g, b], \"srgb(#rrggbb)\" or \"blackbody(6500)\""
    ))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn near(got: Rgb, want: Rgb, bound: f32) {
        assert!(
            got.iter().zip(want).all(|(g, w)| (g - w).abs() <= bound),
            "{got:?}, expected {want:?}"
        );
    }

    #[test]
    fn lights_have_the_known_hues() {
        // By the tabulated matching functions; the fit is good to a few percent.
        near(blackbody(6504.0).unwrap(), [1.04, 0.99, 1.0], 0.04);
        near(blackbody(2856.0).unwrap(), [1.845, 0.826, 0.233], 0.05);
        near(daylight(6504.0).unwrap(), [1.0; 3], 0.01);
        near(daylight(5003.0).unwrap(), [1.1760, 0.9757, 0.7205], 0.005);
        assert_eq!((daylight(3000.0), daylight(3e4)), (blackbody(3000.0), None));
        let luminance_of_3000 = luminance(blackbody(3000.0).unwrap());
        assert!((luminance_of_3000 - 1.0).abs() < 1e-6);
        assert_eq!(emission_hue(|_| 0.0), None);
        // A flat spectrum of 1 would have the area of the matching function, 106.9.
        let hot = luminance(blackbody_peak_one(6000.0));
        assert!((90.0..106.9).contains(&hot), "{hot}");
        assert!(luminance(blackbody_peak_one(2000.0)) < 20.0);
        assert_eq!(blackbody_peak_one(99.0), [0.0; 3]);
        assert_eq!(blackbody_peak_one(f64::NAN), [0.0; 3]);
        near(weighted(|_| 0.25), [0.25; 3], 1e-6);
    }

    #[test]
    fn colours_are_parsed() {
        near(parse("srgb(#ffffff)").unwrap(), [1.0; 3], 0.0);
        near(
            parse("srgb( #Bc0000 )").unwrap(),
            [0.502_886_5, 0.0, 0.0],
            1e-6,
        );
        near(
            parse("blackbody(6504)").unwrap(),
            blackbody(6504.0).unwrap(),
            0.0,
        );
        for bad in [
            "srgb(#fff)",
            "srgb(ffffff)",
            "blackbody(-1)",
            "blackbody(hot)",
            "red",
            "srgb(#+fffff)",
        ] {
            assert!(parse(bad).is_err(), "{bad}");
        }
    }

    #[test]
    fn tables_are_interpolated() {
        let table = [(400.0, 1.0), (500.0, 3.0)];
        assert_eq!(
            [300.0, 400.0, 450.0, 600.0].map(|l| interpolate(&table, l)),
            [1.0, 1.0, 2.0, 3.0]
        );
        assert_eq!(interpolate(&[], 1.0), 0.0);
    }
}
