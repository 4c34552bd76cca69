//! Who may do what. Runs before everything else, so that 401 comes before 404, 415 and 422.

use crate::config::{Config, Scope};
use crate::error::{ApiError, FORBIDDEN, FOREIGN_ORIGIN, UNAUTHORIZED};
use axum::extract::{Request, State};
use axum::http::{HeaderMap, Method, header};
use axum::middleware::Next;
use axum::response::{IntoResponse, Response};
use std::net::IpAddr;
use std::sync::Arc;

/// What the guard knows.
pub struct Guard {
    /// Tokens.
    pub config: Config,
    /// Only this machine can connect.
    pub loopback: bool,
}

/// Who calls.
#[derive(Clone, Copy, Debug)]
pub struct Caller {
    /// What the token allows.
    pub scope: Scope,
    /// Which token, where there are any.
    pub token: Option<usize>,
}

/// What a call needs.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Need {
    /// Nothing.
    Open,
    /// Any token: the address does not exist.
    Any,
    /// To look at jobs.
    Watch,
    /// To submit and change jobs.
    Submit,
    /// To render.
    Work,
    /// A file: those who submit, and workers that hold a lease.
    Asset,
    /// Everything.
    Admin,
}

impl Need {
    /// Whether a scope is enough.
    pub fn met_by(self, scope: Scope) -> bool {
        match self {
            Need::Open | Need::Any => true,
            Need::Watch => matches!(scope, Scope::Watch | Scope::Submit | Scope::Admin),
            Need::Submit => matches!(scope, Scope::Submit | Scope::Admin),
            Need::Work => matches!(scope, Scope::Work | Scope::Admin),
            Need::Asset => matches!(scope, Scope::Submit | Scope::Work | Scope::Admin),
            Need::Admin => scope == Scope::Admin,
        }
    }
}

/// What a call needs, by method and path alone: the same whether the thing exists or not.
pub fn need(method: &Method, path: &str) -> Need {
    let read = matches!(*method, Method::GET | Method::HEAD);
    match path {
        "/" | "/healthz" | "/readyz" | "/openapi.json" => return Need::Open,
        "/metrics" => return Need::Watch,
        "/v1/assets/missing" => return Need::Submit,
        _ => {}
    }
    let under = |prefix: &str| {
        path.strip_prefix(prefix)
            .is_some_and(|rest| rest.is_empty() || rest.starts_with('/'))
    };
    if under("/web") || under("/problems") {
        Need::Open
    } else if under("/v1/worker") {
        Need::Work
    } else if under("/v1/assets") {
        if read { Need::Asset } else { Need::Submit }
    } else if under("/v1/workers") {
        if read { Need::Watch } else { Need::Admin }
    } else if under("/v1/scenes") {
        Need::Submit
    } else if under("/v1/jobs") || under("/v1/events") {
        if read { Need::Watch } else { Need::Submit }
    } else {
        Need::Any
    }
}

/// Lets a call pass or not.
pub async fn guard(State(guard): State<Arc<Guard>>, mut request: Request, next: Next) -> Response {
    if let Err(error) = check_origin(request.headers(), guard.loopback) {
        return error.into_response();
    }
    let need = need(request.method(), request.uri().path());
    match identify(&guard.config, request.headers(), need) {
        Ok(caller) => {
            request.extensions_mut().insert(caller);
            next.run(request).await
        }
        Err(error) => error.into_response(),
    }
}

fn identify(config: &Config, headers: &HeaderMap, need: Need) -> Result<Caller, ApiError> {
    if config.tokens.is_empty() {
        return Ok(Caller {
            scope: Scope::Admin,
            token: None,
        });
    }
    let secret = headers
        .get(header::AUTHORIZATION)
        .and_then(|v| v.to_str().ok())
        .and_then(|v| v.strip_prefix("Bearer "));
    let caller = secret.and_then(|secret| {
        // Digests are compared, in constant time, and all of them.
        let digest = blake3::hash(secret.trim().as_bytes());
        let matching = config
            .tokens
            .iter()
            .enumerate()
            .filter(|(_, t)| t.secret == digest);
        // The same secret for two scopes is a worker's and a watcher's at once: the one that is enough.
        let mut found: Vec<Caller> = matching
            .map(|(index, t)| Caller {
                scope: t.scope,
                token: Some(index),
            })
            .collect();
        found.sort_by_key(|c| !need.met_by(c.scope));
        found.first().copied()
    });
    match caller {
        Some(caller) if need.met_by(caller.scope) => Ok(caller),
        None if need == Need::Open => Ok(Caller {
            scope: Scope::Watch,
            token: None,
        }),
        Some(caller) => Err(ApiError::new(
            FORBIDDEN,
            format!("a token of scope {} is not enough", caller.scope.name()),
        )),
        None => Err(ApiError::new(
            UNAUTHORIZED,
            "send 'Authorization: Bearer SECRET'",
        )),
    }
}

/// Keeps pages of other sites out: they may send requests to this machine from its own browser,
/// by its address or by a name of theirs that they point here.
fn check_origin(headers: &HeaderMap, loopback: bool) -> Result<(), ApiError> {
    let text = |name| headers.get(name).map(|v| v.to_str().unwrap_or("?"));
    let host = text(header::HOST);
    if loopback
        && let Some(host) = host
        && !is_local(host)
    {
        return Err(ApiError::new(
            FOREIGN_ORIGIN,
            "the Host header names another machine",
        ));
    }
    match text(header::ORIGIN) {
        None => Ok(()),
        Some(origin) => {
            let authority = origin.split_once("://").map(|(_, rest)| rest);
            if authority.is_some() && authority == host {
                Ok(())
            } else {
                Err(ApiError::new(
                    FOREIGN_ORIGIN,
                    "the Origin header names another site",
                ))
            }
        }
    }
}

fn is_local(host: &str) -> bool {
    let name = match host.strip_prefix('[') {
        Some(rest) => rest.split(']').next().unwrap_or(rest),
        None => host.rsplit_once(':').map_or(host, |(name, _)| name),
    };
    name.eq_ignore_ascii_case("localhost")
        || name.parse::<IpAddr>().is_ok_and(|ip| ip.is_loopback())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_this_machine_is_local() {
        for good in [
            "localhost",
            "localhost:7878",
            "127.0.0.1:1",
            "127.9.9.9",
            "[::1]:80",
            "[::1]",
        ] {
            assert!(is_local(good), "{good}");
        }
        for bad in [
            "",
            "evil.example",
            "localhost.evil.example:7878",
            "10.0.0.1",
            "[::2]",
            "127.0.0.1.evil:80",
        ] {
            assert!(!is_local(bad), "{bad}");
        }
    }

    #[test]
    fn other_sites_are_refused() {
        let check = |host: &str, origin: Option<&str>, ok: bool| {
            let mut headers = HeaderMap::new();
            headers.insert(header::HOST, host.parse().unwrap());
            if let Some(origin) = origin {
                headers.insert(header::ORIGIN, origin.parse().unwrap());
            }
            assert_eq!(
                check_origin(&headers, true).is_ok(),
                ok,
                "{host} {origin:?}"
            );
        };
        check("127.0.0.1:7878", None, true);
        check("127.0.0.1:7878", Some("http://127.0.0.1:7878"), true);
        check("127.0.0.1:7878", Some("http://127.0.0.1:80"), false);
        check("127.0.0.1:7878", Some("http://evil.example"), false);
        check("127.0.0.1:7878", Some("null"), false);
        check("evil.example:7878", None, false);
    }
}
