//! Procedural patterns. They are pbrt-v4's, so that its scenes look as they do there.

use crate::math::ONE_MINUS_EPSILON;
use glam::{DVec3, Vec2, Vec3};
use scene::model::NoisePattern;
use scene::noise;

/// Radius of a dot in cells.
const DOT_RADIUS: f64 = 0.35;

/// Whether a place lies on a dot: each unit cell about a whole coordinate has one if the noise says so,
/// moved as far as keeps it inside its cell.
pub(super) fn on_dot(st: Vec2) -> bool {
    let (s, t) = (st.x as f64, st.y as f64);
    let (cs, ct) = ((s + 0.5).floor(), (t + 0.5).floor());
    // The third coordinate is half a cell, as noise vanishes on the lattice.
    let noise = |x: f64, y: f64| noise::noise(DVec3::new(x, y, 0.5));
    if noise(cs + 0.5, ct + 0.5) <= 0.0 {
        return false;
    }
    let room = 0.5 - DOT_RADIUS;
    let ds = s - (cs + room * noise(cs + 1.5, ct + 2.8));
    let dt = t - (ct + room * noise(cs + 4.5, ct + 9.8));
    ds * ds + dt * dt < DOT_RADIUS * DOT_RADIUS
}

/// A noise pattern at a point of texture space.
pub(super) fn noise(pattern: &NoisePattern, p: DVec3) -> [f32; 4] {
    let grey = |v: f64| {
        let v = v as f32;
        [v, v, v, 1.0]
    };
    match *pattern {
        NoisePattern::Fbm { octaves, roughness } => {
            grey(noise::fbm(p, f64::from(roughness), octaves))
        }
        NoisePattern::Wrinkled { octaves, roughness } => {
            grey(noise::turbulence(p, f64::from(roughness), octaves))
        }
        NoisePattern::Windy => {
            let strength = noise::fbm(p * 0.1, 0.5, 3);
            grey(strength.abs() * noise::fbm(p, 0.5, 6))
        }
        NoisePattern::Marble {
            octaves,
            roughness,
            scale,
            variation,
        } => {
            let p = p * f64::from(scale);
            let disturbed =
                p.y + f64::from(variation) * noise::fbm(p, f64::from(roughness), octaves);
            let v = veins((0.5 + 0.5 * libm::sin(disturbed)) as f32);
            [v.x, v.y, v.z, 1.0]
        }
    }
}

/// Colours of marble over t in [0, 1]: Bezier pieces through windows of four colours.
fn veins(t: f32) -> Vec3 {
    const PALE: Vec3 = Vec3::new(0.58, 0.58, 0.6);
    const COLORS: [Vec3; 9] = [
        PALE,
        PALE,
        PALE,
        Vec3::new(0.5, 0.5, 0.5),
        Vec3::new(0.6, 0.59, 0.58),
        PALE,
        PALE,
        Vec3::new(0.2, 0.2, 0.33),
        PALE,
    ];
    const PIECES: usize = COLORS.len() - 3;
    let x = t.clamp(0.0, ONE_MINUS_EPSILON) * PIECES as f32;
    let first = (x as usize).min(PIECES - 1);
    let (u, v) = (x - first as f32, 1.0 - (x - first as f32));
    let c = &COLORS[first..first + 4];
    let bezier = c[0] * (v * v * v)
        + c[1] * (3.0 * v * v * u)
        + c[2] * (3.0 * v * u * u)
        + c[3] * (u * u * u);
    bezier * 1.5
}
