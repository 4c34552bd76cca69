//! Shape "curve": Bezier and B-spline strands of degree 2 and 3, all as cubic Bezier pieces. A head of
//! hair is a hundred thousand of these directives in a row, so those that differ in nothing else end up
//! in one bundle.

use super::params::{Kind, Params};
use super::{Importer, PendingShape};
use crate::context::Issue;
use crate::model::{CurveKind, CurveSegment, Curves, CurvesId, Shape};
use glam::DVec3;
use std::sync::Arc;

/// What a strand is made of before it is placed.
pub(super) struct Strand {
    kind: CurveKind,
    segments: Vec<CurveSegment>,
}

impl Importer<'_, '_> {
    pub(super) fn strand(&mut self, params: &Params) -> Result<Strand, Issue> {
        let width = params.float("width", 1.0)?;
        let width = [
            params.float("width0", width)?,
            params.float("width1", width)?,
        ];
        if width.iter().any(|w| *w < 0.0) {
            return params.fail("a curve with a negative width");
        }
        let degree = params.count("degree", 3, 2..=3)? as usize;
        // How finely rays cut it is ours.
        params.count("splitdepth", 3, 0..=30)?;
        let Some(points) = params.rows::<3>("P", &[Kind::Point3])? else {
            return params.fail("a curve needs \"P\"");
        };
        let points: Vec<DVec3> = points
            .iter()
            .map(|p| DVec3::from_array(p.map(f64::from)))
            .collect();
        let pieces = match params.text("basis", "bezier")? {
            "bezier" => bezier(&points, degree),
            "bspline" => bspline(&points, degree),
            other => {
                return params.fail(format!(
                    "unknown basis {other:?}; there are bezier and bspline"
                ));
            }
        };
        let pieces = match pieces {
            Some(pieces) => pieces,
            None => {
                return params.fail(format!(
                    "a curve of degree {degree} cannot have {} control points",
                    points.len()
                ));
            }
        };
        let kind = match params.text("type", "flat")? {
            "flat" => CurveKind::Flat,
            "cylinder" => CurveKind::Cylinder,
            "ribbon" => CurveKind::Ribbon,
            other => {
                return params.fail(format!(
                    "unknown curve type {other:?}; there are flat, cylinder, ribbon"
                ));
            }
        };
        let normals = params.rows::<3>("N", &[Kind::Normal])?;
        let normals = match (kind, normals) {
            (CurveKind::Ribbon, Some(normals)) if normals.len() == pieces.len() + 1 => normals,
            (CurveKind::Ribbon, Some(normals)) => {
                return params.fail(format!(
                    "{} normals for {} pieces: a ribbon has one more than pieces",
                    normals.len(),
                    pieces.len()
                ));
            }
            (CurveKind::Ribbon, None) => return params.fail("a ribbon needs normals \"N\""),
            (_, Some(_)) => {
                self.warn_once(
                    &params.place,
                    "normals \"N\" of a curve that is no ribbon are left out, as in pbrt",
                );
                Vec::new()
            }
            (_, None) => Vec::new(),
        };
        let count = pieces.len() as f64;
        let width_at = |i: usize| (width[0] + (width[1] - width[0]) * i as f64 / count) as f32;
        let segments = pieces
            .iter()
            .enumerate()
            .map(|(i, piece)| CurveSegment {
                points: piece.map(|p| p.to_array().map(|x| x as f32)),
                width: [width_at(i), width_at(i + 1)],
                // pbrt starts again at each piece.
                u: [0.0, 1.0],
                normals: match normals.get(i..i + 2) {
                    Some(&[a, b]) => [a, b],
                    _ => [[0.0; 3]; 2],
                },
            })
            .collect();
        Ok(Strand { kind, segments })
    }

    /// Adds a strand to the shapes: to the bundle before it if nothing else differs.
    pub(super) fn add_strand(
        &mut self,
        params: &Params,
        strand: Strand,
        mut pending: PendingShape,
    ) -> Result<(), Issue> {
        let bytes = strand.segments.len() as u64 * size_of::<CurveSegment>() as u64;
        self.cx.charge(&params.place, bytes)?;
        let open = self.open_group;
        let list = match self.groups.last_mut().filter(|_| open) {
            Some(group) => &mut group.shapes,
            None => &mut self.shapes,
        };
        if let Some(last) = list.last()
            && let Shape::Curves(id) = last.shape
            && let Some(bundle) = self.curves.get_mut(id.index())
            && bundle.kind == strand.kind
            && last.looks_like(&pending)
        {
            Arc::make_mut(&mut bundle.segments).extend(strand.segments);
            return Ok(());
        }
        let index = self.curves.len() as u32;
        pending.shape = Shape::Curves(CurvesId(index));
        list.push(pending);
        self.curves.push(Curves {
            name: format!("curves {index} at {}", params.place),
            kind: strand.kind,
            segments: Arc::new(strand.segments),
        });
        Ok(())
    }
}

/// The cubic with the same shape as a quadratic piece.
fn elevated([a, b, c]: [DVec3; 3]) -> [DVec3; 4] {
    [a, (a + b * 2.0) / 3.0, (b * 2.0 + c) / 3.0, c]
}

/// Pieces that share their end points; nothing if the points do not come out even.
fn bezier(points: &[DVec3], degree: usize) -> Option<Vec<[DVec3; 4]>> {
    if points.len() <= degree || !(points.len() - 1).is_multiple_of(degree) {
        return None;
    }
    let piece = |i: usize| {
        let p = &points[i * degree..];
        match degree {
            2 => elevated([p[0], p[1], p[2]]),
            _ => [p[0], p[1], p[2], p[3]],
        }
    };
    Some((0..(points.len() - 1) / degree).map(piece).collect())
}

/// A uniform B-spline: each piece depends on `degree + 1` points and moves on by one.
fn bspline(points: &[DVec3], degree: usize) -> Option<Vec<[DVec3; 4]>> {
    if points.len() <= degree {
        return None;
    }
    let piece = |p: &[DVec3]| match degree {
        2 => elevated([(p[0] + p[1]) * 0.5, p[1], (p[1] + p[2]) * 0.5]),
        _ => {
            let end = |a: DVec3, b: DVec3, c: DVec3| (a + b * 4.0 + c) / 6.0;
            [
                end(p[0], p[1], p[2]),
                (p[1] * 2.0 + p[2]) / 3.0,
                (p[1] + p[2] * 2.0) / 3.0,
                end(p[1], p[2], p[3]),
            ]
        }
    };
    Some(points.windows(degree + 1).map(piece).collect())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn at([a, b, c, d]: [DVec3; 4], t: f64) -> DVec3 {
        let s = 1.0 - t;
        a * (s * s * s) + b * (3.0 * s * s * t) + c * (3.0 * s * t * t) + d * (t * t * t)
    }

    fn points(n: usize) -> Vec<DVec3> {
        (0..n)
            .map(|i| {
                let i = i as f64;
                DVec3::new(i, libm::sin(i * 1.3), libm::cos(i * 0.7) * 2.0)
            })
            .collect()
    }

    #[test]
    fn quadratic_pieces_keep_their_shape() {
        let p = points(3);
        let cubic = bezier(&p, 2).unwrap()[0];
        for i in 0..=10 {
            let t = f64::from(i) / 10.0;
            let s = 1.0 - t;
            let want = p[0] * (s * s) + p[1] * (2.0 * s * t) + p[2] * (t * t);
            assert!((at(cubic, t) - want).length() < 1e-12);
        }
    }

    /// The basis functions of the uniform cubic B-spline, written out.
    #[test]
    fn splines_become_bezier_pieces() {
        let p = points(6);
        let pieces = bspline(&p, 3).unwrap();
        assert_eq!(pieces.len(), 3);
        for (i, piece) in pieces.iter().enumerate() {
            for k in 0..=10 {
                let t = f64::from(k) / 10.0;
                let s = 1.0 - t;
                let want = (p[i] * (s * s * s)
                    + p[i + 1] * (3.0 * t * t * t - 6.0 * t * t + 4.0)
                    + p[i + 2] * (3.0 * s * s * s - 6.0 * s * s + 4.0)
                    + p[i + 3] * (t * t * t))
                    / 6.0;
                assert!((at(*piece, t) - want).length() < 1e-12, "{i}, {t}");
            }
        }
        let quadratic = bspline(&p, 2).unwrap();
        assert_eq!(quadratic.len(), 4);
        for pair in quadratic.windows(2) {
            assert!((pair[0][3] - pair[1][0]).length() < 1e-12);
            // The slopes join too.
            let (before, after) = (pair[0][3] - pair[0][2], pair[1][1] - pair[1][0]);
            assert!((before - after).length() < 1e-12);
        }
    }

    #[test]
    fn points_must_come_out_even() {
        for (n, degree, bezier_pieces, spline_pieces) in [
            (0, 3, None, None),
            (3, 3, None, None),
            (4, 3, Some(1), Some(1)),
            (5, 3, None, Some(2)),
            (7, 3, Some(2), Some(4)),
            (2, 2, None, None),
            (3, 2, Some(1), Some(1)),
            (4, 2, None, Some(2)),
            (5, 2, Some(2), Some(3)),
        ] {
            let p = points(n);
            assert_eq!(bezier(&p, degree).map(|v| v.len()), bezier_pieces);
            assert_eq!(bspline(&p, degree).map(|v| v.len()), spline_pieces);
        }
    }
}
