//! A simulated two-joint arm with DC motors under PD control: equations (12) to (23) of the paper.

#[allow(dead_code)]
mod noise;
mod options;
mod schedule;
mod sensors;
mod setpoint;

pub use options::{ARM_JOINTS, ArmParameters, ControllerKind, ControllerOptions, SimError, SimOptions};
pub use schedule::{Interpolation, MassSchedule};
pub use sensors::SensorOptions;
pub use setpoint::{Setpoint, Tone};
