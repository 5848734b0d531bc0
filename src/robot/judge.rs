//! Finds probable mistakes in a robot's log as configured, and in its identification.
//!
//! ```text
//! P_j = Σ f_j q̇_j ≥ 0 for every machine, f_j: friction torque of joint j without its offset        (1)
//! ```
//!
//! Nothing here changes a number or refuses a log: suspicions are only reported, and the user, who
//! knows the robot, decides. Hardly any robot exceeds the limits below.

use super::clipped::Largest;
use super::echo::Echo;
use super::fit::{MOVING, correlation_time_s};
use super::friction::FrictionTerm;
use super::identify::RobotIdentifier;
use super::impossible_room::Impossible;
use super::model::RobotModel;
use super::state::{FilteredSample, RobotSample};
use super::suspicion::RobotSuspicion;
use super::tree::RobotJoint;
use super::velocity_ratio::{PIECES, VelocityRatio, WrongVelocities, wraps};
use crate::model::MAX_JOINTS;
use std::f64::consts::PI;

/// Turning joints without limits seldom turn further \[rad\].
const FARTHEST_RAD: f64 = 4.0 * PI;
/// Turning joints seldom turn as fast on average \[rad/s\].
const FASTEST_RAD_PER_S: f64 = 4.0 * PI;
/// Share of its range by which a joint may exceed a limit without suspicion.
const BEYOND: f64 = 0.5;
/// Samples are seldom further apart \[s\].
const LONGEST_STEP_S: f64 = 0.5;
/// Standard deviations beyond which a wrong sign is reported.
const SURE: f64 = 5.0;
/// Residual above which a joint is suspicious \[%\]; the last joint of a real robot has 40 to 56 %.
const LARGEST_RESIDUAL: f64 = 70.0;
/// A misfit with a correlation time below this share of a window is noise, or nearly so.
const WHITE: f64 = 0.2;
/// Friction below this share of the torque is ignored.
const LEAST_FRICTION: f64 = 0.01;
/// Number of samples in the sums.
const ENOUGH: usize = 2000;

/// Suspicions about the samples of a log; steps longer than `max_gap_s` are gaps.
pub fn judge_robot_log(model: &RobotModel, log: &[RobotSample], max_gap_s: f64) -> Vec<RobotSuspicion> {
    let mut found = Vec::new();
    if log.len() < 3 {
        return found;
    }
    let mut steps: Vec<f64> = log.windows(2).map(|pair| pair[1].t_s - pair[0].t_s).collect();
    let (_, step_s, _) = steps.select_nth_unstable_by(log.len() / 2 - 1, f64::total_cmp);
    // Round off the rounding errors of a difference of stamps.
    let step_s = format!("{step_s:.4e}").parse().unwrap_or(*step_s);
    if step_s > LONGEST_STEP_S {
        found.push(RobotSuspicion::Time { step_s });
    }
    let mut moving = Vec::new();
    for (joint, own) in model.robot().joints.iter().enumerate() {
        let turns = own.turns;
        found.extend(judge_positions(own, joint, log));
        let wraps = turns && log.windows(2).any(|pair| wraps(pair[0].q[joint], pair[1].q[joint]));
        if wraps {
            found.push(RobotSuspicion::Wraps { joint });
        }
        let mut rate = VelocityRatio::default();
        for sample in log {
            rate.take((sample.t_s, sample.q[joint], sample.dq[joint]), max_gap_s, turns);
        }
        let factor = rate.wrong().filter(|_| !wraps);
        if let Some(factor) = factor {
            found.push(RobotSuspicion::Rate { joint, turns, factor });
        }
        let value = log[0].q[joint];
        if rate.fast >= PIECES && log.iter().all(|sample| sample.q[joint] == value) {
            let signal = "position";
            found.push(RobotSuspicion::Constant { joint, signal, value });
        }
        let value = log[0].tau[joint];
        if rate.count >= PIECES && log.iter().all(|sample| sample.tau[joint] == value) {
            let signal = "torque";
            found.push(RobotSuspicion::Constant { joint, signal, value });
        }
        if rate.count >= PIECES {
            moving.push(joint);
        }
        found.extend(clipped(joint, model.friction()[joint].rest_speed, log));
        let square: f64 = log.iter().map(|sample| sample.dq[joint].powi(2)).sum();
        let rms = (square / log.len() as f64).sqrt();
        let limit = own.limits.velocity.filter(|limit| *limit > 0.0);
        let largest = limit.unwrap_or(if turns { FASTEST_RAD_PER_S } else { f64::INFINITY });
        if rms > largest && factor.is_none() {
            found.push(RobotSuspicion::Speed {
                joint,
                turns,
                rms,
                limit,
            });
        }
    }
    found.extend(Echo::of(log, &moving, max_gap_s).map(RobotSuspicion::Echo));
    found
}

/// A torque that is clipped while its joint moves; one that never changes is a different mistake.
fn clipped(joint: usize, rest_speed: f64, log: &[RobotSample]) -> Option<RobotSuspicion> {
    let mut largest = Largest::default();
    let moving = log.iter().filter(|sample| sample.dq[joint].abs() > rest_speed);
    moving.for_each(|sample| largest.take(sample.tau[joint]));
    let (value, share) = largest.clipped()?;
    let percent = 100.0 * share;
    Some(RobotSuspicion::Clipped { joint, value, percent })
}

/// Suspicions about an identification, from the filtered samples of its log.
pub fn judge_robot_fit(identifier: &RobotIdentifier, states: &[FilteredSample]) -> Vec<RobotSuspicion> {
    let model = identifier.model();
    let motion = Motion::of(identifier, states);
    let mut found = Vec::new();
    for (joint, friction) in model.friction().iter().enumerate() {
        let negative: Vec<(String, f64, f64)> = friction
            .terms
            .iter()
            .zip(model.friction_of(joint))
            .filter(|(term, _)| matches!(term, FrictionTerm::Viscous | FrictionTerm::Coulomb))
            .map(|(_, i)| (i, identifier.theta()[i], identifier.own_std(i)))
            .filter(|(_, estimate, std)| *estimate < -SURE * std)
            .map(|(i, estimate, std)| (model.parameters()[i].name.clone(), estimate, std))
            .collect();
        // One of several terms may be negative although their sum brakes.
        if !negative.is_empty() && motion.friction_drives(joint) {
            let parameters = negative;
            found.push(RobotSuspicion::Sign { joint, parameters });
        }
    }
    match identifier.impossible() {
        Some(Impossible::Inertia(joint)) if identifier.is_sign_likelier() => {
            found.push(RobotSuspicion::NegativeInertia { joint });
        }
        _ if identifier.is_gain_likelier() => {}
        _ => found.extend(identifier.left_out_cause().map(|cause| {
            let travel = identifier.other_travel(&cause).map(RobotSuspicion::Travel);
            travel.unwrap_or(RobotSuspicion::LeftOut(cause))
        })),
    }
    // a wrong ratio is a suspicion about the log
    let late = identifier
        .wrong_velocities()
        .filter(|what| matches!(what, WrongVelocities::Late { .. }));
    found.extend(late.map(RobotSuspicion::Late));
    found.extend(identifier.doubt().map(RobotSuspicion::Changed));
    found.extend(identifier.wrong_gain().map(RobotSuspicion::Gain));
    // if the model does not explain the torques, its moments do not identify the cause
    let contradiction = identifier
        .contradiction()
        .filter(|_| identifier.unexplained().is_none());
    found.extend(contradiction.map(RobotSuspicion::Contradiction));
    for joint in 0..model.robot().len() {
        let percent = motion.residual(joint).unwrap_or(0.0);
        let share = identifier.figures().explained[joint];
        if identifier.recent_rows.lacking[joint] {
            let explained = 100.0 * share.max(0.0);
            found.push(RobotSuspicion::Unexplained { joint, explained });
        } else if percent > LARGEST_RESIDUAL {
            let forgotten_s = correlation_time_s(model, identifier.theta(), states, joint);
            let is_noise = forgotten_s.is_some_and(|time_s| time_s < WHITE * identifier.window_s());
            found.push(match is_noise {
                true => RobotSuspicion::Noise { joint, percent },
                false => RobotSuspicion::Residual { joint, percent },
            });
        }
    }
    found
}

fn judge_positions(own: &RobotJoint, joint: usize, log: &[RobotSample]) -> Option<RobotSuspicion> {
    let turns = own.turns;
    let positions = || log.iter().map(|sample| sample.q[joint]);
    let reach = [
        positions().fold(f64::INFINITY, f64::min),
        positions().fold(f64::NEG_INFINITY, f64::max),
    ];
    let limits = own
        .limits
        .lower
        .zip(own.limits.upper)
        .filter(|(lower, upper)| lower < upper);
    let [lower, upper] = match limits {
        Some((lower, upper)) => {
            let margin = BEYOND * (upper - lower);
            [lower - margin, upper + margin]
        }
        None if turns => [-FARTHEST_RAD, FARTHEST_RAD],
        None => [f64::NEG_INFINITY, f64::INFINITY],
    };
    let beyond = reach[0] < lower || reach[1] > upper;
    beyond.then_some(RobotSuspicion::Positions {
        joint,
        turns,
        reach,
        limits: limits.map(|(lower, upper)| [lower, upper]),
    })
}

/// Sums over samples, per joint.
#[derive(Default)]
struct Motion {
    samples: usize,
    /// (1).
    power: [f64; MAX_JOINTS],
    /// Σ f_j² and Σ τ_j².
    friction: [f64; MAX_JOINTS],
    torque: [f64; MAX_JOINTS],
    /// Samples in which the joint moves, with Σ (τ_j − τ̂_j)² and Σ τ_j² over them, because
    /// friction holds a joint at rest under any torque.
    moving: [usize; MAX_JOINTS],
    error: [f64; MAX_JOINTS],
    borne: [f64; MAX_JOINTS],
}

impl Motion {
    fn of(identifier: &RobotIdentifier, states: &[FilteredSample]) -> Self {
        let model = identifier.model();
        let n = model.robot().len();
        let mut frictionless = identifier.theta().to_vec();
        for (joint, friction) in model.friction().iter().enumerate() {
            for (term, i) in friction.terms.iter().zip(model.friction_of(joint)) {
                if *term != FrictionTerm::Offset {
                    frictionless[i] = 0.0;
                }
            }
        }
        let mut sums = Self::default();
        let (mut with, mut without) = ([0.0; MAX_JOINTS], [0.0; MAX_JOINTS]);
        for state in states.iter().step_by(states.len() / ENOUGH + 1) {
            sums.samples += 1;
            model.torques(identifier.theta(), state, &mut with[..n]);
            model.torques(&frictionless, state, &mut without[..n]);
            for (joint, own) in model.friction().iter().enumerate() {
                let (friction, torque) = (with[joint] - without[joint], state.tau[joint]);
                sums.power[joint] += friction * state.dq[joint]; // (1)
                sums.friction[joint] += friction.powi(2);
                sums.torque[joint] += torque.powi(2);
                if state.dq[joint].abs() > own.rest_speed {
                    sums.moving[joint] += 1;
                    sums.error[joint] += (torque - with[joint]).powi(2);
                    sums.borne[joint] += torque.powi(2);
                }
            }
        }
        sums
    }

    /// True if a joint contradicts (1), unless its friction hardly counts.
    fn friction_drives(&self, joint: usize) -> bool {
        self.power[joint] < 0.0 && self.friction[joint] > LEAST_FRICTION.powi(2) * self.torque[joint]
    }

    /// Relative residual of a joint while it moves \[%\]; `None` if it hardly does.
    fn residual(&self, joint: usize) -> Option<f64> {
        let moves = self.moving[joint] as f64 > MOVING * self.samples as f64;
        let residual = 100.0 * (self.error[joint] / self.borne[joint]).sqrt();
        (moves && residual.is_finite()).then_some(residual)
    }
}
