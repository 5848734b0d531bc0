//! Simulated machines: a two-joint arm with DC motors under PD control, equations (12) to (23) of the paper, and a servo axis with friction.
//!
//! [`SimOptions`] say what to simulate, [`MachineSimulator`] gives the samples. The parts are usable on their own: [`Motor`], [`ArmDynamics`], [`rk4_step`].

mod arm;
mod faults;
mod instants;
mod integrator;
mod motor;
mod moves;
mod noise;
mod options;
mod resonance;
mod schedule;
mod sensors;
mod servo_axis;
mod setpoint;
mod simulator;
mod stream;
mod unmodelled;

pub use arm::ArmDynamics;
pub use faults::{Fault, FaultKind, FaultSignal, Faults};
pub use instants::SampleInstants;
pub use integrator::rk4_step;
pub use motor::Motor;
pub use moves::{MoveProfile, Moves};
pub use options::{
    ARM_JOINTS, ArmParameters, ControllerKind, ControllerOptions, Machine, PositionFeedback, SimError, SimOptions,
};
pub use schedule::{Interpolation, MassSchedule};
pub use sensors::{Losses, SensorOptions};
pub use servo_axis::{ServoAxisOptions, ServoAxisSimulator};
pub use setpoint::{Setpoint, Tone};
pub use simulator::{ArmSimulator, MachineSimulator};
pub use stream::sample_stream;
pub use unmodelled::Unmodelled;
