//! The whole coordinator with fake workers: a unit is a hash of its samples, and the finished film
//! has to be that of one machine that renders everything in order, bit for bit.

mod audits;
mod connections;
mod crashes;
mod frames;
mod http;
mod lifecycle;
mod orders;
mod roster;
mod scheduling;
mod support;
mod throughput;
