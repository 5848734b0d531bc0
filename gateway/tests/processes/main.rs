//! Gateways as users start them: real processes, two domains on this host, zenoh on the loopback
//! interface.
//!
//! The machine is one of the test's own, so that every message that must arrive is known.

mod access;
mod carry;
mod control;
mod kills;
mod programs;
mod silence;
mod strangers;
mod support;
mod ways;
