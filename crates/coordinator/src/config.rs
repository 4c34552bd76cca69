//! What the coordinator is told at its start. Passed on, never global.

use std::path::PathBuf;
use std::time::Duration;

/// What a token allows.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum Scope {
    /// Look at jobs and pictures.
    Watch,
    /// That, and submit and change jobs.
    Submit,
    /// Render: the worker calls, and the files of the jobs that it holds a lease for.
    Work,
    /// Everything.
    Admin,
}

impl Scope {
    /// As it is written in `--token SCOPE=SECRET`.
    pub fn name(self) -> &'static str {
        match self {
            Scope::Watch => "watch",
            Scope::Submit => "submit",
            Scope::Work => "work",
            Scope::Admin => "admin",
        }
    }
}

impl std::str::FromStr for Scope {
    type Err = ConfigError;
    fn from_str(text: &str) -> Result<Self, ConfigError> {
        [Scope::Watch, Scope::Submit, Scope::Work, Scope::Admin]
            .into_iter()
            .find(|s| s.name() == text)
            .ok_or(ConfigError::Scope)
    }
}

/// A secret and what it allows. Only its digest is kept, so that it cannot end up in a log and
/// comparing takes the same time whatever differs.
#[derive(Clone, Debug)]
pub struct Token {
    /// What it allows.
    pub scope: Scope,
    pub(crate) secret: blake3::Hash,
}

/// Shortest secret that is accepted.
const SECRET_BYTES_MIN: usize = 8;

impl Token {
    /// For a scope.
    pub fn new(scope: Scope, secret: &str) -> Result<Self, ConfigError> {
        if secret.len() < SECRET_BYTES_MIN {
            return Err(ConfigError::ShortSecret);
        }
        Ok(Token {
            scope,
            secret: blake3::hash(secret.as_bytes()),
        })
    }
}

/// `SCOPE=SECRET`.
impl std::str::FromStr for Token {
    type Err = ConfigError;
    fn from_str(text: &str) -> Result<Self, ConfigError> {
        let (scope, secret) = text.split_once('=').ok_or(ConfigError::Token)?;
        Token::new(scope.parse()?, secret)
    }
}

/// What cannot be served.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum ConfigError {
    /// Not one of the four.
    #[error("a token's scope is one of watch, submit, work, admin")]
    Scope,
    /// Not `SCOPE=SECRET`.
    #[error("a token is written SCOPE=SECRET")]
    Token,
    /// Too easy to guess.
    #[error("a token's secret has at least 8 bytes")]
    ShortSecret,
    /// Reachable from outside and open to everyone.
    #[error(
        "listening off loopback needs a token for each scope in use (--token admin=SECRET), or --insecure"
    )]
    OpenToAll,
}

/// Where jobs, results and files are kept.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum StoreConfig {
    /// In memory: gone with the process.
    Memory,
    /// In a folder.
    Embedded(PathBuf),
}

/// Bounds. Each is named by the error that quotes it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Limits {
    /// Body of a JSON request.
    pub json_bytes: usize,
    /// One file of a scene.
    pub asset_bytes: u64,
    /// Digests in one `assets/missing`.
    pub missing_digests: usize,
    /// Files of one job.
    pub files: usize,
    /// Longest name of a job or worker, in bytes.
    pub name_bytes: usize,
    /// Frames of one job.
    pub frames: u32,
    /// Jobs that are not in a final state.
    pub active_jobs: usize,
    /// Leases in one sync.
    pub leases_per_sync: u32,
    /// Leases that one worker holds.
    pub leases_per_worker: usize,
    /// Registered workers.
    pub workers: usize,
    /// Attempts of one unit before its job fails.
    pub attempts: u32,
    /// Imports under way at once: each may use a lot of memory.
    pub imports: usize,
    /// Event streams open at once.
    pub event_streams: usize,
    /// Connections open at once.
    pub connections: usize,
}

impl Default for Limits {
    fn default() -> Self {
        Limits {
            json_bytes: 32 << 20,
            asset_bytes: scene::assets::MAX_FILE_BYTES,
            missing_digests: 100_000,
            files: scene::assets::MAX_FILES,
            name_bytes: 256,
            frames: 10_000,
            active_jobs: 10_000,
            leases_per_sync: 256,
            leases_per_worker: 1024,
            workers: 10_000,
            attempts: 50,
            imports: 2,
            event_streams: 1000,
            // Two for each worker; a worker has rarely more open.
            connections: 20_000,
        }
    }
}

/// Everything.
#[derive(Clone, Debug)]
pub struct Config {
    /// Where things are kept.
    pub store: StoreConfig,
    /// Who may do what. None: on loopback everyone may do everything.
    pub tokens: Vec<Token>,
    /// Off loopback without tokens.
    pub insecure: bool,
    /// How long a lease lives without a heartbeat.
    pub lease_ttl: Duration,
    /// How long a client may take for the head of a request, and be idle before it.
    pub header_timeout: Duration,
    /// How many workers there will ever be, where that is known: a unit that all of them failed fails
    /// its job, which would wait for others elsewhere.
    pub crew: Option<usize>,
    /// How often a busy worker is asked to sync.
    pub heartbeat: Duration,
    /// Longest time between checkpoints of a job that changes.
    pub checkpoint_every: Duration,
    /// Result bytes merged before the next checkpoint.
    pub checkpoint_bytes: u64,
    /// Bounds.
    pub limits: Limits,
}

impl Default for Config {
    fn default() -> Self {
        Config {
            store: StoreConfig::Memory,
            tokens: Vec::new(),
            insecure: false,
            lease_ttl: Duration::from_secs(30),
            header_timeout: Duration::from_secs(30),
            crew: None,
            heartbeat: Duration::from_secs(5),
            checkpoint_every: Duration::from_secs(10),
            checkpoint_bytes: 512 << 20,
            limits: Limits::default(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn tokens_are_parsed_and_redacted() {
        let token: Token = "work=correct horse".parse().unwrap();
        assert_eq!(token.scope, Scope::Work);
        assert!(!format!("{token:?}").contains("horse"));
        let check = |text: &str, expect| assert_eq!(text.parse::<Token>().unwrap_err(), expect);
        check("work", ConfigError::Token);
        check("king=correct horse", ConfigError::Scope);
        check("work=short", ConfigError::ShortSecret);
    }
}
