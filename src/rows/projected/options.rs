//! Options of projected rows, and their errors.

use super::sensor_noise::SensorNoise;
use crate::rows::kernel::InputTiming;
use crate::rows::suspect::Considered;

/// How samples become projected rows.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ProjectedOptions {
    /// h \[s\], 1e-6 to 1.
    pub sample_period_s: f64,
    /// T \[s\], 8 to 2000 sample periods; rounded to an even number of them. Long windows average
    /// more noise, short ones resolve faster motion: about 1.3 periods of the fastest relevant mode
    /// is a good length.
    pub window_s: f64,
    /// Time from one window to the next \[s\], one sample period to T; rounded to whole periods.
    /// T/5 loses little, see docs/method.md.
    pub stride_s: f64,
    /// Samples on either side that the velocity filter (order 5) uses, 3 to 100. 10 for encoders of
    /// 16 bits, 5 from 20 bits on.
    pub velocity_half_width: usize,
    /// Behaviour of the input between samples.
    pub timing: InputTiming,
    /// The recorded input acts on the plant this much later \[s\], at most half of T either way;
    /// negative for an input that was recorded late.
    pub input_delay_s: f64,
    /// Noise of the sensors.
    pub noise: SensorNoise,
    /// If true, the noise levels are learnt from the signals block by block (`noise.rs`), and
    /// `noise` is not used.
    pub learn_noise: bool,
    /// Errors that the model lacks and σ must allow for.
    pub considered: Considered,
}

impl ProjectedOptions {
    /// Windows of 100 ms every 20 ms at 1 kHz: suitable for modes up to about 15 Hz, 16-bit
    /// encoders and input noise of 0.05.
    pub fn recommended() -> Self {
        Self {
            sample_period_s: 1e-3,
            window_s: 0.1,
            stride_s: 0.02,
            velocity_half_width: 8,
            timing: InputTiming::Held,
            input_delay_s: 0.0,
            noise: SensorNoise::encoder(16, 0.05),
            learn_noise: false,
            considered: Considered::default(),
        }
    }

    /// Samples on either side of the middle of a window.
    pub(super) fn half(&self) -> usize {
        (0.5 * self.window_s / self.sample_period_s).round() as usize
    }

    /// Samples from one window to the next, as requested.
    pub(super) fn stride(&self) -> usize {
        (self.stride_s / self.sample_period_s).round() as usize
    }

    /// Checks every value against its domain.
    ///
    /// # Errors
    /// The first value out of range.
    pub fn validate(&self) -> Result<(), ProjectedError> {
        let check = |field, expected, got: f64, good: bool| {
            if good {
                Ok(())
            } else {
                Err(ProjectedError::Value { field, expected, got })
            }
        };
        let within = |x: f64, low: f64, high: f64| x >= low && x <= high;
        let (h, t) = (self.sample_period_s, self.window_s);
        check("sample_period_s", "1e-6 to 1", h, within(h, 1e-6, 1.0))?;
        check(
            "window_s",
            "8 to 2000 sample periods",
            t,
            within(t / h, 7.999, 2000.001),
        )?;
        check(
            "stride_s",
            "one sample period to window_s",
            self.stride_s,
            within(self.stride_s / h, 0.999, t / h + 0.001),
        )?;
        let half_width = self.velocity_half_width;
        check(
            "velocity_half_width",
            "3 to 100",
            half_width as f64,
            (3..=100).contains(&half_width),
        )?;
        check(
            "input_delay_s",
            "at most half of window_s either way",
            self.input_delay_s,
            within(self.input_delay_s.abs(), 0.0, 0.5 * t),
        )?;
        let all = self
            .noise
            .position_resolution
            .iter()
            .map(|v| ("position_resolution", v))
            .chain(self.noise.position_noise.iter().map(|v| ("position_noise", v)))
            .chain(self.noise.input_noise.iter().map(|v| ("input_noise", v)))
            .chain(self.noise.input_resolution.iter().map(|v| ("input_resolution", v)));
        let considered = self.considered;
        let suspects = [
            (
                "considered.input_delay_s",
                considered.input_delay_std_s(self.sample_period_s),
            ),
            ("considered.gain", considered.gain),
            ("considered.coulomb", considered.coulomb),
            ("considered.stribeck", considered.stribeck),
            ("considered.offset", considered.offset),
            ("considered.dead_band", considered.dead_band),
            ("considered.spring", considered.spring),
            ("considered.gain_by_direction", considered.gain_by_direction),
            ("considered.viscous_by_direction", considered.viscous_by_direction),
            ("considered.load_friction", considered.load_friction),
            ("considered.inertia", considered.inertia),
            ("considered.viscous", considered.viscous),
            ("considered.friction_in_back_emf", considered.friction_in_back_emf),
            ("considered.resonance_hz", considered.resonance_hz),
            ("considered.drift_per_s", considered.drift_per_s),
            ("considered.zero_rad", considered.zero_rad),
            ("considered.eccentricity_rad", considered.eccentricity_rad),
        ];
        let all = all.chain(suspects.iter().map(|(field, value)| (*field, value)));
        for (field, &value) in all {
            check(
                field,
                "a finite number, not negative",
                value,
                value.is_finite() && value >= 0.0,
            )?;
        }
        Ok(())
    }
}

/// Options or a plant that projected rows cannot work with.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum ProjectedError {
    /// An option is out of its range.
    #[error("{field}: expected {expected}, got {got}")]
    Value {
        /// Name of the option.
        field: &'static str,
        /// What was expected.
        expected: &'static str,
        /// Value given.
        got: f64,
    },
    /// A term is differentiated more often than the window permits.
    #[error("equation {equation}: expected terms differentiated at most {expected} times, got {got}")]
    Order {
        /// Name of the equation.
        equation: String,
        /// Highest possible order.
        expected: usize,
        /// Order of the equation.
        got: usize,
    },
    /// The plant's equations, parameters or start values do not fit together.
    #[error("the plant's parameters and equations do not fit together")]
    Plant,
}
