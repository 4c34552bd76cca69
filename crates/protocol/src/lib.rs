//! The wire: what coordinator, clients and workers say to each other in JSON over HTTP. Types only,
//! no logic, no HTTP. Times are milliseconds since the Unix epoch, durations are seconds.
#![forbid(unsafe_code)]

pub mod asset;
pub mod event;
pub mod job;
pub mod problem;
pub mod worker;

pub use asset::*;
pub use event::*;
pub use job::*;
pub use problem::*;
pub use worker::*;

/// Milliseconds since the Unix epoch.
pub type TimestampMs = u64;
