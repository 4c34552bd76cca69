//! Hair and fur fibres [Chiang16]: light is reflected (R), passes through (TT), is reflected inside once (TRT)
//! or more often, each with a longitudinal lobe Mp and an azimuthal lobe Np:
//!
//! f |cos| = sum over p of Mp(theta_o, theta_i) Ap(h, theta_o) Np(phi)
//!
//! x of the shading frame runs along the strand, h in [-1, 1] is where across it the ray meets it, growing
//! along y. Azimuths are measured about x from y to z, so that only their difference counts and the
//! shading normal does not. R, TT, TRT are lobes of their own, the rest is one that is uniform around the
//! strand. The scales tilt the lobes by -2, 1 and 4 times their angle. Not quite reciprocal, as the paper's.

use super::{BsdfSample, fresnel_dielectric};
use crate::math::{
    INV_2PI, ONE_MINUS_EPSILON, PI, Rgb, TWO_PI, asin, atan2, exp, ln, luminance, safe_sqrt,
    sin_cos_2pi, sqr,
};
use glam::{Vec2, Vec3};

/// Lobes: R, TT, TRT, and everything after.
const LOBES: usize = 4;
/// Smoother fibres cannot be told from these, and would have no digits left.
const BETA_MIN: f32 = 0.05;

/// A fibre at a point across it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Hair {
    h: f32,
    eta: f32,
    /// Absorption per radius.
    sigma_a: Rgb,
    /// Longitudinal variance of R.
    v: f32,
    /// Azimuthal scale of the logistic.
    s: f32,
    /// Sine of the scales' tilt.
    tilt: f32,
}

/// What follows from the view direction.
struct View {
    sin: f32,
    cos: f32,
    phi: f32,
    gamma_o: f32,
    gamma_t: f32,
    /// Attenuation of each lobe.
    a: [Rgb; LOBES],
    /// Their probabilities.
    p: [f32; LOBES],
}

/// x^n by repeated multiplication.
fn power(x: f32, n: u32) -> f32 {
    (0..n).fold(1.0, |y, _| y * x)
}

impl Hair {
    /// With the place across, the index of refraction, the absorption per radius, the longitudinal and
    /// azimuthal roughness in [0, 1] and the tilt of the scales in degrees.
    pub fn new(h: f32, eta: f32, sigma_a: Rgb, beta_m: f32, beta_n: f32, tilt: f32) -> Hair {
        let m = beta_m.clamp(BETA_MIN, 1.0);
        let n = beta_n.clamp(BETA_MIN, 1.0);
        Hair {
            h: h.clamp(-0.999_9, 0.999_9),
            eta: eta.max(1.0001),
            sigma_a: sigma_a.max(Rgb::ZERO),
            // The paper's fits of perceptually uniform roughness.
            v: sqr(0.726 * m + 0.812 * m * m + 3.7 * power(m, 20)),
            s: 0.626_657_07 * (0.265 * n + 1.194 * n * n + 5.372 * power(n, 22)),
            tilt: crate::math::sin_cos_2pi((tilt.abs().min(45.0)) / 360.0)
                .0
                .copysign(tilt),
        }
    }

    /// Absorption per radius of hair whose mass shows this colour, for an azimuthal roughness: the paper's
    /// fit.
    pub fn absorption_of(color: Rgb, beta_n: f32) -> Rgb {
        let b = beta_n.clamp(BETA_MIN, 1.0);
        let fit = 5.969 - 0.215 * b + 2.532 * b * b - 10.73 * power(b, 3)
            + 5.574 * power(b, 4)
            + 0.245 * power(b, 5);
        let one = |c: f32| sqr(ln(c.clamp(1e-4, 1.0)) / fit);
        Rgb::new(one(color.x), one(color.y), one(color.z))
    }

    /// Absorption of concentrations of brown-black and red-blond pigment [DEon11].
    pub fn absorption_of_melanin(eumelanin: f32, pheomelanin: f32) -> Rgb {
        Rgb::new(0.419, 0.697, 1.37) * eumelanin.max(0.0)
            + Rgb::new(0.187, 0.4, 1.05) * pheomelanin.max(0.0)
    }

    /// Longitudinal variance of a lobe.
    #[inline]
    fn variance(&self, lobe: usize) -> f32 {
        match lobe {
            0 => self.v,
            1 => 0.25 * self.v,
            _ => 4.0 * self.v,
        }
    }

    fn view(&self, wo: Vec3) -> View {
        let sin = wo.x.clamp(-1.0, 1.0);
        let cos = safe_sqrt(1.0 - sin * sin);
        // The ray inside: Snell along the strand, and across it with the index as it looks from there.
        let sin_t = sin / self.eta;
        let cos_t = safe_sqrt(1.0 - sin_t * sin_t);
        let across = safe_sqrt(self.eta * self.eta - sin * sin) / cos.max(1e-6);
        let sin_gamma = self.h / across;
        let cos_gamma = safe_sqrt(1.0 - sin_gamma * sin_gamma);
        let way = 2.0 * cos_gamma / cos_t.max(1e-6);
        let through = crate::medium::beer(self.sigma_a, way);
        let (f, _) = fresnel_dielectric(cos * safe_sqrt(1.0 - self.h * self.h), self.eta);
        let mut a = [Rgb::splat(f); LOBES];
        a[1] = through * sqr(1.0 - f);
        a[2] = a[1] * through * f;
        a[3] = a[2] * through * f / (Rgb::ONE - through * f).max(Rgb::splat(1e-6));
        let weights = a.map(|a| luminance(a).max(0.0));
        let sum: f32 = weights.iter().sum();
        View {
            sin,
            cos,
            phi: atan2(wo.z, wo.y),
            gamma_o: asin(self.h),
            gamma_t: asin(sin_gamma.clamp(-1.0, 1.0)),
            a,
            p: weights.map(|w| w / sum.max(1e-20)),
        }
    }

    /// Sine and cosine of the view's angle to the strand, turned by the scales for a lobe.
    #[inline]
    fn tilted(&self, view: &View, lobe: usize) -> (f32, f32) {
        // Sines and cosines of 1, 2, 4 times the tilt.
        let s1 = self.tilt;
        let c1 = safe_sqrt(1.0 - s1 * s1);
        let (s2, c2) = (2.0 * s1 * c1, c1 * c1 - s1 * s1);
        let (s4, c4) = (2.0 * s2 * c2, c2 * c2 - s2 * s2);
        let (s, c) = match lobe {
            0 => (-s2, c2),
            1 => (s1, c1),
            2 => (s4, c4),
            _ => (0.0, 1.0),
        };
        let sin = view.sin * c + view.cos * s;
        // Past the pole the angle comes back on the other side.
        (sin, (view.cos * c - view.sin * s).abs())
    }

    /// Where a lobe points to around the strand, relative to the view.
    #[inline]
    fn center(view: &View, lobe: usize) -> f32 {
        2.0 * lobe as f32 * view.gamma_t - 2.0 * view.gamma_o + lobe as f32 * PI
    }

    pub(super) fn eval_pdf(&self, wo: Vec3, wi: Vec3) -> (Rgb, f32) {
        let view = self.view(wo);
        let sin_i = wi.x.clamp(-1.0, 1.0);
        let cos_i = safe_sqrt(1.0 - sin_i * sin_i);
        let phi = atan2(wi.z, wi.y) - view.phi;
        let mut f = Rgb::ZERO;
        let mut pdf = 0.0;
        for lobe in 0..LOBES {
            let (sin_o, cos_o) = self.tilted(&view, lobe);
            let m = longitudinal(cos_i, cos_o, sin_i, sin_o, self.variance(lobe));
            let n = if lobe + 1 < LOBES {
                trimmed(wrapped(phi - Self::center(&view, lobe)), self.s)
            } else {
                INV_2PI
            };
            f += view.a[lobe] * (m * n);
            pdf += view.p[lobe] * (m * n);
        }
        (f, pdf)
    }

    pub(super) fn sample(&self, wo: Vec3, u_lobe: f32, u: Vec2) -> Option<BsdfSample> {
        let view = self.view(wo);
        let mut lobe = 0;
        let mut rest = u_lobe;
        while lobe + 1 < LOBES && rest >= view.p[lobe] {
            rest -= view.p[lobe];
            lobe += 1;
        }
        // What the choice leaves of the number places the direction around the strand.
        let rest = (rest / view.p[lobe].max(1e-20)).clamp(0.0, ONE_MINUS_EPSILON);
        let (sin_o, cos_o) = self.tilted(&view, lobe);
        let v = self.variance(lobe);
        let cos = 1.0 + v * ln(u.x.max(1e-7) + (1.0 - u.x) * exp(-2.0 / v));
        let sin = safe_sqrt(1.0 - cos * cos);
        let (_, turn) = sin_cos_2pi(u.y);
        let sin_i = (-cos * sin_o + sin * turn * cos_o).clamp(-1.0, 1.0);
        let cos_i = safe_sqrt(1.0 - sin_i * sin_i);
        let around = if lobe + 1 < LOBES {
            Self::center(&view, lobe) + sample_trimmed(rest, self.s)
        } else {
            TWO_PI * rest
        };
        let turns = (view.phi + around) * INV_2PI;
        let (z, y) = sin_cos_2pi(turns - turns.floor());
        let wi = Vec3::new(sin_i, cos_i * y, cos_i * z);
        let (f, pdf) = self.eval_pdf(wo, wi);
        if !(pdf > 0.0 && pdf.is_finite()) {
            return None;
        }
        Some(BsdfSample {
            wi,
            weight: f * (1.0 / pdf),
            pdf,
            eta: 1.0,
            delta: false,
            transmitted: wi.z * wo.z < 0.0,
        })
    }

    /// Everything that is not absorbed.
    pub(super) fn albedo(&self, wo: Vec3) -> Rgb {
        self.view(wo).a.iter().fold(Rgb::ZERO, |sum, a| sum + *a)
    }
}

/// The longitudinal lobe [DEon11]: exp(-sin sin / v) I0(cos cos / v) / (2 v sinh(1 / v)), which integrates
/// to 1 over the sphere for each turn around the strand.
fn longitudinal(cos_i: f32, cos_o: f32, sin_i: f32, sin_o: f32, v: f32) -> f32 {
    let a = cos_i * cos_o / v;
    let b = sin_i * sin_o / v;
    if v <= 0.1 {
        // sinh(1/v) = exp(1/v) / 2 here, and everything goes into one exponential.
        exp(ln_bessel(a) - b - 1.0 / v) / v
    } else {
        let e = exp(1.0 / v);
        exp(-b) * bessel(a) / (v * (e - 1.0 / e))
    }
}

/// I0 by its series; the argument is at most 10.
fn bessel(x: f32) -> f32 {
    let q = 0.25 * x * x;
    let mut term = 1.0;
    let mut sum = 1.0;
    for i in 1..24 {
        term *= q / (i * i) as f32;
        sum += term;
    }
    sum
}

/// ln I0, asymptotic for large arguments.
fn ln_bessel(x: f32) -> f32 {
    if x > 12.0 {
        let r = 1.0 / (8.0 * x);
        // 1 + 1/8x + 9/128x^2 + 225/3072x^3 ...
        let tail = 1.0 + r * (1.0 + r * (4.5 + r * 37.5));
        x - 0.5 * ln(TWO_PI * x) + ln(tail)
    } else {
        ln(bessel(x))
    }
}

/// An angle in [-pi, pi].
#[inline]
fn wrapped(x: f32) -> f32 {
    let turns = x * INV_2PI;
    x - TWO_PI * (turns + 0.5).floor()
}

/// Distribution function of the logistic.
#[inline]
fn logistic(x: f32, s: f32) -> f32 {
    1.0 / (1.0 + exp(-x / s))
}

/// Density of the logistic cut to [-pi, pi].
#[inline]
fn trimmed(x: f32, s: f32) -> f32 {
    let e = exp(-x.abs() / s);
    let whole = 2.0 * logistic(PI, s) - 1.0;
    e / (s * sqr(1.0 + e) * whole)
}

/// An angle from [`trimmed`].
#[inline]
fn sample_trimmed(u: f32, s: f32) -> f32 {
    let low = logistic(-PI, s);
    // Half of it, mirrored: near 0 numbers are dense, near 1 they are not.
    let (half, side) = if u < 0.5 { (u, 1.0) } else { (1.0 - u, -1.0) };
    let c = (low + half * (1.0 - 2.0 * low)).max(1e-30);
    let x = s * ln(c / (1.0 - c).max(1e-30));
    side * x.clamp(-PI, PI)
}
