//! A joint whose torque the model does not explain is not a noisy joint: no estimate is usable.

use super::judge::{changed, model, simulated};
use super::{SIX_AXIS, robot};
use thetabus::messages::State;
use thetabus::node::robot::RobotEvidence;
use thetabus::robot::{
    IdentifyOptions, Motions, RobotIdentifier, RobotModel, RobotSample, filtered, judge_robot_fit, judge_robot_log,
};

/// Blocks that may be used and those of the state `misfit`, both in the last third of a log, and
/// the messages about the log.
pub(super) fn last_third(model: &RobotModel, log: &[RobotSample]) -> (usize, usize, Vec<String>) {
    judged(model, log, 2 * log.len() / 3)
}

/// The same after the first `behind` samples.
pub(super) fn judged(model: &RobotModel, log: &[RobotSample], behind: usize) -> (usize, usize, Vec<String>) {
    let mut identifier = RobotIdentifier::new(model.clone(), IdentifyOptions::default()).expect("valid");
    let mut evidence = RobotEvidence::new(&identifier);
    let (mut usable, mut misfits) = (0, 0);
    for (k, sample) in log.iter().enumerate() {
        if identifier.push(sample).expect("finite") {
            let estimate = evidence.judge(&identifier, true, 0.0);
            if k > behind {
                usable += estimate.use_ok as usize;
                misfits += usize::from(estimate.state == State::Misfit as u32);
                assert!(estimate.state != State::Misfit as u32 || estimate.usable.is_empty());
            }
        }
    }
    let found = judge_robot_fit(&identifier, &filtered(model, log));
    (usable, misfits, found.iter().map(ToString::to_string).collect())
}

fn moves(seed: u64, noise: f64) -> Vec<RobotSample> {
    simulated(&model(SIX_AXIS), 60, |options| {
        (options.seed, options.machine_seed) = (seed, seed);
        options.motions = Motions::Moves { rest_s: 0.3 };
        options.torque_noise = noise;
    })
}

#[test]
fn fault_nothing_is_used_while_a_joint_is_not_explained() {
    type Change = fn(&mut RobotSample);
    let cases: [(&str, Change, &str); 4] = [
        (
            "torque that hangs",
            |s| s.tau[1] = 0.3,
            "the model explains little of joint 2's",
        ),
        ("sign of a torque", |s| s.tau[2] *= -1.0, ""),
        (
            "sign of a position",
            |s| (s.q[1], s.dq[1]) = (-s.q[1], -s.dq[1]),
            "the model explains little of joint ",
        ),
        (
            "torques swapped",
            |s| s.tau.swap(1, 2),
            "the model explains little of joint 3's",
        ),
    ];
    for seed in 1..=2 {
        let log = moves(seed, 0.005);
        for (what, change, words) in cases {
            let (usable, misfits, said) = last_third(&model(SIX_AXIS), &changed(&log, change));
            assert!(
                usable == 0 && misfits > 15,
                "{what} {seed}: {usable} {misfits} {said:#?}"
            );
            assert!(said.iter().any(|line| line.contains(words)), "{what} {seed}: {said:#?}");
        }
        // one drive reports velocities in another scale
        let (usable, misfits, _) = last_third(&model(SIX_AXIS), &changed(&log, |s| s.dq[1] *= 1.05));
        assert!(usable == 0 && misfits > 15, "velocities {seed}: {usable} {misfits}");
        // an axis of the URDF is reversed
        let mut turned = robot(SIX_AXIS);
        turned.joints[1].axis *= -1.0;
        let turned = RobotModel::new(turned, true, model(SIX_AXIS).friction().to_vec()).expect("sound");
        let (usable, misfits, said) = last_third(&turned, &log);
        assert!(usable == 0 && misfits > 15, "axis {seed}: {usable} {misfits} {said:#?}");
    }
}

/// The first samples of a motion may not reach the limit.
#[test]
fn fault_a_clipped_torque_is_not_used_and_one_in_counts_is_not_clipped() {
    for seed in 1..=2 {
        let log = moves(seed, 0.005);
        let largest = log.iter().map(|s| s.tau[1].abs()).fold(0.0, f64::max);
        let limit = 0.7 * largest;
        let (usable, misfits, _) = last_third(
            &model(SIX_AXIS),
            &changed(&log, |s| s.tau[1] = s.tau[1].clamp(-limit, limit)),
        );
        assert!(usable == 0 && misfits >= 19, "{seed}: {usable} {misfits}");
        for count in [0.005, 0.02] {
            let counts = changed(&log, |s| {
                for (tau, joint) in s.tau.iter_mut().zip(&robot(SIX_AXIS).joints) {
                    let count = count * joint.limits.effort.expect("stated");
                    *tau = (*tau / count).round() * count;
                }
            });
            let stops = judge_robot_log(&model(SIX_AXIS), &counts, 0.05);
            assert!(stops.is_empty(), "{seed}, {count}: {stops:?}");
        }
    }
}

/// Torque noise of up to a fifth of each joint's range drowns most of the wrist's torques; it is
/// white, and whatever is known in spite of it stays usable.
#[test]
fn prop_noise_is_not_taken_for_a_model_that_explains_little() {
    for (seed, noise) in [(1, 0.05), (2, 0.05), (1, 0.2)] {
        let (_, misfits, said) = last_third(&model(SIX_AXIS), &moves(seed, noise));
        assert!(misfits <= 1, "seed {seed}, noise {noise}: {misfits} {said:#?}");
        let blames_noise = |line: &String| line.contains(" is mostly noise (residual ");
        assert!(said.iter().all(blames_noise), "{said:#?}");
        assert!(noise < 0.2 || !said.is_empty());
    }
    let (usable, _, said) = last_third(&model(SIX_AXIS), &moves(1, 0.005));
    assert!(usable > 12 && said.is_empty(), "{usable} {said:#?}");
}
