//! The API as it is spoken.

use super::support::*;
use crate::auth::{Need, need};
use crate::config::{Config, Scope, Token};
use crate::farm::Farm;
use axum::Router;
use axum::body::Body;
use axum::http::{HeaderMap, Method, Request, StatusCode};
use bytes::Bytes;
use futures::StreamExt;
use http_body_util::BodyExt;
use protocol::{JobList, JobStatus, Problem};
use serde_json::{Value, json};
use std::sync::Arc;
use tower::ServiceExt;

struct Answer {
    status: StatusCode,
    headers: HeaderMap,
    body: Bytes,
}

impl Answer {
    fn json<T: serde::de::DeserializeOwned>(&self) -> T {
        serde_json::from_slice(&self.body).unwrap_or_else(|e| panic!("{e}: {:?}", self.body))
    }
    fn problem(&self, status: u16, kind: &str) -> Problem {
        assert_eq!(
            self.headers["content-type"], "application/problem+json",
            "{:?}",
            self.body
        );
        let problem: Problem = self.json();
        assert_eq!(
            (problem.status, problem.kind.as_str()),
            (status, format!("/problems/{kind}").as_str()),
            "{problem:?}"
        );
        assert_eq!(self.status.as_u16(), status);
        assert!(problem.request_id.is_some());
        problem
    }
}

struct Web {
    rig: Rig,
    router: Router,
}

impl Web {
    async fn new(config: Config) -> Web {
        let farm = Farm::start(config).await.unwrap();
        Self::over(Rig { farm, folder: None })
    }
    fn over(rig: Rig) -> Web {
        let router = crate::routes::router(rig.farm.clone(), true);
        Web { rig, router }
    }
    async fn send(&self, request: Request<Body>) -> Answer {
        let response = self.router.clone().oneshot(request).await.unwrap();
        let (parts, body) = response.into_parts();
        Answer {
            status: parts.status,
            headers: parts.headers,
            body: body.collect().await.unwrap().to_bytes(),
        }
    }
    async fn call(
        &self,
        method: &str,
        path: &str,
        headers: &[(&str, &str)],
        body: impl Into<Body>,
    ) -> Answer {
        let mut request = Request::builder()
            .method(method)
            .uri(path)
            .header("host", "localhost");
        for (name, value) in headers {
            request = request.header(*name, *value);
        }
        self.send(request.body(body.into()).unwrap()).await
    }
    async fn get(&self, path: &str) -> Answer {
        self.call("GET", path, &[], "").await
    }
    async fn json(&self, method: &str, path: &str, body: &Value) -> Answer {
        self.call(
            method,
            path,
            &[("content-type", "application/json")],
            body.to_string(),
        )
        .await
    }
    /// Uploads the scene and submits it.
    async fn submit(&self, stop: Value) -> JobStatus {
        let digest = blake3::hash(SCENE.as_bytes()).to_hex().to_string();
        let put = self
            .call("PUT", &format!("/v1/assets/{digest}"), &[], SCENE)
            .await;
        assert!(put.status.is_success());
        let body = json!({"scene": "scene.pbrt", "files": {"scene.pbrt": digest}, "stop": stop});
        let answer = self.json("POST", "/v1/jobs", &body).await;
        assert_eq!(answer.status, 201, "{:?}", answer.body);
        let job: JobStatus = answer.json();
        assert_eq!(answer.headers["location"], format!("/v1/jobs/{}", job.id));
        self.rig
            .wait(job.id, |s| s.state != protocol::JobState::Checking)
            .await
    }
}

#[tokio::test]
async fn from_upload_to_picture() {
    let web = Web::over(Rig::embedded().await);
    let job = web.submit(json!({"spp": 4})).await;
    let image = format!("/v1/jobs/{}/image.png", job.id);
    web.get(&image).await.problem(409, "no-image-yet");
    let worker = web.rig.worker("a");
    let lease = web.rig.lease(worker, 1).await.remove(0);
    let bytes = render(lease.at.unit);
    let digest = blake3::hash(&bytes).to_hex().to_string();
    let path = format!("/v1/worker/results/{}/{}", job.id, lease.at.unit);
    let id = worker.to_string();
    let headers = [
        ("brolly-worker", id.as_str()),
        ("brolly-blake3", &digest),
        ("brolly-cpu-seconds", "0.5"),
    ];
    let first = web.call("PUT", &path, &headers, bytes.clone()).await;
    assert_eq!(
        (first.status.as_u16(), first.json::<Value>()),
        (201, json!({"duplicate": false}))
    );
    let second = web.call("PUT", &path, &headers, bytes.clone()).await;
    assert_eq!(
        (second.status.as_u16(), second.json::<Value>()),
        (200, json!({"duplicate": true}))
    );
    let other = render_wrong(lease.at.unit);
    web.call("PUT", &path, &headers, other.clone())
        .await
        .problem(400, "digest-mismatch");
    web.call("PUT", &path, &[("brolly-worker", &id)], other)
        .await
        .problem(409, "other-bytes");
    web.rig.merged(job.id, 1).await;
    let shown = web.get(&image).await;
    assert_eq!(
        (shown.status.as_u16(), &shown.body[1..4]),
        (200, &b"PNG"[..])
    );
    let etag = shown.headers["etag"].to_str().unwrap().to_owned();
    let same = web
        .call("GET", &image, &[("if-none-match", &etag)], "")
        .await;
    assert_eq!((same.status.as_u16(), same.body.len()), (304, 0));
    let exr = web.get(&format!("/v1/jobs/{}/image.exr", job.id)).await;
    assert_eq!(exr.body[..4], [0x76, 0x2f, 0x31, 0x01]);
    for query in ["layer=error", "exposure=2.5", "tonemap=filmic", "frame=0"] {
        assert_eq!(
            web.get(&format!("{image}?{query}")).await.status,
            200,
            "{query}"
        );
    }
    for query in [
        "layer=nonsense",
        "exposure=NaN",
        "tonemap=x",
        "frame=-1",
        "size=9",
    ] {
        web.get(&format!("{image}?{query}"))
            .await
            .problem(400, "bad-request");
    }
    web.get(&format!("{image}?frame=1"))
        .await
        .problem(404, "no-frame");
    let status: JobStatus = web.get(&format!("/v1/jobs/{}", job.id)).await.json();
    assert_eq!((status.units_merged, status.cpu_seconds), (1, 0.5));
    let tiles: Value = web.get(&format!("/v1/jobs/{}/tiles", job.id)).await.json();
    assert_eq!(tiles["samples"], json!([1, 0, 0, 0]));
    assert_eq!(tiles["tiles"][0]["worker"], "a");
    let log: Value = web.get(&format!("/v1/jobs/{}/log", job.id)).await.json();
    assert!(log.as_array().unwrap().len() >= 2);
    web.rig.farm.state().workers.clear();
    let delete = web
        .call("DELETE", &format!("/v1/jobs/{}", job.id), &[], "")
        .await;
    assert_eq!(delete.status, 204);
    let worker = web.rig.worker("b").to_string();
    web.call("PUT", &path, &[("brolly-worker", &worker)], bytes)
        .await
        .problem(410, "gone");
}

#[tokio::test]
async fn assets_are_checked_while_they_come() {
    let mut config = config(crate::config::StoreConfig::Memory);
    config.limits.asset_bytes = 1000;
    let web = Web::new(config).await;
    let digest = |b: &[u8]| blake3::hash(b).to_hex().to_string();
    let (good, large) = (digest(b"good"), digest(&[7; 1001]));
    let path = |d: &str| format!("/v1/assets/{d}");
    web.get(&path(&good)).await.problem(404, "no-asset");
    web.call("PUT", &path(&good), &[], "bad")
        .await
        .problem(400, "digest-mismatch");
    assert_eq!(web.call("PUT", &path(&good), &[], "good").await.status, 201);
    assert_eq!(web.call("PUT", &path(&good), &[], "good").await.status, 200);
    let got = web.get(&path(&good)).await;
    assert_eq!(
        (
            &got.body[..],
            got.headers["content-length"].to_str().unwrap()
        ),
        (&b"good"[..], "4")
    );
    let head = web.call("HEAD", &path(&good), &[], "").await;
    assert_eq!(
        (
            head.status.as_u16(),
            head.headers["content-length"].to_str().unwrap()
        ),
        (200, "4")
    );
    let limit = web
        .call("PUT", &path(&large), &[], vec![7; 1001])
        .await
        .problem(413, "too-large")
        .limit
        .unwrap();
    assert_eq!((limit.name.as_str(), limit.value), ("asset_bytes", 1000));
    // Without a length, too.
    let pieces =
        futures::stream::iter((0..10).map(|_| Ok::<_, std::io::Error>(Bytes::from(vec![7; 200]))));
    web.call("PUT", &path(&large), &[], Body::from_stream(pieces))
        .await
        .problem(413, "too-large");
    web.call("PUT", &path(&good), &[("content-encoding", "gzip")], "x")
        .await
        .problem(415, "unsupported-media-type");
    for bad in ["x", "..%2f..%2fetc%2fpasswd", &good.to_uppercase()] {
        web.get(&path(bad)).await.problem(404, "no-asset");
    }
    let missing = json!({"digests": [good, large]});
    let answer: Value = web
        .json("POST", "/v1/assets/missing", &missing)
        .await
        .json();
    assert_eq!(answer, json!({"missing": [large]}));
}

#[tokio::test]
async fn bad_requests_are_problems() {
    let web = Web::new(config(crate::config::StoreConfig::Memory)).await;
    let digest = blake3::hash(SCENE.as_bytes()).to_hex().to_string();
    web.get("/v1/nothing").await.problem(404, "no-route");
    web.call("DELETE", "/v1/jobs", &[], "")
        .await
        .problem(405, "method-not-allowed");
    web.call("POST", "/v1/jobs", &[], "{}")
        .await
        .problem(415, "unsupported-media-type");
    let json_type = [("content-type", "application/json")];
    web.call("POST", "/v1/jobs", &json_type, "{")
        .await
        .problem(400, "bad-request");
    web.call("POST", "/v1/jobs", &json_type, "{}")
        .await
        .problem(422, "invalid");
    let body = |change: Value| {
        let mut body = json!({"scene": "scene.pbrt", "files": {"scene.pbrt": digest}});
        body.as_object_mut()
            .unwrap()
            .extend(change.as_object().unwrap().clone());
        body
    };
    let bad = [
        json!({"scene": "other.pbrt"}),
        json!({"scene": "../scene.pbrt"}),
        json!({"files": {"scene.pbrt": "12"}}),
        json!({"files": {"scene.pbrt": digest, "/etc/passwd": digest}}),
        json!({"priority": 101}),
        json!({"stop": {"spp": 0}}),
        json!({"stop": {"noise": -1.0}}),
        json!({"stop": {"samples": [1], "time": 3.0}}),
        json!({"frames": [4, 3]}),
        json!({"name": "x".repeat(300)}),
        json!({"nonsense": 1}),
        json!({"clamp_indirect": 0.0}),
    ];
    for change in bad {
        web.json("POST", "/v1/jobs", &body(change))
            .await
            .problem(422, "invalid");
    }
    let large = [
        (json!({"stop": {"spp": 20_000_000}}), "spp"),
        (json!({"size": [70_000, 1]}), "side_pixels"),
        (json!({"size": [60_000, 60_000]}), "picture_pixels"),
        (json!({"frames": [0, 4_000_000_000u32]}), "frames"),
    ];
    for (change, name) in large {
        let problem = web
            .json("POST", "/v1/jobs", &body(change))
            .await
            .problem(413, "too-large");
        assert_eq!(problem.limit.unwrap().name, name);
    }
    let problem = web
        .json("POST", "/v1/jobs", &body(json!({})))
        .await
        .problem(422, "assets-missing");
    assert!(problem.detail.unwrap().contains("scene.pbrt"));
    for path in [
        "/v1/jobs/x",
        "/v1/jobs/01890a5d-ac96-774b-bcce-b302099a8057",
    ] {
        web.get(path).await.problem(404, "no-job");
        web.call("POST", &format!("{path}/cancel"), &[], "")
            .await
            .problem(404, "no-job");
    }
    web.get("/v1/jobs?limit=x")
        .await
        .problem(400, "bad-request");
    web.get("/v1/jobs?cursor=x")
        .await
        .problem(400, "bad-request");
    let wrong_site = [("origin", "http://evil.example")];
    web.call("GET", "/v1/jobs", &wrong_site, "")
        .await
        .problem(403, "foreign-origin");
    let request = Request::get("/v1/jobs")
        .header("host", "evil.example")
        .body(Body::empty());
    web.send(request.unwrap())
        .await
        .problem(403, "foreign-origin");
}

#[tokio::test]
async fn a_key_makes_one_job() {
    let web = Web::over(Rig::embedded().await);
    let digest = crate::record::hex(&web.rig.farm.stores.blobs.put(SCENE.as_bytes()).unwrap());
    let body = |seed: u64| {
        json!({"scene": "scene.pbrt", "files": {"scene.pbrt": digest}, "seed": seed}).to_string()
    };
    let headers = [
        ("content-type", "application/json"),
        ("idempotency-key", "k1"),
    ];
    let first: JobStatus = web.call("POST", "/v1/jobs", &headers, body(1)).await.json();
    let again = web.call("POST", "/v1/jobs", &headers, body(1)).await;
    assert_eq!(
        (again.status.as_u16(), again.json::<JobStatus>().id),
        (201, first.id)
    );
    web.call("POST", "/v1/jobs", &headers, body(2))
        .await
        .problem(422, "idempotency-key-reused");
}

#[tokio::test]
async fn lists_have_pages() {
    let web = Web::new(config(crate::config::StoreConfig::Memory)).await;
    let mut ids = Vec::new();
    for _ in 0..5 {
        ids.insert(0, web.submit(json!({})).await.id);
    }
    let mut seen = Vec::new();
    let mut path = "/v1/jobs?limit=2".to_owned();
    loop {
        let page: JobList = web.get(&path).await.json();
        seen.extend(page.jobs.iter().map(|j| j.id));
        match page.next {
            Some(next) => path = format!("/v1/jobs?limit=2&cursor={next}"),
            None => break,
        }
    }
    assert_eq!(seen, ids);
    let none: JobList = web.get("/v1/jobs?state=failed").await.json();
    assert!(none.jobs.is_empty());
}

#[tokio::test]
async fn events_begin_with_a_snapshot() {
    let web = Web::new(config(crate::config::StoreConfig::Memory)).await;
    let job = web.submit(json!({"spp": 1})).await;
    let request = Request::get(format!("/v1/jobs/{}/events", job.id))
        .header("last-event-id", "7")
        .body(Body::empty());
    let response = web.router.clone().oneshot(request.unwrap()).await.unwrap();
    assert_eq!(response.headers()["content-type"], "text/event-stream");
    let mut stream = response.into_body().into_data_stream();
    let mut text = String::new();
    let worker = web.rig.worker("a");
    let mut worked = false;
    while !text.contains("\"state\":\"done\"") {
        let piece = tokio::time::timeout(std::time::Duration::from_secs(30), stream.next()).await;
        text.push_str(std::str::from_utf8(&piece.unwrap().unwrap().unwrap()).unwrap());
        if !worked {
            assert!(
                text.contains("event: job") && text.contains("id: ") && text.contains("queued"),
                "{text}"
            );
            web.rig.work(worker, job.id).await;
            worked = true;
        }
    }
    assert!(
        text.contains("event: image") && text.contains("\"tiles\":["),
        "{text}"
    );
    web.rig.farm.close().await;
    while let Some(rest) = stream.next().await {
        rest.unwrap();
    }
}

#[tokio::test]
async fn pages_for_people_and_machines() {
    let web = Web::new(config(crate::config::StoreConfig::Memory)).await;
    let empty = web.get("/").await;
    assert!(String::from_utf8_lossy(&empty.body).contains("No jobs yet"));
    let job = web.submit(json!({"spp": 1})).await;
    let patch = json!({"name": "<script>alert(1)</script>"});
    assert_eq!(
        web.json("PATCH", &format!("/v1/jobs/{}", job.id), &patch)
            .await
            .status,
        200
    );
    let page = web.get("/").await;
    let text = String::from_utf8_lossy(&page.body).into_owned();
    assert!(text.contains("&lt;script&gt;alert") && !text.contains("<script>alert"));
    let policy = page.headers["content-security-policy"].to_str().unwrap();
    assert!(policy.contains("default-src 'none'") && !policy.contains("unsafe"));
    assert_eq!(page.headers["x-content-type-options"], "nosniff");
    assert!(
        !text.contains("http://") && !text.contains("https://"),
        "nothing from elsewhere"
    );
    for file in [
        "/web/app.js",
        "/web/style.css",
        "/healthz",
        "/readyz",
        "/openapi.json",
    ] {
        assert_eq!(web.get(file).await.status, 200, "{file}");
    }
    web.get("/web/..%2fCargo.toml")
        .await
        .problem(404, "no-route");
    let metrics = web.get("/metrics").await;
    let metrics = String::from_utf8_lossy(&metrics.body).into_owned();
    assert!(
        metrics.contains("brolly_jobs{state=\"queued\"} 1"),
        "{metrics}"
    );
    web.rig.farm.close().await;
    web.get("/readyz").await.problem(503, "unavailable");
}

/// Every route with every scope, with none, and with an unknown token.
#[tokio::test]
async fn tokens_open_what_they_should() {
    let mut config = config(crate::config::StoreConfig::Memory);
    let scopes = [Scope::Watch, Scope::Submit, Scope::Work, Scope::Admin];
    let secret = |scope: Scope| format!("{}-secret", scope.name());
    config.tokens = scopes
        .iter()
        .map(|s| Token::new(*s, &secret(*s)).unwrap())
        .collect();
    let web = Web::new(config).await;
    let id = "01890a5d-ac96-774b-bcce-b302099a8057";
    let digest = "0".repeat(64);
    let mut routes: Vec<(String, String)> = Vec::new();
    let api: Value = serde_json::from_str(&crate::openapi::document()).unwrap();
    for (path, methods) in api["paths"].as_object().unwrap() {
        for method in methods.as_object().unwrap().keys() {
            let path = path
                .replace("{id}", id)
                .replace("{job}", id)
                .replace("{unit}", "0-0-0-1")
                .replace("{digest}", &digest);
            routes.push((method.to_uppercase(), path));
        }
    }
    assert!(routes.len() >= 30, "{}", routes.len());
    routes.push(("GET".into(), "/v1/nothing".into()));
    for (method, path) in &routes {
        let needs = need(&Method::from_bytes(method.as_bytes()).unwrap(), path);
        // A body that is no JSON: whoever gets as far is refused for that.
        let status = async |token: Option<String>| {
            let value = token.map(|t| format!("Bearer {t}"));
            let headers: Vec<(&str, &str)> = value
                .iter()
                .map(|v| ("authorization", v.as_str()))
                .collect();
            let mut request = Request::builder()
                .method(method.as_str())
                .uri(path)
                .header("host", "localhost");
            for (name, value) in headers {
                request = request.header(name, value);
            }
            let request = request.body(Body::from("{")).unwrap();
            // Streams do not end: only the head of the answer is of interest.
            web.router
                .clone()
                .oneshot(request)
                .await
                .unwrap()
                .status()
                .as_u16()
        };
        let closed = needs != Need::Open;
        assert_eq!(status(None).await == 401, closed, "{method} {path}");
        assert_eq!(
            status(Some("unknown-secret".into())).await == 401,
            closed,
            "{method} {path}"
        );
        for scope in scopes {
            let refused = matches!(status(Some(secret(scope))).await, 401 | 403);
            let expected = !needs.met_by(scope) || (needs == Need::Asset && scope == Scope::Work);
            assert_eq!(refused, expected, "{method} {path} with {}", scope.name());
        }
    }
}

#[tokio::test]
async fn workers_read_only_files_of_their_jobs() {
    let mut config = config(crate::config::StoreConfig::Memory);
    config.tokens = vec![
        Token::new(Scope::Work, "work-secret").unwrap(),
        Token::new(Scope::Work, "other-secret").unwrap(),
        Token::new(Scope::Submit, "submit-secret").unwrap(),
    ];
    let farm = Farm::start(config).await.unwrap();
    let rig = Rig { farm, folder: None };
    let id = rig.submit(spp(1)).await;
    let web = Web::over(rig);
    let path = format!("/v1/assets/{}", blake3::hash(SCENE.as_bytes()).to_hex());
    let read = async |secret: &str| {
        let value = format!("Bearer {secret}");
        web.call("GET", &path, &[("authorization", &value)], "")
            .await
            .status
            .as_u16()
    };
    assert_eq!(
        (read("work-secret").await, read("submit-secret").await),
        (403, 200)
    );
    let worker = web.rig.farm.register(about("a"), Some(0)).unwrap().worker;
    let leases = web
        .rig
        .farm
        .sync(asking(worker, 1), Some(0))
        .await
        .unwrap()
        .leases;
    assert_eq!(leases.len(), 1);
    assert_eq!(
        (read("work-secret").await, read("other-secret").await),
        (200, 403)
    );
    // Another token cannot speak for this worker.
    assert!(web.rig.farm.sync(asking(worker, 1), Some(1)).await.is_err());
    web.rig.farm.cancel(id).await.unwrap();
    let mut request = asking(worker, 0);
    request.held = vec![leases[0].at.clone()];
    web.rig.farm.sync(request, Some(0)).await.unwrap();
    assert_eq!(read("work-secret").await, 403);
}

#[tokio::test]
async fn off_loopback_somebody_says_who_may_do_what() {
    let listener = tokio::net::TcpListener::bind("127.0.0.1:0").await.unwrap();
    let mut open = Config::default();
    assert!(crate::check_address(&listener, &open).is_ok());
    // An address off loopback is not bound here: the rule is asked about one.
    let outside: std::net::SocketAddr = "192.0.2.1:7878".parse().unwrap();
    assert!(crate::check_open(&outside, &open).is_err());
    open.insecure = true;
    assert!(crate::check_open(&outside, &open).is_ok());
    open.insecure = false;
    open.tokens = vec![Token::new(Scope::Admin, "admin-secret").unwrap()];
    assert!(crate::check_open(&outside, &open).is_ok());
}

#[tokio::test]
async fn it_serves_over_a_socket() {
    use tokio::io::{AsyncReadExt, AsyncWriteExt};
    let coordinator = crate::Coordinator::bind("127.0.0.1:0", Config::default())
        .await
        .unwrap();
    let address = coordinator.local_addr();
    let shutdown = tokio_util::sync::CancellationToken::new();
    let running = tokio::spawn(coordinator.run(shutdown.clone()));
    let mut stream = tokio::net::TcpStream::connect(address).await.unwrap();
    let request = format!("GET /healthz HTTP/1.1\r\nhost: {address}\r\nconnection: close\r\n\r\n");
    stream.write_all(request.as_bytes()).await.unwrap();
    let mut text = String::new();
    stream.read_to_string(&mut text).await.unwrap();
    assert!(
        text.starts_with("HTTP/1.1 200") && text.ends_with("ok\n"),
        "{text}"
    );
    shutdown.cancel();
    running.await.unwrap().unwrap();
}

#[test]
fn farms_are_shared() {
    fn shared<T: Send + Sync>() {}
    shared::<Arc<Farm>>();
}
