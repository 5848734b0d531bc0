//! On-line identification of a running machine's physical parameters.

pub mod estimator;
pub mod messages;
pub mod model;
