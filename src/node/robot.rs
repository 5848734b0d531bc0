//! The learner of a robot: drives → torque, velocity → rows → information → estimate.
//!
//! Windows extend over the border of a block; data within half a window of the end are used with
//! the next block. Tunables and another N are refused.

use super::command::Change;
use super::identifier::IdentifierNode;
use super::learner::{BlockEnd, Learner, Learnt};
use super::robot_evidence;
pub use super::robot_evidence::RobotEvidence;
use super::rowless::Spacing;
use crate::estimator::{EstimatorOptions, EstimatorState, Report, StateError};
use crate::messages::{Estimate, MAX_DERIVED, Sample, Status, estimate_flags};
use crate::model::MAX_PARAMS;
use crate::robot::{BodyParameters, ChangeCause, Drives, PAYLOAD_VALUES, RobotIdentifier, RobotSample, Velocities};
use std::any::Any;

/// The identifier of a robot as a value.
pub type RobotNode = IdentifierNode<RobotLearner>;

/// Learner of a robot.
pub struct RobotLearner {
    drives: Drives,
    robot: RobotIdentifier,
    velocities: Option<Velocities>,
    evidence: RobotEvidence,
    spacing: Spacing,
}

impl RobotLearner {
    /// A learner without data. `velocities` is for samples without velocities.
    pub fn new(drives: Drives, robot: RobotIdentifier, velocities: Option<Velocities>) -> Self {
        Self {
            evidence: RobotEvidence::new(&robot),
            spacing: Spacing::new(*robot.windows()),
            drives,
            robot,
            velocities,
        }
    }

    /// The identification, for evidence beyond the message.
    pub fn robot(&self) -> &RobotIdentifier {
        &self.robot
    }

    /// Copies the present estimates to the report outside a block.
    fn note(&mut self) {
        self.evidence.note(&self.robot);
    }
}

impl Learner for RobotLearner {
    fn take(&mut self, sample: &Sample) -> bool {
        let sample = RobotSample {
            t_s: sample.t_ns as f64 * 1e-9,
            q: sample.q,
            dq: sample.dq,
            tau: self.drives.torques(&sample.input),
        };
        self.spacing.note(sample.t_s);
        match &mut self.velocities {
            None => self.robot.take(&sample).is_ok(),
            Some(velocities) => velocities
                .push(&sample)
                .is_none_or(|middle| self.robot.take(&middle).is_ok()),
        }
    }

    fn drop_block(&mut self) {
        self.robot.discard_block();
    }

    fn restart_rows(&mut self) {
        self.robot.discard_block();
        self.robot.restart_windows();
        if let Some(velocities) = &mut self.velocities {
            velocities.restart();
        }
    }

    fn learn(&mut self, end: &BlockEnd) -> Learnt {
        let learnt = self.robot.close_block();
        let knows_nothing = !learnt && self.robot.blocks() == 0;
        let no_rows = knows_nothing.then(|| self.spacing.reason(end.last_seq)).flatten();
        self.spacing.next_block();
        let change = self.robot.change().filter(|_| learnt);
        let mut estimate = self.evidence.judge(&self.robot, learnt, end.lost);
        let explained = change.filter(|change| change.cause != ChangeCause::Unexplained);
        if explained.is_some() {
            estimate.flags |= estimate_flags::CHANGED;
        }
        Learnt {
            estimate,
            change_ns: explained.map(|change| (change.t_s.max(0.0) * 1e9) as u64),
            error: robot_evidence::clipped(&self.robot, end.last_seq)
                .or_else(|| robot_evidence::wrong_velocities(&self.robot, end.last_seq))
                .or_else(|| {
                    let left_out = robot_evidence::left_out(&self.robot, end.last_seq);
                    left_out.filter(|_| !self.robot.is_sign_likelier() && !self.robot.is_gain_likelier())
                })
                .or_else(|| robot_evidence::doubt(&self.robot, end.last_seq))
                .or_else(|| robot_evidence::impossible(&self.robot, end.last_seq))
                .or_else(|| robot_evidence::unexplained(&self.robot, end.last_seq))
                .or_else(|| robot_evidence::wrong_gain(&self.robot, end.last_seq))
                .or_else(|| robot_evidence::contradiction(&self.robot, end.last_seq))
                .or_else(|| robot_evidence::words(&change?, end.last_seq))
                .or(no_rows),
        }
    }

    /// The payload in the form that robot controllers use: zeros if nothing is carried, `NaN` while
    /// unknown.
    fn derive(&self, estimate: &mut Estimate) {
        if !self.robot.estimates_payload() {
            return;
        }
        let count = PAYLOAD_VALUES.len().min(MAX_DERIVED);
        estimate.derived_len = count as u32;
        let unknown = if self.robot.is_loaded() { f64::NAN } else { 0.0 };
        estimate.derived[..count].fill(unknown);
        estimate.derived_std[..count].fill(f64::NAN);
        if let Some(carried) = self.robot.carried() {
            estimate.derived[..count].copy_from_slice(&carried.values[..count]);
            estimate.derived_std[..count].copy_from_slice(&carried.std[..count]);
        }
    }

    fn report(&self) -> &Report {
        self.evidence.report()
    }

    /// Writes nothing: a robot's information is kept per joint and has no single condition number.
    fn describe(&self, _: &mut Status) {}

    fn window_s(&self) -> Option<f64> {
        Some(self.robot.window_s())
    }

    fn held_at(&self, index: usize) -> Option<f64> {
        self.robot.is_fixed(index).then(|| self.robot.theta()[index])
    }

    fn fix(&mut self, index: usize, value: Option<f64>) {
        self.robot.fix(index, value);
        self.note();
    }

    fn free(&mut self, index: usize) {
        if self.robot.is_fixed(index) {
            self.robot.free(index);
        }
        self.note();
    }

    fn accepts(&self, change: &Change) -> bool {
        match change {
            Change::Restart { .. } => true,
            Change::Payload { .. } => self.robot.estimates_payload(),
            _ => false,
        }
    }

    fn declare_payload(&mut self, body: Option<&[f64; 10]>) {
        self.robot
            .declare_payload(body.map(|body| BodyParameters(*body)).as_ref());
        self.note();
    }

    fn begin_anew(&mut self, change: &mut Change) -> Result<bool, StateError> {
        let Change::Restart { state } = change else {
            return Ok(false);
        };
        match state {
            Some(state) => self.load(&state.estimator).map(|()| true),
            None => {
                self.robot.reset();
                self.evidence.reset(&self.robot);
                Ok(false)
            }
        }
    }

    fn tune(&mut self, _: &mut EstimatorOptions, _: Option<&mut Box<dyn Any + Send>>) -> bool {
        false
    }

    fn save(&mut self, into: &mut EstimatorState) -> u64 {
        self.robot.save(into);
        self.robot.blocks() as u64
    }

    fn load(&mut self, state: &EstimatorState) -> Result<(), StateError> {
        let loaded = self.robot.load_state(state);
        self.evidence.reset(&self.robot);
        loaded
    }

    /// Parameters of the payload are as in the state: fixed at zero while nothing is carried.
    fn load_kept(&mut self, state: &EstimatorState) -> Result<(), StateError> {
        let arm = self.robot.model().parameters().len();
        let mut held = [None; MAX_PARAMS];
        for (i, held) in held.iter_mut().enumerate().take(arm) {
            *held = self.held_at(i);
        }
        let loaded = self.load(state);
        for (i, held) in held.into_iter().enumerate().take(arm) {
            match held {
                _ if held == self.held_at(i) => {}
                Some(_) => self.fix(i, held),
                None => self.free(i),
            }
        }
        loaded
    }

    fn into_rows(self: Box<Self>) -> Box<dyn Any + Send> {
        Box::new(())
    }
}
