//! Projected rows: estimates from positions and inputs alone.

use thetabus::estimator::{BlockEstimator, EquationNoise, EstimatorOptions, Residuals};
use thetabus::model::{
    AutoDiff, Delayed, DriveInput, Equation, JointSample, Manipulator, Motion, Parameter, Plant, Scalar, ServoAxis,
};
use thetabus::rows::{
    InputTiming, ProjectedBlock, ProjectedOptions, SampleBlock, SensorNoise, SmoothedBlock, SmoothedOptions, structure,
};
use thetabus::sim::{ArmSimulator, ControllerKind, MassSchedule, SensorOptions, Setpoint, SimOptions};

/// References of three kinds; each seed has its own.
fn reference(kind: &str, seed: u64) -> [Setpoint; 2] {
    let random = |limit: f64| Setpoint::Random {
        min_rad: -limit,
        max_rad: limit,
        min_dwell_s: 1.0,
        max_dwell_s: 3.0,
    };
    let square = |amplitude: f64, period: f64| Setpoint::Square {
        amplitude_rad: amplitude,
        offset_rad: 0.0,
        period_s: period,
        shift_s: 0.0,
    };
    let sines = |amplitude: f64| Setpoint::RandomSines {
        count: 6,
        min_frequency_hz: 0.23,
        max_frequency_hz: 5.3,
        amplitude_rad: amplitude,
    };
    match kind {
        "steps" => [random(1.0), random(0.8)],
        "square" => {
            let shift = 0.13 * seed as f64;
            [square(0.8, 3.1 + 0.5 * shift), square(0.6, 4.3 - 0.5 * shift)]
        }
        _ => [sines(1.0), sines(0.8)],
    }
}

fn scenario(kind: &str, controller: ControllerKind, seed: u64, duration_s: f64) -> SimOptions {
    let mut options = SimOptions::cedro2022();
    options.duration_s = duration_s;
    options.setpoint = reference(kind, seed);
    options.controller.kind = controller;
    options.seed = seed;
    options.mass_2 = MassSchedule::jump(150.0, 45.0, 170.0);
    options
}

pub fn start() -> Vec<f64> {
    let truth = SimOptions::cedro2022().true_theta(0.0);
    let factors = [2.5, 0.4, 0.4, 2.5, 0.4, 2.5, 0.4, 2.5, 0.4];
    truth.iter().zip(factors).map(|(t, f)| t * f).collect()
}

fn percent(theta: &[f64], truth: &[f64]) -> Vec<f64> {
    theta.iter().zip(truth).map(|(a, b)| 100.0 * (a / b - 1.0)).collect()
}

/// Result of one run of blocks.
struct Run {
    theta: Vec<Vec<f64>>,
    std: Vec<Vec<f64>>,
    truth: Vec<Vec<f64>>,
    noise: Vec<Vec<f64>>,
    change: Vec<Option<u64>>,
}

fn timing(sim: &SimOptions) -> InputTiming {
    match sim.controller.kind {
        ControllerKind::Analog => InputTiming::Continuous,
        ControllerKind::Sampled => InputTiming::Held,
    }
}

pub fn estimator_options(plant: &impl Plant, theta_start: Vec<f64>) -> EstimatorOptions {
    let mut options = EstimatorOptions::recommended(theta_start, plant.equations().len());
    for (prior, p) in options.parameters.iter_mut().zip(plant.parameters()) {
        (prior.lower, prior.upper) = (p.lower, p.upper);
    }
    options.forgetting_factor = 0.98;
    options.equations.fill(EquationNoise::WHITENED);
    if let Some(detection) = &mut options.change_detection {
        detection.margin = 40_000_000;
        // as in encoder_only.toml: R is right to some per cent only, so the tail of the test is
        // thicker than stated
        detection.false_alarm_rate = 2e-5;
    }
    options
}

fn identify<P: Plant + Clone + Send + Sync + 'static>(
    plant: P,
    sim: &SimOptions,
    rows: ProjectedOptions,
    options: EstimatorOptions,
) -> Run {
    const N: u64 = 1900;
    let mut block = ProjectedBlock::new(plant.clone(), rows, N as usize).unwrap();
    let mut estimator = BlockEstimator::new(structure(&plant), options).unwrap();
    let mut run = Run {
        theta: Vec::new(),
        std: Vec::new(),
        truth: Vec::new(),
        noise: Vec::new(),
        change: Vec::new(),
    };
    let mut losses = thetabus::sim::Losses::new(&sim.sensors, sim.seed);
    for (k, sample) in (0..sim.sample_count()).zip(ArmSimulator::new(sim).unwrap()) {
        if !losses.next_is_lost() {
            assert!(block.push(k * 1_000_000, &sample));
        }
        if k % N == N - 1 {
            block.prepare(estimator.theta());
            let report = estimator.update(&block);
            run.theta.push(report.theta.clone());
            run.std.push(report.theta_std.clone());
            run.noise.push(report.noise_std.clone());
            run.change.push(report.change.map(|change| change.time));
            run.truth.push(sim.true_theta(k as f64 * 1e-3).to_vec());
            block.clear();
        }
    }
    run
}

fn errors(run: &Run, block: usize) -> Vec<f64> {
    percent(&run.theta[block], &run.truth[block])
}

#[test]
fn ident_exact_positions_give_the_parameters_to_the_filters_error() {
    for controller in [ControllerKind::Analog, ControllerKind::Sampled] {
        for kind in ["steps", "square", "sines"] {
            let sim = scenario(kind, controller, 1, 10.0 * 1.9);
            let plant = Manipulator::default();
            let rows = ProjectedOptions {
                timing: timing(&sim),
                noise: SensorNoise::NONE,
                velocity_half_width: 5,
                ..ProjectedOptions::recommended()
            };
            let mut options = estimator_options(&plant, start());
            options.change_detection = None;
            let run = identify(plant, &sim, rows, options);
            let error = errors(&run, 9);
            // Over 11 samples the velocity filter is off by (ωh)⁶/6000 = 5e-11 at 13 Hz and by 1e-5
            // in the few samples around a jump of the jerk. That meets θ2 and θ4 as it is,
            // twentyfold θ1 and θ3, which stand beside 20 times their inertia, and hardly the rest.
            for (i, limit) in [0.02, 0.001, 0.02, 0.001, 1e-4, 1e-4, 1e-4, 1e-4, 1e-4]
                .into_iter()
                .enumerate()
            {
                assert!(
                    error[i].abs() < limit,
                    "{controller:?} {kind}: theta_{} {:.4} %",
                    i + 1,
                    error[i]
                );
            }
        }
    }
}

fn encoder_rows(sim: &SimOptions) -> ProjectedOptions {
    let bits = sim.sensors.encoder_bits;
    ProjectedOptions {
        timing: timing(sim),
        noise: SensorNoise::encoder(bits, sim.sensors.input_noise_v),
        ..ProjectedOptions::recommended()
    }
}

#[test]
fn ident_encoder_and_voltage_alone_give_all_that_the_data_hold() {
    for controller in [ControllerKind::Analog, ControllerKind::Sampled] {
        let mut sim = scenario("steps", controller, 4, 10.0 * 1.9);
        sim.sensors = SensorOptions::encoder(16, 0.05);
        let plant = Manipulator::default();
        let run = identify(plant, &sim, encoder_rows(&sim), estimator_options(&plant, start()));
        for (block, limit) in [(0, 2.0), (9, 0.3)] {
            let error = errors(&run, block);
            for i in 4..9 {
                assert!(
                    error[i].abs() < limit,
                    "{controller:?} block {block}: theta_{} {:.3} %",
                    i + 1,
                    error[i]
                );
            }
        }
        for i in 0..9 {
            let deviations = (run.theta[9][i] - run.truth[9][i]).abs() / run.std[9][i];
            // nine parameters in two runs: 4.5 standard deviations come once in 10 000 such tests
            assert!(
                deviations < 4.5,
                "{controller:?}: theta_{} is off by {deviations:.1} deviations",
                i + 1
            );
        }
        // The sensors were told, so whitened residuals have variance 1; 950 rows give their
        // standard deviation to 2 %, and R is right to a few per cent.
        for noise in &run.noise[9] {
            assert!((noise - 1.0).abs() < 0.15, "{controller:?}: {:?}", run.noise[9]);
        }
    }
}

#[test]
fn ident_a_delay_ignored_configured_and_identified() {
    let mut sim = scenario("sines", ControllerKind::Sampled, 2, 10.0 * 1.9);
    sim.sensors = SensorOptions::encoder(16, 0.05);
    sim.sensors.input_delay_s = 0.5e-3;
    let plant = Manipulator::default();
    let rows = encoder_rows(&sim);
    let ignored = identify(plant, &sim, rows, estimator_options(&plant, start()));
    let told = ProjectedOptions {
        input_delay_s: 0.5e-3,
        ..rows
    };
    let configured = identify(plant, &sim, told, estimator_options(&plant, start()));
    let delayed = Delayed::new(plant, 0.0, 5e-3);
    let mut theta = start();
    theta.push(0.0);
    let mut options = estimator_options(&delayed, theta);
    options.parameters[9].std = 1e-3;
    let identified = identify(delayed, &sim, rows, options);
    // theta_6: half a sample costs tens of per cent, told or found out it is as good as without
    let error = |run: &Run| errors(run, 9)[5];
    assert!(error(&ignored).abs() > 5.0, "{}", error(&ignored));
    assert!(error(&configured).abs() < 0.5, "{}", error(&configured));
    assert!(error(&identified).abs() < 0.5, "{}", error(&identified));
    let delay = identified.theta[9][9];
    assert!((delay - 0.5e-3).abs() < 20e-6, "{delay}");
    let deviations = (delay - 0.5e-3).abs() / identified.std[9][9];
    assert!(deviations < 4.5, "{deviations}");
}

/// The rows of a block of samples, evaluated at θ.
fn all_rows<P: Plant>(block: &ProjectedBlock, plant: &P, theta: &[f64]) -> Vec<(f64, Vec<f64>)> {
    let mut rows = Vec::new();
    for (e, equation) in plant.equations().iter().enumerate() {
        for index in 0..block.len() {
            let mut phi = vec![0.0; equation.parameters.len()];
            let f = block.row(e, index, theta, &mut phi);
            rows.push((f, phi));
        }
    }
    rows
}

#[test]
fn fault_windows_that_touch_a_long_hole_are_dropped_and_no_others() {
    let sim = scenario("steps", ControllerKind::Sampled, 1, 4.0);
    let plant = Manipulator::default();
    let options = ProjectedOptions {
        noise: SensorNoise::encoder(16, 0.05),
        ..ProjectedOptions::recommended()
    };
    let samples: Vec<_> = ArmSimulator::new(&sim).unwrap().take(1900).collect();
    let spans = |lost: &[usize]| -> Vec<(u64, u64)> {
        let mut block = ProjectedBlock::new(plant, options, 1900).unwrap();
        for (k, sample) in samples.iter().enumerate().filter(|(k, _)| !lost.contains(k)) {
            assert!(block.push(k as u64 * 1_000_000, sample));
        }
        block.prepare(&start());
        (0..block.len()).map(|i| block.span(i)).collect()
    };
    let whole = spans(&[]);
    // up to five lost samples are bridged
    assert_eq!(spans(&[1000, 1001, 1002, 1003, 1004]), whole);
    let with_hole = spans(&[1000, 1001, 1002, 1003, 1004, 1005]);
    let hole_ns = 1_000_000_000..=1_005_000_000;
    assert!(
        with_hole
            .iter()
            .all(|&(a, b)| b < *hole_ns.start() || a > *hole_ns.end())
    );
    // a window needs 70 samples on either side of its centre: those whose centres are nearer to the
    // hole are gone, every 20th sample one
    assert_eq!(whole.len() - with_hole.len(), 7);
    assert!(
        with_hole.iter().all(|span| whole.contains(span)),
        "the grid stays where it was"
    );
    assert_eq!(spans(&(500..900).collect::<Vec<_>>()).len(), whole.len() - 27);
}

#[test]
fn prop_rows_do_not_depend_on_where_blocks_are_cut() {
    let sim = scenario("steps", ControllerKind::Sampled, 1, 4.0);
    let plant = Manipulator::default();
    let options = ProjectedOptions {
        noise: SensorNoise::encoder(16, 0.05),
        ..ProjectedOptions::recommended()
    };
    let spans = |block_len: usize| -> Vec<(u64, u64)> {
        let mut block = ProjectedBlock::new(plant, options, block_len).unwrap();
        let mut spans = Vec::new();
        for (k, sample) in ArmSimulator::new(&sim).unwrap().take(3800).enumerate() {
            assert!(block.push(k as u64 * 1_000_000, &sample));
            if (k + 1) % block_len == 0 {
                spans.extend((0..block.len()).map(|i| block.span(i)));
                block.clear();
            }
        }
        spans
    };
    let whole = spans(3800);
    assert_eq!(spans(1900), whole);
    assert_eq!(spans(95), whole, "a block shorter than a window");
    assert_eq!(spans(1), whole, "one sample to a block");
}

/// Rows and windows at the end of a block, as bits.
fn bits(block: &ProjectedBlock, theta: &[f64]) -> Vec<u64> {
    let rows = all_rows(block, &Manipulator::default(), theta);
    let ends = (0..2).flat_map(|e| (0..4).filter_map(move |k| block.tail(e, k, theta)));
    let rows = rows.into_iter().flat_map(|(f, phi)| phi.into_iter().chain([f]));
    rows.chain(ends).map(f64::to_bits).collect()
}

#[test]
fn prop_a_block_that_was_reset_gives_the_bits_of_a_new_one_whatever_it_held() {
    let plant = Manipulator::default();
    // levels that are learnt stay over a reset: the sensors are the same
    let options = ProjectedOptions {
        noise: SensorNoise::encoder(16, 0.05),
        ..ProjectedOptions::recommended()
    };
    let feed = |block: &mut ProjectedBlock, kind: &str, seed: u64| {
        let mut sim = scenario(kind, ControllerKind::Sampled, seed, 4.0);
        sim.sensors = SensorOptions::encoder(16, 0.05);
        for (k, sample) in ArmSimulator::new(&sim).unwrap().take(1900).enumerate() {
            assert!(block.push(k as u64 * 1_000_000, &sample));
        }
        block.prepare(&start());
    };
    let mut new = ProjectedBlock::new(plant, options, 1900).unwrap();
    feed(&mut new, "sines", 1);
    let mut used = ProjectedBlock::new(plant, options, 1900).unwrap();
    feed(&mut used, "steps", 2);
    used.clear();
    // as a command that forgets everything does
    used.reset();
    used.forget_theta();
    feed(&mut used, "sines", 1);
    let found = bits(&new, &start());
    assert!(found.len() > 500, "{}", found.len());
    let other = bits(&used, &start()).iter().zip(&found).filter(|(a, b)| a != b).count();
    assert_eq!(other, 0, "of {}", found.len());
    assert_eq!(used.start(), new.start());
    assert!(new.start().is_some());
}

/// The arm's equations with θ₁ written as the square of its root: no polynomial of degree 2.
#[derive(Clone)]
struct Rooted(Manipulator);

impl Plant for Rooted {
    fn name(&self) -> &'static str {
        "rooted"
    }
    fn joints(&self) -> usize {
        self.0.joints()
    }
    fn input_unit(&self) -> &str {
        self.0.input_unit()
    }
    fn parameters(&self) -> &[Parameter] {
        self.0.parameters()
    }
    fn equations(&self) -> &[Equation] {
        self.0.equations()
    }
    fn terms<D: Scalar>(&self, equation: usize, q: &[D], dq: &[D], theta: &[D], g: &mut [D]) {
        let mut other = [D::from(0.0); 9];
        other.copy_from_slice(theta);
        other[8] = theta[8].sqrt();
        other[0] = theta[0].sqrt();
        self.0.terms(equation, q, dq, &other, g);
    }
}

#[test]
fn val_terms_that_are_no_polynomials_give_the_same_rows_by_evaluation() {
    let sim = scenario("sines", ControllerKind::Sampled, 1, 4.0);
    let options = ProjectedOptions {
        noise: SensorNoise::NONE,
        velocity_half_width: 5,
        ..ProjectedOptions::recommended()
    };
    let truth = sim.true_theta(0.0).to_vec();
    let mut squared = truth.clone();
    (squared[0], squared[8]) = (truth[0] * truth[0], truth[8] * truth[8]);
    let arm = Manipulator::default();
    let mut by_parts = ProjectedBlock::new(arm, options, 1900).unwrap();
    let rooted = Rooted(arm);
    let mut evaluated = ProjectedBlock::new(rooted.clone(), options, 1900).unwrap();
    for (k, sample) in ArmSimulator::new(&sim).unwrap().take(1900).enumerate() {
        assert!(by_parts.push(k as u64 * 1_000_000, &sample));
        assert!(evaluated.push(k as u64 * 1_000_000, &sample));
    }
    by_parts.prepare(&truth);
    evaluated.prepare(&squared);
    let a = all_rows(&by_parts, &arm, &truth);
    let b = all_rows(&evaluated, &rooted, &squared);
    let size = |rows: &[(f64, Vec<f64>)], i: usize| rows.iter().fold(0.0, |m: f64, r| m.max(r.1[i].abs()));
    for (range, i, factor) in [
        (0..a.len() / 2, 1, 1.0),
        (0..a.len() / 2, 0, 0.5 / truth[0]),
        (a.len() / 2..a.len(), 3, 0.5 / truth[8]),
    ] {
        let scale = size(&a[range.clone()], i) * factor;
        for k in range {
            // by parts from positions, or from filtered velocities: the filter's 1e-5 and what it
            // is whitened by
            let difference = (a[k].1[i] * factor - b[k].1[i]).abs();
            assert!(
                difference < 5e-3 * scale,
                "row {k}, column {i}: {} {}",
                a[k].1[i] * factor,
                b[k].1[i]
            );
        }
    }
}

/// The projected regressors against differences of the projected residual, for whitened rows of any
/// plant.
fn assert_projected_regressors<P: Plant>(plant: &P, block: &ProjectedBlock, theta: &[f64]) {
    for (e, equation) in plant.equations().iter().enumerate() {
        let count = equation.parameters.len();
        let (mut phi, mut scratch) = (vec![0.0; count], vec![0.0; count]);
        for index in 0..block.len() {
            let f = block.row(e, index, theta, &mut phi);
            let scale = f.abs()
                + phi
                    .iter()
                    .zip(&theta[equation.parameters.clone()])
                    .map(|(p, t)| (p * t).abs())
                    .sum::<f64>();
            for (slot, parameter) in equation.parameters.clone().enumerate() {
                let h = 1e-5 * theta[parameter].abs().max(1e-3);
                let mut at = |delta: f64| {
                    let mut moved = theta.to_vec();
                    moved[parameter] += delta;
                    block.row(e, index, &moved, &mut scratch)
                };
                let difference = -(at(h) - at(-h)) / (2.0 * h);
                // rounding of f over the step; the terms are of degree 2, for which central
                // differences are exact
                let tolerance = 1e-12 * scale / h + 1e-8 * phi[slot].abs();
                assert!(
                    (difference - phi[slot]).abs() <= tolerance,
                    "equation {e}, row {index}, parameter {parameter}: {difference} {}",
                    phi[slot]
                );
            }
        }
    }
}

#[test]
fn val_projected_regressors_equal_finite_differences_near_singular_states_too() {
    // joint 2 passes the vertical, where cos q2 is 0, and both joints come to rest
    let plant = Manipulator::default();
    let options = ProjectedOptions {
        noise: SensorNoise::encoder(16, 0.05),
        ..ProjectedOptions::recommended()
    };
    let samples: Vec<JointSample> = (0..1000)
        .map(|k| {
            let t = f64::from(k) * 1e-3;
            let mut sample = JointSample::default();
            let moving = (1.0 - t / 0.6).max(0.0).powi(3);
            sample.q[0] = 0.7 * moving;
            sample.q[1] = std::f64::consts::FRAC_PI_2 + 0.5 * moving * (8.0 * t).cos();
            sample.input[0] = 40.0 * moving;
            sample.input[1] = -25.0 * moving;
            sample
        })
        .collect();
    let mut block = ProjectedBlock::new(plant, options, 1000).unwrap();
    let delayed = Delayed::new(plant, 0.0, 5e-3);
    let mut with_delay = ProjectedBlock::new(delayed.clone(), options, 1000).unwrap();
    for (k, sample) in samples.iter().enumerate() {
        assert!(block.push(k as u64 * 1_000_000, sample));
        assert!(with_delay.push(k as u64 * 1_000_000, sample));
    }
    let mut theta = start();
    block.prepare(&theta);
    assert_projected_regressors(&plant, &block, &theta);
    theta.push(0.3e-3);
    with_delay.prepare(&theta);
    assert_projected_regressors(&delayed, &with_delay, &theta);

    let axis = ServoAxis::new(Motion::Linear, DriveInput::Voltage, 35.15).unwrap();
    let mut block = ProjectedBlock::new(axis.clone(), options, 1000).unwrap();
    for (k, sample) in samples.iter().enumerate() {
        assert!(block.push(k as u64 * 1_000_000, sample));
    }
    let theta = [95.0, 203.0, 20.0, -3.0];
    block.prepare(&theta);
    assert_projected_regressors(&axis, &block, &theta);
}

#[test]
fn fault_smoothed_windows_do_not_reach_over_a_hole_and_do_not_depend_on_blocks() {
    let sim = scenario("steps", ControllerKind::Sampled, 1, 4.0);
    let samples: Vec<_> = ArmSimulator::new(&sim).unwrap().take(1900).collect();
    let spans = |lost: &[usize], block_len: usize| -> Vec<(u64, u64)> {
        let model = AutoDiff(Manipulator::default());
        let mut block = SmoothedBlock::new(model, 2, SmoothedOptions::recommended(), block_len).unwrap();
        let mut spans = Vec::new();
        for (k, sample) in samples.iter().enumerate() {
            if !lost.contains(&k) {
                assert!(block.push(k as u64 * 1_000_000, sample));
            }
            if (k + 1) % block_len == 0 {
                spans.extend((0..block.len()).map(|i| block.span(i)));
                block.clear();
            }
        }
        spans
    };
    let whole = spans(&[], 1900);
    assert_eq!(spans(&[], 95), whole);
    let hole_ns = 1_000_000_000;
    let with_hole = spans(&[1000], 1900);
    // derivatives need ten samples on either side, so the windows stay that far from the hole
    let clear = |&(a, b): &(u64, u64)| b + 10_000_000 < hole_ns || a > hole_ns + 10_000_000;
    assert_eq!(with_hole, whole.iter().copied().filter(clear).collect::<Vec<_>>());
    let bad = SmoothedOptions {
        half_width: 2,
        ..SmoothedOptions::recommended()
    };
    assert!(SmoothedBlock::new(AutoDiff(Manipulator::default()), 2, bad, 10).is_err());
}
