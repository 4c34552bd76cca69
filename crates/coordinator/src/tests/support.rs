//! A farm under test, and workers that render by hashing.

use crate::config::{Config, StoreConfig};
use crate::error::ApiError;
use crate::farm::Farm;
use crate::owner::Order;
use crate::results::{Delivery, Taken};
use bytes::Bytes;
use film::unit::pass_end;
use film::{Film, LayerSample, Receipt, SampleBuffer, SampleRange, TileGrid, Unit};
use protocol::{
    JobRequest, JobState, JobStatus, Lease, LeaseRef, RegisterRequest, Stop, SyncRequest,
    SyncResponse,
};
use std::collections::BTreeMap;
use std::path::PathBuf;
use std::sync::Arc;
use std::time::{Duration, Instant};
use store::Stores;
use uuid::Uuid;

/// The picture of every test: four tiles, cut at two borders.
pub const GRID: TileGrid = TileGrid {
    width: 100,
    height: 70,
};

pub const SCENE: &str = r#"
Film "rgb" "integer xresolution" [100] "integer yresolution" [70]
Sampler "independent" "integer pixelsamples" [8]
Camera "perspective" "float fov" [40]
WorldBegin
LightSource "infinite"
Shape "sphere" "float radius" [1]
"#;

/// Waiting that long means hanging.
const PATIENCE: Duration = Duration::from_secs(60);

pub struct Rig {
    pub farm: Arc<Farm>,
    pub folder: Option<Arc<tempfile::TempDir>>,
}

pub fn config(store: StoreConfig) -> Config {
    Config {
        store,
        // Only when a test asks for one.
        checkpoint_every: Duration::from_secs(3600),
        ..Config::default()
    }
}

impl Rig {
    pub async fn memory() -> Rig {
        Rig {
            farm: Farm::start(config(StoreConfig::Memory)).await.unwrap(),
            folder: None,
        }
    }

    /// That many workers, and never another.
    pub async fn with_crew(workers: usize) -> Rig {
        let config = Config {
            crew: Some(workers),
            ..config(StoreConfig::Memory)
        };
        Rig {
            farm: Farm::start(config).await.unwrap(),
            folder: None,
        }
    }

    pub async fn embedded() -> Rig {
        let folder = Arc::new(tempfile::tempdir().unwrap());
        Self::open(folder).await
    }

    pub async fn open(folder: Arc<tempfile::TempDir>) -> Rig {
        let store = StoreConfig::Embedded(folder.path().to_owned());
        Rig {
            farm: Farm::start(config(store)).await.unwrap(),
            folder: Some(folder),
        }
    }

    pub async fn with_stores(stores: Stores) -> Rig {
        Rig {
            farm: Farm::with_stores(config(StoreConfig::Memory), stores)
                .await
                .unwrap(),
            folder: None,
        }
    }

    pub fn path(&self) -> PathBuf {
        self.folder.as_ref().unwrap().path().to_owned()
    }

    /// As if the process had been killed: no checkpoint, no goodbye.
    pub async fn crash(self) -> Arc<tempfile::TempDir> {
        let Rig { farm, folder } = self;
        farm.shutdown.cancel();
        farm.tasks.close();
        farm.tasks.wait().await;
        for job in farm.state().jobs.values_mut() {
            if let Some(owner) = job.owner.take() {
                owner.send(Order::Stop);
            }
        }
        farm.owners.close();
        farm.owners.wait().await;
        assert_eq!(
            Arc::strong_count(&farm),
            1,
            "something still holds the farm"
        );
        folder.unwrap()
    }

    pub async fn restart(self) -> Rig {
        Self::open(self.crash().await).await
    }

    /// Ends as on SIGTERM, with last checkpoints, and starts again.
    pub async fn restart_gracefully(self) -> Rig {
        self.farm.close().await;
        let Rig { farm, folder } = self;
        drop(farm);
        Self::open(folder.unwrap()).await
    }

    pub fn request(&self, stop: Stop) -> JobRequest {
        let digest = self.farm.stores.blobs.put(SCENE.as_bytes()).unwrap();
        JobRequest {
            scene: "scene.pbrt".into(),
            files: BTreeMap::from([("scene.pbrt".into(), crate::record::hex(&digest))]),
            name: None,
            priority: None,
            seed: 0,
            size: None,
            integrator: None,
            stop,
            look: Default::default(),
            frames: None,
            allow_missing: false,
            clamp_indirect: None,
        }
    }

    pub async fn submit_request(&self, request: JobRequest) -> Uuid {
        let job = crate::submit::submit(&self.farm, request, None)
            .await
            .unwrap();
        self.wait(job.id, |s| s.state != JobState::Checking).await;
        let status = self.status(job.id);
        assert_eq!(status.problem, None);
        job.id
    }

    pub async fn submit(&self, stop: Stop) -> Uuid {
        self.submit_request(self.request(stop)).await
    }

    pub fn status(&self, id: Uuid) -> JobStatus {
        self.farm.status(id).unwrap()
    }

    /// Waits for what other threads do; real time, also where tokio's is paused.
    pub async fn wait(&self, id: Uuid, f: impl Fn(&JobStatus) -> bool) -> JobStatus {
        let start = Instant::now();
        loop {
            let status = self.status(id);
            if f(&status) {
                return status;
            }
            assert!(start.elapsed() < PATIENCE, "hangs: {status:?}");
            std::thread::sleep(Duration::from_millis(2));
            tokio::task::yield_now().await;
        }
    }

    pub async fn done(&self, id: Uuid) -> JobStatus {
        self.wait(id, |s| s.state == JobState::Done).await
    }

    pub async fn merged(&self, id: Uuid, units: u64) -> JobStatus {
        self.wait(id, |s| s.units_merged >= units).await
    }

    pub fn worker(&self, name: &str) -> Uuid {
        self.farm.register(about(name), None).unwrap().worker
    }

    pub async fn sync(&self, request: SyncRequest) -> SyncResponse {
        self.farm.sync(request, None).await.unwrap()
    }

    pub async fn lease(&self, worker: Uuid, want: u32) -> Vec<Lease> {
        self.sync(asking(worker, want)).await.leases
    }

    pub async fn deliver(&self, worker: Uuid, at: &LeaseRef) -> Result<Taken, ApiError> {
        self.send(worker, at, render(at.unit)).await
    }

    pub async fn send(
        &self,
        worker: Uuid,
        at: &LeaseRef,
        bytes: Vec<u8>,
    ) -> Result<Taken, ApiError> {
        let delivery = Delivery {
            job: at.job,
            unit: at.unit,
            worker,
            token: None,
            digest: *blake3::hash(&bytes).as_bytes(),
            claimed: None,
            bytes: Bytes::from(bytes),
            cpu_seconds: 0.001,
        };
        self.farm.take(delivery).await
    }

    /// Renders until nothing is offered for a while and the job is done.
    pub async fn work(&self, worker: Uuid, id: Uuid) -> JobStatus {
        let start = Instant::now();
        loop {
            let status = self.status(id);
            if status.state.is_final() {
                return status;
            }
            assert!(start.elapsed() < PATIENCE, "hangs: {status:?}");
            let leases = self.lease(worker, 7).await;
            for lease in &leases {
                self.deliver(worker, &lease.at).await.unwrap();
            }
            if leases.is_empty() {
                std::thread::sleep(Duration::from_millis(1));
                tokio::task::yield_now().await;
            }
        }
    }

    pub fn film_digest(&self, id: Uuid, frame: u32) -> [u8; 32] {
        let film = crate::checkpoint::look(&self.farm, id, frame)
            .unwrap()
            .unwrap();
        let film = film.read().unwrap();
        film.digest()
    }
}

pub fn asking(worker: Uuid, want: u32) -> SyncRequest {
    SyncRequest {
        worker,
        held: vec![],
        given_back: vec![],
        failed: vec![],
        want,
        want_samples: 0,
        wait_ms: 0,
        draining: false,
        prepared: vec![],
    }
}

pub fn about(name: &str) -> RegisterRequest {
    RegisterRequest {
        name: name.into(),
        threads: 1,
        engine_version: film::ENGINE_VERSION,
        version: "test".into(),
        simd: "none".into(),
        memory_bytes: 1 << 30,
        previous_id: None,
    }
}

pub fn spp(n: u32) -> Stop {
    Stop {
        spp: Some(n),
        ..Stop::default()
    }
}

/// A few pixels of each sample, by hash: adds up whatever the cut.
pub fn render(unit: Unit) -> Vec<u8> {
    let tile = GRID.tile(unit.tile);
    let mut buffer = SampleBuffer::new(tile, unit.samples);
    let mut counters = film::Counters::default();
    for index in unit.samples.begin..unit.samples.end {
        for n in 0..3u32 {
            let mut hasher = blake3::Hasher::new();
            for word in [unit.frame, unit.tile, index, n] {
                hasher.update(&word.to_le_bytes());
            }
            let hash = *hasher.finalize().as_bytes();
            let x = u32::from(hash[0]) % tile.width;
            let y = u32::from(hash[1]) % tile.height;
            let value = |i: usize| f32::from(hash[i]) * 0.013;
            let sample = LayerSample {
                beauty: [value(2), value(3), value(4)],
                alpha: 1.0,
                ..LayerSample::EMPTY
            };
            buffer.add(x, y, index, &sample).unwrap();
            counters.samples += 1;
            counters.rays += 2;
        }
    }
    film::encode_unit(unit, &buffer, &counters, film::ENGINE_VERSION)
}

/// Bytes that decode, and are wrong.
pub fn render_wrong(unit: Unit) -> Vec<u8> {
    let mut result = film::decode_unit(&render(unit)).unwrap();
    result.buffer.pixels_mut()[0].beauty[0] += 1 << 20;
    film::encode_unit(unit, &result.buffer, &result.counters, film::ENGINE_VERSION)
}

/// What one machine gets that renders everything in order.
pub fn oracle(frame: u32, counts: impl Fn(u32) -> u32) -> [u8; 32] {
    let mut film = Film::new(GRID, frame);
    for tile in 0..GRID.count() {
        let mut begin = 0;
        while begin < counts(tile) {
            let end = pass_end(begin).min(counts(tile));
            let samples = SampleRange { begin, end };
            let bytes = render(Unit {
                frame,
                tile,
                samples,
            });
            let result = film::decode_unit(&bytes).unwrap();
            film.merge(&result, Receipt::of(&bytes, "oracle")).unwrap();
            begin = end;
        }
    }
    film.digest()
}

pub fn hex(digest: &[u8; 32]) -> Option<String> {
    Some(crate::record::hex(digest))
}
