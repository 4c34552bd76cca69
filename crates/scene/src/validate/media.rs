//! Media, grids and curves: counts, ranges, numbers.

use super::Findings;
use crate::limits::MAX_GRID_SIDE;
use crate::model::{CurveKind, Curves, Grid, GridValues, Medium, SceneDesc};
use std::collections::BTreeSet;

pub(super) fn check(desc: &SceneDesc, found: &mut Findings) {
    let mut names = BTreeSet::new();
    for m in &desc.media {
        found.check(names.insert(m.name.as_str()), || {
            format!("medium {:?} is there twice", m.name)
        });
        medium(m, found);
    }
    if let Some(id) = desc.camera.medium {
        found.check(id.index() < desc.media.len(), || {
            "camera: refers to no medium".into()
        });
    }
    let mut names = BTreeSet::new();
    for c in &desc.curves {
        found.check(names.insert(c.name.as_str()), || {
            format!("curves {:?} are there twice", c.name)
        });
        curves(c, found);
    }
}

fn medium(m: &Medium, found: &mut Findings) {
    let what = format!("medium {:?}", m.name);
    for (name, color) in [
        ("sigma_a", m.sigma_a),
        ("sigma_s", m.sigma_s),
        ("emission", m.emission),
    ] {
        found.check(color.iter().all(|c| *c >= 0.0 && c.is_finite()), || {
            format!("{what}: {name} of {color:?}")
        });
    }
    found.check(m.g > -1.0 && m.g < 1.0, || {
        format!(
            "{what}: an asymmetry of {}; it lies between -1 and 1, without either",
            m.g
        )
    });
    if let Some(ior) = m.translucent {
        found.check((0.01..=100.0).contains(&ior), || {
            format!("{what}: an index of refraction of {ior}; it lies between 0.01 and 100")
        });
    }
    let Some(g) = &m.grid else { return };
    found.transform(&what, &g.transform);
    let [low, high] = g.bounds;
    let fine = (0..3).all(|i| low[i].is_finite() && high[i].is_finite() && low[i] < high[i]);
    found.check(fine, || {
        format!("{what}: a box from {low:?} to {high:?}; the first corner is the lower one")
    });
    grid(&what, "absorption", &g.absorption, found);
    grid(&what, "scattering", &g.scattering, found);
    if let Some(e) = &g.emission {
        grid(&what, "emission", e, found);
    }
}

fn grid(what: &str, name: &str, grid: &Grid, found: &mut Findings) {
    let [x, y, z] = grid.size;
    found.check(
        grid.size.iter().all(|s| (1..=MAX_GRID_SIDE).contains(s)),
        || {
            format!(
                "{what}: a grid ({name}) of {x} x {y} x {z} cells; a side is 1 to {MAX_GRID_SIDE}"
            )
        },
    );
    let cells = (grid.size.iter()).fold(1u64, |n, s| n.saturating_mul(u64::from(*s)));
    let (count, numbers): (usize, &[f32]) = match &grid.values {
        GridValues::Scalar(v) => (v.len(), v),
        GridValues::Rgb(v) => (v.len(), v.as_flattened()),
    };
    found.check(count as u64 == cells, || {
        format!("{what}: a grid ({name}) of {x} x {y} x {z} cells with {count} values")
    });
    found.check(numbers.iter().all(|v| *v >= 0.0 && v.is_finite()), || {
        format!("{what}: a grid ({name}) with values that are negative or not finite")
    });
}

fn curves(c: &Curves, found: &mut Findings) {
    let what = format!("curves {:?}", c.name);
    found.check(!c.segments.is_empty(), || format!("{what}: no segments"));
    for (i, s) in c.segments.iter().enumerate() {
        let numbers = s.points.as_flattened().iter();
        let finite = numbers
            .chain(&s.u)
            .chain(s.normals.as_flattened())
            .all(|x| x.is_finite());
        let width = s.width.iter().all(|w| *w >= 0.0 && w.is_finite());
        let problem = if !finite {
            "numbers that are not finite"
        } else if !width || s.width == [0.0; 2] {
            "a width that is negative, not finite, or zero at both ends"
        } else if c.kind == CurveKind::Ribbon && s.normals.contains(&[0.0; 3]) {
            "a ribbon without normals"
        } else {
            continue;
        };
        // One is enough: bundles have millions.
        found.error(format!("{what}: segment {i}: {problem}"));
        break;
    }
}
