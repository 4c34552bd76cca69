//! A worker driven by hand, for what a good one never does.

use bytes::Bytes;
use client::{Client, ClientError, Delivery, UnitResult, digest};
use film::ENGINE_VERSION;
use protocol::{JobSpec, Lease, LeaseRef, RegisterRequest, SyncRequest, SyncResponse};
use scene::assets::MemorySource;
use std::collections::HashMap;
use tracer::{PrepareSettings, StopFlag};
use uuid::Uuid;

use super::wait_until;

/// Registered, and doing only what it is told.
pub struct RawWorker {
    pub client: Client,
    pub id: Uuid,
    specs: HashMap<Uuid, JobSpec>,
}

impl RawWorker {
    pub async fn register(client: &Client, name: &str) -> Self {
        let request = RegisterRequest {
            name: name.into(),
            threads: 1,
            engine_version: ENGINE_VERSION,
            version: "test".into(),
            simd: "scalar".into(),
            memory_bytes: 1 << 29,
            previous_id: None,
        };
        let id = client.register(&request).await.expect("registered").worker;
        RawWorker {
            client: client.clone(),
            id,
            specs: HashMap::new(),
        }
    }

    pub async fn sync(&mut self, held: Vec<LeaseRef>, want: u32) -> SyncResponse {
        let request = SyncRequest {
            worker: self.id,
            held,
            given_back: Vec::new(),
            failed: Vec::new(),
            want,
            want_samples: 0,
            wait_ms: 200,
            draining: false,
            prepared: Vec::new(),
        };
        let response = self.client.sync(&request).await.expect("sync");
        self.specs.extend(response.specs.clone());
        response
    }

    /// Asks until there is a lease.
    pub async fn lease(&mut self) -> Lease {
        for _ in 0..600 {
            if let Some(lease) = self.sync(Vec::new(), 1).await.leases.pop() {
                return lease;
            }
        }
        panic!("no lease to be had");
    }

    /// Renders a lease as any worker does.
    pub async fn render(&self, lease: &Lease) -> Vec<u8> {
        let spec = &self.specs[&lease.at.job];
        let mut source = MemorySource::new();
        for (path, digest) in &spec.files {
            let bytes = self.client.asset(digest).await.expect("an asset");
            source.insert(path, &bytes[..]).expect("a path");
        }
        let (desc, _) = scene::load(&spec.scene, &source, &spec.overrides).expect("the scene");
        let settings = PrepareSettings {
            seed: spec.seed,
            frame: lease.at.unit.frame,
            clamp_indirect: None,
            threads: 1,
            picture_bytes: u64::MAX,
        };
        let stop = StopFlag::default();
        let scene = tracer::prepare(&desc, &source, &settings, &stop).expect("prepared");
        let (buffer, counters) =
            tracer::render_unit(&scene, &lease.at.unit, &stop).expect("rendered");
        film::encode_unit(lease.at.unit, &buffer, &counters, ENGINE_VERSION)
    }

    /// Delivers bytes for a lease.
    pub async fn deliver(&self, lease: &Lease, bytes: Vec<u8>) -> Result<Delivery, ClientError> {
        let result = UnitResult {
            worker: self.id,
            lease: lease.at.clone(),
            blake3: digest::of_bytes(&bytes),
            bytes: Bytes::from(bytes),
            cpu_seconds: 0.01,
        };
        self.client.deliver(&result).await
    }

    /// Waits until the coordinator has given up on a lease.
    pub async fn wait_until_lost(&mut self, job: Uuid) {
        let client = self.client.clone();
        wait_until("the lease expires", async || {
            let status = client.job(job).await.expect("the job's state");
            (status.units_leased == 0).then_some(())
        })
        .await;
    }
}
