//! Tests whether the estimates, though they fit, are of another machine than the model's.

use super::allowances::Allowances;
use super::drive_gain_room::{DriveGains, WrongGain};
use super::impossible_room::{Impossible, Impossibles};
use super::learning::{Arm, Beyond, Learner};
use super::regressor::EnergyRegressors;
use super::urdf_prior::{UrdfContradiction, UrdfPrior};
use crate::estimator::persist::Visit;

/// The tests, block by block.
#[derive(Debug, Clone)]
pub(super) struct ModelChecks {
    urdf_prior: UrdfPrior,
    gains: DriveGains,
    impossibles: Impossibles,
}

impl ModelChecks {
    /// For an arm; its offsets are constant if `is_drifting` is false.
    pub fn new(arm: &Arm, beyond: &Beyond, is_drifting: bool) -> Self {
        let columns = (0..arm.joints()).map(|joint| arm.wide.columns(joint).len()).max();
        let drift = (is_drifting, beyond.acting);
        Self {
            urdf_prior: UrdfPrior::new(&arm.model),
            gains: DriveGains::new(&arm.model, &arm.wide, beyond.drifts.clone(), drift),
            impossibles: Impossibles::new(columns.unwrap_or(0)),
        }
    }

    /// Forgets everything.
    pub fn reset(&mut self) {
        self.impossibles.clear();
        self.gains.reset();
        self.urdf_prior.found = None;
    }

    /// Forgets the rows of the test of the gains, because the payload changes.
    pub fn forget_gains(&mut self) {
        self.gains.clear();
    }

    /// Tests the moments against the URDF and, if `tests_gains`, the joints against each other.
    pub fn look_at_misfit(&mut self, learner: &Learner, allowances: &Allowances, tests_gains: bool) {
        self.urdf_prior.look_at_block(learner, allowances);
        if tests_gains {
            self.gains.look_at_block(learner);
        }
    }

    /// Tests the signs; `newest` are the regressors at the newest sample.
    pub fn look_at_signs(&mut self, learner: &Learner, allowances: &Allowances, newest: &EnergyRegressors) {
        self.impossibles.look_at_block(learner, allowances, newest);
    }

    /// See [`RobotIdentifier::contradiction`](super::RobotIdentifier::contradiction).
    pub fn contradiction(&self) -> Option<UrdfContradiction> {
        self.urdf_prior.found
    }

    /// See [`RobotIdentifier::wrong_gain`](super::RobotIdentifier::wrong_gain).
    pub fn wrong_gain(&self) -> Option<WrongGain> {
        self.gains.found
    }

    /// See [`RobotIdentifier::impossible`](super::RobotIdentifier::impossible).
    pub fn impossible(&self) -> Option<Impossible> {
        self.impossibles.first()
    }

    /// State kept in a checkpoint.
    pub fn visit(&mut self, v: &mut impl Visit) {
        self.gains.visit(v);
    }
}
