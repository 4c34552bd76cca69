//! Scenes as data: what there is to render, read from Brolly's own JSON or from foreign formats,
//! checked, and named by content. Nothing here knows how light moves.
//!
//! The way in is [`load()`]: it picks the reader by the main file's ending, reads through an
//! [`AssetSource`] and returns a [`SceneDesc`] with the [`Diagnostic`]s that were collected.

#![forbid(unsafe_code)]

pub mod assets;
pub mod color;
mod context;
pub mod diagnostic;
pub mod import;
pub mod limits;
mod load;
pub mod model;
mod number;
pub mod overrides;
pub mod picture;
mod suggest;

pub use assets::{AssetError, AssetSource};
pub use diagnostic::{Diagnostic, Place, SceneError, Severity};
pub use load::{Loaded, load, load_with_files};
pub use model::SceneDesc;
pub use overrides::{Look, Overrides};
