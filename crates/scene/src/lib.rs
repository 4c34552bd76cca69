//! Scenes as data: what there is to render, read from Brolly's own JSON or from foreign formats,
//! checked, and named by content. Nothing here knows how light moves.
//!
//! The way in is [`load`]: it picks the main file, reads it through an [`AssetSource`] and returns
//! a [`SceneDesc`] with the [`Diagnostic`]s that the reader collected.

#![forbid(unsafe_code)]

pub mod assets;
pub mod diagnostic;
pub mod model;
pub mod overrides;

pub use assets::{AssetError, AssetSource};
pub use diagnostic::{Diagnostic, Place, SceneError, Severity};
pub use model::SceneDesc;
pub use overrides::{Look, Overrides};
