//! Options of the PD controllers (13).

use super::arm_parameters::ARM_JOINTS;
use super::error::{SimError, not_negative, positive};
use crate::model::{JointSample, MAX_JOINTS};

/// When the controller computes its voltage.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum ControllerKind {
    /// Continuously, as in the paper: (13) is part of the differential equation.
    #[default]
    Analog,
    /// Once per sample, held until the next one (zero-order hold).
    Sampled,
}

impl ControllerKind {
    /// All kinds with their names in configuration files.
    pub const NAMES: [(Self, &'static str); 2] = [(Self::Analog, "analog"), (Self::Sampled, "sampled")];
}

/// The position used by the controller.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum PositionFeedback {
    /// The true one.
    #[default]
    True,
    /// The position of the sample, with all sensor errors; for a sampled controller. The velocity
    /// is the true one, as from a tachometer.
    Measured,
}

impl PositionFeedback {
    /// All kinds with their names in configuration files.
    pub const NAMES: [(Self, &'static str); 2] = [(Self::True, "true"), (Self::Measured, "measured")];
}

/// The PD controllers (13), one per joint.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ControllerOptions {
    /// Analog or sampled.
    pub kind: ControllerKind,
    /// The position used by the controllers.
    pub feedback: PositionFeedback,
    /// K_p of each joint \[V/rad\], ≥ 0.
    pub proportional_gain_v_per_rad: [f64; ARM_JOINTS],
    /// K_d of each joint \[V s/rad\], ≥ 0.
    pub derivative_gain_v_s_per_rad: [f64; ARM_JOINTS],
    /// Largest voltage of each drive \[V\], of either sign, > 0; `inf` for no limit.
    pub voltage_limit_v: f64,
}

impl ControllerOptions {
    /// Section 5 of the paper.
    pub const fn cedro2022() -> Self {
        Self {
            kind: ControllerKind::Analog,
            feedback: PositionFeedback::True,
            proportional_gain_v_per_rad: [191.304; ARM_JOINTS],
            derivative_gain_v_s_per_rad: [31.6957; ARM_JOINTS],
            voltage_limit_v: f64::INFINITY,
        }
    }

    /// Checks every value against its domain.
    ///
    /// # Errors
    /// The first value out of range, with its name.
    pub fn validate(&self) -> Result<(), SimError> {
        if self.kind == ControllerKind::Analog && self.feedback == PositionFeedback::Measured {
            let (expected, got) = ("true for an analog controller, which no sample reaches", "measured");
            return Err(SimError::new("controller.feedback", expected, got));
        }
        if self.voltage_limit_v != f64::INFINITY {
            positive("controller.voltage_limit_v", self.voltage_limit_v)?;
        }
        for joint in 0..ARM_JOINTS {
            not_negative(
                "controller.proportional_gain_v_per_rad",
                self.proportional_gain_v_per_rad[joint],
            )?;
            not_negative(
                "controller.derivative_gain_v_s_per_rad",
                self.derivative_gain_v_s_per_rad[joint],
            )?;
        }
        Ok(())
    }
}

/// A simulated machine that accepts feed-forward from an external controller.
pub trait Commanded: Iterator<Item = JointSample> {
    /// Adds this to the output of the machine's own loop, from the next sample on; in the input's
    /// unit, held until the next call.
    fn command(&mut self, feed_forward: &[f64; MAX_JOINTS]);
}

impl<C: Commanded + ?Sized> Commanded for Box<C> {
    fn command(&mut self, feed_forward: &[f64; MAX_JOINTS]) {
        (**self).command(feed_forward);
    }
}
