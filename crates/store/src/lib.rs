//! Brolly store.
