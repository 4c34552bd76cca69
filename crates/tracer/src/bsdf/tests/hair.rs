//! Fibres: members of the common suite, and what they do with energy and colour.

use super::furnace::albedo;
use super::*;

fn fibre(h: f32, sigma_a: Rgb, beta_m: f32, beta_n: f32, tilt: f32) -> Bsdf<'static> {
    Bsdf::Hair(Hair::new(h, 1.55, sigma_a, beta_m, beta_n, tilt))
}

pub(super) fn cases() -> Vec<Case> {
    let brown = Hair::absorption_of_melanin(1.3, 0.2);
    [
        ("hair", fibre(0.3, brown, 0.3, 0.3, 2.0)),
        (
            "hair, blond, rough",
            fibre(-0.7, brown * 0.1, 0.9, 0.8, 2.0),
        ),
        ("hair, smooth", fibre(0.9, brown * 0.3, 0.1, 0.2, 3.0)),
        ("hair, white", fibre(0.0, Rgb::ZERO, 0.4, 0.5, 0.0)),
    ]
    .map(|(name, bsdf)| Case {
        name,
        bsdf,
        reciprocal: false,
    })
    .to_vec()
}

/// What absorbs nothing loses nothing, from anywhere, by samples and by the integral of the values.
#[test]
fn a_white_fibre_loses_nothing() {
    for h in [-0.9, -0.3, 0.0, 0.6] {
        for (m, n, tilt) in [(0.2, 0.3, 2.0), (0.6, 0.9, 0.0), (1.0, 0.5, 5.0)] {
            let bsdf = fibre(h, Rgb::ZERO, m, n, tilt);
            for (i, wo) in views().into_iter().enumerate() {
                let (a, error) = albedo(&bsdf, wo, 20_000);
                let off = (a - Rgb::ONE).abs().max_element();
                assert!(
                    off < 2e-3 + 4.0 * error as f32,
                    "h {h}, {m} {n} {tilt} from {wo}: {a}"
                );
                let stated = bsdf.albedo(wo);
                assert!((stated - Rgb::ONE).abs().max_element() < 1e-4, "{stated}");
                // Quadrature is slow: from two sides.
                if i != 1 && i != 6 {
                    continue;
                }
                let f = |w: [f32; 3]| f64::from(bsdf.eval(wo, w.into()).y);
                let whole = sphere_integral_about(pole(&bsdf, wo).to_array(), f, 1e-3);
                assert!((whole - 1.0).abs() < 6e-3, "h {h} from {wo}: {whole}");
            }
        }
    }
}

/// More pigment is darker, by channel, and the fit of a colour gives pigment that lets it through.
#[test]
fn pigment_darkens() {
    let at = |sigma: Rgb| fibre(0.2, sigma, 0.3, 0.3, 2.0).albedo(direction(0.9, 0.2));
    let (fair, dark) = (
        at(Hair::absorption_of_melanin(0.3, 0.0)),
        at(Hair::absorption_of_melanin(8.0, 0.0)),
    );
    assert!(fair.cmpgt(dark).all());
    assert!(fair.x > fair.y && fair.y > fair.z, "{fair}");
    let red = Hair::absorption_of(Rgb::new(0.8, 0.3, 0.1), 0.3);
    assert!(red.x < red.y && red.y < red.z && red.x > 0.0, "{red}");
    assert_eq!(Hair::absorption_of(Rgb::ONE, 0.3), Rgb::ZERO);
}
