//! What a job record says: everything about a job that outlives the process.

use crate::plan::OPEN_SPP_MAX;
use film::unit::SPP_MAX;
use film::{StopRule, TileGrid};
use protocol::{
    Finding, HistoryPoint, JobRequest, JobSpec, JobState, LogLine, Problem, Stop, TimestampMs,
};
use serde::{Deserialize, Serialize};
use std::collections::{BTreeMap, BTreeSet};
use store::Digest;
use uuid::Uuid;

/// Version of the record.
const RECORD_VERSION: u32 = 1;
/// Samples per pixel where neither the job nor the file says.
pub const SPP_DEFAULT: u32 = 64;
/// Lines of the log that are kept.
pub const LOG_LINES_MAX: usize = 500;
/// Points of the history that are kept; beyond, every other one is dropped.
pub const HISTORY_MAX: usize = 512;

/// Sums of a frame for people; the film has the truth.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct FrameStats {
    /// Camera samples.
    pub samples: u64,
    /// Rays of all kinds.
    pub rays: u64,
    /// Samples that added nothing.
    pub rejected: u64,
    /// Units merged.
    pub units: u64,
    /// Remaining error.
    pub error: Option<f64>,
}

/// A committed checkpoint.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Checkpoint {
    /// Manifest, in hex.
    pub manifest: String,
    /// Results before this position of the log are in it.
    pub log_pos: u64,
}

/// A tile that was cleared: its results before a position of the log do not count.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Void {
    /// Which tile.
    pub tile: u32,
    /// Position.
    pub before: u64,
}

/// One frame that was begun.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct FrameRecord {
    /// The newest.
    pub current: Option<Checkpoint>,
    /// The one before, should the newest be damaged.
    pub previous: Option<Checkpoint>,
    /// Cleared tiles that a checkpoint may still hold.
    pub voids: Vec<Void>,
    /// Where a time limit ended it.
    pub stopped_at: Option<Vec<u32>>,
    /// Complete and checkpointed.
    pub done: bool,
    /// For people.
    pub stats: FrameStats,
}

/// Everything about a job that is kept.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct JobRecord {
    /// Of this format.
    pub version: u32,
    /// Id.
    pub id: Uuid,
    /// As it was submitted.
    pub request: JobRequest,
    /// Life.
    pub state: JobState,
    /// For people.
    pub name: String,
    /// 0 to 100.
    pub priority: u8,
    /// Stop in force.
    pub stop: Stop,
    /// Samples that the file asks for.
    pub file_spp: Option<u32>,
    /// Engine version that it was begun with.
    pub engine: u32,
    /// What workers are told; absent while checking.
    pub spec: Option<JobSpec>,
    /// BLAKE3 of the spec.
    pub spec_digest: String,
    /// First and last frame.
    pub frames: [u32; 2],
    /// Frames that were begun.
    pub begun: BTreeMap<u32, FrameRecord>,
    /// The time limit is reached: only first passes are left.
    pub timed_out: bool,
    /// Findings of the checks.
    pub warnings: Vec<Finding>,
    /// Why it failed.
    pub problem: Option<Problem>,
    /// When it was submitted.
    pub created_at: TimestampMs,
    /// First lease.
    pub started_at: Option<TimestampMs>,
    /// First merged result.
    pub first_image_at: Option<TimestampMs>,
    /// End.
    pub finished_at: Option<TimestampMs>,
    /// Accumulated running time, seconds.
    pub run_seconds: f64,
    /// Processor time of units, seconds.
    pub cpu_seconds: f64,
    /// Longest preparation, seconds.
    pub prepare_seconds: f64,
    /// Rises with every change of the picture.
    pub image_version: u64,
    /// Of the first frame's merged state, in hex.
    pub digest: Option<String>,
    /// Whether the noise target was reached everywhere.
    pub target_met: Option<bool>,
    /// Error over time.
    pub history: Vec<HistoryPoint>,
    /// What happened.
    pub log: Vec<LogLine>,
}

impl JobRecord {
    /// A new job.
    pub fn new(id: Uuid, request: JobRequest, now: TimestampMs) -> Self {
        JobRecord {
            version: RECORD_VERSION,
            id,
            state: JobState::Checking,
            name: request
                .name
                .clone()
                .unwrap_or_else(|| default_name(&request.scene)),
            priority: request.priority.unwrap_or(50),
            stop: request.stop.clone(),
            file_spp: None,
            engine: film::ENGINE_VERSION.0,
            spec: None,
            spec_digest: String::new(),
            frames: request.frames.unwrap_or([0, 0]),
            begun: BTreeMap::new(),
            timed_out: false,
            warnings: Vec::new(),
            problem: None,
            created_at: now,
            started_at: None,
            first_image_at: None,
            finished_at: None,
            run_seconds: 0.0,
            cpu_seconds: 0.0,
            prepare_seconds: 0.0,
            image_version: 0,
            digest: None,
            target_met: None,
            history: Vec::new(),
            log: Vec::new(),
            request,
        }
    }

    /// As bytes for the store.
    pub fn encode(&self) -> Result<Vec<u8>, serde_json::Error> {
        serde_json::to_vec(self)
    }

    /// Back from bytes; the error says why not.
    pub fn decode(bytes: &[u8]) -> Result<Self, String> {
        let record: JobRecord = serde_json::from_slice(bytes).map_err(|e| e.to_string())?;
        if record.version > RECORD_VERSION {
            return Err(format!(
                "job record version {}; this program reads up to {RECORD_VERSION}",
                record.version
            ));
        }
        Ok(record)
    }

    /// How the picture is cut; no tiles while checking.
    pub fn grid(&self) -> TileGrid {
        let [width, height] = self.spec.as_ref().map_or([0, 0], |s| s.size);
        TileGrid { width, height }
    }

    /// When tiles stop, without regard to time.
    pub fn rule(&self) -> StopRule {
        rule(&self.stop, self.file_spp)
    }

    /// The same, for a frame that a time limit may have ended.
    pub fn frame_rule(&self, frame: u32) -> StopRule {
        let mut rule = self.rule();
        match self.begun.get(&frame).and_then(|f| f.stopped_at.clone()) {
            Some(counts) => {
                rule.noise = None;
                rule.spp = counts.iter().copied().max().unwrap_or(0);
                rule.samples = Some(counts);
            }
            // Begun after the time was up: a picture all the same, of one pass.
            None if self.timed_out => {
                rule.noise = None;
                rule.spp = rule.spp.min(1);
            }
            None => {}
        }
        rule
    }

    /// Number of frames.
    pub fn frame_count(&self) -> u32 {
        self.frames[1]
            .saturating_sub(self.frames[0])
            .saturating_add(1)
    }

    /// Files of the scene.
    pub fn file_blobs(&self) -> BTreeSet<Digest> {
        let files = self.request.files.values();
        files.filter_map(|text| parse_digest(text)).collect()
    }

    /// Notes a line in the log.
    pub fn note(&mut self, line: LogLine) {
        if self.log.len() >= LOG_LINES_MAX {
            // The first lines say how it began, so the oldest of the later ones goes.
            self.log.remove(LOG_LINES_MAX / 4);
        }
        self.log.push(line);
    }

    /// Adds a warning about the job as a whole, once.
    pub fn warn(&mut self, reason: String) {
        if self.warnings.iter().any(|known| known.reason == reason) {
            return;
        }
        self.warnings.push(Finding {
            severity: "warning".into(),
            file: self.request.scene.clone(),
            line: None,
            column: None,
            pointer: None,
            reason,
        });
    }

    /// Notes a point of the history.
    pub fn point(&mut self, point: HistoryPoint) {
        if self.history.len() >= HISTORY_MAX {
            let mut keep = false;
            self.history.retain(|_| {
                keep = !keep;
                keep
            });
        }
        self.history.push(point);
    }
}

/// When tiles stop, without regard to time.
pub fn rule(stop: &Stop, file_spp: Option<u32>) -> StopRule {
    let spp = match (stop.spp, &stop.samples) {
        (Some(spp), _) => spp,
        (None, Some(counts)) => counts.iter().copied().max().unwrap_or(0),
        (None, None) if is_open(stop) => OPEN_SPP_MAX,
        (None, None) => file_spp.unwrap_or(SPP_DEFAULT),
    };
    StopRule {
        spp: spp.min(SPP_MAX),
        noise: stop.noise,
        samples: stop.samples.clone(),
    }
}

/// Whether nothing but noise or time ends it.
pub fn is_open(stop: &Stop) -> bool {
    stop.spp.is_none() && stop.samples.is_none() && (stop.noise.is_some() || stop.time.is_some())
}

/// Lower-case hex to digest.
pub fn parse_digest(text: &str) -> Option<Digest> {
    // The parser of the digest crate would take upper case, too; names are spelled one way.
    let lower = text
        .bytes()
        .all(|b| b.is_ascii_digit() || (b'a'..=b'f').contains(&b));
    let hash = blake3::Hash::from_hex(text).ok()?;
    lower.then(|| *hash.as_bytes())
}

/// Digest to lower-case hex.
pub fn hex(digest: &Digest) -> String {
    blake3::Hash::from_bytes(*digest).to_hex().to_string()
}

fn default_name(path: &str) -> String {
    let file = path.rsplit('/').next().unwrap_or(path);
    file.rsplit_once('.').map_or(file, |(stem, _)| stem).into()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn stops_are_completed() {
        let check = |stop: Stop, file: Option<u32>, spp: u32| {
            assert_eq!(rule(&stop, file).spp, spp, "{stop:?} {file:?}");
        };
        let none = Stop::default();
        check(none.clone(), None, 64);
        check(none.clone(), Some(16), 16);
        let noise = Stop {
            noise: Some(0.1),
            ..none.clone()
        };
        check(noise.clone(), Some(16), 65_536);
        let spp = Stop {
            spp: Some(300),
            ..noise
        };
        check(spp, Some(16), 300);
        let time = Stop {
            time: Some(9.0),
            ..none.clone()
        };
        check(time, Some(16), 65_536);
        let samples = Stop {
            samples: Some(vec![3, 9]),
            ..none
        };
        check(samples, None, 9);
    }

    #[test]
    fn digests_have_one_spelling() {
        let good = "0".repeat(63) + "a";
        assert_eq!(parse_digest(&good).map(|d| hex(&d)), Some(good.clone()));
        for bad in ["", "0", &good.to_uppercase(), &good[..62], &"g".repeat(64)] {
            assert_eq!(parse_digest(bad), None, "{bad}");
        }
    }
}
