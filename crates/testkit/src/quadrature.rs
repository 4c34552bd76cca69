//! Integrals of functions of a direction.

use std::f64::consts::PI;

/// Nodes and weights of Gauss-Legendre quadrature with five points on [-1, 1].
const GAUSS5: [(f64, f64); 5] = [
    (-0.906_179_845_938_664, 0.236_926_885_056_189_1),
    (-0.538_469_310_105_683_1, 0.478_628_670_499_366_5),
    (0.0, 0.568_888_888_888_888_9),
    (0.538_469_310_105_683_1, 0.478_628_670_499_366_5),
    (0.906_179_845_938_664, 0.236_926_885_056_189_1),
];

/// Halvings that are always made: the edge of a hemisphere may cut off a corner between the nodes.
const LEAST_DEPTH: u32 = 2;

/// Integral of `f` over a rectangle, halving it until the halves agree with the whole within
/// `tolerance`, or `depth` times.
pub(crate) fn adaptive<F: FnMut(f64, f64) -> f64>(
    f: &mut F,
    x: (f64, f64),
    y: (f64, f64),
    tolerance: f64,
    depth: u32,
) -> f64 {
    refine(f, x, y, f64::INFINITY, tolerance, depth, LEAST_DEPTH)
}

fn refine<F: FnMut(f64, f64) -> f64>(
    f: &mut F,
    x: (f64, f64),
    y: (f64, f64),
    whole: f64,
    tolerance: f64,
    depth: u32,
    least: u32,
) -> f64 {
    let (mx, my) = (0.5 * (x.0 + x.1), 0.5 * (y.0 + y.1));
    let parts = [
        ((x.0, mx), (y.0, my)),
        ((mx, x.1), (y.0, my)),
        ((x.0, mx), (my, y.1)),
        ((mx, x.1), (my, y.1)),
    ];
    let values = parts.map(|(x, y)| gauss(f, x, y));
    let sum: f64 = values.iter().sum();
    if depth == 0 || (least == 0 && (sum - whole).abs() <= tolerance) {
        return sum;
    }
    parts
        .iter()
        .zip(values)
        .map(|(&(x, y), v)| {
            refine(
                f,
                x,
                y,
                v,
                0.25 * tolerance,
                depth - 1,
                least.saturating_sub(1),
            )
        })
        .sum()
}

fn gauss<F: FnMut(f64, f64) -> f64>(f: &mut F, x: (f64, f64), y: (f64, f64)) -> f64 {
    let (cx, hx) = (0.5 * (x.0 + x.1), 0.5 * (x.1 - x.0));
    let (cy, hy) = (0.5 * (y.0 + y.1), 0.5 * (y.1 - y.0));
    let mut sum = 0.0;
    for (nx, wx) in GAUSS5 {
        for (ny, wy) in GAUSS5 {
            sum += wx * wy * f(cx + hx * nx, cy + hy * ny);
        }
    }
    sum * hx * hy
}

/// A right-handed frame about a unit vector.
pub(crate) fn frame(n: [f64; 3]) -> [[f64; 3]; 3] {
    let helper = if n[0].abs() < 0.6 {
        [1.0, 0.0, 0.0]
    } else {
        [0.0, 1.0, 0.0]
    };
    let cross = |a: [f64; 3], b: [f64; 3]| {
        [
            a[1] * b[2] - a[2] * b[1],
            a[2] * b[0] - a[0] * b[2],
            a[0] * b[1] - a[1] * b[0],
        ]
    };
    let s = cross(helper, n);
    let l = (s[0] * s[0] + s[1] * s[1] + s[2] * s[2]).sqrt();
    let s = s.map(|v| v / l);
    [s, cross(n, s), n]
}

/// Direction with these polar angles about the frame's third axis.
pub(crate) fn direction(frame: &[[f64; 3]; 3], theta: f64, phi: f64) -> [f32; 3] {
    let (st, ct) = theta.sin_cos();
    let (sp, cp) = phi.sin_cos();
    std::array::from_fn(|i| {
        (frame[0][i] * st * cp + frame[1][i] * st * sp + frame[2][i] * ct) as f32
    })
}

/// Integral of `f` over the sphere of directions, to about `tolerance`.
pub fn sphere_integral(f: impl FnMut([f32; 3]) -> f64, tolerance: f64) -> f64 {
    sphere_integral_about([0.0, 0.0, 1.0], f, tolerance)
}

/// The same for a function that is concentrated about a direction: cells shrink towards it.
pub fn sphere_integral_about(
    axis: [f32; 3],
    mut f: impl FnMut([f32; 3]) -> f64,
    tolerance: f64,
) -> f64 {
    let frame = frame(axis.map(f64::from));
    // theta = pi/2 t^3 on the near half.
    let mut g = |t: f64, phi: f64| {
        let (theta, stretch) = if t < 1.0 {
            (0.5 * PI * t * t * t, 1.5 * PI * t * t)
        } else {
            (0.5 * PI * t, 0.5 * PI)
        };
        f(direction(&frame, theta, phi)) * theta.sin() * stretch
    };
    let mut sum = 0.0;
    for i in 0..16 {
        for j in 0..8 {
            let t = (f64::from(i) / 8.0, f64::from(i + 1) / 8.0);
            let phi = (PI / 4.0 * f64::from(j), PI / 4.0 * f64::from(j + 1));
            sum += adaptive(&mut g, t, phi, tolerance / 128.0, 7);
        }
    }
    sum
}
