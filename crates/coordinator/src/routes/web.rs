//! The web page: the state of the farm, and each picture while it converges. The page itself works
//! without scripts; with them it follows the events.

use crate::auth::{Caller, Need};
use crate::error::{ApiError, NO_ROUTE};
use crate::farm::Farm;
use crate::status;
use axum::Extension;
use axum::extract::{Path, State};
use axum::http::header;
use axum::response::{IntoResponse, Response};
use protocol::JobStatus;
use std::fmt::Write;
use std::sync::Arc;

/// Nothing from elsewhere, nothing inline; pictures may also be made by the script.
const POLICY: &str = "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' blob:; connect-src 'self'; form-action 'none'; frame-ancestors 'none'; base-uri 'none'";
/// Jobs on the page.
const JOBS: usize = 50;

const HEAD: &str = include_str!("../web/head.html");
const TAIL: &str = include_str!("../web/tail.html");

/// The page.
#[utoipa::path(get, path = "/", tag = "operation", security(()), responses((status = 200, content_type = "text/html")))]
pub async fn index(
    State(farm): State<Arc<Farm>>,
    Extension(caller): Extension<Caller>,
) -> Response {
    // Anybody may open the page; jobs are shown to those who may see them.
    let open = farm.config.tokens.is_empty();
    let shown = open || (caller.token.is_some() && Need::Watch.met_by(caller.scope));
    let mut page = HEAD.to_owned();
    if shown {
        let now = farm.clock.now();
        let state = farm.state();
        let jobs = state.jobs.values().rev().take(JOBS);
        let jobs: Vec<JobStatus> = jobs
            .map(|j| status::of(j, &state.workers, now, &farm.config))
            .collect();
        drop(state);
        if jobs.is_empty() {
            page.push_str("<p id=\"empty\">No jobs yet. <code>brolly submit SCENE --to URL</code> brings one.</p>\n");
        }
        for job in &jobs {
            card(&mut page, job);
        }
    } else {
        page.push_str("<p id=\"empty\">Jobs are shown with a token of scope watch.</p>\n");
    }
    page.push_str(TAIL);
    let headers = [
        (header::CONTENT_TYPE, "text/html; charset=utf-8"),
        (header::CONTENT_SECURITY_POLICY, POLICY),
        (header::REFERRER_POLICY, "no-referrer"),
    ];
    (headers, page).into_response()
}

fn card(page: &mut String, job: &JobStatus) {
    let id = job.id;
    let state = crate::metrics::state_name(job.state);
    let name = escape(&job.name);
    let error = job
        .error
        .map_or_else(String::new, |e| format!(", error {e:.4}"));
    let _ = writeln!(
        page,
        "<article class=\"job\" data-job=\"{id}\" data-version=\"{}\">",
        job.image_version
    );
    let _ = writeln!(
        page,
        "<h2>{name} <span class=\"state {state}\">{state}</span></h2>"
    );
    let _ = writeln!(
        page,
        "<p class=\"line\">{} x {}, {:.1} spp{error}</p>",
        job.width, job.height, job.spp
    );
    if let Some(why) = &job.waiting_for {
        let _ = writeln!(page, "<p class=\"why\">waits for {}</p>", escape(why));
    }
    if let Some(problem) = &job.problem {
        let text = problem.detail.as_deref().unwrap_or(&problem.title);
        let _ = writeln!(page, "<p class=\"problem\">{}</p>", escape(text));
    }
    if job.image_version > 0 {
        let _ = writeln!(
            page,
            "<img alt=\"{name}, as it stands\" src=\"/v1/jobs/{id}/image.png\">"
        );
    }
    let _ = writeln!(
        page,
        "<p class=\"links\"><a href=\"/v1/jobs/{id}/image.png\">PNG</a> <a href=\"/v1/jobs/{id}/image.exr\">EXR</a> <a href=\"/v1/jobs/{id}\">status</a> <a href=\"/v1/jobs/{id}/log\">log</a></p>\n</article>"
    );
}

/// Text that cannot become markup.
fn escape(text: &str) -> String {
    let mut out = String::with_capacity(text.len());
    for c in text.chars() {
        match c {
            '&' => out.push_str("&amp;"),
            '<' => out.push_str("&lt;"),
            '>' => out.push_str("&gt;"),
            '"' => out.push_str("&quot;"),
            '\'' => out.push_str("&#39;"),
            c => out.push(c),
        }
    }
    out
}

/// What the page needs.
pub async fn file(Path(name): Path<String>) -> Response {
    let (kind, bytes) = match name.as_str() {
        "app.js" => (
            "text/javascript; charset=utf-8",
            include_str!("../web/app.js"),
        ),
        "style.css" => ("text/css; charset=utf-8", include_str!("../web/style.css")),
        _ => return ApiError::new(NO_ROUTE, "no such file").into_response(),
    };
    (
        [
            (header::CONTENT_TYPE, kind),
            (header::CACHE_CONTROL, "no-cache"),
        ],
        bytes,
    )
        .into_response()
}

#[cfg(test)]
mod tests {
    use super::escape;

    #[test]
    fn hostile_names_stay_text() {
        assert_eq!(
            escape("<img src=x onerror='a(\"b\")'>&"),
            "&lt;img src=x onerror=&#39;a(&quot;b&quot;)&#39;&gt;&amp;"
        );
    }
}
