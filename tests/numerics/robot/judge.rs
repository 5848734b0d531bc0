//! Messages about a robot's log that was recorded or read incorrectly.

use super::{SEVEN_AXIS, SIX_AXIS, SUBSTEPS, robot, ur10e, ur10e_recording};
use std::f64::consts::{PI, TAU};
use thetabus::robot::{
    IdentifyOptions, JointFriction, Motions, Robot, RobotIdentifier, RobotModel, RobotSample, RobotSimOptions,
    RobotSimulator, filtered, judge_robot_fit, judge_robot_log,
};

pub(super) fn model(urdf: &str) -> RobotModel {
    let robot = robot(urdf);
    let joints = robot.len();
    RobotModel::new(robot, true, vec![JointFriction::default(); joints]).expect("sound")
}

/// Seconds of a simulated robot at 100 Hz, with encoders and noise.
pub(super) fn simulated(model: &RobotModel, seconds: usize, change: impl Fn(&mut RobotSimOptions)) -> Vec<RobotSample> {
    let mut options = RobotSimOptions {
        sample_period_s: 0.01,
        control_steps: 10,
        has_velocity: true,
        substeps: SUBSTEPS,
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

/// Messages about a log.
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

pub(super) fn changed(log: &[RobotSample], change: impl Fn(&mut RobotSample)) -> Vec<RobotSample> {
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
    let cases: [(&str, Change, &str); 13] = [
        (
            "sign of a torque",
            |s| s.tau[1] *= -1.0,
            "torque of joint 2 may have the opposite sign (",
        ),
        (
            "a torque that is clipped",
            |s| s.tau[1] = s.tau[1].clamp(-20.0, 20.0),
            "torque of joint 2 is 20 or -20 in ",
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
    // Positions are wrapped to −π … π.
    let turning = SIX_AXIS.replace("revolute", "continuous");
    let model = self::model(&turning);
    let wrapped = changed(&log, |s| s.q[0] = (s.q[0] + 3.0 + PI).rem_euclid(TAU) - PI);
    let said = said(&model, &wrapped);
    let words = "positions of joint 1 jump by a whole turn";
    assert!(said.iter().any(|line| line.contains(words)), "{said:#?}");
}

/// Recordings of a real robot whose last joint is mostly friction.
#[test]
fn val_nothing_is_said_of_a_real_robots_recordings() {
    let Some(robot) = ur10e() else { return };
    let model = RobotModel::new(robot, true, vec![JointFriction::default(); 6]).unwrap();
    for name in [
        "train_30s_12harm",
        "validation_ptp",
        "empty_14harm",
        "empty_15harm",
        "load_14harm",
    ] {
        let Some(log) = ur10e_recording(&format!("{name}.csv"), &[1.0; 6]) else {
            return;
        };
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

/// A log of positions and velocities alone, or a planned motion, has as many columns as one of
/// torques.
#[test]
fn fault_torques_that_are_another_signal_are_told() {
    let model = model(SIX_AXIS);
    let log = simulated(&model, 20, |options| options.encoder_bits = 0);
    let said = |change: &dyn Fn(usize, usize) -> f64| {
        let mut log = log.clone();
        for k in 1..log.len() - 1 {
            (0..6).for_each(|j| log[k].tau[j] = change(k, j));
        }
        let found = judge_robot_log(&model, &log[1..log.len() - 1], 0.05);
        found.iter().map(ToString::to_string).collect::<Vec<_>>().join("\n")
    };
    // The factor is a gain of the drive, the last per cent a derivative by other means.
    let gain = |j: usize| 1.0 + 10.0 * j as f64;
    let cases: [(&str, &dyn Fn(usize, usize) -> f64); 3] = [
        ("position", &|k, j| gain(j) * log[k].q[j]),
        ("velocity", &|k, j| gain(j) * (log[k].dq[j] + 0.01 * (k as f64).sin())),
        ("acceleration", &|k, j| {
            gain(j) * (log[k + 1].dq[j] - log[k - 1].dq[j]) / 0.02
        }),
    ];
    for (signal, change) in cases {
        let words = format!("the torque of every joint that moves is its {signal} times a factor");
        let found = said(change);
        assert!(found.contains(&words), "{signal}: {found}");
        // A machine with one such joint may exist.
        let one = said(&|k, j| if j == 2 { change(k, j) } else { log[k].tau[j] });
        assert_eq!(one, "", "{signal}");
    }
}

/// Many URDFs state no efforts, or zeros: friction is then expected by the weight that the drives
/// bear, and the simulated drives are as strong.
#[test]
fn ident_a_robot_without_efforts_is_explained() {
    let without = |mut robot: Robot| {
        robot.joints.iter_mut().for_each(|joint| joint.limits.effort = None);
        RobotModel::new(robot, true, vec![JointFriction::default(); 6]).expect("sound")
    };
    let model = without(robot(SIX_AXIS));
    assert_eq!(said(&model, &simulated(&model, 40, |_| {})), [""; 0]);
    // The friction of this wrist, 3 N m, is ten times the torque by its weight.
    let Some(robot) = ur10e() else { return };
    let Some(log) = ur10e_recording("train_30s_12harm.csv", &[1.0; 6]) else {
        return;
    };
    assert_eq!(said(&without(robot), &log), [""; 0]);
}
