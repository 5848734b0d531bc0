//! The library's façade, `Identifier::builder`: its settings, and what they do.

use crate::configured::{Pendulum, assert_same_as_service, pendulum};
use crate::support::TestRng;
use std::f64::consts::TAU;
use thetabus::config::{Catalog, Config};
use thetabus::estimator::Residuals;
use thetabus::identify::{Identifier, IdentifierBuilder, InputTiming};
use thetabus::messages::Estimate;
use thetabus::model::{Equation, JointSample, Parameter, Plant, Scalar};
use thetabus::rows::{ProjectedBlock, ProjectedOptions, SampleBlock, SuspectKind};
use thetabus::sim::rk4_step;

/// The pendulum driven by a torque that runs on between samples, which are recorded `late_s` late.
fn continuous(late_s: f64, samples: u64) -> impl Iterator<Item = JointSample> {
    let mut rng = TestRng(5);
    let mut state = [0.3, 0.0];
    let count = TAU / 16f64.exp2();
    let torque = |t: f64| 6.0 * (1.3 * t).sin() + 4.0 * (7.1 * t).sin() + 2.0 * (17.0 * t).cos();
    (0..samples).map(move |k| {
        let t = k as f64 * 1e-3;
        let mut sample = JointSample::default();
        sample.q[0] = (state[0] / count).round() * count;
        let normal: f64 = (0..12).map(|_| rng.between(0.0, 1.0)).sum::<f64>() - 6.0;
        sample.input[0] = torque(t - late_s) + 0.02 * normal;
        let rate = |s: f64, x: &[f64; 2]| [x[1], (torque(t + 1e-3 * s) - 0.8 * x[1] - 12.0 * x[0].sin()) / 2.5];
        state = rk4_step(&state, 1e-3, rate);
        sample
    })
}

fn last(builder: IdentifierBuilder, samples: impl Iterator<Item = JointSample>) -> Estimate {
    let mut identifier = builder.build().unwrap();
    samples.filter_map(|sample| identifier.push(&sample)).last().unwrap()
}

#[test]
fn ident_an_input_that_runs_on_between_samples_is_usable_if_it_is_stated() {
    let run = |timing| last(Identifier::builder(Pendulum).timing(timing), continuous(0.0, 10 * 1900));
    let (held, stated) = (run(InputTiming::Held), run(InputTiming::Continuous));
    let sigmas = |e: &Estimate, i: usize, truth: f64| (e.theta[i] - truth).abs() / e.theta_std[i];
    for (i, truth) in [2.5, 0.8, 12.0].into_iter().enumerate() {
        println!(
            "{i}: {:.2} sigma, held {:.2}",
            sigmas(&stated, i, truth),
            sigmas(&held, i, truth)
        );
        assert!(stated.is_usable(i) && sigmas(&stated, i, truth) < 4.5, "{i}");
    }
    // half a sample of delay is seen in the damping, and not used
    assert!(held.theta_std[1] > 2.0 * stated.theta_std[1] || !held.is_usable(1));
}

#[test]
fn ident_a_delay_of_the_input_is_stated_or_estimated() {
    let builder = || Identifier::builder(Pendulum).timing(InputTiming::Continuous);
    // what is recorded now has acted 3 ms ago
    let stated = last(builder().input_delay_s(-3e-3), continuous(3e-3, 10 * 1900));
    let names = builder().estimate_input_delay(None).build().unwrap().names().clone();
    assert_eq!(names.as_slice()[3], "input_delay");
    let estimated = last(builder().estimate_input_delay(Some(5e-3)), continuous(3e-3, 10 * 1900));
    println!("{} ± {}", estimated.theta[3], estimated.theta_std[3]);
    assert!((estimated.theta[3] + 3e-3).abs() < 4.5 * estimated.theta_std[3] && estimated.theta_std[3] < 2e-4);
    for estimate in [stated, estimated] {
        for (i, truth) in [2.5, 0.8, 12.0].into_iter().enumerate() {
            let sigmas = (estimate.theta[i] - truth).abs() / estimate.theta_std[i];
            assert!(estimate.is_usable(i) && sigmas < 4.5, "{i}: {sigmas}");
        }
    }
}

#[test]
fn prop_the_builder_has_the_choices_of_a_configuration() {
    let sets = [
        "window_s=0.06",
        "stride_s=0.015",
        "velocity_half_width_s=0.005",
        "timing=\"continuous\"",
        "input_delay_s=-0.001",
    ]
    .map(|set| format!("identifier.projected.{set}"));
    let limits = [
        "identifier.input_limit=[11.0]".to_owned(),
        "identifier.frozen_after_s=0.3".to_owned(),
    ];
    let sets: Vec<String> = sets.into_iter().chain(limits).collect();
    let mut identifier = Identifier::builder(Pendulum)
        .window_s(0.06)
        .stride_s(0.015)
        .velocity_half_width_s(0.005)
        .timing(InputTiming::Continuous)
        .input_delay_s(-1e-3)
        .input_limit(&[11.0])
        .frozen_after_s(0.3)
        .build()
        .unwrap();
    let samples = pendulum(16, 0.05, 3, 5 * 1900).map(|(t_ns, mut joints)| {
        // a sensor that hangs
        if t_ns > 7_000_000_000 {
            joints.q[0] = 0.25;
        }
        joints
    });
    let blocks = assert_same_as_service(&sets, &mut identifier, samples);
    let status = identifier.status();
    assert_eq!(blocks, 5);
    assert!(status.faults.saturated > 0, "{status:?}");
    assert!(status.faults.frozen > 0, "{status:?}");
}

#[test]
fn prop_the_builder_refuses_what_the_service_refuses() {
    let builder = || Identifier::builder(Pendulum);
    for (wrong, words) in [
        (builder().sample_period_s(2.0), ["sample_period_s", "1 Hz to 100 kHz"]),
        (builder().sample_period_s(1e-6), ["sample_period_s", "1e-5 to 1 s"]),
        (builder().stride_s(0.3).window_s(0.1), ["stride_s", "got 0.3"]),
        (builder().stride_s(f64::NAN), ["stride_s", "one sample period"]),
        (
            builder().velocity_half_width_s(0.2),
            ["velocity_half_width", "3 to 100"],
        ),
        (
            builder().velocity_half_width_s(f64::NAN),
            ["velocity_half_width", "3 to 100"],
        ),
        (builder().input_delay_s(f64::NAN), ["input_delay_s", "half of window_s"]),
        (builder().input_delay_s(0.3), ["input_delay_s", "half of window_s"]),
        (
            builder().estimate_input_delay(Some(0.0)),
            ["estimate_input_delay", "above 0"],
        ),
        (
            builder().input_delay_s(5e-3).estimate_input_delay(Some(2e-3)),
            ["estimate_input_delay", "magnitude of input_delay_s"],
        ),
        (
            builder().exact_derivatives().estimate_input_delay(None),
            ["estimate_input_delay", "exact_derivatives"],
        ),
        (builder().input_limit(&[-1.0]), ["input_limit", "above 0"]),
        (builder().input_limit(&[1.0, 2.0]), ["input_limit", "one per joint"]),
        (builder().frozen_after_s(-1.0), ["frozen_after_s", "0 to 3600 s"]),
    ] {
        let text = wrong.build().unwrap_err().to_string();
        assert!(words.iter().all(|word| text.contains(word)), "{text}");
    }
    for period_s in [1e-5, 0.1, 1.0] {
        assert!(builder().sample_period_s(period_s).build().is_ok(), "{period_s}");
    }
}

/// The heading of a ship, in steps of the rudder: drag that grows with the cube of the yaw rate.
#[derive(Clone, Copy)]
struct Ship;

impl Plant for Ship {
    fn name(&self) -> &'static str {
        "ship"
    }
    fn joints(&self) -> usize {
        1
    }
    fn input_unit(&self) -> &'static str {
        "rad"
    }
    fn parameters(&self) -> &[Parameter] {
        static PARAMETERS: [Parameter; 3] = [
            Parameter::positive("inertia", "s^2", "per rudder angle", 100.0),
            Parameter::positive("linear", "s", "damping", 10.0),
            Parameter::positive("cubic", "s^3/rad^2", "damping", 1000.0),
        ];
        &PARAMETERS
    }
    fn equations(&self) -> &[Equation] {
        static EQUATIONS: [Equation; 1] = [Equation::new("yaw", 0, 1.0, 1, 0..3)];
        &EQUATIONS
    }
    fn terms<D: Scalar>(&self, _: usize, _: &[D], dq: &[D], theta: &[D], g: &mut [D]) {
        g[0] = theta[1] * dq[0] + theta[2] * dq[0].powi(3);
        g[1] = theta[0] * dq[0];
    }
}

#[test]
fn ident_the_noise_of_a_slow_machine_does_not_bias_a_term_that_is_cubic_in_the_speed() {
    let truth = [240.0, 22.0, 12000.0];
    for seed in 0..3 {
        let mut rng = TestRng(seed);
        let mut normal = move || (0..12).map(|_| rng.between(0.0, 1.0)).sum::<f64>() - 6.0;
        let mut state = [0.0, 0.0];
        let samples = (0..12 * 3000).map(|k| {
            let t = f64::from(k) * 0.1;
            let rudder = 0.25 * (TAU * t / 110.0).sin() + 0.12 * (TAU * t / 37.0).sin() + 0.05 * (TAU * t / 17.0).sin();
            let mut sample = JointSample::default();
            sample.q[0] = state[0] + 3e-4 * normal();
            sample.input[0] = rudder + 1e-3 * normal();
            let rate = |_: f64, x: &[f64; 2]| [x[1], (rudder - 22.0 * x[1] - 12000.0 * x[1].powi(3)) / 240.0];
            state = rk4_step(&state, 0.1, rate);
            sample
        });
        let estimate = last(Identifier::builder(Ship).sample_period_s(0.1).block_len(3000), samples);
        for (i, truth) in truth.into_iter().enumerate() {
            let sigmas = (estimate.theta[i] - truth).abs() / estimate.theta_std[i];
            println!(
                "{seed} {i}: {:+.3} %, {sigmas:.2} sigma of {:.3} %",
                100.0 * (estimate.theta[i] / truth - 1.0),
                100.0 * estimate.theta_std[i] / truth
            );
            // 3 σ² cubic/linear of the filter over 1 s is 0.3 % of the linear damping
            assert!(
                sigmas < 3.5 && (i == 2 || estimate.is_usable(i)),
                "{seed} {i}: {sigmas}"
            );
        }
        assert!(
            (estimate.theta[1] / truth[1] - 1.0).abs() < 1.5e-3,
            "{seed}: {}",
            estimate.theta[1]
        );
    }
}

/// A slide on a hinge.
#[derive(Clone, Copy)]
struct Polar;

impl Plant for Polar {
    fn name(&self) -> &'static str {
        "polar"
    }
    fn joints(&self) -> usize {
        2
    }
    fn input_unit(&self) -> &'static str {
        "N m, N"
    }
    fn turns(&self, joint: usize) -> bool {
        joint == 0
    }
    fn parameters(&self) -> &[Parameter] {
        static PARAMETERS: [Parameter; 2] = [
            Parameter::positive("inertia", "kg m^2", "of the hinge", 1.0),
            Parameter::positive("mass", "kg", "of the slide", 1.0),
        ];
        &PARAMETERS
    }
    fn equations(&self) -> &[Equation] {
        static EQUATIONS: [Equation; 2] = [
            Equation::new("hinge", 0, 1.0, 1, 0..2),
            Equation::new("slide", 1, 1.0, 1, 1..2),
        ];
        &EQUATIONS
    }
    fn terms<D: Scalar>(&self, equation: usize, q: &[D], dq: &[D], theta: &[D], g: &mut [D]) {
        if equation == 0 {
            g[0] = theta[1] * q[1] * q[0].cos() * 9.81;
            g[1] = (theta[0] + theta[1] * q[1] * q[1]) * dq[0];
        } else {
            g[0] = theta[1] * (q[0].sin() * 9.81 - q[1] * dq[0] * dq[0]);
            g[1] = theta[1] * dq[1];
        }
    }
}

#[test]
fn prop_a_slide_beside_a_hinge_has_no_eccentric_encoder() {
    let options = ProjectedOptions::recommended();
    let mut block = ProjectedBlock::new(Polar, options, 1900).unwrap();
    for k in 0..1900_u64 {
        let t = k as f64 * 1e-3;
        let mut sample = JointSample::default();
        (sample.q[0], sample.q[1]) = ((3.0 * t).sin(), 0.5 + 0.2 * (5.0 * t).sin());
        (sample.input[0], sample.input[1]) = ((4.0 * t).cos(), (6.0 * t).cos());
        assert!(block.push(k * 1_000_000, &sample));
    }
    block.prepare(&[1.0, 1.0]);
    let suspects = block.suspect_rows();
    let mut columns = vec![0.0; suspects.count()];
    let mut sums = [0.0_f64; 2];
    for equation in 0..2 {
        for row in 0..block.len() {
            suspects.row(equation, row, &mut columns);
            for (index, column) in columns.iter().enumerate() {
                let suspect = block.suspect(index).unwrap();
                if matches!(suspect.kind, SuspectKind::Eccentricity | SuspectKind::Zero) {
                    sums[suspect.joint.unwrap()] += column.abs();
                }
            }
        }
    }
    assert!(sums[0] > 0.0 && sums[1] == 0.0, "{sums:?}");
    let config = Config::load_for(
        &Catalog::default().with(Polar),
        &[Config::embedded("own_plant").unwrap()],
        &[],
    );
    let description = config.unwrap().description();
    let units: Vec<&str> = description.joints().iter().map(|joint| joint.position_unit()).collect();
    assert_eq!(units, ["rad", "m"]);
    assert_eq!(description.position_unit(), "rad or m");
    // in a log, the unit is that of the joints that it suits
    let units_in = |unit: &str| {
        let sets = [
            "log.q=[\"a\",\"b\"]".to_owned(),
            format!("log.position_unit=\"{unit}\""),
        ];
        let basis = Config::embedded("own_plant").unwrap();
        let config = Config::load_for(&Catalog::default().with(Polar), &[basis], &sets);
        config.unwrap().log.position_units
    };
    assert_eq!(units_in("mm"), [1.0, 1e-3]);
    assert_eq!(units_in("deg"), [TAU / 360.0, 1.0]);
    assert_eq!(units_in("rad"), [1.0, 1.0]);
    let counts_per_turn = Identifier::builder(Polar)
        .encoder(16, 0.1)
        .build()
        .unwrap_err()
        .to_string();
    assert!(counts_per_turn.contains("position_resolution"), "{counts_per_turn}");
}

/// A trolley and the load that hangs from it, whose angle nothing drives.
#[derive(Clone, Copy)]
struct Crane;

const GRAVITY: f64 = 9.81;

impl Plant for Crane {
    fn name(&self) -> &'static str {
        "crane"
    }
    fn joints(&self) -> usize {
        2
    }
    fn input_unit(&self) -> &'static str {
        "N"
    }
    fn turns(&self, joint: usize) -> bool {
        joint == 1
    }
    fn parameters(&self) -> &[Parameter] {
        static PARAMETERS: [Parameter; 4] = [
            Parameter::positive("mass", "kg", "of trolley and load", 10.0),
            Parameter::positive("moment", "kg m", "mass of the load times length", 10.0),
            Parameter::positive("friction", "N s/m", "of the trolley", 1.0),
            Parameter::positive("length", "m", "of the cable", 1.0),
        ];
        &PARAMETERS
    }
    fn equations(&self) -> &[Equation] {
        static EQUATIONS: [Equation; 2] = [
            Equation::new("trolley", 0, 1.0, 1, 0..3),
            Equation::new("load", 1, 1.0, 1, 3..4),
        ];
        &EQUATIONS
    }
    fn terms<D: Scalar>(&self, equation: usize, q: &[D], dq: &[D], theta: &[D], g: &mut [D]) {
        if equation == 0 {
            g[0] = theta[2] * dq[0];
            g[1] = theta[0] * dq[0] + theta[1] * q[1].cos() * dq[1];
        } else {
            g[0] = q[1].sin() * dq[1] * dq[0] + q[1].sin() * GRAVITY;
            g[1] = theta[3] * dq[1] + q[1].cos() * dq[0];
        }
    }
}

#[test]
fn ident_a_joint_that_nothing_drives_is_no_frozen_input() {
    let truth = [25.0, 15.0, 6.0, 1.5];
    let mut rng = TestRng(4);
    let mut normal = move || (0..12).map(|_| rng.between(0.0, 1.0)).sum::<f64>() - 6.0;
    let count = TAU / 16f64.exp2();
    let mut state = [0.0, 0.3, 0.0, 0.0];
    let samples = (0..8 * 1900).map(|k| {
        let t = f64::from(k) * 2e-3;
        let force = 60.0 * (2.1 * t).sin() + 40.0 * (5.3 * t).sin() - 20.0 * state[0];
        let mut sample = JointSample::default();
        sample.q[0] = (state[0] / 1e-5_f64).round() * 1e-5;
        sample.q[1] = (state[1] / count).round() * count;
        sample.input[0] = force + 0.1 * normal();
        let rate = |_: f64, x: &[f64; 4]| {
            let [mass, moment, friction, length] = truth;
            let [_, angle, speed, turn] = *x;
            let (sin, cos) = angle.sin_cos();
            let push = force - friction * speed + moment * sin * turn * turn + moment * cos * sin * GRAVITY / length;
            let acceleration = push / (mass - moment * cos * cos / length);
            [
                speed,
                turn,
                acceleration,
                -(cos * acceleration + sin * GRAVITY) / length,
            ]
        };
        state = rk4_step(&state, 2e-3, rate);
        sample
    });
    let estimate = last(Identifier::builder(Crane).sample_period_s(2e-3), samples);
    for (i, truth) in truth.into_iter().enumerate() {
        let sigmas = (estimate.theta[i] - truth).abs() / estimate.theta_std[i];
        println!(
            "{i}: {} ± {}, {sigmas:.2} sigma",
            estimate.theta[i], estimate.theta_std[i]
        );
        assert!(estimate.is_usable(i) && sigmas < 4.5, "{i}: {sigmas}");
    }
}
