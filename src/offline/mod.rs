//! Identification off line, from what users have: log files with columns of their own.

mod log;

pub use log::{LogCounts, LogError, LogReader};
