//! Nasty scenes: whatever happens, the film holds numbers, and nearly no sample is refused.

use crate::common::*;
use glam::{DAffine3, DVec3};
use scene::model::*;

const INTEGRATORS: [Integrator; 7] = [
    Integrator::Path { max_depth: 32 },
    Integrator::Direct { max_depth: 8 },
    Integrator::Whitted { max_depth: 8 },
    Integrator::Normals,
    Integrator::Albedo,
    Integrator::Depth,
    Integrator::Uv,
];

/// Renders with everything; each sample must be accepted, so that nothing was NaN, infinite or huge.
#[track_caller]
fn survives(what: &str, desc: &SceneDesc) {
    for integrator in INTEGRATORS {
        let mut desc = desc.clone();
        desc.integrator = integrator;
        let picture = render(&desc, 8);
        assert_eq!(
            picture.rejected, 0,
            "{what}: refused samples by {integrator:?}"
        );
        let fine = |p: &[f64; 3]| p.iter().all(|c| c.is_finite() && *c >= 0.0);
        assert!(picture.rgb.iter().all(fine), "{what}: {integrator:?}");
    }
}

fn materials() -> Vec<BsdfDesc> {
    let rough = |u: f32, v: f32| Roughness {
        u: FloatTex::Const(u),
        v: FloatTex::Const(v),
        scale: RoughnessScale::Alpha,
    };
    let gold = ConductorFresnel::EtaK {
        eta: ColorTex::Const([0.16, 0.42, 1.35]),
        k: ColorTex::Const([3.9, 2.5, 1.9]),
    };
    let coat = Coat {
        ior: 1.5,
        roughness: rough(0.1, 0.1),
        thickness: 0.01,
        albedo: [0.3; 3],
        g: 0.3,
        max_depth: 10,
        samples: 1,
    };
    let dielectric = |ior, roughness| BsdfDesc::Dielectric {
        ior,
        roughness,
        reflect_tint: grey(1.0),
        transmit_tint: grey(1.0),
    };
    vec![
        diffuse(0.7),
        diffuse(0.0),
        BsdfDesc::OrenNayar {
            reflectance: grey(0.6),
            sigma: FloatTex::Const(40.0),
        },
        BsdfDesc::Phong {
            diffuse: grey(0.2),
            specular: grey(0.6),
            exponent: FloatTex::Const(1e5),
        },
        BsdfDesc::Lafortune {
            diffuse: grey(0.1),
            lobes: vec![LafortuneLobe {
                albedo: [0.4; 3],
                c: [-1.0, -1.0, 1.0],
                exponent: 300.0,
            }],
        },
        BsdfDesc::Mirror {
            reflectance: grey(1.0),
        },
        glass(),
        dielectric(1.0, smooth()),
        dielectric(1.5, rough(1e-4, 1.0)),
        dielectric(0.6, rough(0.3, 0.3)),
        BsdfDesc::ThinDielectric { ior: 1.5 },
        BsdfDesc::Conductor {
            fresnel: gold,
            roughness: rough(1.0, 1e-3),
        },
        BsdfDesc::CoatedDiffuse {
            reflectance: grey(0.8),
            coat,
        },
        BsdfDesc::CoatedConductor {
            fresnel: gold,
            roughness: rough(0.2, 0.2),
            coat,
        },
        BsdfDesc::DiffuseTransmission {
            reflectance: grey(0.5),
            transmittance: grey(0.5),
        },
        BsdfDesc::Interface,
    ]
}

/// Something to be lit by and to stand on, `scale` across.
fn stage(scale: f64) -> SceneDesc {
    let mut desc = blank(16, 16);
    desc.camera.projection = perspective(70.0, None);
    desc.camera.transform =
        Motion::fixed(look([0.0, scale, 3.0 * scale], [0.0; 3], [0.0, 1.0, 0.0]));
    desc.place(
        Shape::Rectangle,
        horizontal([0.0, -scale, 0.0], 4.0 * scale, 4.0 * scale),
        diffuse(0.5),
    );
    desc.place(
        Shape::Rectangle,
        horizontal([0.0, 3.0 * scale, 0.0], -scale, scale),
        diffuse(0.5),
    )
    .emission = shining(5.0);
    desc.lights.push(sky(0.3));
    desc
}

#[test]
fn every_material_from_outside_and_inside() {
    for bsdf in materials() {
        let mut desc = stage(1.0);
        desc.place(
            Shape::Sphere { radius: 1.0 },
            DAffine3::IDENTITY,
            bsdf.clone(),
        );
        survives(&format!("{bsdf:?}"), &desc);
        desc.camera.transform =
            Motion::fixed(look([0.5, 0.0, 0.0], [0.0, 0.3, -1.0], [0.0, 1.0, 0.0]));
        survives(&format!("inside {bsdf:?}"), &desc);
        // On the surface itself, and exactly at its centre.
        for from in [[0.0, 0.0, 1.0], [0.0, 0.0, 0.0]] {
            desc.camera.transform = Motion::fixed(look(from, [0.0, 0.0, -2.0], [0.0, 1.0, 0.0]));
            survives(&format!("at {from:?} in {bsdf:?}"), &desc);
        }
    }
}

#[test]
fn nothing_at_all() {
    survives("empty", &blank(4, 4));
    let mut dark = stage(1.0);
    dark.lights.clear();
    dark.primitives.pop();
    dark.place(Shape::Sphere { radius: 1.0 }, DAffine3::IDENTITY, glass());
    survives("no lights", &dark);
    let mut one = blank(1, 1);
    one.lights.push(sky(0.0));
    survives("a black sky", &one);
}

#[test]
fn degenerate_lights() {
    let mut desc = stage(1.0);
    desc.lights.push(Light::Point {
        transform: at(0.0, -1.0, 0.0), // in the floor
        intensity: [1.0; 3],
    });
    desc.lights.push(Light::Spot {
        transform: DAffine3::IDENTITY,
        intensity: [1.0; 3],
        cone_angle: 30.0,
        full_angle: 30.0,
        falloff: SpotFalloff::SmoothStep,
    });
    desc.lights.push(Light::Distant {
        direction: DVec3::NEG_Y,
        irradiance: [0.0; 3],
    });
    desc.place(
        Shape::Rectangle,
        spanned([0.0; 3], [1e-6, 0.0, 0.0], [0.0, 1.0, 0.0]),
        diffuse(0.5),
    )
    .emission = shining(5.0);
    desc.place(
        Shape::Sphere { radius: 1e-6 },
        at(0.3, 0.0, 0.0),
        diffuse(0.5),
    )
    .emission = shining(1e6);
    desc.place(
        Shape::Sphere { radius: 0.5 },
        at(-0.6, 0.0, 0.0),
        diffuse(0.5),
    )
    .emission = shining(0.0);
    // A light in the floor's plane.
    desc.place(
        Shape::Rectangle,
        horizontal([2.0, -1.0, 0.0], 0.5, 0.5),
        diffuse(0.5),
    )
    .emission = shining(5.0);
    // A triangle without area among others.
    let soup = [
        [0.0f32, 1.0, 0.0],
        [1.0, 1.0, 0.0],
        [2.0, 1.0, 0.0],
        [0.0, 1.0, 1.0],
    ];
    let shape = desc.mesh(triangles(&soup, &[[0, 1, 2], [0, 1, 3], [1, 1, 1]]));
    desc.place(shape, DAffine3::IDENTITY, diffuse(0.5)).emission = shining(5.0);
    survives("degenerate lights", &desc);
}

#[test]
fn tiny_and_huge() {
    for scale in [1e-4, 1e-2, 1e3, 1e6] {
        let mut desc = stage(scale);
        desc.place(Shape::Sphere { radius: scale }, DAffine3::IDENTITY, glass());
        let (x, y) = (-1.5 * scale, 0.5 * scale);
        desc.place(
            Shape::Sphere {
                radius: 0.5 * scale,
            },
            at(x, y, 0.0),
            diffuse(0.5),
        );
        survives(&format!("scale {scale}"), &desc);
    }
    // Far from the origin.
    let mut desc = stage(1.0);
    let far = DVec3::new(1e6, -1e6, 1e6);
    for primitive in &mut desc.primitives {
        primitive.transform.keys[0].transform.translation += far;
    }
    desc.camera.transform.keys[0].transform.translation += far;
    survives("far away", &desc);
}

/// The same scene in other units is the same picture: no length is built in.
#[test]
fn no_length_is_built_in() {
    let picture = |scale: f64| {
        let mut desc = stage(scale);
        desc.place(
            Shape::Sphere { radius: scale },
            DAffine3::IDENTITY,
            diffuse(0.7),
        );
        desc.place(
            Shape::Sphere {
                radius: 0.5 * scale,
            },
            at(1.4 * scale, 0.0, 0.0),
            glass(),
        );
        render(&desc, 256).moments().mean()
    };
    let one = picture(1.0);
    for scale in [1e-4, 1e-2, 1e3, 1e6] {
        let other = picture(scale);
        assert!(
            (other - one).abs() < 0.01 * one,
            "scale {scale}: {other}, at scale 1: {one}"
        );
    }
}
