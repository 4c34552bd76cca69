//! From what a user names to the files of a job: which of them the scene uses, their digests, and
//! the request that names them.

use crate::args::{LookArgs, SceneArgs};
use anyhow::Context;
use client::{Client, Upload, UploadBody, digest};
use protocol::JobRequest;
use scene::assets::{AssetBytes, RecordingSource};
use scene::{AssetError, AssetSource, Diagnostic, Look, Overrides, SceneDesc};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

/// Folder of files that come from outside the scene's own, such as `--env`.
const OUTSIDE: &str = "brolly-look";

/// A scene that was read and found good.
pub struct LocalScene {
    /// The folder on disk, unless it is an archive.
    folder: Option<PathBuf>,
    /// The files; `--env` is among them.
    pub source: Box<dyn AssetSource>,
    /// The main file.
    pub main: String,
    /// The files that are used.
    pub used: Vec<String>,
    /// What it describes.
    pub desc: SceneDesc,
    /// What the reader found.
    pub warnings: Vec<Diagnostic>,
    /// The look flags with paths of the job.
    pub look: Look,
}

/// The files of a scene and one more from elsewhere.
struct WithFile {
    inner: Box<dyn AssetSource>,
    path: String,
    bytes: AssetBytes,
}

impl AssetSource for WithFile {
    fn read(&self, path: &str) -> Result<AssetBytes, AssetError> {
        if path == self.path {
            return Ok(self.bytes.clone());
        }
        self.inner.read(path)
    }
    fn read_prefix(&self, path: &str, n: usize) -> Result<AssetBytes, AssetError> {
        if path == self.path {
            return Ok(AssetBytes::from(&self.bytes[..n.min(self.bytes.len())]));
        }
        self.inner.read_prefix(path, n)
    }
    fn exists(&self, path: &str) -> bool {
        path == self.path || self.inner.exists(path)
    }
    fn list(&self) -> Vec<String> {
        let mut list = self.inner.list();
        list.push(self.path.clone());
        list.sort();
        list
    }
}

/// Opens and reads a scene. Errors carry every finding.
pub fn open(
    path: &Path,
    look: &LookArgs,
    settings: impl FnOnce(Look) -> Overrides,
) -> anyhow::Result<LocalScene> {
    let (mut source, main) = scene::assets::open(path)?;
    let folder = if path.is_dir() {
        Some(path.to_owned())
    } else if path.file_name().is_some_and(|name| name == main.as_str()) {
        Some(path.parent().unwrap_or(Path::new("")).to_owned())
    } else {
        None // an archive
    };
    let mut env = None;
    if let Some(file) = &look.env {
        let bytes =
            std::fs::read(file).with_context(|| format!("{} cannot be read", file.display()))?;
        let name = file
            .file_name()
            .map(|n| n.to_string_lossy().into_owned())
            .unwrap_or_default();
        let inside = format!("{OUTSIDE}/{name}");
        source = Box::new(WithFile {
            inner: source,
            path: inside.clone(),
            bytes: bytes.into(),
        });
        env = Some(inside);
    }
    let look = look.look(env);
    let overrides = settings(look.clone());
    let recording = RecordingSource::new(&*source);
    let (desc, warnings) = scene::load(&main, &recording, &overrides)?;
    let mut used = recording.used();
    used.insert(main.clone());
    used.extend(look.env.clone());
    Ok(LocalScene {
        folder,
        used: used.into_iter().collect(),
        source,
        main,
        desc,
        warnings,
        look,
    })
}

/// Opens a scene for a job.
pub fn open_for_job(args: &SceneArgs) -> anyhow::Result<LocalScene> {
    open(&args.scene, &args.look, |look| Overrides {
        size: args.size,
        integrator: args.integrator.clone(),
        look,
        clamp_indirect: args.clamp_indirect,
        allow_missing: args.allow_missing,
    })
}

impl LocalScene {
    /// Names every file that is used. Files on disk are hashed several at a time and will be
    /// streamed; what comes out of an archive is kept in memory until it is sent.
    async fn uploads(&self) -> anyhow::Result<BTreeMap<String, Upload>> {
        let mut uploads = BTreeMap::new();
        let mut on_disk = Vec::new();
        for path in &self.used {
            // Reading it through the source has shown that it does not leave the folder.
            match &self.folder {
                Some(folder) if self.look.env.as_ref() != Some(path) => {
                    on_disk.push((path.clone(), folder.join(path)));
                }
                _ => {
                    let bytes = self.source.read(path)?;
                    let upload = Upload {
                        digest: digest::of_bytes(&bytes),
                        body: UploadBody::Bytes(bytes::Bytes::from_owner(bytes)),
                    };
                    uploads.insert(path.clone(), upload);
                }
            }
        }
        let files = on_disk.iter().map(|(_, file)| file.clone()).collect();
        for ((path, file), digest) in on_disk.into_iter().zip(digest::of_files(files).await?) {
            let body = UploadBody::File(file);
            uploads.insert(path, Upload { digest, body });
        }
        Ok(uploads)
    }

    /// Sends what the coordinator lacks and returns the request for the job.
    pub async fn upload(&self, client: &Client, args: &SceneArgs) -> anyhow::Result<JobRequest> {
        let uploads = self.uploads().await?;
        let list: Vec<Upload> = uploads.values().cloned().collect();
        let sent = client
            .upload_missing(&list)
            .await
            .context("the scene's files cannot be uploaded")?;
        tracing::info!(files = list.len(), sent, "uploaded the scene");
        Ok(JobRequest {
            scene: self.main.clone(),
            files: uploads
                .into_iter()
                .map(|(path, upload)| (path, upload.digest))
                .collect(),
            name: None,
            priority: None,
            seed: args.seed,
            size: args.size,
            integrator: args.integrator.clone(),
            stop: args.stop.rule(),
            look: self.look.clone(),
            frames: args.frames,
            allow_missing: args.allow_missing,
            clamp_indirect: args.clamp_indirect,
        })
    }
}
