//! Encoders of 13 bits: the regressors are so noisy that the first blocks fit badly, or that any
//! parameters fit them.

use super::left_out::{run, simulation};
use super::{SIX_AXIS, robot};
use thetabus::robot::{
    IdentifyOptions, JointFriction, RobotIdentifier, RobotModel, RobotSample, RobotSimOptions, RobotSimulator,
    WindowOptions, with_velocities,
};

fn coarse(has_rests: bool, seed: u64) -> RobotSimOptions {
    RobotSimOptions {
        encoder_bits: 13,
        ..simulation(has_rests, seed)
    }
}

/// A false change in the third second made 20 blocks of the first of these runs dangerous.
#[test]
fn fault_coarse_encoders_make_nothing_surely_wrong() {
    let terms = JointFriction::default().terms;
    for (has_rests, seed) in [(true, 11), (true, 16), (false, 11), (false, 13)] {
        let run = run(&terms, 2e-4, coarse(has_rests, seed), 60);
        println!("rests {has_rests}, seed {seed}: {run:?}");
        assert_eq!(run.dangerous, 0);
        assert!(run.usable > 20, "{}", run.usable);
    }
}

/// With windows of 0.25 s the first second gives a joint 15 rows, and it has 40 parameters: its
/// residuals were 1e-7 N m, and so was what they were taken to tell of the noise. The weights of
/// that block then spoilt all that was learnt later.
#[test]
fn prop_rows_that_any_parameters_fit_tell_nothing_of_the_noise() {
    let robot = robot(SIX_AXIS);
    let log: Vec<RobotSample> = RobotSimulator::new(&robot, coarse(false, 11))
        .unwrap()
        .take(2500)
        .enumerate()
        .map(|(k, joints)| RobotSample {
            t_s: 1e-3 * k as f64,
            q: joints.q,
            tau: joints.input,
            ..RobotSample::default()
        })
        .collect();
    let model = RobotModel::new(robot, true, vec![JointFriction::default(); 6]).unwrap();
    for windows in [WindowOptions::default(), WindowOptions::for_period(1e-3)] {
        let options = IdentifyOptions {
            windows,
            payload: true,
            ..IdentifyOptions::default()
        };
        let mut identifier = RobotIdentifier::new(model.clone(), options).unwrap();
        for sample in with_velocities(&log, 0.02, 0.02) {
            if !identifier.push(&sample).unwrap() {
                continue;
            }
            let figures = identifier.figures();
            for joint in (0..6).filter(|&joint| figures.rows[joint] > 0) {
                // near 2 % of the torque so far, of which that of a block may be some times more
                let (std, size) = (identifier.torque_std(joint), figures.signal_rms[joint]);
                assert!(std > 1e-3 * size, "joint {}: {std} beside {size}", joint + 1);
            }
        }
        assert_eq!(identifier.blocks(), 2);
    }
}

/// The error of a window's acceleration falls with the fifth power of its length, and goes with the
/// square of a count: encoders of 17 bits have a 256th of that of 13 bits.
#[test]
fn prop_windows_become_longer_for_coarse_encoders_alone() {
    let robot = robot(SIX_AXIS);
    for (bits, seed) in [(17, 21), (13, 21), (13, 22)] {
        let simulation = RobotSimOptions {
            encoder_bits: bits,
            ..simulation(true, seed)
        };
        let simulator = RobotSimulator::new(&robot, simulation).unwrap();
        let model = RobotModel::new(robot.clone(), true, vec![JointFriction::default(); 6]).unwrap();
        let log: Vec<RobotSample> = simulator
            .take(20_000)
            .enumerate()
            .map(|(k, joints)| RobotSample {
                t_s: 1e-3 * k as f64,
                q: joints.q,
                tau: joints.input,
                ..RobotSample::default()
            })
            .collect();
        let options = IdentifyOptions {
            windows: WindowOptions::for_period(1e-3),
            lengthens: true,
            formed_over_s: Some(0.02),
            payload: true,
            ..IdentifyOptions::default()
        };
        let mut identifier = RobotIdentifier::new(model, options).unwrap();
        for sample in with_velocities(&log, 0.02, 0.02) {
            identifier.push(&sample).unwrap();
        }
        println!("{bits} bits, seed {seed}: {} s", identifier.window_s());
        match bits {
            17 => assert_eq!(identifier.window_s(), 0.1),
            _ => assert!(identifier.window_s() > 0.13, "{}", identifier.window_s()),
        }
    }
}
