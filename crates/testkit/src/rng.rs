//! Random numbers for tests.

use rand::rngs::StdRng;
use rand::{RngCore, SeedableRng};

/// Seeded uniform numbers.
#[derive(Clone, Debug)]
pub struct TestRng(StdRng);

impl TestRng {
    /// The same numbers for the same seed.
    pub fn new(seed: u64) -> Self {
        TestRng(StdRng::seed_from_u64(seed))
    }

    /// Uniform in [0, 1), a multiple of 2^-24.
    pub fn u(&mut self) -> f32 {
        (self.0.next_u32() >> 8) as f32 / 16_777_216.0
    }

    /// Two of them.
    pub fn u2(&mut self) -> [f32; 2] {
        let bits = self.0.next_u64();
        let scale = |b: u32| (b >> 8) as f32 / 16_777_216.0;
        [scale(bits as u32), scale((bits >> 32) as u32)]
    }

    /// Uniform bits.
    pub fn bits(&mut self) -> u64 {
        self.0.next_u64()
    }

    /// A uniform direction.
    pub fn direction(&mut self) -> [f32; 3] {
        let [u, v] = self.u2();
        let z = 1.0 - 2.0 * u;
        let r = (1.0 - z * z).max(0.0).sqrt();
        let phi = std::f32::consts::TAU * v;
        [r * phi.cos(), r * phi.sin(), z]
    }
}
