//! Clients that send too much, too slowly, or come in too great a number: over real connections.

use super::support::*;
use crate::config::{Config, Limits, StoreConfig};
use crate::{Coordinator, ServeError};
use serde_json::json;
use std::io::{BufRead, BufReader, Read, Write};
use std::net::{SocketAddr, TcpStream};
use std::time::Duration;
use tokio::task::JoinHandle;
use tokio_util::sync::CancellationToken;

/// Far more than what the system buffers on the way.
const BODY_BYTES: usize = 48 << 20;

struct Server {
    address: SocketAddr,
    rig: Rig,
    shutdown: CancellationToken,
    running: JoinHandle<Result<(), ServeError>>,
}

impl Server {
    async fn start(change: impl FnOnce(&mut Config)) -> Server {
        let mut config = config(StoreConfig::Memory);
        change(&mut config);
        let coordinator = Coordinator::bind("127.0.0.1:0", config).await.unwrap();
        let shutdown = CancellationToken::new();
        Server {
            address: coordinator.local_addr(),
            rig: Rig {
                farm: coordinator.farm.clone(),
                folder: None,
            },
            shutdown: shutdown.clone(),
            running: tokio::spawn(coordinator.run(shutdown)),
        }
    }

    /// Runs a client that blocks.
    async fn client<T: Send + 'static>(&self, f: impl FnOnce(Client) -> T + Send + 'static) -> T {
        let address = self.address;
        tokio::task::spawn_blocking(move || f(Client::new(address)))
            .await
            .unwrap()
    }

    async fn stop(self) {
        self.shutdown.cancel();
        self.running.await.unwrap().unwrap();
    }
}

/// A client that writes all it has to say before it listens, as most do.
struct Client(BufReader<TcpStream>);

impl Client {
    fn new(address: SocketAddr) -> Client {
        let stream = TcpStream::connect(address).unwrap();
        stream
            .set_read_timeout(Some(Duration::from_secs(120)))
            .unwrap();
        Client(BufReader::new(stream))
    }

    fn say(&mut self, bytes: &[u8]) {
        self.0.get_mut().write_all(bytes).unwrap();
    }

    fn ask(&mut self, head: &str) {
        self.say(format!("{head}\r\nhost: localhost\r\n\r\n").as_bytes());
    }

    /// The head of an answer, in lower case.
    fn head(&mut self) -> String {
        let mut head = String::new();
        while !head.ends_with("\r\n\r\n") {
            assert_ne!(self.0.read_line(&mut head).unwrap(), 0, "{head:?}");
        }
        head.to_lowercase()
    }

    /// An answer with a length.
    fn answer(&mut self) -> (u16, String, serde_json::Value) {
        let head = self.head();
        let status = head.split(' ').nth(1).unwrap().parse().unwrap();
        let length = head.split("content-length: ").nth(1).unwrap();
        let mut body = vec![0; length.lines().next().unwrap().parse().unwrap()];
        self.0.read_exact(&mut body).unwrap();
        (
            status,
            head,
            serde_json::from_slice(&body).unwrap_or_default(),
        )
    }

    /// What comes until the other side closes.
    fn rest(&mut self) -> Vec<u8> {
        let mut rest = Vec::new();
        self.0.read_to_end(&mut rest).unwrap();
        rest
    }
}

fn small(config: &mut Config) {
    config.limits = Limits {
        json_bytes: 1 << 20,
        asset_bytes: 1 << 20,
        ..config.limits
    };
}

#[tokio::test(flavor = "multi_thread")]
async fn a_client_that_still_sends_reads_why_it_is_refused() {
    let server = Server::start(small).await;
    let asset = format!("PUT /v1/assets/{} HTTP/1.1", "0".repeat(64));
    let job = "POST /v1/jobs HTTP/1.1\r\ncontent-type: application/json".to_owned();
    for (head, limit) in [(asset, "asset_bytes"), (job, "json_bytes")] {
        for chunked in [false, true] {
            let head = head.clone();
            let (status, head, problem) = server
                .client(move |mut client| {
                    let how = match chunked {
                        true => "transfer-encoding: chunked".into(),
                        false => format!("content-length: {BODY_BYTES}"),
                    };
                    client.ask(&format!("{head}\r\n{how}"));
                    let piece = vec![b' '; 1 << 20];
                    for _ in 0..BODY_BYTES >> 20 {
                        if chunked {
                            client.say(b"100000\r\n");
                        }
                        client.say(&piece);
                        if chunked {
                            client.say(b"\r\n");
                        }
                    }
                    if chunked {
                        client.say(b"0\r\n\r\n");
                    }
                    client.answer()
                })
                .await;
            assert_eq!(
                (status, &problem["type"]),
                (413, &json!("/problems/too-large"))
            );
            assert_eq!(problem["limit"]["name"], limit);
            assert!(head.contains("connection: close"), "{head}");
        }
    }
    server.stop().await;
}

#[tokio::test(flavor = "multi_thread")]
async fn a_client_that_asks_first_sends_nothing() {
    let server = Server::start(small).await;
    let (status, _, problem) = server
        .client(|mut client| {
            client.ask(&format!(
                "PUT /v1/assets/{} HTTP/1.1\r\nexpect: 100-continue\r\ncontent-length: {BODY_BYTES}",
                "0".repeat(64)
            ));
            client.answer()
        })
        .await;
    assert_eq!(
        (status, &problem["limit"]["actual"]),
        (413, &json!(BODY_BYTES))
    );
    // What fits is asked for.
    let (first, (status, ..)) = server
        .client(|mut client| {
            client.ask(&format!(
                "PUT /v1/assets/{} HTTP/1.1\r\nexpect: 100-continue\r\ncontent-length: 3",
                blake3::hash(b"abc").to_hex()
            ));
            let first = client.head();
            client.say(b"abc");
            (first, client.answer())
        })
        .await;
    assert!(first.starts_with("http/1.1 100"), "{first}");
    assert_eq!(status, 201);
    server.stop().await;
}

#[tokio::test(flavor = "multi_thread")]
async fn half_a_head_is_cut_off_and_a_long_poll_is_not() {
    let timeout = Duration::from_millis(300);
    let server = Server::start(|config| config.header_timeout = timeout).await;
    let worker = server.rig.worker("a");
    let polling = server.client(move |mut client| {
        let body = json!({"worker": worker, "held": [], "given_back": [], "failed": [], "want": 1,
            "wait_ms": 4 * timeout.as_millis() as u64, "draining": false});
        let body = body.to_string();
        let length = body.len();
        client.ask(&format!("POST /v1/worker/sync HTTP/1.1\r\ncontent-type: application/json\r\ncontent-length: {length}"));
        client.say(body.as_bytes());
        client.answer()
    });
    let streaming = server.client(move |mut client| {
        client.ask("GET /v1/events HTTP/1.1");
        let head = client.head();
        let mut line = String::new();
        // Nothing happens until the others are through.
        while !line.starts_with("event: job") {
            line.clear();
            assert_ne!(client.0.read_line(&mut line).unwrap(), 0, "{head}");
        }
        head
    });
    let halting = async {
        let rest = server
            .client(|mut client| {
                client.say(b"GET /healthz HTTP/1.1\r\nhost: loc");
                client.rest()
            })
            .await;
        assert_eq!(rest, b"", "cut off without a word");
    };
    let both = async {
        let (answer, ()) = tokio::join!(polling, halting);
        server.rig.submit(spp(1)).await;
        answer
    };
    let (events, (status, _, answer)) = tokio::join!(streaming, both);
    assert_eq!((status, &answer["leases"]), (200, &json!([])));
    assert!(events.contains("text/event-stream"), "{events}");
    server.stop().await;
}

#[tokio::test(flavor = "multi_thread")]
async fn connections_are_counted() {
    let server = Server::start(|config| config.limits.connections = 2).await;
    let hold = |mut client: Client| {
        client.ask("GET /healthz HTTP/1.1");
        assert_eq!(client.answer().0, 200);
        client
    };
    let held = [server.client(hold).await, server.client(hold).await];
    let refused = || {
        server.client(|mut client| {
            client.ask("GET /healthz HTTP/1.1");
            client.answer()
        })
    };
    let (status, _, problem) = refused().await;
    assert_eq!(
        (status, &problem["type"]),
        (429, &json!("/problems/too-many"))
    );
    assert_eq!(problem["limit"], json!({"name": "connections", "value": 2}));
    drop(held);
    // The server hears of it a little later.
    while refused().await.0 != 200 {
        tokio::time::sleep(Duration::from_millis(5)).await;
    }
    server.stop().await;
}
