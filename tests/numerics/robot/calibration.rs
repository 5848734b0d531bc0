//! Known loads: gains of the drives from one, and what the flange carries by declaration.

use super::{SIX_AXIS, SUBSTEPS, robot, ur10e, ur10e_recording, ur10e_rows};
use thetabus::robot::{
    ChangeCause, FrictionTerm, GainCalibration, IdentifyOptions, JointFriction, KnownLoad, PayloadChange,
    RobotIdentifier, RobotModel, RobotSample, RobotSimOptions, RobotSimulator, Velocities, declared_load,
};

const LOAD: PayloadChange = PayloadChange {
    t_s: 0.0,
    mass_kg: 2.0,
    center_m: [0.02, -0.01, 0.06],
    inertia_kg_m2: [0.006, 0.0, 0.007, 0.0, 0.0, 0.004],
};

fn model() -> RobotModel {
    let friction = JointFriction {
        terms: vec![FrictionTerm::Viscous, FrictionTerm::Coulomb, FrictionTerm::Offset],
        presliding: 1e-4,
        ..JointFriction::default()
    };
    RobotModel::new(robot(SIX_AXIS), true, vec![friction; 6]).unwrap()
}

/// The simulated six-axis arm for `seconds`; the torques have gains that are wrong by the factors
/// `gains`.
fn samples(payloads: Vec<PayloadChange>, seed: u64, seconds: f64, gains: [f64; 6]) -> Vec<RobotSample> {
    let robot = robot(SIX_AXIS);
    let options = RobotSimOptions {
        seed,
        machine_seed: 4,
        difference: 0.15,
        payloads,
        substeps: SUBSTEPS,
        ..RobotSimOptions::new(&robot)
    };
    let mut velocities = Velocities::new(20, 0.05);
    RobotSimulator::new(&robot, options)
        .unwrap()
        .take((1000.0 * seconds) as usize)
        .enumerate()
        .filter_map(|(k, sample)| {
            let mut tau = sample.input;
            tau.iter_mut().zip(gains).for_each(|(tau, gain)| *tau *= gain);
            velocities.push(&RobotSample {
                t_s: 1e-3 * k as f64,
                q: sample.q,
                dq: sample.dq,
                tau,
            })
        })
        .collect()
}

#[test]
fn ident_gains_are_found_from_a_known_load() {
    // What identification sees is the torque times these; the gains are to be divided by them.
    let wrong = [1.12, 1.06, 1.09, 1.15, 1.02, 1.1];
    let options = IdentifyOptions {
        friction_walk: 0.0,
        ..IdentifyOptions::default()
    };
    let empty = samples(Vec::new(), 1, 30.0, wrong);
    let loaded = samples(vec![LOAD], 2, 30.0, wrong);
    for is_known in [true, false] {
        let load = KnownLoad {
            mass_kg: LOAD.mass_kg,
            center_m: is_known.then_some(LOAD.center_m),
            inertia_kg_m2: is_known.then_some(LOAD.inertia_kg_m2),
        };
        let found = GainCalibration::of(&model(), &options, &empty, &loaded, &load).unwrap();
        println!("centre known: {is_known}: {found:.4?}");
        for j in 0..6 {
            let off = (found.factor[j] * wrong[j] - 1.0).abs();
            // Three standard deviations and half a per cent for encoders and friction that sticks.
            assert!(
                off < 3.0 * found.factor_std[j] + 0.005,
                "joint {}: {off} {found:?}",
                j + 1
            );
        }
        // Joints 2 and 3 bear the load's weight.
        assert!(
            found.factor_std[1] < 0.02 && found.factor_std[2] < 0.02 && found.mass_std < 0.02,
            "{found:?}"
        );
        for (found, truth) in found.center_m.iter().zip(LOAD.center_m) {
            assert!((found - truth).abs() < 0.01, "{found} {truth}");
        }
    }
    // the load in neither recording, and masses that it does not have
    let known = |mass_kg| KnownLoad {
        mass_kg,
        center_m: None,
        inertia_kg_m2: None,
    };
    let right = known(LOAD.mass_kg);
    for (first, second, load) in [
        (&empty, &empty, right),
        (&empty, &loaded, known(1e3)),
        (&empty, &loaded, known(1e-3)),
    ] {
        let error = GainCalibration::of(&model(), &options, first, second, &load).unwrap_err();
        assert!(
            error.to_string().contains("is the load on the flange in the second"),
            "{error}"
        );
    }
    let none = KnownLoad {
        mass_kg: -1.0,
        center_m: None,
        inertia_kg_m2: None,
    };
    assert!(
        GainCalibration::of(&model(), &options, &empty, &loaded, &none)
            .unwrap_err()
            .to_string()
            .contains("a finite number above 0, got -1")
    );
    let still = &loaded[..2];
    let load = KnownLoad { mass_kg: 2.0, ..none };
    let error = GainCalibration::of(&model(), &options, &empty, still, &load).unwrap_err();
    assert!(
        error
            .to_string()
            .contains("with load: expected at least a second of motion"),
        "{error}"
    );
}

fn identifier(payload: bool) -> RobotIdentifier {
    let options = IdentifyOptions {
        friction_walk: 0.0,
        payload,
        ..IdentifyOptions::default()
    };
    RobotIdentifier::new(model(), options).unwrap()
}

/// An arm identified with a declared load is the arm without the load; without the declaration it
/// is not.
#[test]
fn ident_an_arm_is_learnt_with_a_load_that_was_declared() {
    let body = declared_load(LOAD.mass_kg, LOAD.center_m, Some(LOAD.inertia_kg_m2)).unwrap();
    let robot = robot(SIX_AXIS);
    let simulation = RobotSimOptions {
        machine_seed: 4,
        difference: 0.15,
        substeps: SUBSTEPS,
        ..RobotSimOptions::new(&robot)
    };
    let truth = RobotSimulator::new(&robot, simulation).unwrap().truth(&model(), 0.0);
    let log = samples(vec![LOAD], 3, 30.0, [1.0; 6]);
    let (mut z2, mut stds, mut priors) = (Vec::new(), Vec::new(), Vec::new());
    for is_declared in [true, false] {
        let mut identifier = identifier(is_declared);
        if is_declared {
            identifier.declare_payload(Some(&body));
            assert!(identifier.is_loaded());
        }
        for sample in &log {
            identifier.push(sample).unwrap();
            assert!(identifier.change().is_none(), "{:?}", identifier.change());
        }
        // The first moment of the upper arm with what it carries.
        let hz2 = identifier.parameters().iter().position(|p| p.name == "hz2").unwrap();
        let z = (identifier.theta()[hz2] - truth[hz2]) / identifier.theta_std(hz2);
        println!("declared: {is_declared}: hz2 off by {z:.2} standard deviations");
        z2.push(z);
        stds.push(identifier.theta_std(hz2));
        priors.push(identifier.prior_std(hz2));
        let carried = identifier.carried();
        assert_eq!(carried.is_some(), is_declared);
        if let Some(carried) = carried {
            assert!((carried.values[0] - 2.0).abs() < 1e-6, "{carried:?}");
        }
        // Nothing is carried any more: what was learnt of the arm stays, but for the rows of the
        // last part of a second.
        let (before, std) = (identifier.theta()[hz2], identifier.theta_std(hz2));
        identifier.declare_payload(None);
        assert!(!identifier.is_loaded());
        let (after, std_after) = (identifier.theta()[hz2], identifier.theta_std(hz2));
        assert!(
            (after - before).abs() < 0.5 * std && (std_after / std - 1.0).abs() < 0.1,
            "{before} ± {std}, {after} ± {std_after}"
        );
    }
    // It is known, and not what the URDF says.
    assert!(
        stds.iter().zip(&priors).all(|(std, prior)| *std < 0.01 * prior),
        "{stds:?} {priors:?}"
    );
    // 2 kg at the end of the arm are ten times its standard deviation and more; 4 standard
    // deviations happen once in 16 000.
    assert!(z2[0].abs() < 4.0 && z2[1].abs() > 10.0, "{z2:?}");
}

#[test]
fn ident_a_declaration_that_is_wrong_is_found_out() {
    let log = samples(vec![PayloadChange { t_s: 20.0, ..LOAD }], 5, 26.0, [1.0; 6]);
    let mut identifier = identifier(true);
    identifier.declare_payload(None);
    let mut found = Vec::new();
    for sample in &log {
        if identifier.push(sample).unwrap() {
            found.extend(identifier.change());
        }
    }
    assert!(
        found.iter().any(|change| change.cause == ChangeCause::Payload),
        "{found:?}"
    );
    assert!(identifier.is_loaded());
}

#[test]
fn fault_loads_that_cannot_exist_are_refused() {
    assert!(declared_load(0.0, [0.0; 3], None).is_err());
    assert!(declared_load(1.0, [f64::NAN, 0.0, 0.0], None).is_err());
    // Millimetres for metres.
    let heavy = declared_load(2e6, [0.0; 3], None).unwrap_err().to_string();
    assert!(heavy.contains("at most 1000000, got 2000000"), "{heavy}");
    let far = declared_load(2.8, [30.0, 150.0, 40.0], None).unwrap_err().to_string();
    assert!(
        far.contains("com: ") && far.contains("divide millimetres by 1000"),
        "{far}"
    );
    assert!(declared_load(2.8, [0.03, 0.15, 0.04], None).is_ok());
    // One principal inertia above the sum of the others.
    let error = declared_load(1.0, [0.0; 3], Some([0.1, 0.0, 0.01, 0.0, 0.0, 0.01])).unwrap_err();
    assert!(
        error.to_string().contains("each principal one below the sum"),
        "{error}"
    );
    assert!(declared_load(1.0, [0.1, 0.0, 0.0], Some([0.01, 0.0, 0.01, 0.0, 0.0, 0.01])).is_ok());
}

/// Mass of the load identified on line, after an empty recording.
fn weighed(empty: &[RobotSample], loaded: &[RobotSample], gain_std: f64) -> (f64, f64) {
    let model = RobotModel::new(ur10e().unwrap(), true, vec![JointFriction::default(); 6]).unwrap();
    let options = IdentifyOptions {
        payload: true,
        gain_std,
        ..IdentifyOptions::default()
    };
    let mut identifier = RobotIdentifier::new(model, options).unwrap();
    let begin = empty.last().unwrap().t_s + 1.0 - loaded[0].t_s;
    for sample in empty {
        identifier.push(sample).unwrap();
    }
    for sample in loaded {
        identifier
            .push(&RobotSample {
                t_s: sample.t_s + begin,
                ..*sample
            })
            .unwrap();
    }
    let carried = identifier.carried().expect("a payload");
    (carried.values[0], carried.std[0])
}

#[test]
fn val_a_real_robot_weighs_right_after_a_calibration_with_a_known_load() {
    const TRUE: f64 = 2.805;
    let (Some(empty), Some(loaded), Some(robot)) = (
        ur10e_rows("empty_14harm.csv", 195..4967),
        ur10e_rows("load_14harm.csv", 308..5072),
        ur10e(),
    ) else {
        return;
    };
    let model = RobotModel::new(robot, true, vec![JointFriction::default(); 6]).unwrap();
    let load = KnownLoad {
        mass_kg: TRUE,
        center_m: None,
        inertia_kg_m2: None,
    };
    let options = IdentifyOptions::default();
    let whole = GainCalibration::of(&model, &options, &empty, &loaded, &load).unwrap();
    println!("whole: {whole:.4?}");
    // The first half calibrates; the load is identified from the second half, after a recording of
    // another trajectory.
    let half = loaded.len() / 2;
    let first = GainCalibration::of(&model, &options, &empty, &loaded[..half], &load).unwrap();
    println!("first half: {first:.4?}");
    for (name, found, part) in [("whole", &whole, &loaded[..]), ("second half", &first, &loaded[half..])] {
        let scale = |log: &[RobotSample]| -> Vec<RobotSample> {
            let scaled = log.iter().map(|sample| {
                let mut sample = *sample;
                sample
                    .tau
                    .iter_mut()
                    .zip(&found.factor)
                    .for_each(|(tau, factor)| *tau *= factor);
                sample
            });
            scaled.collect()
        };
        for (file, rows) in [("empty_14harm.csv", 195..4967), ("empty_15harm.csv", 300..5001)] {
            let other = ur10e_recording(file, &found.factor).unwrap();
            let other = &other[rows.start - 1..rows.end - 1];
            let (mass, std) = weighed(other, &scale(part), found.mass_std);
            println!("{name} behind {file}: {mass:.3} ± {std:.3} kg");
            // Published gains: 3.05 kg. The spread between trajectories is some per cent, and the
            // standard deviation covers it.
            assert!((mass - TRUE).abs() < 0.05 * TRUE, "{mass}");
            assert!((mass - TRUE).abs() < 3.0 * std, "{mass} ± {std}");
        }
    }
}
