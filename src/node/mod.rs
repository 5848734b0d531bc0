//! The three roles as values: messages in, messages out, no I/O, no clock. The runner waits, the node computes.

pub mod command;
mod freeze;
pub mod identifier;
pub mod monitor;
pub mod plant;
pub mod stream;
