//! What stands between the exact signals of the simulated machine and the samples that it publishes.
//!
//! Positions pass, in this order: the instant at which they are read (delay of the input, jitter), noise, the encoder's counts. The instant is
//! moved by q + q̇ τ + q̈ τ²/2; the rest, q⃛ τ³/6, is below 1e-7 rad for half a millisecond.

use super::noise::Noise;
use super::options::{ARM_JOINTS, SimError, in_range, not_negative, positive};
use crate::messages::signals;
use crate::model::JointSample;
use std::f64::consts::TAU;

/// Errors added to the exact signals.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SensorOptions {
    /// Standard deviation of white noise on the measured voltage \[V\], ≥ 0. The motor gets the voltage without it.
    pub input_noise_v: f64,
    /// Share of samples whose voltage carries a spike, 0 to 1; each joint on its own.
    pub spike_probability: f64,
    /// Standard deviation of a spike \[V\], ≥ 0.
    pub spike_v: f64,
    /// Most that the voltage measurement can show \[V\], either sign, > 0; `inf` for no limit.
    pub input_limit_v: f64,
    /// 2^bits counts per turn on each joint, up to 40; 0 for positions without rounding.
    pub encoder_bits: u32,
    /// Standard deviation of white noise on the measured position, before it is rounded \[rad\], ≥ 0.
    pub position_noise_rad: f64,
    /// The recorded input acts this much later than the positions of its sample say \[s\], up to 0.01 s either way.
    pub input_delay_s: f64,
    /// Standard deviation of the instant at which positions are read \[s\], 0 to 1e-3; the same for all joints of a sample.
    pub jitter_s: f64,
    /// Share of samples that are lost on their way, 0 to 1 exclusive.
    pub loss_probability: f64,
}

impl SensorOptions {
    /// Every signal as it is.
    pub const fn exact() -> Self {
        Self {
            input_noise_v: 0.0,
            spike_probability: 0.0,
            spike_v: 0.0,
            input_limit_v: f64::INFINITY,
            encoder_bits: 0,
            position_noise_rad: 0.0,
            input_delay_s: 0.0,
            jitter_s: 0.0,
            loss_probability: 0.0,
        }
    }

    /// Encoders of 2^`bits` counts per turn and white noise on the measured voltage \[V\].
    pub const fn encoder(bits: u32, input_noise_v: f64) -> Self {
        let mut options = Self::exact();
        options.encoder_bits = bits;
        options.input_noise_v = input_noise_v;
        options
    }

    /// True where the published positions are the exact ones.
    pub fn exact_positions(&self) -> bool {
        self.encoder_bits == 0 && self.position_noise_rad == 0.0 && self.input_delay_s == 0.0 && self.jitter_s == 0.0
    }

    /// Which of a sample's [`signals`] hold data: a machine whose positions come from a sensor reports no derivatives.
    pub fn signals(&self) -> u32 {
        if self.exact_positions() {
            signals::ALL
        } else {
            signals::Q | signals::SETPOINT | signals::INPUT
        }
    }

    /// One count of the encoders \[rad\], 0 where there are none.
    pub fn resolution_rad(&self) -> f64 {
        match self.encoder_bits {
            0 => 0.0,
            bits => TAU / f64::from(bits).exp2(),
        }
    }

    /// Checks every value against its domain.
    ///
    /// # Errors
    /// The first value outside, with its name.
    pub fn validate(&self) -> Result<(), SimError> {
        not_negative("sensors.input_noise_v", self.input_noise_v)?;
        in_range("sensors.spike_probability", self.spike_probability, 0.0, 1.0)?;
        not_negative("sensors.spike_v", self.spike_v)?;
        if self.input_limit_v != f64::INFINITY {
            positive("sensors.input_limit_v", self.input_limit_v)?;
        }
        if self.encoder_bits > 40 {
            return Err(SimError::new("sensors.encoder_bits", "0 to 40", self.encoder_bits));
        }
        not_negative("sensors.position_noise_rad", self.position_noise_rad)?;
        in_range("sensors.input_delay_s", self.input_delay_s, -0.01, 0.01)?;
        in_range("sensors.jitter_s", self.jitter_s, 0.0, 1e-3)?;
        in_range("sensors.loss_probability", self.loss_probability, 0.0, 0.999)
    }
}

/// Turns exact samples into measured ones.
#[derive(Debug, Clone)]
pub(super) struct Sensors {
    options: SensorOptions,
    /// One count of the positions, 0 where they are not rounded.
    resolution: f64,
    noise: Noise,
    spikes: Noise,
    positions: Noise,
    jitter: Noise,
}

impl Sensors {
    pub fn new(options: SensorOptions, seed: u64) -> Self {
        Self {
            options,
            resolution: options.resolution_rad(),
            noise: Noise::new(seed, Noise::INPUT),
            spikes: Noise::new(seed, Noise::SPIKES),
            positions: Noise::new(seed, Noise::POSITION),
            jitter: Noise::new(seed, Noise::JITTER),
        }
    }

    /// With counts of another size, where this is above 0.
    pub fn with_resolution(mut self, resolution: f64) -> Self {
        if resolution > 0.0 {
            self.resolution = resolution;
        }
        self
    }

    /// True where the published positions are the exact ones.
    fn exact_positions(&self) -> bool {
        self.options.exact_positions() && self.resolution == 0.0
    }

    /// The positions as this sample's sensors show them, from positions, velocities and accelerations.
    pub fn positions(
        &mut self,
        q: [f64; ARM_JOINTS],
        dq: [f64; ARM_JOINTS],
        ddq: [f64; ARM_JOINTS],
    ) -> [f64; ARM_JOINTS] {
        if self.exact_positions() {
            return q;
        }
        let options = &self.options;
        let mut late_s = -options.input_delay_s;
        if options.jitter_s > 0.0 {
            late_s += options.jitter_s * self.jitter.normal();
        }
        std::array::from_fn(|joint| {
            let mut position = q[joint] + late_s * (dq[joint] + 0.5 * late_s * ddq[joint]);
            if options.position_noise_rad > 0.0 {
                position += options.position_noise_rad * self.positions.normal();
            }
            match self.resolution {
                0.0 => position,
                count => (position / count).round() * count,
            }
        })
    }

    /// Adds this sample's errors. Draws the same number of values whatever they are, so that one source of noise does not
    /// change the draws of another. Derivatives are blanked where the positions are measured.
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
            sample.input[joint] = sample.input[joint].clamp(-options.input_limit_v, options.input_limit_v);
        }
        if !self.exact_positions() {
            (sample.dq, sample.ddq, sample.dddq) = Default::default();
        }
    }
}

/// Which samples get lost between the machine and its listeners.
#[derive(Debug, Clone)]
pub struct Losses {
    probability: f64,
    noise: Noise,
}

impl Losses {
    /// The losses of a run.
    pub fn new(options: &SensorOptions, seed: u64) -> Self {
        Self {
            probability: options.loss_probability,
            noise: Noise::new(seed, Noise::LOSSES),
        }
    }

    /// Whether the next sample is lost.
    pub fn next_is_lost(&mut self) -> bool {
        self.probability > 0.0 && self.noise.uniform() < self.probability
    }
}
