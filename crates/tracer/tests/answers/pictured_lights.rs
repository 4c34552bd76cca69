//! Lights that take pictures, and portals, on a diffuse plane: closed forms.

use crate::common::*;
use glam::{DAffine3, DVec3};
use scene::assets::MemorySource;
use scene::model::*;
use std::f64::consts::PI;

const COLUMNS: u32 = 16;
const X: (f64, f64) = (-1.0, 1.0);
const RHO: f64 = 0.6;

fn pfm(width: usize, height: usize, rgb: impl Fn(usize, usize) -> [f32; 3]) -> Vec<u8> {
    let mut bytes = format!("PF {width} {height} -1\n").into_bytes();
    for y in (0..height).rev() {
        for x in 0..width {
            for c in rgb(x, y) {
                bytes.extend(c.to_le_bytes());
            }
        }
    }
    bytes
}

/// A plane y = 0 seen point by point, lit by one light with a picture.
fn plane(light: Light, picture: Vec<u8>, rows: u32) -> (SceneDesc, MemorySource) {
    let mut desc = blank(COLUMNS, rows);
    as_points_below(&mut desc, X, 0.0);
    desc.images.push(ImageDesc {
        bytes: None,
        path: "a.pfm".into(),
        encoding: Encoding::Auto,
        missing: false,
    });
    desc.place(
        Shape::Rectangle,
        horizontal([0.0; 3], 10.0, 10.0),
        diffuse(RHO as f32),
    );
    desc.lights.push(light);
    (desc, MemorySource::new().with("a.pfm", picture).unwrap())
}

/// Light space with +Z down and +X along +X of the world: +Y of the light is -Z of the world.
fn downwards(height: f64) -> DAffine3 {
    DAffine3::from_translation(DVec3::new(0.0, height, 0.0)) * DAffine3::from_rotation_x(PI / 2.0)
}

fn exact(what: &str, light: Light, picture: Vec<u8>, irradiance: impl Fn(f64) -> f64) {
    let (mut desc, assets) = plane(light, picture, 4);
    for integrator in [
        Integrator::Whitted { max_depth: 2 },
        Integrator::Direct { max_depth: 2 },
        Integrator::Path { max_depth: 4 },
    ] {
        desc.integrator = integrator;
        let picture = Picture::of(&compile(&desc, &assets, 7, 1), 2);
        for i in 0..COLUMNS {
            let x = column(i, COLUMNS, X);
            let (got, want) = (picture.column(i).mean(), RHO / PI * irradiance(x));
            assert!(
                (got - want).abs() <= 2e-4 * want + 1e-6,
                "{what} at x = {x} by {integrator:?}: {got}, expected {want}"
            );
        }
    }
}

#[test]
fn projections_throw_their_pixels() {
    // Four columns, of which the first is seen on the left (-X) and the last is dark.
    let values = [1.0f32, 3.0, 2.0, 0.0];
    let light = |power| Light::Projection {
        transform: downwards(1.0),
        intensity: [5.0; 3],
        image: ImageId(0),
        fov: 90.0,
        power,
    };
    // Twice as wide as high: at distance 1 it spans [-2, 2] x [-1, 1].
    let picture = || pfm(4, 2, |x, _| [values[x]; 3]);
    let falloff = |x: f64| 1.0 / ((1.0 + x * x) * (1.0 + x * x).sqrt());
    let at = |x: f64| f64::from(values[((x + 2.0) as usize).min(3)]);
    exact("projection", light(None), picture(), |x| {
        5.0 * at(x) * falloff(x)
    });

    // Power: the solid angle of the column from x = a to b, with |y| < 1, is the difference of two of these.
    let arc = |x: f64| (x / (x * x + 2.0).sqrt()).atan() * 2.0;
    let sum: f64 = (0..4)
        .map(|i| {
            let x = f64::from(i) - 2.0;
            f64::from(values[i as usize]) * (arc(x + 1.0) - arc(x))
        })
        .sum();
    // The importer's sum takes each pixel's middle: exact for many pixels.
    let fine = || pfm(400, 200, |x, _| [values[x / 100]; 3]);
    exact("projection with power", light(Some(7.0)), fine(), |x| {
        5.0 * 7.0 / sum * at(x) * falloff(x)
    });
}

#[test]
fn nothing_is_thrown_beside_the_picture() {
    // 40 degrees over the shorter side, square, from height 1: |x| < tan 20.
    let light = Light::Projection {
        transform: downwards(1.0),
        intensity: [1.0; 3],
        image: ImageId(0),
        fov: 40.0,
        power: None,
    };
    let edge = 20f64.to_radians().tan();
    exact("edge", light, pfm(1, 1, |_, _| [1.0; 3]), |x| {
        if x.abs() < edge {
            1.0 / ((1.0 + x * x) * (1.0 + x * x).sqrt())
        } else {
            0.0
        }
    });
}

#[test]
fn goniometric_lights_shine_by_direction() {
    // Bright where the light's own x is positive: the right half of the octahedral picture.
    let picture = || pfm(64, 64, |x, _| [if x >= 32 { 3.0 } else { 1.0 }; 3]);
    let light = |power| Light::Goniometric {
        transform: downwards(1.0),
        intensity: [5.0; 3],
        image: ImageId(0),
        power,
    };
    let irradiance = |x: f64| {
        let d2 = x * x + 1.0;
        (if x > 0.0 { 3.0 } else { 1.0 }) / (d2 * d2.sqrt())
    };
    exact("goniometric", light(None), picture(), |x| {
        5.0 * irradiance(x)
    });
    // Mean 2 over the sphere.
    exact("goniometric with power", light(Some(9.0)), picture(), |x| {
        5.0 * 9.0 / (8.0 * PI) * irradiance(x)
    });
}

fn environment(
    image: Option<(ImageId, SphereMapping)>,
    illuminance: Option<f32>,
    portal: Option<[DVec3; 4]>,
) -> Light {
    Light::Environment {
        // +Z of the light is up.
        transform: DAffine3::from_rotation_x(-PI / 2.0),
        radiance: [2.0; 3],
        image,
        hidden: false,
        illuminance,
        portal,
    }
}

/// A white picture gives twice what it is asked for, as in pbrt; `radiance` is a factor on it.
#[test]
fn illuminance_sets_the_level() {
    for mapping in [SphereMapping::OctahedralEqualArea, SphereMapping::LatLong] {
        let light = environment(Some((ImageId(0), mapping)), Some(3.0), None);
        let (desc, assets) = plane(light, pfm(64, 64, |_, _| [0.3; 3]), 64);
        let picture = Picture::of(&compile(&desc, &assets, 7, 1), 64);
        let got = picture.moments().mean();
        let want = RHO / PI * 2.0 * 2.0 * 3.0;
        assert!(
            (got - want).abs() < 0.01 * want,
            "{mapping:?}: {got}, {want}"
        );
    }
}

/// Form factor of a rectangle parallel to the plane, by its four corners [Lambert1760].
fn rectangle(x: f64, z: (f64, f64), xs: (f64, f64), height: f64) -> f64 {
    let quarter = |a: f64, b: f64| {
        let (a, b) = (a / height, b / height);
        let (ra, rb) = ((1.0 + a * a).sqrt(), (1.0 + b * b).sqrt());
        (a / ra * (b / ra).atan() + b / rb * (a / rb).atan()) / (2.0 * PI)
    };
    let (x0, x1) = (xs.0 - x, xs.1 - x);
    quarter(x1, z.1) - quarter(x0, z.1) - quarter(x1, z.0) + quarter(x0, z.0)
}

/// The sky through a window in the ceiling, without the ceiling: only the portal says where it is.
#[test]
fn portals_let_in_what_is_seen_through_them() {
    let (xs, zs, height) = ((-0.5, 0.8), (-0.4, 0.3), 1.0);
    let corner = |x, z| DVec3::new(x, height, z);
    // (p3 - p0) x (p1 - p0) points up, to the sky.
    let portal = [
        corner(xs.0, zs.0),
        corner(xs.1, zs.0),
        corner(xs.1, zs.1),
        corner(xs.0, zs.1),
    ];
    let up = (portal[3] - portal[0]).cross(portal[1] - portal[0]);
    assert!(up.y > 0.0, "{up}");
    let pictures = [
        (None, "constant"),
        (
            Some((ImageId(0), SphereMapping::OctahedralEqualArea)),
            "picture",
        ),
    ];
    for (image, what) in pictures {
        let (mut desc, assets) = plane(
            environment(image, None, Some(portal)),
            pfm(32, 32, |_, _| [1.0; 3]),
            64,
        );
        desc.integrator = Integrator::Path { max_depth: 3 };
        let picture = Picture::of(&compile(&desc, &assets, 7, 1), 256);
        for i in 0..COLUMNS {
            let x = column(i, COLUMNS, X);
            let want = RHO * 2.0 * rectangle(x, zs, xs, height);
            check(&format!("{what} at x = {x}"), &picture.column(i), want);
        }
    }
}

/// A sky that is bright in one place only: what comes through the window is the same whether it is
/// found by the portal or by chance.
#[test]
fn portals_agree_with_a_hole_in_the_roof() {
    let (xs, zs, height) = ((-0.5, 0.8), (-0.4, 0.3), 1.0);
    let sky = || {
        pfm(32, 32, |x, y| {
            let bright = (12..18).contains(&x) && (14..20).contains(&y);
            [if bright { 20.0 } else { 0.5 }; 3]
        })
    };
    let image = Some((ImageId(0), SphereMapping::OctahedralEqualArea));
    let corner = |x, z| DVec3::new(x, height, z);
    let portal = [
        corner(xs.0, zs.0),
        corner(xs.1, zs.0),
        corner(xs.1, zs.1),
        corner(xs.0, zs.1),
    ];
    let (desc, assets) = plane(environment(image, None, Some(portal)), sky(), 64);
    let through_portal = Picture::of(&compile(&desc, &assets, 7, 1), 64);
    // The same with a black roof around the hole instead.
    let (mut desc, assets) = plane(environment(image, None, None), sky(), 64);
    let far = 1000.0;
    for (a, b, c, d) in [
        (-far, xs.0, -far, far),
        (xs.1, far, -far, far),
        (xs.0, xs.1, -far, zs.0),
        (xs.0, xs.1, zs.1, far),
    ] {
        let center = [(a + b) / 2.0, height, (c + d) / 2.0];
        desc.place(
            Shape::Rectangle,
            horizontal(center, (b - a) / 2.0, (d - c) / 2.0),
            diffuse(0.0),
        );
    }
    let through_hole = Picture::of(&compile(&desc, &assets, 8, 1), 1024);
    for i in 0..COLUMNS {
        let (a, b) = (through_portal.column(i), through_hole.column(i));
        let (difference, error) = (
            (a.mean() - b.mean()).abs(),
            (a.error() * a.error() + b.error() * b.error()).sqrt(),
        );
        assert!(
            difference < 5.0 * error + 1e-3 * b.mean(),
            "column {i}: {} +- {}, {} +- {}",
            a.mean(),
            a.error(),
            b.mean(),
            b.error()
        );
        assert!(error < 0.05 * b.mean(), "column {i}: nothing is said");
    }
}

/// Shapes of which one half shines, by texture coordinates: the halves are mirror images of each other
/// and add up to the whole, which has a closed form.
#[test]
fn halves_of_textured_shapes_add_up() {
    let (height, radius) = (1.5, 0.6);
    // Local y is +X of the world; the disk faces down.
    let turn = |down: bool| {
        let (y, z) = (DVec3::X, if down { DVec3::NEG_Y } else { DVec3::Y });
        DAffine3::from_mat3_translation(
            glam::DMat3::from_cols(y.cross(z), y, z),
            DVec3::new(0.0, height, 0.0),
        )
    };
    let disk = Shape::Disk {
        radius,
        inner_radius: 0.0,
        height: 0.0,
    };
    // Form factor of a parallel disk, seen from x off its axis.
    let of_disk = |x: f64| {
        let (h, r, a) = (height * height, radius * radius, x * x);
        0.5 * (1.0 - (h + a - r) / ((h + a + r) * (h + a + r) - 4.0 * a * r).sqrt())
    };
    let of_sphere = |x: f64| {
        let d2 = height * height + x * x;
        radius * radius / d2 * height / d2.sqrt()
    };
    type Case<'a> = (Shape, DAffine3, &'a dyn Fn(f64) -> f64);
    let cases: [Case; 2] = [
        (disk, turn(true), &of_disk),
        (Shape::Sphere { radius }, turn(false), &of_sphere),
    ];
    for (shape, transform, factor) in cases {
        let half = |bright_first: bool| {
            let mut desc = blank(COLUMNS, 64);
            as_points_below(&mut desc, X, 0.0);
            desc.integrator = Integrator::Path { max_depth: 1 };
            let white = ColorTex::Const([1.0; 3]);
            let black = ColorTex::Const([0.0; 3]);
            let (even, odd) = if bright_first {
                (white, black)
            } else {
                (black, white)
            };
            desc.textures.push(Texture::Checkerboard {
                map: UvMap::Uv {
                    set: 0,
                    matrix: [2.0, 0.0, 0.0, 0.0, 0.0, 0.5],
                },
                even,
                odd,
            });
            desc.place(
                Shape::Rectangle,
                horizontal([0.0; 3], 10.0, 10.0),
                diffuse(RHO as f32),
            );
            desc.place(shape.clone(), transform, diffuse(0.0)).emission = Some(Emission {
                radiance: ColorTex::Texture(TextureId(0)),
                scale: 4.0,
                two_sided: false,
            });
            render(&desc, 256)
        };
        let (first, second) = (half(true), half(false));
        for i in 0..COLUMNS {
            let x = column(i, COLUMNS, X);
            let want = RHO * 4.0 * factor(x);
            let (a, b) = (first.column(i), second.column(i));
            let error = (a.error() * a.error() + b.error() * b.error()).sqrt();
            let sum = a.mean() + b.mean();
            assert!(
                (sum - want).abs() < 5.0 * error + 1e-4 * want && error < 0.01 * want,
                "{shape:?} at x = {x}: {sum} +- {error}, expected {want}"
            );
            let mirrored = second.column(COLUMNS - 1 - i);
            let difference = (a.mean() - mirrored.mean()).abs();
            let error = (a.error() * a.error() + mirrored.error() * mirrored.error()).sqrt();
            assert!(
                difference < 5.0 * error + 1e-4 * want,
                "{shape:?} at x = {x}: {} and {}",
                a.mean(),
                mirrored.mean()
            );
            // The bright half is on one side.
            assert!(x.abs() < 0.3 || (a.mean() > b.mean()) == (x > 0.0));
        }
    }
}
