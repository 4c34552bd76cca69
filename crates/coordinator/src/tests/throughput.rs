//! How fast results are taken. Not a test: `cargo test --release -- --ignored --nocapture`.

use super::support::*;
use bytes::Bytes;
use film::{Film, LayerSample, SampleBuffer, SampleRange, Unit};
use std::sync::Arc;
use std::time::Instant;

/// A result as a renderer makes it: every pixel has its samples.
fn full(unit: Unit) -> Vec<u8> {
    let tile = GRID.tile(unit.tile);
    let mut buffer = SampleBuffer::new(tile, unit.samples);
    let mut x = 0x9E37_79B9_7F4A_7C15u64 ^ u64::from(unit.samples.begin);
    let mut next = || {
        x ^= x << 13;
        x ^= x >> 7;
        x ^= x << 17;
        (x >> 40) as f32 / 16_777_216.0
    };
    for y in 0..tile.height {
        for px in 0..tile.width {
            for index in unit.samples.begin..(unit.samples.begin + 4).min(unit.samples.end) {
                let sample = LayerSample {
                    beauty: [next(), next(), next()],
                    alpha: 1.0,
                    albedo: [next(), next(), next()],
                    normal: [next(), next(), next()],
                    depth: 1.0 + next(),
                };
                buffer.add(px, y, index, &sample).unwrap();
            }
        }
    }
    film::encode_unit(unit, &buffer, &Default::default(), film::ENGINE_VERSION)
}

#[tokio::test(flavor = "multi_thread")]
#[ignore = "a measurement"]
async fn results_per_second() {
    for durable in [false, true] {
        let rig = Arc::new(if durable {
            Rig::embedded().await
        } else {
            Rig::memory().await
        });
        let passes = 400;
        let id = rig.submit(spp(512 * passes)).await;
        let worker = rig.worker("a");
        let mut leases = Vec::new();
        loop {
            let more = rig.lease(worker, 256).await;
            if more.is_empty() {
                break;
            }
            leases.extend(more.into_iter().filter(|l| l.at.unit.tile == 0));
            if leases.len() > 300 {
                break;
            }
        }
        let rendered: Vec<(protocol::LeaseRef, Bytes)> = leases
            .into_iter()
            .map(|l| (l.at.clone(), full(l.at.unit).into()))
            .collect();
        let size: usize = rendered.iter().map(|(_, b)| b.len()).sum();
        let count = rendered.len();
        let start = Instant::now();
        let tasks = rendered.chunks(count.div_ceil(32)).map(|part| {
            let (rig, part) = (rig.clone(), part.to_vec());
            tokio::spawn(async move {
                for (at, bytes) in part {
                    let delivery = crate::results::Delivery {
                        job: at.job,
                        unit: at.unit,
                        worker,
                        token: None,
                        digest: *blake3::hash(&bytes).as_bytes(),
                        claimed: None,
                        bytes,
                        cpu_seconds: 0.0,
                    };
                    rig.farm.take(delivery).await.unwrap();
                }
            })
        });
        futures::future::join_all(tasks).await;
        rig.merged(id, count as u64).await;
        let seconds = start.elapsed().as_secs_f64();
        println!(
            "{}: {count} results of {} KB in {seconds:.2} s: {:.0} results/s, {:.0} MB/s",
            if durable { "embedded" } else { "memory" },
            size / count / 1000,
            count as f64 / seconds,
            size as f64 / 1e6 / seconds
        );
        if durable {
            let rig = Arc::into_inner(rig).unwrap();
            let folder = rig.crash().await;
            let start = Instant::now();
            let rig = Rig::open(folder).await;
            let seconds = start.elapsed().as_secs_f64();
            assert_eq!(rig.status(id).units_merged, count as u64);
            println!(
                "restart with {:.0} MB of log: {seconds:.2} s",
                size as f64 / 1e6
            );
        }
    }
}

/// Merging alone, for comparison.
#[test]
#[ignore = "a measurement"]
fn merge_alone() {
    let results: Vec<_> = (0..100)
        .map(|n| {
            let samples = SampleRange {
                begin: (n + 1) * 512,
                end: (n + 2) * 512,
            };
            full(Unit {
                frame: 0,
                tile: 0,
                samples,
            })
        })
        .collect();
    let mut film = Film::new(GRID, 0);
    let (mut decode, mut merge) = (0.0, 0.0);
    for bytes in &results {
        let start = Instant::now();
        let result = film::decode_unit(bytes).unwrap();
        decode += start.elapsed().as_secs_f64();
        let start = Instant::now();
        film.merge(
            &result,
            film::Receipt {
                digest: [0; 32],
                worker: "a".into(),
            },
        )
        .unwrap();
        merge += start.elapsed().as_secs_f64();
    }
    println!(
        "decode {:.3} ms, merge {:.3} ms a result of {} KB",
        decode * 10.0,
        merge * 10.0,
        results[0].len() / 1000
    );
}
