//! Irradiance from lights with extent on a diffuse plane, in closed form: polygons by Lambert's
//! formula, disks and spheres by their form factors.

use crate::common::*;
use glam::{DAffine3, DMat3, DVec3};
use scene::model::*;
use std::f64::consts::PI;

const COLUMNS: u32 = 12;
const ROWS: u32 = 48;
const SPP: u32 = 64;
const X: (f64, f64) = (-2.0, 2.0);
const RHO: f64 = 0.6;
const LE: f64 = 2.0;

/// E = L/2 sum of the angles between neighbouring corners times the cosine between the normal and the
/// plane through them and the point [Lambert1760]. The polygon lies above the point's horizon.
pub fn lambert(corners: &[DVec3], point: DVec3, normal: DVec3) -> f64 {
    let count = corners.len();
    let sum: f64 = (0..count)
        .map(|i| {
            let a = (corners[i] - point).normalize();
            let b = (corners[(i + 1) % count] - point).normalize();
            a.dot(b).clamp(-1.0, 1.0).acos() * a.cross(b).normalize().dot(normal)
        })
        .sum();
    0.5 * LE * sum.abs()
}

/// Lights the plane y = 0 with one shape and compares it along a line.
fn compare(
    what: &str,
    integrator: Integrator,
    build: impl Fn(&mut SceneDesc),
    irradiance: impl Fn(DVec3) -> f64,
) {
    let mut desc = blank(COLUMNS, ROWS);
    as_points_below(&mut desc, X, 0.0);
    desc.integrator = integrator;
    desc.place(
        Shape::Rectangle,
        horizontal([0.0; 3], 10.0, 10.0),
        diffuse(RHO as f32),
    );
    build(&mut desc);
    desc.primitives.last_mut().unwrap().emission = shining(LE as f32);
    let picture = render(&desc, SPP);
    for i in 0..COLUMNS {
        let x = column(i, COLUMNS, X);
        let want = RHO / PI * irradiance(DVec3::new(x, 0.0, 0.0));
        check(
            &format!("{what} at x = {x:.3} by {integrator:?}"),
            &picture.column(i),
            want,
        );
    }
}

fn by_both(what: &str, build: impl Fn(&mut SceneDesc), irradiance: impl Fn(DVec3) -> f64) {
    // One event: what the light itself reflects back is left out.
    for integrator in [
        Integrator::Path { max_depth: 1 },
        Integrator::Direct { max_depth: 2 },
    ] {
        compare(what, integrator, &build, &irradiance);
    }
}

#[test]
fn triangle() {
    let corners = [[-0.7f32, 0.6, -0.5], [0.9, 1.1, -0.3], [0.1, 0.8, 0.8]];
    by_both(
        "triangle",
        |desc| {
            let shape = desc.mesh(triangles(&corners, &[[0, 1, 2]]));
            desc.place(shape, DAffine3::IDENTITY, diffuse(0.0));
        },
        |p| lambert(&corners.map(|c| DVec3::from(c.map(f64::from))), p, DVec3::Y),
    );
}

#[test]
fn rectangle() {
    let (center, a, b) = ([0.3, 0.9, 0.2], [0.6, 0.2, 0.0], [0.0, 0.1, 0.5]);
    let corner = |i: f64, j: f64| DVec3::from(center) + i * DVec3::from(a) + j * DVec3::from(b);
    let corners = [
        corner(-1.0, -1.0),
        corner(1.0, -1.0),
        corner(1.0, 1.0),
        corner(-1.0, 1.0),
    ];
    by_both(
        "rectangle",
        |desc| {
            desc.place(Shape::Rectangle, spanned(center, a, b), diffuse(0.0));
        },
        |p| lambert(&corners, p, DVec3::Y),
    );
}

/// The same rectangle as a mesh inside an instance that stands still: it can be met by scattered rays
/// alone or be sampled, the answer is the same.
#[test]
fn rectangle_in_an_instance() {
    let corners = [
        [-0.5f32, 0.7, -0.5],
        [0.5, 0.7, -0.5],
        [0.5, 0.7, 0.5],
        [-0.5, 0.7, 0.5],
    ];
    let mut desc = blank(COLUMNS, ROWS);
    as_points_below(&mut desc, (-1.0, 1.0), 0.0);
    desc.integrator = Integrator::Path { max_depth: 1 };
    desc.place(
        Shape::Rectangle,
        horizontal([0.0; 3], 10.0, 10.0),
        diffuse(RHO as f32),
    );
    let shape = desc.mesh(triangles(&corners, &[[0, 1, 2], [0, 2, 3]]));
    desc.place(shape, DAffine3::IDENTITY, diffuse(0.0)).emission = shining(LE as f32);
    let primitive = desc.primitives.pop().unwrap();
    desc.groups.push(Group {
        name: String::new(),
        primitives: vec![primitive],
        instances: vec![],
    });
    desc.instances.push(Instance {
        group: GroupId(0),
        transform: Motion::fixed(at(0.2, 0.1, 0.0)),
    });
    let moved = corners.map(|c| DVec3::from(c.map(f64::from)) + DVec3::new(0.2, 0.1, 0.0));
    let picture = render(&desc, 256);
    for i in 0..COLUMNS {
        let p = DVec3::new(column(i, COLUMNS, (-1.0, 1.0)), 0.0, 0.0);
        let want = RHO / PI * lambert(&moved, p, DVec3::Y);
        check(&format!("at {p}"), &picture.column(i), want);
    }
}

/// A disk of radius R parallel to the plane, at height h and distance a aside:
/// E = pi L / 2 (1 - (a^2 + h^2 - R^2) / sqrt((a^2 + h^2 + R^2)^2 - 4 a^2 R^2)).
fn disk_irradiance(a: f64, h: f64, r: f64) -> f64 {
    let (a2, h2, r2) = (a * a, h * h, r * r);
    let root = ((a2 + h2 + r2) * (a2 + h2 + r2) - 4.0 * a2 * r2).sqrt();
    0.5 * PI * LE * (1.0 - (a2 + h2 - r2) / root)
}

/// Normal +Z turned to face down, scaled to twice its size.
fn downwards(height: f64) -> DAffine3 {
    let turned = DMat3::from_rotation_x(PI / 2.0) * DMat3::from_diagonal(DVec3::splat(2.0));
    DAffine3::from_mat3_translation(turned, DVec3::new(0.0, height, 0.0))
}

#[test]
fn disk() {
    let shape = |inner_radius| Shape::Disk {
        radius: 0.4,
        inner_radius,
        height: 0.0,
    };
    by_both(
        "disk",
        |desc| {
            desc.place(shape(0.0), downwards(0.5), diffuse(0.0));
        },
        |p| disk_irradiance(p.x, 0.5, 0.8),
    );
    by_both(
        "ring",
        |desc| {
            desc.place(shape(0.25), downwards(0.5), diffuse(0.0));
        },
        |p| disk_irradiance(p.x, 0.5, 0.8) - disk_irradiance(p.x, 0.5, 0.5),
    );
}

/// Seen whole above the horizon a sphere gives pi L (r/d)^2 cos, wherever it stands.
#[test]
fn sphere() {
    let center = DVec3::new(0.4, 1.2, 0.3);
    for radius in [1.0, 0.3, 0.01] {
        by_both(
            &format!("sphere of radius {radius}"),
            |desc| {
                desc.place(
                    Shape::Sphere { radius },
                    DAffine3::from_translation(center),
                    diffuse(0.0),
                );
            },
            |p| {
                let d = center - p;
                PI * LE * radius * radius / d.length_squared() * d.normalize().y
            },
        );
    }
}

/// The basic ray tracer puts all of an area light into its centre: E = L A cos cos / d^2.
#[test]
fn whitted_sees_a_point() {
    compare(
        "rectangle",
        Integrator::Whitted { max_depth: 1 },
        |desc| {
            // Facing down.
            desc.place(
                Shape::Rectangle,
                horizontal([0.0, 0.8, 0.0], -0.5, 0.5),
                diffuse(0.0),
            );
        },
        |p| {
            let d2 = p.x * p.x + 0.64;
            LE * 1.0 * 0.64 / (d2 * d2)
        },
    );
}
