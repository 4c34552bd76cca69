//! Owen-scrambled Sobol points, two dimensions at a time, each pair with a sequence order and a
//! scrambling of its own ("padding") [Burley20]. The hash that stands in for Owen's tree of random
//! flips is the improved one of [Vegdahl21].

use super::to_unit;
use crate::hash;
use crate::lanes::{Int, Wide};
use glam::Vec2;

/// A point of the shuffled, scrambled (0, 2)-sequence. `reversed` is the sample index with its bits
/// in reverse order.
#[inline(always)]
pub fn pair(reversed: u32, key: u64) -> Vec2 {
    let (k0, k1) = (key as u32, (key >> 32) as u32);
    // Shuffling the order: scrambling the index as if it were a coordinate. What comes out, still
    // reversed, is the first Sobol coordinate (the radical inverse) of the shuffled index.
    let x = owen(reversed, k0);
    let shuffled = x.reverse_bits();
    let y = second_dimension(shuffled);
    let x = owen(x.reverse_bits(), k1 ^ 0x68BC_21EB).reverse_bits();
    let y = owen(y, k1 ^ 0x02E5_BE93).reverse_bits();
    Vec2::new(to_unit(x), to_unit(y))
}

/// Four pairs at once, with the same numbers at every SIMD level (it is integer arithmetic). Eight
/// coordinates in lanes cost little more than one pair alone.
#[inline(always)]
pub fn four_pairs(reversed: u32, key: u64) -> [Vec2; 4] {
    let (k0, k1) = (key as u32, (key >> 32) as u32);
    let orders = lanes::<4>(k0);
    let mut shuffled = [reversed; 4];
    owen_lanes(&mut shuffled, &orders);
    reverse_lanes(&mut shuffled);
    let mut both = [0u32; 8];
    for i in 0..4 {
        both[i] = shuffled[i];
        both[i + 4] = second_dimension(shuffled[i]);
    }
    owen_lanes(&mut both, &lanes::<8>(k1));
    reverse_lanes(&mut both);
    let mut unit = [0.0f32; 8];
    for i in 0..8 {
        unit[i] = to_unit(both[i]);
    }
    [0, 1, 2, 3].map(|i| Vec2::new(unit[i], unit[i + 4]))
}

/// Keys of N lanes.
#[inline(always)]
fn lanes<const N: usize>(key: u32) -> [u32; N] {
    let mut keys = [0; N];
    for (i, k) in keys.iter_mut().enumerate() {
        *k = hash::mix32(key.wrapping_add((i as u32).wrapping_mul(0x9E37_79B9)));
    }
    keys
}

#[inline(always)]
fn owen_lanes<const N: usize>(x: &mut [u32; N], keys: &[u32; N]) {
    for i in 0..N {
        x[i] = owen(x[i], keys[i]);
    }
}

/// Reverses the bits of every lane by swapping ever larger groups: the machine's own byte swap does
/// not come in lanes everywhere.
#[inline(always)]
fn reverse_lanes<const N: usize>(x: &mut [u32; N]) {
    for v in x.iter_mut() {
        let mut y = *v;
        y = (y >> 1 & 0x5555_5555) | (y & 0x5555_5555) << 1;
        y = (y >> 2 & 0x3333_3333) | (y & 0x3333_3333) << 2;
        y = (y >> 4 & 0x0F0F_0F0F) | (y & 0x0F0F_0F0F) << 4;
        y = (y >> 8 & 0x00FF_00FF) | (y & 0x00FF_00FF) << 8;
        *v = y.rotate_left(16);
    }
}

/// Scrambles a number whose bits are reversed: each bit is flipped depending on the bits below it.
#[inline(always)]
pub(super) fn owen(x: u32, key: u32) -> u32 {
    let mut x = x;
    x ^= x.wrapping_mul(0x3D20_ADEA);
    x = x.wrapping_add(key);
    x = x.wrapping_mul((key >> 16) | 1);
    x ^= x.wrapping_mul(0x0552_6C56);
    x ^= x.wrapping_mul(0x53A2_2864);
    x
}

/// [`owen`] in lanes.
#[inline(always)]
pub(super) fn owen_in_lanes<W: Wide<N>, const N: usize>(x: W::I, key: W::I) -> W::I {
    let x = x ^ (x * W::I::splat(0x3D20_ADEA));
    let x = x + key;
    let x = x * (key.shr::<16>() | W::I::splat(1));
    let x = x ^ (x * W::I::splat(0x0552_6C56));
    x ^ (x * W::I::splat(0x53A2_2864))
}

/// The second Sobol coordinate of an index, with its bits reversed (lowest bit first): row r of the
/// generator matrix is row r of Pascal's triangle modulo 2, which factors into five shifts.
#[inline(always)]
fn second_dimension(index: u32) -> u32 {
    let mut y = index;
    y ^= (y & 0xAAAA_AAAA) >> 1;
    y ^= (y & 0xCCCC_CCCC) >> 2;
    y ^= (y & 0xF0F0_F0F0) >> 4;
    y ^= (y & 0xFF00_FF00) >> 8;
    y ^= y >> 16;
    y
}
