//! BLAKE3 digests of files: their names on the wire.

use crate::ClientError;
use futures::{StreamExt, TryStreamExt};
use std::path::{Path, PathBuf};

/// Digest of bytes in lower-case hex.
pub fn of_bytes(bytes: &[u8]) -> String {
    blake3::hash(bytes).to_hex().to_string()
}

/// Digest of one file, read in pieces.
pub fn of_file(path: &Path) -> Result<String, ClientError> {
    let hash = || -> std::io::Result<String> {
        let mut hasher = blake3::Hasher::new();
        hasher.update_reader(std::fs::File::open(path)?)?;
        Ok(hasher.finalize().to_hex().to_string())
    };
    hash().map_err(|source| ClientError::File {
        path: path.to_owned(),
        source,
    })
}

/// Digests of many files, several at a time, in their order.
pub async fn of_files(paths: Vec<PathBuf>) -> Result<Vec<String>, ClientError> {
    let at_once = std::thread::available_parallelism().map_or(4, usize::from);
    futures::stream::iter(paths)
        .map(|path| async move {
            let shown = path.clone();
            tokio::task::spawn_blocking(move || of_file(&path))
                .await
                .unwrap_or_else(|e| {
                    Err(ClientError::File {
                        path: shown,
                        source: std::io::Error::other(e),
                    })
                })
        })
        .buffered(at_once)
        .try_collect()
        .await
}

#[cfg(test)]
mod tests {
    use super::*;

    #[tokio::test]
    async fn files_and_bytes_agree() {
        let dir = tempfile::tempdir().unwrap();
        let paths: Vec<_> = (0..20u8)
            .map(|i| {
                let path = dir.path().join(i.to_string());
                std::fs::write(&path, vec![i; 100_000 + i as usize]).unwrap();
                path
            })
            .collect();
        let digests = of_files(paths.clone()).await.unwrap();
        for (i, digest) in digests.iter().enumerate() {
            assert_eq!(digest, &of_bytes(&vec![i as u8; 100_000 + i]));
        }
        let missing = of_files(vec![dir.path().join("nothing")]).await;
        assert!(matches!(missing, Err(ClientError::File { .. })));
    }
}
