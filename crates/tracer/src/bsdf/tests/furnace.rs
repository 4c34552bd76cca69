//! Energy: nothing gives off more than it gets, and what should lose nothing loses nothing.

use super::*;

/// Mean weight with radiance brought back to power: transmission undone by eta^2.
pub(super) fn albedo(bsdf: &Bsdf, wo: Vec3, n: u32) -> (Rgb, f64) {
    let mut rng = TestRng::new(31);
    let mut sum = glam::DVec3::ZERO;
    let mut moments = Moments::default();
    for _ in 0..n {
        let weight = bsdf
            .sample(wo, rng.u(), rng.u2().into())
            .map_or(Rgb::ZERO, |s| s.weight * s.eta * s.eta);
        sum += weight.as_dvec3();
        moments.add(f64::from(weight.max_element()));
    }
    ((sum / f64::from(n)).as_vec3(), moments.error())
}

#[test]
fn nothing_is_created() {
    for case in cases() {
        // Lafortune lobes conserve what their numbers conserve.
        if case.name.starts_with("lafortune") {
            continue;
        }
        for wo in views() {
            let (a, error) = albedo(&case.bsdf, wo, 20_000);
            let limit = 1.0 + 4.0 * error as f32 + 1e-5;
            assert!(
                a.max_element() <= limit,
                "{} from {wo}: {a} +- {error}",
                case.name
            );
        }
    }
}

#[test]
fn what_is_clear_or_white_loses_nothing() {
    let one = Rgb::ONE;
    let white = [
        ("diffuse", Bsdf::Diffuse(Diffuse::new(one))),
        ("mirror", Bsdf::Mirror(Mirror::new(one))),
        (
            "glass",
            Bsdf::Dielectric(Dielectric::new(1.5, 0.0, 0.0, one, one)),
        ),
        (
            "air in water",
            Bsdf::Dielectric(Dielectric::new(1.0 / 1.33, 0.0, 0.0, one, one)),
        ),
        (
            "nothing",
            Bsdf::Dielectric(Dielectric::new(1.0, 0.5, 0.5, one, one)),
        ),
        ("pane", Bsdf::ThinDielectric(ThinDielectric::new(1.5))),
        (
            "paper",
            Bsdf::DiffuseTransmission(DiffuseTransmission::new(grey(0.25), grey(0.75))),
        ),
    ];
    for (name, bsdf) in white {
        for wo in views() {
            // Every sample has weight 1 (paper: on either side), so a few are enough.
            let (a, error) = albedo(&bsdf, wo, 1000);
            let tolerance = 1e-4 + 4.0 * error as f32;
            assert!(
                (a - one).abs().max_element() < tolerance,
                "{name} from {wo}: {a}"
            );
            assert!(
                (bsdf.albedo(wo) - one).abs().max_element() < 1e-5,
                "{name}: {}",
                bsdf.albedo(wo)
            );
        }
    }
}

#[test]
fn smooth_glass_bends_by_snell_and_splits_by_fresnel() {
    let bsdf = Bsdf::Dielectric(Dielectric::new(1.5, 0.0, 0.0, Rgb::ONE, Rgb::ONE));
    for (cos, eta) in [(0.8f32, 1.5f32), (-0.9, 1.0 / 1.5)] {
        let wo = direction(cos, 0.2);
        let r = fresnel_dielectric(cos.abs(), eta).0;
        let low = bsdf.sample(wo, r - 1e-3, Vec2::ZERO).unwrap();
        let high = bsdf.sample(wo, r + 1e-3, Vec2::ZERO).unwrap();
        assert!(low.delta && !low.transmitted && low.eta == 1.0 && (low.pdf - r).abs() < 1e-6);
        assert!((low.wi - Vec3::new(-wo.x, -wo.y, wo.z)).length() < 1e-6);
        assert!(high.delta && high.transmitted && (high.eta - eta).abs() < 1e-6);
        assert!(
            (high.wi.truncate() + wo.truncate() / eta).length() < 1e-6,
            "Snell: {high:?}"
        );
        assert!((high.weight.x - 1.0 / (eta * eta)).abs() < 1e-5, "{high:?}");
    }
    // Total reflection from inside.
    let wo = direction(-0.5, 0.4);
    let s = bsdf.sample(wo, 0.999_999, Vec2::ZERO).unwrap();
    assert!(!s.transmitted && s.pdf == 1.0 && s.wi.z < 0.0, "{s:?}");
}

#[test]
fn a_pane_reflects_between_its_faces() {
    // R + T^2 R / (1 - R^2) = 2 R / (1 + R).
    let pane = ThinDielectric::new(1.5);
    for cos in [1.0, 0.5, 0.1] {
        let r = fresnel_dielectric(cos, 1.5).0;
        assert!((pane.reflectance(cos) - 2.0 * r / (1.0 + r)).abs() < 1e-6);
    }
}

/// Directional albedo of GGX with perfectly reflecting facets, single scattering, as quadrature of the
/// formula (not of our code) gives it.
#[test]
fn ggx_loses_what_bounces_between_facets() {
    let metal = (Rgb::ZERO, grey(1e4));
    for alpha in [0.1f32, 0.25, 0.5, 1.0] {
        for cos in [1.0f32, 0.5, 0.1] {
            let bsdf = Bsdf::Conductor(Conductor::new(metal.0, metal.1, alpha, alpha));
            let wo = direction(cos, 0.3);
            let (sampled, error) = albedo(&bsdf, wo, 100_000);
            let exact = ggx_albedo(f64::from(alpha), f64::from(cos));
            println!(
                "alpha {alpha} cos {cos}: {exact:.4} {:.4} +- {error:.4}",
                sampled.x
            );
            assert!(
                (f64::from(sampled.x) - exact).abs() < 4.0 * error + 1e-3,
                "alpha {alpha} cos {cos}: sampled {} +- {error}, exact {exact}",
                sampled.x
            );
        }
    }
}

/// Integral of D G / (4 cos_o) over half vectors, in double precision: dwi = 4 (wo.m) dm.
fn ggx_albedo(alpha: f64, cos: f64) -> f64 {
    let sin = (1.0 - cos * cos).sqrt();
    let lambda = |z: f64| {
        let tan2 = (1.0 - z * z) / (z * z);
        0.5 * ((1.0 + alpha * alpha * tan2).sqrt() - 1.0)
    };
    let n = 1000;
    let mut sum = 0.0;
    for i in 0..n {
        // Stratified in the distribution of normals: tan^2 = alpha^2 u / (1 - u).
        let u = (f64::from(i) + 0.5) / f64::from(n);
        let tan2 = alpha * alpha * u / (1.0 - u);
        let mz = 1.0 / (1.0 + tan2).sqrt();
        let ms = (1.0 - mz * mz).max(0.0).sqrt();
        for j in 0..200 {
            let phi = (f64::from(j) + 0.5) / 200.0 * std::f64::consts::PI;
            let dot = sin * ms * libm::cos(phi) + cos * mz;
            let wi = 2.0 * dot * mz - cos;
            if dot > 0.0 && wi > 0.0 {
                // Density of m is D mz, so D cancels: G (wo.m) / (cos_o mz).
                sum += dot / (cos * mz * (1.0 + lambda(cos) + lambda(wi)));
            }
        }
    }
    sum / (f64::from(n) * 200.0)
}

#[test]
fn oren_nayar_knows_its_albedo() {
    for sigma in [0.0, 20.0, 90.0] {
        let bsdf = Bsdf::OrenNayar(OrenNayar::new(grey(0.8), sigma));
        for wo in views() {
            let f = |w: [f32; 3]| f64::from(bsdf.eval(wo, w.into()).x);
            let integral = testkit::sphere_integral(f, 1e-5);
            let a = f64::from(bsdf.albedo(wo).x);
            assert!(
                (a - integral).abs() < 1e-3,
                "sigma {sigma} from {wo}: {a} {integral}"
            );
        }
    }
}

/// How far the cheap albedos are from the integrals.
#[test]
fn albedos_are_close_to_what_is_sampled() {
    for case in cases() {
        let mut worst = (0.0f32, Vec3::Z, Rgb::ZERO, Rgb::ZERO);
        for wo in views() {
            let (sampled, _) = albedo(&case.bsdf, wo, 20_000);
            let stated = case.bsdf.albedo(wo);
            let error = (stated - sampled).abs().max_element();
            if error > worst.0 {
                worst = (error, wo, stated, sampled);
            }
        }
        let (error, wo, stated, sampled) = worst;
        println!(
            "{}: {error:.3} from {wo}: stated {stated}, sampled {sampled}",
            case.name
        );
        assert!(
            error < 0.6,
            "{} from {wo}: stated {stated}, sampled {sampled}",
            case.name
        );
    }
}
