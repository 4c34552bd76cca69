//! New jobs: checked as far as that goes without reading the scene, stored, then imported.

use crate::error::{ASSETS_MISSING, ApiError, INVALID, KEY_REUSED, TOO_LARGE, TOO_MANY};
use crate::farm::Farm;
use crate::job::Job;
use crate::record::{JobRecord, parse_digest};
use crate::{import, status};
use film::unit::SPP_MAX;
use protocol::{JobRequest, JobStatus, Stop};
use scene::assets::normalize;
use std::collections::BTreeSet;
use std::sync::Arc;
use store::{Created, Digest, IdempotencyKey};
use uuid::Uuid;

/// Missing files that an error names.
const NAMED_MAX: usize = 20;
/// Longest idempotency key, in bytes.
pub const KEY_BYTES_MAX: usize = 256;

fn invalid(text: impl Into<String>) -> ApiError {
    ApiError::new(INVALID, text)
}

/// Whether a stop can be.
pub fn check_stop(stop: &Stop) -> Result<(), ApiError> {
    let positive = |name: &str, value: Option<f64>| match value {
        Some(v) if !(v.is_finite() && v > 0.0) => {
            Err(invalid(format!("stop.{name} has to be above zero")))
        }
        _ => Ok(()),
    };
    positive("noise", stop.noise)?;
    positive("time", stop.time)?;
    let counts = stop.samples.iter().flatten().copied();
    for spp in stop.spp.into_iter().chain(counts) {
        if spp > SPP_MAX {
            return Err(ApiError::limit(
                TOO_LARGE,
                "spp",
                SPP_MAX.into(),
                Some(spp.into()),
            ));
        }
    }
    if stop.spp == Some(0) {
        return Err(invalid("stop.spp has to be above zero"));
    }
    if stop.samples.as_ref().is_some_and(|s| s.contains(&0)) {
        return Err(invalid("stop.samples has a tile without samples"));
    }
    if stop.samples.is_some() && (stop.noise.is_some() || stop.time.is_some()) {
        return Err(invalid(
            "stop.samples says all: it goes with neither noise nor time",
        ));
    }
    Ok(())
}

/// A name that fits.
pub fn check_name(farm: &Farm, name: &str) -> Result<(), ApiError> {
    let max = farm.config.limits.name_bytes;
    if name.len() > max {
        return Err(ApiError::limit(
            INVALID,
            "name_bytes",
            max as u64,
            Some(name.len() as u64),
        ));
    }
    Ok(())
}

/// 0 to 100.
pub fn check_priority(priority: u8) -> Result<(), ApiError> {
    if priority > 100 {
        return Err(ApiError::limit(
            INVALID,
            "priority",
            100,
            Some(priority.into()),
        ));
    }
    Ok(())
}

/// Checks a request without reading the scene, and writes its paths in their one spelling.
pub fn check(farm: &Farm, request: &mut JobRequest) -> Result<(), ApiError> {
    let limits = &farm.config.limits;
    if request.files.len() > limits.files {
        return Err(ApiError::limit(
            TOO_LARGE,
            "files",
            limits.files as u64,
            Some(request.files.len() as u64),
        ));
    }
    let path = |p: &str| normalize(p).map_err(|e| invalid(e.to_string()));
    let mut files = std::collections::BTreeMap::new();
    for (name, digest) in &request.files {
        if parse_digest(digest).is_none() {
            return Err(invalid(format!(
                "files: the digest of {name:?} is not 64 lower-case hex digits"
            )));
        }
        if files.insert(path(name)?, digest.clone()).is_some() {
            return Err(invalid(format!("files: {name:?} is there twice")));
        }
    }
    request.files = files;
    request.scene = path(&request.scene)?;
    if !request.files.contains_key(&request.scene) {
        return Err(invalid(format!(
            "scene: {:?} is not among the files",
            request.scene
        )));
    }
    if let Some(env) = &mut request.look.env {
        *env = path(env)?;
    }
    if let Some(name) = &request.name {
        check_name(farm, name)?;
    }
    request.priority.map_or(Ok(()), check_priority)?;
    check_stop(&request.stop)?;
    if let Some(size) = request.size {
        import::check_size(size)?;
    }
    if request
        .clamp_indirect
        .is_some_and(|c| !(c.is_finite() && c > 0.0))
    {
        return Err(invalid("clamp_indirect has to be above zero"));
    }
    if let Some([first, last]) = request.frames {
        let count = u64::from(last.saturating_sub(first)) + 1;
        if first > last {
            return Err(invalid(format!("frames: {first} is after {last}")));
        }
        if count > limits.frames.into() {
            return Err(ApiError::limit(
                TOO_LARGE,
                "frames",
                limits.frames.into(),
                Some(count),
            ));
        }
    }
    Ok(())
}

/// Which of these blobs are not there.
pub async fn missing(farm: &Arc<Farm>, digests: Vec<Digest>) -> Result<Vec<Digest>, ApiError> {
    let blobs = farm.stores.blobs.clone();
    let look = tokio::task::spawn_blocking(move || {
        let mut seen = BTreeSet::new();
        let mut missing = Vec::new();
        for digest in digests {
            if seen.insert(digest) && blobs.size(&digest)?.is_none() {
                missing.push(digest);
            }
        }
        Ok::<_, store::StoreError>(missing)
    });
    Ok(look.await.unwrap_or_else(|_| {
        Err(store::StoreError::Unavailable {
            reason: "looking for blobs crashed".into(),
        })
    })?)
}

/// Takes a job. With a key that was used before, returns that job.
pub async fn submit(
    farm: &Arc<Farm>,
    mut request: JobRequest,
    key: Option<String>,
) -> Result<JobStatus, ApiError> {
    check(farm, &mut request)?;
    let limits = &farm.config.limits;
    let now = farm.clock.now();
    let active = farm
        .state()
        .jobs
        .values()
        .filter(|j| !j.record.state.is_final())
        .count();
    if active >= limits.active_jobs {
        return Err(ApiError::limit(
            TOO_MANY,
            "active_jobs",
            limits.active_jobs as u64,
            Some(active as u64),
        ));
    }
    let key = match key {
        Some(key) if key.is_empty() || key.len() > KEY_BYTES_MAX => {
            return Err(ApiError::limit(
                INVALID,
                "idempotency_key_bytes",
                KEY_BYTES_MAX as u64,
                Some(key.len() as u64),
            ));
        }
        Some(key) => {
            let body = serde_json::to_vec(&request).map_err(|e| invalid(e.to_string()))?;
            Some(IdempotencyKey {
                key,
                request: *blake3::hash(&body).as_bytes(),
            })
        }
        None => None,
    };
    let id = Uuid::now_v7();
    let record = JobRecord::new(id, request, now);
    let blobs = record.file_blobs();
    // Held before it is looked at, so that nobody removes it in between.
    farm.refs.hold(blobs.iter().copied());
    let stored = store(farm, &record, key).await;
    match stored {
        Ok(Created::New(revision)) => {
            let mut state = farm.state();
            for blob in &blobs {
                state.young.remove(blob);
            }
            let job = Job::new(record, revision);
            let status = status::of(&job, &state.workers, now, &farm.config);
            state.jobs.insert(id, job);
            drop(state);
            tracing::info!(job.id = %id, job.name = status.name, "submitted");
            farm.tell_job(id);
            farm.tasks.spawn(import::run(farm.clone(), id));
            Ok(status)
        }
        other => {
            farm.refs.release_kept(blobs);
            match other? {
                Created::Exists(known) => farm.status(known),
                _ => Err(ApiError::new(
                    KEY_REUSED,
                    "the key came with another request before",
                )),
            }
        }
    }
}

async fn store(
    farm: &Arc<Farm>,
    record: &JobRecord,
    key: Option<IdempotencyKey>,
) -> Result<Created, ApiError> {
    let missing = missing(farm, record.file_blobs().into_iter().collect()).await?;
    if !missing.is_empty() {
        let named: Vec<&str> = record
            .request
            .files
            .iter()
            .filter(|(_, d)| parse_digest(d).is_some_and(|d| missing.contains(&d)))
            .map(|(path, _)| path.as_str())
            .take(NAMED_MAX)
            .collect();
        return Err(ApiError::new(
            ASSETS_MISSING,
            format!(
                "{} files are not uploaded, among them {}",
                missing.len(),
                named.join(", ")
            ),
        ));
    }
    let bytes = record.encode().map_err(|e| invalid(e.to_string()))?;
    Ok(farm.stores.jobs.create(record.id, key, bytes).await?)
}

impl Farm {
    /// How a job stands.
    pub fn status(&self, id: Uuid) -> Result<JobStatus, ApiError> {
        let now = self.clock.now();
        let state = self.state();
        let job = state.jobs.get(&id).ok_or_else(|| crate::farm::no_job(id))?;
        Ok(status::of(job, &state.workers, now, &self.config))
    }
}
