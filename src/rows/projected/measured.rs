//! A block as it was measured: samples, their noise, the jumps of the inputs.

use super::input_jumps::InputJumps;
use super::options::{ProjectedError, ProjectedOptions};
use super::sample_noise::SampleNoise;
use super::samples::Samples;
use super::weak_form::WeakForm;
use crate::model::{JointSample, Plant};
use crate::rows::kernel::InputTiming;

/// The block, and the equations that it is seen through.
#[derive(Debug, Clone)]
pub(super) struct MeasuredBlock<P> {
    pub form: WeakForm<P>,
    pub samples: Samples,
    pub noise: SampleNoise,
    pub jumps: InputJumps,
}

impl<P: Plant> MeasuredBlock<P> {
    /// Room for a block of `block_len` samples. The options must be valid.
    ///
    /// # Errors
    /// A velocity filter over too few samples.
    pub fn new(plant: P, options: ProjectedOptions, block_len: usize) -> Result<Self, ProjectedError> {
        let form = WeakForm::new(plant, options)?;
        let samples = Samples::new(&form, block_len);
        let (joints, capacity) = (form.plant.joints(), samples.capacity());
        Ok(Self {
            form,
            samples,
            noise: SampleNoise::new(options.noise, joints, capacity),
            jumps: InputJumps::new(joints, capacity),
        })
    }

    /// Takes a sample in; false if there is no room for it.
    pub fn push(&mut self, t_ns: u64, sample: &JointSample) -> bool {
        self.samples.push(&self.form, t_ns, sample)
    }

    /// Mends the samples of a block that is complete and says what each is worth.
    pub fn sense(&mut self) {
        let sensors = &self.noise.sensors;
        self.samples.mend(&self.form, |joint| {
            (sensors.deviations(joint), sensors.position_resolution[joint])
        });
        self.noise.sense(&self.form, &self.samples);
    }

    /// Finds the jumps of inputs that are continuous otherwise.
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

    /// s ∫ψ^(r) u of the window around a centre for r < N ≤ 3; `u` are inputs as measured or freed
    /// of noise \[joint\]\[sample\].
    pub fn moments<const N: usize>(&self, equation: usize, centre: usize, u: &[Vec<f64>]) -> [f64; N] {
        let (input, scale) = self.form.input(equation);
        let moments = self.jumps.moments(&self.form.kernels, centre, input, &u[input]);
        moments.map(|moment| scale * moment)
    }

    /// Keeps what the next block's windows reach back to.
    pub fn clear(&mut self) {
        self.samples.clear();
    }

    /// Begins a new stream.
    pub fn reset(&mut self) {
        self.samples.reset();
        self.noise.reset();
    }
}
