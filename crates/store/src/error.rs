//! What can go wrong in a store.

/// Why a store did not do what it was asked.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum StoreError {
    /// There is no such thing.
    #[error("{what} is not in the store")]
    NotFound {
        /// What was asked for.
        what: String,
    },
    /// A lease has gone to somebody else.
    #[error("the lease of {what} is lost")]
    LeaseLost {
        /// Which unit.
        what: String,
    },
    /// Somebody else was faster: what this caller knows is out of date.
    #[error("{what} was changed by somebody else")]
    Conflict {
        /// Which record.
        what: String,
    },
    /// No room. Reading goes on; writing works again once there is room.
    #[error("no room for {what}")]
    Full {
        /// What was to be written.
        what: String,
    },
    /// It may work later.
    #[error("the store is unavailable: {reason}")]
    Unavailable {
        /// What the system said.
        reason: String,
    },
    /// What was written is not what is there. Somebody has to look.
    #[error("damaged: {what}")]
    Damaged {
        /// Where and how.
        what: String,
    },
    /// A sync to disk failed. What the system then holds is unknown, and syncing again would report
    /// success for bytes that are lost: the process has to end, and its next start reads what is left.
    #[error(
        "{what} could not be synced to disk ({reason}); what is left is found out by a restart"
    )]
    SyncFailed {
        /// What was written.
        what: String,
        /// What the system said.
        reason: String,
    },
    /// Another process uses it.
    #[error("{what} is in use by {who}")]
    Locked {
        /// Which data directory.
        what: String,
        /// What the holder wrote into the lock file.
        who: String,
    },
}

impl StoreError {
    /// Whether the same call may succeed later without anybody changing it.
    pub fn retryable(&self) -> bool {
        matches!(
            self,
            StoreError::Full { .. } | StoreError::Unavailable { .. }
        )
    }

    /// From an error of the file system.
    pub(crate) fn io(what: &str, error: &std::io::Error) -> Self {
        use std::io::ErrorKind;
        match error.kind() {
            ErrorKind::StorageFull | ErrorKind::QuotaExceeded | ErrorKind::FileTooLarge => {
                StoreError::Full { what: what.into() }
            }
            ErrorKind::NotFound => StoreError::NotFound { what: what.into() },
            _ => StoreError::Unavailable {
                reason: format!("{what}: {error}"),
            },
        }
    }
}
