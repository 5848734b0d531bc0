//! Checks of the signals that need no model: jumps of encoders, and velocities that are not the
//! rate of change of the positions.

use super::doubt::RobotDoubt;
use super::jump::Jumps;
use super::state::RobotSample;
use super::tree::Robot;
use super::velocity_ratio::{VelocityRatios, WrongVelocities};
use crate::estimator::persist::Visit;

/// The checks, sample by sample.
#[derive(Debug, Clone, Default)]
pub(super) struct SignalChecks {
    jumps: Jumps,
    velocities: VelocityRatios,
}

impl SignalChecks {
    /// Forgets everything.
    pub fn reset(&mut self) {
        self.jumps.reset();
        self.velocities = VelocityRatios::default();
    }

    /// The next sample does not follow the last one.
    pub fn restart(&mut self) {
        self.jumps.restart();
        self.velocities.restart();
    }

    /// Adds a sample; true if an encoder has jumped. Steps longer than `max_gap_s` are gaps.
    pub fn take(&mut self, robot: &Robot, sample: &RobotSample, max_gap_s: f64) -> bool {
        self.velocities.take(robot, sample, max_gap_s);
        self.jumps.take(robot, sample)
    }

    /// The encoder that has jumped.
    pub fn jump(&self) -> Option<RobotDoubt> {
        self.jumps.found()
    }

    /// The first joint whose velocities are wrong, or late by more than `considered_s`.
    pub fn wrong_velocities(&self, considered_s: f64) -> Option<WrongVelocities> {
        self.velocities.wrong(considered_s)
    }

    /// State kept in a checkpoint.
    pub fn visit(&mut self, v: &mut impl Visit) {
        self.velocities.0.iter_mut().for_each(|ratio| ratio.visit(v));
    }
}
