//! The whole tracer against answers that are known in closed form, and the promises of samples:
//! same bits however they are grouped, nothing but numbers in the film, honest errors.
//!
//! One program, so that it is linked once. Seeds are fixed: a test that passes always passes. One
//! that fails prints what it measured, with its standard error.
#![allow(
    clippy::disallowed_methods,
    reason = "expected values need not be the same on every machine"
)]

mod common;

mod cameras;
mod convergence;
mod curves;
mod determinism;
mod error_coverage;
mod filters;
mod furnace;
mod guiding;
mod irradiance;
mod lights;
mod media;
mod mixes;
mod motion;
mod normal_maps;
mod penumbra;
mod pictured_lights;
mod pictures;
mod references;
mod robustness;
mod splitting;
mod streams;
