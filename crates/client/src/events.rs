//! The coordinator's events, over as many connections as it takes.

use crate::sse::Parser;
use crate::{Client, ClientError};
use futures::StreamExt;
use futures::stream::BoxStream;
use protocol::Event;
use reqwest::Method;
use std::collections::VecDeque;
use std::time::Duration;
use uuid::Uuid;

/// The coordinator sends a comment every 15 s: a stream that is silent for longer is dead.
const SILENCE_MAX: Duration = Duration::from_secs(45);

/// Reads events and connects again when the stream breaks, from where it was. The first event
/// after every connect is a snapshot, so nothing that matters is missed.
pub struct EventStream {
    client: Client,
    path: String,
    last_id: Option<String>,
    failures: u32,
    connection: Option<(BoxStream<'static, reqwest::Result<bytes::Bytes>>, Parser)>,
    ready: VecDeque<Event>,
}

impl Client {
    /// Events of one job, or of all.
    pub fn events(&self, job: Option<Uuid>) -> EventStream {
        EventStream {
            client: self.clone(),
            path: match job {
                Some(id) => format!("v1/jobs/{id}/events"),
                None => "v1/events".into(),
            },
            last_id: None,
            failures: 0,
            connection: None,
            ready: VecDeque::new(),
        }
    }
}

impl EventStream {
    /// The next event. Fails only when the retry policy of the client gives up or the coordinator
    /// refuses. Safe to drop and call again.
    pub async fn next(&mut self) -> Result<Event, ClientError> {
        loop {
            if let Some(event) = self.ready.pop_front() {
                return Ok(event);
            }
            let Some((stream, parser)) = &mut self.connection else {
                self.connect().await?;
                continue;
            };
            let piece = match tokio::time::timeout(SILENCE_MAX, stream.next()).await {
                Ok(Some(Ok(piece))) => piece,
                _ => {
                    self.connection = None;
                    continue;
                }
            };
            let Ok(raw) = parser.push(&piece) else {
                self.connection = None;
                continue;
            };
            for event in raw {
                self.failures = 0;
                if event.id.is_some() {
                    self.last_id = event.id;
                }
                // A newer coordinator may say things that this program does not know.
                match serde_json::from_str(&event.data) {
                    Ok(event) => self.ready.push_back(event),
                    Err(error) => tracing::debug!(%error, "unknown event"),
                }
            }
        }
    }

    async fn connect(&mut self) -> Result<(), ClientError> {
        if self.failures > 0 {
            // Connected before and lost it: a coordinator that accepts and drops must not be hammered.
            tokio::time::sleep(Duration::from_millis(50)).await;
        }
        loop {
            let mut request = self
                .client
                .request(Method::GET, &self.path)
                .header("Accept", "text/event-stream");
            if let Some(id) = &self.last_id {
                request = request.header("Last-Event-ID", id);
            }
            let answer = self.client.send_once(request).await;
            self.failures += 1;
            match answer {
                Ok(response) => {
                    self.connection = Some((response.bytes_stream().boxed(), Parser::default()));
                    return Ok(());
                }
                Err(error) => match self.client.retry().pause(self.failures, &error) {
                    Some(pause) => tokio::time::sleep(pause).await,
                    None => return Err(error),
                },
            }
        }
    }
}
