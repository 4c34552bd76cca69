//! FLIP: how visible a difference is when two pictures are shown in turn at the same place.
//!
//! P. Andersson, J. Nilsson, T. Akenine-Moller, M. Oskarsson, K. Astrom, M. D. Fairchild, *FLIP: A
//! Difference Evaluator for Alternating Images*, PACM CGIT 3(2), 2020. Written from the equations of
//! the paper, for pictures in [0, 1]:
//!
//! - *colour*: both pictures are blurred by the contrast sensitivity of the eye at the viewing
//!   distance (section 4.1.1), compared in Hunt-adjusted Lab by the HyAB distance (4.1.2), and the
//!   distances are compressed (4.1.3);
//! - *features*: edges and points are found in the unblurred luminance by Gaussian derivatives (4.2);
//! - a difference in features raises that in colour: color^(1 - feature) (4.3).

/// Of a 0.7 m wide 4K monitor seen from 0.7 m.
pub const PIXELS_PER_DEGREE: f32 = 67.0;

/// Contrast sensitivity as a sum of Gaussians a sqrt(pi/b) exp(-pi^2 x^2 / b), x in degrees
/// (table 1): achromatic, red-green, blue-yellow.
const SENSITIVITY: [&[(f64, f64)]; 3] = [
    &[(1.0, 0.0047)],
    &[(1.0, 0.0053)],
    &[(34.1, 0.04), (13.5, 0.025)],
];
/// Widest of them.
const WIDEST: f64 = 0.04;
/// Compression of colour distances: exponent, and the part of the range mapped to [0, 0.95].
const COLOR_EXPONENT: f64 = 0.7;
const COLOR_KNEE: (f64, f64) = (0.4, 0.95);
/// Width of a feature in degrees, and its exponent.
const FEATURE_WIDTH: f64 = 0.082;
const FEATURE_EXPONENT: f64 = 0.5;

/// Linear Rec. 709 to XYZ, from the primaries and D65.
const XYZ: [[f32; 3]; 3] = [
    [0.412_390_8, 0.357_584_35, 0.180_480_8],
    [0.212_639, 0.715_168_7, 0.072_192_32],
    [0.019_330_819, 0.119_194_78, 0.950_532_16],
];
/// And back.
const RGB: [[f32; 3]; 3] = [
    [3.240_97, -1.537_383_2, -0.498_610_76],
    [-0.969_243_64, 1.875_967_5, 0.041_555_06],
    [0.055_630_08, -0.203_976_96, 1.056_971_5],
];

fn times(m: &[[f32; 3]; 3], v: [f32; 3]) -> [f32; 3] {
    m.map(|row| row[0] * v[0] + row[1] * v[1] + row[2] * v[2])
}

/// XYZ over that of white.
fn relative_xyz(rgb: [f32; 3]) -> [f32; 3] {
    let (xyz, white) = (times(&XYZ, rgb), times(&XYZ, [1.0; 3]));
    [0, 1, 2].map(|c| xyz[c] / white[c])
}

/// Linearised Lab: blurring in it mixes light, not perception.
fn ycxcz(rgb: [f32; 3]) -> [f32; 3] {
    let [x, y, z] = relative_xyz(rgb);
    [116.0 * y - 16.0, 500.0 * (x - y), 200.0 * (y - z)]
}

fn from_ycxcz(v: [f32; 3]) -> [f32; 3] {
    let y = (v[0] + 16.0) / 116.0;
    let relative = [y + v[1] / 500.0, y, y - v[2] / 200.0];
    let white = times(&XYZ, [1.0; 3]);
    times(&RGB, [0, 1, 2].map(|c| relative[c] * white[c]))
}

/// CIE Lab with colourfulness scaled by lightness (Hunt effect).
fn hunt_lab(rgb: [f32; 3]) -> [f32; 3] {
    const DELTA: f32 = 6.0 / 29.0;
    let curve = |t: f32| {
        if t > DELTA * DELTA * DELTA {
            libm::cbrtf(t)
        } else {
            t / (3.0 * DELTA * DELTA) + 4.0 / 29.0
        }
    };
    let [x, y, z] = relative_xyz(rgb).map(curve);
    let lightness = 116.0 * y - 16.0;
    let hunt = 0.01 * lightness;
    [lightness, hunt * 500.0 * (x - y), hunt * 200.0 * (y - z)]
}

/// City-block in lightness, Euclidean in colour.
fn hyab(a: [f32; 3], b: [f32; 3]) -> f32 {
    let (da, db) = (a[1] - b[1], a[2] - b[2]);
    (a[0] - b[0]).abs() + (da * da + db * db).sqrt()
}

/// A plane of numbers.
#[derive(Clone)]
struct Plane {
    width: usize,
    height: usize,
    values: Vec<f32>,
}

impl Plane {
    fn new(width: usize, height: usize, values: Vec<f32>) -> Plane {
        Plane {
            width,
            height,
            values,
        }
    }

    /// Filters rows by one kernel and columns by another; the border pixel goes on outside.
    fn filtered(&self, row: &[f32], column: &[f32]) -> Plane {
        let (width, height) = (self.width, self.height);
        let radius = row.len() / 2;
        let mut across = vec![0.0; self.values.len()];
        let mut padded = vec![0.0; width + 2 * radius];
        for (line, out) in self.values.chunks(width).zip(across.chunks_mut(width)) {
            padded[..radius].fill(line[0]);
            padded[radius..radius + width].copy_from_slice(line);
            padded[radius + width..].fill(line[width - 1]);
            for (k, &weight) in row.iter().enumerate() {
                for (out, &value) in out.iter_mut().zip(&padded[k..]) {
                    *out += weight * value;
                }
            }
        }
        let radius = column.len() / 2;
        let mut down = vec![0.0; self.values.len()];
        for (y, out) in down.chunks_mut(width).enumerate() {
            for (k, &weight) in column.iter().enumerate() {
                let from = (y + k).saturating_sub(radius).min(height - 1) * width;
                for (out, &value) in out.iter_mut().zip(&across[from..from + width]) {
                    *out += weight * value;
                }
            }
        }
        Plane::new(width, height, down)
    }
}

/// exp(-x^2 factor) at -radius..=radius.
fn gaussian(radius: usize, factor: f64) -> Vec<f64> {
    let radius = radius as i64;
    (-radius..=radius)
        .map(|x| libm::exp(-((x * x) as f64) * factor))
        .collect()
}

fn sum(kernel: &[f64]) -> f64 {
    kernel.iter().sum()
}

fn scaled(kernel: &[f64], factor: f64) -> Vec<f32> {
    kernel.iter().map(|&x| (x * factor) as f32).collect()
}

/// Blurs a channel by its contrast sensitivity.
fn blur(plane: &Plane, gaussians: &[(f64, f64)], ppd: f64) -> Plane {
    let pi = std::f64::consts::PI;
    let radius = (3.0 * (WIDEST / (2.0 * pi * pi)).sqrt() * ppd).ceil() as usize;
    let parts: Vec<(f64, Vec<f64>)> = gaussians
        .iter()
        .map(|&(a, b)| {
            (
                a * (pi / b).sqrt(),
                gaussian(radius, pi * pi / (b * ppd * ppd)),
            )
        })
        .collect();
    let total: f64 = parts
        .iter()
        .map(|(weight, kernel)| weight * sum(kernel) * sum(kernel))
        .sum();
    let mut out = vec![0.0; plane.values.len()];
    for (weight, kernel) in &parts {
        let part = plane.filtered(&scaled(kernel, weight / total), &scaled(kernel, 1.0));
        for (out, value) in out.iter_mut().zip(part.values) {
            *out += value;
        }
    }
    Plane::new(plane.width, plane.height, out)
}

/// Scales the positive part of a kernel to sum 1 and the negative part to -1.
fn balanced(kernel: &[f64]) -> Vec<f32> {
    let positive: f64 = kernel.iter().filter(|&&x| x > 0.0).sum();
    let negative: f64 = -kernel.iter().filter(|&&x| x < 0.0).sum::<f64>();
    kernel
        .iter()
        .map(|&x| (x / if x > 0.0 { positive } else { negative }) as f32)
        .collect()
}

/// Strength of edges and of points.
fn features(luminance: &Plane, ppd: f64) -> (Vec<f32>, Vec<f32>) {
    let deviation = 0.5 * FEATURE_WIDTH * ppd;
    let radius = (3.0 * deviation).ceil() as usize;
    let bell = gaussian(radius, 0.5 / (deviation * deviation));
    let x = |i: usize| i as f64 - radius as f64;
    let smooth = scaled(&bell, 1.0 / sum(&bell));
    let edge: Vec<f64> = bell.iter().enumerate().map(|(i, &g)| -x(i) * g).collect();
    let point: Vec<f64> = bell
        .iter()
        .enumerate()
        .map(|(i, &g)| (x(i) * x(i) / (deviation * deviation) - 1.0) * g)
        .collect();
    let strength = |kernel: &[f64]| -> Vec<f32> {
        let kernel = balanced(kernel);
        let across = luminance.filtered(&kernel, &smooth).values;
        let down = luminance.filtered(&smooth, &kernel).values;
        across
            .iter()
            .zip(&down)
            .map(|(a, b)| (a * a + b * b).sqrt())
            .collect()
    };
    (strength(&edge), strength(&point))
}

/// A picture as the eye gets it: blurred, in Hunt-adjusted Lab; and its features.
struct Seen {
    lab: Vec<[f32; 3]>,
    edges: Vec<f32>,
    points: Vec<f32>,
}

fn see(rgb: &[[f32; 3]], width: usize, height: usize, ppd: f64) -> Seen {
    let opponent: Vec<[f32; 3]> = rgb.iter().map(|&rgb| ycxcz(rgb)).collect();
    let plane = |c: usize| Plane::new(width, height, opponent.iter().map(|v| v[c]).collect());
    let [y, x, z] = [0, 1, 2].map(|c| blur(&plane(c), SENSITIVITY[c], ppd).values);
    let lab = (0..rgb.len())
        .map(|i| hunt_lab(from_ycxcz([y[i], x[i], z[i]]).map(|v| v.clamp(0.0, 1.0))))
        .collect();
    let mut luminance = plane(0);
    for value in &mut luminance.values {
        *value = (*value + 16.0) / 116.0;
    }
    let (edges, points) = features(&luminance, ppd);
    Seen { lab, edges, points }
}

/// FLIP error of each pixel of a test picture, both linear in [0, 1].
pub fn flip(
    reference: &[[f32; 3]],
    test: &[[f32; 3]],
    width: usize,
    height: usize,
    pixels_per_degree: f32,
) -> Vec<f32> {
    if width == 0
        || height == 0
        || reference.len() != width * height
        || test.len() != reference.len()
    {
        return Vec::new();
    }
    let ppd = pixels_per_degree as f64;
    let (r, t) = (
        see(reference, width, height, ppd),
        see(test, width, height, ppd),
    );
    let power = |x: f32| libm::pow(x as f64, COLOR_EXPONENT);
    let most = power(hyab(hunt_lab([0.0, 1.0, 0.0]), hunt_lab([0.0, 0.0, 1.0])));
    let (knee, at_knee) = COLOR_KNEE;
    (0..reference.len())
        .map(|i| {
            let distance = power(hyab(r.lab[i], t.lab[i]));
            let color = if distance < knee * most {
                distance * at_knee / (knee * most)
            } else {
                at_knee + (distance - knee * most) / (most - knee * most) * (1.0 - at_knee)
            };
            let edge = (r.edges[i] - t.edges[i]).abs();
            let point = (r.points[i] - t.points[i]).abs();
            let most = edge.max(point) as f64 / std::f64::consts::SQRT_2;
            let feature = libm::pow(most, FEATURE_EXPONENT).min(1.0);
            libm::pow(color, 1.0 - feature) as f32
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    const SIDE: usize = 48;

    fn picture(value: impl Fn(usize, usize) -> [f32; 3]) -> Vec<[f32; 3]> {
        (0..SIDE * SIDE)
            .map(|i| value(i % SIDE, i / SIDE))
            .collect()
    }

    fn mean(a: &[[f32; 3]], b: &[[f32; 3]]) -> f32 {
        let map = flip(a, b, SIDE, SIDE, PIXELS_PER_DEGREE);
        assert!(map.iter().all(|x| (0.0..=1.0).contains(x)));
        map.iter().sum::<f32>() / map.len() as f32
    }

    fn grey(x: f32) -> Vec<[f32; 3]> {
        picture(|_, _| [x; 3])
    }

    #[test]
    fn known_properties() {
        let noise = picture(|x, y| {
            let h = (x * 7919 + y * 104_729) % 101;
            [h as f32 / 101.0, 0.5, 1.0 - h as f32 / 202.0]
        });
        assert_eq!(mean(&noise, &noise), 0.0);
        assert!(
            (mean(&noise, &grey(0.3)) - mean(&grey(0.3), &noise)).abs() < 1e-6,
            "symmetric"
        );
        // The compression is made so that green against blue is 1.
        let (green, blue) = (
            picture(|_, _| [0.0, 1.0, 0.0]),
            picture(|_, _| [0.0, 0.0, 1.0]),
        );
        assert!((mean(&green, &blue) - 1.0).abs() < 1e-3);
        let errors: Vec<f32> = [0.21, 0.25, 0.4, 0.8]
            .map(|x| mean(&grey(0.2), &grey(x)))
            .into();
        assert!(
            errors.is_sorted() && errors[0] > 0.0 && errors[3] < 1.0,
            "{errors:?}"
        );
    }

    #[test]
    fn a_line_is_seen_more_than_its_area() {
        let base = grey(0.5);
        let line = picture(|x, _| if x == 24 { [0.9; 3] } else { [0.5; 3] });
        let map = flip(&base, &line, SIDE, SIDE, PIXELS_PER_DEGREE);
        assert!(
            map[10 * SIDE + 24] > 0.2 && map[10 * SIDE] < 1e-3,
            "far away nothing changes"
        );
    }

    #[test]
    fn colours_round_trip() {
        for rgb in [[0.1, 0.5, 0.9], [1.0; 3], [0.0; 3]] {
            let back = from_ycxcz(ycxcz(rgb));
            assert!(
                (0..3).all(|c| (back[c] - rgb[c]).abs() < 1e-5),
                "{rgb:?} {back:?}"
            );
        }
    }
}
