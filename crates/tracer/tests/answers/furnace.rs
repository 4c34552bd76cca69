//! Uniform light: inside a shining unit sphere, and under a white sky.

use crate::common::*;
use glam::{DAffine3, DQuat, DVec3};
use scene::model::*;

const LE: f64 = 0.587;
const RHO: f64 = 0.5;
const SAMPLERS: [SamplerKind; 3] = [
    SamplerKind::OwenSobol,
    SamplerKind::Stratified,
    SamplerKind::Independent,
];

/// A camera inside a unit sphere that shines inwards and reflects.
fn inside(
    integrator: Integrator,
    sampler: SamplerKind,
    projection: &Projection,
    rho: f64,
) -> SceneDesc {
    let mut desc = blank(12, 12);
    desc.integrator = integrator;
    desc.sampler = sampler;
    desc.camera.projection = projection.clone();
    desc.camera.transform =
        Motion::fixed(look([0.2, 0.1, -0.3], [-0.3, 0.4, 0.9], [0.0, 1.0, 0.0]));
    let sphere = desc.place(
        Shape::Sphere { radius: 1.0 },
        DAffine3::IDENTITY,
        diffuse(rho as f32),
    );
    sphere.reverse_orientation = true;
    sphere.emission = shining(LE as f32);
    desc
}

/// Every point of the sphere sees Le on every side, so the light that arrives is the light that leaves:
/// L = Le + rho L. Cut after D events it is Le (1 + rho + ... + rho^D).
#[test]
fn lit_from_inside() {
    let spherical = |mapping| Projection::Spherical { mapping };
    let cameras = [
        ("perspective", perspective(60.0, None)),
        ("orthographic", orthographic((-0.3, 0.3), (-0.3, 0.3))),
        ("lat-long", spherical(SphereMapping::LatLong)),
        ("octahedral", spherical(SphereMapping::OctahedralEqualArea)),
    ];
    let sum = |n: i32| LE * (1.0 - RHO.powi(n + 1)) / (1.0 - RHO);
    let path = |max_depth| Integrator::Path { max_depth };
    let integrators = [
        (path(0), LE, 4),
        (path(1), sum(1), 64),
        (path(3), sum(3), 64),
        (path(64), LE / (1.0 - RHO), 128),
        (Integrator::Direct { max_depth: 8 }, sum(1), 64),
        // A spherical light is a point that shines outwards; this one does not.
        (Integrator::Whitted { max_depth: 8 }, LE, 1),
    ];
    for (integrator, expected, spp) in integrators {
        for sampler in SAMPLERS {
            for (name, camera) in &cameras {
                let picture = render(&inside(integrator, sampler, camera, RHO), spp);
                let what = format!("{integrator:?}, {sampler:?}, {name}");
                check(&what, &picture.moments(), expected);
                assert_eq!(picture.rejected, 0, "{what}");
            }
        }
    }
}

/// Russian roulette changes no mean: paths of low albedo end by chance almost always.
#[test]
fn roulette_is_unbiased() {
    for rho in [0.05, 0.2, 0.8, 0.95] {
        let mut desc = inside(
            Integrator::Path { max_depth: 1000 },
            SamplerKind::Independent,
            &perspective(60.0, None),
            rho,
        );
        (desc.film.width, desc.film.height) = (48, 48);
        check(
            &format!("albedo {rho}"),
            &render(&desc, 64).moments(),
            LE / (1.0 - rho),
        );
    }
}

/// Under a white sky what absorbs nothing cannot be seen.
#[test]
fn white_things_vanish_under_a_white_sky() {
    let materials = [
        ("diffuse", diffuse(1.0)),
        (
            "mirror",
            BsdfDesc::Mirror {
                reflectance: grey(1.0),
            },
        ),
        ("glass", glass()),
        ("pane", BsdfDesc::ThinDielectric { ior: 1.5 }),
        ("interface", BsdfDesc::Interface),
        (
            "diffuse on both sides",
            BsdfDesc::DiffuseTransmission {
                reflectance: grey(0.6),
                transmittance: grey(0.4),
            },
        ),
    ];
    for sampler in SAMPLERS {
        let mut all = blank(24, 24);
        all.sampler = sampler;
        all.integrator = Integrator::Path { max_depth: 400 };
        all.lights.push(sky(1.0));
        for (i, (name, bsdf)) in materials.iter().enumerate() {
            let mut desc = all.clone();
            desc.primitives.clear();
            desc.place(
                Shape::Sphere { radius: 0.8 },
                at(0.0, 0.0, -2.0),
                bsdf.clone(),
            );
            check(
                &format!("{name}, {sampler:?}"),
                &render(&desc, 32).moments(),
                1.0,
            );
            let (x, y) = ((i % 3) as f64 * 0.66 - 0.66, (i / 3) as f64 * 0.7 - 0.35);
            all.place(Shape::Sphere { radius: 0.33 }, at(x, y, -2.0), bsdf.clone());
        }
        check(
            &format!("all, {sampler:?}"),
            &render(&all, 64).moments(),
            1.0,
        );
    }
}

/// A tube of few flat faces with interpolated normals, closed by cones; from the side and from the end.
fn smooth_tube(length: f32) -> Mesh {
    const AROUND: u32 = 7;
    let rings = [
        (0.0, -length),
        (0.5, -0.6 * length),
        (0.5, 0.6 * length),
        (0.0, length),
    ];
    let (mut positions, mut normals, mut indices) = (vec![], vec![], vec![]);
    for (r, y) in rings {
        for i in 0..AROUND {
            let (s, c) = (i as f32 / AROUND as f32 * std::f32::consts::TAU).sin_cos();
            positions.push([r * c, y, r * s]);
            let n = glam::Vec3::new(c, 2.0 * y / length, s).normalize();
            normals.push(if r == 0.0 {
                [0.0, y.signum(), 0.0]
            } else {
                n.to_array()
            });
        }
    }
    for ring in 0..3 {
        for i in 0..AROUND {
            let (a, b) = (ring * AROUND + i, ring * AROUND + (i + 1) % AROUND);
            indices.extend([[a, a + AROUND, b], [b, a + AROUND, b + AROUND]]);
        }
    }
    let mut mesh = triangles(&positions, &indices);
    mesh.normals = std::sync::Arc::new(normals);
    mesh
}

/// Where interpolated normals disagree with the faces, glass neither gains nor loses: what is mirrored
/// stays inside, and what is bent out leaves.
#[test]
fn smooth_glass_of_flat_faces_vanishes_too() {
    for length in [0.6, 3.0] {
        for axis in [DVec3::Y, DVec3::new(0.3, 0.4, 1.0).normalize()] {
            let mut desc = blank(48, 48);
            desc.integrator = Integrator::Path { max_depth: 2000 };
            desc.lights.push(sky(1.0));
            let shape = desc.mesh(smooth_tube(length));
            let turn = DAffine3::from_quat(DQuat::from_rotation_arc(DVec3::Y, axis));
            desc.place(shape, at(0.0, 0.0, -9.0) * turn, glass());
            let what = format!("length {length}, along {axis}");
            check(&what, &render(&desc, 16).moments(), 1.0);
        }
    }
}

/// A plane and a sphere that nothing shades reflect their albedo of a uniform sky.
#[test]
fn diffuse_things_show_their_albedo() {
    for (name, shape) in [
        ("plane", Shape::Rectangle),
        ("sphere", Shape::Sphere { radius: 3.0 }),
    ] {
        for integrator in [
            Integrator::Path { max_depth: 1 },
            Integrator::Direct { max_depth: 4 },
        ] {
            let mut desc = blank(16, 16);
            desc.integrator = integrator;
            desc.lights.push(sky(0.7));
            desc.place(
                shape.clone(),
                DAffine3::from_translation([0.0, 0.0, -4.0].into()),
                diffuse(0.3),
            );
            check(
                &format!("{name}, {integrator:?}"),
                &render(&desc, 64).moments(),
                0.21,
            );
        }
    }
}

/// What is no surface casts no shadow either: a white ball inside it stays invisible.
#[test]
fn interfaces_cast_no_shadow() {
    let mut desc = blank(24, 24);
    desc.lights.push(sky(1.0));
    desc.place(
        Shape::Sphere { radius: 0.5 },
        at(0.0, 0.0, -2.0),
        diffuse(1.0),
    );
    desc.place(
        Shape::Sphere { radius: 0.9 },
        at(0.0, 0.0, -2.0),
        BsdfDesc::Interface,
    );
    for integrator in [
        Integrator::Path { max_depth: 400 },
        Integrator::Direct { max_depth: 8 },
    ] {
        desc.integrator = integrator;
        check(
            &format!("{integrator:?}"),
            &render(&desc, 64).moments(),
            1.0,
        );
    }
}
