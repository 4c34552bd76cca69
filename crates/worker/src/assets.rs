//! Files of scenes, by digest: fetched once, kept in memory while there is room.

use client::{Client, ClientError};
use futures::{StreamExt, TryStreamExt};
use protocol::JobSpec;
use scene::AssetError;
use scene::assets::{AssetBytes, MemorySource};
use std::collections::HashMap;
use std::sync::{Arc, Mutex, PoisonError};

/// Downloads that run at the same time.
const AT_ONCE: usize = 8;

/// Why the files of a scene could not be had.
#[derive(Debug, thiserror::Error)]
pub enum FetchError {
    #[error("{path} cannot be fetched")]
    Download {
        path: String,
        #[source]
        source: ClientError,
    },
    #[error("a path of the job is refused")]
    Path(#[from] AssetError),
}

/// Shared by all preparations of a worker.
#[derive(Clone)]
pub struct AssetCache {
    client: Client,
    budget_bytes: u64,
    kept: Arc<Mutex<Kept>>,
}

#[derive(Default)]
struct Kept {
    files: HashMap<String, (AssetBytes, u64)>,
    bytes: u64,
    clock: u64,
}

impl AssetCache {
    /// An empty cache that keeps at most `budget_bytes`.
    pub fn new(client: Client, budget_bytes: u64) -> Self {
        AssetCache {
            client,
            budget_bytes,
            kept: Arc::default(),
        }
    }

    /// All files of a job, as the source that readers and the tracer take.
    pub async fn source(&self, spec: &JobSpec) -> Result<MemorySource, FetchError> {
        let files: Vec<(String, AssetBytes)> = futures::stream::iter(spec.files.clone())
            .map(|(path, digest)| async move {
                match self.file(&digest).await {
                    Ok(bytes) => Ok((path, bytes)),
                    Err(source) => Err(FetchError::Download { path, source }),
                }
            })
            .buffer_unordered(AT_ONCE)
            .try_collect()
            .await?;
        let mut source = MemorySource::new();
        for (path, bytes) in files {
            source.insert(&path, bytes)?;
        }
        Ok(source)
    }

    async fn file(&self, digest: &str) -> Result<AssetBytes, ClientError> {
        if let Some(bytes) = self.lookup(digest) {
            return Ok(bytes);
        }
        let bytes: AssetBytes = AssetBytes::from(&self.client.asset(digest).await?[..]);
        self.keep(digest, &bytes);
        Ok(bytes)
    }

    fn lookup(&self, digest: &str) -> Option<AssetBytes> {
        let mut kept = self.kept.lock().unwrap_or_else(PoisonError::into_inner);
        kept.clock += 1;
        let now = kept.clock;
        let (bytes, used) = kept.files.get_mut(digest)?;
        *used = now;
        Some(bytes.clone())
    }

    fn keep(&self, digest: &str, bytes: &AssetBytes) {
        let size = bytes.len() as u64;
        if size > self.budget_bytes {
            return;
        }
        let mut kept = self.kept.lock().unwrap_or_else(PoisonError::into_inner);
        while kept.bytes + size > self.budget_bytes {
            // The clock makes all ages different, so the map's order does not matter.
            let Some(oldest) = kept
                .files
                .iter()
                .min_by_key(|(_, (_, used))| *used)
                .map(|(digest, _)| digest.clone())
            else {
                break;
            };
            if let Some((gone, _)) = kept.files.remove(&oldest) {
                kept.bytes -= gone.len() as u64;
            }
        }
        kept.clock += 1;
        let now = kept.clock;
        if kept
            .files
            .insert(digest.to_owned(), (bytes.clone(), now))
            .is_none()
        {
            kept.bytes += size;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_oldest_files_make_room() {
        let client = Client::new("http://127.0.0.1:1", None).unwrap();
        let cache = AssetCache::new(client, 100);
        let bytes = |n: usize| AssetBytes::from(vec![0u8; n]);
        cache.keep("a", &bytes(40));
        cache.keep("b", &bytes(40));
        assert!(cache.lookup("a").is_some());
        cache.keep("c", &bytes(40));
        assert!(cache.lookup("b").is_none(), "b was used longest ago");
        assert!(cache.lookup("a").is_some() && cache.lookup("c").is_some());
        cache.keep("huge", &bytes(101));
        assert!(cache.lookup("huge").is_none());
        cache.keep("a", &bytes(40));
        assert_eq!(cache.kept.lock().unwrap().bytes, 80);
    }
}
