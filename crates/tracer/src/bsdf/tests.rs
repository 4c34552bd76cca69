//! Every model against its contract: samples follow their density, weights are f |cos| / pdf, energy is
//! conserved, light may travel backwards; and the coated surfaces against a random walk.

use super::*;
use crate::math::{luminance, safe_sqrt, sin_cos_2pi};
use testkit::chi2::SphereTest;
use testkit::{Moments, TestRng, sphere_integral_about, ttest};

mod coated;
mod furnace;
mod hair;
mod lobes;
mod principled;
mod walk;

/// A model with a name.
#[derive(Clone, Copy)]
struct Case {
    name: &'static str,
    bsdf: Bsdf<'static>,
    /// What returns from one direction to the other is the same both ways.
    reciprocal: bool,
}

fn grey(x: f32) -> Rgb {
    Rgb::splat(x)
}

/// Copper, by channel.
fn copper() -> (Rgb, Rgb) {
    (Rgb::new(0.21, 0.92, 1.17), Rgb::new(3.67, 2.56, 2.3))
}

fn coat(ior: f32, alpha: f32, thickness: f32) -> &'static CoatTable {
    Box::leak(Box::new(CoatTable::new(
        ior,
        alpha,
        alpha,
        thickness,
        0.0,
        Rgb::ZERO,
        10,
    )))
}

/// A mix of models with their shares.
fn mixed(parts: &[(Bsdf<'static>, f32)]) -> Bsdf<'static> {
    let mixed = Mixed::new(parts, Vec3::new(0.6, 0.0, 0.8));
    Bsdf::Mixed(Box::leak(Box::new(mixed)))
}

/// Every model, with parameters from the tame to the extreme.
fn cases() -> Vec<Case> {
    let (eta, k) = copper();
    let one = Rgb::ONE;
    let colour = Rgb::new(0.2, 0.5, 0.8);
    let hazy: &'static CoatTable = Box::leak(Box::new(CoatTable::new(
        1.5,
        0.1,
        0.1,
        0.3,
        0.4,
        Rgb::new(0.9, 0.5, 0.2),
        10,
    )));
    let lobes: &'static [LobeParam] = Box::leak(Box::new([
        LobeParam {
            albedo: Rgb::new(0.3, 0.2, 0.1),
            c: Vec3::new(-1.0, -1.0, 0.95),
            n: 40.0,
        },
        LobeParam {
            albedo: grey(0.1),
            c: Vec3::new(0.7, 0.7, 0.8),
            n: 5.0,
        },
        LobeParam {
            albedo: grey(0.05),
            c: Vec3::new(-0.9, -0.4, -0.3),
            n: 3.0,
        },
    ]));
    let glass = |a, b| Bsdf::Dielectric(Dielectric::new(1.5, a, b, one, one));
    let coated =
        |ior, a: f32, t, r| Bsdf::CoatedDiffuse(CoatedDiffuse::new(r, coat(ior, a, t), a, a));
    let lacquer = |a, c: f32, t| {
        Bsdf::CoatedConductor(CoatedConductor::new(eta, k, a, a, coat(1.5, c, t), c, c))
    };
    [
        ("diffuse", Bsdf::Diffuse(Diffuse::new(colour))),
        (
            "oren-nayar 20",
            Bsdf::OrenNayar(OrenNayar::new(colour, 20.0)),
        ),
        (
            "oren-nayar 90",
            Bsdf::OrenNayar(OrenNayar::new(grey(1.0), 90.0)),
        ),
        (
            "phong 0",
            Bsdf::Phong(Phong::new(grey(0.2), grey(0.8), 0.0)),
        ),
        (
            "phong 10",
            Bsdf::Phong(Phong::new(colour * 0.5, grey(0.3), 10.0)),
        ),
        (
            "phong 500",
            Bsdf::Phong(Phong::new(grey(0.0), grey(1.0), 500.0)),
        ),
        (
            "lafortune",
            Bsdf::Lafortune(Lafortune::new(colour * 0.3, lobes)),
        ),
        ("glass 0.05", glass(0.05, 0.05)),
        ("glass 0.3", glass(0.3, 0.3)),
        ("glass 0.1 x 0.6", glass(0.1, 0.6)),
        (
            "water to air, tinted",
            Bsdf::Dielectric(Dielectric::new(1.0 / 1.33, 0.2, 0.2, grey(0.3), colour)),
        ),
        (
            "metal 0.02",
            Bsdf::Conductor(Conductor::new(eta, k, 0.02, 0.02)),
        ),
        (
            "metal 0.4",
            Bsdf::Conductor(Conductor::new(eta, k, 0.4, 0.4)),
        ),
        (
            "metal 1 x 0.1",
            Bsdf::Conductor(Conductor::new(eta, k, 1.0, 0.1)),
        ),
        ("coated, smooth", coated(1.5, 0.0, 0.01, colour)),
        ("coated 0.3, thick", coated(1.5, 0.3, 0.5, colour)),
        ("coated 0.05, diamond", coated(2.4, 0.05, 0.01, grey(1.0))),
        (
            "coated, hazy",
            Bsdf::CoatedDiffuse(CoatedDiffuse::new(colour, hazy, 0.1, 0.1)),
        ),
        ("lacquer, smooth on 0.3", lacquer(0.3, 0.0, 0.01)),
        ("lacquer, 0.2 on 0.1", lacquer(0.1, 0.2, 0.01)),
        ("lacquer, 0.2 on smooth", lacquer(0.0, 0.2, 0.2)),
        (
            "paper",
            Bsdf::DiffuseTransmission(DiffuseTransmission::new(colour * 0.7, grey(0.3))),
        ),
        (
            "mixed, diffuse and metal",
            mixed(&[
                (Bsdf::Diffuse(Diffuse::new(colour)), 0.7),
                (Bsdf::Conductor(Conductor::new(eta, k, 0.1, 0.1)), 0.3),
            ]),
        ),
        (
            "mixed, with a mirror",
            mixed(&[
                (Bsdf::OrenNayar(OrenNayar::new(grey(0.8), 30.0)), 0.2),
                (Bsdf::Mirror(Mirror::new(grey(0.9))), 0.5),
                (coated(1.5, 0.3, 0.5, colour), 0.2),
                (Bsdf::Diffuse(Diffuse::new(grey(0.0))), 0.1),
            ]),
        ),
        (
            "mixed, paper and metal",
            mixed(&[
                (
                    Bsdf::DiffuseTransmission(DiffuseTransmission::new(grey(0.2), grey(0.6))),
                    0.6,
                ),
                (Bsdf::Conductor(Conductor::new(eta, k, 0.4, 0.4)), 0.4),
            ]),
        ),
    ]
    .map(|(name, bsdf)| Case {
        name,
        bsdf,
        reciprocal: !name.contains("tinted"),
    })
    .into_iter()
    .chain(principled::cases())
    .chain(hair::cases())
    .collect()
}

/// Direction with this cosine, away from the axes of the frame.
fn direction(cos: f32, turn: f32) -> Vec3 {
    let (s, c) = sin_cos_2pi(turn);
    let sin = safe_sqrt(1.0 - cos * cos);
    Vec3::new(sin * c, sin * s, cos)
}

/// From above, oblique, grazing, and from below.
fn views() -> Vec<Vec3> {
    [1.0, 0.8, 0.35, 0.1, 0.02, -0.02, -0.3, -0.7, -0.95]
        .iter()
        .enumerate()
        .map(|(i, &cos)| direction(cos, 0.07 + 0.23 * i as f32 % 1.0))
        .collect()
}

/// Where most of the light for `wo` comes from: the pole of grids.
fn pole(bsdf: &Bsdf, wo: Vec3) -> Vec3 {
    let mut rng = TestRng::new(99);
    let mut best = (-1.0, Vec3::Z);
    for _ in 0..64 {
        let sampled = bsdf.sample(wo, rng.u(), rng.u2().into());
        if let Some(s) = sampled.filter(|s| !s.delta && s.pdf > best.0) {
            best = (s.pdf, s.wi);
        }
    }
    best.1
}

#[test]
fn samples_follow_their_density_from_above() {
    samples_follow_their_density(|wo| wo.z > 0.2);
}

#[test]
fn samples_follow_their_density_at_the_horizon() {
    samples_follow_their_density(|wo| wo.z.abs() <= 0.2);
}

#[test]
fn samples_follow_their_density_from_below() {
    samples_follow_their_density(|wo| wo.z < -0.2);
}

fn samples_follow_their_density(chosen: impl Fn(Vec3) -> bool) {
    let tests = cases().len() * views().len();
    let mut failures = vec![];
    for (i, case) in cases().iter().enumerate() {
        for (j, &wo) in views().iter().enumerate().filter(|(_, wo)| chosen(**wo)) {
            let test = SphereTest {
                axis: pole(&case.bsdf, wo).to_array(),
                rings: 16,
                power: 2,
                sectors: 12,
                samples: 100_000,
                tests,
                ..SphereTest::default()
            };
            let sample = |rng: &mut TestRng| {
                let s = case.bsdf.sample(wo, rng.u(), rng.u2().into())?;
                (!s.delta).then(|| s.wi.to_array())
            };
            let pdf = |w: [f32; 3]| f64::from(case.bsdf.pdf(wo, Vec3::from_array(w)));
            // Phong and Lafortune lobes go on below the surface, where samples are lost.
            let lost_below = matches!(case.bsdf, Bsdf::Phong(_) | Bsdf::Lafortune(_));
            let pdf = |w: [f32; 3]| {
                if lost_below && w[2] * wo.z <= 0.0 {
                    0.0
                } else {
                    pdf(w)
                }
            };
            // Nothing but delta lobes, at least from here.
            if case.bsdf.is_delta() {
                continue;
            }
            if let Err(e) = test.run(1000 + (i * 100 + j) as u64, sample, pdf) {
                failures.push(format!("{} from {wo}: {e}", case.name));
            }
        }
    }
    assert!(
        failures.is_empty(),
        "{} of {tests} fail\n{}",
        failures.len(),
        failures.join("\n")
    );
}

#[test]
fn weights_are_f_cos_over_pdf() {
    for case in cases() {
        let mut rng = TestRng::new(4);
        for wo in views() {
            for _ in 0..2000 {
                let Some(s) = case.bsdf.sample(wo, rng.u(), rng.u2().into()) else {
                    continue;
                };
                assert!(
                    s.weight.is_finite() && s.weight.min_element() >= 0.0,
                    "{}: {s:?}",
                    case.name
                );
                assert!((s.wi.length() - 1.0).abs() < 1e-4, "{}: {s:?}", case.name);
                assert_eq!(s.transmitted, s.wi.z * wo.z < 0.0, "{}: {s:?}", case.name);
                if s.delta {
                    assert!(s.pdf > 0.0 && s.pdf <= 1.0 + 1e-6, "{}: {s:?}", case.name);
                    continue;
                }
                let (f, pdf) = case.bsdf.eval_pdf(wo, s.wi);
                assert_eq!(
                    (f, pdf),
                    (case.bsdf.eval(wo, s.wi), case.bsdf.pdf(wo, s.wi))
                );
                // Half vectors found again from the directions differ a little at the horizon.
                let tolerance = 2e-3 + 3e-6 / s.wi.z.abs().min(wo.z.abs());
                assert!(
                    (pdf / s.pdf - 1.0).abs() < tolerance,
                    "{} from {wo}: pdf {pdf}, {s:?}",
                    case.name
                );
                let error = (f - s.weight * s.pdf).abs().max_element();
                assert!(
                    error <= tolerance * f.max_element(),
                    "{} from {wo}: f cos {f}, {s:?}",
                    case.name
                );
            }
        }
    }
}

#[test]
fn means_of_samples_are_integrals() {
    let (cases, views) = (cases(), views());
    let level = testkit::sidak(0.01, cases.len() * views.len());
    let mut failures = vec![];
    for case in &cases {
        for &wo in &views {
            let mut rng = TestRng::new(8);
            let mut moments = Moments::default();
            let mut bound = 0.0f32;
            for _ in 0..40_000 {
                let s = case.bsdf.sample(wo, rng.u(), rng.u2().into());
                let w = s.filter(|s| !s.delta).map_or(0.0, |s| luminance(s.weight));
                bound = bound.max(w);
                moments.add(f64::from(w));
            }
            let f = |w: [f32; 3]| f64::from(luminance(case.bsdf.eval(wo, w.into())));
            let integral = sphere_integral_about(pole(&case.bsdf, wo).to_array(), f, 1e-4);
            let p = ttest::p_value(&moments, integral);
            if p < level && (moments.mean() / integral - 1.0).abs() > 1e-3 {
                failures.push(format!(
                    "{} from {wo}: samples {:.5} +- {:.5} (largest weight {bound}), integral {integral:.5}, p {p:.1e}",
                    case.name,
                    moments.mean(),
                    moments.error(),
                ));
            }
        }
    }
    assert!(failures.is_empty(), "{}", failures.join("\n"));
}

#[test]
fn light_may_travel_backwards() {
    // f(wo, wi) = f(wi, wo) for reflection; transmission from side o to side i carries eta^2 more
    // where radiance is compressed: f(wo, wi) eta_i^2 = f(wi, wo) eta_o^2.
    let mut rng = TestRng::new(21);
    for case in cases().iter().filter(|c| c.reciprocal) {
        for _ in 0..4000 {
            let (a, b) = (Vec3::from(rng.direction()), Vec3::from(rng.direction()));
            let scale = match case.bsdf {
                Bsdf::Dielectric(_) if a.z > 0.0 && b.z < 0.0 => 1.5f32 * 1.5,
                Bsdf::Dielectric(_) if a.z < 0.0 && b.z > 0.0 => 1.0 / (1.5 * 1.5),
                _ => 1.0,
            };
            let there = case.bsdf.eval(a, b) / b.z.abs() * scale;
            let back = case.bsdf.eval(b, a) / a.z.abs();
            let error = (there - back).abs().max_element();
            // Near total reflection 1 - F has few digits.
            let tolerance =
                1e-3 + 1e-5 / a.z.abs().min(b.z.abs()) + if scale == 1.0 { 0.0 } else { 0.03 };
            assert!(
                error <= tolerance * there.max_element() + if scale == 1.0 { 1e-9 } else { 1e-5 },
                "{}: {a} to {b} {there}, back {back}",
                case.name
            );
        }
    }
}

/// The same direction on the other side. Not a closure: rustc 1.95 reuses an argument that the first
/// of two closures has changed in place for the second (rust-lang/rust#155241).
fn turn(v: Vec3) -> Vec3 {
    Vec3::new(v.x, v.y, -v.z)
}

#[test]
fn both_sides_reflect_alike() {
    let mut rng = TestRng::new(22);
    for case in cases().iter().filter(|c| !c.bsdf.transmits()) {
        for _ in 0..500 {
            let (a, b) = (Vec3::from(rng.direction()), Vec3::from(rng.direction()));
            if case.name.contains("tilted") {
                // A normal that leans to one side of the surface leans to the other on its back.
                let (front, p) = case.bsdf.eval_pdf(a, b);
                let (back, q) = case.bsdf.eval_pdf(-a, -b);
                let error = (front - back).abs().max_element().max((p - q).abs());
                let size = front.max_element().max(p);
                assert!(
                    error <= 2e-3 * size + 1e-6,
                    "{}: {front}, back {back}",
                    case.name
                );
                continue;
            }
            assert_eq!(
                case.bsdf.eval_pdf(a, b),
                case.bsdf.eval_pdf(turn(a), turn(b)),
                "{}",
                case.name
            );
            let (u, v) = (rng.u(), Vec2::from(rng.u2()));
            let s = case.bsdf.sample(a, u, v);
            let t = case.bsdf.sample(turn(a), u, v);
            assert_eq!(
                s.map(|s| BsdfSample {
                    wi: turn(s.wi),
                    ..s
                }),
                t,
                "{}",
                case.name
            );
        }
    }
}

#[test]
fn extreme_directions_and_numbers_stay_finite() {
    let ends = [0.0, 1e-7, 0.5, crate::math::ONE_MINUS_EPSILON];
    let cosines = [
        1.0,
        1e-3,
        1e-6,
        1e-20,
        f32::MIN_POSITIVE,
        0.0,
        -0.0,
        -1e-20,
        -1e-4,
        -1.0,
    ];
    let mut list = cases();
    let (eta, k) = copper();
    let one = Rgb::ONE;
    let extra = [
        (
            "glass 1",
            Bsdf::Dielectric(Dielectric::new(1.0, 0.3, 0.3, one, one)),
        ),
        (
            "glass, black",
            Bsdf::Dielectric(Dielectric::new(1.5, 0.3, 0.3, Rgb::ZERO, Rgb::ZERO)),
        ),
        (
            "glass, very smooth",
            Bsdf::Dielectric(Dielectric::new(1.5, 1e-3, 1e-3, one, one)),
        ),
        (
            "glass, scratched",
            Bsdf::Dielectric(Dielectric::new(1.5, 1.0, 0.0, one, one)),
        ),
        (
            "metal, very smooth",
            Bsdf::Conductor(Conductor::new(eta, k, 1e-3, 1e-3)),
        ),
        ("metal, perfect", {
            let (eta, k) = conductor_k_from_reflectance(one);
            Bsdf::Conductor(Conductor::new(eta, k, 0.3, 0.3))
        }),
        (
            "phong, black",
            Bsdf::Phong(Phong::new(Rgb::ZERO, Rgb::ZERO, 3.0)),
        ),
        (
            "phong, very sharp",
            Bsdf::Phong(Phong::new(Rgb::ZERO, one, 1e6)),
        ),
        (
            "lafortune, empty",
            Bsdf::Lafortune(Lafortune::new(Rgb::ZERO, &[])),
        ),
        (
            "coat of nothing",
            Bsdf::CoatedDiffuse(CoatedDiffuse::new(one, coat(1.0, 0.3, 0.0), 0.3, 0.3)),
        ),
        (
            "coat of air",
            Bsdf::CoatedDiffuse(CoatedDiffuse::new(one, coat(0.7, 0.3, 0.1), 0.3, 0.3)),
        ),
        (
            "coat, opaque",
            Bsdf::CoatedDiffuse(CoatedDiffuse::new(one, coat(1.5, 0.0, 1e4), 0.0, 0.0)),
        ),
        (
            "lacquer of air",
            Bsdf::CoatedConductor(CoatedConductor::new(
                eta,
                k,
                0.2,
                0.2,
                coat(0.7, 0.0, 0.1),
                0.0,
                0.0,
            )),
        ),
        (
            "lacquer, smooth on smooth",
            Bsdf::CoatedConductor(CoatedConductor::new(
                eta,
                k,
                0.0,
                0.0,
                coat(1.5, 0.0, 0.1),
                0.0,
                0.0,
            )),
        ),
    ];
    list.extend(extra.map(|(name, bsdf)| Case {
        name,
        bsdf,
        reciprocal: true,
    }));
    for case in &list {
        for cos in cosines {
            let wo = direction(cos, 0.3);
            assert!(
                case.bsdf.albedo(wo).is_finite(),
                "{}: albedo from {wo}",
                case.name
            );
            for other in cosines {
                for turn in [0.3, 0.8] {
                    let (f, pdf) = case.bsdf.eval_pdf(wo, direction(other, turn));
                    assert!(
                        f.is_finite() && pdf.is_finite() && f.min_element() >= 0.0 && pdf >= 0.0,
                        "{}: {wo}, {other}: {f} {pdf}",
                        case.name
                    );
                }
            }
            for u in ends {
                for v in ends {
                    for w in ends {
                        let Some(s) = case.bsdf.sample(wo, u, Vec2::new(v, w)) else {
                            continue;
                        };
                        assert!(
                            s.weight.is_finite()
                                && s.pdf.is_finite()
                                && s.pdf > 0.0
                                && s.wi.is_finite(),
                            "{}: {wo}, {u} {v} {w}: {s:?}",
                            case.name
                        );
                    }
                }
            }
        }
    }
}
