//! Generates tables: comparisons of estimators on the same simulated data, and trials of the
//! evidence. Not part of the product.

mod common;
mod contenders;
mod document;
mod draw;
pub mod efficiency;
pub mod ekf;
pub mod emps;
pub mod encoder;
mod encoder_runs;
mod encoder_setup;
pub mod metrics;
pub mod paper;
mod parallel;
mod references;
pub mod results;
#[cfg(feature = "robot")]
pub mod robots;
mod scenario;
pub mod simulated;
mod speed;
pub mod states;
pub mod stress;
pub mod trials;

pub use common::{Effort, STUDY_NOISE_V};
pub use contenders::{BlockResult, RunRecord, run_batch, run_blocks, run_ekf, run_wrls};
pub use document::{Document, Section, Table, two_digits};
pub use encoder_setup::{EncoderSetup, Signals};
pub use parallel::for_each_index;
pub use references::Reference;
pub use scenario::{ArmSample, Scenario, ScenarioRows};

use crate::estimator::{EstimatorError, WrlsError};
use crate::rows::ProjectedError;
use crate::sim::SimError;

/// Why a comparison failed.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum CompareError {
    /// The simulation's options.
    #[error(transparent)]
    Sim(#[from] SimError),
    /// The estimator's options.
    #[error(transparent)]
    Estimator(#[from] EstimatorError),
    /// The options of the rows.
    #[error(transparent)]
    Rows(#[from] ProjectedError),
    /// The options of the sample-by-sample baseline.
    #[error(transparent)]
    Wrls(#[from] WrlsError),
    /// There is no change to follow.
    #[error("expected a mass that changes after the first block and within the run, got none: set plant.mass_2")]
    NoJump,
}
