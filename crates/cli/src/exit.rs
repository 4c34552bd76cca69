//! How a command ends: exit codes, and errors printed once.

use client::ClientError;
use protocol::{Finding, Problem};
use scene::SceneError;
use std::process::ExitCode;

/// The input or the job failed.
const FAILED: u8 = 1;
/// The command line makes no sense.
const USAGE: u8 = 2;
/// The service could not be reached.
const UNREACHABLE: u8 = 3;
/// Ctrl-C.
pub const INTERRUPTED: u8 = 130;

/// A command line that clap cannot refuse by itself.
#[derive(Debug, thiserror::Error)]
#[error("{0}")]
pub struct Usage(pub String);

/// Ctrl-C.
#[derive(Debug, thiserror::Error)]
#[error("interrupted")]
pub struct Interrupted;

/// A job that ended without its picture.
#[derive(Debug, thiserror::Error)]
pub enum JobFailed {
    /// Failed, and why.
    #[error("the job failed: {}{}", .0.title, .0.detail.as_ref().map(|d| format!(": {d}")).unwrap_or_default())]
    Failed(Box<Problem>),
    /// Ended by a person.
    #[error("the job was cancelled")]
    Cancelled,
    /// Gone.
    #[error("the job was deleted")]
    Deleted,
}

/// Prints an error with its causes once, findings one a line, and gives the exit code.
pub fn report(error: &anyhow::Error) -> ExitCode {
    for cause in error.chain() {
        for line in findings(cause) {
            eprintln!("{line}");
        }
    }
    let mut text = String::new();
    for cause in error.chain().map(ToString::to_string) {
        // An error that shows its source as itself must not be read twice.
        if text.is_empty() {
            text = cause;
        } else if !text.ends_with(&cause) {
            text.push_str(": ");
            text.push_str(&cause);
        }
    }
    eprintln!("error: {text}");
    ExitCode::from(code(error))
}

fn findings(cause: &(dyn std::error::Error + 'static)) -> Vec<String> {
    let shown = |findings: &[Finding]| findings.iter().map(ToString::to_string).collect();
    if let Some(error) = cause.downcast_ref::<SceneError>() {
        return error.diagnostics.iter().map(ToString::to_string).collect();
    }
    if let Some(ClientError::Problem { problem, .. }) = cause.downcast_ref() {
        return shown(&problem.findings);
    }
    if let Some(JobFailed::Failed(problem)) = cause.downcast_ref() {
        return shown(&problem.findings);
    }
    Vec::new()
}

fn code(error: &anyhow::Error) -> u8 {
    for cause in error.chain() {
        if cause.is::<Usage>() {
            return USAGE;
        }
        if cause.is::<Interrupted>() {
            return INTERRUPTED;
        }
        match cause.downcast_ref::<ClientError>() {
            Some(ClientError::Address { .. }) => return USAGE,
            Some(error) if error.retryable() => return UNREACHABLE,
            _ => {}
        }
    }
    FAILED
}
