//! Where a scene's files come from. This trait is the only way a reader or the tracer gets at
//! bytes: no path outside the scene's folder, no network.

mod dir;
mod open;
mod record;
mod zipped;

pub use dir::DirSource;
pub use open::{find_main, open};
pub use record::RecordingSource;
pub use zipped::ZipSource;

use std::collections::BTreeMap;

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

/// The largest file that any source hands out.
pub const MAX_FILE_BYTES: u64 = 1 << 30;
/// The largest number of files that a folder or archive may list.
pub const MAX_FILES: usize = 100_000;
/// The longest path.
pub const MAX_PATH_BYTES: usize = 4096;

fn refused(path: &str, reason: &str) -> AssetError {
    // A hostile path goes into logs and web pages: keep it short and printable.
    let shown: String = path
        .chars()
        .take(200)
        .map(|c| if c.is_control() { '?' } else { c })
        .collect();
    AssetError::Refused {
        path: shown,
        reason: reason.to_owned(),
    }
}

/// The one spelling of a path inside a scene: relative, `/` between parts, no `.` and no `..`.
/// Refuses what is absolute, leaves the folder, carries a scheme or a drive letter, or cannot be a
/// file name on every system.
pub fn normalize(path: &str) -> Result<String, AssetError> {
    if path.is_empty() {
        return Err(refused(path, "an empty path"));
    }
    if path.len() > MAX_PATH_BYTES {
        return Err(refused(path, "a path longer than the limit of 4096 bytes"));
    }
    if path.chars().any(char::is_control) {
        return Err(refused(path, "a path with a control character in it"));
    }
    if path.contains('\\') {
        return Err(refused(
            path,
            "a path with a backslash; write / between folders",
        ));
    }
    if path.starts_with('/') {
        return Err(refused(
            path,
            "an absolute path; a scene names files relative to its own folder",
        ));
    }
    let head = path.split('/').next().unwrap_or_default();
    if head.contains(':') {
        return Err(refused(
            path,
            "a URL or drive letter; a scene's files lie in its own folder",
        ));
    }
    let mut parts: Vec<&str> = Vec::new();
    for part in path.split('/') {
        match part {
            "" | "." => {}
            ".." => {
                if parts.pop().is_none() {
                    return Err(refused(path, "a path that leaves the scene's folder"));
                }
            }
            _ => parts.push(part),
        }
    }
    if parts.is_empty() {
        return Err(refused(path, "a folder, not a file"));
    }
    Ok(parts.join("/"))
}

/// The folder of a path inside a scene, with a trailing `/`, or nothing at the top.
pub fn folder_of(path: &str) -> &str {
    path.rfind('/').map_or("", |slash| &path[..=slash])
}

/// Files held in memory: tests, and scenes that were built rather than read.
#[derive(Clone, Debug, Default)]
pub struct MemorySource {
    files: BTreeMap<String, AssetBytes>,
}

impl MemorySource {
    /// No files.
    pub fn new() -> Self {
        Self::default()
    }
    /// Adds or replaces a file; the path is normalised.
    pub fn insert(&mut self, path: &str, bytes: impl Into<AssetBytes>) -> Result<(), AssetError> {
        self.files.insert(normalize(path)?, bytes.into());
        Ok(())
    }
    /// The same, for building in one expression.
    pub fn with(mut self, path: &str, bytes: impl AsRef<[u8]>) -> Result<Self, AssetError> {
        self.insert(path, bytes.as_ref())?;
        Ok(self)
    }
}

impl AssetSource for MemorySource {
    fn read(&self, path: &str) -> Result<AssetBytes, AssetError> {
        let path = normalize(path)?;
        self.files
            .get(&path)
            .cloned()
            .ok_or(AssetError::NotFound { path })
    }
    fn read_prefix(&self, path: &str, n: usize) -> Result<AssetBytes, AssetError> {
        let bytes = self.read(path)?;
        Ok(if bytes.len() <= n {
            bytes
        } else {
            AssetBytes::from(&bytes[..n])
        })
    }
    fn exists(&self, path: &str) -> bool {
        normalize(path).is_ok_and(|p| self.files.contains_key(&p))
    }
    fn list(&self) -> Vec<String> {
        self.files.keys().cloned().collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn paths_are_normalised_or_refused() {
        let check = |input: &str, expect: Result<&str, &str>| match (normalize(input), expect) {
            (Ok(got), Ok(want)) => assert_eq!(got, want, "{input:?}"),
            (Err(error), Err(want)) => {
                assert!(error.to_string().contains(want), "{input:?}: {error}")
            }
            (got, _) => panic!("{input:?}: {got:?}, expected {expect:?}"),
        };
        check("a.ply", Ok("a.ply"));
        check("./a//b/./c.ply", Ok("a/b/c.ply"));
        check("a/../b.ply", Ok("b.ply"));
        check("a/b/../../c", Ok("c"));
        check("..a/b..", Ok("..a/b.."));
        check("a/c:d", Ok("a/c:d"));
        check("", Err("empty"));
        check(".", Err("folder"));
        check("a/..", Err("folder"));
        check("../a", Err("leaves"));
        check("a/../../b", Err("leaves"));
        check("/etc/passwd", Err("absolute"));
        check("//host/share", Err("absolute"));
        check("C:/x", Err("drive"));
        check("file:///etc/passwd", Err("URL"));
        check("http://x/y", Err("URL"));
        check("a\\..\\b", Err("backslash"));
        check("a\0b", Err("control"));
        check("a\nb", Err("control"));
        check(&"a/".repeat(3000), Err("4096"));
    }
}
