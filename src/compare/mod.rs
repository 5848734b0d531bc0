//! Estimators side by side on the same simulated data.

pub mod metrics;
mod scenario;

pub use scenario::{Scenario, ScenarioRows};
