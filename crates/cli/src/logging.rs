//! Log lines on stderr.

use crate::args::{Cli, Command, LogFormat};
use std::io::IsTerminal;
use tracing_subscriber::EnvFilter;

/// Starts logging: servers tell what they do, tools only what goes wrong, `RUST_LOG` decides otherwise.
pub fn start(cli: &Cli) {
    let server = matches!(cli.command, Command::Serve(_) | Command::Work(_));
    let default = if server { "info" } else { "error" };
    let filter = EnvFilter::try_from_default_env().unwrap_or_else(|_| EnvFilter::new(default));
    let builder = tracing_subscriber::fmt()
        .with_env_filter(filter)
        .with_writer(std::io::stderr)
        .with_ansi(std::io::stderr().is_terminal());
    // Fails only if a subscriber is there already, and then that one does.
    let _ = match cli.log_format {
        LogFormat::Text => builder.with_target(false).try_init(),
        LogFormat::Json => builder.json().flatten_event(true).try_init(),
    };
}
