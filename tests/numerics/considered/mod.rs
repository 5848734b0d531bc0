//! Effects that the model leaves out: how they change the estimate, whether σ allows for them, and
//! whether they are found.

mod recursion;

use super::support::TestRng;
use thetabus::estimator::{
    BlockEstimator, EquationNoise, EstimatorOptions, EstimatorState, Forgetting, IndexSet, ParameterPrior, Residuals,
    StateMachine, Structure, SuspectRows, Suspicion,
};
use thetabus::model::{JointSample, Manipulator, Plant};
use thetabus::rows::{
    Considered, InputTiming, ProjectedBlock, ProjectedOptions, SampleBlock, SensorNoise, SuspectKind, structure,
};
use thetabus::sim::{ArmSimulator, ControllerKind, MassSchedule, MoveProfile, Moves, Setpoint, SimOptions};

const N: u64 = 1900;

/// Effects of a machine that its model leaves out.
#[derive(Debug, Clone, Copy, Default)]
struct Wrong {
    delay_s: f64,
    /// Coulomb friction [V] at joint 1 or 2, known from the voltage that overcomes it.
    coulomb_v: [f64; 2],
    eccentricity_rad: [f64; 2],
    gain: [f64; 2],
    /// Offset of the recorded voltage [V].
    offset_v: [f64; 2],
    /// Share by which the windings' resistance rises within a minute.
    heating: f64,
}

/// Smooth motion that no table of setpoints can describe: sines of few frequencies, below the
/// resonance.
fn smooth(seed: u64) -> [Setpoint; 2] {
    let sines = |amplitude: f64| Setpoint::RandomSines {
        count: 4,
        min_frequency_hz: 0.2,
        max_frequency_hz: 1.2 + 0.01 * seed as f64,
        amplitude_rad: amplitude,
    };
    [sines(1.0), sines(0.8)]
}

fn steps() -> [Setpoint; 2] {
    let random = |limit: f64| Setpoint::Random {
        min_rad: -limit,
        max_rad: limit,
        min_dwell_s: 1.0,
        max_dwell_s: 3.0,
    };
    [random(1.0), random(0.8)]
}

/// Moves from point to point that are smooth up to the acceleration.
fn minimum_jerk() -> [Setpoint; 2] {
    [1.0, 0.8].map(|limit| {
        Setpoint::Moves(Moves {
            profile: MoveProfile::MinimumJerk,
            min_rad: -limit,
            max_rad: limit,
            min_move_s: 0.6,
            max_move_s: 1.6,
            min_rest_s: 0.0,
            max_rest_s: 0.5,
        })
    })
}

/// The same, but each takes 4 to 9 s.
fn slow_moves() -> [Setpoint; 2] {
    minimum_jerk().map(|setpoint| match setpoint {
        Setpoint::Moves(moves) => Setpoint::Moves(Moves {
            min_move_s: 4.0,
            max_move_s: 9.0,
            max_rest_s: 1.0,
            ..moves
        }),
        other => other,
    })
}

fn arm(setpoint: [Setpoint; 2], seed: u64, blocks: u64, wrong: Wrong) -> SimOptions {
    let mut sim = SimOptions::cedro2022();
    sim.duration_s = (blocks * N) as f64 * 1e-3;
    sim.setpoint = setpoint;
    sim.controller.kind = ControllerKind::Sampled;
    sim.seed = seed;
    sim.mass_2 = MassSchedule::constant(150.0);
    sim.sensors.input_delay_s = wrong.delay_s;
    sim
}

/// Result of one block.
struct Answer {
    theta: Vec<f64>,
    std: Vec<f64>,
    truth: Vec<f64>,
    usable: IndexSet,
    excited: IndexSet,
    changed: bool,
    /// Description with its size, kind and joint.
    named: Option<(String, SuspectKind, Option<usize>, Suspicion)>,
}

fn identify(sim: &SimOptions, considered: Considered, wrong: Wrong) -> Vec<Answer> {
    let plant = Manipulator::default();
    let count = std::f64::consts::TAU / 65_536.0;
    let rows = ProjectedOptions {
        timing: InputTiming::Held,
        noise: SensorNoise::encoder(16, 0.05),
        considered,
        ..ProjectedOptions::recommended()
    };
    let factors = [2.5, 0.4, 0.4, 2.5, 0.4, 2.5, 0.4, 2.5, 0.4];
    let right = sim.true_theta(0.0);
    let start: Vec<f64> = right.iter().zip(factors).map(|(t, f)| t * f).collect();
    let mut options = EstimatorOptions::recommended(start.iter().copied().map(ParameterPrior::positive), 2);
    options.forgetting_factor = 0.98;
    options.equations.fill(EquationNoise::WHITENED);
    options.drift_per_s = considered.drift_per_s;
    options.relations = plant.relations().to_vec();
    if let Some(detection) = &mut options.change_detection {
        detection.margin = 40_000_000;
        detection.false_alarm_rate = 2e-5;
    }
    let mut block = ProjectedBlock::new(plant, rows, N as usize)
        .unwrap()
        .starting_at(&start)
        .unwrap();
    let mut estimator = BlockEstimator::new(structure(&plant), options).unwrap();
    let mut answers = Vec::new();
    let mut rng = TestRng(sim.seed);
    let mut samples = ArmSimulator::new(sim).unwrap();
    let mut next = samples.next();
    for k in 0..sim.sample_count() {
        let Some(exact) = next else { break };
        next = samples.next();
        let after = next.unwrap_or(exact);
        let mut sample = JointSample::default();
        let warmer = wrong.heating * (k as f64 * 1e-3 / 60.0).min(1.0);
        for joint in 0..2 {
            let (q, dq) = (exact.q[joint], exact.dq[joint]);
            // a winding that is warmer needs so much more voltage for its current; held over a
            // sample, as the input is
            let current = exact.input[joint] - right[4 + 3 * joint] * (after.q[joint] - q) / 1e-3;
            // voltage overcomes friction and makes up for what the drive delivers too little
            let input = exact.input[joint] + warmer * current + wrong.coulomb_v[joint] * (dq / 0.005).tanh();
            sample.input[joint] = input * (1.0 - wrong.gain[joint]) + wrong.offset_v[joint] + 0.05 * rng.normal();
            sample.q[joint] = ((q + wrong.eccentricity_rad[joint] * q.sin()) / count).round() * count;
        }
        assert!(block.push(k * 1_000_000, &sample));
        if k % N == N - 1 {
            block.prepare(estimator.theta());
            let report = estimator.update(&block);
            let mut truth = right.to_vec();
            // everything of both equations but back-EMF and length has R as a factor
            [0, 1, 2, 3, 5, 6].into_iter().for_each(|i| truth[i] *= 1.0 + warmer);
            answers.push(Answer {
                theta: report.theta.clone(),
                std: report.theta_std.clone(),
                truth,
                usable: report.usable,
                excited: report.excited,
                changed: report.change.is_some(),
                named: report.suspicion.map(|s| {
                    let suspect = block.suspect(s.suspect).unwrap();
                    let mut words = String::new();
                    suspect.write(s.amplitude, &mut words).unwrap();
                    let words = format!("{words} {:.2e} {}", s.amplitude, suspect.unit);
                    (words, suspect.kind, suspect.joint, s)
                }),
            });
            block.clear();
        }
    }
    answers
}

/// Blocks with a usable parameter that is more than 5 σ and more than 0.5 % off.
fn dangerous(answers: &[Answer]) -> Vec<usize> {
    let bad = |a: &Answer, i: usize| {
        let off = (a.theta[i] - a.truth[i]).abs();
        a.usable.contains(i) && off > 5.0 * a.std[i] && off > 0.005 * a.truth[i]
    };
    (0..answers.len())
        .filter(|&b| (0..9).any(|i| bad(&answers[b], i)))
        .collect()
}

/// Usable parameters per excited one; θ₁ and θ₃ are hardly to be known through 16 bits.
fn useful(answers: &[Answer]) -> f64 {
    let knowable = |set: IndexSet| set.iter().filter(|i| ![0, 2].contains(i)).count();
    let settled = &answers[3..];
    let both = settled.iter().map(|a| knowable(a.usable.intersection(a.excited)));
    let excited = settled.iter().map(|a| knowable(a.excited));
    both.sum::<usize>() as f64 / excited.sum::<usize>() as f64
}

/// A kind of wrong model, and the name of its cause.
fn wrongs() -> Vec<(&'static str, Wrong, Option<(SuspectKind, Option<usize>)>)> {
    let none = Wrong::default();
    let delay = |delay_s: f64| Wrong { delay_s, ..none };
    let cause = |kind, joint| Some((kind, joint));
    vec![
        ("right", none, None),
        ("delay 50 us", delay(50e-6), cause(SuspectKind::InputDelay, None)),
        ("delay 150 us", delay(150e-6), cause(SuspectKind::InputDelay, None)),
        (
            "friction 2 % joint 1",
            Wrong {
                coulomb_v: [0.3, 0.0],
                ..none
            },
            cause(SuspectKind::Coulomb, Some(0)),
        ),
        (
            "friction 10 % joint 2",
            Wrong {
                coulomb_v: [0.0, 2.0],
                ..none
            },
            cause(SuspectKind::Coulomb, Some(1)),
        ),
        (
            "offset 50 mV joint 2",
            Wrong {
                offset_v: [0.0, 0.05],
                ..none
            },
            cause(SuspectKind::Offset, Some(1)),
        ),
        (
            "eccentricity 200 as joint 1",
            Wrong {
                eccentricity_rad: [1e-3, 0.0],
                ..none
            },
            cause(SuspectKind::Eccentricity, Some(0)),
        ),
        ("heating 10 %", Wrong { heating: 0.1, ..none }, None),
    ]
}

fn only(input_delay_s: f64) -> Considered {
    Considered {
        input_delay_s: Some(input_delay_s),
        ..Considered::NONE
    }
}

/// `cargo test --release --test numerics study_of_considered -- --ignored --nocapture`: the table
/// behind the defaults.
#[test]
#[ignore = "prints a table"]
fn study_of_considered_errors() {
    for smoothly in [false, true] {
        for (name, wrong, _) in wrongs() {
            for (allowed, considered) in [("default", Considered::default()), ("delay 1e-4", only(1e-4))] {
                for seed in 1..=4 {
                    let motion = if smoothly { smooth(seed) } else { steps() };
                    let answers = identify(&arm(motion, seed, 40, wrong), considered, wrong);
                    let alarms = answers.iter().filter(|a| a.changed).count();
                    let named = answers
                        .last()
                        .and_then(|a| a.named.as_ref())
                        .map_or("-".to_owned(), |(words, .., s)| {
                            format!("{words}, share {:.2}", s.share)
                        });
                    println!(
                        "smooth {smoothly}, {name}, considered {allowed}, seed {seed}: dangerous {:?}, alarms {alarms}, useful {:.2}: {named}",
                        dangerous(&answers),
                        useful(&answers)
                    );
                }
            }
        }
    }
}

/// The load is held with 1.3 V, and slow moves need little more. An offset of 20 mV is 1.5 % of
/// that, and 0.1 % of the input's root mean square would be 3 mV.
#[test]
fn fault_an_offset_in_slow_motion_makes_no_weight_confidently_wrong() {
    let wrong = Wrong {
        offset_v: [0.0, 0.03],
        ..Wrong::default()
    };
    for seed in 1..=4 {
        let answers = identify(&arm(slow_moves(), seed, 16, wrong), Considered::default(), wrong);
        let weight = |answer: &Answer| (answer.theta[6] - answer.truth[6]) / answer.std[6];
        let largest = answers.iter().map(|answer| weight(answer).abs()).fold(0.0, f64::max);
        println!(
            "seed {seed}: dangerous {:?}, theta_7 {largest:.1} σ off",
            dangerous(&answers)
        );
        assert!(dangerous(&answers).is_empty(), "seed {seed}");
    }
}

#[test]
fn prop_the_defaults_leave_a_right_model_useful_and_name_nothing() {
    for seed in 1..=3 {
        let sim = arm(steps(), seed, 25, Wrong::default());
        let answers = identify(&sim, Considered::default(), Wrong::default());
        let without = identify(&sim, Considered::NONE, Wrong::default());
        // no motion tells friction from back EMF, θ₅ and θ₈
        let others = (0..9).filter(|i| ![4, 7].contains(i));
        let ratio = others.map(|i| answers[24].std[i] / without[24].std[i]).sum::<f64>() / 7.0;
        // only the sharpest edges tell a delay from the inductances: to know neither costs a factor
        // of two, a rate of change and an offset as much again each, and only the inductances tell
        // viscous friction from inertia
        assert!(ratio < 15.0, "sigma is {ratio:.2} times as wide");
        // What holds the weight is widened most: the posture changes it by a third, and only that
        // tells it from the offset of a voltage.
        assert!((0..9).all(|i| answers[24].std[i] < 0.01 * answers[24].theta[i]));
        assert!(useful(&answers) >= 0.85, "{:.2}", useful(&answers));
        assert_eq!(dangerous(&answers), Vec::<usize>::new());
        assert!(answers.iter().all(|a| a.named.is_none()));
    }
}

#[test]
fn prop_smooth_motion_of_a_right_model_names_nothing_for_sure() {
    for seed in 1..=2 {
        let sim = arm(minimum_jerk(), seed, 25, Wrong::default());
        for answer in identify(&sim, Considered::default(), Wrong::default()) {
            // The second derivative of so slow an input is all noise, which residuals have, too:
            // made of measured signals it is named with some 15 standard deviations. What the first
            // blocks leave, before the estimate is near enough to smooth with, is at the limit.
            let deviations = answer.named.as_ref().map_or(0.0, |(.., s)| s.deviations);
            assert!(deviations < 10.0, "seed {seed}: {:?}", answer.named);
        }
    }
}

#[test]
fn prop_an_unknown_delay_that_is_considered_leaves_nothing_confidently_wrong() {
    let wrong = Wrong {
        delay_s: 150e-6,
        ..Wrong::default()
    };
    for (kind, motion) in [("steps", steps()), ("smooth", smooth(1))] {
        let answers = identify(&arm(motion, 1, 25, wrong), only(1e-4), wrong);
        assert_eq!(dangerous(&answers), Vec::<usize>::new(), "{kind}");
        assert!(answers.iter().any(|a| !a.usable.is_empty()), "silence is no honesty");
    }
}

/// An input that is recorded half a sample or one sample late, with the defaults.
#[test]
fn prop_a_record_that_is_a_sample_late_leaves_nothing_confidently_wrong() {
    for delay_s in [0.5e-3, 1e-3] {
        let wrong = Wrong {
            delay_s,
            ..Wrong::default()
        };
        for (kind, motion) in [("steps", steps()), ("smooth", smooth(1))] {
            let answers = identify(&arm(motion, 1, 25, wrong), Considered::default(), wrong);
            assert_eq!(dangerous(&answers), Vec::<usize>::new(), "{kind}, {delay_s} s");
        }
    }
}

/// A rotor with 5 % of the inertia of link 2, whose weight the model takes for that of the link.
#[test]
fn prop_a_rotor_leaves_nothing_confidently_wrong() {
    for (kind, motion) in [("steps", steps()), ("moves", minimum_jerk())] {
        let mut sim = arm(motion, 1, 25, Wrong::default());
        let own = 150.0 * sim.arm.length_2_m.powi(2) / 3.0;
        sim.unmodelled.rotor_inertia_kg_m2 = [0.0, 0.05 * own];
        let answers = identify(&sim, Considered::default(), Wrong::default());
        assert_eq!(dangerous(&answers), Vec::<usize>::new(), "{kind}");
        assert!(answers.iter().any(|a| !a.usable.is_empty()), "silence is no honesty");
    }
}

/// Viscous friction adds to the back EMF, and behind the inductance to the inertia: 10 N m s/rad are
/// 0.08 % of the former and make θ₃ 48 % larger.
#[test]
fn prop_viscous_friction_leaves_nothing_confidently_wrong() {
    for (kind, motion) in [("steps", steps()), ("moves", minimum_jerk())] {
        for friction in [3.0, 20.0, 60.0] {
            let mut sim = arm(motion.clone(), 1, 25, Wrong::default());
            sim.unmodelled.viscous_friction_n_m_s_per_rad = [friction; 2];
            let answers = identify(&sim, Considered::default(), Wrong::default());
            assert_eq!(dangerous(&answers), Vec::<usize>::new(), "{kind}, {friction}");
            let used = answers.iter().any(|a| !a.usable.is_empty());
            assert!(used || friction > 3.0, "silence is no honesty");
        }
    }
}

#[test]
fn ident_the_term_that_the_model_lacks_is_named_and_allowed_for() {
    for (name, wrong, cause) in wrongs() {
        let Some((kind, joint)) = cause else { continue };
        for seed in [1, 2] {
            let answers = identify(&arm(steps(), seed, 25, wrong), Considered::default(), wrong);
            assert_eq!(dangerous(&answers), Vec::<usize>::new(), "{name}, seed {seed}");
            let (_, its_kind, its_joint, suspicion) = answers[24]
                .named
                .as_ref()
                .unwrap_or_else(|| panic!("{name}, seed {seed}: nothing is named"));
            assert_eq!((*its_kind, *its_joint), (kind, joint), "{name}, seed {seed}");
            if kind == SuspectKind::InputDelay {
                // to first order in the delay, of which the motion shows 15 %
                assert!(
                    (suspicion.amplitude / wrong.delay_s - 1.0).abs() < 0.15,
                    "{name}: {suspicion:?}"
                );
            }
        }
    }
}

#[test]
fn ident_the_offset_of_a_voltage_is_found_in_volts_while_the_motion_grows() {
    // 0.05 V are 4 % of what holds link 2 level: without a column for it every block that may be
    // used is 4 % off by 40 standard deviations
    let wrong = Wrong {
        offset_v: [0.0, 0.05],
        ..Wrong::default()
    };
    for seed in [1, 2] {
        // the input's size, which the prior is a share of, grows from block to block
        let mut sim = arm(minimum_jerk(), seed, 30, wrong);
        for setpoint in &mut sim.setpoint {
            if let Setpoint::Moves(moves) = setpoint {
                (moves.min_move_s, moves.max_move_s) = (0.4, 3.0);
            }
        }
        let answers = identify(&sim, Considered::default(), wrong);
        // the first moves may be too slow to show what size of input is usual
        let later: Vec<usize> = dangerous(&answers).into_iter().filter(|&b| b > 2).collect();
        assert_eq!(later, Vec::<usize>::new(), "seed {seed}");
        let (words, kind, joint, suspicion) = answers[29].named.as_ref().expect("something is named");
        assert_eq!((*kind, *joint), (SuspectKind::Offset, Some(1)), "seed {seed}: {words}");
        // −0.05 V act that the record does not have; to first order in what it does to the estimate
        assert!((suspicion.amplitude / -0.05 - 1.0).abs() < 0.2, "seed {seed}: {words}");
    }
}

#[test]
fn prop_sigma_follows_a_winding_that_warms_up() {
    let wrong = Wrong {
        heating: 0.1,
        ..Wrong::default()
    };
    let answers = identify(&arm(steps(), 1, 40, wrong), Considered::default(), wrong);
    // The first block cannot tell a drift from its mean: it is at its end 0.15 % further than what
    // it fits.
    let late: Vec<usize> = dangerous(&answers).into_iter().filter(|&b| b > 0).collect();
    assert!(late.len() <= 1, "{late:?}");
}
