//! A robot's samples become estimates without allocation.

use thetabus::robot::{
    FrictionTerm, IdentifyOptions, JointFriction, Robot, RobotIdentifier, RobotModel, RobotSample, Selection,
};

/// Nine seconds at 100 Hz, through settling, walking friction, a pause and a refused sample; by a
/// model with every term of friction, and by one that leaves some out.
#[test]
fn rt_a_robots_samples_become_estimates_without_allocation() {
    let all = JointFriction::default();
    let few = JointFriction {
        terms: vec![FrictionTerm::Coulomb],
        ..JointFriction::default()
    };
    for friction in [all, few] {
        let urdf = include_str!("../../config/robots/seven_axis.urdf");
        let robot = Robot::from_urdf(urdf, &Selection::default()).unwrap();
        let model = RobotModel::new(robot, true, vec![friction; 7]).unwrap();
        let options = IdentifyOptions {
            settle_blocks: 4,
            ..IdentifyOptions::default()
        };
        let mut identifier = RobotIdentifier::new(model, options).unwrap();
        let mut estimates = 0;
        let counted = allocation_counter::measure(|| {
            for k in 0..900 {
                let t_s = 0.01 * f64::from(k) + if k > 600 { 2.0 } else { 0.0 };
                let mut sample = RobotSample {
                    t_s,
                    ..RobotSample::default()
                };
                for i in 0..7 {
                    let w = 1.0 + 0.3 * i as f64;
                    (sample.q[i], sample.dq[i], sample.tau[i]) =
                        ((w * t_s).sin(), w * (w * t_s).cos(), (w * t_s).cos());
                }
                if k == 300 {
                    sample.q[0] = f64::NAN;
                }
                estimates += i32::from(identifier.push(&sample).unwrap_or(false));
            }
        });
        assert!(estimates >= 8, "{estimates}");
        assert_eq!(counted.count_total, 0);
    }
}

/// Eighteen seconds at 1 kHz through the node: collecting, a payload that comes, a replay, and the
/// end.
#[test]
fn rt_a_robots_node_estimates_a_payload_without_allocation() {
    use thetabus::messages::{Sample, sample_flags, signals};
    use thetabus::node::identifier::IdentifierOptions;
    use thetabus::node::robot::{RobotLearner, RobotNode};
    use thetabus::robot::{Drives, PayloadChange, RobotSimOptions, RobotSimulator, Velocities, WindowOptions};

    let urdf = include_str!("../../config/robots/six_axis.urdf");
    let robot = Robot::from_urdf(urdf, &Selection::default()).unwrap();
    let payload = PayloadChange {
        t_s: 13.0,
        mass_kg: 3.0,
        center_m: [0.0, 0.0, 0.05],
        inertia_kg_m2: [0.01, 0.0, 0.01, 0.0, 0.0, 0.01],
    };
    let simulation = RobotSimOptions {
        payloads: vec![payload],
        encoder_bits: 13,
        ..RobotSimOptions::new(&robot)
    };
    let samples: Vec<_> = RobotSimulator::new(&robot, simulation).unwrap().take(18_000).collect();
    let model = RobotModel::new(robot, true, vec![JointFriction::default(); 6]).unwrap();
    let options = IdentifyOptions {
        windows: WindowOptions {
            length_s: 0.1,
            stride_s: 0.02,
            max_gap_s: 0.02,
            ..WindowOptions::default()
        },
        // in the middle of the run windows become longer
        lengthens: true,
        formed_over_s: Some(0.02),
        payload: true,
        ..IdentifyOptions::default()
    };
    let mut node = RobotNode::new(
        IdentifierOptions {
            sample_period_ns: 1_000_000,
            frozen_after: 200,
            ..IdentifierOptions::new(500, 6, signals::Q | signals::INPUT)
        },
        RobotLearner::new(
            Drives::torque(6),
            RobotIdentifier::new(model, options).unwrap(),
            Some(Velocities::new(20, 0.02)),
        ),
        1,
    );
    let (mut estimates, mut loaded) = (0, 0);
    let counted = allocation_counter::measure(|| {
        for stream in 1..=2_u64 {
            let len = if stream == 1 { 18_000 } else { 2_000 };
            for (seq, joints) in samples.iter().take(len).enumerate() {
                let seq = seq as u64;
                let mask = signals::Q | signals::SETPOINT | signals::INPUT;
                let mut sample = Sample::new(stream, seq, seq * 1_000_000, 6, mask, joints);
                if stream == 2 {
                    sample.flags |= sample_flags::REPLAY;
                }
                if seq + 1 == len as u64 {
                    sample.flags |= sample_flags::END;
                }
                node.on_sample(&sample, &mut |estimate| {
                    estimates += 1;
                    loaded += i32::from(estimate.derived[0] > 2.0);
                });
            }
        }
    });
    assert_eq!(estimates, 40);
    assert!(loaded >= 4, "{loaded}");
    assert_eq!(counted.count_total, 0);
}
