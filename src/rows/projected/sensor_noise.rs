//! Noise and resolution of the sensors of each joint: σ² = σ_white² + LSB²/12.

use crate::model::MAX_JOINTS;

/// Noise and resolution of the sensors, from which the weights of the rows follow.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SensorNoise {
    /// Size of one count of each joint's encoder \[rad or m\], ≥ 0; 0 if the position is not
    /// quantised.
    pub position_resolution: [f64; MAX_JOINTS],
    /// Standard deviation of white noise on each measured position \[rad or m\], ≥ 0.
    pub position_noise: [f64; MAX_JOINTS],
    /// Standard deviation of white noise on each measured input, in the input's unit, ≥ 0.
    pub input_noise: [f64; MAX_JOINTS],
    /// Size of one count of each measured input, in the input's unit, ≥ 0; 0 if the input is not
    /// rounded.
    pub input_resolution: [f64; MAX_JOINTS],
}

impl SensorNoise {
    /// Exact signals.
    pub const NONE: Self = Self {
        position_resolution: [0.0; MAX_JOINTS],
        position_noise: [0.0; MAX_JOINTS],
        input_noise: [0.0; MAX_JOINTS],
        input_resolution: [0.0; MAX_JOINTS],
    };

    /// The same encoder of `bits` (2^bits counts per turn) and the same input noise on every joint.
    pub fn encoder(bits: u32, input_noise: f64) -> Self {
        Self {
            position_resolution: [std::f64::consts::TAU / f64::from(bits).exp2(); MAX_JOINTS],
            position_noise: [0.0; MAX_JOINTS],
            input_noise: [input_noise; MAX_JOINTS],
            ..Self::NONE
        }
    }

    /// Standard deviations of a joint's position and input, if their rounding is white.
    pub(in crate::rows) fn deviations(&self, joint: usize) -> [f64; 2] {
        let with = |noise: f64, count: f64| noise.hypot(count / 12f64.sqrt());
        [
            with(self.position_noise[joint], self.position_resolution[joint]),
            with(self.input_noise[joint], self.input_resolution[joint]),
        ]
    }
}
