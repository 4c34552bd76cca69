//! Foreign formats, one a module.

pub mod pbrt;
pub mod ply;
