//! Lobes with a known shape.

use super::*;
use crate::math::{PI, dot, powf};

/// The lecture's claim: a mirror ray can be jittered so that it matches Phong exactly.
#[test]
fn the_jittered_mirror_ray_has_exactly_the_phong_density() {
    for (i, n) in [0.0f32, 1.0, 20.0, 500.0, 20_000.0].into_iter().enumerate() {
        for (j, wo) in [direction(0.9, 0.1), direction(0.3, 0.6)]
            .into_iter()
            .enumerate()
        {
            let mirror = Vec3::new(-wo.x, -wo.y, wo.z);
            let jitter = |rng: &mut TestRng| Phong::jitter(mirror, n, rng.u2().into());
            // Over the sphere: (n + 1) / (2 pi) cos^n.
            let test = SphereTest {
                axis: mirror.to_array(),
                rings: 24,
                power: 2,
                tests: 10,
                ..SphereTest::default()
            };
            let density = |w: [f32; 3]| {
                // cos from the chord: with a large n the scalar product has too few digits.
                let d = (Vec3::from_array(w) - mirror).as_dvec3();
                let cos = 1.0 - 0.5 * d.length_squared();
                let n = f64::from(n);
                if cos > 0.0 {
                    (n + 1.0) / (2.0 * std::f64::consts::PI) * libm::pow(cos, n)
                } else {
                    0.0
                }
            };
            let seed = (i * 10 + j) as u64;
            if let Err(e) = test.run(seed, |rng| Some(jitter(rng).to_array()), density) {
                panic!("n = {n}: {e}");
            }
            // Along the angle: the cumulative distribution is 1 - cos^(n+1), so its values at the
            // samples are uniform.
            let mut rng = TestRng::new(seed + 1000);
            let mut seen = [0u64; 32];
            for _ in 0..100_000 {
                let d = (jitter(&mut rng) - mirror).as_dvec3();
                let cos = 1.0 - 0.5 * d.length_squared();
                let u = 1.0 - libm::pow(cos.max(0.0), f64::from(n) + 1.0);
                seen[((u * 32.0) as usize).min(31)] += 1;
            }
            let chi2 = testkit::chi2::compare(&seen, &[100_000.0 / 32.0; 32]);
            assert!(chi2.p > 1e-3, "n = {n}: {chi2:?} {seen:?}");
        }
    }
}

#[test]
fn phong_is_the_published_formula() {
    let (kd, ks, n) = (Rgb::new(0.1, 0.2, 0.3), Rgb::new(0.5, 0.4, 0.3), 12.0f32);
    let bsdf = Bsdf::Phong(Phong::new(kd, ks, n));
    let mut rng = TestRng::new(2);
    for _ in 0..1000 {
        let wo = Vec3::from(rng.direction()).abs();
        let wi = Vec3::from(rng.direction());
        let mirror = Vec3::new(-wo.x, -wo.y, wo.z);
        let lobe = powf(dot(mirror, wi).max(0.0), n);
        let f = (kd / PI + ks * ((n + 2.0) / (2.0 * PI) * lobe)) * wi.z.max(0.0);
        let got = bsdf.eval(wo, wi);
        assert!(
            (f - got).abs().max_element() < 1e-5 * (1.0 + f.max_element()),
            "{f} {got}"
        );
    }
    // At normal incidence all of kd + ks comes back: (n + 2) cos^(n+1) integrates to 1.
    let f = |w: [f32; 3]| f64::from(bsdf.eval(Vec3::Z, w.into()).x);
    let albedo = sphere_integral_about([0.0, 0.0, 1.0], f, 1e-5);
    assert!((albedo - 0.6).abs() < 1e-3, "{albedo}");
}

#[test]
fn a_lafortune_lobe_about_the_mirror_is_phong() {
    let n = 30.0f32;
    let ks = 0.7;
    let lobes = [LobeParam {
        albedo: grey(ks * (n + 2.0) / (2.0 * PI)),
        c: Vec3::new(-1.0, -1.0, 1.0),
        n,
    }];
    let a = Bsdf::Lafortune(Lafortune::new(grey(0.2), &lobes));
    let b = Bsdf::Phong(Phong::new(grey(0.2), grey(ks), n));
    let mut rng = TestRng::new(12);
    for _ in 0..1000 {
        let (wo, wi) = (Vec3::from(rng.direction()), Vec3::from(rng.direction()));
        let (x, y) = (a.eval(wo, wi), b.eval(wo, wi));
        assert!(
            (x - y).abs().max_element() < 1e-4 * (1.0 + x.max_element()),
            "{x} {y}"
        );
    }
}

#[test]
fn visible_normals_follow_their_density() {
    // Normals, not directions: D(m) G1(wo) (wo.m) / wo.z over the hemisphere.
    let tests = 3 * 4;
    for (i, (ax, ay)) in [(0.1, 0.1), (0.7, 0.7), (0.8, 0.15)]
        .into_iter()
        .enumerate()
    {
        let ggx = Ggx::new(ax, ay);
        for (j, cos) in [1.0, 0.6, 0.15, 0.02].into_iter().enumerate() {
            let wo = direction(cos, 0.15);
            let test = SphereTest {
                power: 2,
                rings: 20,
                tests,
                ..SphereTest::default()
            };
            let sample =
                |rng: &mut TestRng| Some(ggx.sample_visible(wo, rng.u2().into()).to_array());
            let pdf = |m: [f32; 3]| {
                let m = Vec3::from_array(m);
                let l = ggx.l(wo);
                let visible = dot(wo, m).max(0.0) * 2.0 / (wo.z + l);
                if m.z > 0.0 {
                    f64::from(ggx.d(m) * visible)
                } else {
                    0.0
                }
            };
            if let Err(e) = test.run((i * 10 + j) as u64, sample, pdf) {
                panic!("alpha {ax} x {ay} from {wo}: {e}");
            }
        }
    }
}

#[test]
fn fresnel_equations_have_known_values() {
    // ((n - 1) / (n + 1))^2 at normal incidence, Brewster's angle, total reflection.
    let (r, t) = fresnel_dielectric(1.0, 1.5);
    assert!((r - 0.04).abs() < 1e-6 && t == 1.0, "{r} {t}");
    let brewster = 1.0 / (1.0f32 + 1.5 * 1.5).sqrt();
    // At Brewster's angle only the perpendicular part returns: ((n^2 - 1) / (n^2 + 1))^2 / 2.
    let (r, _) = fresnel_dielectric(brewster, 1.5);
    let expected = 0.5 * (1.25f32 / 3.25) * (1.25 / 3.25);
    assert!((r - expected).abs() < 1e-6, "{r} {expected}");
    assert_eq!(fresnel_dielectric(0.5, 1.0 / 1.5), (1.0, 0.0));
    assert_eq!(fresnel_dielectric(0.3, 1.0), (0.0, 0.3));
    assert_eq!(fresnel_dielectric(0.0, 1.5).0, 1.0);
    // A metal with k = 0 is a dielectric.
    for cos in [1.0, 0.8, 0.5, 0.2, 0.01] {
        let r = fresnel_conductor(cos, grey(1.5), Rgb::ZERO).x;
        assert!(
            (r - fresnel_dielectric(cos, 1.5).0).abs() < 2e-6,
            "{cos}: {r}"
        );
    }
    let (eta, k) = conductor_k_from_reflectance(Rgb::new(0.0, 0.5, 0.98));
    let r = fresnel_conductor(1.0, eta, k);
    assert!(
        (r - Rgb::new(0.0, 0.5, 0.98)).abs().max_element() < 1e-5,
        "{r}"
    );
}
