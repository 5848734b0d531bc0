//! Regressors, dynamics and base parameters.

use super::{SEVEN_AXIS, SIX_AXIS, robot, shared, ur10e};
use crate::support::TestRng;
use thetabus::robot::{BaseParameters, EnergyRegressors, Robot, Selection, forward_dynamics, inverse_dynamics};

/// A branched robot with each kind of joint, a tilted axis and fixed links.
const MIXED: &str = r#"<robot name="mixed">
  <link name="world"/>
  <joint name="stand" type="fixed"><parent link="world"/><child link="foot"/><origin xyz="0.1 0 0.3" rpy="0.2 -0.1 0.4"/></joint>
  <link name="foot"/>
  <joint name="slide" type="prismatic"><parent link="foot"/><child link="cart"/><axis xyz="0.6 0 0.8"/>
    <limit lower="-1" upper="1" velocity="1" effort="100"/></joint>
  <link name="cart"><inertial><origin xyz="0.1 0.02 -0.03" rpy="0.3 0.1 -0.2"/><mass value="4"/>
    <inertia ixx="0.1" ixy="0.01" ixz="-0.02" iyy="0.2" iyz="0.03" izz="0.15"/></inertial></link>
  <joint name="left" type="continuous"><parent link="cart"/><child link="left_arm"/><origin xyz="0 0.3 0.2" rpy="0.5 0.6 0.7"/><axis xyz="0 1 0"/></joint>
  <link name="left_arm"><inertial><origin xyz="0 0 0.2"/><mass value="2"/>
    <inertia ixx="0.05" ixy="0" ixz="0.004" iyy="0.06" iyz="0" izz="0.02"/></inertial></link>
  <joint name="right" type="revolute"><parent link="cart"/><child link="right_arm"/><origin xyz="0 -0.3 0.2" rpy="-0.5 0 1"/><axis xyz="1 0 0"/>
    <limit lower="-2" upper="2" velocity="1" effort="100"/></joint>
  <link name="right_arm"><inertial><origin xyz="0.05 0 0.15"/><mass value="1.5"/>
    <inertia ixx="0.03" ixy="0.001" ixz="0" iyy="0.04" iyz="0.002" izz="0.01"/></inertial></link>
  <joint name="grip" type="fixed"><parent link="right_arm"/><child link="tool"/><origin xyz="0 0.1 0.3" rpy="0 0 1.2"/></joint>
  <link name="tool"><inertial><origin xyz="0.01 0 0.05"/><mass value="0.7"/>
    <inertia ixx="0.002" ixy="0" ixz="0" iyy="0.003" iyz="0" izz="0.001"/></inertial></link>
</robot>"#;

fn mixed() -> Robot {
    let joints = ["slide", "left", "right"].map(str::to_owned).to_vec();
    let selection = Selection {
        joints: Some(joints),
        ..Selection::default()
    };
    Robot::from_urdf(MIXED, &selection).unwrap()
}

/// Y π of one joint.
fn of_bodies(row: &[f64], robot: &Robot) -> f64 {
    let parameters = robot.bodies.iter().flat_map(|body| body.0);
    row.iter().zip(parameters).map(|(y, p)| y * p).sum()
}

fn random(rng: &mut TestRng, n: usize, limit: f64) -> Vec<f64> {
    (0..n).map(|_| rng.between(-limit, limit)).collect()
}

/// The URDF's own file and golden states of another rigid-body library (PyPI `pin` 4.1.0).
#[test]
fn val_momentum_gravity_and_torque_of_the_ur10e_equal_pinocchio() {
    let (Some(robot), Some((_, golden))) = (ur10e(), shared("../reference/golden/ur10e_dynamics.csv")) else {
        return;
    };
    let mut worst = [0.0_f64; 3];
    let mut regressors = EnergyRegressors::new(6);
    for line in golden.lines().skip(1) {
        let v: Vec<f64> = line.split(',').map(|field| field.parse().unwrap()).collect();
        let [q, dq, ddq, tau, p, ctdq, g] = [0, 1, 2, 3, 4, 5, 6].map(|i| &v[6 * i..6 * i + 6]);
        regressors.evaluate(&robot, q, dq);
        let mut computed = [0.0; 6];
        inverse_dynamics(&robot, &robot.bodies, q, dq, ddq, &mut computed);
        let scale = |x: &[f64]| x.iter().fold(0.0_f64, |a, b| a.max(b.abs()));
        for i in 0..6 {
            let errors = [
                (of_bodies(regressors.momentum(i), &robot) - p[i]) / scale(p),
                // Cᵀ q̇ = ∂T/∂q, g = ∂V/∂q.
                (of_bodies(regressors.lagrangian(i), &robot) - (ctdq[i] - g[i])) / scale(ctdq).max(scale(g)),
                (computed[i] - tau[i]) / scale(tau),
            ];
            for (worst, error) in worst.iter_mut().zip(errors) {
                *worst = worst.max(error.abs());
            }
        }
    }
    println!(
        "largest relative difference of p, dL/dq, tau: {:.2e} {:.2e} {:.2e}",
        worst[0], worst[1], worst[2]
    );
    assert!(worst.iter().all(|w| *w < 1e-10), "{worst:?}");
}

/// d/dt (Y_p π) − Y_L π by central differences along q(t), against Newton and Euler's equations.
#[test]
fn val_the_regressors_along_a_motion_give_the_inverse_dynamics() {
    let mut rng = TestRng(3);
    for robot in [robot(SIX_AXIS), robot(SEVEN_AXIS), mixed()] {
        let n = robot.len();
        for _ in 0..30 {
            let (q, dq, ddq) = (
                random(&mut rng, n, 2.0),
                random(&mut rng, n, 2.0),
                random(&mut rng, n, 5.0),
            );
            let h = 1e-4;
            let mut regressors = EnergyRegressors::new(n);
            let mut momentum = |t: f64| -> Vec<f64> {
                let at: Vec<f64> = (0..n).map(|i| q[i] + t * dq[i] + 0.5 * t * t * ddq[i]).collect();
                let speed: Vec<f64> = (0..n).map(|i| dq[i] + t * ddq[i]).collect();
                regressors.evaluate(&robot, &at, &speed);
                (0..n).map(|i| of_bodies(regressors.momentum(i), &robot)).collect()
            };
            let [far, near] = [h, h / 2.0].map(|h| {
                let (after, before) = (momentum(h), momentum(-h));
                (0..n).map(|i| (after[i] - before[i]) / (2.0 * h)).collect::<Vec<_>>()
            });
            let mut tau = vec![0.0; n];
            inverse_dynamics(&robot, &robot.bodies, &q, &dq, &ddq, &mut tau);
            regressors.evaluate(&robot, &q, &dq);
            for i in 0..n {
                // Richardson's extrapolation leaves h⁴ and rounding over h: 1e-11 of the largest
                // torque per 1e-4 s.
                let rate = (4.0 * near[i] - far[i]) / 3.0;
                let error = rate - of_bodies(regressors.lagrangian(i), &robot) - tau[i];
                assert!(error.abs() < 1e-7, "joint {i} of {}: {error:e}", robot.name);
            }
            // At rest only the weight remains; about a hundred roundings of the largest.
            let (still, mut weight) = (vec![0.0; n], vec![0.0; n]);
            inverse_dynamics(&robot, &robot.bodies, &q, &still, &still, &mut tau);
            regressors.weight(&robot.bodies, &mut weight);
            let largest = tau.iter().fold(1.0f64, |largest, tau| largest.max(tau.abs()));
            for (i, (own, tau)) in weight.iter().zip(&tau).enumerate() {
                assert!(
                    (own - tau).abs() < 1e-13 * largest,
                    "joint {i} of {}: {own} and {tau}",
                    robot.name
                );
            }
        }
    }
}

/// Two algorithms that share no step: articulated bodies forwards, Newton and Euler backwards.
#[test]
fn prop_forward_dynamics_undo_inverse_dynamics() {
    let mut rng = TestRng(5);
    for robot in [robot(SIX_AXIS), robot(SEVEN_AXIS), mixed()] {
        let n = robot.len();
        for _ in 0..100 {
            let (q, dq, ddq) = (
                random(&mut rng, n, 3.0),
                random(&mut rng, n, 3.0),
                random(&mut rng, n, 20.0),
            );
            let rotor: Vec<f64> = (0..n).map(|_| rng.between(0.0, 0.2)).collect();
            let (mut tau, mut back) = (vec![0.0; n], vec![0.0; n]);
            inverse_dynamics(&robot, &robot.bodies, &q, &dq, &ddq, &mut tau);
            (0..n).for_each(|i| tau[i] += rotor[i] * ddq[i]);
            forward_dynamics(&robot, &robot.bodies, &rotor, &q, &dq, &tau, &mut back);
            for i in 0..n {
                assert!(
                    (back[i] - ddq[i]).abs() < 1e-8,
                    "joint {i} of {}: {} is {}",
                    robot.name,
                    back[i],
                    ddq[i]
                );
            }
        }
    }
}

#[test]
fn val_the_ur10e_has_36_base_parameters_of_60_and_40_of_66_with_rotors() {
    let Some(robot) = ur10e() else { return };
    for (rotors, count) in [(false, 36), (true, 40)] {
        let base = BaseParameters::of(&robot, rotors);
        println!("gap {:.1e} {:.1e}", base.gap.0, base.gap.1);
        for parameter in &base.parameters {
            println!("{}", parameter.combination());
        }
        assert_eq!(base.parameters.len(), count);
        let (kept, dropped) = base.gap;
        assert!(kept > 1e-4 && dropped < 1e-12, "{kept:e} {dropped:e}");
    }
}

/// Moves a URDF's bodies along the directions that base parameters do not see: torques must not
/// change.
#[test]
fn prop_base_parameters_say_all_that_torques_depend_on() {
    let mut rng = TestRng(11);
    for robot in [robot(SIX_AXIS), robot(SEVEN_AXIS), mixed()] {
        let n = robot.len();
        let base = BaseParameters::of(&robot, false);
        let beta = base.nominal(&robot, &vec![0.0; n]);
        // The bodies that have β on the leading parameters and nothing else.
        let mut reduced = robot.clone();
        reduced.bodies.iter_mut().for_each(|body| body.0 = [0.0; 10]);
        for (parameter, value) in base.parameters.iter().zip(&beta) {
            let thetabus::robot::Standard::Body { joint, parameter } = parameter.leading else {
                unreachable!("no rotors were asked for")
            };
            reduced.bodies[joint].0[parameter] = *value;
        }
        for _ in 0..20 {
            let (q, dq, ddq) = (
                random(&mut rng, n, 3.0),
                random(&mut rng, n, 2.0),
                random(&mut rng, n, 5.0),
            );
            let (mut all, mut few) = (vec![0.0; n], vec![0.0; n]);
            inverse_dynamics(&robot, &robot.bodies, &q, &dq, &ddq, &mut all);
            inverse_dynamics(&robot, &reduced.bodies, &q, &dq, &ddq, &mut few);
            for i in 0..n {
                assert!(
                    (all[i] - few[i]).abs() < 1e-9,
                    "joint {i} of {}: {} {}",
                    robot.name,
                    all[i],
                    few[i]
                );
            }
        }
    }
}

/// 1.5708 for π/2 makes no parameter identifiable that is not.
#[test]
fn prop_digits_of_pi_do_not_change_the_base_parameters() {
    let Some((_, text)) = shared("ur10e/ur10e.urdf") else {
        return;
    };
    let rough = text.replace("1.57079632679", "1.5708");
    assert_ne!(rough, text);
    let [fine, rough] = [&text, &rough].map(|text| {
        let base = BaseParameters::of(&robot(text), true);
        base.parameters.iter().map(|p| p.leading.name()).collect::<Vec<_>>()
    });
    assert_eq!(fine, rough);
}
