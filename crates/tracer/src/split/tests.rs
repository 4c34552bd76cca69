use super::*;
use proptest::prelude::*;

fn some_splits(width: u32, height: u32, side: u32) -> Splits {
    let columns = width.div_ceil(side);
    let count = columns * height.div_ceil(side);
    Splits {
        side,
        columns,
        of: (0..count).map(|i| CHOICES[i as usize % 3] as u8).collect(),
    }
}

proptest! {
    /// Every pixel of a rectangle is in one part, which says what the pixel's place in the whole picture says.
    #[test]
    fn parts_cover_rectangles(
        (width, height) in (1u32..200, 1u32..200),
        corner in (0.0f64..1.0, 0.0f64..1.0),
        size in (0.0f64..1.0, 0.0f64..1.0),
        side in 7u32..64,
    ) {
        let splits = some_splits(width, height, side);
        let begin = [(corner.0 * f64::from(width)) as u32, (corner.1 * f64::from(height)) as u32];
        let end = [
            begin[0] + 1 + (size.0 * f64::from(width - begin[0] - 1)) as u32,
            begin[1] + 1 + (size.1 * f64::from(height - begin[1] - 1)) as u32,
        ];
        let mut seen = vec![0u32; (width * height) as usize];
        for part in splits.parts(begin, end) {
            for y in part.begin[1]..part.end[1] {
                for x in part.begin[0]..part.end[0] {
                    let of = splits.of[(y / side * splits.columns + x / side) as usize];
                    prop_assert_eq!(u32::from(of), part.split);
                    seen[(y * width + x) as usize] += 1;
                }
            }
        }
        for y in 0..height {
            for x in 0..width {
                let inside = x >= begin[0] && x < end[0] && y >= begin[1] && y < end[1];
                prop_assert_eq!(seen[(y * width + x) as usize], u32::from(inside), "{} {}", x, y);
            }
        }
    }

    /// No other choice for a few parts is clearly better than the one found.
    #[test]
    fn finds_the_least_product(
        of in prop::collection::vec((0.0f64..1.0, 0.0f64..1.0, 0.5f64..2.0, 1.0f64..4.0), 1..6),
    ) {
        let trials: Vec<Trial> = (of.iter())
            .map(|(one, falls, rays, times)| Trial {
                variance: [*one, one * falls],
                rays: [*rays, rays * times],
            })
            .collect();
        let product = |chosen: &[usize]| {
            let (mut variance, mut rays) = (0.0, 0.0);
            for (trial, c) in trials.iter().zip(chosen) {
                variance += trial.of_choices()[*c].0;
                rays += trial.of_choices()[*c].1;
            }
            variance * rays
        };
        let found = product(&best(&trials));
        let count = CHOICES.len().pow(trials.len() as u32);
        for mut code in 0..count {
            let chosen: Vec<usize> = (0..trials.len())
                .map(|_| {
                    let c = code % CHOICES.len();
                    code /= CHOICES.len();
                    c
                })
                .collect();
            prop_assert!(found <= product(&chosen) * 1.1, "{:?}: {}, {:?}", trials, found, chosen);
        }
    }
}

/// Where several paths do not help, there is one; where they do and cost little, there are most.
#[test]
fn goes_by_variance_and_cost() {
    let lens = Trial {
        variance: [1.0, 0.98],
        rays: [3.0, 9.0],
    };
    let behind = Trial {
        variance: [1.0, 0.25],
        rays: [3.0, 9.0],
    };
    assert_eq!(best(&[lens; 5]), [0; 5]);
    assert_eq!(best(&[behind; 5]), [2; 5]);
    // Beside parts that make little noise whatever is done.
    let quiet = Trial {
        variance: [0.1, 0.098],
        ..lens
    };
    assert_eq!(best(&[quiet, behind, quiet, behind]), [0, 2, 0, 2]);
    // Nothing to see.
    assert_eq!(best(&[Trial::default(); 3]), [0; 3]);
}
