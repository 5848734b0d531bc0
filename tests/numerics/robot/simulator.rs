//! The simulated robot against energy, rest and the regressors, none of which it uses.

use super::{SEVEN_AXIS, SIX_AXIS, robot};
use thetabus::robot::{
    BodyParameters, EnergyRegressors, FrictionTerm, IdentifyOptions, JointFriction, MotionLimits, Motions,
    PayloadChange, Reference, Robot, RobotController, RobotIdentifier, RobotModel, RobotSample, RobotSimOptions,
    RobotSimulator, SimulatedDrive, inverse_dynamics,
};

fn exact(robot: &Robot) -> RobotSimOptions {
    RobotSimOptions {
        encoder_bits: 0,
        has_velocity: true,
        torque_noise: 0.0,
        ..RobotSimOptions::new(robot)
    }
}

/// T by momentum, ½ q̇·p.
fn kinetic(robot: &Robot, bodies: &[BodyParameters], rotors: &[f64], q: &[f64], dq: &[f64]) -> f64 {
    let mut regressors = EnergyRegressors::new(robot.len());
    regressors.evaluate(robot, q, dq);
    (0..robot.len())
        .map(|i| {
            let row = regressors.momentum(i).iter();
            let p: f64 = row.zip(bodies.iter().flat_map(|body| body.0)).map(|(y, x)| y * x).sum();
            0.5 * dq[i] * (p + rotors[i] * dq[i])
        })
        .sum()
}

/// The change of kinetic energy is the work of torque, gravity and friction; trapezoids over 0.25
/// ms leave 1e-5 of it.
#[test]
fn prop_work_becomes_kinetic_energy() {
    for urdf in [SIX_AXIS, SEVEN_AXIS] {
        let robot = robot(urdf);
        let n = robot.len();
        let drives = vec![
            SimulatedDrive {
                rotor_inertia: 0.1,
                ..SimulatedDrive::default()
            };
            n
        ];
        let options = RobotSimOptions {
            sample_period_s: 2.5e-4,
            substeps: 1,
            difference: 0.2,
            drives,
            ..exact(&robot)
        };
        let mut simulator = RobotSimulator::new(&robot, options).unwrap();
        let bodies = simulator.bodies().to_vec();
        let (mut work, mut before, mut size) = (0.0, [0.0; 8], 0.0_f64);
        for k in 0..20_000 {
            let (q, _) = simulator.state();
            let sample = simulator.next().unwrap();
            let (after, dq_after) = simulator.state();
            let (still, mut weight) = ([0.0; 8], [0.0; 8]);
            let mut held = vec![0.0; n];
            // The torque of the coming period: twice the mean less that of the period before; at
            // first the robot rests.
            for i in 0..n {
                held[i] = if k == 0 {
                    sample.input[i]
                } else {
                    2.0 * sample.input[i] - before[i]
                };
                before[i] = held[i];
            }
            let middle: Vec<f64> = (0..n).map(|i| 0.5 * (q[i] + after[i])).collect();
            inverse_dynamics(&robot, &bodies, &middle, &still[..n], &still[..n], &mut weight[..n]);
            for i in 0..n {
                work += (held[i] - weight[i]) * (after[i] - q[i]);
            }
            let now = kinetic(&robot, &bodies, &vec![0.1; n], &after[..n], &dq_after[..n]);
            size = size.max(now);
            if k % 2000 == 1999 {
                assert!((now - work).abs() < 2e-4 * size, "{}: {now} J is {work} J", robot.name);
            }
        }
        assert!(size > 0.1, "it moves: {size} J");
    }
}

#[test]
fn prop_at_rest_it_rests_and_its_torque_is_its_weight() {
    let robot = robot(SIX_AXIS);
    for controller in [RobotController::ComputedTorque, RobotController::Pd] {
        let options = RobotSimOptions {
            motions: Motions::Rest,
            controller,
            ..exact(&robot)
        };
        let mut simulator = RobotSimulator::new(&robot, options).unwrap();
        let (start, _) = simulator.state();
        let last = simulator.by_ref().take(1000).last().unwrap();
        let (still, mut weight) = ([0.0; 6], [0.0; 6]);
        inverse_dynamics(&robot, &robot.bodies, &start[..6], &still, &still, &mut weight);
        for i in 0..6 {
            assert!((last.q[i] - start[i]).abs() < 1e-9 && last.dq[i].abs() < 1e-9);
            assert!(
                (last.input[i] - weight[i]).abs() < 1e-6,
                "{} {}",
                last.input[i],
                weight[i]
            );
        }
    }
}

/// A brake that is heavier than the load holds it: friction sticks.
#[test]
fn prop_a_joint_that_sticks_stays() {
    let robot = robot(SIX_AXIS);
    let mut drives = SimulatedDrive::sized(&robot);
    drives.iter_mut().for_each(|drive| drive.coulomb *= 3.0);
    let options = RobotSimOptions {
        motions: Motions::Rest,
        drives,
        // The machine is heavier or lighter than its controller knows, and the controller hardly
        // pushes.
        difference: 0.1,
        bandwidth_rad_per_s: 0.01,
        controller: RobotController::Pd,
        ..exact(&robot)
    };
    let mut simulator = RobotSimulator::new(&robot, options).unwrap();
    let (start, _) = simulator.state();
    let last = simulator.by_ref().take(3000).last().unwrap();
    for i in 0..6 {
        // Presliding of 0.1 mrad, a few times.
        assert!(
            (last.q[i] - start[i]).abs() < 2e-3,
            "joint {i}: {}",
            last.q[i] - start[i]
        );
    }
}

#[test]
fn prop_motions_keep_to_their_limits_and_the_robot_to_its_motion() {
    let robot = robot(SEVEN_AXIS);
    let limits = MotionLimits::default();
    for motions in [
        Motions::Fourier {
            harmonics: 5,
            period_s: 10.0,
        },
        Motions::Moves { rest_s: 0.5 },
    ] {
        for seed in 0..3 {
            let mut reference = Reference::new(&robot, motions.clone(), limits, seed).unwrap();
            for k in 0..30_000 {
                let setpoints = reference.at(1e-3 * f64::from(k));
                for (joint, [q, dq, ddq]) in robot.joints.iter().zip(setpoints) {
                    let speed = joint.limits.velocity.unwrap();
                    assert!(q.abs() <= 1.2 + 1e-9 && dq.abs() <= speed && ddq.abs() <= 1.1 * limits.acceleration);
                }
            }
        }
        let options = RobotSimOptions {
            motions,
            ..exact(&robot)
        };
        let mut off = 0.0_f64;
        for sample in RobotSimulator::new(&robot, options).unwrap().take(8000) {
            for i in 0..7 {
                off = off.max((sample.q[i] - sample.setpoint[i]).abs());
            }
        }
        assert!(off < 0.3 && off > 0.0, "{off}");
    }
    assert!(
        Reference::new(
            &robot,
            Motions::Fourier {
                harmonics: 0,
                period_s: 1.0
            },
            limits,
            0
        )
        .is_err()
    );
    assert!(Reference::new(&robot, Motions::Rest, MotionLimits { part: 2.0, ..limits }, 0).is_err());
}

#[test]
fn fault_a_payload_that_is_no_body_is_refused_by_its_member() {
    let robot = robot(SIX_AXIS);
    let payload = PayloadChange {
        t_s: 1.0,
        mass_kg: 2.0,
        center_m: [0.0, f64::NAN, 0.1],
        inertia_kg_m2: [0.01, 0.0, 0.01, 0.0, 0.0, 0.01],
    };
    let options = RobotSimOptions {
        payloads: vec![payload],
        ..RobotSimOptions::new(&robot)
    };
    let error = RobotSimulator::new(&robot, options).unwrap_err();
    assert_eq!(
        error.to_string(),
        "payload: center_m: expected finite numbers, got [0.0, NaN, 0.1]"
    );
}

#[test]
fn prop_the_same_seed_gives_the_same_bits_and_another_one_others() {
    let robot = robot(SIX_AXIS);
    let run = |seed| {
        let options = RobotSimOptions {
            seed,
            difference: 0.1,
            ..RobotSimOptions::new(&robot)
        };
        RobotSimulator::new(&robot, options)
            .unwrap()
            .take(500)
            .collect::<Vec<_>>()
    };
    assert_eq!(run(3), run(3));
    assert_ne!(run(3), run(4));
}

/// Exact samples of the simulated robot fit the weak rows of the true parameters, with a payload
/// from the beginning.
#[test]
fn val_the_regressors_explain_the_simulated_torque() {
    let robot = robot(SEVEN_AXIS);
    let payload = PayloadChange {
        t_s: 0.0,
        mass_kg: 2.0,
        center_m: [0.02, -0.01, 0.08],
        inertia_kg_m2: [0.004, 0.0, 0.004, 0.0, 0.0, 0.003],
    };
    let options = RobotSimOptions {
        difference: 0.2,
        payloads: vec![payload],
        ..exact(&robot)
    };
    let simulator = RobotSimulator::new(&robot, options.clone()).unwrap();
    let mut true_robot = robot.clone();
    true_robot.bodies = simulator.bodies().to_vec();
    true_robot.bodies[6] = true_robot.bodies[6].plus(&payload.body().moved(&robot.flange));
    let friction = JointFriction {
        terms: vec![FrictionTerm::Viscous, FrictionTerm::Coulomb, FrictionTerm::Offset],
        presliding: options.presliding,
        ..JointFriction::default()
    };
    let model = RobotModel::new(robot.clone(), true, vec![friction; 7]).unwrap();
    let rotors: Vec<f64> = options.drives.iter().map(|drive| drive.rotor_inertia).collect();
    let mut theta = model.base().nominal(&true_robot, &rotors);
    for drive in &options.drives {
        theta.extend([drive.viscous, drive.coulomb, drive.offset]);
    }
    let mut identifier = RobotIdentifier::new(model, IdentifyOptions::default()).unwrap();
    for (k, sample) in simulator.take(30_000).enumerate() {
        let sample = RobotSample {
            t_s: 1e-3 * k as f64,
            q: sample.q,
            dq: sample.dq,
            tau: sample.input,
        };
        identifier.push(&sample).unwrap();
    }
    for (i, parameter) in identifier.model().parameters().iter().enumerate() {
        let (error, std) = (identifier.theta()[i] - theta[i], identifier.theta_std(i));
        // Windows of 0.25 s over samples of 1 ms, held torques: 1e-4 of a parameter's size.
        let tolerance = 3.0 * std + 2e-3 * theta[i].abs().max(0.05 * parameter.scale.min(1.0));
        assert!(error.abs() < tolerance, "{}: {error} ± {std}", parameter.name);
    }
}
