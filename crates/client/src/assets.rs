//! Files of scenes: upload what is missing, download what is needed.

use crate::{Client, ClientError, digest};
use bytes::Bytes;
use futures::{StreamExt, TryStreamExt};
use protocol::{MissingRequest, MissingResponse};
use reqwest::Method;
use std::collections::BTreeMap;
use std::path::PathBuf;
use tokio_util::io::ReaderStream;

/// Uploads and downloads that run at the same time.
const AT_ONCE: usize = 8;
/// Digests in one question, so that its body stays far below the coordinator's limit.
const ASKED_AT_ONCE: usize = 4096;

/// Where the bytes of an upload come from.
#[derive(Clone, Debug)]
pub enum UploadBody {
    /// Streamed from a file.
    File(PathBuf),
    /// From memory.
    Bytes(Bytes),
}

/// A file to be offered to the coordinator.
#[derive(Clone, Debug)]
pub struct Upload {
    /// BLAKE3 in lower-case hex.
    pub digest: String,
    /// Its bytes.
    pub body: UploadBody,
}

impl Client {
    /// Which of these the coordinator lacks, in their order.
    pub async fn missing_assets(&self, digests: &[String]) -> Result<Vec<String>, ClientError> {
        let mut missing = Vec::new();
        for part in digests.chunks(ASKED_AT_ONCE) {
            let request = MissingRequest {
                digests: part.to_vec(),
            };
            let answer: MissingResponse = self.post("v1/assets/missing", &request).await?;
            missing.extend(answer.missing);
        }
        Ok(missing)
    }

    /// Uploads those that the coordinator lacks, several at a time. Returns how many that were.
    pub async fn upload_missing(&self, uploads: &[Upload]) -> Result<usize, ClientError> {
        // The same bytes under two names travel once.
        let by_digest: BTreeMap<&str, &Upload> =
            uploads.iter().map(|u| (u.digest.as_str(), u)).collect();
        let digests: Vec<String> = by_digest.keys().map(|d| d.to_string()).collect();
        let missing = self.missing_assets(&digests).await?;
        let wanted: Vec<Upload> = missing
            .iter()
            .filter_map(|digest| by_digest.get(digest.as_str()).map(|u| (*u).clone()))
            .collect();
        let count = wanted.len();
        futures::stream::iter(wanted)
            .map(|upload| async move { self.upload(&upload).await })
            .buffer_unordered(AT_ONCE)
            .try_collect::<()>()
            .await?;
        Ok(count)
    }

    /// Uploads one file, again from its beginning when the connection breaks.
    pub async fn upload(&self, upload: &Upload) -> Result<(), ClientError> {
        let path = format!("v1/assets/{}", upload.digest);
        let mut failures = 0;
        loop {
            let request = self
                .request(Method::PUT, &path)
                .header("Content-Type", "application/octet-stream");
            let request = match &upload.body {
                UploadBody::Bytes(bytes) => request.body(bytes.clone()),
                UploadBody::File(file) => {
                    let fail = |source| ClientError::File {
                        path: file.clone(),
                        source,
                    };
                    let opened = tokio::fs::File::open(file).await.map_err(fail)?;
                    let length = opened.metadata().await.map_err(fail)?.len();
                    request
                        .header("Content-Length", length)
                        .body(reqwest::Body::wrap_stream(ReaderStream::with_capacity(
                            opened,
                            1 << 16,
                        )))
                }
            };
            let Err(error) = self.send_once(request).await else {
                return Ok(());
            };
            failures += 1;
            match self.retry().pause(failures, &error) {
                Some(pause) => tokio::time::sleep(pause).await,
                None => return Err(error),
            }
        }
    }

    /// Downloads one file and checks it against its name.
    pub async fn asset(&self, digest: &str) -> Result<Bytes, ClientError> {
        let path = format!("v1/assets/{digest}");
        let response = self.send(|| self.request(Method::GET, &path)).await?;
        let bytes = response.bytes().await.map_err(|e| self.unreachable(e))?;
        let actual = digest::of_bytes(&bytes);
        if actual != digest {
            return Err(ClientError::Digest {
                expected: digest.to_owned(),
                actual,
            });
        }
        Ok(bytes)
    }
}
