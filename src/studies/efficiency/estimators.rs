//! The estimators of the comparison, and their application to one run.

use super::prediction::{Record, Start, augmented_filter, maximum_likelihood};
use crate::studies::states::StateSpace;
use nalgebra::SVector;

/// An estimator in the comparison.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Method {
    /// The service as shipped, on line.
    Ours,
    /// The extended Kalman filter with θ in its state, on line.
    Filter,
    /// The same from a start that is 10 % off, with the matching standard deviation.
    NearFilter,
    /// Maximum likelihood by prediction errors, off line.
    PredictionError,
    /// Maximum likelihood by output errors: the input is taken as exact; off line.
    OutputError,
    /// Least squares on differentiated positions, off line.
    LeastSquares,
    /// The same with instruments from simulations, off line.
    Instruments,
}

impl Method {
    /// Every estimator, in the order of the tables.
    pub const ALL: [Self; 7] = [
        Self::Ours,
        Self::Filter,
        Self::NearFilter,
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
            Self::NearFilter => "the same, from 10 % off",
            Self::PredictionError => "prediction error",
            Self::OutputError => "output error",
            Self::LeastSquares => "least squares",
            Self::Instruments => "instrumental variables",
        }
    }
}

/// θ̂ after the last sample with its standard deviations.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Published {
    /// θ̂.
    pub theta: Vec<f64>,
    /// Its standard deviations.
    pub std: Vec<f64>,
}

/// Result of a run after its last sample.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Outcome {
    /// True θ.
    pub truth: Vec<f64>,
    /// Smallest standard deviation of each parameter with an unknown initial state.
    pub bound: Vec<f64>,
    /// θ̂ of each of [`Method::ALL`]; `None` if it did not settle.
    pub estimates: [Option<Vec<f64>>; Method::ALL.len()],
    /// Standard deviations published by the service.
    pub own_std: Vec<f64>,
}

impl Outcome {
    /// (θ̂ − θ)/bound of a parameter; `None` if the method did not settle.
    pub fn ratio(&self, method: Method, i: usize) -> Option<f64> {
        let theta = self.estimates[method as usize].as_ref()?;
        Some((theta[i] - self.truth[i]) / self.bound[i])
    }
}

/// Inputs of the other estimators.
pub struct Contest<'a, const X: usize, const P: usize, const U: usize, S> {
    /// The machine as states.
    pub machine: &'a S,
    /// The run.
    pub record: &'a Record<U>,
    /// The values of the configuration.
    pub start: Start<X, P>,
    /// True θ.
    pub truth: SVector<f64, P>,
    /// θ̂ by least squares.
    pub least_squares: Option<SVector<f64, P>>,
    /// θ̂ by instrumental variables.
    pub instruments: Option<SVector<f64, P>>,
}

/// Standard deviation of a logarithm at the start of the filter: a factor of 2.7.
const FAR: f64 = 1.0;
/// Relative distance of the near start.
const NEAR: f64 = 0.1;

impl<const X: usize, const P: usize, const U: usize, S: StateSpace<X, P, U>> Contest<'_, X, P, U, S> {
    /// Runs the filters and the searches; `ours` is what the service published.
    pub fn outcome(&self, bound: Vec<f64>, ours: Option<Published>) -> Outcome {
        let Self {
            machine,
            record,
            start,
            truth,
            ..
        } = self;
        let near = Start {
            theta: SVector::from_fn(|i, _| truth[i] * if i % 2 == 0 { 1.0 + NEAR } else { 1.0 - NEAR }),
            ..*start
        };
        // the likelihood has several peaks: a search starts at the coarse estimate, if there is one
        let coarse = Start {
            theta: self
                .instruments
                .filter(|theta| start.can_be(theta))
                .unwrap_or(start.theta),
            ..*start
        };
        let found = [
            Some(augmented_filter(*machine, record, start, FAR)),
            Some(augmented_filter(*machine, record, &near, NEAR)),
            maximum_likelihood(*machine, record, &coarse),
            maximum_likelihood(*machine, &record.with_exact_input(), &coarse),
            self.least_squares,
            self.instruments,
        ];
        let Published { theta, std } = ours.unwrap_or_default();
        let mut estimates: [Option<Vec<f64>>; Method::ALL.len()] = Default::default();
        let all =
            std::iter::once(theta).chain(found.map(|theta| theta.map_or_else(Vec::new, |t| t.as_slice().to_vec())));
        for (place, theta) in estimates.iter_mut().zip(all) {
            let settled = theta.len() >= P && theta.iter().all(|value| value.is_finite());
            *place = settled.then_some(theta);
        }
        Outcome {
            truth: truth.as_slice().to_vec(),
            bound,
            estimates,
            own_std: std,
        }
    }
}
