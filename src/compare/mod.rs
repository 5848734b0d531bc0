//! Estimators side by side on the same simulated data.

mod document;
pub mod metrics;
pub mod paper;
mod parallel;
mod presets;
mod scenario;

pub use document::{Document, Section, Table};
pub use parallel::for_each_index;
pub use presets::{CEDRO2022_BLOCK_LEN, CEDRO2022_START, cedro2022_estimator};
pub use scenario::{Scenario, ScenarioRows};

use crate::estimator::EstimatorError;
use crate::sim::SimError;

/// Why there is no comparison.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum CompareError {
    /// The simulation's options.
    #[error(transparent)]
    Sim(#[from] SimError),
    /// The estimator's options.
    #[error(transparent)]
    Estimator(#[from] EstimatorError),
    /// Nothing to follow.
    #[error("expected a mass that changes after the first block and within the run, got none: set plant.mass_2")]
    NoJump,
}
