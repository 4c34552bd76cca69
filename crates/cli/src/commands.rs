//! One file a command.

pub mod check;
pub mod compare;
pub mod convert;
pub mod fetch;
pub mod info;
pub mod jobs;
pub mod render;
pub mod serve;
pub mod submit;
pub mod watch;
pub mod work;

use serde::Serialize;
use std::io::Write;

/// Prints one JSON value on stdout.
fn print_json(value: &impl Serialize) -> anyhow::Result<()> {
    print_line(&serde_json::to_string(value)?)
}

/// Prints one line on stdout. A reader that went away (`| head`) is no error.
fn print_line(line: &str) -> anyhow::Result<()> {
    match writeln!(std::io::stdout().lock(), "{line}") {
        Err(error) if error.kind() != std::io::ErrorKind::BrokenPipe => Err(error.into()),
        _ => Ok(()),
    }
}
