//! The binary `brolly`. All of it is in the library beside, so that tests can start it as well.
#![forbid(unsafe_code)]

use std::process::ExitCode;

fn main() -> ExitCode {
    cli::main()
}
