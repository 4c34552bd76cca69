//! One function for each kind of bytes that come from outside. It reads them the way the product
//! does and asserts what must hold whatever they are: an answer or a refusal, never a panic, and
//! what was accepted keeps to the limits.
//!
//! The fuzzers in `fuzz/` call these functions with bytes of their own making; the test of this
//! crate calls them with the corpus, on every run of the tests.
//!
//! ```
//! // Half a file is refused, not a reason to panic.
//! fuzzing::ply(b"ply\nformat ascii 1.0\nelement vertex 3\n");
//! ```
#![forbid(unsafe_code)]

mod films;
mod pictures;
mod scenes;

pub use films::{checkpoint, unit};
pub use pictures::{compared, picture};
pub use scenes::{draco, glb, gltf, meshopt, native, obj, pbrt, ply, zip};

/// A function by its name, which is that of its fuzzer and of its folder in the corpus.
pub struct Target {
    /// Name.
    pub name: &'static str,
    /// Panics where something does not hold.
    pub run: fn(&[u8]),
}

/// All of them.
pub const TARGETS: [Target; 13] = [
    target("checkpoint", checkpoint),
    target("compared", compared),
    target("draco", draco),
    target("glb", glb),
    target("gltf", gltf),
    target("meshopt", meshopt),
    target("native", native),
    target("obj", obj),
    target("pbrt", pbrt),
    target("picture", picture),
    target("ply", ply),
    target("unit", unit),
    target("zip", zip),
];

const fn target(name: &'static str, run: fn(&[u8])) -> Target {
    Target { name, run }
}
