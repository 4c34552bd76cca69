//! Brolly's own scenes: JSON, strict, friendly to write by hand, able to say everything that a
//! [`SceneDesc`] can hold. Large arrays lie in files beside it.
//!
//! [`write`] is the way back: what it writes reads as an equal description.

mod arrays;
mod buffer;
pub(crate) mod locate;
mod read;
mod schema;
#[cfg(test)]
pub(crate) mod tests;
mod values;
mod write;

pub(crate) use read::import;
pub use schema::schema;
pub use write::{WriteError, Written, write};
