//! Scenes as data: what there is to render, read from Brolly's own JSON or from foreign formats,
//! checked, and named by content. Nothing here knows how light moves.
//!
//! The way in is [`load()`]: it picks the reader by the main file's ending, reads through an
//! [`AssetSource`] and returns a [`SceneDesc`] with the [`Diagnostic`]s that were collected.
//!
//! ```
//! use scene::{Overrides, assets::MemorySource, load};
//!
//! let text = "WorldBegin LightSource \"infinite\" Shape \"sphere\" \"float radius\" 2";
//! let assets = MemorySource::new().with("ball.pbrt", text)?;
//! let (desc, diagnostics) = load("ball.pbrt", &assets, &Overrides::default())?;
//! assert_eq!((desc.primitives.len(), diagnostics.len()), (1, 0));
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

#![forbid(unsafe_code)]
// Papers are cited as [Key] after docs/references.md, which rustdoc takes for links.
#![allow(rustdoc::broken_intra_doc_links)]

mod apply;
pub mod assets;
pub mod color;
mod context;
pub mod diagnostic;
pub mod digest;
pub mod import;
pub mod limits;
mod load;
pub mod model;
pub mod native;
pub mod noise;
mod number;
pub mod overrides;
pub mod picture;
mod spectrum;
mod suggest;
pub mod validate;

pub use apply::{INTEGRATORS, integrator, look_at};
pub use assets::{AssetError, AssetSource};
pub use diagnostic::{Diagnostic, Place, SceneError, Severity};
pub use digest::SceneDigest;
pub use load::{Loaded, load, load_with_files};
pub use model::SceneDesc;
pub use overrides::{Look, Overrides};
pub use validate::validate;
