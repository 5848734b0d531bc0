//! The harness of the trials: its bound against an independent program, its settings against the
//! simulator.

use thetabus::config::{Config, Source};
use thetabus::estimator::BlockEstimator;
use thetabus::messages::{Estimate, ParameterSet, estimate_flags, signals};
use thetabus::model::{Manipulator, ManipulatorDerived, Plant};
use thetabus::node::block_learner::BlockLearner;
use thetabus::node::identifier::{IdentifierNode, IdentifierOptions};
use thetabus::rows::{ProjectedBlock, RowForm, structure};
use thetabus::sim::{ArmSimulator, SimOptions};
use thetabus::studies::trials::{
    Arm, CramerRaoBound, Disturbance, Motion, RandomArmSpec, Trial, TrialResult, TrialSpec, Trouble, full_cases,
    quick_cases, rest_instant,
};

pub fn sources() -> Vec<Source> {
    Config::embedded("encoder_only").into_iter().collect()
}

/// One run as `thetabus run config/encoder_only.toml --duration 21` with the sines of
/// config/default.toml and 150 kg throughout.
fn exported_run() -> SimOptions {
    let sets = [
        "plant.duration_s=21.0",
        "plant.setpoint.kind=\"sines\"",
        "plant.mass_2.t_s=[0.0]",
        "plant.mass_2.mass_kg=[150.0]",
    ];
    let config = Config::load(&sources(), &sets.map(str::to_owned)).unwrap();
    config.plant.sim
}

/// GOLDEN is what `crlb.py`, a program of its own in Python with finite differences in place of the
/// Jacobians written out here, prints for the CSV export of that run: `crlb.py SAMPLES.csv --end-s
/// 2 10 20`.
#[test]
fn val_the_bound_is_that_of_an_independent_program() {
    const GOLDEN: [(u64, [f64; 9]); 3] = [
        (
            2,
            [10.95, 0.6182, 41.14, 2.331, 0.009834, 0.1134, 0.07769, 0.007445, 0.1173],
        ),
        (
            10,
            [9.06, 0.512, 26.66, 1.533, 0.003726, 0.07681, 0.03881, 0.003244, 0.07843],
        ),
        (
            20,
            [
                8.147, 0.4611, 22.96, 1.331, 0.00264, 0.06007, 0.02799, 0.002244, 0.06065,
            ],
        ),
    ];
    let sim = exported_run();
    let lsb = std::f64::consts::TAU / 65536.0;
    let mut bound = CramerRaoBound::new(&sim, lsb / 12f64.sqrt(), 0.05);
    let theta = sim.true_theta(0.0);
    let mut samples = 0;
    for sample in ArmSimulator::new(&sim).unwrap().take(20_000) {
        // The bound follows its own integration of the same equations; 1e-6 rad are far below a
        // count.
        let [q1, q2] = bound.positions();
        assert!((q1 - sample.q[0]).abs() < lsb && (q2 - sample.q[1]).abs() < lsb);
        bound.advance([sample.setpoint[0], sample.setpoint[1]]);
        samples += 1;
        for (_, percent) in GOLDEN.iter().filter(|(end_s, _)| end_s * 1000 == samples) {
            for (i, std) in bound.std().iter().enumerate() {
                let got = 100.0 * std / theta[i];
                // The program prints four digits.
                assert!(
                    (got / percent[i] - 1.0).abs() < 1e-3,
                    "theta_{} after {samples} samples: {got} %, expected {} %",
                    i + 1,
                    percent[i]
                );
            }
        }
    }
}

/// Every machine stays within its range: 2.2 rad of overshoot leave no doubt that a loop has become
/// unstable.
#[test]
fn prop_every_arm_is_stable_at_every_period_with_every_motion() {
    for arm in Arm::ALL {
        for period_us in [500, 1000, 2000] {
            for motion in Motion::ALL {
                let spec = TrialSpec {
                    arm,
                    period_us,
                    blocks: 20,
                    ..TrialSpec::new(motion, 5)
                };
                let config = Config::load(&sources(), &spec.settings()).unwrap();
                let sim = config.plant.sim;
                let mut last = [0.0; 2];
                let mut seen = 0;
                for sample in ArmSimulator::new(&sim).unwrap().take(sim.sample_count() as usize) {
                    let [q1, q2] = [sample.q[0], sample.q[1]];
                    assert!(
                        q1.abs() < 2.2 && q2.abs() < 2.2,
                        "{:?} {:?} {period_us} µs: at {q1}, {q2} rad after {seen} samples",
                        spec.arm,
                        spec.motion
                    );
                    last = [q1 - sample.setpoint[0], q2 - sample.setpoint[1]];
                    seen += 1;
                }
                assert_eq!(seen, sim.sample_count(), "{last:?}");
            }
        }
    }
}

/// A trial of ten blocks whose estimates go through `change` before they are scored, with the truth
/// at their ends.
fn scored(change: impl Fn(&mut Estimate, &[f64; 9])) -> TrialResult {
    let spec = TrialSpec {
        blocks: 10,
        ..TrialSpec::new(Motion::Steps, 2)
    };
    let config = Config::load(&sources(), &spec.settings()).unwrap();
    let plant = Manipulator::default();
    let RowForm::Projected(rows) = config.identifier.rows else {
        panic!("encoder_only has projected rows");
    };
    let options = &config.estimator.options;
    let rows = ProjectedBlock::new(plant, rows, 1900).and_then(|rows| rows.starting_at(&options.theta_start()));
    let estimator = BlockEstimator::new(structure(&plant), options.clone()).unwrap();
    let derived = ManipulatorDerived::new(config.known.unwrap()).unwrap();
    let node_options = IdentifierOptions {
        sample_period_ns: 1_000_000,
        ..IdentifierOptions::new(1900, 2, signals::Q | signals::INPUT)
    };
    let learner = BlockLearner::new(rows.unwrap(), estimator, Some(Box::new(derived)));
    let mut node = IdentifierNode::new(node_options, learner, 1);
    let names: Vec<String> = plant.parameters().iter().map(|p| p.name.to_string()).collect();
    let sim = &config.plant.sim;
    let trial = Trial {
        sim,
        block_len: 1900,
        names: &names,
        known: config.known,
    };
    let publish = |estimate: &Estimate| {
        let mut changed = *estimate;
        change(&mut changed, &sim.true_theta(estimate.t_last_ns as f64 * 1e-9));
        changed
    };
    trial
        .run(|sample, estimates| node.on_sample(sample, &mut |estimate| estimates.push(publish(estimate))))
        .unwrap()
}

/// Publishes the truth with σ of 0.1 % and everything usable.
fn perfect(estimate: &mut Estimate, truth: &[f64; 9]) {
    estimate.theta[..9].copy_from_slice(truth);
    for i in 0..9 {
        estimate.theta_std[i] = 1e-3 * truth[i].abs();
    }
    estimate.derived_len = 0;
    estimate.flags = 0;
    (estimate.use_ok, estimate.usable, estimate.excited) = (1, (0..9).collect(), (0..9).collect());
}

#[test]
fn prop_the_score_tells_the_truth_from_lies() {
    let honest = scored(perfect);
    assert_eq!((honest.blocks, honest.dangerous, honest.false_alarms), (10, 0, 0));
    // Blocks 6 to 10; block 6 holds the change, and is not quiet.
    assert_eq!((honest.usable, honest.excited), (45, 45));
    let of_all = |result: &TrialResult, value: fn(&thetabus::studies::trials::ParameterScore) -> u64| {
        result.parameters.iter().map(value).sum::<u64>()
    };
    assert_eq!(
        (of_all(&honest, |p| p.covered), of_all(&honest, |p| p.intervals)),
        (36, 36)
    );
    assert_eq!((honest.changes, honest.detected), (1, 0));
    assert!(
        honest
            .parameters
            .iter()
            .all(|p| p.squared_ratio == 0.0 && p.end_error == 0.0)
    );
    assert!(
        honest.parameters[6].marks == 3,
        "gravity shows theta_7 from the first block on"
    );

    // 6 σ and 0.6 %: dangerous, and only if it is usable and may be used.
    let off = |share: f64, std: f64, usable: u128, use_ok: u32| {
        scored(move |estimate, truth| {
            perfect(estimate, truth);
            estimate.theta[6] = truth[6] * (1.0 + share);
            estimate.theta_std[6] = std * truth[6];
            (estimate.usable, estimate.use_ok) = (ParameterSet::from_bits(usable), use_ok);
        })
    };
    let lie = off(0.006, 1e-3, 511, 1);
    assert_eq!(lie.dangerous, 10);
    let worst = lie.worst.unwrap();
    assert_eq!(worst.name, "theta_7");
    assert!((worst.sigmas - 6.0).abs() < 1e-6 && (worst.error - 0.006).abs() < 1e-9);
    for (share, std, usable, use_ok, why) in [
        (0.006, 1e-3, 511 - 64, 1, "not usable"),
        (0.006, 1e-3, 511, 0, "use_ok is 0"),
        (0.006, 1.3e-3, 511, 1, "4.6 sigma"),
        (0.004, 1e-5, 511, 1, "below half a per cent"),
    ] {
        assert_eq!(off(share, std, usable, use_ok).dangerous, 0, "{why}");
    }

    // Alarms in every block: those in the block of the change and in the next one are not false.
    let alarmed = scored(|estimate, truth| {
        perfect(estimate, truth);
        estimate.flags |= estimate_flags::CHANGED;
    });
    assert_eq!((alarmed.false_alarms, alarmed.quiet, alarmed.detected), (8, 8, 1));
}

#[test]
fn prop_every_case_is_a_valid_configuration() {
    let mut names = std::collections::BTreeSet::new();
    for case in full_cases() {
        assert!(names.insert(case.name()), "{} is there twice", case.name());
    }
    for case in quick_cases().into_iter().chain(full_cases().into_iter().step_by(7)) {
        let basis: Vec<Source> = Config::embedded(case.spec.basis()).into_iter().collect();
        let config = Config::load(&basis, &case.spec.with(3, None).settings());
        assert!(config.is_ok(), "{}: {}", case.name(), config.unwrap_err());
        assert!(case.matches(&case.spec.words()[0]) && !case.matches("no_such_word"));
    }
    for disturbance in Disturbance::MODEL {
        assert!(disturbance.cause().is_some(), "{}", disturbance.name());
    }
}

#[test]
fn prop_a_rest_is_found_at_which_neither_joint_moves() {
    let spec = TrialSpec {
        disturbance: Disturbance::AtRest,
        ..TrialSpec::new(Motion::Rests, 1)
    };
    let mut sim = Config::load(&sources(), &spec.settings()).unwrap().plant.sim;
    let at_s = rest_instant(&sim, spec.middle_s()).unwrap();
    assert!(at_s >= spec.middle_s());
    sim.sensors = thetabus::sim::SensorOptions::exact();
    let at = (at_s / 1e-3).round() as usize;
    let samples: Vec<_> = ArmSimulator::new(&sim).unwrap().take(at + 1).collect();
    assert!(
        samples[at - 500..]
            .iter()
            .all(|s| s.dq.iter().all(|dq| dq.abs() < 1e-3))
    );
}

/// A loop that becomes unstable leaves the range of the motions, and no estimate follows.
#[test]
fn prop_arms_that_seeds_draw_are_stable() {
    for trouble in [Trouble::Right, Trouble::LateChange] {
        for seed in 0..40 {
            let spec = RandomArmSpec {
                trouble,
                blocks: 20,
                seed,
            };
            let config = Config::load(&sources(), &spec.trial().settings()).unwrap();
            let sim = config.plant.sim;
            let samples = ArmSimulator::new(&sim).unwrap().take(sim.sample_count() as usize);
            let largest = samples.fold(0.0f64, |largest, sample| {
                largest.max(sample.q[0].abs()).max(sample.q[1].abs())
            });
            assert!(largest < 3.0, "{trouble:?} {seed}: at {largest} rad");
        }
    }
}
