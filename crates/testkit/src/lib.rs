//! Statistics for tests of samplers and estimators: does a sampler follow its density
//! ([`chi2`]), does a mean agree with a known value ([`ttest`], [`ztest`])? All sizes and seeds are
//! fixed by the caller, so a test gives the same answer every time.
//!
//! ```
//! // Cosine-weighted directions against their density.
//! let density = |w: [f32; 3]| f64::from(w[2].max(0.0)) / std::f64::consts::PI;
//! let sample = |rng: &mut testkit::TestRng| {
//!     let ([u, v], two_pi) = (rng.u2(), std::f32::consts::TAU);
//!     let r = u.sqrt();
//!     Some([r * (two_pi * v).cos(), r * (two_pi * v).sin(), (1.0 - u).sqrt()])
//! };
//! testkit::chi2::SphereTest::default().run(1, sample, density).unwrap();
//! ```

pub mod chi2;
mod moments;
mod quadrature;
mod rng;
pub mod special;
pub mod ttest;
pub mod ztest;

pub use moments::Moments;
pub use quadrature::{sphere_integral, sphere_integral_about};
pub use rng::TestRng;

/// Level for each of `tests` independent tests so that all together fail by chance with probability
/// `level` (Sidak's correction).
pub fn sidak(level: f64, tests: usize) -> f64 {
    // 1 - (1 - level)^(1 / tests) without cancellation.
    -((-level).ln_1p() / tests.max(1) as f64).exp_m1()
}

#[cfg(test)]
mod tests;
