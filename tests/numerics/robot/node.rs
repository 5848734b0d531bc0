//! The node of a robot: streams, blocks, states, commands and what it keeps.

use super::{SIX_AXIS, SUBSTEPS, at_1_khz, robot};
use thetabus::messages::{Estimate, Sample, State, estimate_flags, sample_flags, signals};
use thetabus::model::{JointSample, MAX_JOINTS};
use thetabus::node::command::{Change, NodeState, Order};
use thetabus::node::identifier::IdentifierOptions;
use thetabus::node::robot::{RobotLearner, RobotNode};
use thetabus::robot::{
    Drives, IdentifyOptions, RobotIdentifier, RobotModel, RobotSimOptions, RobotSimulator, Velocities,
};

const N: u64 = 500;

fn node() -> RobotNode {
    node_of_blocks(N, IdentifyOptions::default().block_s)
}

/// With blocks of `samples` samples, which last `block_s` [s].
fn node_of_blocks(samples: u64, block_s: f64) -> RobotNode {
    let (friction, windows) = at_1_khz(6);
    let model = RobotModel::new(robot(SIX_AXIS), true, friction).unwrap();
    let options = IdentifyOptions {
        windows,
        formed_over_s: Some(0.02),
        payload: true,
        block_s,
        ..IdentifyOptions::default()
    };
    let options = (RobotIdentifier::new(model, options).unwrap(), Velocities::new(20, 0.02));
    RobotNode::new(
        IdentifierOptions {
            sample_period_ns: 1_000_000,
            ..IdentifierOptions::new(samples, 6, signals::Q | signals::INPUT)
        },
        RobotLearner::new(Drives::torque(6), options.0, Some(options.1)),
        1,
    )
}

fn motion(seconds: usize) -> Vec<JointSample> {
    let robot = robot(SIX_AXIS);
    let options = RobotSimOptions {
        difference: 0.1,
        substeps: SUBSTEPS,
        ..RobotSimOptions::new(&robot)
    };
    RobotSimulator::new(&robot, options)
        .unwrap()
        .take(1000 * seconds)
        .collect()
}

fn message(stream: u64, seq: u64, joints: &JointSample) -> Sample {
    Sample::new(
        stream,
        seq,
        seq * 1_000_000,
        6,
        signals::Q | signals::SETPOINT | signals::INPUT,
        joints,
    )
}

fn feed(
    node: &mut RobotNode,
    stream: u64,
    samples: &[JointSample],
    change: impl Fn(u64, &mut Sample) -> bool,
) -> Vec<Estimate> {
    let mut estimates = Vec::new();
    for (seq, joints) in samples.iter().enumerate() {
        let mut sample = message(stream, seq as u64, joints);
        if change(seq as u64, &mut sample) {
            node.on_sample(&sample, &mut |estimate| estimates.push(*estimate));
        }
    }
    estimates
}

#[test]
fn ident_a_stream_of_positions_and_torques_becomes_estimates_that_may_be_used() {
    let samples = motion(25);
    let mut node = node();
    let estimates = feed(&mut node, 1, &samples, |_, _| true);
    assert_eq!(estimates.len(), 50);
    for (i, estimate) in estimates.iter().enumerate() {
        assert_eq!((estimate.block, estimate.accepted), (i as u64 + 1, N * (i as u64 + 1)));
        assert_eq!(estimate.params as usize, node.learner().robot().parameters().len());
    }
    let last = estimates[49];
    println!(
        "state {} use_ok {} usable {} excited {} explained {:.3?} p {:.1e}",
        last.state,
        last.use_ok,
        last.usable.len(),
        last.excited.len(),
        &last.explained[..6],
        last.fit_probability
    );
    let ready = [State::Converged as u32, State::PoorlyExcited as u32];
    assert!(ready.contains(&last.state) && last.use_ok == 1, "{}", last.state);
    assert!(last.usable.len() > 6, "{}", last.usable.len());
    assert!(last.explained[..6].iter().all(|share| *share > 0.9));
    // The payload is held at nothing.
    let first = node.learner().robot().model().parameters().len();
    assert!(last.fixed.contains(first) && last.theta[first] == 0.0 && last.derived[0] == 0.0);
    // A value that is reported as known to 5 % is known to 5 %.
    let robot = robot(SIX_AXIS);
    let options = RobotSimOptions {
        difference: 0.1,
        substeps: SUBSTEPS,
        ..RobotSimOptions::new(&robot)
    };
    let truth = RobotSimulator::new(&robot, options)
        .unwrap()
        .truth(node.learner().robot().model(), 0.0);
    for i in last.usable.iter() {
        assert!(
            (last.theta[i] / truth[i] - 1.0).abs() < 0.05,
            "{i}: {} {}",
            last.theta[i],
            truth[i]
        );
    }
}

/// Within a quarter of a second the torque of a joint hardly changes: what is explained shows over
/// several blocks. A joint that rests all the time has nothing to explain.
#[test]
fn ident_short_blocks_and_a_joint_that_rests_come_to_be_used() {
    let samples = motion(25);
    let rests = |_: u64, sample: &mut Sample| {
        sample.q[5] = 0.0;
        true
    };
    let all = feed(&mut node_of_blocks(250, 0.25), 1, &samples, |_, _| true);
    let five = feed(&mut node_of_blocks(250, 0.25), 1, &samples, rests);
    for (estimates, joints) in [(all, 6), (five, 5)] {
        let last = estimates[99];
        assert!(
            last.use_ok == 1,
            "state {} explained {:?}",
            last.state,
            &last.explained[..6]
        );
        assert!(last.explained[..joints].iter().all(|share| *share > 0.9));
    }
}

#[test]
fn fault_lost_refused_and_ended_samples_are_counted_and_harm_nothing() {
    let samples = motion(6);
    let mut node = node();
    let estimates = feed(&mut node, 1, &samples, |seq, sample| {
        if seq == 700 {
            sample.q[2] = f64::NAN;
        }
        if seq == 900 {
            sample.signals = signals::Q;
        }
        if seq == 5_700 {
            sample.flags |= sample_flags::END;
        }
        !(1_200..1_300).contains(&seq) && seq <= 5_700
    });
    let status = node.status();
    assert_eq!((status.missing, status.rejected, status.faults.gaps), (100, 2, 1));
    assert_eq!((status.faults.not_finite, status.faults.wrong_signals), (1, 1));
    assert_eq!(status.state, State::Ended as u32);
    // 11 whole blocks; the twelfth ends with the stream and gives none.
    assert_eq!(estimates.len(), 11);
    let incomplete: Vec<u64> = estimates
        .iter()
        .filter(|e| e.flags & estimate_flags::INCOMPLETE != 0)
        .map(|e| e.block)
        .collect();
    assert_eq!(incomplete, [2, 3]);
    assert!(
        estimates
            .iter()
            .all(|e| e.theta[..e.params as usize].iter().all(|x| x.is_finite()))
    );
}

#[test]
fn prop_pause_fix_free_and_restart_take_effect_between_blocks() {
    let samples = motion(8);
    let mut node = node();
    feed(&mut node, 1, &samples[..2_100], |_, _| true);
    let fix = Change::Fix {
        index: 3,
        value: Some(0.7),
    };
    assert_eq!(node.offer(Order::new(1, 0, fix)).unwrap().from_seq, 2_500);
    assert!(
        node.offer(Order::new(
            2,
            0,
            Change::Fix {
                index: 500,
                value: None
            }
        ))
        .is_err()
    );
    let mut estimates = Vec::new();
    let go = |node: &mut RobotNode, range: std::ops::Range<usize>, estimates: &mut Vec<Estimate>| {
        for seq in range {
            node.on_sample(&message(1, seq as u64, &samples[seq]), &mut |e| estimates.push(*e));
        }
    };
    go(&mut node, 2_100..3_100, &mut estimates);
    assert!(!estimates[0].fixed.contains(3) && estimates[1].fixed.contains(3));
    assert_eq!((estimates[1].theta[3], estimates[1].theta_std[3]), (0.7, 0.0));
    node.offer(Order::new(3, 0, Change::Free { index: 3 })).unwrap();
    node.offer(Order::new(4, 0, Change::Pause)).unwrap();
    estimates.clear();
    go(&mut node, 3_100..4_100, &mut estimates);
    assert_eq!(estimates[1].state, State::Paused as u32);
    assert!(!estimates[1].fixed.contains(3) && estimates[1].flags & estimate_flags::HELD != 0);
    node.offer(Order::new(5, 0, Change::Resume)).unwrap();
    node.offer(Order::new(6, 0, Change::Restart { state: None })).unwrap();
    go(&mut node, 4_100..4_600, &mut estimates);
    assert_eq!(node.learner().robot().blocks(), 0, "nothing is known after a reset");
    assert_eq!(std::iter::from_fn(|| node.take_done()).count(), 5);
}

#[test]
fn prop_a_saved_state_goes_on_and_a_replay_teaches_nothing_that_lasts() {
    let samples = motion(10);
    let mut node = node();
    feed(&mut node, 1, &samples[..6_000], |_, _| true);
    let mut state = NodeState::default();
    node.save(&mut state);
    let known = node.learner().robot().theta().to_vec();

    let mut other = self::node();
    other.load(&state).unwrap();
    assert_eq!(other.learner().robot().theta(), known);
    let estimates = feed(&mut other, 2, &samples[6_000..], |_, _| true);
    assert_ne!(estimates[0].flags & estimate_flags::WARM, 0);
    for (i, parameter) in other.learner().robot().parameters().iter().enumerate() {
        let moved = (estimates[7].theta[i] - known[i]).abs();
        assert!(
            moved <= 5.0 * node.learner().robot().theta_std(i),
            "{}: {moved}",
            parameter.name
        );
    }
    let mut damaged = state.clone();
    damaged.estimator.reals.pop();
    assert!(self::node().load(&damaged).is_err());
    damaged = state.clone();
    damaged.estimator.reals[0] = f64::NAN;
    assert!(self::node().load(&damaged).is_err());

    // A replay of something else, and then the machine again.
    let wrong: Vec<JointSample> = samples
        .iter()
        .map(|sample| {
            let mut sample = *sample;
            (0..MAX_JOINTS).for_each(|i| sample.input[i] *= 1.5);
            sample
        })
        .collect();
    feed(&mut node, 3, &wrong[..4_000], |_, sample| {
        sample.flags |= sample_flags::REPLAY;
        true
    });
    assert_ne!(node.learner().robot().theta(), known);
    let mut during = NodeState::default();
    node.save(&mut during);
    assert_eq!(
        during.estimator.reals[..known.len()],
        known,
        "a checkpoint holds what is known of the machine"
    );
    feed(&mut node, 4, &samples[..10], |_, _| true);
    assert_eq!(node.learner().robot().theta(), known);
}
