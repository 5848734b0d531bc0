//! Sensor errors between the exact signals of the simulated machine and the published samples.
//!
//! Positions pass, in this order: a resonance between joint and sensor, the instant at which they
//! are read (delay of the input, jitter), the encoder's eccentricity, noise, spikes, the encoder's
//! counts. The instant is moved by q + q̇ τ + q̈ τ²/2; the rest, q⃛ τ³/6, is below 1e-7 rad for
//! half a millisecond.

use super::arm_parameters::ARM_JOINTS;
use super::error::{SimError, finite, in_range, not_negative, positive};
use super::noise::Noise;
use super::resonance::Resonance;
use crate::messages::signals;
use crate::model::JointSample;
use std::f64::consts::TAU;

/// Errors added to the exact signals.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SensorOptions {
    /// Standard deviation of white noise on the measured voltage \[V\], ≥ 0. The motor gets the
    /// voltage without noise.
    pub input_noise_v: f64,
    /// Share of samples with a spike in the voltage, 0 to 1; independent for each joint.
    pub spike_probability: f64,
    /// Standard deviation of a spike \[V\], ≥ 0.
    pub spike_v: f64,
    /// Largest voltage that the measurement can show \[V\], of either sign, > 0; `inf` for no
    /// limit.
    pub input_limit_v: f64,
    /// One count of the voltage measurement \[V\], ≥ 0; 0 for voltages without rounding.
    pub input_resolution_v: f64,
    /// 2^bits counts per turn on each joint, up to 40; 0 for positions without rounding.
    pub encoder_bits: u32,
    /// Standard deviation of white noise on the measured position, before it is rounded \[rad\],
    /// ≥ 0.
    pub position_noise_rad: f64,
    /// Share of samples with a spike in the position, 0 to 1; independent for each joint.
    pub position_spike_probability: f64,
    /// Standard deviation of such a spike \[rad\], ≥ 0.
    pub position_spike_rad: f64,
    /// a of encoders mounted off their axes \[rad\]: they show q + a sin(q + phase); −0.1 to 0.1.
    pub eccentricity_rad: f64,
    /// The phase of it \[rad\].
    pub eccentricity_phase_rad: f64,
    /// Frequency of a resonance between joint and encoder \[Hz\], 0 to 1000; 0 for none.
    pub resonance_hz: f64,
    /// Damping ratio of it, 0 to 10.
    pub resonance_damping: f64,
    /// Delay of the recorded input's effect relative to the positions of its sample \[s\], up to
    /// 0.01 s either way.
    pub input_delay_s: f64,
    /// Standard deviation of the instant at which positions are read \[s\], 0 to 1e-3; the same for
    /// all joints of a sample.
    pub jitter_s: f64,
    /// Standard deviation of the instants of samples around their grid \[s\], 0 to 0.01; the
    /// machine, its controller and the time stamps follow the true instants.
    pub stamp_jitter_s: f64,
    /// Share of samples lost in transport, 0 to 1 exclusive.
    pub loss_probability: f64,
    /// Number of samples lost together, 1 to 10 000.
    pub loss_burst: u64,
}

impl SensorOptions {
    /// Exact signals.
    pub const fn exact() -> Self {
        Self {
            input_noise_v: 0.0,
            spike_probability: 0.0,
            spike_v: 0.0,
            input_limit_v: f64::INFINITY,
            input_resolution_v: 0.0,
            encoder_bits: 0,
            position_noise_rad: 0.0,
            position_spike_probability: 0.0,
            position_spike_rad: 0.0,
            eccentricity_rad: 0.0,
            eccentricity_phase_rad: 0.0,
            resonance_hz: 0.0,
            resonance_damping: 0.05,
            input_delay_s: 0.0,
            jitter_s: 0.0,
            stamp_jitter_s: 0.0,
            loss_probability: 0.0,
            loss_burst: 1,
        }
    }

    /// Encoders of 2^`bits` counts per turn and white noise on the measured voltage \[V\].
    pub const fn encoder(bits: u32, input_noise_v: f64) -> Self {
        let mut options = Self::exact();
        options.encoder_bits = bits;
        options.input_noise_v = input_noise_v;
        options
    }

    /// True if the published positions are the exact ones.
    pub fn exact_positions(&self) -> bool {
        let errors = [
            self.position_noise_rad,
            self.position_spike_probability,
            self.eccentricity_rad,
            self.resonance_hz,
            self.input_delay_s,
            self.jitter_s,
        ];
        self.encoder_bits == 0 && errors.iter().all(|&error| error == 0.0)
    }

    /// Which of a sample's [`signals`] hold data: a machine whose positions come from a sensor
    /// reports no derivatives.
    pub fn signals(&self) -> u32 {
        if self.exact_positions() {
            signals::ALL
        } else {
            signals::Q | signals::SETPOINT | signals::INPUT
        }
    }

    /// One count of the encoders \[rad\], 0 if there are none.
    pub fn resolution_rad(&self) -> f64 {
        match self.encoder_bits {
            0 => 0.0,
            bits => TAU / f64::from(bits).exp2(),
        }
    }

    /// Checks every value against its domain.
    ///
    /// # Errors
    /// The first value out of range, with its name.
    pub fn validate(&self) -> Result<(), SimError> {
        not_negative("sensors.input_noise_v", self.input_noise_v)?;
        in_range("sensors.spike_probability", self.spike_probability, 0.0, 1.0)?;
        not_negative("sensors.spike_v", self.spike_v)?;
        if self.input_limit_v != f64::INFINITY {
            positive("sensors.input_limit_v", self.input_limit_v)?;
        }
        not_negative("sensors.input_resolution_v", self.input_resolution_v)?;
        if self.encoder_bits > 40 {
            return Err(SimError::new("sensors.encoder_bits", "0 to 40", self.encoder_bits));
        }
        not_negative("sensors.position_noise_rad", self.position_noise_rad)?;
        in_range(
            "sensors.position_spike_probability",
            self.position_spike_probability,
            0.0,
            1.0,
        )?;
        not_negative("sensors.position_spike_rad", self.position_spike_rad)?;
        in_range("sensors.eccentricity_rad", self.eccentricity_rad, -0.1, 0.1)?;
        finite("sensors.eccentricity_phase_rad", self.eccentricity_phase_rad)?;
        in_range("sensors.resonance_hz", self.resonance_hz, 0.0, 1000.0)?;
        in_range("sensors.resonance_damping", self.resonance_damping, 0.0, 10.0)?;
        in_range("sensors.input_delay_s", self.input_delay_s, -0.01, 0.01)?;
        in_range("sensors.jitter_s", self.jitter_s, 0.0, 1e-3)?;
        in_range("sensors.stamp_jitter_s", self.stamp_jitter_s, 0.0, 0.01)?;
        in_range("sensors.loss_probability", self.loss_probability, 0.0, 0.999)?;
        in_range("sensors.loss_burst", self.loss_burst as f64, 1.0, 10_000.0)
    }
}

/// Turns exact samples into measured ones.
#[derive(Debug, Clone)]
pub(super) struct Sensors<const N: usize = ARM_JOINTS> {
    options: SensorOptions,
    /// One count of the positions, 0 if they are not rounded.
    resolution: f64,
    noise: Noise,
    spikes: Noise,
    positions: Noise,
    position_spikes: Noise,
    jitter: Noise,
    resonances: Option<[Resonance; N]>,
}

impl<const N: usize> Sensors<N> {
    pub fn new(options: SensorOptions, seed: u64) -> Self {
        Self {
            options,
            resolution: options.resolution_rad(),
            noise: Noise::new(seed, Noise::INPUT),
            spikes: Noise::new(seed, Noise::SPIKES),
            positions: Noise::new(seed, Noise::POSITION),
            position_spikes: Noise::new(seed, Noise::POSITION_SPIKES),
            jitter: Noise::new(seed, Noise::JITTER),
            resonances: (options.resonance_hz > 0.0)
                .then(|| [Resonance::new(options.resonance_hz, options.resonance_damping); N]),
        }
    }

    /// Sets the size of a count, if this is above 0.
    pub fn with_resolution(mut self, resolution: f64) -> Self {
        if resolution > 0.0 {
            self.resolution = resolution;
        }
        self
    }

    /// True if the published positions are the exact ones.
    fn exact_positions(&self) -> bool {
        self.options.exact_positions() && self.resolution == 0.0
    }

    /// The measured positions of this sample, from positions, velocities and accelerations.
    pub fn positions(&mut self, q: [f64; N], dq: [f64; N], ddq: [f64; N]) -> [f64; N] {
        if self.exact_positions() {
            return q;
        }
        let (mut q, mut dq, mut ddq) = (q, dq, ddq);
        for (joint, resonance) in self.resonances.iter_mut().flatten().enumerate() {
            [q[joint], dq[joint], ddq[joint]] = resonance.output(q[joint]);
        }
        let options = &self.options;
        let mut late_s = -options.input_delay_s;
        if options.jitter_s > 0.0 {
            late_s += options.jitter_s * self.jitter.normal();
        }
        std::array::from_fn(|joint| {
            let mut position = q[joint] + late_s * (dq[joint] + 0.5 * late_s * ddq[joint]);
            if options.eccentricity_rad != 0.0 {
                position += options.eccentricity_rad * (position + options.eccentricity_phase_rad).sin();
            }
            if options.position_noise_rad > 0.0 {
                position += options.position_noise_rad * self.positions.normal();
            }
            if options.position_spike_probability > 0.0 {
                let (chance, size) = (self.position_spikes.uniform(), self.position_spikes.normal());
                if chance < options.position_spike_probability {
                    position += options.position_spike_rad * size;
                }
            }
            match self.resolution {
                0.0 => position,
                count => (position / count).round() * count,
            }
        })
    }

    /// Advances from one sample to the next: positions and velocities at both, `h` seconds apart.
    pub fn advance(&mut self, from: [[f64; 2]; N], to: [[f64; 2]; N], h: f64) {
        for (joint, resonance) in self.resonances.iter_mut().flatten().enumerate() {
            resonance.advance(from[joint], to[joint], h);
        }
    }

    /// Adds this sample's errors. Always draws the same number of values, so that one source of
    /// noise does not change the draws of another. Derivatives are cleared if the positions are
    /// measured.
    pub fn measure(&mut self, sample: &mut JointSample) {
        let options = &self.options;
        for joint in 0..N {
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
            if options.input_resolution_v > 0.0 {
                let count = options.input_resolution_v;
                sample.input[joint] = (sample.input[joint] / count).round() * count;
            }
        }
        if !self.exact_positions() {
            (sample.dq, sample.ddq, sample.dddq) = Default::default();
        }
    }
}

/// Selects the samples lost between the machine and its consumers.
#[derive(Debug, Clone)]
pub struct Losses {
    /// Probability that a burst begins at a sample outside a burst.
    probability: f64,
    burst: u64,
    left: u64,
    noise: Noise,
}

impl Losses {
    /// The losses of a run.
    pub fn new(options: &SensorOptions, seed: u64) -> Self {
        Self {
            // With bursts of L samples the share p is lost if one begins with q: q L/(q L + 1 −
            // q) = p.
            probability: options.loss_probability
                / (options.loss_probability + options.loss_burst as f64 * (1.0 - options.loss_probability)),
            burst: options.loss_burst,
            left: 0,
            noise: Noise::new(seed, Noise::LOSSES),
        }
    }

    /// True if the next sample is lost.
    pub fn next_is_lost(&mut self) -> bool {
        if self.left > 0 {
            self.left -= 1;
            return true;
        }
        let begins = self.probability > 0.0 && self.noise.uniform() < self.probability;
        if begins {
            self.left = self.burst - 1;
        }
        begins
    }
}
