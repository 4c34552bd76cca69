//! Every model against its contract.
