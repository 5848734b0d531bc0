//! A robot's samples become estimates without allocation.

use thetabus::robot::{IdentifyOptions, JointFriction, Robot, RobotIdentifier, RobotModel, RobotSample, Selection};

/// Nine seconds at 100 Hz, through settling, walking friction, a pause and a refused sample.
#[test]
fn rt_a_robots_samples_become_estimates_without_allocation() {
    let urdf = include_str!("../../config/robots/seven_axis.urdf");
    let robot = Robot::from_urdf(urdf, &Selection::default()).unwrap();
    let model = RobotModel::new(robot, true, vec![JointFriction::default(); 7]).unwrap();
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
                (sample.q[i], sample.dq[i], sample.tau[i]) = ((w * t_s).sin(), w * (w * t_s).cos(), (w * t_s).cos());
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
