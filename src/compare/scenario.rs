//! One simulated run, kept as what the rows need, so that many estimators can be put on the very same data.

use crate::estimator::Residuals;
use crate::model::{MANIPULATOR_PARAMS, Manipulator, ManipulatorFeatures, PointwiseModel};
use crate::sim::{ArmSimulator, SimError, SimOptions};

/// A run of the arm: features of every sample and the true parameters.
#[derive(Debug, Clone)]
pub struct Scenario {
    options: SimOptions,
    model: Manipulator,
    features: Vec<ManipulatorFeatures>,
}

/// Samples `first..` of a scenario as rows for an estimator; stream time counts in ns.
#[derive(Debug, Clone, Copy)]
pub struct ScenarioRows<'a> {
    model: &'a Manipulator,
    features: &'a [ManipulatorFeatures],
    first: u64,
    period_ns: u64,
}

impl Scenario {
    /// Simulates; some 100 bytes a sample are kept.
    ///
    /// # Errors
    /// The options are not valid, or the closed loop is unstable and ends before the duration does.
    pub fn simulate(options: &SimOptions) -> Result<Self, SimError> {
        // Gravity was validated with the options; the default is never used.
        let simulator = ArmSimulator::new(options)?;
        let model = Manipulator::new(options.arm.gravity_m_s2).unwrap_or_default();
        let count = options.sample_count();
        let features: Vec<_> = simulator
            .take(count as usize)
            .map(|sample| model.features(&sample))
            .collect();
        if (features.len() as u64) < count {
            return Err(SimError {
                field: "controller",
                joint: None,
                expected: "a stable closed loop".to_owned(),
                got: format!("numbers that are not finite after {} samples", features.len()),
            });
        }
        Ok(Self {
            options: options.clone(),
            model,
            features,
        })
    }

    /// What was simulated.
    pub fn options(&self) -> &SimOptions {
        &self.options
    }

    /// Number of samples.
    pub fn len(&self) -> usize {
        self.features.len()
    }

    /// True for a run without samples.
    pub fn is_empty(&self) -> bool {
        self.features.is_empty()
    }

    /// Time of a sample \[s\].
    pub fn time_s(&self, sample: usize) -> f64 {
        sample as f64 * self.options.sample_period_s
    }

    /// θ as it really is at a sample.
    pub fn truth(&self, sample: usize) -> [f64; MANIPULATOR_PARAMS] {
        self.options.true_theta(self.time_s(sample))
    }

    /// The complete blocks of `block_len` samples, in order; `block_len` ≥ 1.
    pub fn blocks(&self, block_len: usize) -> impl Iterator<Item = ScenarioRows<'_>> {
        let period_ns = (self.options.sample_period_s * 1e9).round() as u64;
        self.features
            .chunks_exact(block_len)
            .enumerate()
            .map(move |(block, features)| ScenarioRows {
                model: &self.model,
                features,
                first: (block * block_len) as u64,
                period_ns,
            })
    }

    /// The first sample at which the mass is another one than before, as (sample, block counted from 0).
    pub fn first_change(&self, block_len: usize) -> Option<(usize, usize)> {
        let mass = |sample: usize| self.options.mass_2.mass_kg(self.time_s(sample));
        (1..self.len())
            .find(|&k| mass(k) != mass(k - 1))
            .map(|k| (k, k / block_len))
    }
}

impl Residuals for ScenarioRows<'_> {
    fn len(&self) -> usize {
        self.features.len()
    }

    #[inline]
    fn row(&self, equation: usize, index: usize, theta: &[f64], regressor: &mut [f64]) -> f64 {
        self.model.row(equation, &self.features[index], theta, regressor)
    }

    fn span(&self, index: usize) -> (u64, u64) {
        let t_ns = (self.first + index as u64) * self.period_ns;
        (t_ns, t_ns)
    }
}
