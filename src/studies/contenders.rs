//! Estimators of a comparison, all with the same output: θ̂ and its standard deviation at the end
//! of each block.

use super::ekf::{Ekf, EkfTuning};
use super::{CompareError, Scenario};
use crate::estimator::{
    BlockEstimator, Change, EstimatorOptions, IndexSet, Residuals, StateMachine, Wrls, batch_least_squares,
};
use crate::model::{MANIPULATOR_PARAMS, Manipulator};
use crate::rows::structure;
use std::time::{Duration, Instant};

/// Result of an estimator at the end of a block.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct BlockResult {
    /// θ̂.
    pub theta: [f64; MANIPULATOR_PARAMS],
    /// Standard deviation of θ̂; `NaN` if there is none.
    pub std: [f64; MANIPULATOR_PARAMS],
    /// Parameters that the estimator marks usable.
    pub usable: IndexSet,
    /// Controllers may use θ̂.
    pub use_ok: bool,
    /// A reported change; its time is stream time in ns.
    pub change: Option<Change>,
    /// Gauss-Newton iterations, 0 if there are none.
    pub iterations: u32,
    /// Rows treated as outliers.
    pub outliers: u32,
}

/// A run of one estimator.
#[derive(Debug, Clone)]
pub struct RunRecord {
    /// One entry per complete block.
    pub blocks: Vec<BlockResult>,
    /// Computing time of each block.
    pub times: Vec<Duration>,
}

impl RunRecord {
    /// Mean computing time of a block.
    pub fn mean_time(&self) -> Duration {
        self.times.iter().sum::<Duration>() / self.times.len().max(1) as u32
    }

    /// Longest computing time of a block.
    pub fn worst_time(&self) -> Duration {
        self.times.iter().max().copied().unwrap_or_default()
    }
}

struct Clock(Vec<Duration>);

impl Clock {
    fn time<T>(&mut self, work: impl FnOnce() -> T) -> T {
        let start = Instant::now();
        let result = work();
        self.0.push(start.elapsed());
        result
    }

    fn record(self, blocks: Vec<BlockResult>) -> RunRecord {
        RunRecord { blocks, times: self.0 }
    }
}

fn array(values: &[f64]) -> [f64; MANIPULATOR_PARAMS] {
    std::array::from_fn(|i| values.get(i).copied().unwrap_or(f64::NAN))
}

/// The block estimator: the paper's variants and thetabus, by its options.
///
/// # Errors
/// If the options do not fit the arm.
pub fn run_blocks(
    scenario: &Scenario,
    block_len: usize,
    options: &EstimatorOptions,
) -> Result<RunRecord, CompareError> {
    let mut estimator = BlockEstimator::new(structure(&Manipulator::default()), options.clone())?;
    let mut states = StateMachine::new(&options.theta_start());
    let mut clock = Clock(Vec::new());
    let blocks = scenario
        .blocks(block_len)
        .map(|rows| {
            let report = clock.time(|| estimator.update(&rows));
            BlockResult {
                theta: array(&report.theta),
                std: array(&report.theta_std),
                usable: report.usable,
                use_ok: states.step(report, 0.0).use_ok,
                change: report.change,
                iterations: report.iterations,
                outliers: report.outliers,
            }
        })
        .collect();
    Ok(clock.record(blocks))
}

/// WRLS (2)–(4), sample by sample, on the equations in linear form: θ₁…θ₅, and θ₆, θ₇, θ₈, θ₆θ₉,
/// θ₇θ₉, from which θ₉ is the quotient of the last and the second. `forgetting_factor` is λ per
/// block, so the factor per sample is its `block_len`-th root.
///
/// Covariances are Γσ² with σ² from the innovations, as usual; they are valid without forgetting.
///
/// # Errors
/// If the start value, λ or ε is out of range.
pub fn run_wrls(scenario: &Scenario, block_len: usize, options: &EstimatorOptions) -> Result<RunRecord, CompareError> {
    let factor = options.forgetting_factor.powf(1.0 / block_len as f64);
    let start = options.theta_start();
    let starts = [
        [start[0], start[1], start[2], start[3], start[4]],
        [start[5], start[6], start[7], start[5] * start[8], start[6] * start[8]],
    ];
    let mut filters = Vec::new();
    for start in &starts {
        filters.push(Wrls::new(start, factor, options.information_floor)?);
    }
    let (mut variance, mut weight) = ([0.0; 2], 0.0);
    let mut covariance = [[0.0; 25]; 2];
    let mut clock = Clock(Vec::new());
    let mut blocks = Vec::new();
    for features in scenario.features().chunks_exact(block_len) {
        clock.time(|| {
            for sample in features {
                weight = factor * weight + 1.0;
                for (equation, filter) in filters.iter_mut().enumerate() {
                    let (regressor, v) = sample.linear_row(equation);
                    if let Some(innovation) = filter.update(&regressor, v) {
                        variance[equation] += (innovation * innovation - variance[equation]) / weight;
                    }
                }
            }
            for (filter, covariance) in filters.iter().zip(&mut covariance) {
                filter.covariance(covariance);
            }
        });
        let (one, two) = (filters[0].theta(), filters[1].theta());
        let (theta_7, product) = (two[1], two[4]);
        let theta_9 = product / theta_7;
        let std = |equation: usize, i: usize| (covariance[equation][i * 5 + i] * variance[equation]).sqrt();
        // Quotient to first order: θ₉ = β₅/β₂.
        let of = |i: usize, j: usize| covariance[1][i * 5 + j] * variance[1];
        let std_9 = ((of(4, 4) - 2.0 * theta_9 * of(1, 4) + theta_9 * theta_9 * of(1, 1)) / (theta_7 * theta_7)).sqrt();
        blocks.push(BlockResult {
            theta: [one[0], one[1], one[2], one[3], one[4], two[0], two[1], two[2], theta_9],
            std: [
                std(0, 0),
                std(0, 1),
                std(0, 2),
                std(0, 3),
                std(0, 4),
                std(1, 0),
                std(1, 1),
                std(1, 2),
                std_9,
            ],
            usable: IndexSet::EMPTY,
            use_ok: false,
            change: None,
            iterations: 0,
            outliers: 0,
        });
    }
    Ok(clock.record(blocks))
}

/// Off-line least squares over everything from the first sample to the end of a block, for the
/// blocks `at` (counted from 0).
///
/// # Errors
/// If the start value or a row is not finite.
pub fn run_batch(
    scenario: &Scenario,
    block_len: usize,
    theta_start: &[f64],
    at: &[usize],
) -> Result<RunRecord, CompareError> {
    let structure = structure(&Manipulator::default());
    let mut clock = Clock(Vec::new());
    let mut blocks = Vec::new();
    for &block in at {
        let rows = scenario.rows(0..(block + 1) * block_len);
        debug_assert!(!rows.is_empty());
        let report = clock.time(|| batch_least_squares(&structure, &rows, theta_start, 50));
        let report = report?;
        blocks.push(BlockResult {
            theta: array(&report.theta),
            std: array(&report.theta_std),
            usable: IndexSet::EMPTY,
            use_ok: false,
            change: None,
            iterations: report.iterations as u32,
            outliers: 0,
        });
    }
    Ok(clock.record(blocks))
}

/// The extended Kalman filter of [`ekf`](super::ekf).
pub fn run_ekf(scenario: &Scenario, block_len: usize, theta_start: &[f64], tuning: EkfTuning) -> RunRecord {
    let mut filter = Ekf::new(scenario, theta_start, tuning);
    // Contribution of a setpoint step to the voltage; 0 for smooth setpoints.
    let gains: [f64; 2] = std::array::from_fn(|joint| {
        let options = scenario.options();
        let steps = options.setpoint[joint].has_steps();
        if steps {
            options.controller.proportional_gain_v_per_rad[joint]
        } else {
            0.0
        }
    });
    let samples = scenario.samples();
    let mut clock = Clock(Vec::new());
    let mut blocks = Vec::new();
    for block in 0..samples.len() / block_len {
        clock.time(|| {
            for k in (block * block_len).max(1)..(block + 1) * block_len {
                let (before, now) = (&samples[k - 1], &samples[k]);
                // The voltage just before the setpoint's step at this sample, from (13).
                let end = [0, 1].map(|j| now.voltage[j] - gains[j] * (now.setpoint[j] - before.setpoint[j]));
                filter.predict(before.voltage, end);
                filter.update([now.q[1], now.dq[0], now.dq[1], now.ddq[0], now.ddq[1]]);
            }
        });
        blocks.push(BlockResult {
            theta: filter.theta(),
            std: filter.theta_std(),
            usable: IndexSet::EMPTY,
            use_ok: false,
            change: None,
            iterations: 0,
            outliers: 0,
        });
    }
    clock.record(blocks)
}
