//! Curves against straight strips and against dense sampling.

use super::*;
use testkit::TestRng;

fn straight(width: [f32; 2]) -> Piece {
    Piece {
        points: [0.0, 1.0, 2.0, 3.0].map(|x| Vec3::new(x, 0.0, 0.0)),
        width,
        u: [2.0, 3.0],
        normals: [Vec3::Z; 2],
    }
}

#[test]
fn a_straight_curve_is_a_strip() {
    let piece = straight([0.2, 0.4]);
    for (x, y, inside) in [
        (1.5, 0.14, true),
        (1.5, 0.16, false),
        (0.3, 0.1, true),
        (0.3, 0.12, false),
        (-0.01, 0.0, false),
        (2.99, -0.19, true),
        (3.01, 0.0, false),
    ] {
        // From above, towards -z, twice as fast.
        let hit = piece.intersect(
            CurveKind::Flat,
            [0.0, 1.0],
            Vec3::new(x, y, 5.0),
            Vec3::new(0.0, 0.0, -2.0),
            f32::INFINITY,
        );
        assert_eq!(hit.is_some(), inside, "{x} {y}: {hit:?}");
        if let Some((t, u, v)) = hit {
            assert!((t - 2.5).abs() < 1e-6 && (u - x / 3.0).abs() < 1e-6);
            // n x tangent = z x x = y.
            let width = 0.2 + 0.2 * x / 3.0;
            assert!((v - (0.5 + y / width)).abs() < 1e-5, "{v}");
            let at = piece.point(CurveKind::Cylinder, u, v, Vec3::NEG_Z);
            assert!((at.uv.x - (2.0 + x / 3.0)).abs() < 1e-6);
            assert!(at.n.y * y >= 0.0 && (at.n.y - 2.0 * y / width).abs() < 0.02);
        }
        // Behind the origin, and beyond the end, there is nothing.
        let from = Vec3::new(x, y, -5.0);
        let none = piece.intersect(CurveKind::Flat, [0.0, 1.0], from, Vec3::NEG_Z, 1e9);
        assert!(none.is_none());
        let from = Vec3::new(x, y, 5.0);
        let none = piece.intersect(CurveKind::Flat, [0.0, 1.0], from, Vec3::NEG_Z, 4.9);
        assert!(none.is_none());
    }
}

#[test]
fn a_ribbon_is_as_wide_as_it_is_seen() {
    let piece = straight([0.4, 0.4]);
    let direction = normalize(Vec3::new(0.0, -1.0, -1.0));
    let hit = |y: f32| {
        let origin = Vec3::new(1.0, y, 0.0) - direction * 3.0;
        piece
            .intersect(CurveKind::Ribbon, [0.0, 1.0], origin, direction, 1e9)
            .is_some()
    };
    // In its own plane it reaches to 0.2 on both sides, whatever the view.
    assert!(hit(0.19) && hit(-0.19) && !hit(0.21) && !hit(-0.21));
}

/// Rays aimed at points of a curve hit it; rays aimed beside it do not; parts together are the whole.
#[test]
fn curves_are_hit_where_they_are() {
    let mut rng = TestRng::new(12);
    let (mut hits, mut apart) = (0, 0);
    for _ in 0..300 {
        let mut points = [Vec3::ZERO; 4];
        for p in &mut points {
            *p = Vec3::from(rng.direction()) * 2.0;
        }
        let piece = Piece {
            points,
            width: [0.02, 0.05],
            u: [0.0, 1.0],
            normals: [Vec3::Z; 2],
        };
        for _ in 0..20 {
            let u = 0.05 + 0.9 * rng.u();
            let target = blossom(&points, u, u, u);
            let origin = Vec3::from(rng.direction()) * 6.0;
            let direction = normalize(target - origin);
            let whole = piece.intersect(CurveKind::Flat, [0.0, 1.0], origin, direction, 1e9);
            let mut nearest: Option<(f32, f32, f32)> = None;
            for i in 0..8 {
                let range = [i as f32 / 8.0, (i + 1) as f32 / 8.0];
                let bounds = piece.bounds(range);
                let hit = piece.intersect(CurveKind::Flat, range, origin, direction, 1e9);
                if let Some((t, at, _)) = hit {
                    let p = origin + direction * t;
                    assert!(
                        p.cmpge(bounds.min).all() && p.cmple(bounds.max).all(),
                        "{p} outside its box"
                    );
                    assert!(at >= range[0] && at <= range[1]);
                    // The point is within half a width of the curve.
                    let on = blossom(&points, at, at, at);
                    assert!(length(on - p) <= 0.5 * piece.width_at(at) + 1e-3);
                    if nearest.is_none_or(|n| t < n.0) {
                        nearest = hit;
                    }
                }
            }
            let (t, ..) = whole.expect("a ray at the middle of a curve");
            let (s, ..) = nearest.expect("one of the parts");
            // Seen end on, how far along a strand a ray meets it depends on how it is cut.
            let far = t > length(target - origin) + 0.05;
            apart += u32::from(far || (t - s).abs() > 2e-3 * t);
            hits += 1;
        }
    }
    assert_eq!(hits, 6000);
    assert!(apart < 60, "{apart} of {hits} are found elsewhere");
}

#[test]
fn degenerate_pieces_do_no_harm() {
    let piece = |points, width| Piece {
        points,
        width,
        u: [0.0; 2],
        normals: [Vec3::ZERO; 2],
    };
    let lone = piece([Vec3::ONE; 4], [0.1; 2]);
    let hit = lone.intersect(CurveKind::Flat, [0.0, 1.0], Vec3::ZERO, Vec3::ONE, 1e9);
    if let Some((_, u, v)) = hit {
        assert!(lone.point(CurveKind::Ribbon, u, v, Vec3::ONE).n.is_finite());
    }
    let thin = piece([0.0, 1.0, 2.0, 3.0].map(|x| Vec3::X * x), [0.0; 2]);
    let down = Vec3::NEG_Y;
    assert!(
        thin.intersect(CurveKind::Flat, [0.0, 1.0], Vec3::ONE, down, 1e9)
            .is_none()
    );
    assert!(
        thin.intersect(CurveKind::Flat, [0.0, 1.0], Vec3::ONE, Vec3::ZERO, 1e9)
            .is_none()
    );
    assert!(
        thin.point(CurveKind::Cylinder, 0.5, 1.0, Vec3::X)
            .n
            .is_finite()
    );
}
