//! What stands between the exact signals of the simulated machine and the samples that it publishes.

use super::noise::Noise;
use super::options::{ARM_JOINTS, SimError, in_range, not_negative};
use crate::model::JointSample;

/// Errors added to the exact signals.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SensorOptions {
    /// Standard deviation of white noise on the measured voltage \[V\], ≥ 0. The motor gets the voltage without it.
    pub input_noise_v: f64,
    /// Share of samples whose voltage carries a spike, 0 to 1; each joint on its own.
    pub spike_probability: f64,
    /// Standard deviation of a spike \[V\], ≥ 0.
    pub spike_v: f64,
}

impl SensorOptions {
    /// Every signal as it is.
    pub const fn exact() -> Self {
        Self {
            input_noise_v: 0.0,
            spike_probability: 0.0,
            spike_v: 0.0,
        }
    }

    /// Checks every value against its domain.
    ///
    /// # Errors
    /// The first value outside, with its name.
    pub fn validate(&self) -> Result<(), SimError> {
        not_negative("sensors.input_noise_v", self.input_noise_v)?;
        in_range("sensors.spike_probability", self.spike_probability, 0.0, 1.0)?;
        not_negative("sensors.spike_v", self.spike_v)
    }
}

/// Turns exact samples into measured ones.
#[derive(Debug, Clone)]
pub(super) struct Sensors {
    options: SensorOptions,
    noise: Noise,
    spikes: Noise,
}

impl Sensors {
    pub fn new(options: SensorOptions, seed: u64) -> Self {
        Self {
            options,
            noise: Noise::new(seed, Noise::INPUT),
            spikes: Noise::new(seed, Noise::SPIKES),
        }
    }

    /// Adds this sample's errors. Draws the same number of values whatever they are, so that one source of noise does not
    /// change the draws of another.
    pub fn measure(&mut self, sample: &mut JointSample) {
        let options = &self.options;
        for joint in 0..ARM_JOINTS {
            if options.input_noise_v > 0.0 {
                sample.input[joint] += options.input_noise_v * self.noise.normal();
            }
            if options.spike_probability > 0.0 {
                let (chance, size) = (self.spikes.uniform(), self.spikes.normal());
                if chance < options.spike_probability {
                    sample.input[joint] += options.spike_v * size;
                }
            }
        }
    }
}
