//! One simulated run, stored in the form needed for rows, so that many estimators can use the same
//! data.

use crate::estimator::Residuals;
use crate::messages::nanoseconds;
use crate::model::{MANIPULATOR_PARAMS, MAX_JOINTS, Manipulator, ManipulatorFeatures, PointwiseModel};
use crate::sim::{ArmSimulator, SimError, SimOptions};

/// A sample of the arm; entries are \[joint 1, joint 2\] in SI units.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ArmSample {
    /// q.
    pub q: [f64; 2],
    /// q̇.
    pub dq: [f64; 2],
    /// q̈.
    pub ddq: [f64; 2],
    /// Setpoint.
    pub setpoint: [f64; 2],
    /// Measured voltage.
    pub voltage: [f64; 2],
}

/// A run of the arm: every sample, its features, and the true parameters.
#[derive(Debug, Clone)]
pub struct Scenario {
    options: SimOptions,
    model: Manipulator,
    samples: Vec<ArmSample>,
    features: Vec<ManipulatorFeatures>,
}

/// Samples `first..` of a scenario as rows for an estimator; stream time is in ns.
#[derive(Debug, Clone, Copy)]
pub struct ScenarioRows<'a> {
    model: &'a Manipulator,
    features: &'a [ManipulatorFeatures],
    first: u64,
    period_ns: u64,
}

impl Scenario {
    /// Simulates a run and keeps about 200 bytes per sample.
    ///
    /// # Errors
    /// If the options are invalid, or the closed loop is unstable and ends early.
    pub fn simulate(options: &SimOptions) -> Result<Self, SimError> {
        // Gravity was validated with the options; the default is never used.
        let simulator = ArmSimulator::new(options)?;
        let model = Manipulator::new(options.arm.gravity_m_s2).unwrap_or_default();
        let count = options.sample_count();
        let (mut samples, mut features) = (Vec::new(), Vec::new());
        for sample in simulator.take(count as usize) {
            let joints = |signal: &[f64; MAX_JOINTS]| [signal[0], signal[1]];
            features.push(model.features(&sample));
            samples.push(ArmSample {
                q: joints(&sample.q),
                dq: joints(&sample.dq),
                ddq: joints(&sample.ddq),
                setpoint: joints(&sample.setpoint),
                voltage: joints(&sample.input),
            });
        }
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
            samples,
            features,
        })
    }

    /// The options of the simulation.
    pub fn options(&self) -> &SimOptions {
        &self.options
    }

    /// The model of the rows.
    pub fn model(&self) -> &Manipulator {
        &self.model
    }

    /// The samples.
    pub fn samples(&self) -> &[ArmSample] {
        &self.samples
    }

    /// All samples as one block of rows, or those of a range.
    pub fn rows(&self, range: std::ops::Range<usize>) -> ScenarioRows<'_> {
        ScenarioRows {
            model: &self.model,
            features: &self.features[range.clone()],
            first: range.start as u64,
            period_ns: nanoseconds(self.options.sample_period_s),
        }
    }

    /// The features of every sample.
    pub fn features(&self) -> &[ManipulatorFeatures] {
        &self.features
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

    /// True θ at a sample.
    pub fn truth(&self, sample: usize) -> [f64; MANIPULATOR_PARAMS] {
        self.options.true_theta(self.time_s(sample))
    }

    /// The complete blocks of `block_len` samples, in order; `block_len` ≥ 1.
    pub fn blocks(&self, block_len: usize) -> impl Iterator<Item = ScenarioRows<'_>> {
        (0..self.len() / block_len).map(move |block| self.rows(block * block_len..(block + 1) * block_len))
    }

    /// The first sample with a changed mass, as (sample, block counted from 0).
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
