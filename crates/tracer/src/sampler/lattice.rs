//! An embedded lattice sequence: at every power of two the points are a rank-1 lattice with a random
//! shift [CoolsKuoNuyens06], so that a picture may be extended without end and without knowing its
//! total.
//!
//! Point i is frac(phi(i) z + shift), with phi the radical inverse in base 2 and z a vector of odd
//! integers. Eight dimensions cost one multiplication each. The camera and the first two scattering
//! events share the order of the points, so that their dimensions are one lattice; every later event
//! takes the points in an order of its own, scrambled as in [Burley20] so that each aligned block of
//! 2^m indices stays such a block (and its points a shifted lattice).

use super::sobol::{owen, owen_in_lanes};
use super::to_unit;
use crate::hash;
use crate::lanes::{Float, Int, Wide};

/// Dimensions of the camera: point of the pixel, point of the lens, moment.
const CAMERA: usize = 5;
/// Dimensions of a scattering event.
const EVENT: usize = 8;
/// Events that share the order of the points with the camera.
const JOINT: u32 = 2;

/// The generating vector: camera, then two events (light, direction, choice of light, lobe, roulette,
/// mix), of which later ones take the first.
///
/// Found component by component: for every power of two up to 2^12 all odd candidates were tried, with
/// the sum of squares of P2 (the worst-case error over functions with square-integrable mixed
/// derivatives [SloanJoe94]) of each two-dimensional projection over the best that two dimensions can
/// have. Pairs that are the two coordinates of one decision weigh 1, a choice and what it chooses .6,
/// other pairs of one event .3, of different ones .15; but those of the first direction and of what is
/// done where it leads (light and direction of the second event) 1. The second event was found after
/// the others. Higher bits, up to 2^20, were chosen one by one the same way.
pub(super) const VECTOR: [u32; CAMERA + JOINT as usize * EVENT] = [
    1, 676_261, 988_099, 844_985, 570_957, // camera
    123_475, 82_281, 610_741, 950_993, 743_073, 385_157, 439_659, 30_473, // first event
    755_581, 852_519, 259_927, 578_993, 901_819, 1_000_819, 643_615, 46_063, // second event
];

/// What tells one event of a pixel from another: the same for all samples.
#[derive(Clone, Copy, Debug, Default)]
pub struct Keys {
    /// Order of the points.
    pub order: u32,
    /// Shift of each dimension.
    pub shift: [u32; EVENT],
}

impl Keys {
    /// From the hash of seed, frame, pixel and dimension.
    #[inline(always)]
    pub fn new(key: u64) -> Keys {
        let mut shift = [0; EVENT];
        for j in 0..EVENT / 2 {
            let both = hash::mix(key ^ (j as u64 + 1) << 56);
            shift[2 * j] = both as u32;
            shift[2 * j + 1] = (both >> 32) as u32;
        }
        Keys {
            order: key as u32,
            shift,
        }
    }
}

/// Pixels whose keys are made together.
pub const TOGETHER: usize = 8;

/// [`Keys::new`] of several at once, which the compiler makes side by side.
#[inline(always)]
pub fn keys_of(keys: [u64; TOGETHER]) -> [Keys; TOGETHER] {
    let mut made = [Keys::default(); TOGETHER];
    for j in 0..EVENT / 2 {
        let mut both = [0; TOGETHER];
        for at in 0..TOGETHER {
            both[at] = hash::mix(keys[at] ^ (j as u64 + 1) << 56);
        }
        for at in 0..TOGETHER {
            made[at].shift[2 * j] = both[at] as u32;
            made[at].shift[2 * j + 1] = (both[at] >> 32) as u32;
        }
    }
    for at in 0..TOGETHER {
        made[at].order = keys[at] as u32;
    }
    made
}

/// Numbers of the camera. `reversed` is the sample index with its bits in reverse order.
#[inline(always)]
pub fn camera(reversed: u32, keys: &Keys) -> [f32; CAMERA] {
    std::array::from_fn(|j| point(reversed, VECTOR[j], keys.shift[j]))
}

/// Numbers of a scattering event; `joint` with those of the camera.
#[inline(always)]
pub fn event(reversed: u32, keys: &Keys, nth: u32) -> [f32; EVENT] {
    let (phi, from) = if nth < JOINT {
        (reversed, CAMERA + nth as usize * EVENT)
    } else {
        (owen(reversed, keys.order), CAMERA)
    };
    std::array::from_fn(|j| point(phi, VECTOR[from + j], keys.shift[j]))
}

/// [`camera`] for a sample a lane, as [`event_in_lanes`].
#[inline(always)]
pub fn camera_in_lanes<W: Wide<N>, const N: usize>(
    reversed: W::I,
    shifts: [W::F; EVENT],
) -> [W::F; CAMERA] {
    let mut numbers = [shifts[0]; CAMERA];
    for j in 0..CAMERA {
        numbers[j] = point_in_lanes::<W, N>(reversed, VECTOR[j], shifts[j]);
    }
    numbers
}

/// [`event`] for a sample a lane, each with its keys: `shifts` are the bits of one dimension's shifts
/// after another's.
#[inline(always)]
pub fn event_in_lanes<W: Wide<N>, const N: usize>(
    reversed: W::I,
    orders: W::I,
    shifts: [W::F; EVENT],
    nth: u32,
) -> [W::F; EVENT] {
    let (phi, from) = if nth < JOINT {
        (reversed, CAMERA + nth as usize * EVENT)
    } else {
        (owen_in_lanes::<W, N>(reversed, orders), CAMERA)
    };
    let mut numbers = shifts;
    for j in 0..EVENT {
        numbers[j] = point_in_lanes::<W, N>(phi, VECTOR[from + j], shifts[j]);
    }
    numbers
}

/// [`point`] in lanes.
#[inline(always)]
fn point_in_lanes<W: Wide<N>, const N: usize>(phi: W::I, z: u32, shift: W::F) -> W::F {
    let bits = phi * W::I::splat(z) + shift.bits();
    W::F::from_int(bits.shr::<8>()) * W::F::splat(1.0 / 16_777_216.0)
}

/// Coordinate of a lattice point.
#[inline(always)]
pub(super) fn point(phi: u32, z: u32, shift: u32) -> f32 {
    to_unit(phi.wrapping_mul(z).wrapping_add(shift))
}
