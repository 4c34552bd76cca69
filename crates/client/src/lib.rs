//! Brolly client.
