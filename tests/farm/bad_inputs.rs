//! What a coordinator refuses, and how: always a problem with a type, never a 5xx.

use crate::support::{TestFarm, TestScene, Tuning};
use protocol::{JobState, Problem};
use reqwest::{Method, StatusCode};
use serde_json::{Value, json};

struct Case {
    what: &'static str,
    method: Method,
    path: String,
    content_type: Option<&'static str>,
    body: Vec<u8>,
    /// Any of these.
    status: &'static [u16],
    /// Somewhere in the problem.
    says: &'static str,
}

#[tokio::test(flavor = "multi_thread")]
async fn bad_requests_are_problems() {
    let scene = TestScene::room(16, 16);
    let farm = TestFarm::start().await;
    let uploads: Vec<_> = scene.uploads().into_values().collect();
    farm.client.upload_missing(&uploads).await.unwrap();
    let good = serde_json::to_value(scene.request(&Tuning::spp(1))).unwrap();
    let digest = good["files"]["scene.pbrt"].as_str().unwrap().to_owned();
    let changed = |change: &dyn Fn(&mut Value)| {
        let mut request = good.clone();
        change(&mut request);
        request.to_string().into_bytes()
    };
    let job = |what, body, status, says| Case {
        what,
        method: Method::POST,
        path: "v1/jobs".into(),
        content_type: Some("application/json"),
        body,
        status,
        says,
    };
    let unknown = "01890000-0000-7000-8000-000000000000";
    let at = |what, method, path: String, status| Case {
        what,
        method,
        path,
        content_type: None,
        body: Vec::new(),
        status,
        says: "",
    };
    let nested = format!("{}{}", "[".repeat(100_000), "]".repeat(100_000)).into_bytes();
    let cases = vec![
        job("no JSON", b"{".to_vec(), &[400], ""),
        job("deep nesting", nested, &[400, 422], ""),
        job("nothing", b"{}".to_vec(), &[400, 422], ""),
        job(
            "an unknown field",
            changed(&|r| r["nonsense"] = json!(1)),
            &[400, 422],
            "nonsense",
        ),
        job(
            "a file that was not uploaded",
            changed(&|r| r["files"]["gone.ply"] = json!("0".repeat(64))),
            &[400, 409, 422],
            "gone.ply",
        ),
        job(
            "a digest that is none",
            changed(&|r| r["files"]["x.ply"] = json!("xyz")),
            &[400, 422],
            "",
        ),
        job(
            "a path that leaves",
            changed(&|r| r["files"]["../x.ply"] = json!(digest)),
            &[400, 422],
            "..",
        ),
        job(
            "an absolute path",
            changed(&|r| r["files"]["/etc/passwd"] = json!(digest)),
            &[400, 422],
            "",
        ),
        job(
            "a main file that is not there",
            changed(&|r| r["scene"] = json!("other.pbrt")),
            &[400, 422],
            "other.pbrt",
        ),
        job(
            "an absurd size",
            changed(&|r| r["size"] = json!([65_537, 1])),
            &[413],
            "65536",
        ),
        job(
            "too many pixels",
            changed(&|r| r["size"] = json!([65_536, 65_536])),
            &[413],
            "268435456",
        ),
        job(
            "no pixels",
            changed(&|r| r["size"] = json!([0, 5])),
            &[400, 422],
            "",
        ),
        job(
            "absurd spp",
            changed(&|r| r["stop"]["spp"] = json!((1 << 24) + 1)),
            &[413],
            "16777216",
        ),
        job(
            "a negative target",
            changed(&|r| r["stop"]["noise"] = json!(-1.0)),
            &[400, 422],
            "",
        ),
        job(
            "a priority above 100",
            changed(&|r| r["priority"] = json!(101)),
            &[400, 422],
            "100",
        ),
        job(
            "frames that run backwards",
            changed(&|r| r["frames"] = json!([5, 1])),
            &[400, 422],
            "",
        ),
        // One byte more, not many: who still writes when the answer comes may not get to read it.
        job(
            "a body above the limit",
            vec![b' '; coordinator::Limits::default().json_bytes + 1],
            &[413],
            "json_bytes",
        ),
        Case {
            what: "another content type",
            content_type: Some("text/plain"),
            ..job("", good.to_string().into_bytes(), &[415], "")
        },
        at(
            "an unknown job",
            Method::GET,
            format!("v1/jobs/{unknown}"),
            &[404],
        ),
        at(
            "an id that is none",
            Method::GET,
            "v1/jobs/7".into(),
            &[400, 404],
        ),
        at(
            "a picture of an unknown job",
            Method::GET,
            format!("v1/jobs/{unknown}/image.png"),
            &[404],
        ),
        at(
            "an unknown action",
            Method::POST,
            format!("v1/jobs/{unknown}/explode"),
            &[404],
        ),
        at(
            "an unknown asset",
            Method::GET,
            format!("v1/assets/{}", "0".repeat(64)),
            &[404],
        ),
        at(
            "an asset name that is none",
            Method::GET,
            "v1/assets/..%2f".into(),
            &[400, 404],
        ),
        at(
            "an unknown route",
            Method::GET,
            "v1/nonsense".into(),
            &[404],
        ),
        at("a wrong method", Method::DELETE, "v1/jobs".into(), &[405]),
        Case {
            what: "an asset under a wrong name",
            method: Method::PUT,
            path: format!("v1/assets/{}", "0".repeat(64)),
            content_type: Some("application/octet-stream"),
            body: b"hello".to_vec(),
            status: &[400, 409, 422],
            says: "",
        },
    ];
    let http = reqwest::Client::builder().no_proxy().build().unwrap();
    let mut wrong = Vec::new();
    for case in cases {
        let mut request = http
            .request(case.method, format!("{}/{}", farm.url, case.path))
            .body(case.body);
        if let Some(content_type) = case.content_type {
            request = request.header("Content-Type", content_type);
        }
        let response = match request.send().await {
            Ok(response) => response,
            Err(error) => {
                wrong.push(format!("{}: no answer: {error:?}", case.what));
                continue;
            }
        };
        let status = response.status();
        let content_type = response
            .headers()
            .get("content-type")
            .map_or(String::new(), |v| v.to_str().unwrap().to_owned());
        let body = response.text().await.unwrap_or_default();
        if !case.status.contains(&status.as_u16()) {
            wrong.push(format!("{}: {status}: {body}", case.what));
            continue;
        }
        match serde_json::from_str::<Problem>(&body) {
            Ok(problem)
                if problem.kind.starts_with("/problems/")
                    && problem.status == status.as_u16()
                    && content_type.starts_with("application/problem+json") => {}
            _ => wrong.push(format!("{}: no problem: {content_type} {body}", case.what)),
        }
        if !body.contains(case.says) {
            wrong.push(format!(
                "{}: does not say {:?}: {body}",
                case.what, case.says
            ));
        }
    }
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
    let healthy = http.get(format!("{}/healthz", farm.url)).send().await;
    assert_eq!(healthy.unwrap().status(), StatusCode::OK);
}

/// What only the import finds out fails the job, with its place and without a worker.
#[tokio::test(flavor = "multi_thread")]
async fn bad_scenes_fail_their_job() {
    let farm = TestFarm::start().await;
    for (what, from, to, says) in [
        ("a missing file", "floor.ply", "gone.ply", "gone.ply"),
        ("a file outside", "floor.ply", "../../etc/passwd", "leaves"),
        ("an absolute path", "floor.ply", "/etc/passwd", "absolute"),
        (
            "an absurd width",
            "[16] \"integer yres",
            "[70000] \"integer yres",
            "65536",
        ),
        ("an unknown shape", "\"plymesh\"", "\"plimesh\"", "plimesh"),
        ("a cut-off string", "\"dielectric\"", "\"dielectric", ""),
    ] {
        let scene = TestScene::room(16, 16);
        scene.replace(from, to);
        let id = farm.submit(&scene, &Tuning::spp(1)).await;
        let job = farm.ends(id).await;
        assert_eq!(job.state, JobState::Failed, "{what}");
        let problem = job.problem.unwrap();
        let text = serde_json::to_string(&problem).unwrap();
        assert!(text.contains(says), "{what}: {text}");
        assert!(
            problem.findings.iter().any(|f| f.line.is_some()),
            "{what}: {text}"
        );
    }
}
