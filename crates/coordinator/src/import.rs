//! From submitted files to a spec that workers can render, or to a problem that says where.

use crate::error::{ApiError, BAD_SCENE, INTERNAL, TOO_LARGE};
use crate::farm::Farm;
use crate::record::{SPP_DEFAULT, parse_digest};
use film::unit::{PIXELS_MAX, SIDE_MAX};
use protocol::{Finding, JobRequest, JobSpec, JobState};
use scene::assets::{AssetBytes, normalize};
use scene::{AssetError, AssetSource, Diagnostic, Overrides, SceneDesc, Severity};
use std::collections::BTreeMap;
use std::io::Read;
use std::sync::Arc;
use store::{BlobStore, Digest, StoreError};
use uuid::Uuid;

/// The files of a job, by path, out of the blobs. There is no other way to a file.
struct BlobSource {
    files: BTreeMap<String, Digest>,
    blobs: Arc<dyn BlobStore>,
}

impl BlobSource {
    fn digest(&self, path: &str) -> Result<(String, Digest), AssetError> {
        let path = normalize(path)?;
        match self.files.get(&path) {
            Some(digest) => Ok((path, *digest)),
            None => Err(AssetError::NotFound { path }),
        }
    }
}

fn unreadable(path: String, error: &StoreError) -> AssetError {
    AssetError::Unreadable {
        path,
        reason: error.to_string(),
    }
}

impl AssetSource for BlobSource {
    fn read(&self, path: &str) -> Result<AssetBytes, AssetError> {
        let (path, digest) = self.digest(path)?;
        match self.blobs.get(&digest) {
            Ok(bytes) => Ok(AssetBytes::from(&bytes[..])),
            Err(error) => Err(unreadable(path, &error)),
        }
    }

    fn read_prefix(&self, path: &str, n: usize) -> Result<AssetBytes, AssetError> {
        let (path, digest) = self.digest(path)?;
        let opened = self
            .blobs
            .open(&digest)
            .map_err(|e| unreadable(path.clone(), &e))?;
        let mut bytes = Vec::new();
        opened
            .reader
            .take(n as u64)
            .read_to_end(&mut bytes)
            .map_err(|e| AssetError::Unreadable {
                path,
                reason: e.to_string(),
            })?;
        Ok(bytes.into())
    }

    fn exists(&self, path: &str) -> bool {
        self.digest(path).is_ok()
    }

    fn list(&self) -> Vec<String> {
        self.files.keys().cloned().collect()
    }
}

/// As it goes over the wire.
pub fn finding(diagnostic: Diagnostic) -> Finding {
    Finding {
        severity: match diagnostic.severity {
            Severity::Warning => "warning".into(),
            Severity::Error => "error".into(),
        },
        file: diagnostic.place.file,
        line: diagnostic.place.line,
        column: diagnostic.place.column,
        pointer: diagnostic.place.pointer,
        reason: diagnostic.reason,
    }
}

/// What an import brings.
pub struct Imported {
    /// For workers.
    pub spec: JobSpec,
    /// Samples that the file asks for.
    pub spp: u32,
    /// Warnings.
    pub findings: Vec<Finding>,
}

/// Reads and checks a scene. Blocks, and may take a lot of memory.
pub fn import(blobs: Arc<dyn BlobStore>, request: &JobRequest) -> Result<Imported, ApiError> {
    let files = request
        .files
        .iter()
        .filter_map(|(path, digest)| Some((normalize(path).ok()?, parse_digest(digest)?)))
        .collect();
    let source = BlobSource { files, blobs };
    let overrides = Overrides {
        size: request.size,
        integrator: request.integrator.clone(),
        look: request.look.clone(),
        clamp_indirect: request.clamp_indirect,
        allow_missing: request.allow_missing,
    };
    let (desc, diagnostics) =
        scene::load(&request.scene, &source, &overrides).map_err(|error| {
            let text = error.to_string();
            let findings = error.diagnostics.into_iter().map(finding).collect();
            ApiError::new(BAD_SCENE, text).with_findings(findings)
        })?;
    let size = size(&desc, &overrides)?;
    Ok(Imported {
        spec: JobSpec {
            scene: request.scene.clone(),
            files: request.files.clone(),
            seed: request.seed,
            overrides,
            size,
        },
        spp: desc.spp.unwrap_or(SPP_DEFAULT),
        findings: diagnostics.into_iter().map(finding).collect(),
    })
}

/// Size of the picture after overrides and crop, checked against the limits.
fn size(desc: &SceneDesc, overrides: &Overrides) -> Result<[u32; 2], ApiError> {
    let film = &desc.film;
    let [width, height] = match film.crop {
        Some([x0, y0, x1, y1]) => [x1.saturating_sub(x0), y1.saturating_sub(y0)],
        None => overrides.size.unwrap_or([film.width, film.height]),
    };
    check_size([width, height])?;
    Ok([width, height])
}

/// A picture that can be rendered.
pub fn check_size([width, height]: [u32; 2]) -> Result<(), ApiError> {
    let pixels = u64::from(width) * u64::from(height);
    let side = width.max(height);
    if pixels == 0 {
        return Err(ApiError::new(
            BAD_SCENE,
            format!("a picture of {width} x {height} pixels"),
        ));
    }
    if side > SIDE_MAX {
        return Err(ApiError::limit(
            TOO_LARGE,
            "side_pixels",
            SIDE_MAX.into(),
            Some(side.into()),
        ));
    }
    if pixels > PIXELS_MAX {
        return Err(ApiError::limit(
            TOO_LARGE,
            "picture_pixels",
            PIXELS_MAX,
            Some(pixels),
        ));
    }
    Ok(())
}

/// Imports a request on a thread that may block, a few at a time.
pub async fn import_on_thread(farm: &Arc<Farm>, request: JobRequest) -> Result<Imported, ApiError> {
    let _permit = farm.imports.acquire().await;
    let blobs = farm.stores.blobs.clone();
    tokio::task::spawn_blocking(move || import(blobs, &request))
        .await
        .unwrap_or_else(|_| Err(ApiError::new(INTERNAL, "the import of the scene crashed")))
}

/// Checks a job and queues it, or fails it.
pub async fn run(farm: Arc<Farm>, id: Uuid) {
    let Ok(request) = farm.with_job(id, |job| Ok(job.record.request.clone())) else {
        return;
    };
    let result = tokio::select! {
        result = import_on_thread(&farm, request) => result,
        () = farm.shutdown.cancelled() => return, // checked again at the next start
    };
    let now = farm.clock.now();
    {
        let mut state = farm.state();
        let Some(job) = state.jobs.get_mut(&id) else {
            return;
        };
        if job.record.state != JobState::Checking {
            return;
        }
        match result.and_then(|imported| fits(job, imported)) {
            Ok(imported) => {
                let bytes = serde_json::to_vec(&imported.spec).unwrap_or_default();
                job.record.spec_digest = blake3::hash(&bytes).to_hex().to_string();
                job.record.file_spp = Some(imported.spp);
                job.record.warnings = imported.findings;
                job.record.spec = Some(imported.spec);
                job.record.stop.spp = resolved_spp(&job.record);
                job.record.state = JobState::Queued;
                job.waiting_since = now;
                let [w, h] = job.record.spec.as_ref().map_or([0, 0], |s| s.size);
                job.note(now, "info", format!("queued: {w} x {h} pixels"), None, None);
                job.open_frames();
                tracing::info!(job.id = %id, width = w, height = h, "queued");
            }
            Err(error) => {
                tracing::info!(job.id = %id, %error, "the scene is refused");
                job.fail(now, error.problem());
            }
        }
        job.dirty = true;
    }
    farm.wake.notify_waiters();
    farm.tell_job(id);
    if let Err(error) = farm.save(id).await {
        // It is in memory and goes on; a restart would check it again.
        tracing::error!(job.id = %id, %error, "the record is not saved");
    }
}

/// What the stop amounts to where the file decides, so that people see a number.
fn resolved_spp(record: &crate::record::JobRecord) -> Option<u32> {
    let stop = &record.stop;
    let open =
        stop.spp.is_none() && stop.noise.is_none() && stop.time.is_none() && stop.samples.is_none();
    if open {
        Some(record.rule().spp)
    } else {
        stop.spp
    }
}

/// Whether the job's stop fits the picture.
fn fits(job: &crate::job::Job, imported: Imported) -> Result<Imported, ApiError> {
    let [width, height] = imported.spec.size;
    let tiles = film::TileGrid { width, height }.count() as usize;
    match &job.record.stop.samples {
        Some(counts) if counts.len() != tiles => Err(ApiError::new(
            crate::error::INVALID,
            format!(
                "stop.samples has {} counts, the picture has {tiles} tiles",
                counts.len()
            ),
        )),
        _ => Ok(imported),
    }
}
