//! Flights through a medium: to the next scattering event, or past it.
//!
//! Colours share one path. What it would have been worth to choose it for each channel is carried along, and
//! every contribution is divided by the mean of the three (spectral multiple importance sampling in
//! the space of null collisions, [Miller19], [Wilkie14], in the form of [PharrJakobHumphreys23, section
//! 14.2]): the channel whose densities drive the choice is drawn once for a path.
//!
//! A homogeneous medium is flown in one step, with the density of [`super::rate`] and light of its own in
//! closed form; a grid by delta tracking [Woodcock65] against one bound for all channels, so that free
//! paths between tentative collisions are the same for all of them and only what happens there differs.
//! Shadow rays use Beer's law and ratio tracking [Novak14].

use super::{Coefficients, Medium, beer, rate};
use crate::math::{Rgb, ln, mean};
use crate::sampler::FlightNumbers;
use glam::Vec3;

/// What a path carries. All three may be multiplied by one factor without changing a contribution.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Carried {
    /// Product of everything met over the density with which the path was drawn.
    pub beta: Rgb,
    /// Density by channel of drawing the path as it was drawn, over the real one.
    pub unidirectional: Rgb,
    /// Density by channel of drawing its last direction by sampling lights, but for the light's own density.
    pub light: Rgb,
}

impl Carried {
    /// At the camera.
    pub const START: Carried = Carried {
        beta: Rgb::ONE,
        unidirectional: Rgb::ONE,
        light: Rgb::ONE,
    };

    /// Makes `beta` what a contribution is multiplied by, and keeps all numbers in range.
    #[inline]
    pub fn normalize(&mut self) {
        let scale = 1.0 / mean(self.unidirectional);
        self.beta *= scale;
        self.unidirectional *= scale;
        self.light *= scale;
    }
}

/// How a flight ends.
pub enum Flight {
    /// It reaches the end.
    Passed,
    /// It meets something that scatters.
    Scattered {
        /// How far.
        distance: f32,
        /// Coefficients there.
        at: Coefficients,
    },
    /// Nothing is left of it.
    Ended,
}

/// Tentative collisions of one flight at most: a bound against hopeless input, far beyond what is seen.
const COLLISIONS_MAX: u32 = 1 << 17;

/// Length of a flight with this rate.
#[inline]
fn exponential(u: f32, rate: f32) -> f32 {
    -ln(1.0 - u) / rate
}

/// Follows a ray (`d` of unit length) through a medium up to `end`; adds the medium's own light, weighted,
/// to `radiance`. `hero` is the channel that decides.
#[inline]
pub fn fly(
    medium: &Medium,
    hero: usize,
    (o, d): (Vec3, Vec3),
    end: f32,
    numbers: &mut FlightNumbers,
    carried: &mut Carried,
    radiance: &mut Rgb,
) -> Flight {
    match &medium.grid {
        None => fly_homogeneous(&medium.constant(), hero, end, numbers, carried, radiance),
        Some(grid) => {
            let whole = medium.constant();
            let mut collisions = 0;
            for stretch in grid.walk(o, d, end) {
                if stretch.bound <= 0.0 {
                    continue;
                }
                let mut t = stretch.from;
                loop {
                    t += exponential(numbers.next_number(), stretch.bound);
                    // NaN and infinity go on with the next stretch.
                    let inside = t < stretch.to;
                    if !inside {
                        break;
                    }
                    collisions += 1;
                    if collisions > COLLISIONS_MAX {
                        return Flight::Ended;
                    }
                    let at = grid.at(o + d * t, &whole);
                    if let Some(end) =
                        collide(&at, t, stretch.bound, hero, numbers, carried, radiance)
                    {
                        return end;
                    }
                }
            }
            Flight::Passed
        }
    }
}

/// One tentative collision in a grid; `None` if it is none.
#[inline]
fn collide(
    at: &Coefficients,
    distance: f32,
    bound: f32,
    hero: usize,
    numbers: &mut FlightNumbers,
    carried: &mut Carried,
    radiance: &mut Rgb,
) -> Option<Flight> {
    let inv = 1.0 / bound;
    if at.emission != Rgb::ZERO {
        *radiance += carried.beta * at.a * at.emission * (inv / mean(carried.unidirectional));
    }
    let scatter = (rate(at) * inv).min(Rgb::ONE);
    let p = scatter[hero];
    if numbers.next_number() < p {
        carried.beta *= at.s * (inv / p);
        carried.unidirectional *= scatter / p;
        return Some(Flight::Scattered { distance, at: *at });
    }
    let q = 1.0 - p;
    carried.beta *= (Rgb::ONE - at.t() * inv).max(Rgb::ZERO) / q;
    carried.unidirectional *= (Rgb::ONE - scatter) / q;
    carried.light *= 1.0 / q;
    (carried.beta == Rgb::ZERO).then_some(Flight::Ended)
}

#[inline]
fn fly_homogeneous(
    c: &Coefficients,
    hero: usize,
    end: f32,
    numbers: &mut FlightNumbers,
    carried: &mut Carried,
    radiance: &mut Rgb,
) -> Flight {
    let extinction = c.t();
    if c.emission != Rgb::ZERO {
        // a e times the integral of exp(-t s) over the way to the end.
        let way = |t: f32| {
            let x = t * end;
            if x > 1e-3 {
                (1.0 - crate::math::exp(-x)) / t
            } else {
                end * (1.0 - 0.5 * x)
            }
        };
        let ways = Rgb::new(way(extinction.x), way(extinction.y), way(extinction.z));
        let own = carried.beta * c.a * c.emission * ways;
        *radiance += own * (1.0 / mean(carried.unidirectional));
    }
    let rates = rate(c);
    let r = rates[hero];
    let t = if r > 0.0 {
        exponential(numbers.next_number(), r)
    } else {
        f32::INFINITY
    };
    let reached = t.min(end);
    // Everything over the real density exp(-r t), which cancels where the channels agree.
    carried.beta *= beer(extinction - Rgb::splat(r), reached);
    carried.unidirectional *= beer(rates - Rgb::splat(r), reached);
    if t < end {
        carried.beta *= c.s / r;
        carried.unidirectional *= rates / r;
        Flight::Scattered {
            distance: t,
            at: *c,
        }
    } else {
        carried.light *= crate::math::exp(r * reached);
        if carried.beta == Rgb::ZERO {
            Flight::Ended
        } else {
            Flight::Passed
        }
    }
}

/// What a shadow ray carries.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Shadow {
    /// Transmittance.
    pub through: Rgb,
    /// Density by channel of flying this way without scattering, over that of the shadow ray.
    pub unidirectional: Rgb,
}

impl Shadow {
    /// Nothing in the way yet.
    pub const START: Shadow = Shadow {
        through: Rgb::ONE,
        unidirectional: Rgb::ONE,
    };
}

/// Below this a shadow ray ends by chance.
const FAINT: f32 = 0.05;

/// Attenuates a shadow ray (`d` of unit length) over a distance.
#[inline]
pub fn shadow(
    medium: &Medium,
    (o, d): (Vec3, Vec3),
    end: f32,
    numbers: &mut FlightNumbers,
    carried: &mut Shadow,
) {
    let whole = medium.constant();
    let Some(grid) = &medium.grid else {
        carried.through *= beer(whole.t(), end);
        carried.unidirectional *= beer(rate(&whole), end);
        return;
    };
    let mut collisions = 0;
    for stretch in grid.walk(o, d, end) {
        if stretch.bound <= 0.0 {
            continue;
        }
        let inv = 1.0 / stretch.bound;
        let mut t = stretch.from;
        loop {
            t += exponential(numbers.next_number(), stretch.bound);
            let inside = t < stretch.to;
            if !inside {
                break;
            }
            let at = grid.at(o + d * t, &whole);
            carried.through *= (Rgb::ONE - at.t() * inv).max(Rgb::ZERO);
            carried.unidirectional *= Rgb::ONE - (rate(&at) * inv).min(Rgb::ONE);
            collisions += 1;
            if carried.through == Rgb::ZERO || collisions > COLLISIONS_MAX {
                carried.through = Rgb::ZERO;
                return;
            }
            if carried.through.max_element() < FAINT {
                if numbers.next_number() < 0.75 {
                    carried.through = Rgb::ZERO;
                    return;
                }
                carried.through *= 4.0;
            }
        }
    }
}
