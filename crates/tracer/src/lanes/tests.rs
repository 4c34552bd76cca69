//! Every level against the plain arrays, bit for bit.

use super::*;

/// Numbers of all sizes, zeros of both signs, NaN, infinities.
fn numbers() -> Vec<f32> {
    let mut numbers = vec![
        0.0,
        -0.0,
        1.0,
        -1.0,
        f32::NAN,
        f32::INFINITY,
        f32::NEG_INFINITY,
        f32::MIN_POSITIVE,
        -1e-40,
        3.4e38,
    ];
    let mut state = 7u64;
    while numbers.len() < 256 {
        state = crate::hash::mix(state);
        let x = f32::from_bits(state as u32);
        numbers.push(if state >> 40 & 1 == 0 {
            x
        } else {
            (x.to_bits() >> 8) as f32 * 1e-7
        });
    }
    numbers
}

/// What all operations give for two rows of operands.
#[inline(always)]
fn all<W: Wide<N>, const N: usize>(a: &Row<N>, b: &Row<N>, out: &mut Vec<Row<N>>) {
    let (x, y) = (W::F::load(a), W::F::load(b));
    let (i, j) = (x.bits(), y.bits());
    let half = W::M::from_bits(0b1010_0110_1010_0110);
    let less = W::F::select(x.lt(y), x, y);
    let values = [
        x + y,
        x - y,
        x * y,
        x / y,
        -x,
        x.sqrt(),
        x.abs(),
        x.min(y),
        x.max(y),
        less,
        W::F::select(x.le(y) | half, x, y),
        W::F::select(!x.eq(y) & half, x, y),
        x.copysign(y),
        W::F::from_bits(i + j),
        W::F::from_bits(i * j),
        W::F::from_bits((i & j) ^ (i | W::I::splat(0x55))),
        W::F::from_bits(i ^ j.shr::<9>()),
        W::F::from_int(i),
        W::F::select(i.eq(j), x, y),
        // Whatever is out of range is nobody's business.
        W::F::from_int(W::F::select(x.abs().lt(W::F::splat(1e6)), x, W::F::splat(0.0)).to_int()),
    ];
    for value in values {
        let mut row = Row::default();
        value.store(&mut row);
        out.push(row);
    }
    let columns = [x, y, x + y, x - y, y, x, x * y, -y];
    let records = W::records(columns);
    for at in [W::turn(&records), W::gather(&records, &[3; N])] {
        for value in at {
            let mut row = Row::default();
            value.store(&mut row);
            out.push(row);
        }
    }
    out.extend(records.chunks(N / LANES).map(|of| {
        let mut row = Row::default();
        let all: Vec<f32> = of.iter().flat_map(|r| r.0).collect();
        row.0.copy_from_slice(&all);
        row
    }));
    out.push(Row([x.lt(y).to_bits() as f32; N]));
}

/// Compares what a level gives with plain arrays.
fn compare<const N: usize>(level: fn(&Row<N>, &Row<N>, &mut Vec<Row<N>>)) {
    let numbers = numbers();
    let (rows, _) = numbers.as_chunks::<N>();
    for a in rows {
        for b in rows {
            let (mut plain, mut wide) = (vec![], vec![]);
            all::<Plain, N>(&Row(*a), &Row(*b), &mut plain);
            level(&Row(*a), &Row(*b), &mut wide);
            assert_eq!(plain.len(), wide.len());
            for (n, (p, w)) in plain.iter().zip(&wide).enumerate() {
                for lane in 0..N {
                    let (p, w) = (p.0[lane], w.0[lane]);
                    // Which NaN comes out of arithmetic is nobody's business.
                    let same = p.to_bits() == w.to_bits() || (p.is_nan() && w.is_nan());
                    assert!(same, "result {n} of {a:?} and {b:?}: {p} against {w}");
                }
            }
        }
    }
}

#[cfg(target_arch = "x86_64")]
#[test]
#[allow(unsafe_code)]
fn avx2_gives_the_bits_of_plain_arrays() {
    #[target_feature(enable = "avx2")]
    fn avx2(a: &Row, b: &Row, out: &mut Vec<Row>) {
        all::<Avx2, LANES>(a, b, out);
    }
    if crate::SimdLevel::best() < crate::SimdLevel::Avx2 {
        return;
    }
    // SAFETY: the processor has AVX2.
    compare::<LANES>(|a, b, out| unsafe { avx2(a, b, out) });
}

#[cfg(target_arch = "x86_64")]
#[test]
#[allow(unsafe_code)]
fn avx512_gives_the_bits_of_plain_arrays() {
    #[target_feature(enable = "avx512f,avx512vl")]
    fn avx512(a: &Row<MOST_LANES>, b: &Row<MOST_LANES>, out: &mut Vec<Row<MOST_LANES>>) {
        all::<Avx512, MOST_LANES>(a, b, out);
    }
    if crate::SimdLevel::best() < crate::SimdLevel::Avx512 {
        return;
    }
    // SAFETY: the processor has AVX-512.
    compare::<MOST_LANES>(|a, b, out| unsafe { avx512(a, b, out) });
}

#[test]
fn columns_and_records_are_turned_about() {
    let mut records = [Row::ZERO; MOST_LANES];
    for (j, record) in records.iter_mut().enumerate() {
        *record = Row(std::array::from_fn(|i| (10 * j + i) as f32));
    }
    let columns = <Plain as Wide<MOST_LANES>>::turn(&records);
    for (i, column) in columns.into_iter().enumerate() {
        let mut row = Row::default();
        column.store(&mut row);
        for (j, x) in row.0.into_iter().enumerate() {
            assert_eq!(x, (10 * j + i) as f32);
        }
    }
    assert_eq!(<Plain as Wide<MOST_LANES>>::records(columns), records);
}

#[test]
fn frames_and_vectors_round_as_single_ones_do() {
    use crate::math::{Frame, length, normalize};
    use glam::Vec3;
    let vectors: Vec<Vec3> = (0..64u64)
        .map(|i| {
            let h = crate::hash::mix(i);
            let unit = |bits: u64| (bits & 0xFFFF) as f32 / 32768.0 - 1.0;
            Vec3::new(unit(h), unit(h >> 16), unit(h >> 32))
        })
        .filter(|v| length(*v) > 0.1)
        .collect();
    for pair in vectors.windows(2) {
        let (a, b) = (pair[0], pair[1]);
        let (wa, wb) = (V3::<Plain, LANES>::splat(a), V3::<Plain, LANES>::splat(b));
        let n = normalize(a);
        let (frame, wide) = (Frame::from_normal(n), Frame3::from_normal(wa.normalized()));
        let expected = [
            n,
            a.cross(b),
            frame.to_local(b),
            frame.to_world(b),
            a * b.x + b - a,
        ];
        let found = [
            wa.normalized(),
            wa.cross(wb),
            wide.to_local(wb),
            wide.to_world(wb),
            wa * wb.x + wb - wa,
        ];
        for (n, (e, f)) in expected.iter().zip(found).enumerate() {
            let mut rows = [Row::default(); 3];
            f.store(&mut rows);
            let f = Vec3::new(rows[0].0[0], rows[1].0[3], rows[2].0[7]);
            assert_eq!(e.to_array(), f.to_array(), "result {n} of {a} and {b}");
        }
    }
}
