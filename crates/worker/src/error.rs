//! Why a worker ends.

use client::ClientError;
use film::EngineVersion;

/// Reasons to stop that no retry cures.
#[derive(Debug, thiserror::Error)]
pub enum WorkerError {
    /// The address is none.
    #[error("the worker cannot start")]
    Client(#[from] ClientError),
    /// Results of this program would not have the coordinator's bits.
    #[error(
        "this worker has engine version {ours}, which the coordinator refuses: install the coordinator's version of brolly here"
    )]
    EngineVersion {
        /// Of this program.
        ours: EngineVersion,
        /// What the coordinator said.
        #[source]
        source: ClientError,
    },
    /// The token is missing or has not the scope `work`.
    #[error("the coordinator does not accept this worker's token (scope `work` is needed)")]
    Unauthorised(#[source] ClientError),
    /// The system gives no threads.
    #[error("the worker's threads cannot be started")]
    Threads(#[source] std::io::Error),
}
