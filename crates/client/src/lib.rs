//! A typed client of a Brolly coordinator: one method for each route, one retry policy, errors that
//! keep what the coordinator said. Plain HTTP only for now: put a TLS proxy in front of a
//! coordinator that is reached over an open network, and a tunnel beside the client.
//!
//! ```no_run
//! # async fn example() -> Result<(), client::ClientError> {
//! let client = client::Client::new("http://127.0.0.1:7878", None)?;
//! for job in client.jobs(&client::JobQuery::default()).await?.jobs {
//!     println!("{} {:?}", job.id, job.state);
//! }
//! # Ok(())
//! # }
//! ```
#![forbid(unsafe_code)]

pub mod assets;
pub mod digest;
mod error;
pub mod events;
mod http;
mod jobs;
mod retry;
mod sse;
mod workers;

pub use assets::{Upload, UploadBody};
pub use error::ClientError;
pub use events::EventStream;
pub use http::Client;
pub use jobs::{ImageQuery, JobQuery, Picture};
pub use retry::RetryPolicy;
pub use workers::{Delivery, UnitResult};
