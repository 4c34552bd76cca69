//! Speed of the parts of the tracer and of whole scenes, on one thread.
//! `cargo bench -p brolly-tracer --bench tracer -- rays` runs those whose name has `rays` in it.

mod lights;
mod rays;
mod scenes;
mod surfaces;
mod textures;

use ::scene::model::*;
use ::scene::{Overrides, assets};
use glam::{Vec2, Vec3};
use std::path::{Path, PathBuf};
use tracer::{PrepareSettings, Scene, StopFlag, prepare};

fn main() {
    divan::main();
}

/// How many things a bench does in one go, so that what it is called with does not matter.
const BATCH: usize = 1024;

const SETTINGS: PrepareSettings = PrepareSettings {
    seed: 1,
    frame: 0,
    clamp_indirect: None,
    threads: 1,
    picture_bytes: u64::MAX,
};

/// Reproducible numbers in [0, 1) (SplitMix64).
struct Numbers(u64);

impl Numbers {
    fn one(&mut self) -> f32 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        ((z ^ (z >> 31)) >> 40) as f32 / (1u32 << 24) as f32
    }

    fn two(&mut self) -> Vec2 {
        Vec2::new(self.one(), self.one())
    }

    fn direction(&mut self) -> Vec3 {
        let z = 2.0 * self.one() - 1.0;
        let (sin, cos) = tracer::math::sin_cos_2pi(self.one());
        let r = (1.0 - z * z).max(0.0).sqrt();
        Vec3::new(r * cos, r * sin, z)
    }
}

/// A scene of this repository by its name.
fn described(name: &str) -> (SceneDesc, Box<dyn ::scene::AssetSource>) {
    let folder: PathBuf = Path::new(env!("CARGO_MANIFEST_DIR"))
        .join("../../scenes")
        .join(name);
    let (assets, main) = assets::open(&folder).expect("a scene of this repository");
    let (desc, _) = ::scene::load(&main, assets.as_ref(), &Overrides::default()).expect("it loads");
    (desc, assets)
}

fn prepared(name: &str) -> Scene {
    let (desc, assets) = described(name);
    prepare(&desc, assets.as_ref(), &SETTINGS, &StopFlag::default()).expect("it is prepared")
}
