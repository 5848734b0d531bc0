//! The run that the study of encoders and voltages varies: setpoints, encoders, rows and estimator.

use super::Reference;
use crate::estimator::EstimatorOptions;
use crate::rows::{InputTiming, ProjectedOptions, SensorNoise};
use crate::sim::{ControllerKind, MassSchedule, SensorOptions, Setpoint, SimOptions, Tone};

/// Setpoints of the arm, |q₁| ≤ 1 rad and |q₂| ≤ 0.8 rad.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Signals {
    /// Random levels, each for 1 to 3 s.
    Steps,
    /// A square wave per joint.
    Square,
    /// Six sines from 0.23 to 5.3 Hz with slowly falling amplitudes, as f^(−1/4), and phases from
    /// the seed.
    Sines,
    /// Six sines of equal speed, amplitudes as 1/f: hardly informative about an inductance.
    LazySines,
}

impl Signals {
    /// The three kinds in the figures.
    pub const MAIN: [Self; 3] = [Self::Steps, Self::Square, Self::Sines];
    /// Every kind.
    pub const ALL: [Self; 4] = [Self::Steps, Self::Square, Self::Sines, Self::LazySines];

    /// Name for tables.
    pub fn name(self) -> &'static str {
        match self {
            Self::Steps => "steps",
            Self::Square => "square",
            Self::Sines => "sines",
            Self::LazySines => "sines, equal speeds",
        }
    }

    /// `base` with these signals and this seed.
    pub fn apply(self, base: &SimOptions, seed: u64) -> SimOptions {
        match self {
            Self::Steps => Reference::Steps.apply(base, seed),
            Self::Square => Reference::Square.apply(base, seed),
            Self::LazySines => Reference::Sines.apply(base, seed),
            Self::Sines => {
                let frequencies_hz = [0.23, 0.43, 0.81, 1.51, 2.83, 5.3f64];
                let size = |frequency: f64| frequency.powf(-0.25);
                let total: f64 = frequencies_hz.iter().copied().map(size).sum();
                let setpoint = [(0u64, 1.0), (1, 0.8)].map(|(joint, reach)| Setpoint::Sines {
                    offset_rad: 0.0,
                    tones: frequencies_hz
                        .iter()
                        .zip(0u64..)
                        .map(|(&frequency, k)| Tone {
                            // the joints share no frequency
                            frequency_hz: frequency * (1.0 + 0.07 * joint as f64),
                            amplitude_rad: reach * size(frequency) / total,
                            phase_rad: ((13 * seed + 7 * k + 5 * joint) as f64 * 0.618_034).fract()
                                * std::f64::consts::TAU,
                        })
                        .collect(),
                });
                SimOptions {
                    seed,
                    setpoint,
                    ..base.clone()
                }
            }
        }
    }
}

/// The run that the tables vary: simulation, rows and estimator.
#[derive(Debug, Clone)]
pub struct EncoderSetup {
    /// The configured simulation.
    pub sim: SimOptions,
    /// The configured rows.
    pub rows: ProjectedOptions,
    /// The configured estimator.
    pub options: EstimatorOptions,
    /// N.
    pub block_len: usize,
}

impl EncoderSetup {
    /// The same with other encoders \[bits\], voltage noise \[V\] and controller, for which the
    /// rows are configured.
    pub fn with(&self, bits: u32, noise_v: f64, kind: ControllerKind) -> Self {
        let mut setup = self.clone();
        setup.sim.sensors = SensorOptions {
            encoder_bits: bits,
            input_noise_v: noise_v,
            ..self.sim.sensors
        };
        setup.sim.controller.kind = kind;
        setup.rows.noise = SensorNoise::encoder(bits, noise_v);
        setup.rows.timing = match kind {
            ControllerKind::Analog => InputTiming::Continuous,
            ControllerKind::Sampled => InputTiming::Held,
        };
        setup
    }

    /// The same with the noise levels learnt from the signals.
    pub fn learning(&self) -> Self {
        let mut setup = self.clone();
        setup.rows.noise = SensorNoise::NONE;
        setup.rows.learn_noise = true;
        setup
    }

    /// The same for `blocks` blocks with a constant payload.
    pub(super) fn lasting(&self, blocks: usize) -> Self {
        let mut setup = self.clone();
        setup.sim.duration_s = (blocks * self.block_len) as f64 * self.sim.sample_period_s;
        setup.sim.mass_2 = MassSchedule::constant(150.0);
        setup
    }
}
