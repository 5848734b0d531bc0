//! Simulated machines: a two-joint arm with DC motors under PD control, equations (12) to (23) of
//! the paper, a servo axis with friction, and any plant from its own equations.
//!
//! [`SimOptions`] specify the simulation, [`MachineSimulator`] produces the samples. The parts can
//! be used separately: [`Motor`], [`ArmDynamics`], [`rk4_step`].

mod arm;
mod arm_parameters;
mod controller;
mod desired_motion;
mod error;
mod fault;
mod faults;
mod instants;
mod integrator;
mod motor;
mod moves;
mod noise;
mod options;
mod plant_simulator;
mod resonance;
mod schedule;
mod sensors;
mod servo_axis;
mod servo_axis_options;
mod setpoint;
mod simulator;
mod unmodelled;

pub use arm::ArmDynamics;
pub use arm_parameters::{ARM_JOINTS, ArmParameters};
pub use controller::{Commanded, ControllerKind, ControllerOptions, PositionFeedback};
pub use desired_motion::DesiredMotion;
pub use error::SimError;
pub use fault::{Fault, FaultKind, FaultSignal};
pub use faults::Faults;
pub use instants::SampleInstants;
pub use integrator::rk4_step;
pub use motor::Motor;
pub use moves::{MoveProfile, Moves};
pub use options::{Machine, PlantMachine, SimOptions};
pub use plant_simulator::PlantSimulator;
pub use schedule::{Interpolation, MassSchedule};
pub use sensors::{Losses, SensorOptions};
pub use servo_axis::ServoAxisSimulator;
pub use servo_axis_options::ServoAxisOptions;
pub use setpoint::{Setpoint, SetpointPath, Tone};
pub use simulator::{ArmSimulator, MachineSimulator};
pub use unmodelled::Unmodelled;
