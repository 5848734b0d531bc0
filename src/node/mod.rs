//! The three roles as values: messages in, messages out, no I/O, no clock. The runner waits, the node computes.

mod bound;
pub mod command;
mod freeze;
pub mod identifier;
mod misfit;
pub mod monitor;
pub mod plant;
#[cfg(feature = "sim")]
pub mod simulated_plant;
pub mod stream;
