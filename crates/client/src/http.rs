//! Requests, answers, and the retry loop that every call goes through.

use crate::{ClientError, RetryPolicy};
use protocol::Problem;
use reqwest::{Method, RequestBuilder, Response, Url};
use serde::Serialize;
use serde::de::DeserializeOwned;
use std::time::Duration;

/// Longest body of an error that is quoted.
const QUOTED_BYTES: usize = 300;

/// A coordinator, as a client sees it. Cheap to clone; clones share the connections.
#[derive(Clone, Debug)]
pub struct Client {
    http: reqwest::Client,
    base: Url,
    token: Option<Token>,
    retry: RetryPolicy,
    timeout: Duration,
}

/// A secret that does not show in logs.
#[derive(Clone)]
struct Token(String);

impl std::fmt::Debug for Token {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str("***")
    }
}

impl Client {
    /// A client of the coordinator at `url` (`http://host:port`, the scheme may be left out).
    pub fn new(url: &str, token: Option<&str>) -> Result<Self, ClientError> {
        let bad = |reason: String| ClientError::Address {
            url: url.to_owned(),
            reason,
        };
        let full = if url.contains("://") {
            url.to_owned()
        } else {
            format!("http://{url}")
        };
        let mut base = Url::parse(&full).map_err(|e| bad(e.to_string()))?;
        if base.scheme() != "http" {
            return Err(bad(format!(
                "'{}' is not spoken here, only http (put a tunnel or proxy in between)",
                base.scheme()
            )));
        }
        let Some(host) = base.host_str().map(str::to_owned) else {
            return Err(bad("it names no host".into()));
        };
        if !base.path().ends_with('/') {
            let path = format!("{}/", base.path());
            base.set_path(&path);
        }
        let mut builder = reqwest::Client::builder()
            .user_agent(concat!("brolly/", env!("CARGO_PKG_VERSION")))
            .connect_timeout(Duration::from_secs(5))
            .tcp_nodelay(true)
            .pool_idle_timeout(Duration::from_secs(60))
            .redirect(reqwest::redirect::Policy::none());
        if is_loopback(&host) {
            // A proxy from the environment cannot reach this machine's loopback.
            builder = builder.no_proxy();
        }
        let http = builder.build().map_err(|e| bad(e.to_string()))?;
        Ok(Client {
            http,
            base,
            token: token.map(|t| Token(t.to_owned())),
            retry: RetryPolicy::PATIENT,
            timeout: Duration::from_secs(60),
        })
    }

    /// The same client with another retry policy.
    pub fn with_retry(mut self, retry: RetryPolicy) -> Self {
        self.retry = retry;
        self
    }

    /// The same client with another bound on the time of one call (uploads and streams have none).
    pub fn with_timeout(mut self, timeout: Duration) -> Self {
        self.timeout = timeout;
        self
    }

    /// Address of the coordinator.
    pub fn base(&self) -> &str {
        self.base.as_str().trim_end_matches('/')
    }

    /// The retry policy in force.
    pub fn retry(&self) -> RetryPolicy {
        self.retry
    }

    /// A request to a path below the coordinator, with the token, without a time limit.
    pub(crate) fn request(&self, method: Method, path: &str) -> RequestBuilder {
        // Paths are made from constants, ids and hex digits, so this cannot leave the base.
        let url = format!("{}{}", self.base, path.trim_start_matches('/'));
        let request = self.http.request(method, url);
        match &self.token {
            Some(Token(token)) => request.bearer_auth(token),
            None => request,
        }
    }

    /// Sends until it succeeds or the policy gives up; `make` builds the request anew each time.
    pub(crate) async fn send<F>(&self, make: F) -> Result<Response, ClientError>
    where
        F: Fn() -> RequestBuilder,
    {
        let mut failures = 0;
        loop {
            let error = match self.send_once(make().timeout(self.timeout)).await {
                Ok(response) => return Ok(response),
                Err(error) => error,
            };
            failures += 1;
            match self.retry.pause(failures, &error) {
                Some(pause) => {
                    tracing::debug!(%error, failures, pause_ms = pause.as_millis() as u64, "call failed, trying again");
                    tokio::time::sleep(pause).await;
                }
                None => return Err(error),
            }
        }
    }

    /// Sends once; a status outside 200..=299 is an error (304 is not).
    pub(crate) async fn send_once(&self, request: RequestBuilder) -> Result<Response, ClientError> {
        let response = request.send().await.map_err(|e| self.unreachable(e))?;
        let status = response.status();
        if status.is_success() || status == reqwest::StatusCode::NOT_MODIFIED {
            Ok(response)
        } else {
            Err(refusal(response).await)
        }
    }

    pub(crate) fn unreachable(&self, source: reqwest::Error) -> ClientError {
        ClientError::Unreachable {
            url: self.base().to_owned(),
            source: source.without_url(),
        }
    }

    /// Reads the body of a successful answer.
    pub(crate) async fn json<T: DeserializeOwned>(
        &self,
        response: Response,
    ) -> Result<T, ClientError> {
        let url = response.url().to_string();
        let bytes = response.bytes().await.map_err(|e| self.unreachable(e))?;
        serde_json::from_slice(&bytes).map_err(|source| ClientError::Decode { url, source })
    }

    pub(crate) async fn get<T: DeserializeOwned>(&self, path: &str) -> Result<T, ClientError> {
        let response = self.send(|| self.request(Method::GET, path)).await?;
        self.json(response).await
    }

    pub(crate) async fn post<B: Serialize + ?Sized, T: DeserializeOwned>(
        &self,
        path: &str,
        body: &B,
    ) -> Result<T, ClientError> {
        let response = self
            .send(|| self.request(Method::POST, path).json(body))
            .await?;
        self.json(response).await
    }

    pub(crate) async fn patch<B: Serialize + ?Sized, T: DeserializeOwned>(
        &self,
        path: &str,
        body: &B,
    ) -> Result<T, ClientError> {
        let response = self
            .send(|| self.request(Method::PATCH, path).json(body))
            .await?;
        self.json(response).await
    }

    /// Whether the coordinator says that it is up.
    pub async fn healthy(&self) -> Result<(), ClientError> {
        self.send(|| self.request(Method::GET, "healthz"))
            .await
            .map(drop)
    }

    /// Whether the coordinator takes work.
    pub async fn ready(&self) -> Result<(), ClientError> {
        self.send(|| self.request(Method::GET, "readyz"))
            .await
            .map(drop)
    }
}

fn is_loopback(host: &str) -> bool {
    host == "localhost"
        || host
            .trim_matches(['[', ']'])
            .parse::<std::net::IpAddr>()
            .is_ok_and(|ip| ip.is_loopback())
}

/// Turns an answer that is no success into an error.
async fn refusal(response: Response) -> ClientError {
    let url = response.url().to_string();
    let status = response.status().as_u16();
    let retry_after = response
        .headers()
        .get(reqwest::header::RETRY_AFTER)
        .and_then(|value| value.to_str().ok()?.trim().parse().ok())
        .map(Duration::from_secs);
    let bytes = response.bytes().await.unwrap_or_default();
    match serde_json::from_slice::<Problem>(&bytes) {
        Ok(mut problem) => {
            problem.status = status; // the status line decides what is retried, not the body
            ClientError::Problem {
                problem: Box::new(problem),
                retry_after,
            }
        }
        Err(_) => ClientError::Status {
            url,
            status,
            body: String::from_utf8_lossy(&bytes[..bytes.len().min(QUOTED_BYTES)])
                .trim()
                .to_owned(),
            retry_after,
        },
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn addresses_are_checked() {
        for good in [
            "http://127.0.0.1:7878",
            "127.0.0.1:7878",
            "farm:80",
            "http://farm/brolly",
        ] {
            assert!(Client::new(good, None).is_ok(), "{good}");
        }
        for bad in ["https://farm", "ftp://farm", "http://", ""] {
            assert!(Client::new(bad, None).is_err(), "{bad}");
        }
        let client = Client::new("http://farm/brolly", Some("secret")).unwrap();
        let request = client.request(Method::GET, "v1/jobs").build().unwrap();
        assert_eq!(request.url().as_str(), "http://farm/brolly/v1/jobs");
        assert!(!format!("{client:?}").contains("secret"));
    }
}
