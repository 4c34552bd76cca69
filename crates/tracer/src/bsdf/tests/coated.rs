//! Coated surfaces against the random walk.

use super::walk::Layered;
use super::*;
use crate::math::mean;

const COSINES: [f32; 5] = [0.97, 0.7, 0.4, 0.15, 0.03];

/// f |cos| of the boundary's own reflection, which the walk leaves out.
fn boundary(ior: f32, alpha: f32, wo: Vec3, wi: Vec3) -> Rgb {
    Bsdf::Dielectric(Dielectric::new(ior, alpha, alpha, Rgb::ONE, Rgb::ONE)).eval(wo, wi)
}

/// Means of the walk for a pair of directions: value and standard error of the mean of the channels.
fn walked(layered: &Layered, wo: Vec3, wi: Vec3, n: u32) -> (Rgb, f64) {
    let mut rng = TestRng::new(5);
    let mut sum = glam::DVec3::ZERO;
    let mut moments = Moments::default();
    for _ in 0..n {
        let f = layered.estimate(&mut rng, wo, wi);
        sum += f.as_dvec3();
        moments.add(f64::from(mean(f)));
    }
    ((sum / f64::from(n)).as_vec3(), moments.error())
}

#[test]
fn coated_diffuse_is_the_mean_of_the_walk() {
    let r = Rgb::new(0.1, 0.5, 0.95);
    let mut worst = (0.0f64, String::new());
    for (ior, alpha, thickness, max_depth) in [
        (1.5, 0.0, 0.01, 10),
        (1.5, 0.1, 0.01, 10),
        (1.5, 0.3, 0.01, 10),
        (1.5, 0.7, 0.01, 10),
        (1.5, 0.0, 0.5, 10),
        (1.5, 0.3, 0.5, 10),
        (1.33, 0.05, 0.05, 3),
        (2.4, 0.2, 0.01, 100),
        (1.5, 0.0, 0.01, 2),
    ] {
        let table = CoatTable::new(ior, alpha, alpha, thickness, 0.0, Rgb::ZERO, max_depth);
        let bsdf = Bsdf::CoatedDiffuse(CoatedDiffuse::new(r, &table, alpha, alpha));
        let layered = Layered {
            ior,
            alpha,
            thickness,
            max_depth,
            base: Bsdf::Diffuse(Diffuse::new(r)),
        };
        for cos_o in COSINES {
            for cos_i in COSINES {
                let (wo, wi) = (direction(cos_o, 0.1), direction(cos_i, 0.45));
                let (reference, error) = walked(&layered, wo, wi, 6_000);
                let f = (bsdf.eval(wo, wi) - boundary(ior, alpha, wo, wi)) / cos_i;
                let deviation = f64::from(((f - reference) / reference).abs().max_element());
                let noise = error / f64::from(mean(reference));
                let line = format!(
                    "ior {ior} alpha {alpha} thickness {thickness} depth {max_depth}, cosines {cos_o} {cos_i}: \
                     {f}, walk {reference}, off by {:.2} %, noise {:.2} %",
                    100.0 * deviation,
                    100.0 * noise
                );
                if deviation > worst.0 {
                    worst = (deviation, line.clone());
                }
                assert!(deviation < 0.01 + 4.0 * noise, "{line}");
            }
        }
    }
    println!("worst: {}", worst.1);
}

#[test]
fn coated_diffuse_keeps_the_energy_of_the_walk() {
    for (alpha, thickness) in [(0.0, 0.01), (0.2, 0.01), (0.5, 0.3)] {
        let r = Rgb::new(0.3, 0.6, 1.0);
        let table = CoatTable::new(1.5, alpha, alpha, thickness, 0.0, Rgb::ZERO, 10);
        let bsdf = Bsdf::CoatedDiffuse(CoatedDiffuse::new(r, &table, alpha, alpha));
        let base = Bsdf::Diffuse(Diffuse::new(r));
        let layered = Layered {
            ior: 1.5,
            alpha,
            thickness,
            max_depth: 10,
            base,
        };
        for cos in COSINES {
            let wo = direction(cos, 0.2);
            let (walk, error) = layered.albedo(wo, 60_000);
            let cell = table.transmittance_and_reflection(cos);
            let ours = bsdf.albedo(wo) - grey(cell.1);
            let deviation = ((ours - walk) / walk).abs().max_element();
            assert!(
                deviation < 0.01 + 4.0 * error as f32 / mean(walk),
                "alpha {alpha} thickness {thickness} cos {cos}: {ours}, walk {walk} +- {error}"
            );
        }
    }
}

#[test]
fn smooth_metal_under_a_smooth_layer_is_exact() {
    let (eta, k) = copper();
    let ior = 1.5;
    for thickness in [0.01, 0.3] {
        let table = CoatTable::new(ior, 0.0, 0.0, thickness, 0.0, Rgb::ZERO, 10);
        let bsdf = Bsdf::CoatedConductor(CoatedConductor::new(eta, k, 0.0, 0.0, &table, 0.0, 0.0));
        assert!(bsdf.is_delta());
        let base = Bsdf::Conductor(Conductor::new(eta / ior, k / ior, 0.0, 0.0));
        let layered = Layered {
            ior,
            alpha: 0.0,
            thickness,
            max_depth: 10,
            base,
        };
        for cos in COSINES {
            let wo = direction(cos, 0.2);
            let (walk, error) = layered.albedo(wo, 60_000);
            let s = bsdf.sample(wo, 0.5, Vec2::splat(0.5)).unwrap();
            let r = fresnel_dielectric(cos, ior).0;
            assert!(
                (s.wi - Vec3::new(-wo.x, -wo.y, wo.z)).length() < 1e-6 && s.delta && s.pdf == 1.0
            );
            assert!(
                (s.weight - grey(r) - walk).abs().max_element() < 4.0 * error as f32 + 1e-3,
                "thickness {thickness} cos {cos}: {} - {r}, walk {walk} +- {error}",
                s.weight
            );
        }
    }
}

/// How far the approximation of a metal under a layer is off, in albedo: the numbers in the module's
/// documentation come from here.
#[test]
fn coated_conductor_is_near_the_walk() {
    let (eta, k) = copper();
    let ior = 1.5;
    for (alpha, coat_alpha, limit) in LACQUERS {
        let table = CoatTable::new(ior, coat_alpha, coat_alpha, 0.01, 0.0, Rgb::ZERO, 10);
        let bsdf = Bsdf::CoatedConductor(CoatedConductor::new(
            eta, k, alpha, alpha, &table, coat_alpha, coat_alpha,
        ));
        let base = Bsdf::Conductor(Conductor::new(eta / ior, k / ior, alpha, alpha));
        let layered = Layered {
            ior,
            alpha: coat_alpha,
            thickness: 0.01,
            max_depth: 10,
            base,
        };
        let mut line = format!("metal {alpha}, coat {coat_alpha}:");
        let mut worst = 0.0f32;
        for cos in [0.97, 0.7, 0.4, 0.15] {
            let wo = direction(cos, 0.2);
            let (walk, _) = layered.albedo(wo, 40_000);
            let f = |w: [f32; 3]| {
                let wi = Vec3::from(w);
                f64::from(mean(bsdf.eval(wo, wi) - boundary(ior, coat_alpha, wo, wi)).max(0.0))
            };
            let ours = sphere_integral_about(pole(&bsdf, wo).to_array(), f, 1e-4) as f32;
            let deviation = ours / mean(walk) - 1.0;
            worst = worst.max(deviation.abs());
            line += &format!("  {cos}: {:+.1} % of {:.3}", 100.0 * deviation, mean(walk));
        }
        println!("{line}");
        assert!(worst < limit, "{line}");
    }
}

/// Widths of metal and coat, and the allowed deviation of the albedo.
const LACQUERS: [(f32, f32, f32); 10] = [
    (0.1, 0.0, 0.07),
    (0.3, 0.0, 0.07),
    (0.6, 0.0, 0.03),
    (1.0, 0.0, 0.03),
    (0.0, 0.1, 0.17),
    (0.0, 0.4, 0.25),
    (0.1, 0.1, 0.1),
    (0.3, 0.2, 0.1),
    (0.2, 0.4, 0.15),
    (0.6, 0.6, 0.3),
];
