//! A block of samples as projected rows, for an estimator.

use super::first_fit::FirstFit;
use super::measured::MeasuredBlock;
use super::options::{ProjectedError, ProjectedOptions};
use super::projection::Projection;
use super::sensor_noise::SensorNoise;
use crate::estimator::{Residuals, SuspectRows};
use crate::model::{AnyPlant, JointSample, Plant, SharedPlant};
use crate::rows::suspect::Suspect;
use crate::rows::theta_polynomial::MAX_ORDER;
use crate::rows::{FirstBlocks, SampleBlock, structure};
use std::sync::Arc;

/// A block of samples as projected rows, see the head of `mod.rs`.
#[derive(Debug, Clone)]
pub struct ProjectedBlock {
    rows: Projection,
    first_fit: FirstFit,
}

impl ProjectedBlock {
    /// An empty block for up to `block_len` samples. Only this call allocates.
    ///
    /// # Errors
    /// If an option is out of range, or the plant has terms differentiated more than twice or no
    /// parameters.
    pub fn new(
        plant: impl Plant + Send + Sync + 'static,
        options: ProjectedOptions,
        block_len: usize,
    ) -> Result<Self, ProjectedError> {
        Self::shared(Arc::new(plant), options, block_len)
    }

    /// The same for a plant that other rows have, too.
    pub(in crate::rows) fn shared(
        plant: SharedPlant,
        options: ProjectedOptions,
        block_len: usize,
    ) -> Result<Self, ProjectedError> {
        options.validate()?;
        if let Some(equation) = plant.equations().iter().find(|e| e.order >= MAX_ORDER) {
            return Err(ProjectedError::Order {
                equation: equation.name.to_string(),
                expected: MAX_ORDER - 1,
                got: equation.order,
            });
        }
        let first_fit = FirstFit::new(&*plant, structure(&*plant)).map_err(|_| ProjectedError::Plant)?;
        let block = MeasuredBlock::new(plant, options, block_len)?;
        Ok(Self {
            first_fit: first_fit.with_finder(&block.form.separation.equations),
            rows: Projection::new(block),
        })
    }

    /// The same with these start values, instead of the plant's, for the weights of the first
    /// block.
    ///
    /// # Errors
    /// If there is not exactly one finite value within its bounds per parameter.
    pub fn starting_at(mut self, theta: &[f64]) -> Result<Self, ProjectedError> {
        let structure = structure(self.plant());
        let started = self.first_fit.starting_at(structure, theta);
        self.first_fit = started.map_err(|_| ProjectedError::Plant)?;
        Ok(self)
    }

    /// The plant of the rows.
    pub fn plant(&self) -> &dyn AnyPlant {
        &*self.rows.block.form.plant
    }

    /// The sensors' noise, as configured or as learnt up to the last prepared block.
    pub fn noise(&self) -> &SensorNoise {
        &self.rows.block.noise.sensors
    }

    /// The options in force.
    pub fn options(&self) -> &ProjectedOptions {
        &self.rows.block.form.options
    }

    /// The longest uninterrupted stretch of a joint's positions in the prepared block, and the
    /// variance of their noise.
    pub(in crate::rows) fn positions(&self, joint: usize) -> (&[f64], f64) {
        let samples = &self.rows.block.samples;
        let positions = &samples.signals.q[joint][samples.longest_stretch()];
        (positions, self.noise().deviations(joint)[0].powi(2))
    }

    /// Adopts what another block of this plant has learnt of the sensors; the estimator knows θ by
    /// then.
    pub(in crate::rows) fn take_over(&mut self, other: &Self) {
        self.first_fit.end();
        self.rows.block.noise.take_over(&other.rows.block.noise);
    }
}

impl Residuals for ProjectedBlock {
    fn len(&self) -> usize {
        self.rows.len()
    }

    #[inline]
    fn row(&self, equation: usize, index: usize, theta: &[f64], regressor: &mut [f64]) -> f64 {
        self.rows.row(equation, index, theta, regressor)
    }

    fn span(&self, index: usize) -> (u64, u64) {
        self.rows.span(index)
    }

    fn is_used(&self, equation: usize, index: usize) -> bool {
        self.rows.is_used(equation, index)
    }

    fn tail(&self, equation: usize, k: usize, theta: &[f64]) -> Option<f64> {
        self.rows.tail(equation, k, theta)
    }

    fn products(&self) -> &[(usize, usize)] {
        self.rows.products()
    }

    fn sensor_variance(&self, _equation: usize) -> Option<f64> {
        self.rows.block.noise.is_known().then_some(1.0)
    }

    fn suspect_rows(&self) -> &dyn SuspectRows {
        &self.rows.suspects
    }

    fn row_forward(&self, equation: usize, index: usize, theta: &[f64], regressor: &mut [f64]) -> f64 {
        self.rows.row_forward(equation, index, theta, regressor)
    }

    fn start(&self) -> Option<&[f64]> {
        self.first_fit.start()
    }
}

impl SampleBlock for ProjectedBlock {
    fn push(&mut self, t_ns: u64, sample: &JointSample) -> bool {
        self.rows.block.push(t_ns, sample)
    }

    fn prepare(&mut self, theta: &[f64]) {
        self.rows.project();
        if !self.rows.is_empty() {
            self.first_fit.weigh(&mut self.rows, theta);
            self.rows.project_suspects();
        }
    }

    fn enable_scale_columns(&mut self, enabled: bool) {
        self.rows.suspects.enable_scale_columns(enabled);
    }

    fn replaced(&self) -> u32 {
        self.rows.block.samples.repair.replaced()
    }

    fn suspect(&self, index: usize) -> Option<Suspect<'_>> {
        let unit = self.rows.block.form.plant.input_unit();
        self.rows.suspects.describe(index, unit)
    }

    fn clear(&mut self) {
        self.rows.clear();
    }

    fn reset(&mut self) {
        self.rows.reset();
    }

    fn forget_theta(&mut self) {
        self.first_fit.restart();
    }

    fn first_blocks(&self) -> FirstBlocks {
        FirstBlocks::new(self.rows.block.form.plant.joints(), self.rows.block.samples.block_len())
    }

    fn know_theta(&mut self) {
        self.first_fit.end();
    }
}
