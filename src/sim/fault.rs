//! One fault of a sensor or of its transport: kind, signal, and time.

use super::arm_parameters::ARM_JOINTS;
use super::error::{SimError, finite, in_range};
use crate::messages::{Sample, signals};
use crate::model::MAX_JOINTS;

/// Kinds of faults.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum FaultKind {
    /// No data. A whole sample is lost; a signal loses its bit in the mask and reads 0; a single
    /// joint reads NaN.
    Off,
    /// Keeps the value that it had when the fault began.
    Stuck,
    /// Random values: NaN, infinities, and finite ones of any magnitude. A whole sample also has a
    /// random joint count and mask.
    Garbage,
    /// gain · x + offset; time is scaled from the fault's beginning.
    Wrong {
        /// Factor.
        gain: f64,
        /// Addend, in the signal's unit.
        offset: f64,
    },
    /// A new value only once per period; whole samples come only once per period.
    Slow {
        /// Period \[s\].
        period_s: f64,
    },
    /// The value of some time ago; whole samples arrive late, and all delayed ones at once when the
    /// fault ends.
    Delayed {
        /// Delay \[s\], above 0 to 10.
        delay_s: f64,
    },
    /// Off in random periods.
    Intermittent {
        /// Share of periods without data, 0 to 1.
        share: f64,
        /// Length of a period \[s\].
        period_s: f64,
    },
}

/// The signal of a fault.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum FaultSignal {
    /// The whole sample.
    Sample,
    /// Its time stamp.
    Time,
    /// Positions.
    Q,
    /// Velocities.
    Dq,
    /// Accelerations.
    Ddq,
    /// Jerks.
    Dddq,
    /// Setpoints.
    Setpoint,
    /// Inputs.
    Input,
}

impl FaultSignal {
    /// All of them with their names in configuration files.
    pub const NAMES: [(Self, &'static str); 8] = [
        (Self::Sample, "sample"),
        (Self::Time, "time"),
        (Self::Q, "q"),
        (Self::Dq, "dq"),
        (Self::Ddq, "ddq"),
        (Self::Dddq, "dddq"),
        (Self::Setpoint, "setpoint"),
        (Self::Input, "input"),
    ];

    /// Its bit in a sample's mask, 0 if it has none.
    pub fn bit(self) -> u32 {
        match self {
            Self::Sample | Self::Time => 0,
            Self::Q => signals::Q,
            Self::Dq => signals::DQ,
            Self::Ddq => signals::DDQ,
            Self::Dddq => signals::DDDQ,
            Self::Setpoint => signals::SETPOINT,
            Self::Input => signals::INPUT,
        }
    }

    /// Its values at the joints of a sample, if it has any.
    pub(super) fn of(self, sample: &mut Sample) -> Option<&mut [f64]> {
        // Garbage is drawn for at least two joints, so that an axis keeps its random numbers.
        let joints = (sample.joints as usize).clamp(ARM_JOINTS, MAX_JOINTS);
        let array = match self {
            Self::Sample | Self::Time => return None,
            Self::Q => &mut sample.q,
            Self::Dq => &mut sample.dq,
            Self::Ddq => &mut sample.ddq,
            Self::Dddq => &mut sample.dddq,
            Self::Setpoint => &mut sample.setpoint,
            Self::Input => &mut sample.input,
        };
        Some(&mut array[..joints])
    }

    /// The signals that a whole sample consists of.
    pub(super) const PARTS: [Self; 6] = [Self::Q, Self::Dq, Self::Ddq, Self::Dddq, Self::Setpoint, Self::Input];
}

/// One fault of a schedule.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Fault {
    /// Its kind.
    pub kind: FaultKind,
    /// Its signal.
    pub signal: FaultSignal,
    /// Its joint, counted from 0; `None` for all. Only for signals of joints.
    pub joint: Option<usize>,
    /// First instant \[s\], ≥ 0.
    pub from_s: f64,
    /// First instant without the fault \[s\], above `from_s`; `inf` for never.
    pub to_s: f64,
}

impl Fault {
    /// Checks every value against its domain; `joints` is the machine's number of joints.
    ///
    /// # Errors
    /// The first value out of range, with its name.
    pub fn validate(&self, joints: usize) -> Result<(), SimError> {
        in_range("faults.from_s", self.from_s, 0.0, 1e9)?;
        if !(self.to_s > self.from_s) {
            return Err(SimError::new("faults.to_s", "a time after from_s", self.to_s));
        }
        let of_joint = self.signal.bit() != 0;
        if let Some(joint) = self.joint
            && (!of_joint || joint >= joints)
        {
            let expected = if of_joint {
                "a joint of the machine, counted from 1, or 0 for all"
            } else {
                "0 for a sample or its time"
            };
            return Err(SimError::new("faults.joint", expected, joint + 1));
        }
        match (self.signal, self.kind) {
            (FaultSignal::Time, FaultKind::Stuck | FaultKind::Wrong { .. }) => {}
            (FaultSignal::Time, _) => {
                return Err(SimError::new(
                    "faults.kind",
                    "stuck or wrong for the signal time",
                    "another",
                ));
            }
            (FaultSignal::Sample, FaultKind::Wrong { .. }) => {
                return Err(SimError::new(
                    "faults.signal",
                    "a single signal for the kind wrong",
                    "sample",
                ));
            }
            _ => {}
        }
        match self.kind {
            FaultKind::Off | FaultKind::Stuck | FaultKind::Garbage => Ok(()),
            FaultKind::Wrong { gain, offset } => {
                finite("faults.gain", gain)?;
                finite("faults.offset", offset)
            }
            FaultKind::Slow { period_s } => in_range("faults.period_s", period_s, 0.0, 1e9),
            FaultKind::Delayed { delay_s } => in_range("faults.delay_s", delay_s, 1e-9, 10.0),
            FaultKind::Intermittent { share, period_s } => {
                in_range("faults.share", share, 0.0, 1.0)?;
                in_range("faults.period_s", period_s, 0.0, 1e9)
            }
        }
    }
}
