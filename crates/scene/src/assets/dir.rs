//! A folder on disk as a source of assets.

use super::{AssetBytes, AssetError, AssetSource, MAX_FILE_BYTES, MAX_FILES, normalize};
use std::io::Read;
use std::path::{Path, PathBuf};

/// How deep [`DirSource::list`] looks.
const MAX_FOLDER_DEPTH: usize = 32;

/// The files below a folder. Links that stay inside are followed, links that leave are refused, and
/// so is everything that is no plain file.
#[derive(Clone, Debug)]
pub struct DirSource {
    root: PathBuf,
}

impl DirSource {
    /// The folder must exist.
    pub fn new(root: &Path) -> Result<Self, AssetError> {
        let shown = || root.display().to_string();
        let root = root.canonicalize().map_err(|e| AssetError::Unreadable {
            path: shown(),
            reason: e.to_string(),
        })?;
        if !root.is_dir() {
            return Err(AssetError::Refused {
                path: shown(),
                reason: "not a folder".into(),
            });
        }
        Ok(DirSource { root })
    }

    /// The real file behind a path, its size, and the normalised path.
    fn find(&self, path: &str) -> Result<(PathBuf, u64, String), AssetError> {
        let path = normalize(path)?;
        let full = match self.root.join(&path).canonicalize() {
            Ok(full) => full,
            Err(e) if e.kind() == std::io::ErrorKind::NotFound => {
                return Err(AssetError::NotFound { path });
            }
            Err(e) => {
                return Err(AssetError::Unreadable {
                    path,
                    reason: e.to_string(),
                });
            }
        };
        if !full.starts_with(&self.root) {
            return Err(AssetError::Refused {
                path,
                reason: "a link that leaves the scene's folder".into(),
            });
        }
        // Looked at before it is opened: opening a pipe would wait for ever.
        let about = full.metadata().map_err(|e| AssetError::Unreadable {
            path: path.clone(),
            reason: e.to_string(),
        })?;
        if !about.is_file() {
            return Err(AssetError::Refused {
                path,
                reason: "not a plain file".into(),
            });
        }
        Ok((full, about.len(), path))
    }
}

fn read_at_most(full: &Path, path: &str, n: u64) -> Result<Vec<u8>, AssetError> {
    let unreadable = |e: std::io::Error| AssetError::Unreadable {
        path: path.to_owned(),
        reason: e.to_string(),
    };
    let mut bytes = Vec::new();
    std::fs::File::open(full)
        .map_err(unreadable)?
        .take(n)
        .read_to_end(&mut bytes)
        .map_err(unreadable)?;
    Ok(bytes)
}

impl AssetSource for DirSource {
    fn read(&self, path: &str) -> Result<AssetBytes, AssetError> {
        let (full, size_bytes, path) = self.find(path)?;
        if size_bytes > MAX_FILE_BYTES {
            return Err(AssetError::TooLarge {
                path,
                size_bytes,
                limit_bytes: MAX_FILE_BYTES,
            });
        }
        // A file that grows meanwhile is cut at the size that was checked.
        Ok(read_at_most(&full, &path, size_bytes)?.into())
    }
    fn read_prefix(&self, path: &str, n: usize) -> Result<AssetBytes, AssetError> {
        let (full, _, path) = self.find(path)?;
        Ok(read_at_most(&full, &path, n as u64)?.into())
    }
    fn exists(&self, path: &str) -> bool {
        self.find(path).is_ok()
    }
    fn list(&self) -> Vec<String> {
        let mut found = Vec::new();
        let mut folders = vec![(String::new(), 0)];
        while let Some((folder, depth)) = folders.pop() {
            let Ok(entries) = std::fs::read_dir(self.root.join(&folder)) else {
                continue;
            };
            for entry in entries.flatten() {
                let Ok(name) = entry.file_name().into_string() else {
                    continue;
                };
                let path = if folder.is_empty() {
                    name
                } else {
                    format!("{folder}/{name}")
                };
                // The type of the entry itself: folders are not followed through links, so there are no loops.
                match entry.file_type() {
                    Ok(kind) if kind.is_dir() && depth < MAX_FOLDER_DEPTH => {
                        folders.push((path, depth + 1))
                    }
                    Ok(kind)
                        if kind.is_file() || (kind.is_symlink() && self.find(&path).is_ok()) =>
                    {
                        found.push(path)
                    }
                    _ => {}
                }
                if found.len() >= MAX_FILES {
                    found.sort();
                    return found;
                }
            }
        }
        found.sort();
        found
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn stays_inside_its_folder() {
        let outside = tempfile::tempdir().unwrap();
        let dir = tempfile::tempdir().unwrap();
        std::fs::write(outside.path().join("secret"), "s").unwrap();
        std::fs::create_dir(dir.path().join("sub")).unwrap();
        std::fs::write(dir.path().join("sub/a.ply"), "abc").unwrap();
        std::os::unix::fs::symlink(outside.path().join("secret"), dir.path().join("leak")).unwrap();
        std::os::unix::fs::symlink(outside.path(), dir.path().join("out")).unwrap();
        std::os::unix::fs::symlink("sub/a.ply", dir.path().join("inside")).unwrap();
        std::os::unix::fs::symlink("/dev/zero", dir.path().join("zero")).unwrap();
        let source = DirSource::new(dir.path()).unwrap();

        assert_eq!(&source.read("sub/../inside").unwrap()[..], b"abc");
        assert_eq!(&source.read_prefix("sub/a.ply", 2).unwrap()[..], b"ab");
        assert!(
            source
                .read("leak")
                .unwrap_err()
                .to_string()
                .contains("leaves")
        );
        assert!(
            source
                .read("out/secret")
                .unwrap_err()
                .to_string()
                .contains("leaves")
        );
        assert!(
            source
                .read("zero")
                .unwrap_err()
                .to_string()
                .contains("leaves")
        );
        assert!(
            source
                .read("sub")
                .unwrap_err()
                .to_string()
                .contains("plain file")
        );
        assert!(matches!(
            source.read("nothing"),
            Err(AssetError::NotFound { .. })
        ));
        assert_eq!(source.list(), ["inside", "sub/a.ply"]);
    }
}
