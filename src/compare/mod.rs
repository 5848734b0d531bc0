//! Estimators side by side on the same simulated data.

pub mod metrics;
mod presets;
mod scenario;

pub use presets::{CEDRO2022_BLOCK_LEN, CEDRO2022_START, cedro2022_estimator};
pub use scenario::{Scenario, ScenarioRows};
