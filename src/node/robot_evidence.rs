//! Converts a robot's figures of a block to the report common to all models, so that states and
//! messages have the same meaning.

use super::estimate_message::message;
use crate::estimator::{Change, ChangeKind, Held, IndexSet, Report, StateMachine};
use crate::messages::{ERROR_TEXT, ErrorCode, Estimate, FixedText, LastError};
use crate::robot::{ChangeCause, Impossible, LEAST_EXPLAINED, RobotChange, RobotIdentifier};
use std::fmt::{self, Write as _};

/// Share of the prior variance below which a parameter is known from data.
const INFORMED: f64 = 1.0 / 9.0;
/// Three standard deviations, relative to a parameter, below which it is usable.
const USABLE: f64 = 0.05;
/// Share of the variance that a block must remove from a parameter known to within its size to have
/// informed on it.
const EXCITED: f64 = 0.9;

/// Evidence about a robot's estimates after each block, on line and off line.
pub struct RobotEvidence {
    judge: StateMachine,
    report: Report,
    changed_before: bool,
}

impl RobotEvidence {
    /// For an identifier without data.
    pub fn new(robot: &RobotIdentifier) -> Self {
        let (parameters, joints) = (robot.theta().len(), robot.model().robot().len());
        let mut evidence = Self {
            judge: StateMachine::new(robot.theta()).explaining(LEAST_EXPLAINED),
            report: empty(parameters, joints),
            changed_before: false,
        };
        evidence.note(robot);
        evidence
    }

    /// The figures of the last block.
    pub fn report(&self) -> &Report {
        &self.report
    }

    /// Copies the present estimates to the report outside a block.
    pub(super) fn note(&mut self, robot: &RobotIdentifier) {
        fill(&mut self.report, robot, false, false);
    }

    /// Call this if the identifier restarts or continues from a state.
    pub(super) fn reset(&mut self, robot: &RobotIdentifier) {
        self.judge.reset(robot.theta());
        self.note(robot);
    }

    /// Judges a block: its estimate with state and evidence. `learnt` is the result of closing it,
    /// `lost` the share of its samples that are missing, 0 to 1.
    pub fn judge(&mut self, robot: &RobotIdentifier, learnt: bool, lost: f64) -> Estimate {
        fill(&mut self.report, robot, learnt, self.changed_before);
        self.changed_before = learnt && robot.change().is_some();
        message(&self.report, self.judge.step(&self.report, lost))
    }
}

/// An empty report for these numbers of parameters and joints.
fn empty(parameters: usize, joints: usize) -> Report {
    let (theta, joint) = (vec![0.0; parameters], vec![0.0; joints]);
    Report {
        theta_std: theta.clone(),
        excitation: theta.clone(),
        theta,
        innovation_rms: joint.clone(),
        residual_rms: joint.clone(),
        noise_std: joint.clone(),
        signal_rms: joint.clone(),
        fit: joint.clone(),
        explained: joint,
        fit_probability: 1.0,
        ..Report::default()
    }
}

/// Fills the report after a block. `changed_before`: there was a change in the block before.
fn fill(report: &mut Report, robot: &RobotIdentifier, learnt: bool, changed_before: bool) {
    report.theta.copy_from_slice(robot.theta());
    report.held = (!learnt).then_some(Held::Empty);
    let change = robot.change().filter(|_| learnt);
    let unexplained = change.is_some_and(|change| change.cause == ChangeCause::Unexplained);
    // if a friction term is missing, motion looks like a change
    let left_out = robot.left_out_cause().is_some();
    report.change = change.filter(|_| !unexplained && !left_out).map(|change| Change {
        kind: ChangeKind::Within,
        row: 0,
        time: (change.t_s.max(0.0) * 1e9) as u64,
        is_late: false,
    });
    let figures = robot.figures();
    let joints = report.fit.len();
    report.innovation_rms.copy_from_slice(&figures.innovation_rms[..joints]);
    report.residual_rms.copy_from_slice(&figures.residual_rms[..joints]);
    report.signal_rms.copy_from_slice(&figures.signal_rms[..joints]);
    report.explained.copy_from_slice(&figures.explained[..joints]);
    report.fit.copy_from_slice(&figures.fit[..joints]);
    report.fit_probability = figures.fit_probability;
    report.excitation.copy_from_slice(&figures.excitation);
    let unfit = unexplained || figures.fit_probability < crate::estimator::MISFIT;
    let refuted = robot.clipped().is_some()
        || robot.wrong_velocities().is_some()
        || robot.impossible().is_some()
        || robot.unexplained().is_some()
        || robot.wrong_gain().is_some()
        || robot.contradiction().is_some();
    let fits = !(unfit || left_out || refuted || robot.doubt().is_some());
    report.misfit = if fits { IndexSet::EMPTY } else { (0..joints).collect() };
    for j in 0..joints {
        // The misfit of friction is correlated, so the error of whole blocks is larger than that of
        // rows.
        report.noise_std[j] = robot.torque_std(j) * robot.inflation(j);
    }
    report.rows = figures.rows[..joints].iter().copied().max().unwrap_or(0);
    report.blocks = robot.blocks() as u64;
    (report.iterations, report.converged, report.outliers) = (1, true, 0);
    let quiet = learnt && fits && report.change.is_none() && !changed_before;
    fill_parameters(report, robot, learnt, quiet);
}

/// Fills in the standard deviations, which parameters are fixed, excited and usable, and the rank.
/// A parameter is usable only in a `quiet` block.
fn fill_parameters(report: &mut Report, robot: &RobotIdentifier, learnt: bool, quiet: bool) {
    (report.excited, report.usable, report.fixed) = Default::default();
    let (mut rank, mut free) = (0, 0);
    for i in 0..robot.theta().len() {
        report.theta_std[i] = robot.theta_std(i);
        if robot.is_fixed(i) {
            report.theta_std[i] = 0.0;
            report.fixed.insert(i);
            continue;
        }
        free += 1;
        let std = report.theta_std[i];
        let informed = std * std <= INFORMED * robot.prior_std(i).powi(2);
        rank += usize::from(informed);
        if learnt && report.excitation[i] >= EXCITED {
            report.excited.insert(i);
        }
        let is_possible = robot.parameters()[i].range.holds(report.theta[i]);
        if quiet && informed && is_possible && 3.0 * std < USABLE * report.theta[i].abs() {
            report.usable.insert(i);
        }
    }
    report.rank = rank;
    report.informed = 2 * rank > free && free > 0;
    let joints = 0..report.fit.len();
    report.uninformed = if report.informed {
        IndexSet::EMPTY
    } else {
        joints.collect()
    };
}

/// A misfit in words.
fn misfit(what: fmt::Arguments<'_>, seq: u64) -> LastError {
    let mut words = FixedText::<ERROR_TEXT>::default();
    // an error only means that the text was truncated
    let _cut = words.write_fmt(what);
    LastError::with_text(ErrorCode::Misfit, seq, words.as_str())
}

/// An impossible estimate, in words.
pub(super) fn impossible(robot: &RobotIdentifier, seq: u64) -> Option<LastError> {
    Some(match robot.impossible()? {
        Impossible::Inertia(joint) => misfit(
            format_args!(
                "inertia at joint {} is negative: its torque, position or axis has the wrong sign",
                joint + 1
            ),
            seq,
        ),
        Impossible::Parameter(index) => misfit(
            format_args!(
                "{} is negative: a torque or position has the wrong sign, or a change was no payload",
                robot.parameters()[index].name
            ),
            seq,
        ),
    })
}

/// A joint whose torque the model hardly explains, in words.
pub(super) fn unexplained(robot: &RobotIdentifier, seq: u64) -> Option<LastError> {
    let (joint, share) = robot.unexplained()?;
    Some(misfit(
        format_args!(
            "{:.0} % of joint {}'s torque is explained: a sign, unit or column of it, or an axis or frame up to it, is wrong",
            100.0 * share.max(0.0),
            joint + 1
        ),
        seq,
    ))
}

/// A joint whose torque contradicts those of the others, in words.
pub(super) fn wrong_gain(robot: &RobotIdentifier, seq: u64) -> Option<LastError> {
    Some(misfit(format_args!("{}", robot.wrong_gain()?), seq))
}

/// A gravity or a zero that contradicts the URDF, in words.
pub(super) fn contradiction(robot: &RobotIdentifier, seq: u64) -> Option<LastError> {
    Some(misfit(format_args!("{}", robot.contradiction()?), seq))
}

/// Velocities that are not the rate of change of the positions, in words.
pub(super) fn wrong_velocities(robot: &RobotIdentifier, seq: u64) -> Option<LastError> {
    Some(misfit(format_args!("{}", robot.wrong_velocities()?), seq))
}

/// A clipped torque, in words.
pub(super) fn clipped(robot: &RobotIdentifier, seq: u64) -> Option<LastError> {
    let (joint, limit) = robot.clipped()?;
    Some(misfit(
        format_args!(
            "torque of joint {} stops at {limit:.4}: its signal is clipped, or its drive at its limit; use slower motion",
            joint + 1
        ),
        seq,
    ))
}

/// A term missing in the model, or reversals that take far longer, in words.
pub(super) fn left_out(robot: &RobotIdentifier, seq: u64) -> Option<LastError> {
    let found = robot.left_out_cause()?;
    Some(match robot.other_travel(&found) {
        Some(travel) => misfit(format_args!("{travel}"), seq),
        None => misfit(format_args!("{found}"), seq),
    })
}

/// A drive or an encoder that has changed, or might have, in words.
pub(super) fn doubt(robot: &RobotIdentifier, seq: u64) -> Option<LastError> {
    Some(misfit(format_args!("{}", robot.doubt()?), seq))
}

/// A change other than of the payload, in words.
pub(super) fn words(change: &RobotChange, seq: u64) -> Option<LastError> {
    match change.cause {
        ChangeCause::Payload => None,
        ChangeCause::Friction => Some(LastError::with_text(
            ErrorCode::Misfit,
            seq,
            "friction has changed, and no payload explains it",
        )),
        ChangeCause::Unexplained => Some(LastError::with_text(
            ErrorCode::Misfit,
            seq,
            "neither payload nor friction explains the torques: a force from outside, or another robot; not learnt",
        )),
    }
}
