//! A gravity or a zero that is wrong leaves no residual, but moments that no URDF is so wrong as to
//! have; errors of 50 % are ordinary.

use super::judge::{changed, model, simulated};
use super::unexplained::{judged, last_third};
use super::{SIX_AXIS, robot};
use nalgebra::Vector3;
use std::f64::consts::FRAC_PI_2;
use thetabus::robot::{BodyParameters, FrictionTerm, JointFriction, Motions, Robot, RobotModel, RobotSample};

/// Two joints with vertical axes and one that lifts; and three prismatic joints.
const SCARA: &str = r#"<robot name="scara"><link name="base"/>
<joint name="j1" type="revolute"><parent link="base"/><child link="l1"/><origin xyz="0 0 0.4"/><axis xyz="0 0 1"/>
<limit lower="-2.3" upper="2.3" velocity="6" effort="80"/></joint>
<link name="l1"><inertial><origin xyz="0.17 0.01 0.03"/><mass value="8"/>
<inertia ixx="0.04" iyy="0.135" izz="0.135" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="j2" type="revolute"><parent link="l1"/><child link="l2"/><origin xyz="0.325 0 0.05"/><axis xyz="0 0 1"/>
<limit lower="-2.5" upper="2.5" velocity="8" effort="40"/></joint>
<link name="l2"><inertial><origin xyz="0.12 -0.01 0.04"/><mass value="5"/>
<inertia ixx="0.03" iyy="0.068" izz="0.0625" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="j3" type="prismatic"><parent link="l2"/><child link="l3"/><origin xyz="0.275 0 0"/><axis xyz="0 0 1"/>
<limit lower="-0.2" upper="0" velocity="1.1" effort="120"/></joint>
<link name="l3"><inertial><origin xyz="0 0 0.02"/><mass value="1.7"/>
<inertia ixx="0.006" iyy="0.006" izz="0.001" ixy="0" ixz="0" iyz="0"/></inertial></link></robot>"#;
const GANTRY: &str = r#"<robot name="gantry"><link name="base"/>
<joint name="j1" type="prismatic"><parent link="base"/><child link="l1"/><axis xyz="1 0 0"/>
<limit lower="-0.8" upper="0.8" velocity="1.5" effort="600"/></joint>
<link name="l1"><inertial><origin xyz="0 0.3 0"/><mass value="40"/>
<inertia ixx="10.4" iyy="0.8" izz="10.4" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="j2" type="prismatic"><parent link="l1"/><child link="l2"/><axis xyz="0 1 0"/>
<limit lower="-0.5" upper="0.5" velocity="1.5" effort="400"/></joint>
<link name="l2"><inertial><origin xyz="0.05 0 0.1"/><mass value="18"/>
<inertia ixx="0.36" iyy="0.36" izz="0.36" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="j3" type="prismatic"><parent link="l2"/><child link="l3"/><axis xyz="0 0 1"/>
<limit lower="-0.4" upper="0.1" velocity="1" effort="300"/></joint>
<link name="l3"><inertial><origin xyz="0 0 -0.2"/><mass value="9"/>
<inertia ixx="0.1" iyy="0.1" izz="0.16" ixy="0" ixz="0" iyz="0"/></inertial></link></robot>"#;

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

/// Where gravity sees but one moment a constant force can make up for it.
#[test]
fn fault_a_wrong_gravity_of_a_scara_or_a_gantry_is_named() {
    for (urdf, seed) in [(SCARA, 1), (SCARA, 2), (GANTRY, 1), (GANTRY, 2)] {
        let log = simulated(&model(urdf), 40, |options| {
            (options.seed, options.machine_seed, options.difference) = (seed, seed, 0.15);
        });
        let upward = Vector3::new(0.0, 0.0, 9.81);
        let cases = [
            // one moment that gravity sees does not tell its sign from that of the torque
            (upward, "sign of its torque, and gravity"),
            (-upward / 9.81, "gravity moments are some 10 times the URDF's"),
            (Vector3::new(9.81, 0.0, 0.0), "gravity seems to have the direction -z"),
            (Vector3::new(0.0, -9.81, 0.0), "gravity seems to have the direction -z"),
        ];
        for (gravity, words) in cases {
            let mut wrong = robot(urdf);
            wrong.gravity = gravity;
            let wrong = RobotModel::new(wrong, true, model(urdf).friction().to_vec()).expect("sound");
            let (usable, misfits, said) = last_third(&wrong, &log);
            assert!(
                usable == 0 && misfits > 10,
                "{gravity}, seed {seed}: {usable} {misfits}"
            );
            assert!(said.iter().any(|line| line.contains(words)), "{words}: {said:#?}");
        }
    }
}

/// A counterweight or a gas spring that carries what the joint lifts, as many vertical axes have.
#[test]
fn prop_a_balanced_vertical_axis_is_no_contradiction() {
    for (urdf, mass, seed) in [(SCARA, 1.7, 1), (GANTRY, 9.0, 2)] {
        // at 100 Hz, more terms of friction leave nothing of the SCARA known in this time
        let terms = vec![FrictionTerm::Viscous, FrictionTerm::Coulomb, FrictionTerm::Offset];
        let friction = JointFriction {
            terms,
            ..JointFriction::default()
        };
        let model = RobotModel::new(robot(urdf), true, vec![friction; 3]).expect("sound");
        for part in [0.5, 1.0, 1.3] {
            let log = simulated(&model, 80, |options| {
                (options.seed, options.machine_seed, options.difference) = (seed, seed, 0.15);
                options.drives[2].offset = -part * mass * 9.81;
            });
            let (usable, misfits, said) = last_third(&model, &log);
            assert!(
                usable > 5 && misfits <= 1 && said.is_empty(),
                "{urdf}, {part}: {usable} {misfits} {said:#?}"
            );
        }
    }
}

/// Over the whole log: by the inertia at a joint or by the moments, whichever is sure first.
#[test]
fn fault_a_wrong_sign_is_told_early() {
    type Change = fn(&mut RobotSample);
    let cases: [(&str, Change, usize); 4] = [
        (SIX_AXIS, |s| s.tau[1] *= -1.0, 2),
        (SIX_AXIS, |s| (s.q[2], s.dq[2]) = (-s.q[2], -s.dq[2]), 3),
        (SCARA, |s| s.tau[2] *= -1.0, 3),
        // the coupling makes the second link's inertia negative, and the rotor's hides it
        (
            SCARA,
            |s| (s.q[0], s.dq[0], s.tau[0]) = (-s.q[0], -s.dq[0], -s.tau[0]),
            2,
        ),
    ];
    for has_rests in [false, true] {
        for (urdf, change, joint) in cases {
            let log = simulated(&model(urdf), 30, |options| {
                (options.seed, options.machine_seed, options.difference) = (5, 5, 0.15);
                if has_rests {
                    options.motions = Motions::Moves { rest_s: 0.4 };
                }
            });
            let (usable, misfits, said) = judged(&model(urdf), &changed(&log, change), 0);
            println!("joint {joint}, rests {has_rests}: {usable} {misfits} {said:#?}");
            // a fifth of the 30 blocks may pass before it is sure, and others find nothing out
            assert!(usable <= 6 && misfits >= 10, "joint {joint}: {usable} {misfits}");
            let words = [
                format!("the inertia at joint {joint} comes out negative"),
                format!("moments from joint {joint} on are the other way round"),
                format!("torque of joint {joint} may have the opposite sign"),
                format!("the model explains little of joint {joint}'s torque"),
            ];
            let is_told = said.iter().any(|line| words.iter().any(|words| line.contains(words)));
            assert!(is_told, "joint {joint}: {said:#?}");
        }
    }
}
