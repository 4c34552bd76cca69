//! Owen-scrambled Sobol points, two dimensions at a time, each pair with a sequence order and a
//! scrambling of its own ("padding") [Burley20]. The hash that stands in for Owen's tree of random
//! flips is the improved one of [Vegdahl21].

use super::to_unit;
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

/// Scrambles a number whose bits are reversed: each bit is flipped depending on the bits below it.
#[inline(always)]
fn owen(x: u32, key: u32) -> u32 {
    let mut x = x;
    x ^= x.wrapping_mul(0x3D20_ADEA);
    x = x.wrapping_add(key);
    x = x.wrapping_mul((key >> 16) | 1);
    x ^= x.wrapping_mul(0x0552_6C56);
    x ^= x.wrapping_mul(0x53A2_2864);
    x
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
