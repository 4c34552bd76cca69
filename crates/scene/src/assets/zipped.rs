//! A `.zip` archive as a source of assets.

use super::{AssetBytes, AssetError, AssetSource, MAX_FILE_BYTES, MAX_FILES, normalize};
use std::collections::BTreeMap;
use std::io::{Cursor, Read};
use std::path::Path;

/// The largest archive.
const MAX_ARCHIVE_BYTES: u64 = 4 << 30;
/// The largest sum of the sizes of its files.
const MAX_TOTAL_BYTES: u64 = 8 << 30;
/// An entry may not expand by more than this, once it is larger than [`RATIO_FROM_BYTES`]: real
/// meshes and pictures stay below 30.
const MAX_RATIO: u64 = 200;
const RATIO_FROM_BYTES: u64 = 1 << 20;

/// The files of an archive, unpacked one at a time when they are asked for.
#[derive(Clone)]
pub struct ZipSource {
    archive: zip::ZipArchive<Cursor<AssetBytes>>,
    /// Normalised path to the entry's index and size.
    entries: BTreeMap<String, (usize, u64)>,
}

impl ZipSource {
    /// Reads the directory of an archive held in memory and checks it against the limits.
    pub fn new(name: &str, bytes: AssetBytes) -> Result<Self, AssetError> {
        let bad = |reason: String| AssetError::Refused {
            path: name.to_owned(),
            reason,
        };
        let mut archive = zip::ZipArchive::new(Cursor::new(bytes))
            .map_err(|e| bad(format!("not a zip archive: {e}")))?;
        if archive.len() > MAX_FILES {
            return Err(bad(format!(
                "{} files, more than the limit of {MAX_FILES}",
                archive.len()
            )));
        }
        let mut entries = BTreeMap::new();
        let mut total: u64 = 0;
        for index in 0..archive.len() {
            let entry = archive
                .by_index_raw(index)
                .map_err(|e| bad(format!("entry {index}: {e}")))?;
            if entry.is_dir() {
                continue;
            }
            let raw = String::from_utf8(entry.name_raw().to_vec())
                .map_err(|_| bad(format!("entry {index} has a name that is not UTF-8")))?;
            let (size, packed) = (entry.size(), entry.compressed_size());
            if entry.is_symlink() {
                return Err(bad(format!("{raw} is a link")));
            }
            if entry.encrypted() {
                return Err(bad(format!("{raw} is encrypted")));
            }
            total = total.saturating_add(size);
            if size > MAX_FILE_BYTES {
                return Err(AssetError::TooLarge {
                    path: raw,
                    size_bytes: size,
                    limit_bytes: MAX_FILE_BYTES,
                });
            }
            if total > MAX_TOTAL_BYTES {
                return Err(AssetError::TooLarge {
                    path: name.to_owned(),
                    size_bytes: total,
                    limit_bytes: MAX_TOTAL_BYTES,
                });
            }
            if size > RATIO_FROM_BYTES && size / packed.max(1) > MAX_RATIO {
                return Err(bad(format!("{raw} expands more than {MAX_RATIO} times")));
            }
            let path = normalize(&raw)?;
            if entries.insert(path.clone(), (index, size)).is_some() {
                return Err(bad(format!("{path} is in it twice")));
            }
        }
        Ok(ZipSource { archive, entries })
    }

    /// The same, from a file on disk.
    pub fn open(file: &Path) -> Result<Self, AssetError> {
        let name = file
            .file_name()
            .map(|n| n.to_string_lossy().into_owned())
            .unwrap_or_default();
        let unreadable = |e: std::io::Error| AssetError::Unreadable {
            path: name.clone(),
            reason: e.to_string(),
        };
        let about = file.metadata().map_err(unreadable)?;
        if !about.is_file() {
            return Err(AssetError::Refused {
                path: name,
                reason: "not a plain file".into(),
            });
        }
        if about.len() > MAX_ARCHIVE_BYTES {
            let (size_bytes, limit_bytes) = (about.len(), MAX_ARCHIVE_BYTES);
            return Err(AssetError::TooLarge {
                path: name,
                size_bytes,
                limit_bytes,
            });
        }
        let bytes = std::fs::read(file).map_err(unreadable)?;
        Self::new(&name, bytes.into())
    }

    fn take(&self, path: &str, limit: u64) -> Result<AssetBytes, AssetError> {
        let path = normalize(path)?;
        let Some(&(index, size)) = self.entries.get(&path) else {
            return Err(AssetError::NotFound { path });
        };
        let unreadable = |reason: String| AssetError::Unreadable {
            path: path.clone(),
            reason,
        };
        // The directory is shared, only the read position is copied: reads from several threads do not meet.
        let mut archive = self.archive.clone();
        let entry = archive
            .by_index(index)
            .map_err(|e| unreadable(e.to_string()))?;
        let mut bytes = Vec::new();
        entry
            .take(limit.min(size.saturating_add(1)))
            .read_to_end(&mut bytes)
            .map_err(|e| unreadable(e.to_string()))?;
        if bytes.len() as u64 > size {
            return Err(unreadable(
                "it holds more bytes than the archive says".into(),
            ));
        }
        Ok(bytes.into())
    }
}

impl AssetSource for ZipSource {
    fn read(&self, path: &str) -> Result<AssetBytes, AssetError> {
        self.take(path, u64::MAX)
    }
    fn read_prefix(&self, path: &str, n: usize) -> Result<AssetBytes, AssetError> {
        self.take(path, n as u64)
    }
    fn exists(&self, path: &str) -> bool {
        normalize(path).is_ok_and(|p| self.entries.contains_key(&p))
    }
    fn list(&self) -> Vec<String> {
        self.entries.keys().cloned().collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::io::Write;
    use zip::write::SimpleFileOptions;

    fn pack(files: &[(&str, &[u8])]) -> AssetBytes {
        let mut writer = zip::ZipWriter::new(Cursor::new(Vec::new()));
        for (name, bytes) in files {
            writer
                .start_file(*name, SimpleFileOptions::default())
                .unwrap();
            writer.write_all(bytes).unwrap();
        }
        writer.finish().unwrap().into_inner().into()
    }

    #[test]
    fn reads_entries_and_keeps_to_limits() {
        let source = ZipSource::new(
            "s.zip",
            pack(&[("a/b.ply", b"hello"), ("scene.pbrt", b"WorldBegin")]),
        )
        .unwrap();
        assert_eq!(source.list(), ["a/b.ply", "scene.pbrt"]);
        assert_eq!(&source.read("a/./b.ply").unwrap()[..], b"hello");
        assert_eq!(&source.read_prefix("a/b.ply", 2).unwrap()[..], b"he");
        assert!(matches!(source.read("c"), Err(AssetError::NotFound { .. })));

        let check = |files: &[(&str, &[u8])], expect: &str| {
            let error = ZipSource::new("s.zip", pack(files))
                .map(|_| ())
                .unwrap_err()
                .to_string();
            assert!(error.contains(expect), "{error}");
        };
        check(&[("../evil", b"x")], "leaves");
        check(&[("/etc/x", b"x")], "absolute");
        check(&[("a/x", b"x"), ("a/./x", b"x")], "twice");
        check(&[("zeros", &vec![0; 4 << 20])], "200 times");
        assert!(ZipSource::new("s.zip", AssetBytes::from(&b"no zip"[..])).is_err());
    }
}
