//! Server-sent events: first how everything stands, then what changes.

use super::body::{job_id, query};
use crate::error::{ApiError, TOO_MANY};
use crate::events::Numbered;
use crate::farm::{Farm, no_job};
use crate::status;
use axum::extract::{Path, State};
use axum::http::Uri;
use axum::response::sse::{Event as Message, KeepAlive, Sse};
use futures::Stream;
use futures::stream::{StreamExt, unfold};
use protocol::{Event, Problem};
use serde::Deserialize;
use std::collections::VecDeque;
use std::convert::Infallible;
use std::sync::Arc;
use std::time::Duration;
use tokio::sync::broadcast::{Receiver, error::RecvError};
use uuid::Uuid;

/// Time between comments that keep proxies and clients from giving up.
const KEEP_ALIVE: Duration = Duration::from_secs(15);
/// Finished jobs in a snapshot of all jobs: a page of history, not all of it.
const FINISHED_MAX: usize = 100;

#[derive(Deserialize, utoipa::IntoParams)]
#[into_params(parameter_in = Query)]
#[serde(deny_unknown_fields)]
pub struct EventQuery {
    /// Only of this job.
    job: Option<Uuid>,
}

/// Events of all jobs, or of one. After every connect, with Last-Event-ID or without, a snapshot
/// comes first: nothing that matters is missed.
#[utoipa::path(get, path = "/v1/events", tag = "events", params(EventQuery, ("Last-Event-ID" = Option<String>, Header)),
    responses((status = 200, body = Event, content_type = "text/event-stream"), (status = "4XX", body = Problem, content_type = "application/problem+json")))]
pub async fn all_events(
    State(farm): State<Arc<Farm>>,
    uri: Uri,
) -> Result<Sse<impl Stream<Item = Result<Message, Infallible>>>, ApiError> {
    let query: EventQuery = query(&uri)?;
    events(farm, query.job)
}

/// Events of one job.
#[utoipa::path(get, path = "/v1/jobs/{id}/events", tag = "events", params(("id" = Uuid, Path), ("Last-Event-ID" = Option<String>, Header)),
    responses((status = 200, body = Event, content_type = "text/event-stream"), (status = "4XX", body = Problem, content_type = "application/problem+json")))]
pub async fn job_events(
    State(farm): State<Arc<Farm>>,
    Path(id): Path<String>,
) -> Result<Sse<impl Stream<Item = Result<Message, Infallible>>>, ApiError> {
    let id = job_id(&id)?;
    events(farm, Some(id))
}

struct Reader {
    farm: Arc<Farm>,
    job: Option<Uuid>,
    receiver: Receiver<Numbered>,
    waiting: VecDeque<Message>,
}

fn events(
    farm: Arc<Farm>,
    job: Option<Uuid>,
) -> Result<Sse<impl Stream<Item = Result<Message, Infallible>>>, ApiError> {
    if let Some(id) = job
        && !farm.state().jobs.contains_key(&id)
    {
        return Err(no_job(id));
    }
    let max = farm.config.limits.event_streams;
    if farm.events.readers() >= max {
        return Err(ApiError::limit(TOO_MANY, "event_streams", max as u64, None));
    }
    let shutdown = farm.shutdown.clone();
    // Before the snapshot, so that nothing falls between.
    let receiver = farm.events.subscribe();
    let waiting = snapshot(&farm, job);
    let reader = Reader {
        farm,
        job,
        receiver,
        waiting,
    };
    let stream = unfold(reader, |mut reader| async move {
        let message = reader.next().await?;
        Some((Ok(message), reader))
    });
    let stream = stream.take_until(shutdown.cancelled_owned());
    Ok(Sse::new(stream).keep_alive(KeepAlive::new().interval(KEEP_ALIVE)))
}

impl Reader {
    async fn next(&mut self) -> Option<Message> {
        loop {
            if let Some(message) = self.waiting.pop_front() {
                return Some(message);
            }
            match self.receiver.recv().await {
                Ok(numbered) => {
                    if self.job.is_none_or(|id| id == numbered.job()) {
                        return Some(message(numbered.id, &numbered.event));
                    }
                }
                // Too far behind: how everything stands says it all.
                Err(RecvError::Lagged(_)) => self.waiting = snapshot(&self.farm, self.job),
                Err(RecvError::Closed) => return None,
            }
        }
    }
}

/// How everything stands, oldest first.
fn snapshot(farm: &Farm, job: Option<Uuid>) -> VecDeque<Message> {
    let now = farm.clock.now();
    let number = farm.events.last();
    let state = farm.state();
    let mut finished = 0;
    let jobs = state
        .jobs
        .iter()
        .rev()
        .filter(|(id, _)| job.is_none_or(|j| j == **id));
    let jobs = jobs.filter(|(_, job)| {
        finished += usize::from(job.record.state.is_final());
        !job.record.state.is_final() || finished <= FINISHED_MAX
    });
    let mut messages: VecDeque<Message> = jobs
        .map(|(_, job)| {
            let job = Box::new(status::of(job, &state.workers, now, &farm.config));
            message(number, &Event::Job { job })
        })
        .collect();
    messages.make_contiguous().reverse();
    messages
}

fn message(id: u64, event: &Event) -> Message {
    let name = match event {
        Event::Job { .. } => "job",
        Event::Image { .. } => "image",
        Event::Deleted { .. } => "deleted",
    };
    let data = serde_json::to_string(event).unwrap_or_default();
    Message::default().id(id.to_string()).event(name).data(data)
}
