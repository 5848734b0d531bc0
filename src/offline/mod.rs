//! Off-line identification from users' log files.

mod echo;
mod lines;
mod log;
mod log_counts;
mod log_error;
mod profile;
mod sign;
mod suspicion;
mod time;

pub use echo::InputEcho;
pub use lines::LineError;
pub use log::LogReader;
pub use log_counts::LogCounts;
pub use log_error::LogError;
pub use profile::{ColumnProfile, LogProfile, Signal, Steps, short};
pub use sign::InputSign;
pub use suspicion::{
    Configured, Suspicion, judge_bounds, judge_field, judge_header, judge_inputs, judge_period, judge_profile,
};
