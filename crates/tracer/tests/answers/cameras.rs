//! Lenses: the blur of a point-like source, blades, the anamorphic squeeze; nothing is lost.

use crate::common::*;
use scene::model::*;
use std::f64::consts::PI;

/// Pixels on a side, and what they cover at distance 1.
const SIZE: u32 = 64;
const HALF_VIEW: f64 = 0.1;

struct Spot {
    /// Sum of the picture.
    total: f64,
    /// Standard deviations in the plane at distance 1.
    x: f64,
    y: f64,
    /// Farthest light from the axis, there.
    reach: f64,
}

/// A small shining disk on the axis at distance `z`, seen through a lens.
fn spot(lens: Option<Lens>, z: f64, radius: f64, spp: u32) -> Spot {
    let mut desc = blank(SIZE, SIZE);
    desc.camera.projection = perspective(2.0 * HALF_VIEW.atan().to_degrees(), lens);
    let disk = Shape::Disk {
        radius,
        inner_radius: 0.0,
        height: 0.0,
    };
    desc.place(disk, at(0.0, 0.0, -z), diffuse(0.0)).emission = shining(1.0);
    let picture = render(&desc, spp);
    let pixel = 2.0 * HALF_VIEW / f64::from(SIZE);
    let place = |i: u32| (f64::from(i) + 0.5) * pixel - HALF_VIEW;
    let (mut total, mut xx, mut yy, mut reach) = (0.0, 0.0, 0.0, 0.0f64);
    for j in 0..SIZE {
        for i in 0..SIZE {
            let l = picture.green(i, j);
            let (x, y) = (place(i), place(j));
            total += l;
            xx += l * x * x;
            yy += l * y * y;
            if l > 0.0 {
                reach = reach.max((x * x + y * y).sqrt());
            }
        }
    }
    // A pixel is a box, which adds its own variance.
    let own = pixel * pixel / 12.0;
    Spot {
        total,
        x: (xx / total - own).sqrt(),
        y: (yy / total - own).sqrt(),
        reach,
    }
}

fn lens(radius: f64, focus_distance: f64) -> Lens {
    Lens {
        radius,
        focus_distance,
        aperture: Aperture::Disk,
        anamorphic: 1.0,
    }
}

#[track_caller]
fn near(what: &str, got: f64, want: f64, tolerance: f64) {
    assert!(
        (got - want).abs() <= tolerance * want,
        "{what}: {got}, expected {want}"
    );
}

/// The circle of confusion in the plane in focus at f has the diameter 2 R |z - f| / z; seen from
/// distance 1 that is 1/f of it. A disk of diameter c has the standard deviation c / 4.
#[test]
fn circle_of_confusion() {
    for (r, focus, z) in [
        (0.2, 4.0, 8.0),
        (0.2, 4.0, 2.5),
        (0.1, 2.0, 20.0),
        (0.35, 8.0, 6.0),
    ] {
        let radius = 0.008 * z;
        let diameter = 2.0 * r * f64::abs(z - focus) / z / focus;
        let source = 2.0 * radius / z;
        let spot = spot(Some(lens(r, focus)), z, radius, 1024);
        let expected = (diameter * diameter + source * source).sqrt() / 4.0;
        let what = format!("R = {r}, f = {focus}, z = {z}");
        near(&format!("{what}, x"), spot.x, expected, 0.012);
        near(&format!("{what}, y"), spot.y, expected, 0.012);
        // Light ends where the two disks together do, give or take a pixel's diagonal.
        let reach = 0.5 * (diameter + source);
        assert!(
            (spot.reach - reach).abs() <= 0.003,
            "{what}: reach {}, expected {reach}",
            spot.reach
        );
    }
}

#[test]
fn what_is_in_focus_stays_sharp() {
    let sharp = spot(None, 4.0, 0.1, 256);
    let focused = spot(Some(lens(0.3, 4.0)), 4.0, 0.1, 256);
    near("deviation", focused.x, 0.1 / 4.0 / 2.0, 0.01);
    near("light", focused.total, sharp.total, 0.003);
}

/// As much light arrives through any aperture as without one: the lens has an area but no gain. (The
/// disk covers pi r^2 / z^2 of the view.)
#[test]
fn a_lens_only_moves_light() {
    let apertures = [
        Aperture::Disk,
        Aperture::Blades {
            count: 5,
            rotation: 10.0,
        },
    ];
    let pixel = 2.0 * HALF_VIEW / f64::from(SIZE);
    let expected = PI * (0.1f64 / 8.0).powi(2) / (pixel * pixel);
    for aperture in apertures {
        let lens = Lens {
            aperture,
            ..lens(0.2, 4.0)
        };
        near(
            "light",
            spot(Some(lens), 8.0, 0.1, 512).total,
            expected,
            0.01,
        );
    }
}

/// Over a regular polygon with n corners on a circle of radius R a coordinate has the variance
/// R^2 (2 + cos(2 pi / n)) / 12, in any direction.
#[test]
fn blades_and_squeeze() {
    let (radius, focus, z) = (0.064, 4.0, 8.0);
    for (count, rotation, anamorphic) in [
        (3, 0.0, 1.0),
        (4, 45.0, 1.0),
        (6, 17.0, 1.0),
        (6, 0.0, 2.0),
        (9, 0.0, 1.5),
    ] {
        let lens = Lens {
            aperture: Aperture::Blades { count, rotation },
            anamorphic,
            ..lens(0.2, focus)
        };
        let spot = spot(Some(lens), z, radius, 1024);
        let scale = 0.2 * (z - focus) / z / focus;
        let polygon = scale * scale * (2.0 + (2.0 * PI / f64::from(count)).cos()) / 12.0;
        let source = (radius / z) * (radius / z) / 4.0;
        let what = format!("{count} blades at {rotation}, squeezed by {anamorphic}");
        let across = polygon / (anamorphic * anamorphic) + source;
        near(&format!("{what}, x"), spot.x, across.sqrt(), 0.015);
        near(
            &format!("{what}, y"),
            spot.y,
            (polygon + source).sqrt(),
            0.015,
        );
    }
}

/// The first corner lies `rotation` degrees from +x: a triangle with a corner to the right reaches twice as
/// far to that side as to the other. What lies behind the plane in focus is blurred in the aperture's
/// own shape (a ray from the right of the lens crosses that plane on the right before it gets to the axis),
/// what lies before it in the mirrored one.
#[test]
fn blades_are_turned() {
    let lens = Lens {
        aperture: Aperture::Blades {
            count: 3,
            rotation: 0.0,
        },
        ..lens(0.2, 4.0)
    };
    let mut desc = blank(SIZE, SIZE);
    desc.camera.projection = perspective(2.0 * HALF_VIEW.atan().to_degrees(), Some(lens));
    let disk = Shape::Disk {
        radius: 0.01,
        inner_radius: 0.0,
        height: 0.0,
    };
    for (z, mirrored) in [(8.0, false), (2.4, true)] {
        let mut desc = desc.clone();
        desc.place(disk.clone(), at(0.0, 0.0, -z), diffuse(0.0))
            .emission = shining(1.0);
        let picture = render(&desc, 1024);
        let lit = |x: &u32| (0..SIZE).any(|y| picture.green(*x, y) > 0.0);
        let (first, last) = (
            (0..SIZE).find(lit).unwrap(),
            (0..SIZE).rev().find(lit).unwrap(),
        );
        let (left, right) = (SIZE / 2 - first, last + 1 - SIZE / 2);
        let (far, close) = if mirrored {
            (left, right)
        } else {
            (right, left)
        };
        let ratio = f64::from(far) / f64::from(close);
        assert!(
            (1.6..=2.5).contains(&ratio),
            "z = {z}: {left} pixels to the left, {right} to the right"
        );
    }
}
