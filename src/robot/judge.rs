//! What is probably wrong with a robot's log that was read as configured, and with what it taught.
//!
//! ```text
//! v̄ = ∫ q̇ dt / T,   d = Δq / T over pieces of some T = 0.1 s:   v̄ ≈ k d,   k = Σ v̄ d / Σ d²        (1)
//! P_j = Σ f_j q̇_j ≥ 0 for every machine, f_j: friction torque of joint j without its offset        (2)
//! ```
//!
//! A judgement here never changes a number and never refuses a log: it is told, and whoever knows
//! the robot decides. The limits are those beyond which hardly any robot is.

use super::friction::FrictionTerm;
use super::identify::RobotIdentifier;
use super::model::RobotModel;
use super::state::{FilteredSample, RobotSample};
use super::suspicion::{FACTOR, RobotSuspicion};
use super::tree::RobotJoint;
use crate::model::MAX_JOINTS;
use std::f64::consts::{PI, TAU};

/// Turning joints without limits seldom turn further \[rad\].
const FARTHEST_RAD: f64 = 4.0 * PI;
/// Turning joints seldom turn as fast on average \[rad/s\].
const FASTEST_RAD_PER_S: f64 = 4.0 * PI;
/// A joint may be this part of its range beyond a limit that is not meant so strictly.
const BEYOND: f64 = 0.5;
/// Steps between samples that are this share of a turn are not motion.
const WRAP: std::ops::Range<f64> = 0.9..1.1;
/// Samples are seldom further apart \[s\].
const LONGEST_STEP_S: f64 = 0.5;
/// T of (1) \[s\].
const PIECE_S: f64 = 0.1;
/// Slower pieces do not count \[rad/s or m/s\].
const SLOWEST: f64 = 0.02;
/// Fewer pieces say nothing.
const PIECES: usize = 10;
/// Standard deviations beyond which a sign is no accident.
const SURE: f64 = 5.0;
/// Residual that hardly anything explains \[%\]; the last joint of a real robot has 40 to 56 %.
const LARGEST_RESIDUAL: f64 = 70.0;
/// A joint that moves in fewer samples than this share is not judged by its residual.
const MOVING: f64 = 0.1;
/// Friction that is a smaller part of the torque hardly counts.
const LEAST_FRICTION: f64 = 0.01;
/// Samples that the sums are taken over.
const ENOUGH: usize = 2000;

/// What is suspicious about the samples of a log; steps longer than `max_gap_s` are holes.
pub fn judge_robot_log(model: &RobotModel, log: &[RobotSample], max_gap_s: f64) -> Vec<RobotSuspicion> {
    let mut found = Vec::new();
    if log.len() < 3 {
        return found;
    }
    let mut steps: Vec<f64> = log.windows(2).map(|pair| pair[1].t_s - pair[0].t_s).collect();
    let (_, step_s, _) = steps.select_nth_unstable_by(log.len() / 2 - 1, f64::total_cmp);
    // A difference of stamps carries rounding that nobody would write.
    let step_s = format!("{step_s:.4e}").parse().unwrap_or(*step_s);
    if step_s > LONGEST_STEP_S {
        found.push(RobotSuspicion::Time { step_s });
    }
    for (joint, own) in model.robot().joints.iter().enumerate() {
        let turns = own.turns;
        found.extend(judge_positions(own, joint, log));
        let wraps = turns && wraps(log, joint);
        if wraps {
            found.push(RobotSuspicion::Wraps { joint });
        }
        let rate = Rate::of(log, joint, max_gap_s, turns);
        let factor = rate.factor().filter(|_| !wraps);
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
    found
}

/// What is suspicious about what was learnt from a log: its filtered samples.
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
            .map(|(_, i)| (i, identifier.theta()[i], identifier.theta_std(i)))
            .filter(|(_, estimate, std)| *estimate < -SURE * std)
            .map(|(i, estimate, std)| (model.parameters()[i].name.clone(), estimate, std))
            .collect();
        // Of several terms one may well be negative while their sum brakes.
        if !negative.is_empty() && motion.friction_drives(joint) {
            let parameters = negative;
            found.push(RobotSuspicion::Sign { joint, parameters });
        }
    }
    for joint in 0..model.robot().len() {
        if let Some(percent) = motion.residual(joint)
            && percent > LARGEST_RESIDUAL
        {
            found.push(RobotSuspicion::Residual { joint, percent });
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

fn jumps_a_turn(before: f64, after: f64) -> bool {
    WRAP.contains(&((after - before).abs() / TAU))
}

fn wraps(log: &[RobotSample], joint: usize) -> bool {
    log.windows(2)
        .any(|pair| jumps_a_turn(pair[0].q[joint], pair[1].q[joint]))
}

/// Sums of (1).
#[derive(Default)]
struct Rate {
    /// Pieces in which the position moves.
    count: usize,
    /// Pieces in which the velocity says that it moves fast.
    fast: usize,
    dd: f64,
    vd: f64,
    vv: f64,
}

impl Rate {
    fn of(log: &[RobotSample], joint: usize, max_gap_s: f64, turns: bool) -> Self {
        let mut sums = Self::default();
        let (mut start, mut way) = (0, 0.0);
        for (at, pair) in log.windows(2).enumerate() {
            let step_s = pair[1].t_s - pair[0].t_s;
            if step_s > max_gap_s || (turns && jumps_a_turn(pair[0].q[joint], pair[1].q[joint])) {
                (start, way) = (at + 1, 0.0);
                continue;
            }
            way += 0.5 * step_s * (pair[0].dq[joint] + pair[1].dq[joint]);
            let span_s = pair[1].t_s - log[start].t_s;
            if span_s < PIECE_S {
                continue;
            }
            let (v, d) = (way / span_s, (pair[1].q[joint] - log[start].q[joint]) / span_s);
            if d.abs() > SLOWEST {
                sums.count += 1;
                (sums.dd, sums.vd, sums.vv) = (sums.dd + d * d, sums.vd + v * d, sums.vv + v * v);
            }
            sums.fast += usize::from(v.abs() > 5.0 * SLOWEST);
            (start, way) = (at + 1, 0.0);
        }
        sums
    }

    /// k if it is surely outside of what it should be.
    fn factor(&self) -> Option<f64> {
        if self.count < PIECES {
            return None;
        }
        let k = self.vd / self.dd; // (1)
        let misfit = (self.vv - self.vd * k).max(0.0) / (self.count - 1) as f64;
        let margin = SURE * (misfit / self.dd).sqrt();
        (k + margin < FACTOR.start || k - margin > FACTOR.end).then_some(k)
    }
}

/// Sums over samples, per joint.
#[derive(Default)]
struct Motion {
    samples: usize,
    /// (2).
    power: [f64; MAX_JOINTS],
    /// Σ f_j² and Σ τ_j².
    friction: [f64; MAX_JOINTS],
    torque: [f64; MAX_JOINTS],
    /// Samples in which the joint moves, with Σ (τ_j − τ̂_j)² and Σ τ_j² over them: a joint at rest
    /// bears what it is given.
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
                sums.power[joint] += friction * state.dq[joint]; // (2)
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

    /// True if a joint contradicts (2), unless its friction hardly counts.
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

#[cfg(test)]
mod tests {
    use super::super::{
        Drives, IdentifyOptions, JointFriction, LogColumns, Motions, Robot, RobotSimOptions, RobotSimulator, Selection,
        filtered, read_log,
    };
    use super::*;
    use std::path::Path;

    const SIX_AXIS: &str = include_str!("../../config/robots/six_axis.urdf");
    const SEVEN_AXIS: &str = include_str!("../../config/robots/seven_axis.urdf");

    fn model(urdf: &str) -> RobotModel {
        let robot = Robot::from_urdf(urdf, &Selection::default()).expect("sound");
        let joints = robot.len();
        RobotModel::new(robot, true, vec![JointFriction::default(); joints]).expect("sound")
    }

    /// Seconds of a simulated robot at 100 Hz, with encoders and noise.
    fn simulated(model: &RobotModel, seconds: usize, change: impl Fn(&mut RobotSimOptions)) -> Vec<RobotSample> {
        let mut options = RobotSimOptions {
            sample_period_s: 0.01,
            control_steps: 10,
            has_velocity: true,
            ..RobotSimOptions::new(model.robot())
        };
        change(&mut options);
        let simulator = RobotSimulator::new(model.robot(), options).expect("valid");
        let samples = simulator.take(100 * seconds).enumerate();
        samples
            .map(|(k, sample)| RobotSample {
                t_s: 0.01 * k as f64,
                q: sample.q,
                dq: sample.dq,
                tau: sample.input,
            })
            .collect()
    }

    /// What is said of a log.
    fn said(model: &RobotModel, log: &[RobotSample]) -> Vec<String> {
        let options = IdentifyOptions::default();
        let mut found = judge_robot_log(model, log, options.windows.max_gap_s);
        let mut identifier = RobotIdentifier::new(model.clone(), options).expect("valid");
        log.iter().for_each(|sample| _ = identifier.push(sample));
        identifier.end_of_recording();
        let states = filtered(model, log);
        found.extend(judge_robot_fit(&identifier, &states));
        found.iter().map(ToString::to_string).collect()
    }

    fn changed(log: &[RobotSample], change: impl Fn(&mut RobotSample)) -> Vec<RobotSample> {
        let mut log = log.to_vec();
        log.iter_mut().for_each(change);
        log
    }

    #[test]
    fn val_nothing_is_said_of_sound_simulated_logs() {
        for urdf in [SIX_AXIS, SEVEN_AXIS] {
            let model = model(urdf);
            for seed in 0..2 {
                let log = simulated(&model, 40, |options| {
                    (options.seed, options.machine_seed) = (seed, seed)
                });
                assert_eq!(said(&model, &log), [""; 0], "seed {seed}");
            }
            let moves = simulated(&model, 40, |options| options.motions = Motions::Moves { rest_s: 0.5 });
            assert_eq!(said(&model, &moves), [""; 0], "moves");
            let rest = simulated(&model, 20, |options| options.motions = Motions::Rest);
            assert_eq!(said(&model, &rest), [""; 0], "rest");
        }
    }

    #[test]
    fn fault_each_usual_mistake_is_named_with_its_joint() {
        let model = model(SIX_AXIS);
        let log = simulated(&model, 40, |_| {});
        type Change = fn(&mut RobotSample);
        let cases: [(&str, Change, &str); 12] = [
            (
                "sign of a torque",
                |s| s.tau[1] *= -1.0,
                "torque of joint 2 may have the opposite sign (",
            ),
            (
                "torques swapped",
                |s| s.tau.swap(1, 4),
                "the model explains little of joint ",
            ),
            (
                "velocities in degrees",
                |s| s.dq = s.dq.map(f64::to_degrees),
                "velocities of joint 3 are 57.",
            ),
            (
                "the same",
                |s| s.dq = s.dq.map(f64::to_degrees),
                "if they are in degrees per second, convert",
            ),
            (
                "positions in degrees",
                |s| s.q = s.q.map(f64::to_degrees),
                "if its positions are in degrees, convert",
            ),
            (
                "the same",
                |s| s.q = s.q.map(f64::to_degrees),
                "positions of joint 1 reach from ",
            ),
            (
                "both in degrees",
                |s| (s.q, s.dq) = (s.q.map(f64::to_degrees), s.dq.map(f64::to_degrees)),
                "positions of joint 2 reach from ",
            ),
            (
                "sign of a velocity",
                |s| s.dq[0] *= -1.0,
                "if they have the opposite sign, turn it round",
            ),
            (
                "velocities swapped",
                |s| s.dq.swap(0, 5),
                "check log.velocity_columns, log.position_columns",
            ),
            (
                "a torque that is not there",
                |s| s.tau[3] = 0.0,
                "torque of joint 4 is 0 in every sample",
            ),
            (
                "a position that is not there",
                |s| s.q[3] = 0.25,
                "position of joint 4 is 0.25 in every sample",
            ),
            ("time in milliseconds", |s| s.t_s *= 1e3, "samples are 10 s apart"),
        ];
        for (what, change, words) in cases {
            let said = said(&model, &changed(&log, change));
            assert!(said.iter().any(|line| line.contains(words)), "{what}: {said:#?}");
        }
        // Between −π and π: what lies beyond comes back at the other end.
        let turning = SIX_AXIS.replace("revolute", "continuous");
        let model = self::model(&turning);
        let wrapped = changed(&log, |s| s.q[0] = (s.q[0] + 3.0 + PI).rem_euclid(TAU) - PI);
        let said = said(&model, &wrapped);
        let words = "positions of joint 1 jump by a whole turn";
        assert!(said.iter().any(|line| line.contains(words)), "{said:#?}");
    }

    /// Recordings of a real robot, whose last joint is mostly friction.
    #[test]
    fn val_nothing_is_said_of_a_real_robots_recordings() {
        let beside = Path::new(env!("CARGO_MANIFEST_DIR")).join("../shared/data");
        let dir = std::env::var_os("THETABUS_DATA_DIR").map_or(beside, Into::into);
        let dir = dir.join("ur10e");
        if !dir.is_dir() {
            let required = std::env::var("THETABUS_REQUIRE_PEERS").as_deref() == Ok("1");
            assert!(!required, "{}", dir.display());
            println!("skipped: {}", dir.display());
            return;
        }
        let robot = Robot::from_file(&dir.join("ur10e.urdf"), &Selection::default()).expect("sound");
        let model = RobotModel::new(robot, true, vec![JointFriction::default(); 6]).expect("sound");
        let columns = LogColumns {
            time: 1,
            position: (2..8).collect(),
            velocity: (8..14).collect(),
            input: (14..20).collect(),
        };
        let drives = Drives {
            gain: vec![14.87, 13.26, 11.13, 10.62, 11.03, 11.47],
            coupling: None,
        };
        for name in [
            "train_30s_12harm",
            "validation_ptp",
            "empty_14harm",
            "empty_15harm",
            "load_14harm",
        ] {
            let text = std::fs::read_to_string(dir.join(format!("{name}.csv"))).expect("a recording");
            let log = read_log(&text, &columns, &drives).expect("sound");
            assert_eq!(said(&model, &log), [""; 0], "{name}");
            let turned = changed(&log, |s| s.tau[2] *= -1.0);
            let turned = said(&model, &turned);
            // Short moves between rests may leave the friction positive, and then explain nothing.
            let words = [
                "torque of joint 3 may have the opposite sign",
                "little of joint 3's torque",
            ];
            let named = |line: &String| words.iter().any(|words| line.contains(words));
            assert!(turned.iter().any(named), "{name}: {turned:#?}");
        }
    }
}
