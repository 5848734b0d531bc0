//! On-line identification of a running machine's physical parameters.

#[cfg(feature = "bus")]
pub mod bus;
#[cfg(feature = "sim")]
pub mod compare;
#[cfg(feature = "config")]
pub mod config;
pub mod estimator;
pub mod messages;
pub mod model;
pub mod node;
pub mod notation;
#[cfg(feature = "service")]
pub mod recording;
#[cfg(feature = "service")]
pub mod report;
pub mod rows;
#[cfg(feature = "service")]
pub mod runner;
#[cfg(feature = "service")]
pub mod service;
#[cfg(feature = "sim")]
pub mod sim;

// The README's program compiles.
#[cfg(all(doctest, feature = "bus"))]
#[doc = include_str!("../README.md")]
struct Readme;
