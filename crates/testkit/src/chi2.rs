//! Pearson's chi-square test: does a sampler follow its density?

use crate::quadrature::{adaptive, direction, frame};
use crate::{TestRng, sidak, special};
use std::f64::consts::PI;
use std::fmt;

/// Outcome of a comparison of counts.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Chi2 {
    /// Sum of (observed - expected)^2 / expected.
    pub statistic: f64,
    /// Degrees of freedom.
    pub dof: usize,
    /// Probability of at least this statistic if the sampler is right.
    pub p: f64,
}

/// Compares counts with expected counts of the same sum. Cells with an expectation below 5 are pooled
/// from the smallest up, cells where nothing is expected too.
pub fn compare(observed: &[u64], expected: &[f64]) -> Chi2 {
    assert_eq!(observed.len(), expected.len());
    let mut order: Vec<usize> = (0..expected.len()).collect();
    order.sort_by(|&a, &b| expected[a].total_cmp(&expected[b]));
    let (mut statistic, mut cells) = (0.0, 0usize);
    let (mut pool_observed, mut pool_expected) = (0.0, 0.0);
    let mut add = |o: f64, e: f64| {
        statistic += (o - e) * (o - e) / e;
        cells += 1;
    };
    for i in order {
        let (o, e) = (observed[i] as f64, expected[i]);
        if !e.is_finite() {
            return Chi2 {
                statistic: f64::INFINITY,
                dof: 0,
                p: 0.0,
            };
        }
        if e < 5.0 || (pool_observed + pool_expected > 0.0 && pool_expected < 5.0) {
            pool_observed += o;
            pool_expected += e;
        } else {
            add(o, e);
        }
    }
    if pool_expected >= 0.5 {
        add(pool_observed, pool_expected);
    } else if pool_observed > 8.0 {
        // Next to nothing is expected, and yet there is something.
        add(pool_observed, 0.5);
    }
    let dof = cells.saturating_sub(1);
    let p = if dof > 0 {
        special::chi2_survival(statistic, dof)
    } else {
        1.0
    };
    Chi2 { statistic, dof, p }
}

/// A test of sampled directions. Cells are rings about `axis` cut into sectors; samples that the sampler
/// loses are a cell of their own, expected to hold what the density lacks to 1.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SphereTest {
    /// Pole of the grid: the direction where the density peaks.
    pub axis: [f32; 3],
    /// Rings; ring i ends at the angle pi ((i + 1) / rings)^power.
    pub rings: usize,
    /// 1 for rings of equal width; more makes them narrow about the axis.
    pub power: i32,
    /// Sectors of a ring.
    pub sectors: usize,
    /// Samples drawn.
    pub samples: usize,
    /// Probability of failing by chance, for all `tests` together.
    pub level: f64,
    /// How many such tests are made.
    pub tests: usize,
}

impl Default for SphereTest {
    fn default() -> Self {
        SphereTest {
            axis: [0.0, 0.0, 1.0],
            rings: 12,
            power: 1,
            sectors: 16,
            samples: 100_000,
            level: 0.01,
            tests: 1,
        }
    }
}

/// Counts and expectations that do not agree.
#[derive(Clone, Debug, PartialEq)]
pub struct Disagreement {
    /// Statistic and p-value.
    pub chi2: Chi2,
    /// Level that p had to reach.
    pub level: f64,
    /// Sectors of a row of the histograms.
    pub sectors: usize,
    /// Samples by ring and sector, the lost ones last.
    pub observed: Vec<u64>,
    /// What the density gives.
    pub expected: Vec<f64>,
}

impl fmt::Display for Disagreement {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Chi2 { statistic, dof, p } = self.chi2;
        writeln!(
            f,
            "chi-square {statistic:.1} with {dof} degrees of freedom: p = {p:.2e} < {:.2e}",
            self.level
        )?;
        let cells = self.observed.len() - 1;
        writeln!(
            f,
            "lost: {} seen, {:.1} expected",
            self.observed[cells], self.expected[cells]
        )?;
        for (title, show) in [
            (
                "seen",
                &(|i| format!("{}", self.observed[i])) as &dyn Fn(usize) -> String,
            ),
            ("expected", &|i| format!("{:.0}", self.expected[i])),
        ] {
            writeln!(f, "{title}, a ring a line:")?;
            for row in (0..cells).step_by(self.sectors) {
                for i in row..row + self.sectors {
                    write!(f, "{:>7}", show(i))?;
                }
                writeln!(f)?;
            }
        }
        Ok(())
    }
}

impl std::error::Error for Disagreement {}

impl SphereTest {
    /// Draws with `sample` (`None` is a lost sample) and compares with `pdf`, a density per solid angle.
    pub fn run(
        &self,
        seed: u64,
        mut sample: impl FnMut(&mut TestRng) -> Option<[f32; 3]>,
        mut pdf: impl FnMut([f32; 3]) -> f64,
    ) -> Result<Chi2, Box<Disagreement>> {
        let frame = frame(self.axis.map(f64::from));
        let cells = self.rings * self.sectors;
        let mut observed = vec![0u64; cells + 1];
        let mut rng = TestRng::new(seed);
        for _ in 0..self.samples {
            let cell = sample(&mut rng).map_or(cells, |w| self.cell(&frame, w));
            observed[cell] += 1;
        }
        let edge = |i: usize| PI * (i as f64 / self.rings as f64).powi(self.power);
        let mut density = |theta: f64, phi: f64| pdf(direction(&frame, theta, phi)) * theta.sin();
        let mut expected = vec![0.0; cells + 1];
        let mut total = 0.0;
        for ring in 0..self.rings {
            for sector in 0..self.sectors {
                let width = 2.0 * PI / self.sectors as f64;
                let phi = width * sector as f64;
                // A tenth of a sample is well below the noise of any cell.
                let tolerance = 0.1 / self.samples as f64;
                let p = adaptive(
                    &mut density,
                    (edge(ring), edge(ring + 1)),
                    (phi, phi + width),
                    tolerance,
                    6,
                );
                expected[ring * self.sectors + sector] = p * self.samples as f64;
                total += p;
            }
        }
        // Quadrature may exceed 1 by a hair; more than that must show.
        expected[cells] = ((1.0 - total) * self.samples as f64).max(0.0);
        let chi2 = if total > 1.002 {
            Chi2 {
                statistic: f64::INFINITY,
                dof: 0,
                p: 0.0,
            }
        } else {
            if expected[cells] < 0.5 && observed[cells] == 0 {
                expected[cells] = 0.0;
            }
            compare(&observed, &expected)
        };
        let level = sidak(self.level, self.tests);
        if chi2.p >= level {
            Ok(chi2)
        } else {
            Err(Box::new(Disagreement {
                chi2,
                level,
                sectors: self.sectors,
                observed,
                expected,
            }))
        }
    }

    fn cell(&self, frame: &[[f64; 3]; 3], w: [f32; 3]) -> usize {
        let w = w.map(f64::from);
        let dot = |a: &[f64; 3]| a[0] * w[0] + a[1] * w[1] + a[2] * w[2];
        let (x, y, z) = (dot(&frame[0]), dot(&frame[1]), dot(&frame[2]));
        let theta = (x * x + y * y).sqrt().atan2(z);
        let phi = y.atan2(x);
        let phi = if phi < 0.0 { phi + 2.0 * PI } else { phi };
        let t = (theta / PI).powf(1.0 / f64::from(self.power));
        let ring = ((t * self.rings as f64) as usize).min(self.rings - 1);
        let sector = ((phi / (2.0 * PI) * self.sectors as f64) as usize).min(self.sectors - 1);
        ring * self.sectors + sector
    }
}
