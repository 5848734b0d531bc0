//! Payloads: found, located, told apart from friction, and estimated; on a simulated robot and on
//! recordings of a real one.

use super::{SEVEN_AXIS, SUBSTEPS, at_1_khz, robot, ur10e, ur10e_rows};
use thetabus::robot::{
    CarriedPayload, ChangeCause, IdentifyOptions, JointFriction, PayloadChange, RobotChange, RobotIdentifier,
    RobotModel, RobotSample, RobotSimOptions, RobotSimulator, SimulatedDrive, Velocities, is_physical,
};

/// Changes found in a run, and the payload after each block.
struct Found {
    changes: Vec<RobotChange>,
    carried: Vec<(f64, Option<CarriedPayload>)>,
}

fn run(identifier: &mut RobotIdentifier, samples: impl IntoIterator<Item = RobotSample>) -> Found {
    let mut found = Found {
        changes: Vec::new(),
        carried: Vec::new(),
    };
    for sample in samples {
        if identifier.push(&sample).unwrap() {
            found.changes.extend(identifier.change());
            if identifier.is_loaded() {
                found.carried.push((sample.t_s, identifier.carried()));
            }
        }
    }
    for (t_s, carried) in &found.carried {
        if let Some(carried) = carried {
            assert!(is_physical(&carried.body), "at {t_s} s: {:?}", carried.body);
        }
    }
    found
}

impl Found {
    fn mass(&self, t_s: f64) -> f64 {
        let at = self.carried.iter().find(|(t, _)| *t >= t_s);
        at.and_then(|(_, carried)| *carried).expect("a payload").values[0]
    }

    fn of(&self, cause: ChangeCause) -> Vec<RobotChange> {
        self.changes
            .iter()
            .copied()
            .filter(|change| change.cause == cause)
            .collect()
    }
}

fn seven_axis() -> RobotIdentifier {
    let (friction, windows) = at_1_khz(7);
    let model = RobotModel::new(robot(SEVEN_AXIS), true, friction).unwrap();
    let options = IdentifyOptions {
        windows,
        formed_over_s: Some(0.02),
        friction_walk: 0.0,
        // the simulated encoders have the zeros of the URDF
        zero_rad: 0.0,
        payload: true,
        ..IdentifyOptions::default()
    };
    RobotIdentifier::new(model, options).unwrap()
}

/// Samples of the simulated arm at 1 kHz: 16-bit encoders, velocities from positions, torque noise
/// of 0.5 % of the range.
fn simulated(options: RobotSimOptions, seconds: usize) -> Vec<RobotSample> {
    let mut velocities = Velocities::new(20, 0.01);
    RobotSimulator::new(&robot(SEVEN_AXIS), options)
        .unwrap()
        .take(1000 * seconds)
        .enumerate()
        .filter_map(|(k, sample)| {
            velocities.push(&RobotSample {
                t_s: 1e-3 * k as f64,
                q: sample.q,
                dq: sample.dq,
                tau: sample.input,
            })
        })
        .collect()
}

fn load(t_s: f64) -> PayloadChange {
    PayloadChange {
        t_s,
        mass_kg: 3.0,
        center_m: [0.02, 0.01, 0.08],
        inertia_kg_m2: [0.01, 0.0, 0.012, 0.0, 0.0, 0.008],
    }
}

#[test]
fn ident_a_payload_of_3_kg_is_located_within_50_ms_and_weighed_and_its_removal_is_found() {
    for seed in 1..=3 {
        let robot = robot(SEVEN_AXIS);
        let gone = PayloadChange {
            t_s: 26.0,
            mass_kg: 0.0,
            center_m: [0.0; 3],
            inertia_kg_m2: [0.0; 6],
        };
        let options = RobotSimOptions {
            seed,
            machine_seed: seed,
            difference: 0.15,
            payloads: vec![load(20.0), gone],
            substeps: SUBSTEPS,
            ..RobotSimOptions::new(&robot)
        };
        let mut identifier = seven_axis();
        let found = run(&mut identifier, simulated(options, 30));
        println!("seed {seed}: {:?}", found.changes);
        let changes = found.of(ChangeCause::Payload);
        assert_eq!((changes.len(), found.changes.len()), (2, 2), "{:?}", found.changes);
        for (change, t_s) in changes.iter().zip([20.0, 26.0]) {
            assert!((change.t_s - t_s).abs() <= 0.05, "located at {} s", change.t_s);
            assert!(change.found_s - t_s < 1.3, "found at {} s", change.found_s);
        }
        let (early, late) = (found.mass(22.0), found.mass(25.0));
        println!("seed {seed}: {early:.3} kg after 2 s, {late:.3} kg after 5 s");
        assert!((early - 3.0).abs() < 0.1 && (late - 3.0).abs() < 0.03, "{early} {late}");
        assert!(!identifier.is_loaded());
    }
}

/// Without a payload none is found, and the arm's parameters are as accurate as without the search
/// for one.
#[test]
fn ident_an_arm_without_payload_raises_no_alarm_and_its_intervals_hold() {
    let (mut inside, mut count, mut worst) = (0.0, 0.0, 0.0_f64);
    for seed in 1..=4 {
        let robot = robot(SEVEN_AXIS);
        let options = RobotSimOptions {
            seed,
            machine_seed: 10 + seed,
            difference: 0.15,
            substeps: SUBSTEPS,
            ..RobotSimOptions::new(&robot)
        };
        let mut identifier = seven_axis();
        let simulator = RobotSimulator::new(&robot, options.clone()).unwrap();
        let truth = simulator.truth(identifier.model(), 0.0);
        let found = run(&mut identifier, simulated(options, 60));
        assert!(found.changes.is_empty(), "{:?}", found.changes);
        for i in 0..identifier.model().parameters().len() {
            let (error, std) = (identifier.theta()[i] - truth[i], identifier.theta_std(i));
            // What the motion excites: known to 0.2 % by its own standard deviation.
            if std < 0.002 * truth[i].abs() {
                worst = worst.max((error / truth[i]).abs());
            }
            count += 1.0;
            inside += f64::from(u8::from(error.abs() < 1.96 * std));
        }
    }
    println!(
        "worst of what is excited: {:.3} %; 95 % intervals hold in {:.1} %",
        100.0 * worst,
        100.0 * inside / count
    );
    assert!(worst < 0.005, "{worst}");
    assert!((0.90..=0.995).contains(&(inside / count)), "{}", inside / count);
}

#[test]
fn fault_friction_that_changes_is_no_payload() {
    let robot = robot(SEVEN_AXIS);
    let options = RobotSimOptions {
        seed: 5,
        difference: 0.1,
        substeps: SUBSTEPS,
        ..RobotSimOptions::new(&robot)
    };
    // The second half is of a machine whose drive 4 rubs twice as much.
    let mut rubbing = options.clone();
    rubbing.drives[3] = SimulatedDrive {
        coulomb: 2.0 * options.drives[3].coulomb,
        viscous: 1.5 * options.drives[3].viscous,
        ..options.drives[3]
    };
    let before = simulated(options, 20);
    let behind = simulated(rubbing, 26);
    let spliced = before.into_iter().chain(behind.into_iter().skip(20_000));
    let mut identifier = seven_axis();
    let found = run(&mut identifier, spliced);
    println!("{:?}", found.changes);
    assert!(found.of(ChangeCause::Payload).is_empty(), "{:?}", found.changes);
    assert!(!found.of(ChangeCause::Friction).is_empty());
    assert!((found.changes[0].t_s - 20.0).abs() < 0.3 && !identifier.is_loaded());
}

/// One recording after the other, a second later; also the index at which the second begins.
fn spliced(parts: [Vec<RobotSample>; 2]) -> (Vec<RobotSample>, f64) {
    let mut all: Vec<RobotSample> = Vec::new();
    let mut border = 0.0;
    for part in parts {
        let begin = all.last().map_or(0.0, |last| last.t_s + 1.0);
        border = begin;
        let first = part[0].t_s;
        all.extend(part.iter().map(|sample| RobotSample {
            t_s: begin + sample.t_s - first,
            ..*sample
        }));
    }
    (all, border)
}

fn ur10e_identifier() -> Option<RobotIdentifier> {
    let model = RobotModel::new(ur10e()?, true, vec![JointFriction::default(); 6]).unwrap();
    let options = IdentifyOptions {
        payload: true,
        ..IdentifyOptions::default()
    };
    Some(RobotIdentifier::new(model, options).unwrap())
}

#[test]
fn val_a_load_of_a_real_robot_is_found_within_a_second_and_a_half_of_motion() {
    let (Some(empty), Some(loaded), Some(mut identifier)) = (
        ur10e_rows("empty_14harm.csv", 195..4967),
        ur10e_rows("load_14harm.csv", 308..5072),
        ur10e_identifier(),
    ) else {
        return;
    };
    let (log, border) = spliced([empty, loaded]);
    let found = run(&mut identifier, log);
    let changes = found.of(ChangeCause::Payload);
    assert_eq!(changes.len(), 1, "{:?}", found.changes);
    let last = found
        .carried
        .last()
        .and_then(|(_, carried)| *carried)
        .expect("a payload");
    println!(
        "alarm {:.2} s after motion began, finally {:.3?} ± {:.3?}",
        changes[0].found_s - border,
        last.values,
        last.std
    );
    assert!(changes[0].found_s - border < 1.5);
    let early = found.mass(border + 5.0);
    println!("{early:.3} kg after 6 s");
    assert!((early / last.values[0] - 1.0).abs() < 0.1, "{early}");
    // 2.805 kg is true; the published torque constants make it 3.06 to 3.09.
    assert!((2.9..3.2).contains(&last.values[0]), "{:?}", last.values);
}

#[test]
fn val_another_empty_recording_raises_no_payload_alarm_and_weighs_nothing() {
    let (Some(one), Some(other)) = (
        ur10e_rows("empty_14harm.csv", 195..4967),
        ur10e_rows("empty_15harm.csv", 300..5001),
    ) else {
        return;
    };
    for parts in [[one.clone(), other.clone()], [other, one]] {
        let Some(mut identifier) = ur10e_identifier() else {
            return;
        };
        let (log, border) = spliced(parts);
        let at = log.partition_point(|sample| sample.t_s < border);
        let found = run(&mut identifier.clone(), log.clone());
        assert!(found.of(ChangeCause::Payload).is_empty(), "{:?}", found.changes);
        // The payload is set free at the border: its mass in the other recording.
        run(&mut identifier, log[..at].iter().copied());
        let first = identifier.model().parameters().len();
        identifier.free(first);
        run(&mut identifier, log[at..].iter().copied());
        println!(
            "{:.3} ± {:.3} kg",
            identifier.theta()[first],
            identifier.theta_std(first)
        );
        assert!(identifier.theta()[first].abs() < 0.08);
    }
}
