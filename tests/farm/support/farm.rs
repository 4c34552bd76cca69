//! A farm in this process, on loopback, on a port that the system chooses.

use super::scenes::{TestScene, Tuning};
use client::{Client, ImageQuery, RetryPolicy};
use coordinator::Config;
use protocol::{JobState, JobStatus};
use std::time::Duration;
use tokio::net::TcpListener;
use tokio::task::JoinHandle;
use tokio_util::sync::CancellationToken;
use uuid::Uuid;
use worker::{WorkerConfig, WorkerError};

/// Far beyond what anything takes on a slow machine: a test that hangs has to end.
const PATIENCE: Duration = Duration::from_secs(240);

/// A coordinator and workers.
pub struct TestFarm {
    pub url: String,
    pub client: Client,
    shutdown: CancellationToken,
    server: Option<JoinHandle<()>>,
    workers: Vec<TestWorker>,
}

struct TestWorker {
    shutdown: CancellationToken,
    task: JoinHandle<Result<(), WorkerError>>,
}

/// What a finished job is compared by.
#[derive(Clone, PartialEq)]
pub struct Outcome {
    /// Digest of the merged state.
    pub digest: Option<String>,
    /// The picture, every layer.
    pub exr: Vec<u8>,
    pub samples: u64,
    pub rays: u64,
}

impl std::fmt::Debug for Outcome {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let digest = self.digest.as_deref().unwrap_or("none");
        let exr = client::digest::of_bytes(&self.exr);
        write!(
            f,
            "state {digest:.16}, exr {exr:.16}, {} samples, {} rays",
            self.samples, self.rays
        )
    }
}

impl TestFarm {
    /// A coordinator with the memory store.
    pub async fn start() -> Self {
        Self::with_config(Config::default()).await
    }

    /// A coordinator.
    pub async fn with_config(config: Config) -> Self {
        let listener = TcpListener::bind(("127.0.0.1", 0)).await.expect("a port");
        let url = format!("http://{}", listener.local_addr().expect("an address"));
        let shutdown = CancellationToken::new();
        let stop = shutdown.clone();
        let server = tokio::spawn(async move {
            coordinator::serve(listener, config, stop)
                .await
                .expect("the coordinator serves");
        });
        let mut farm = Self::at(url);
        farm.shutdown = shutdown;
        farm.server = Some(server);
        farm
    }

    /// The farm of a coordinator that runs elsewhere.
    pub fn at(url: String) -> Self {
        let patient = RetryPolicy {
            attempts: Some(200),
            first: Duration::from_millis(20),
            longest: Duration::from_millis(500),
        };
        TestFarm {
            client: Client::new(&url, None)
                .expect("an address")
                .with_retry(patient),
            url,
            shutdown: CancellationToken::new(),
            server: None,
            workers: Vec::new(),
        }
    }

    /// Adds a worker in this process.
    pub fn worker(&mut self, threads: usize) -> &mut Self {
        self.worker_with(|config| config.threads = threads)
    }

    /// Adds a worker with other settings.
    pub fn worker_with(&mut self, change: impl FnOnce(&mut WorkerConfig)) -> &mut Self {
        let mut config = WorkerConfig::new(self.url.clone());
        config.threads = 1;
        config.memory_bytes = 1 << 29;
        config.name = format!("test-{}", self.workers.len());
        change(&mut config);
        let shutdown = CancellationToken::new();
        let task = tokio::spawn(worker::run(config, shutdown.clone()));
        self.workers.push(TestWorker { shutdown, task });
        self
    }

    /// Waits until worker `index` ends by itself.
    pub async fn ended(&mut self, index: usize) -> Result<(), WorkerError> {
        let worker = self.workers.remove(index);
        tokio::time::timeout(PATIENCE, worker.task)
            .await
            .expect("the worker ends")
            .expect("a worker does not panic")
    }

    /// Uploads and submits.
    pub async fn submit(&self, scene: &TestScene, tuning: &Tuning) -> Uuid {
        let uploads: Vec<_> = scene.uploads().into_values().collect();
        self.client.upload_missing(&uploads).await.expect("upload");
        let job = self.client.submit(&scene.request(tuning)).await;
        job.expect("the job is taken").id
    }

    /// Waits for a final state.
    pub async fn ends(&self, id: Uuid) -> JobStatus {
        wait_until(&format!("job {id} ends"), async || {
            let job = self.client.job(id).await.expect("the job's state");
            job.state.is_final().then_some(job)
        })
        .await
    }

    /// Waits until it is done.
    pub async fn done(&self, id: Uuid) -> JobStatus {
        let job = self.ends(id).await;
        assert_eq!(job.state, JobState::Done, "{:?}", job.problem);
        job
    }

    /// Submits, waits, fetches.
    pub async fn render(&self, scene: &TestScene, tuning: &Tuning) -> Outcome {
        let id = self.submit(scene, tuning).await;
        self.outcome(id).await
    }

    /// Waits for a job and fetches what it is compared by.
    pub async fn outcome(&self, id: Uuid) -> Outcome {
        let job = self.done(id).await;
        let picture = self
            .client
            .image(id, "exr", &ImageQuery::default(), None)
            .await
            .expect("the picture")
            .expect("a picture without a condition");
        Outcome {
            digest: job.digest,
            exr: picture.bytes.to_vec(),
            samples: job.samples,
            rays: job.rays,
        }
    }
}

impl Drop for TestFarm {
    fn drop(&mut self) {
        for worker in &self.workers {
            worker.shutdown.cancel();
        }
        self.shutdown.cancel();
    }
}

/// One farm in this process, one job.
pub async fn outcome(workers: &[usize], scene: &TestScene, tuning: &Tuning) -> Outcome {
    let mut farm = TestFarm::start().await;
    for &threads in workers {
        farm.worker(threads);
    }
    farm.render(scene, tuning).await
}

/// Asks until there is an answer.
pub async fn wait_until<T>(what: &str, mut ask: impl AsyncFnMut() -> Option<T>) -> T {
    let waiting = async {
        loop {
            if let Some(answer) = ask().await {
                return answer;
            }
            tokio::time::sleep(Duration::from_millis(20)).await;
        }
    };
    match tokio::time::timeout(PATIENCE, waiting).await {
        Ok(answer) => answer,
        Err(_) => panic!("waited in vain: {what}"),
    }
}
