//! Which files of a scene are used.

use super::{AssetBytes, AssetError, AssetSource, normalize};
use std::collections::BTreeSet;
use std::sync::Mutex;

/// Passes everything on and remembers which files were read, so that a client uploads only those.
pub struct RecordingSource<'a> {
    inner: &'a dyn AssetSource,
    used: Mutex<BTreeSet<String>>,
}

impl<'a> RecordingSource<'a> {
    /// Records what is read from `inner`.
    pub fn new(inner: &'a dyn AssetSource) -> Self {
        RecordingSource {
            inner,
            used: Mutex::default(),
        }
    }
    /// The files that were read, by normalised path.
    pub fn used(&self) -> BTreeSet<String> {
        self.used
            .lock()
            .map(|used| used.clone())
            .unwrap_or_default()
    }
    fn note(&self, path: &str) {
        if let (Ok(path), Ok(mut used)) = (normalize(path), self.used.lock()) {
            used.insert(path);
        }
    }
}

impl AssetSource for RecordingSource<'_> {
    fn read(&self, path: &str) -> Result<AssetBytes, AssetError> {
        let bytes = self.inner.read(path)?;
        self.note(path);
        Ok(bytes)
    }
    fn read_prefix(&self, path: &str, n: usize) -> Result<AssetBytes, AssetError> {
        let bytes = self.inner.read_prefix(path, n)?;
        self.note(path);
        Ok(bytes)
    }
    fn exists(&self, path: &str) -> bool {
        self.inner.exists(path)
    }
    fn list(&self) -> Vec<String> {
        self.inner.list()
    }
}
