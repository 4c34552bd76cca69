//! Reflectances as spectra, for what does not act on each channel by itself.
//!
//! A renderer of wavelengths takes a colour for a smooth curve over them [JakobHanika19]. What is a
//! product of colours is nearly the same in three channels, but light that is thrown back and forth
//! under a coat is not: a red that is 1 in its channel is less at most of the wavelengths that the
//! channel sees, and each round takes its share.

use crate::color;
use crate::model::Rgb;

/// Squared distance of colours up to which a curve counts as found.
const FOUND: f64 = 1e-6;

/// The reflectance that, taken channel by channel, looks under a clear coat with this index of
/// refraction like the smooth spectrum of the colour `rgb` does: the coat throws a share of the light
/// back at the base each time. Colours outside [0, 1] and those without a curve stay as they are.
pub fn under_coat(rgb: Rgb, ior: f32) -> Rgb {
    let grey = rgb.iter().all(|c| *c == rgb[0]);
    let coated = ior > 1.0 && rgb.iter().all(|c| (0.0..=1.0).contains(c));
    if grey || !coated {
        return rgb;
    }
    let Some(curve) = Curve::of(rgb.map(f64::from)) else {
        return rgb;
    };
    let back = thrown_back(f64::from(ior));
    let through = |r: f64| (1.0 - back) * r / (1.0 - back * r);
    let seen = color::weighted(|lambda| through(curve.at(lambda)));
    seen.map(|c| {
        let c = f64::from(c);
        (c / (1.0 - back + back * c)).clamp(0.0, 1.0) as f32
    })
}

/// Share of diffuse light that a smooth boundary throws back at the denser side: what leaves is what
/// enters from outside, thinned by the square of the index.
fn thrown_back(ior: f64) -> f64 {
    const STEPS: u32 = 200;
    let mut outside = 0.0;
    for i in 0..STEPS {
        let cos = (f64::from(i) + 0.5) / f64::from(STEPS);
        let inner = libm::sqrt(1.0 - (1.0 - cos * cos) / (ior * ior));
        let (s, p) = (
            (cos - ior * inner) / (cos + ior * inner),
            (ior * cos - inner) / (ior * cos + inner),
        );
        outside += (s * s + p * p) * cos / f64::from(STEPS);
    }
    1.0 - (1.0 - outside) / (ior * ior)
}

/// A reflectance over wavelengths: a sigmoid of a parabola [JakobHanika19, eq. 3 and 5].
struct Curve([f64; 3]);

impl Curve {
    /// The place of a wavelength in nm, [0, 1] over what is visible.
    fn place(lambda: f64) -> f64 {
        (lambda - 360.0) / 470.0
    }

    fn exponent(&self, x: f64) -> f64 {
        let [a, b, c] = self.0;
        (a * x + b) * x + c
    }

    fn at(&self, lambda: f64) -> f64 {
        let t = self.exponent(Self::place(lambda));
        0.5 + 0.5 * t / libm::sqrt(1.0 + t * t)
    }

    /// The colour, less the wanted one.
    fn miss(&self, rgb: [f64; 3]) -> [f64; 3] {
        let seen = color::weighted_signed(|lambda| self.at(lambda));
        std::array::from_fn(|i| seen[i] - rgb[i])
    }

    /// The curve of a colour in [0, 1], by damped Gauss-Newton steps from a few starts; nothing if none
    /// of them gets there.
    fn of(rgb: [f64; 3]) -> Option<Curve> {
        // At the ends the curve would run away to infinity.
        let rgb = rgb.map(|c| c.clamp(0.001, 0.999));
        const STARTS: [[f64; 3]; 5] = [
            [0.0, 0.0, 0.0],
            [-20.0, 20.0, -5.0],
            [20.0, -20.0, 3.0],
            [0.0, 8.0, -6.0],
            [0.0, -8.0, 2.0],
        ];
        STARTS
            .into_iter()
            .map(|start| Curve(start).approach(rgb))
            .find(|(_, error)| *error < FOUND)
            .map(|(curve, _)| curve)
    }

    fn approach(mut self, rgb: [f64; 3]) -> (Curve, f64) {
        let square = |v: [f64; 3]| v.iter().map(|c| c * c).sum::<f64>();
        let mut miss = self.miss(rgb);
        let mut damping = 1e-3;
        for _ in 0..100 {
            if square(miss) < FOUND * 1e-3 || damping > 1e9 {
                break;
            }
            // Derivatives of each channel by each coefficient.
            let by = |factor: fn(f64) -> f64| {
                color::weighted_signed(|lambda| {
                    let x = Self::place(lambda);
                    let t = self.exponent(x);
                    let root = libm::sqrt(1.0 + t * t);
                    factor(x) * 0.5 / (root * root * root)
                })
            };
            let j = [by(|x| x * x), by(|x| x), by(|_| 1.0)];
            let dot = |a: [f64; 3], b: [f64; 3]| a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
            let mut m = [[0.0; 3]; 3];
            for (r, row) in m.iter_mut().enumerate() {
                for (c, value) in row.iter_mut().enumerate() {
                    *value = dot(j[r], j[c]);
                }
                row[r] += damping * (row[r] + 1e-9);
            }
            let Some(step) = solve(m, j.map(|column| -dot(column, miss))) else {
                damping *= 10.0;
                continue;
            };
            let next = Curve(std::array::from_fn(|i| self.0[i] + step[i]));
            let next_miss = next.miss(rgb);
            if square(next_miss) < square(miss) {
                (self, miss) = (next, next_miss);
                damping = (damping * 0.2).max(1e-12);
            } else {
                damping *= 5.0;
            }
        }
        let error = square(miss);
        (self, error)
    }
}

/// Cramer's rule.
fn solve(m: [[f64; 3]; 3], b: [f64; 3]) -> Option<[f64; 3]> {
    let [m0, m1, m2] = m.map(glam::DVec3::from_array);
    let det = m0.dot(m1.cross(m2));
    if det == 0.0 || !det.is_finite() {
        return None;
    }
    // The matrix is symmetric: rows are columns.
    let b = glam::DVec3::from_array(b);
    let x = [
        b.dot(m1.cross(m2)),
        m0.dot(b.cross(m2)),
        m0.dot(m1.cross(b)),
    ]
    .map(|v| v / det);
    x.iter().all(|v| v.is_finite()).then_some(x)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn curves_have_the_colours_that_they_are_made_for() {
        for r in [0.0, 0.02, 0.3, 0.9, 1.0] {
            for g in [0.0, 0.1, 0.5, 1.0] {
                for b in [0.0, 0.05, 0.6, 1.0] {
                    let Some(curve) = Curve::of([r, g, b]) else {
                        panic!("no curve for {r} {g} {b}");
                    };
                    let miss = curve.miss([r, g, b]);
                    assert!(
                        miss.iter().all(|m| m.abs() < 3e-3),
                        "{r} {g} {b} misses by {miss:?}"
                    );
                }
            }
        }
    }

    #[test]
    fn half_of_the_light_under_glass_is_thrown_back() {
        // Internal diffuse reflectance at 1.5, tabulated by Walsh's formula: 0.5963.
        assert!((thrown_back(1.5) - 0.5963).abs() < 2e-4);
        assert!(thrown_back(1.0001) < 1e-3);
    }

    #[test]
    fn coats_take_from_what_is_saturated_and_bright() {
        assert_eq!(under_coat([0.4; 3], 1.5), [0.4; 3], "grey is grey");
        assert_eq!(under_coat([0.9, 0.3, 0.1], 1.0), [0.9, 0.3, 0.1], "no coat");
        assert_eq!(under_coat([1.5, 0.3, 0.1], 1.5), [1.5, 0.3, 0.1]);
        // Worked out with another solver in another language.
        for (rgb, expect) in [
            ([1.0, 0.378_676, 0.013_473], [0.916, 0.390, 0.0]),
            ([0.6, 0.3, 0.1], [0.585, 0.299, 0.094]),
            ([0.1, 0.2, 0.6], [0.110, 0.187, 0.599]),
        ] {
            let got = under_coat(rgb, 1.5);
            for i in 0..3 {
                assert!(
                    (got[i] - expect[i]).abs() < 0.004,
                    "{rgb:?} is {got:?} instead of {expect:?}"
                );
            }
        }
    }
}
