//! A gravity or a zero that is wrong leaves no residual, but moments that no URDF is so wrong as to
//! have; errors of 50 % are ordinary.

use super::judge::{changed, model, simulated};
use super::unexplained::last_third;
use super::{SIX_AXIS, robot};
use std::f64::consts::FRAC_PI_2;
use thetabus::robot::{BodyParameters, Robot, RobotModel, RobotSample};

fn with(change: impl Fn(&mut Robot)) -> RobotModel {
    let mut own = robot(SIX_AXIS);
    change(&mut own);
    RobotModel::new(own, true, model(SIX_AXIS).friction().to_vec()).expect("sound")
}

fn log(seed: u64, difference: f64) -> Vec<RobotSample> {
    simulated(&model(SIX_AXIS), 40, |options| {
        (options.seed, options.machine_seed, options.difference) = (seed, seed, difference);
    })
}

#[test]
fn fault_a_wrong_gravity_or_zero_is_named_and_nothing_is_used() {
    for seed in 1..=3 {
        let log = log(seed, 0.15);
        let upward = with(|robot| robot.gravity *= -1.0);
        let in_g = with(|robot| robot.gravity /= 9.81);
        let sound = model(SIX_AXIS);
        let turned = |joint: usize| changed(&log, |s| s.q[joint] += FRAC_PI_2);
        let cases = [
            (&upward, log.clone(), "gravity moments have the opposite sign"),
            (&in_g, log.clone(), "gravity moments are some 10 times the URDF's"),
            (
                &sound,
                turned(1),
                "moments from joint 2 on are turned by some 90 degrees",
            ),
            (
                &sound,
                turned(2),
                "moments from joint 3 on are turned by some 90 degrees",
            ),
        ];
        for (model, log, words) in cases {
            let (usable, misfits, said) = last_third(model, &log);
            println!("seed {seed}: {usable} {misfits} {said:?}");
            assert!(usable == 0 && misfits > 10, "{words}, seed {seed}: {usable} {misfits}");
            assert!(said.iter().any(|line| line.contains(words)), "{words}: {said:#?}");
        }
    }
}

/// Bodies that differ from the URDF by up to half, a URDF whose masses are placeholders, and torques
/// in another unit.
#[test]
fn prop_honest_errors_of_the_urdf_are_no_contradiction() {
    for seed in 1..=6 {
        let (_, misfits, said) = last_third(&model(SIX_AXIS), &log(seed, 0.5));
        assert!(misfits <= 1 && said.is_empty(), "seed {seed}: {misfits} {said:#?}");
    }
    let log = log(1, 0.15);
    for factor in [1e-3, 0.1] {
        let light = with(|robot| {
            for body in &mut robot.bodies {
                *body = BodyParameters(body.0.map(|x| factor * x));
            }
        });
        // what a machine can have is sized by the URDF, so that a thousandth of it explains little
        let (_, _, said) = last_third(&light, &log);
        let blames = |line: &String| line.contains("gravity") || line.contains(" degrees ");
        assert!(!said.iter().any(blames), "{factor}: {said:#?}");
    }
}
