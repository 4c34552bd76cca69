//! The `brolly` command.
fn main() {}
