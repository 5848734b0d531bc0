//! Designed motions: they keep their limits, are better than random ones, and identification
//! reaches the predicted errors.

use super::{SEVEN_AXIS, SIX_AXIS, robot};
use std::sync::Arc;
use thetabus::robot::{
    Excitation, ExcitationOptions, Forecaster, FrictionTerm, IdentifyOptions, JointFriction, JointRange, MotionTable,
    Motions, RobotIdentifier, RobotModel, RobotSample, RobotSimOptions, RobotSimulator, RowMisfit, Velocities,
    WindowOptions,
};

/// Friction as the simulated drives have it.
fn model(urdf: &str) -> RobotModel {
    let robot = robot(urdf);
    let friction = JointFriction {
        terms: vec![FrictionTerm::Viscous, FrictionTerm::Coulomb, FrictionTerm::Offset],
        presliding: 1e-4,
        ..JointFriction::default()
    };
    let joints = robot.len();
    RobotModel::new(robot, true, vec![friction; joints]).unwrap()
}

/// What white noise of the simulated torques makes of rows: 0.5 % of the largest torque per
/// millisecond.
fn misfit(model: &RobotModel) -> RowMisfit {
    let noise: Vec<f64> = model
        .robot()
        .joints
        .iter()
        .map(|joint| 0.005 * joint.limits.effort.unwrap())
        .collect();
    RowMisfit::white(&noise, 1e-3, &WindowOptions::default())
}

fn forecaster(model: &RobotModel) -> Forecaster {
    Forecaster::new(model.clone(), WindowOptions::default(), misfit(model)).unwrap()
}

fn options(model: &RobotModel, tries: usize) -> ExcitationOptions {
    ExcitationOptions {
        duration_s: 20.0,
        harmonics: 8,
        tries,
        ..ExcitationOptions::new(JointRange::of(model.robot(), 0.8, 1.2, 4.0))
    }
}

#[test]
fn prop_a_designed_motion_keeps_to_its_limits_and_begins_and_ends_at_rest() {
    for urdf in [SIX_AXIS, SEVEN_AXIS] {
        let model = model(urdf);
        let options = options(&model, 40);
        let motion = Excitation::design(&mut forecaster(&model), &options, &mut |_| true).unwrap();
        // Ten times as dense as the limits were looked at.
        let mut used = vec![0.0_f64; model.robot().len()];
        for k in 0..=32_000 {
            let setpoints = motion.at(20.0 * f64::from(k) / 32_000.0);
            for (j, range) in options.ranges.iter().enumerate() {
                let [q, dq, ddq] = setpoints[j];
                assert!(q >= range.lower && q <= range.upper, "joint {j}: {q}");
                assert!(
                    dq.abs() <= range.velocity && ddq.abs() <= range.acceleration,
                    "joint {j}: {dq} {ddq}"
                );
                let place = (2.0 * q - range.lower - range.upper).abs() / (range.upper - range.lower);
                used[j] = used[j]
                    .max(dq.abs() / range.velocity)
                    .max(ddq.abs() / range.acceleration)
                    .max(place);
            }
        }
        // One limit of each joint is used up to the margin between the instants, 1/cos(π/40) =
        // 1.003.
        assert!(used.iter().all(|used| *used > 0.99), "{used:?}");
        for t_s in [0.0, 20.0] {
            for setpoint in &motion.at(t_s)[..used.len()] {
                assert!(setpoint[1].abs() < 1e-9 && setpoint[2].abs() < 1e-8, "{setpoint:?}");
            }
        }
        let table = motion.table(0.01).unwrap();
        assert!(table.is_closed() && (table.duration_s() - 20.0).abs() < 1e-9);
        for (a, b) in table.at(7.123).iter().zip(motion.at(7.123)) {
            assert!((a[0] - b[0]).abs() < 1e-6 && (a[1] - b[1]).abs() < 1e-4, "{a:?} {b:?}");
        }
    }
}

#[test]
fn prop_a_designed_motion_tells_more_than_random_ones_and_is_the_same_each_time() {
    let model = model(SIX_AXIS);
    let design = |tries| Excitation::design(&mut forecaster(&model), &options(&model, tries), &mut |_| true).unwrap();
    let (short, long, again) = (design(100), design(400), design(100));
    assert_eq!(short.at(3.3), again.at(3.3));
    println!(
        "median of random motions {:.1}, 100 tries {:.1}, 400 tries {:.1} nat",
        short.random_gain, short.gain, long.gain
    );
    // A nat per ten parameters is 10 % of a standard deviation: what is worth the search.
    let worth = 0.1 * model.parameters().len() as f64;
    assert!(long.gain > long.random_gain + worth);
}

/// Positions as encoders give them, with the velocities formed from them.
fn samples(options: RobotSimOptions, seconds: f64) -> Vec<RobotSample> {
    let robot = robot(SIX_AXIS);
    let mut velocities = Velocities::new(20, 0.05);
    RobotSimulator::new(&robot, options)
        .unwrap()
        .take((1000.0 * seconds) as usize)
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

/// Prediction, simulation, identification: errors are as large as predicted, and the
/// identification's own standard deviations agree.
#[test]
fn ident_what_a_motion_promises_is_kept() {
    let model = model(SIX_AXIS);
    let motion = Excitation::design(&mut forecaster(&model), &options(&model, 300), &mut |_| true).unwrap();
    let table = MotionTable::parse(&motion.table(0.01).unwrap().to_csv(&[true; 6]), 6).unwrap();
    let promise = forecaster(&model).forecast(&table);
    let (mut square, mut count, mut ratios) = (0.0, 0.0, Vec::new());
    for seed in 1..=6 {
        let options = RobotSimOptions {
            seed,
            machine_seed: seed,
            difference: 0.15,
            motions: Motions::Table(Arc::new(table.clone())),
            ..RobotSimOptions::new(model.robot())
        };
        let truth = RobotSimulator::new(model.robot(), options.clone())
            .unwrap()
            .truth(&model, 0.0);
        let settings = IdentifyOptions {
            formed_over_s: Some(0.02),
            friction_walk: 0.0,
            // the forecast and the simulation both have exact zeros, and friction of the terms only
            zero_rad: 0.0,
            friction_shape: 0.0,
            spring_share: 0.0,
            ..IdentifyOptions::default()
        };
        let mut identifier = RobotIdentifier::new(model.clone(), settings).unwrap();
        for sample in samples(options, 20.0) {
            identifier.push(&sample).unwrap();
        }
        identifier.end_of_recording();
        for (i, promise) in promise.iter().enumerate().filter(|(_, promise)| promise.is_told) {
            let z = (identifier.theta()[i] - truth[i]) / promise.std;
            if seed == 1 {
                println!(
                    "{:10} {:9.4} promised {:.4}, said {:.4}, error {:6.2} promised",
                    model.parameters()[i].name,
                    truth[i],
                    promise.std,
                    identifier.theta_std(i),
                    z
                );
            }
            square += z * z;
            count += 1.0;
            ratios.push(identifier.theta_std(i) / promise.std);
        }
    }
    let rms = f64::sqrt(square / count);
    ratios.sort_by(f64::total_cmp);
    let median = ratios[ratios.len() / 2];
    println!(
        "errors are {rms:.2} times what was promised, rms of {count}; standard deviations {median:.2} times, median"
    );
    // Six runs of some 50 parameters, correlated among each other: chance leaves 1 ± 0.1. Encoders
    // and the controller's own following add up to a third.
    assert!((0.8..1.4).contains(&rms), "{rms}");
    // The identification assumes f = 3 at first, which a few blocks correct.
    assert!((0.9..1.5).contains(&median), "{median}");
}

#[test]
fn prop_a_motion_that_leaves_a_joint_at_rest_says_nothing_of_its_friction() {
    let model = model(SIX_AXIS);
    let motion = Excitation::design(&mut forecaster(&model), &options(&model, 20), &mut |_| true).unwrap();
    let times: Vec<f64> = (0..=2000).map(|k| 0.01 * f64::from(k)).collect();
    let postures: Vec<[f64; 8]> = times
        .iter()
        .map(|t_s| {
            let mut q = motion.at(*t_s).map(|setpoint| setpoint[0]);
            q[5] = 0.3;
            q
        })
        .collect();
    let forecast = forecaster(&model).forecast(&MotionTable::new(6, &times, &postures).unwrap());
    for (i, parameter) in model.parameters().iter().enumerate() {
        let of_six = ["viscous_6", "coulomb_6", "Izz6"].contains(&parameter.name.as_str());
        if of_six {
            assert!(!forecast[i].is_told, "{}: {:?}", parameter.name, forecast[i]);
        }
        if parameter.name.ends_with("_2") {
            assert!(forecast[i].is_told, "{}: {:?}", parameter.name, forecast[i]);
        }
    }
}

#[test]
fn fault_options_of_a_motion_are_refused_by_name() {
    let model = model(SIX_AXIS);
    let good = options(&model, 4);
    let mut narrow = good.clone();
    narrow.ranges[2].upper = narrow.ranges[2].lower;
    let mut weak = good.clone();
    weak.ranges[1].effort = 0.5;
    let with = |change: &dyn Fn(&mut ExcitationOptions)| {
        let mut options = good.clone();
        change(&mut options);
        options
    };
    for (options, said) in [
        (with(&|o| o.harmonics = 1), "harmonics: expected 2 to 50, got 1"),
        (
            with(&|o| o.duration_s = f64::NAN),
            "duration: expected 1 to 600, got NaN",
        ),
        (with(&|o| o.tries = 0), "tries: expected 1"),
        (
            with(&|o| _ = o.ranges.pop()),
            "expected one for each of 6 joints, got 5",
        ),
        (narrow, "limits of joint \"joint_3\": expected a finite lower below"),
        (
            with(&|o| o.ranges[2].acceleration = -1.0),
            "limits of joint \"joint_3\": acceleration: expected a number above 0, got -1",
        ),
        (
            with(&|o| o.ranges[2].effort = f64::NAN),
            "effort: expected a number above 0, got NaN",
        ),
        (weak, "torques of joint \"joint_2\" up to 0.5"),
    ] {
        let error = Excitation::design(&mut forecaster(&model), &options, &mut |_| true).unwrap_err();
        assert!(error.to_string().contains(said), "{error}");
    }
}
