//! Where a scene's files come from. This trait is the only way a reader or the tracer gets at
//! bytes: no path outside the scene's folder, no network.

/// Why an asset could not be had.
#[derive(Debug, thiserror::Error)]
pub enum AssetError {
    /// No such file in the scene.
    #[error("{path}: no such file in the scene's folder")]
    NotFound {
        /// The path that was asked for.
        path: String,
    },
    /// A path that is absolute, leaves the scene's folder, or names something that is no plain file.
    #[error("{path}: {reason}")]
    Refused {
        /// The path that was asked for.
        path: String,
        /// Which rule it broke.
        reason: String,
    },
    /// Larger than the reader accepts.
    #[error("{path}: {size_bytes} bytes, more than the limit of {limit_bytes}")]
    TooLarge {
        /// The path that was asked for.
        path: String,
        /// Its size.
        size_bytes: u64,
        /// The limit that it breaks.
        limit_bytes: u64,
    },
    /// It is there, but reading failed.
    #[error("{path}: {reason}")]
    Unreadable {
        /// The path that was asked for.
        path: String,
        /// What the system said.
        reason: String,
    },
}

/// Bytes of an asset, shared.
pub type AssetBytes = std::sync::Arc<[u8]>;

/// Read access to the files of one scene. Paths are relative to the scene's folder, with `/`
/// between parts; [`normalize`] is applied by every implementation.
pub trait AssetSource: Send + Sync {
    /// The whole file.
    fn read(&self, path: &str) -> Result<AssetBytes, AssetError>;
    /// The first `n` bytes (fewer if the file is shorter), for probing headers.
    fn read_prefix(&self, path: &str, n: usize) -> Result<AssetBytes, AssetError>;
    /// Whether the file is there.
    fn exists(&self, path: &str) -> bool;
    /// All files, sorted.
    fn list(&self) -> Vec<String>;
}
