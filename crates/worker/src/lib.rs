//! Brolly worker.
