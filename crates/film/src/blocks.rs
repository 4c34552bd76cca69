//! A run of up to [`BLOCK`] integers in few bytes: the smallest of them, then the distance of each
//! from it in as many whole bytes as the largest distance needs, without the zero bits that all
//! distances end with. Noisy sums do not compress further at a useful speed (shuffle + zstd gained
//! a fifth at a tenth of the speed).
//!
//! ```text
//! width of a distance in bytes, 0 if all are equal      u8, 0 to 24
//! zero bits taken off the end of the distances          u8
//! length of the base                                    u8, 0 to 24
//! base, two's complement, least significant byte first
//! distances, least significant byte first
//! ```
//! Each field is as small as can be, and decoding insists on it: the same integers are always the
//! same bytes and no other bytes are those integers.

use crate::wide::{WIDE_BYTES, Wide};

/// Integers of a block: large enough to make little of the head, small enough to keep the widening
/// by a bright pixel local. Four rows of a tile.
pub(crate) const BLOCK: usize = 256;

/// Longest head of a block.
pub(crate) const HEAD_MAX: usize = 3 + WIDE_BYTES;

/// Writes the head of a block.
fn pack_head(width: usize, shift: u32, base: Wide, out: &mut Vec<u8>) {
    let bytes = base.to_bytes();
    let length = signed_bytes(base);
    out.extend_from_slice(&[width as u8, shift as u8, length as u8]);
    out.extend_from_slice(&bytes[..length]);
}

/// Fewest bytes that hold a signed number.
fn signed_bytes(value: Wide) -> usize {
    if value == Wide::ZERO {
        return 0;
    }
    let magnitude = if value < Wide::ZERO {
        Wide(value.0.map(|limb| !limb))
    } else {
        value
    };
    magnitude.bits() as usize / 8 + 1
}

/// Packs integers of 64 bits.
pub(crate) fn pack_i64(values: &[i64], out: &mut Vec<u8>) {
    let (mut low, mut high) = (i64::MAX, i64::MIN);
    for &value in values {
        low = low.min(value);
        high = high.max(value);
    }
    if low >= high {
        return pack_head(0, 0, Wide::from(low), out);
    }
    let mut any = 0u64;
    for &value in values {
        any |= value.wrapping_sub(low) as u64;
    }
    let shift = any.trailing_zeros();
    let bits = 64 - (high.wrapping_sub(low) as u64 >> shift).leading_zeros();
    let width = bits.div_ceil(8) as usize;
    pack_head(width, shift, Wide::from(low), out);
    let start = out.len();
    out.resize(start + values.len() * width, 0);
    let room = &mut out[start..];
    let distance = |value: i64| value.wrapping_sub(low) as u64 >> shift;
    match width {
        1 => put_u64::<1>(values, distance, room),
        2 => put_u64::<2>(values, distance, room),
        3 => put_u64::<3>(values, distance, room),
        4 => put_u64::<4>(values, distance, room),
        5 => put_u64::<5>(values, distance, room),
        6 => put_u64::<6>(values, distance, room),
        7 => put_u64::<7>(values, distance, room),
        _ => put_u64::<8>(values, distance, room),
    }
}

#[inline(always)]
fn put_u64<const W: usize>(values: &[i64], distance: impl Fn(i64) -> u64, room: &mut [u8]) {
    for (chunk, &value) in room.chunks_exact_mut(W).zip(values) {
        chunk.copy_from_slice(&distance(value).to_le_bytes()[..W]);
    }
}

/// Packs integers of 128 bits.
pub(crate) fn pack_i128(values: &[i128], out: &mut Vec<u8>) {
    let (mut low, mut high) = (i128::MAX, i128::MIN);
    for &value in values {
        low = low.min(value);
        high = high.max(value);
    }
    if low >= high {
        return pack_head(0, 0, Wide::from(low), out);
    }
    let mut any = 0u128;
    for &value in values {
        any |= value.wrapping_sub(low) as u128;
    }
    let shift = any.trailing_zeros();
    let bits = 128 - (high.wrapping_sub(low) as u128 >> shift).leading_zeros();
    let width = bits.div_ceil(8) as usize;
    pack_head(width, shift, Wide::from(low), out);
    let start = out.len();
    out.resize(start + values.len() * width, 0);
    let room = &mut out[start..];
    let distance = |value: i128| value.wrapping_sub(low) as u128 >> shift;
    match width {
        7 => put_u128::<7>(values, distance, room),
        8 => put_u128::<8>(values, distance, room),
        9 => put_u128::<9>(values, distance, room),
        10 => put_u128::<10>(values, distance, room),
        11 => put_u128::<11>(values, distance, room),
        12 => put_u128::<12>(values, distance, room),
        _ => put_u128_any(values, distance, width, room),
    }
}

#[inline(always)]
fn put_u128<const W: usize>(values: &[i128], distance: impl Fn(i128) -> u128, room: &mut [u8]) {
    for (chunk, &value) in room.chunks_exact_mut(W).zip(values) {
        chunk.copy_from_slice(&distance(value).to_le_bytes()[..W]);
    }
}

fn put_u128_any(values: &[i128], distance: impl Fn(i128) -> u128, width: usize, room: &mut [u8]) {
    for (chunk, &value) in room.chunks_exact_mut(width).zip(values) {
        chunk.copy_from_slice(&distance(value).to_le_bytes()[..width]);
    }
}

/// Packs integers of 192 bits: rare, so plain.
pub(crate) fn pack_wide(values: &[Wide], out: &mut Vec<u8>) {
    let (Some(&low), Some(&high)) = (values.iter().min(), values.iter().max()) else {
        return pack_head(0, 0, Wide::ZERO, out);
    };
    if low == high {
        return pack_head(0, 0, low, out);
    }
    let mut any = Wide::ZERO;
    for &value in values {
        let distance = value.sub(low);
        any = Wide([0, 1, 2].map(|i| any.0[i] | distance.0[i]));
    }
    let shift = any.trailing_zeros();
    let width = high.sub(low).shr(shift).bits().div_ceil(8) as usize;
    pack_head(width, shift, low, out);
    for &value in values {
        out.extend_from_slice(&value.sub(low).shr(shift).to_bytes()[..width]);
    }
}

/// The integers of a block, in the narrowest type that holds them all.
#[derive(Debug)]
pub(crate) enum Values<'a> {
    /// All equal.
    Same(Wide),
    Narrow(&'a [i64]),
    Mid(&'a [i128]),
    Wide(&'a [Wide]),
}

impl Values<'_> {
    /// The smallest and the largest.
    pub fn span(&self) -> (Wide, Wide) {
        fn of<T: Copy + Ord + Into<Wide>>(values: &[T]) -> (Wide, Wide) {
            let end = |v: Option<&T>| v.map_or(Wide::ZERO, |&v| v.into());
            (end(values.iter().min()), end(values.iter().max()))
        }
        match self {
            Values::Same(value) => (*value, *value),
            Values::Narrow(values) => of(values),
            Values::Mid(values) => of(values),
            Values::Wide(values) => of(values),
        }
    }
}

/// Room to decode a block into.
pub(crate) struct Scratch {
    narrow: [i64; BLOCK],
    mid: [i128; BLOCK],
    wide: Vec<Wide>,
}

impl Scratch {
    pub fn new() -> Scratch {
        Scratch {
            narrow: [0; BLOCK],
            mid: [0; BLOCK],
            wide: Vec::new(),
        }
    }
}

/// Why a block is refused.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum BlockError {
    /// The bytes end inside it.
    Short,
    /// Not what packing writes.
    Malformed,
    /// Integers outside the bounds.
    OutOfRange,
}

/// Takes `n` bytes off the front.
pub(crate) fn take<'a>(input: &mut &'a [u8], n: usize) -> Option<&'a [u8]> {
    let (head, rest) = input.split_at_checked(n)?;
    *input = rest;
    Some(head)
}

/// Takes a block of `count` integers off the front of `input`. Integers outside `bounds` are
/// refused.
pub(crate) fn unpack<'a>(
    input: &mut &[u8],
    count: usize,
    bounds: (Wide, Wide),
    scratch: &'a mut Scratch,
) -> Result<Values<'a>, BlockError> {
    let packed = check(input, count, bounds)?;
    let Packed {
        base,
        shift,
        width,
        bytes,
    } = packed.block;
    if width == 0 {
        return Ok(Values::Same(base));
    }
    if let (Some(base), Some(_)) = (base.to_i64(), packed.top.to_i64()) {
        let out = &mut scratch.narrow[..count];
        match width {
            1 => get_u64::<1>(bytes, base, shift, out),
            2 => get_u64::<2>(bytes, base, shift, out),
            3 => get_u64::<3>(bytes, base, shift, out),
            4 => get_u64::<4>(bytes, base, shift, out),
            5 => get_u64::<5>(bytes, base, shift, out),
            6 => get_u64::<6>(bytes, base, shift, out),
            7 => get_u64::<7>(bytes, base, shift, out),
            _ => get_u64::<8>(bytes, base, shift, out),
        }
        return Ok(Values::Narrow(out));
    }
    if let (Some(base), Some(_)) = (base.to_i128(), packed.top.to_i128()) {
        let out = &mut scratch.mid[..count];
        match width {
            7 => get_u128::<7>(bytes, base, shift, out),
            8 => get_u128::<8>(bytes, base, shift, out),
            9 => get_u128::<9>(bytes, base, shift, out),
            10 => get_u128::<10>(bytes, base, shift, out),
            11 => get_u128::<11>(bytes, base, shift, out),
            12 => get_u128::<12>(bytes, base, shift, out),
            _ => get_u128_any(bytes, width, base, shift, out),
        }
        return Ok(Values::Mid(out));
    }
    scratch.wide.clear();
    scratch.wide.extend(
        bytes
            .chunks_exact(width)
            .map(|chunk| base.add(load(chunk).shl(shift))),
    );
    Ok(Values::Wide(&scratch.wide))
}

/// A block as it stands in a file.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Packed<'a> {
    /// The smallest integer.
    pub base: Wide,
    /// By how many bits the distances are shifted.
    pub shift: u32,
    /// Bytes of a distance, 0 if all integers are equal.
    pub width: usize,
    /// The distances.
    pub bytes: &'a [u8],
}

/// A block that is what packing writes.
pub(crate) struct Checked<'a> {
    pub block: Packed<'a>,
    /// The largest integer.
    pub top: Wide,
}

/// Takes a block of `count` integers off the front, as far as its head tells what it is. Says
/// nothing about the integers.
pub(crate) fn split<'a>(input: &mut &'a [u8], count: usize) -> Result<Packed<'a>, BlockError> {
    debug_assert!(count <= BLOCK);
    let head = take(input, 3).ok_or(BlockError::Short)?;
    let (width, shift, length) = (head[0] as usize, head[1] as u32, head[2] as usize);
    if width > WIDE_BYTES || length > WIDE_BYTES || width as u32 * 8 + shift > 184 {
        return Err(BlockError::Malformed);
    }
    let base = unpack_base(take(input, length).ok_or(BlockError::Short)?);
    if signed_bytes(base) != length || (width == 0 && shift != 0) {
        return Err(BlockError::Malformed);
    }
    Ok(Packed {
        base,
        shift,
        width,
        bytes: take(input, count * width).ok_or(BlockError::Short)?,
    })
}

/// The same, with every integer inside the bounds and every field as packing writes it.
pub(crate) fn check<'a>(
    input: &mut &'a [u8],
    count: usize,
    bounds: (Wide, Wide),
) -> Result<Checked<'a>, BlockError> {
    let block = split(input, count)?;
    let Packed { base, shift, .. } = block;
    if base < bounds.0 || base > bounds.1 {
        return Err(BlockError::OutOfRange);
    }
    if block.width == 0 {
        return Ok(Checked { block, top: base });
    }
    // The bounds lie within 2^153 and distances below 2^184: the sum cannot wrap.
    let largest = largest_distance(block.bytes, block.width).ok_or(BlockError::Malformed)?;
    let top = base.add(largest.shl(shift));
    if top > bounds.1 {
        return Err(BlockError::OutOfRange);
    }
    Ok(Checked { block, top })
}

fn unpack_base(bytes: &[u8]) -> Wide {
    let fill = if bytes.last().is_some_and(|&top| top >= 0x80) {
        0xff
    } else {
        0
    };
    let mut all = [fill; WIDE_BYTES];
    all[..bytes.len()].copy_from_slice(bytes);
    Wide::from_bytes(all)
}

pub(crate) fn load(bytes: &[u8]) -> Wide {
    let mut all = [0; WIDE_BYTES];
    all[..bytes.len()].copy_from_slice(bytes);
    Wide::from_bytes(all)
}

/// The largest of the distances, or None if packing would have chosen another base, shift or width.
fn largest_distance(bytes: &[u8], width: usize) -> Option<Wide> {
    let (smallest, largest, any) = match width {
        1 => span_u64::<1>(bytes),
        2 => span_u64::<2>(bytes),
        3 => span_u64::<3>(bytes),
        4 => span_u64::<4>(bytes),
        5 => span_u64::<5>(bytes),
        6 => span_u64::<6>(bytes),
        7 => span_u64::<7>(bytes),
        8 => span_u64::<8>(bytes),
        9 => span_u128::<9>(bytes),
        10 => span_u128::<10>(bytes),
        11 => span_u128::<11>(bytes),
        12 => span_u128::<12>(bytes),
        _ => {
            let all = || bytes.chunks_exact(width).map(load);
            let any = all().fold(0, |any, v| any | v.0[0]);
            (all().min()?, all().max()?, any)
        }
    };
    let canonical =
        smallest == Wide::ZERO && any & 1 == 1 && largest.bits().div_ceil(8) as usize == width;
    canonical.then_some(largest)
}

#[inline(always)]
fn load_u64<const W: usize>(chunk: &[u8]) -> u64 {
    let mut eight = [0; 8];
    eight[..W].copy_from_slice(&chunk[..W]);
    u64::from_le_bytes(eight)
}

#[inline(always)]
pub(crate) fn load_u128<const W: usize>(chunk: &[u8]) -> u128 {
    let mut sixteen = [0; 16];
    sixteen[..W].copy_from_slice(&chunk[..W]);
    u128::from_le_bytes(sixteen)
}

fn span_u64<const W: usize>(bytes: &[u8]) -> (Wide, Wide, u64) {
    let (mut low, mut high, mut any) = (u64::MAX, 0, 0);
    for chunk in bytes.chunks_exact(W) {
        let value = load_u64::<W>(chunk);
        low = low.min(value);
        high = high.max(value);
        any |= value;
    }
    (Wide([low, 0, 0]), Wide([high, 0, 0]), any)
}

fn span_u128<const W: usize>(bytes: &[u8]) -> (Wide, Wide, u64) {
    let (mut low, mut high, mut any) = (u128::MAX, 0, 0);
    for chunk in bytes.chunks_exact(W) {
        let value = load_u128::<W>(chunk);
        low = low.min(value);
        high = high.max(value);
        any |= value as u64;
    }
    let wide = |value: u128| Wide([value as u64, (value >> 64) as u64, 0]);
    (wide(low), wide(high), any)
}

fn get_u64<const W: usize>(bytes: &[u8], base: i64, shift: u32, out: &mut [i64]) {
    for (out, chunk) in out.iter_mut().zip(bytes.chunks_exact(W)) {
        *out = base.wrapping_add((load_u64::<W>(chunk) << shift) as i64);
    }
}

fn get_u128<const W: usize>(bytes: &[u8], base: i128, shift: u32, out: &mut [i128]) {
    for (out, chunk) in out.iter_mut().zip(bytes.chunks_exact(W)) {
        *out = base.wrapping_add((load_u128::<W>(chunk) << shift) as i128);
    }
}

fn get_u128_any(bytes: &[u8], width: usize, base: i128, shift: u32, out: &mut [i128]) {
    for (out, chunk) in out.iter_mut().zip(bytes.chunks_exact(width)) {
        let mut sixteen = [0; 16];
        sixteen[..width].copy_from_slice(chunk);
        *out = base.wrapping_add((u128::from_le_bytes(sixteen) << shift) as i128);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn widest(values: &Values, count: usize) -> Vec<Wide> {
        match values {
            Values::Same(value) => vec![*value; count],
            Values::Narrow(values) => values.iter().map(|&v| Wide::from(v)).collect(),
            Values::Mid(values) => values.iter().map(|&v| Wide::from(v)).collect(),
            Values::Wide(values) => values.to_vec(),
        }
    }

    fn check(values: &[Wide]) {
        let limit = Wide::scaled(1, 180);
        let mut bytes = vec![];
        pack_wide(values, &mut bytes);
        let mut input = &bytes[..];
        let mut scratch = Scratch::new();
        let back = unpack(&mut input, values.len(), (limit.neg(), limit), &mut scratch).unwrap();
        assert_eq!(widest(&back, values.len()), values);
        assert!(input.is_empty());
        // Whatever type they come in, the same integers are the same bytes.
        if let Some(mid) = values
            .iter()
            .map(|v| v.to_i128())
            .collect::<Option<Vec<_>>>()
        {
            let mut same = vec![];
            pack_i128(&mid, &mut same);
            assert_eq!(same, bytes);
        }
        if let Some(narrow) = values
            .iter()
            .map(|v| v.to_i64())
            .collect::<Option<Vec<_>>>()
        {
            let mut same = vec![];
            pack_i64(&narrow, &mut same);
            assert_eq!(same, bytes);
        }
    }

    proptest! {
        #[test]
        fn every_width_and_shift_round_trips(
            parts in proptest::collection::vec(any::<(u64, u64, u64)>(), 1..BLOCK),
            bits in 0u32..152, shift in 0u32..24, negative in any::<bool>(),
        ) {
            let values: Vec<Wide> = parts.iter().map(|&(a, b, c)| {
                let value = Wide([a, b, c]).shr(192 - bits).shl(shift);
                if negative && a & 1 == 1 { value.neg() } else { value }
            }).collect();
            check(&values);
        }

        #[test]
        fn no_second_encoding(mut bytes in proptest::collection::vec(any::<u8>(), 3..64)) {
            bytes[0] %= 4;
            bytes[1] %= 3;
            bytes[2] %= 3;
            let limit = Wide::scaled(1, 180);
            let mut input = &bytes[..];
            let mut scratch = Scratch::new();
            if let Ok(values) = unpack(&mut input, 4, (limit.neg(), limit), &mut scratch) {
                let used = bytes.len() - input.len();
                let mut again = vec![];
                pack_wide(&widest(&values, 4), &mut again);
                prop_assert_eq!(&bytes[..used], again);
            }
        }
    }

    #[test]
    fn extremes_of_each_type() {
        for (low, high) in [
            (i64::MIN, i64::MAX),
            (0, 255),
            (0, 256),
            (-1, 0),
            (-128, 127),
        ] {
            check(&[Wide::from(low), Wide::from(high)]);
        }
        check(&[Wide::from(-(1i128 << 120)), Wide::from(1i128 << 120)]);
        check(&[Wide::scaled(1, 152), Wide::ZERO]);
        check(&[Wide::from(-129i64); 7]);
    }

    #[test]
    fn outside_the_bounds_is_refused() {
        let mut bytes = vec![];
        pack_i64(&[3, 9], &mut bytes);
        let mut scratch = Scratch::new();
        let mut get = |low: i64, high: i64| {
            unpack(
                &mut &bytes[..],
                2,
                (Wide::from(low), Wide::from(high)),
                &mut scratch,
            )
            .is_ok()
        };
        assert!(get(3, 9) && !get(4, 9) && !get(3, 8));
    }
}
