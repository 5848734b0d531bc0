//! How near estimators come to the least error that the data allow: the tables of docs/efficiency.md.
//!
//! ```text
//! simulated run ─▶ samples as the bus has them ─┬▶ ours, as shipped
//!                                               ├▶ a Kalman filter with θ in its state
//!                                               └▶ off line: prediction errors, output errors, least squares, instruments
//! the same run without noise ─▶ the Cramér–Rao bound
//! ```
//!
//! All see the same positions, inputs and setpoints, know the sensors' noise and start from the same values.

mod arm;
mod axis;
mod instruments;
mod prediction;
mod table;

pub use arm::arm_run;
pub use axis::axis_run;
pub use table::{CaseRuns, efficiency_document};

/// An estimator in the comparison.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Method {
    /// The service as shipped, on line.
    Ours,
    /// The extended Kalman filter with θ in its state, on line.
    Filter,
    /// Maximum likelihood by prediction errors, off line.
    PredictionError,
    /// Maximum likelihood by output errors: the input counts as exact; off line.
    OutputError,
    /// Least squares on differentiated positions, off line.
    LeastSquares,
    /// The same with instruments from simulations, off line.
    Instruments,
}

impl Method {
    /// Every estimator, in the order of the tables.
    pub const ALL: [Self; 6] = [
        Self::Ours,
        Self::Filter,
        Self::PredictionError,
        Self::OutputError,
        Self::LeastSquares,
        Self::Instruments,
    ];

    /// Name in tables.
    pub fn name(self) -> &'static str {
        match self {
            Self::Ours => "thetabus",
            Self::Filter => "extended Kalman filter",
            Self::PredictionError => "prediction error",
            Self::OutputError => "output error",
            Self::LeastSquares => "least squares",
            Self::Instruments => "instrumental variables",
        }
    }
}

/// θ̂ after the last sample with its standard deviations.
#[derive(Debug, Clone, PartialEq)]
pub struct Published {
    /// θ̂.
    pub theta: Vec<f64>,
    /// Its standard deviations.
    pub std: Vec<f64>,
}

/// What a run gave after its last sample.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Outcome {
    /// θ as it is.
    pub truth: Vec<f64>,
    /// Least standard deviation of each parameter, the state at the start known.
    pub bound: Vec<f64>,
    /// The same if nothing is known of the state at the start.
    pub bound_unknown_start: Vec<f64>,
    /// θ̂ of each of [`Method::ALL`]; none if it did not settle.
    pub estimates: [Option<Vec<f64>>; Method::ALL.len()],
    /// What the service says of its own standard deviations.
    pub own_std: Vec<f64>,
}

/// A result that is a number in every place.
fn finite(theta: &[f64]) -> Option<Vec<f64>> {
    theta.iter().all(|value| value.is_finite()).then(|| theta.to_vec())
}
