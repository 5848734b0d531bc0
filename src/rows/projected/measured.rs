//! A block as measured: samples, their noise, the jumps of the inputs.

use super::input_jumps::InputJumps;
use super::options::{ProjectedError, ProjectedOptions};
use super::reversal_errors::ReversalErrors;
use super::sample_noise::SampleNoise;
use super::samples::Samples;
use super::weak_form::WeakForm;
use crate::model::{JointSample, SharedPlant};
use crate::rows::kernel::InputTiming;

/// The block, and the equations in weak form.
#[derive(Debug, Clone)]
pub(super) struct MeasuredBlock {
    pub form: WeakForm,
    pub samples: Samples,
    pub noise: SampleNoise,
    pub jumps: InputJumps,
    pub reversals: ReversalErrors,
}

impl MeasuredBlock {
    /// Workspace for a block of `block_len` samples. The options must be valid.
    ///
    /// # Errors
    /// If the velocity filter has too few samples.
    pub fn new(plant: SharedPlant, options: ProjectedOptions, block_len: usize) -> Result<Self, ProjectedError> {
        let form = WeakForm::new(plant, options)?;
        let samples = Samples::new(&form, block_len);
        let (joints, capacity) = (form.plant.joints(), samples.capacity());
        Ok(Self {
            reversals: ReversalErrors::new(&form, capacity),
            form,
            samples,
            noise: SampleNoise::new(options.noise, joints, capacity),
            jumps: InputJumps::new(joints, capacity),
        })
    }

    /// Adds a sample; false if the block is full.
    pub fn push(&mut self, t_ns: u64, sample: &JointSample) -> bool {
        self.samples.push(&self.form, t_ns, sample)
    }

    /// Repairs the samples of a complete block and determines their noise.
    pub fn sense(&mut self) {
        let sensors = &self.noise.sensors;
        self.samples.mend(&self.form, |joint| {
            (sensors.deviations(joint), sensors.position_resolution[joint])
        });
        self.noise.sense(&self.form, &self.samples);
    }

    /// Finds the jumps of otherwise continuous inputs.
    pub fn find_jumps(&mut self) {
        if self.form.options.timing != InputTiming::Continuous {
            return;
        }
        let samples = &self.samples;
        for (joint, u) in samples.signals.u.iter().enumerate() {
            let std = self.noise.input_std(joint);
            let surplus = &mut self.noise.surplus[joint];
            self.jumps.find(joint, &u[..samples.len], std, &samples.steps, surplus);
        }
    }

    /// s ∫ψ^(r) u of the window around a centre for r < N ≤ 3; `u` are measured or smoothed inputs
    /// \[joint\]\[sample\].
    pub fn moments<const N: usize>(&self, equation: usize, centre: usize, u: &[Vec<f64>]) -> [f64; N] {
        let (input, scale) = self.form.input(equation);
        let moments = self.jumps.moments(&self.form.kernels, centre, input, &u[input]);
        moments.map(|moment| scale * moment)
    }

    /// Keeps the samples that the next block's windows need.
    pub fn clear(&mut self) {
        self.samples.clear();
    }

    /// Begins a new stream.
    pub fn reset(&mut self) {
        self.samples.reset();
        self.noise.reset();
    }
}
