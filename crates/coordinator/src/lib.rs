//! Brolly coordinator.
