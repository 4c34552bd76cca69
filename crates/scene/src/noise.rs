//! Gradient noise [Perlin02] with the table and the gradients that pbrt-v4 uses, so that patterns come
//! out where its pictures have them. Positions are in double precision, which only matters far from the
//! origin; everything is plain arithmetic and the same on every machine.

use glam::DVec3;

/// A permutation of 0..256 [Perlin02].
const PERMUTATION: [u8; 256] = [
    151, 160, 137, 91, 90, 15, 131, 13, 201, 95, 96, 53, 194, 233, 7, 225, 140, 36, 103, 30, 69,
    142, 8, 99, 37, 240, 21, 10, 23, 190, 6, 148, 247, 120, 234, 75, 0, 26, 197, 62, 94, 252, 219,
    203, 117, 35, 11, 32, 57, 177, 33, 88, 237, 149, 56, 87, 174, 20, 125, 136, 171, 168, 68, 175,
    74, 165, 71, 134, 139, 48, 27, 166, 77, 146, 158, 231, 83, 111, 229, 122, 60, 211, 133, 230,
    220, 105, 92, 41, 55, 46, 245, 40, 244, 102, 143, 54, 65, 25, 63, 161, 1, 216, 80, 73, 209, 76,
    132, 187, 208, 89, 18, 169, 200, 196, 135, 130, 116, 188, 159, 86, 164, 100, 109, 198, 173,
    186, 3, 64, 52, 217, 226, 250, 124, 123, 5, 202, 38, 147, 118, 126, 255, 82, 85, 212, 207, 206,
    59, 227, 47, 16, 58, 17, 182, 189, 28, 42, 223, 183, 170, 213, 119, 248, 152, 2, 44, 154, 163,
    70, 221, 153, 101, 155, 167, 43, 172, 9, 129, 22, 39, 253, 19, 98, 108, 110, 79, 113, 224, 232,
    178, 185, 112, 104, 218, 246, 97, 228, 251, 34, 242, 193, 238, 210, 144, 12, 191, 179, 162,
    241, 81, 51, 145, 235, 249, 14, 239, 107, 49, 192, 214, 31, 181, 199, 106, 157, 184, 84, 204,
    176, 115, 121, 50, 45, 127, 4, 150, 254, 138, 236, 205, 93, 222, 114, 67, 29, 24, 72, 243, 141,
    128, 195, 78, 66, 215, 61, 156, 180,
];

/// How much finer each octave is than the one before; not 2, so that zeros do not line up.
const LACUNARITY: f64 = 1.99;
/// The mean of |noise|, about: what stands for octaves that are left out.
const MEAN_MAGNITUDE: f64 = 0.2;

/// Which of the 16 gradients a lattice point has, dotted with an offset from it.
fn gradient(corner: [usize; 3], d: [f64; 3]) -> f64 {
    // The table repeats every 256; sums of an entry and a coordinate stay below 512.
    let hash = |below: usize, axis: usize| usize::from(PERMUTATION[(below + corner[axis]) & 255]);
    let h = hash(hash(hash(0, 0), 1), 2) & 15;
    let u = if h < 8 || h == 12 || h == 13 {
        d[0]
    } else {
        d[1]
    };
    let v = if h < 4 || h == 12 || h == 13 {
        d[1]
    } else {
        d[2]
    };
    (if h & 1 == 0 { u } else { -u }) + (if h & 2 == 0 { v } else { -v })
}

/// Smooth from 0 to 1 with two vanishing derivatives at both ends.
fn fade(t: f64) -> f64 {
    t * t * t * (t * (t * 6.0 - 15.0) + 10.0)
}

/// Noise in [-1, 1], 0 at whole coordinates, 256-periodic along each axis. 0 where `p` is not finite.
pub fn noise(p: DVec3) -> f64 {
    if !p.is_finite() {
        return 0.0;
    }
    let floor = p.to_array().map(libm::floor);
    // Where neighbouring numbers are further apart than a cell there is nothing to interpolate.
    if floor.iter().any(|f| libm::fabs(*f) > 1e15) {
        return 0.0;
    }
    let cell = floor.map(|f| (f as i64).rem_euclid(256) as usize);
    let d: [f64; 3] = std::array::from_fn(|i| p[i] - floor[i]);
    let w = d.map(fade);
    let corner = |x: usize, y: usize, z: usize| {
        gradient(
            [
                (cell[0] + x) & 255,
                (cell[1] + y) & 255,
                (cell[2] + z) & 255,
            ],
            [d[0] - x as f64, d[1] - y as f64, d[2] - z as f64],
        )
    };
    let along_x = |y: usize, z: usize| lerp(corner(0, y, z), corner(1, y, z), w[0]);
    let along_y = |z: usize| lerp(along_x(0, z), along_x(1, z), w[1]);
    lerp(along_y(0), along_y(1), w[2])
}

fn lerp(a: f64, b: f64, t: f64) -> f64 {
    (1.0 - t) * a + t * b
}

/// Sum of octaves, each finer and weaker (by `roughness`) than the one before.
pub fn fbm(p: DVec3, roughness: f64, octaves: u32) -> f64 {
    let (mut sum, mut frequency, mut weight) = (0.0, 1.0, 1.0);
    for _ in 0..octaves {
        sum += weight * noise(p * frequency);
        frequency *= LACUNARITY;
        weight *= roughness;
    }
    sum
}

/// The same of absolute values; the octave after the last is there with its mean.
pub fn turbulence(p: DVec3, roughness: f64, octaves: u32) -> f64 {
    let (mut sum, mut frequency, mut weight) = (0.0, 1.0, 1.0);
    for _ in 0..octaves {
        sum += weight * libm::fabs(noise(p * frequency));
        frequency *= LACUNARITY;
        weight *= roughness;
    }
    sum + weight * MEAN_MAGNITUDE
}

/// Slope of the noise by one-sided differences of 0.01, as pbrt-v4 takes it.
fn slope(p: DVec3) -> DVec3 {
    const STEP: f64 = 0.01;
    let here = noise(p);
    let along = |axis: DVec3| (noise(p + axis * STEP) - here) / STEP;
    DVec3::new(along(DVec3::X), along(DVec3::Y), along(DVec3::Z))
}

/// Density in [0, 1] of pbrt-v4's procedural cloud at a point of its own space, where y is 0 at the
/// bottom and 1 at the top: noise, thinning with height, over a solid lower half.
pub fn cloud(p: DVec3, density: f64, wispiness: f64, frequency: f64) -> f64 {
    let mut at = p * frequency;
    if wispiness > 0.0 {
        let (mut weight, mut scale) = (0.05 * wispiness, 10.0);
        for _ in 0..2 {
            at += slope(at * scale) * weight;
            weight *= 0.5;
            scale *= LACUNARITY;
        }
    }
    let d = 0.5 * fbm(at, 0.5, 5);
    let d = ((1.0 - p.y) * 4.5 * density * d).clamp(0.0, 1.0);
    (d + 2.0 * (0.5 - p.y).max(0.0)).clamp(0.0, 1.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_table_is_a_permutation() {
        let mut seen = [false; 256];
        for value in PERMUTATION {
            assert!(!std::mem::replace(&mut seen[usize::from(value)], true));
        }
    }

    /// Values worked out by hand from the definition: on the lattice the noise is 0, half way between
    /// two lattice points along x it is half the difference of their slopes along x.
    #[test]
    fn noise_has_the_values_of_its_definition() {
        for p in [DVec3::ZERO, DVec3::new(3.0, -7.0, 250.0)] {
            assert_eq!(noise(p), 0.0);
        }
        let x_slope = |i: usize| gradient([i, 0, 0], [1.0, 0.0, 0.0]);
        for i in 0..8 {
            let got = noise(DVec3::new(i as f64 + 0.5, 0.0, 0.0));
            let want = 0.5 * 0.5 * (x_slope(i) - x_slope(i + 1));
            assert_eq!(got, want, "between {i} and {}", i + 1);
        }
        assert_eq!(noise(DVec3::new(f64::NAN, 0.0, 0.0)), 0.0);
        assert_eq!(noise(DVec3::splat(1e300)), 0.0);
    }

    #[test]
    fn noise_is_smooth_bounded_and_periodic() {
        let (mut least, mut most, mut sum) = (0.0f64, 0.0f64, 0.0);
        for i in 0..20_000 {
            let p = DVec3::new(0.137, 0.071, 0.053) * f64::from(i) + DVec3::new(-60.0, 5.5, 0.0);
            let n = noise(p);
            least = least.min(n);
            most = most.max(n);
            sum += libm::fabs(n);
            let near = noise(p + DVec3::splat(1e-4));
            assert!(libm::fabs(n - near) < 2e-3, "{p}: {n}, {near}");
            let far = noise(p + DVec3::new(256.0, -512.0, 0.0));
            assert!(libm::fabs(n - far) < 1e-9, "{p}: {n}, {far}");
        }
        assert!(least > -1.0 && most < 1.0, "{least} to {most}");
        let mean = sum / 20_000.0;
        assert!((0.15..0.3).contains(&mean), "mean of |noise|: {mean}");
    }

    #[test]
    fn octaves_add_up() {
        let p = DVec3::new(0.3, 1.7, -2.2);
        let (first, second) = (noise(p), noise(p * LACUNARITY));
        assert_eq!(fbm(p, 0.25, 2), first + 0.25 * second);
        assert_eq!(fbm(p, 0.25, 0), 0.0);
        let want = libm::fabs(first) + 0.25 * libm::fabs(second) + 0.0625 * MEAN_MAGNITUDE;
        assert!(libm::fabs(turbulence(p, 0.25, 2) - want) < 1e-15);
    }

    #[test]
    fn clouds_are_solid_below_and_gone_above() {
        assert_eq!(cloud(DVec3::new(0.3, 0.0, 0.2), 1.0, 1.0, 5.0), 1.0);
        assert_eq!(cloud(DVec3::new(0.3, 1.0, 0.2), 1.0, 1.0, 5.0), 0.0);
    }
}
