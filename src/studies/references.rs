//! Setpoints for studies: kinds of references by name, each drawn from a seed.

use crate::sim::{Setpoint, SimOptions};

/// Kinds of reference, |q₁| ≤ 1 rad and |q₂| ≤ 0.8 rad.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Reference {
    /// Random levels, each for 1 to 3 s.
    Steps,
    /// Six sines between 0.23 and 5.3 Hz.
    Sines,
    /// A square wave per joint; the seed varies amplitude, period and phase.
    Square,
}

impl Reference {
    /// Every kind.
    pub const ALL: [Self; 3] = [Self::Steps, Self::Sines, Self::Square];

    /// Name for tables.
    pub fn name(self) -> &'static str {
        match self {
            Self::Steps => "steps",
            Self::Sines => "sines",
            Self::Square => "square",
        }
    }

    /// `base` with this reference and seed.
    pub fn apply(self, base: &SimOptions, seed: u64) -> SimOptions {
        // Low-discrepancy numbers in [0, 1): the seeds of a study cover the range evenly.
        let spread = |step: f64| (0.5 + (seed + 1) as f64 * step).fract();
        let setpoint = [(1.0, 0.618_034), (0.8, 0.754_878)].map(|(reach, step)| match self {
            Self::Steps => Setpoint::Random {
                min_rad: -reach,
                max_rad: reach,
                min_dwell_s: 1.0,
                max_dwell_s: 3.0,
            },
            Self::Sines => Setpoint::RandomSines {
                count: 6,
                min_frequency_hz: 0.23,
                max_frequency_hz: 5.3,
                amplitude_rad: reach,
            },
            Self::Square => Setpoint::Square {
                amplitude_rad: reach * (0.6 + 0.4 * spread(step)),
                offset_rad: 0.0,
                period_s: 1.2 + 1.8 * spread(step * step),
                shift_s: spread(1.0 - step),
            },
        });
        SimOptions {
            seed,
            setpoint,
            ..base.clone()
        }
    }
}
