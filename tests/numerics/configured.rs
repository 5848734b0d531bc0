//! Whole configurations on simulated machines: optional terms, sample rates, noise of unknown
//! level.

use std::f64::consts::TAU;
use thetabus::config::{Catalog, Config};
use thetabus::estimator::{BlockEstimator, IndexSet};
use thetabus::identify::{Identifier, IdentifierBuilder, ParameterPrior};
use thetabus::messages::{Estimate, Sample, signals};
use thetabus::model::{
    DerivedValues, DriveInput, Equation, ExtendedDerived, ExtendedManipulator, ExtraTerms, JointSample, Manipulator,
    ManipulatorDerived, Motion, Parameter, Plant, Scalar, ServoAxis,
};
use thetabus::node::simulated_plant::sample_stream;
use thetabus::rows::{AutoWindowBlock, InputSource, RowForm, SampleBlock, structure};
use thetabus::sim::{ArmParameters, SimOptions, rk4_step};

fn encoder_only(sets: &[String]) -> Config {
    Config::load(&[Config::embedded("encoder_only").unwrap()], sets).unwrap()
}

/// Estimates after the last block: θ̂ and its standard deviations, and the number of reported
/// changes.
struct Last {
    theta: Vec<f64>,
    std: Vec<f64>,
    usable: IndexSet,
    changes: usize,
    window_s: f64,
}

/// Samples through the rows and the estimator of a configuration.
fn identify<P: Plant + Clone + Send + Sync + 'static>(
    config: &Config,
    plant: P,
    samples: impl Iterator<Item = (u64, JointSample)>,
) -> Last {
    let RowForm::Projected(rows) = config.identifier.rows else {
        panic!("projected rows are what these tests are about");
    };
    let (len, options) = (config.estimator.block_len, config.estimator.options.clone());
    let block = match config.identifier.auto_window {
        true => AutoWindowBlock::chosen(plant.clone(), rows, len),
        false => AutoWindowBlock::fixed(plant.clone(), rows, len),
    };
    let mut block = block.unwrap().starting_at(&options.theta_start()).unwrap();
    let mut estimator = BlockEstimator::new(structure(&plant), options).unwrap();
    let mut changes = 0;
    for (k, (t_ns, sample)) in samples.enumerate() {
        assert!(block.push(t_ns, &sample));
        if (k + 1) % len == 0 {
            block.prepare(estimator.theta());
            changes += usize::from(estimator.update(&block).change.is_some());
            block.clear();
        }
    }
    let report = estimator.report();
    Last {
        theta: report.theta.clone(),
        std: report.theta_std.clone(),
        usable: report.usable,
        changes,
        window_s: block.window_s().unwrap(),
    }
}

fn simulated(sim: &SimOptions) -> impl Iterator<Item = (u64, JointSample)> {
    let mut plant = sample_stream(sim, 1).unwrap();
    std::iter::from_fn(move || plant.next_sample().map(|s: Sample| (s.t_ns, s.joint_sample())))
}

fn identify_arm(config: &Config) -> Last {
    let samples = simulated(&config.plant.sim);
    let section = &config.file_form().model;
    let terms = ExtraTerms {
        coulomb_friction: section.coulomb_friction,
        offset: section.offset,
    };
    let plant = ExtendedManipulator::new(Manipulator::new(section.gravity_m_s2).unwrap(), terms);
    assert_eq!(plant.parameters(), config.model.parameters());
    identify(config, plant, samples)
}

const BOTH: ExtraTerms = ExtraTerms {
    coulomb_friction: true,
    offset: true,
};

#[test]
fn val_extra_terms_are_those_of_the_motor_equation_and_none_are_the_papers_arm() {
    let paper = ExtendedManipulator::new(Manipulator::default(), ExtraTerms::default());
    assert_eq!(paper.parameters(), Manipulator::default().parameters());
    assert_eq!(paper.equations(), Manipulator::default().equations());
    assert_eq!(paper.relations(), Manipulator::default().relations());

    let arm = ExtendedManipulator::new(Manipulator::default(), BOTH);
    let names: Vec<&str> = arm.parameters().iter().map(|p| &*p.name).collect();
    let sim = SimOptions::cedro2022();
    let theta: Vec<f64> = sim.true_theta(0.0).to_vec();
    let all = [&theta[..5], &[3.0, 0.3, -2.0], &theta[5..], &[5.0, 0.5, 7.0]].concat();
    assert_eq!(names[5..8], ["coulomb_friction_1", "coulomb_inductance_1", "offset_1"]);
    assert_eq!(names[12..], ["coulomb_friction_2", "coulomb_inductance_2", "offset_2"]);
    let (q, dq) = ([0.3, -0.4], [0.7, -1.1]);
    // signs of the velocities: +, −; the offset has no derivative
    for (equation, [more_0, more_1]) in [(0, [3.0 - 2.0, 0.3]), (1, [-5.0 + 7.0, -0.5])] {
        let (mut own, mut extended) = ([0.0; 3], [0.0; 3]);
        Plant::terms(&Manipulator::default(), equation, &q, &dq, &theta, &mut own);
        Plant::terms(&arm, equation, &q, &dq, &all, &mut extended);
        let more = [12.0 * more_0, 12.0 * more_1, 0.0];
        for d in 0..3 {
            assert!((extended[d] - own[d] - more[d]).abs() < 1e-12, "{equation} {d}");
        }
    }
    // What the simulator knows of friction satisfies the relations, and physical values do not
    // depend on the terms.
    let mut sim = sim;
    sim.unmodelled.coulomb_friction_n_m = [40.0, 70.0];
    let truth = sim.true_values(&names, 0.0);
    for [i, j, k, l] in arm.relations().iter().copied() {
        let (left, right) = (truth[i] * truth[l], truth[j] * truth[k]);
        assert!((left - right).abs() < 1e-12 * left.abs(), "{} {}", names[i], names[k]);
    }
    let parameters = ArmParameters::cedro2022().with_mass_2(150.0);
    let derived = ManipulatorDerived::new(parameters.known()).unwrap();
    let extended = ExtendedDerived::new(derived, ExtendedManipulator::places(BOTH));
    let mut gradient = vec![f64::NAN; truth.len()];
    assert!((extended.value_and_gradient(0, &truth, &mut gradient) - 150.0).abs() < 1e-9);
    assert!(gradient[5..8].iter().chain(&gradient[12..]).all(|slope| *slope == 0.0));
    assert!(gradient[9] != 0.0, "mass_2 follows from theta_7, the tenth");
}

/// A run with Coulomb friction at a joint, in per cent of the torque that holds link 2 level.
fn with_friction(motion: &[&str], joint: usize, percent: f64, seed: u64) -> Config {
    // 150 kg on 1 m
    let torque = percent / 100.0 * 150.0 * 9.81 * 0.5;
    let torques = [1, 2].map(|j| if j == joint { torque } else { 0.25 * torque });
    let start = SimOptions::cedro2022().true_theta(0.0);
    let start: Vec<f64> = start
        .iter()
        .zip([2.5, 0.4].iter().cycle())
        .map(|(t, f)| t * f)
        .collect();
    let start = [&start[..5], &[1.0, 0.1], &start[5..], &[1.0, 0.1]].concat();
    let mut sets: Vec<String> = motion.iter().map(|&set| set.to_owned()).collect();
    sets.extend([
        format!("plant.seed={seed}"),
        "plant.duration_s=114".to_owned(),
        "plant.substeps=10".to_owned(),
        "plant.mass_2.t_s=[0.0]".to_owned(),
        "plant.mass_2.mass_kg=[150.0]".to_owned(),
        format!("plant.unmodelled.coulomb_friction_n_m={torques:?}"),
        "model.coulomb_friction=true".to_owned(),
        format!("estimator.theta_start={start:?}"),
    ]);
    encoder_only(&sets)
}

#[test]
fn ident_with_the_friction_term_an_arm_with_friction_is_known_as_well_as_one_without() {
    let minimum_jerk = [
        "plant.setpoint.kind=\"moves\"",
        "plant.setpoint.moves.max_rest_s=[0.5, 0.5]",
    ];
    for motion in [&[][..], &minimum_jerk] {
        for (joint, percent) in [(1, 2.0), (1, 10.0), (2, 2.0), (2, 10.0)] {
            let config = with_friction(motion, joint, percent, 3);
            let last = identify_arm(&config);
            let names: Vec<&str> = config.model.parameters().iter().map(|p| &*p.name).collect();
            let truth = config.plant.sim.true_values(&names, 0.0);
            let mut table = String::new();
            for (i, name) in names.iter().enumerate() {
                let off = last.theta[i] - truth[i];
                table += &format!(
                    "\n{name:<22} {:>8.3} %  {:>6.2} sigma  usable {}",
                    100.0 * off / truth[i],
                    off / last.std[i],
                    last.usable.contains(i)
                );
            }
            println!("{motion:?} joint {joint} {percent} %{table}");
            for (i, name) in names.iter().enumerate() {
                let off = (last.theta[i] - truth[i]).abs();
                assert!(off < 5.0 * last.std[i], "{motion:?} {joint} {percent}: {name}{table}");
                // what may be used of the arm itself is right to a per cent
                if name.starts_with("theta") && last.usable.contains(i) {
                    assert!(off < 0.01 * truth[i], "{motion:?} {joint} {percent}: {name}{table}");
                }
            }
        }
    }
}

#[test]
fn ident_the_velocity_filter_keeps_its_time_at_every_sample_rate() {
    // gains with which the sampled loop is stable at 2 ms, too
    let gains = [
        "plant.controller.proportional_gain_v_per_rad=[120.0, 120.0]",
        "plant.controller.derivative_gain_v_s_per_rad=[12.0, 12.0]",
    ];
    let errors = |period_s: f64, half_width_s: Option<f64>| {
        let mut sets: Vec<String> = gains.iter().map(|&set| set.to_owned()).collect();
        sets.extend([
            format!("plant.sample_period_s={period_s:?}"),
            format!("plant.duration_s={:?}", 40.0 * 1900.0 * period_s),
            "plant.mass_2.t_s=[0.0]".to_owned(),
            "plant.mass_2.mass_kg=[150.0]".to_owned(),
            "plant.seed=2".to_owned(),
            // σ would allow for more than the filter does
            "identifier.considered.drift_per_s=0.0".to_owned(),
            "identifier.considered.viscous=0.0".to_owned(),
        ]);
        sets.extend(half_width_s.map(|s| format!("identifier.projected.velocity_half_width_s={s:?}")));
        let config = encoder_only(&sets);
        let (last, truth) = (identify_arm(&config), config.plant.sim.true_theta(0.0));
        let off = |i: usize| (last.theta[i] - truth[i]).abs();
        let sigmas: Vec<f64> = (0..9).map(|i| off(i) / last.std[i]).collect();
        let worst = (0..9).filter(|i| last.usable.contains(*i)).map(|i| off(i) / truth[i]);
        println!(
            "{period_s} s, {half_width_s:?}: {sigmas:.1?} sigma, usable {:?}",
            last.usable
        );
        (sigmas.into_iter().fold(0.0, f64::max), worst.fold(0.0, f64::max))
    };
    for period_s in [0.5e-3, 1e-3, 2e-3] {
        let (sigmas, worst) = errors(period_s, None);
        // nine parameters at three rates: 4.5 standard deviations come once in 5000 such tests
        assert!(
            sigmas < 4.5 && worst < 0.01,
            "{period_s} s: {sigmas:.1} sigma, {worst:.4}"
        );
    }
    // ten samples of 2 ms, as the count once had it, smooth the fastest motion away: more than σ
    // allows, unlike all of the above
    let (sigmas, _) = errors(2e-3, Some(0.02));
    assert!(sigmas > 4.5, "{sigmas}");
}

/// A driven pendulum, as a user would write it down.
#[derive(Clone, Copy)]
pub(crate) struct Pendulum;

static PENDULUM: [Parameter; 3] = [
    Parameter::positive("inertia", "kg m^2", "about the axis", 1.0),
    Parameter::positive("damping", "N m s/rad", "friction that grows with speed", 1.0),
    Parameter::positive("weight", "N m", "torque that holds it level", 1.0),
];

impl Plant for Pendulum {
    fn name(&self) -> &'static str {
        "pendulum"
    }
    fn joints(&self) -> usize {
        1
    }
    fn input_unit(&self) -> &'static str {
        "N m"
    }
    fn parameters(&self) -> &[Parameter] {
        &PENDULUM
    }
    fn equations(&self) -> &[Equation] {
        static EQUATIONS: [Equation; 1] = [Equation::new("axis", 0, 1.0, 1, 0..3)];
        &EQUATIONS
    }
    fn terms<D: Scalar>(&self, _: usize, q: &[D], dq: &[D], theta: &[D], g: &mut [D]) {
        g[0] = theta[1] * dq[0] + theta[2] * q[0].sin();
        g[1] = theta[0] * dq[0];
    }
}

/// q and q̇ of the pendulum of `examples/own_machine.rs` so many seconds later, in steps whose own
/// error is far below any noise here.
fn swing(state: [f64; 2], torque: f64, period_s: f64) -> [f64; 2] {
    let rate = |_: f64, x: &[f64; 2]| [x[1], (torque - 0.8 * x[1] - 12.0 * x[0].sin()) / 2.5];
    let steps = (period_s / 5e-4).round() as usize;
    (0..steps).fold(state, |x, _| rk4_step(&x, 5e-4, rate))
}

/// This pendulum with an encoder of `bits` and `noise` on the measured torque.
pub(crate) fn pendulum(bits: i32, noise: f64, seed: u64, samples: u64) -> impl Iterator<Item = (u64, JointSample)> {
    let mut rng = crate::support::TestRng(seed);
    let phase = rng.between(0.0, TAU);
    let mut state = [0.3, 0.0];
    let count = TAU / f64::from(bits).exp2();
    (0..samples).map(move |k| {
        let t = k as f64 * 1e-3;
        let torque = 6.0 * (1.3 * t + phase).sin() + 4.0 * (7.1 * t).sin() + 2.0 * (17.0 * t).cos();
        let mut sample = JointSample::default();
        sample.q[0] = (state[0] / count).round() * count;
        let normal: f64 = (0..12).map(|_| rng.between(0.0, 1.0)).sum::<f64>() - 6.0;
        sample.input[0] = torque + noise * normal;
        state = swing(state, torque, 1e-3);
        (k * 1_000_000, sample)
    })
}

#[test]
fn ident_a_plant_of_ones_own_needs_no_word_about_its_sensors() {
    let own = Catalog::default().with(Pendulum);
    let truth = [2.5, 0.8, 12.0];
    let (mut covered, mut all, mut changes) = (0, 0, 0);
    // from a coarse encoder with a quiet drive to a fine one with a noisy drive: none is what any
    // default would guess
    for (bits, noise) in [(13, 0.1), (14, 0.5), (20, 1.0)] {
        for seed in 0..6 {
            let basis = Config::embedded("own_plant").unwrap();
            let config = Config::load_for(&own, &[basis], &[]).unwrap();
            let last = identify(&config, Pendulum, pendulum(bits, noise, seed, 12 * 1900));
            changes += last.changes;
            println!("{bits} bits {noise} N m, seed {seed}: {} changes", last.changes);
            for i in 0..3 {
                let sigmas = (last.theta[i] - truth[i]).abs() / last.std[i];
                println!(
                    "{bits} bits {noise} N m: {} {:.3} %, {sigmas:.2} sigma",
                    PENDULUM[i].name,
                    100.0 * (last.theta[i] / truth[i] - 1.0)
                );
                assert!(sigmas < 4.5, "{bits} bits, {noise} N m: {}", PENDULUM[i].name);
                all += 1;
                covered += usize::from(sigmas < 1.96);
            }
        }
    }
    // 54 intervals of 95 %: fewer than 46 come once in a thousand such tests
    assert!(covered >= 46, "{covered} of {all} intervals hold the truth");
    // 216 blocks
    assert!(changes <= 1, "{changes} false alarms");
}

#[test]
fn ident_windows_that_the_identifier_chooses_are_as_good_as_configured_ones() {
    for period_s in [0.5e-3, 1e-3, 2e-3] {
        let settings = |window: &str| {
            encoder_only(&[
                format!("identifier.projected.window_s={window}"),
                "plant.controller.proportional_gain_v_per_rad=[120.0, 120.0]".to_owned(),
                "plant.controller.derivative_gain_v_s_per_rad=[12.0, 12.0]".to_owned(),
                format!("plant.sample_period_s={period_s:?}"),
                format!("plant.duration_s={:?}", 30.0 * 1900.0 * period_s),
                "plant.mass_2.t_s=[0.0]".to_owned(),
                "plant.mass_2.mass_kg=[150.0]".to_owned(),
            ])
        };
        let (fixed, auto) = (settings("0.1"), settings("auto"));
        assert!(auto.identifier.auto_window && !fixed.identifier.auto_window);
        let truth = fixed.plant.sim.true_theta(0.0);
        let (by_hand, chosen) = (identify_arm(&fixed), identify_arm(&auto));
        println!("{period_s} s: {} s", chosen.window_s);
        assert_eq!(chosen.changes, 0);
        for i in 0..9 {
            let sigmas = (chosen.theta[i] - truth[i]).abs() / chosen.std[i];
            assert!(sigmas < 4.5, "{period_s} s: theta_{} {sigmas:.1} sigma", i + 1);
            let ratio = chosen.std[i] / by_hand.std[i];
            println!("theta_{}: {sigmas:.2} sigma, {ratio:.3} of the fixed one's", i + 1);
            assert!(ratio < 1.15, "{period_s} s: theta_{} {ratio}", i + 1);
        }
    }
}

/// Asserts that an identifier for the pendulum gives the estimates and the status of the service
/// with `own_plant.toml` and these settings; returns the number of blocks.
pub(crate) fn assert_same_as_service(
    sets: &[String],
    identifier: &mut Identifier,
    samples: impl Iterator<Item = JointSample>,
) -> usize {
    let basis = Config::embedded("own_plant").unwrap();
    let config = Config::load_for(&Catalog::default().with(Pendulum), &[basis], sets).unwrap();
    let mut node = config.identifier().unwrap();
    let mut blocks = 0;
    for (seq, joints) in (0..).zip(samples) {
        let signals = signals::Q | signals::INPUT;
        let sample = Sample::new(1, seq, seq * 1_000_000, 1, signals, &joints);
        let mut expected = None;
        node.on_sample(&sample, &mut |estimate| {
            // the builder has no configuration
            let estimate = Estimate {
                config_hash: 0,
                ..*estimate
            };
            expected = Some(estimate);
        });
        let got = identifier.push(&joints);
        // Debug tells NaN from NaN, unlike equality
        assert_eq!(format!("{got:?}"), format!("{expected:?}"));
        blocks += usize::from(got.is_some());
    }
    assert_eq!(format!("{:?}", identifier.status()), format!("{:?}", node.status()));
    blocks
}

#[test]
fn prop_the_builder_makes_the_identifier_of_own_plant_toml() {
    let mut identifier = Identifier::builder(Pendulum).build().unwrap();
    let samples = pendulum(16, 0.05, 3, 6 * 1900).map(|(_, joints)| joints);
    let blocks = assert_same_as_service(&[], &mut identifier, samples);
    assert_eq!((blocks, identifier.names().as_slice()[2].as_str()), (6, "weight"));

    let message = |builder: IdentifierBuilder| builder.build().unwrap_err().to_string();
    let builder = || Identifier::builder(Pendulum);
    let unknown = message(builder().prior("mass", ParameterPrior::new(1.0)));
    assert!(
        unknown.contains("inertia, damping, weight") && unknown.contains("\"mass\""),
        "{unknown}"
    );
    let outside = message(builder().prior("inertia", ParameterPrior::new(-1.0).within(0.0, 9.0)));
    assert!(outside.contains("theta_start"), "{outside}");
    for (wrong, named) in [
        (builder().block_len(0), "block_len"),
        (builder().sample_period_s(f64::NAN), "sample_period_s"),
        (builder().window_s(1e-3), "window_s"),
        (builder().forgetting_factor(2.0), "forgetting_factor"),
    ] {
        let text = message(wrong);
        assert!(text.contains(named), "{text}");
    }
    let line = ServoAxis::new(Motion::Linear, DriveInput::Force, 1.0).unwrap();
    let counts_per_turn = message(Identifier::builder(line).encoder(16, 0.1));
    assert!(
        counts_per_turn.contains("position_resolution") && counts_per_turn.contains("positions in m"),
        "{counts_per_turn}"
    );
    let mut far = builder().build().unwrap();
    far.skip(u64::MAX);
    assert!(far.push(&JointSample::default()).is_none() && far.push(&JointSample::default()).is_none());
    let held = builder()
        .prior("weight", ParameterPrior::new(12.0).fixed())
        .build()
        .unwrap();
    assert_eq!(held.status().estimates, 0);
}

/// Three masses, each with an input of its own.
#[derive(Clone, Copy)]
struct Masses;

impl Plant for Masses {
    fn name(&self) -> &'static str {
        "masses"
    }
    fn joints(&self) -> usize {
        3
    }
    fn input_unit(&self) -> &'static str {
        "V"
    }
    fn parameters(&self) -> &[Parameter] {
        static PARAMETERS: [Parameter; 3] = [
            Parameter::positive("mass_1", "V s^2/rad", "of joint 1", 1.0),
            Parameter::positive("mass_2", "V s^2/rad", "of joint 2", 1.0),
            Parameter::positive("mass_3", "V s^2/rad", "of joint 3", 1.0),
        ];
        &PARAMETERS
    }
    fn equations(&self) -> &[Equation] {
        static EQUATIONS: [Equation; 3] = [
            Equation::new("joint_1", 0, 1.0, 1, 0..1),
            Equation::new("joint_2", 1, 1.0, 1, 1..2),
            Equation::new("joint_3", 2, 1.0, 1, 2..3),
        ];
        &EQUATIONS
    }
    fn terms<D: Scalar>(&self, equation: usize, _: &[D], dq: &[D], theta: &[D], g: &mut [D]) {
        g[1] = theta[equation] * dq[equation];
    }
}

#[test]
fn regress_a_computed_input_needs_the_gains_of_every_joint_of_the_model() {
    let own = Catalog::default().with(Masses);
    let load = |more: &[&str]| {
        let sets = [
            "model.kind=masses",
            "identifier.rows=pointwise",
            "identifier.input=controller",
        ];
        let sets: Vec<String> = sets.iter().chain(more).map(|&set| set.to_owned()).collect();
        Config::load_for(&own, &[], &sets).map_err(|e| e.to_string())
    };
    let kd = "identifier.derivative_gain_v_s_per_rad=[1, 2, 3]";
    let refused = load(&[kd]).unwrap_err();
    assert!(
        refused
            .contains("identifier.proportional_gain_v_per_rad: expected 3 numbers, one per joint of the model, got 2"),
        "{refused}"
    );
    assert!(!refused.contains("derivative_gain_v_s_per_rad: expected"), "{refused}");
    let InputSource::Controller(gains) = load(&[kd, "identifier.proportional_gain_v_per_rad=[4, 5, 6, 7]"])
        .unwrap()
        .identifier
        .input
    else {
        panic!("the input is computed");
    };
    let kp = gains.map(|gain| gain.proportional_gain_v_per_rad);
    assert_eq!(kp[..4], [4.0, 5.0, 6.0, 0.0]);
}

#[test]
fn ident_a_slow_sample_rate_gets_windows_that_resolve_their_bump() {
    // 10 ms: the configured 100 ms are ten samples
    let own = Catalog::default().with(Pendulum);
    let basis = Config::embedded("own_plant").unwrap();
    let sets = [
        "plant.sample_period_s=0.01",
        "identifier.projected.window_s=auto",
        "estimator.block_len=600",
    ];
    let sets: Vec<String> = sets.iter().map(|&set| set.to_owned()).collect();
    let config = Config::load_for(&own, &[basis], &sets).unwrap();
    let last = identify(&config, Pendulum, slow_pendulum(3));
    assert_eq!(last.window_s, 0.2);
    for (i, truth) in [2.5, 0.8, 12.0].into_iter().enumerate() {
        let off = (last.theta[i] - truth).abs();
        println!(
            "{}: {:.3} %, {:.2} sigma",
            PENDULUM[i].name,
            100.0 * off / truth,
            off / last.std[i]
        );
        assert!(off < 4.5 * last.std[i] && off < 0.02 * truth, "{}", PENDULUM[i].name);
    }
}

/// The pendulum, its torque held over 10 ms, sampled as often.
fn slow_pendulum(seed: u64) -> impl Iterator<Item = (u64, JointSample)> {
    let mut rng = crate::support::TestRng(seed);
    let mut state = [0.3, 0.0];
    let count = TAU / 65536.0;
    (0..6000).map(move |k| {
        let t = k as f64 * 1e-2;
        let torque = 6.0 * (1.3 * t).sin() + 4.0 * (4.1 * t).sin() + 2.0 * (7.0 * t).cos();
        let mut sample = JointSample::default();
        sample.q[0] = (state[0] / count).round() * count;
        sample.input[0] = torque + 0.05 * (rng.between(-1.0, 1.0) + rng.between(-1.0, 1.0));
        state = swing(state, torque, 1e-2);
        (k * 10_000_000, sample)
    })
}
