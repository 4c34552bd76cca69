//! The description of the API, generated from the code. `api/openapi.json` is the committed copy;
//! a test keeps it fresh, `BROLLY_BLESS=1` rewrites it.

use crate::routes;
use utoipa::openapi::security::{Http, HttpAuthScheme, SecurityScheme};
use utoipa::{Modify, OpenApi};

#[derive(OpenApi)]
#[openapi(
    info(
        title = "Brolly",
        description = "A self-hosted render farm for physically based pictures. Errors are application/problem+json; their types are listed in docs/api-design.md."
    ),
    paths(
        routes::missing, routes::put_asset, routes::get_asset, routes::head_asset,
        routes::check,
        routes::submit, routes::list, routes::get_job, routes::patch_job, routes::delete_job,
        routes::pause, routes::resume, routes::cancel, routes::retry,
        routes::tiles, routes::history, routes::log,
        routes::png, routes::exr,
        routes::all_events, routes::job_events,
        routes::list_workers, routes::patch_worker,
        routes::register, routes::sync, routes::result,
        routes::healthz, routes::readyz, routes::metrics, routes::openapi, routes::index,
    ),
    security(("token" = [])),
    modifiers(&Token)
)]
struct Api;

struct Token;

impl Modify for Token {
    fn modify(&self, api: &mut utoipa::openapi::OpenApi) {
        let scheme = SecurityScheme::Http(Http::new(HttpAuthScheme::Bearer));
        let components = api.components.get_or_insert_with(Default::default);
        components.add_security_scheme("token", scheme);
    }
}

/// OpenAPI 3.1 as JSON.
pub fn document() -> String {
    // Made of constants: what fails, fails in the test.
    let mut text = Api::openapi().to_pretty_json().unwrap_or_default();
    text.push('\n');
    text
}

#[cfg(test)]
mod tests {
    #[test]
    fn the_committed_description_is_fresh() {
        let path = concat!(env!("CARGO_MANIFEST_DIR"), "/../../api/openapi.json");
        let fresh = super::document();
        if std::env::var_os("BROLLY_BLESS").is_some() {
            std::fs::write(path, &fresh).unwrap();
        }
        let committed = std::fs::read_to_string(path).unwrap_or_default();
        assert!(
            committed == fresh,
            "api/openapi.json is stale: run this test with BROLLY_BLESS=1"
        );
    }
}
