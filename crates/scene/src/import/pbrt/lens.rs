//! Camera "realistic": its glass elements stand for one thin lens, found by paraxial optics. Lengths in
//! lens files are millimetres, in scenes metres.

/// One surface of a lens system, from the front to the film.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Element {
    /// Radius of curvature; 0 is flat: the aperture stop.
    curvature: f64,
    /// Distance to the next surface.
    thickness: f64,
    /// Index of refraction behind it; 0 is air.
    ior: f64,
    /// Diameter.
    diameter: f64,
}

/// The thin lens that a system amounts to, in millimetres.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct ThinLens {
    pub focal_length: f64,
    /// Largest diameter that the stop, or the narrowest surface where there is none, lets through.
    pub stop: f64,
}

/// Reads the numbers of a lens file, four for each surface.
pub(super) fn thin_lens(numbers: &[f64]) -> Result<ThinLens, String> {
    let (rows, rest) = numbers.as_chunks::<4>();
    if rows.is_empty() || !rest.is_empty() {
        return Err(format!(
            "{} numbers: a lens has four for each surface",
            numbers.len()
        ));
    }
    let elements: Vec<Element> = rows
        .iter()
        .map(|&[curvature, thickness, ior, diameter]| Element {
            curvature,
            thickness,
            ior,
            diameter,
        })
        .collect();
    // A ray that comes in parallel to the axis, at height 1: height and slope behind each surface.
    let (mut height, mut slope, mut before) = (1.0, 0.0, 1.0);
    for element in &elements {
        let after = if element.ior == 0.0 { 1.0 } else { element.ior };
        if element.curvature != 0.0 {
            let power = (after - before) / element.curvature;
            slope = (before * slope - height * power) / after;
            before = after;
        }
        height += slope * element.thickness;
    }
    // Where the last surface leads into glass there is no film behind it.
    let focal_length = -1.0 / (slope * before);
    if !(focal_length > 0.0 && focal_length.is_finite()) {
        return Err(format!(
            "a lens that does not focus light (focal length {focal_length} mm)"
        ));
    }
    let narrowest = |list: &mut dyn Iterator<Item = &Element>| {
        list.map(|e| e.diameter).fold(f64::INFINITY, f64::min)
    };
    let stops = narrowest(&mut elements.iter().filter(|e| e.curvature == 0.0));
    let stop = if stops.is_finite() {
        stops
    } else {
        narrowest(&mut elements.iter())
    };
    if stop <= 0.0 {
        return Err("a lens that lets nothing through".into());
    }
    Ok(ThinLens { focal_length, stop })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn one_lens_obeys_the_lensmaker() {
        // 1 / f = (n - 1) (1 / r1 - 1 / r2 + (n - 1) d / (n r1 r2))
        let lens = thin_lens(&[50.0, 5.0, 1.5, 20.0, -50.0, 40.0, 1.0, 18.0]).unwrap();
        let inverse = 0.5 * (1.0 / 50.0 + 1.0 / 50.0 - 0.5 * 5.0 / (1.5 * 50.0 * 50.0));
        assert!((lens.focal_length - 1.0 / inverse).abs() < 1e-9, "{lens:?}");
        assert_eq!(lens.stop, 18.0);
        // Air may be written as 0, and the stop decides.
        let stopped = thin_lens(&[
            50.0, 5.0, 1.5, 20.0, -50.0, 2.0, 0.0, 18.0, 0.0, 30.0, 0.0, 9.0,
        ])
        .unwrap();
        assert!((stopped.focal_length - lens.focal_length).abs() < 1e-9);
        assert_eq!(stopped.stop, 9.0);
        for (numbers, expect) in [
            (&[][..], "0 numbers"),
            (&[1.0, 2.0, 3.0], "3 numbers"),
            (
                &[-50.0, 5.0, 1.5, 20.0, 50.0, 40.0, 1.0, 20.0],
                "does not focus",
            ),
            (&[0.0, 5.0, 1.0, 20.0], "does not focus"),
        ] {
            assert!(thin_lens(numbers).unwrap_err().contains(expect));
        }
    }
}
