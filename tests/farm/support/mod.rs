//! What the tests stand on.

mod farm;
mod process;
mod raw_worker;
mod scenes;

pub use farm::{TestFarm, outcome, wait_until};
pub use process::{Brolly, brolly};
pub use raw_worker::RawWorker;
pub use scenes::{TestScene, Tuning};

/// A seed for one test: the same every time, unless `BROLLY_TEST_SEED` says otherwise. Printed, so that
/// a failure can be repeated.
pub fn seed(test: &str) -> u64 {
    let seed = std::env::var("BROLLY_TEST_SEED")
        .ok()
        .and_then(|text| text.parse().ok())
        .unwrap_or_else(|| {
            test.bytes().fold(0xcbf2_9ce4_8422_2325, |hash: u64, byte| {
                (hash ^ u64::from(byte)).wrapping_mul(0x0100_0000_01b3)
            })
        });
    eprintln!("{test}: BROLLY_TEST_SEED={seed}");
    seed
}
