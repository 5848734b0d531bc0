//! What reaches the rows: lost samples, spikes, time stamps off the grid, coarse inputs.

use crate::support::TestRng;
use thetabus::estimator::{BlockEstimator, EquationNoise, EstimatorOptions, StateMachine};
use thetabus::model::{JointSample, Manipulator, Plant};
use thetabus::rows::{InputTiming, ProjectedBlock, ProjectedOptions, SampleBlock, SensorNoise, priors, structure};
use thetabus::sim::{ArmSimulator, ControllerKind, SensorOptions, Setpoint, SimOptions};

const N: usize = 1900;
const BLOCKS: usize = 8;
const BITS: u32 = 16;
const INPUT_NOISE: f64 = 0.05;

/// The arm on random steps, through encoders of 16 bits and 0.05 V of noise.
fn arm(seed: u64, kind: ControllerKind) -> (SimOptions, Vec<JointSample>) {
    let mut sim = SimOptions::cedro2022();
    sim.seed = seed;
    sim.controller.kind = kind;
    sim.sensors = SensorOptions::encoder(BITS, INPUT_NOISE);
    sim.mass_2 = thetabus::sim::MassSchedule::constant(150.0);
    let random = |reach: f64| Setpoint::Random {
        min_rad: -reach,
        max_rad: reach,
        min_dwell_s: 0.6,
        max_dwell_s: 2.0,
    };
    sim.setpoint = [random(1.0), random(0.8)];
    let samples = ArmSimulator::new(&sim).unwrap().take(N * BLOCKS).collect();
    (sim, samples)
}

fn rows(kind: ControllerKind) -> ProjectedOptions {
    ProjectedOptions {
        noise: SensorNoise::encoder(BITS, INPUT_NOISE),
        timing: match kind {
            ControllerKind::Analog => InputTiming::Continuous,
            ControllerKind::Sampled => InputTiming::Held,
        },
        ..ProjectedOptions::recommended()
    }
}

fn options(plant: &Manipulator) -> EstimatorOptions {
    let mut options = EstimatorOptions::recommended(priors(plant), plant.equations().len());
    options.forgetting_factor = 0.98;
    options.equations.fill(EquationNoise::WHITENED);
    if let Some(detection) = &mut options.change_detection {
        (detection.margin, detection.false_alarm_rate) = (40_000_000, 2e-5);
    }
    options
}

#[derive(Default, Clone)]
struct Outcome {
    theta: Vec<f64>,
    std: Vec<f64>,
    noise: f64,
    rows: usize,
    alarms: usize,
    use_ok: usize,
    replaced: u32,
}

/// Identifies from received samples: stamps in ns, samples, and the block that each belongs to.
fn identify(received: &[(usize, u64, JointSample)], rows: ProjectedOptions) -> Outcome {
    let plant = Manipulator::default();
    let mut block = ProjectedBlock::new(plant, rows, N).unwrap();
    let mut estimator = BlockEstimator::new(structure(&plant), options(&plant)).unwrap();
    let mut judge = StateMachine::new(estimator.theta());
    let mut outcome = Outcome::default();
    for number in 0..BLOCKS {
        for (_, t_ns, sample) in received.iter().filter(|(of, _, _)| *of == number) {
            assert!(block.push(*t_ns, sample));
        }
        block.prepare(estimator.theta());
        let report = estimator.update(&block);
        // as the service counts what was replaced
        let spiky = f64::from(block.replaced()) / (2 * plant.joints()) as f64 / N as f64;
        outcome.use_ok += usize::from(judge.step(report, spiky).use_ok);
        outcome.alarms += usize::from(report.change.is_some());
        outcome.replaced += block.replaced();
        outcome.rows += report.rows;
        outcome.noise = report.residual_rms.iter().fold(0.0, |a: f64, b| a.max(*b));
        block.clear();
    }
    (outcome.theta, outcome.std) = (estimator.report().theta.clone(), estimator.report().theta_std.clone());
    outcome
}

fn stamped(samples: &[JointSample]) -> Vec<(usize, u64, JointSample)> {
    let stamp = |(k, sample): (usize, &JointSample)| (k / N, k as u64 * 1_000_000, *sample);
    samples.iter().enumerate().map(stamp).collect()
}

/// Effect of a fault on one stream per seed: share of intervals of two standard deviations that
/// contain the truth, alarms, worst figures over the seeds.
struct Trial {
    covered: f64,
    alarms: usize,
    worst: f64,
    least_use_ok: usize,
    replaced: u32,
    /// Square mean of the standard deviations relative to those without the fault.
    wider: f64,
}

fn trial(
    name: &str,
    kind: ControllerKind,
    seeds: u64,
    rows: ProjectedOptions,
    fault: impl Fn(u64, &SimOptions, &mut Vec<(usize, u64, JointSample)>),
) -> Trial {
    let (mut inside, mut all, mut widths) = (0, 0, 0.0);
    let mut trial = Trial {
        covered: 0.0,
        alarms: 0,
        worst: 0.0,
        least_use_ok: BLOCKS,
        replaced: 0,
        wider: 0.0,
    };
    let mut share = 0.0;
    let mut noise = 0.0f64;
    for seed in 0..seeds {
        let (sim, samples) = arm(seed, kind);
        let clean = identify(&stamped(&samples), rows);
        let mut received = stamped(&samples);
        fault(seed, &sim, &mut received);
        let outcome = identify(&received, rows);
        for (i, truth) in sim.true_theta(0.0).iter().enumerate() {
            let off = (outcome.theta[i] - truth).abs() / outcome.std[i];
            inside += usize::from(off < 1.96);
            all += 1;
            trial.worst = trial.worst.max(off);
            widths += (outcome.std[i] / clean.std[i]).powi(2);
        }
        trial.alarms += outcome.alarms;
        trial.least_use_ok = trial.least_use_ok.min(outcome.use_ok);
        trial.replaced += outcome.replaced;
        share += outcome.rows as f64 / clean.rows as f64 / seeds as f64;
        noise = noise.max(outcome.noise);
    }
    trial.covered = inside as f64 / all as f64;
    trial.wider = (widths / all as f64).sqrt();
    println!(
        "{name:<34} {:.1} % covered, worst {:.1} σ, {} alarms, use_ok in {} of {BLOCKS}, σ × {:.2}, {} replaced, {:.0} % of the rows, residual {noise:.2}",
        100.0 * trial.covered,
        trial.worst,
        trial.alarms,
        trial.least_use_ok,
        trial.wider,
        trial.replaced,
        100.0 * share,
    );
    trial
}

/// 8 seeds and 9 parameters give 72 intervals, not all independent: 90 % less three binomial
/// standard deviations is 83 %.
fn honest(trial: &Trial) {
    assert!(trial.covered > 0.83, "{}", trial.covered);
    assert!(trial.worst < 4.5, "{}", trial.worst);
    assert_eq!(trial.alarms, 0);
}

#[test]
fn fault_lost_samples_single_and_in_bursts_leave_the_estimates_honest() {
    for kind in [ControllerKind::Analog, ControllerKind::Sampled] {
        for share in [0.0, 0.001, 0.01, 0.03, 0.05] {
            let lost = trial(
                &format!("{kind:?} {share} single"),
                kind,
                8,
                rows(kind),
                |seed, _, received| {
                    let mut rng = TestRng(seed + 77);
                    received.retain(|_| rng.between(0.0, 1.0) >= share);
                },
            );
            honest(&lost);
            assert!(lost.least_use_ok >= 3 && lost.wider < 1.5);
        }
        for share in [0.001, 0.01] {
            let lost = trial(
                &format!("{kind:?} {share} bursts"),
                kind,
                8,
                rows(kind),
                |seed, _, received| {
                    let mut rng = TestRng(seed + 177);
                    let mut left = 0;
                    received.retain(|_| {
                        if left == 0 && rng.between(0.0, 1.0) < share / 6.0 {
                            left = rng.between(2.0, 11.0) as usize;
                        }
                        left = left.saturating_sub(1);
                        left == 0
                    });
                },
            );
            honest(&lost);
        }
    }
}

#[test]
fn fault_spikes_are_replaced_before_they_enter_a_window() {
    let count = std::f64::consts::TAU / f64::from(BITS).exp2();
    for kind in [ControllerKind::Analog, ControllerKind::Sampled] {
        for (name, q_size, u_size) in [
            ("q by 30 counts", 30.0 * count, 0.0),
            ("q by 100 counts", 100.0 * count, 0.0),
            ("q by up to 1 rad", 1.0, 0.0),
            ("u by 100 deviations", 0.0, 100.0 * INPUT_NOISE),
            ("u by 1000 deviations", 0.0, 1000.0 * INPUT_NOISE),
            ("both", 0.3, 100.0 * INPUT_NOISE),
        ] {
            let spiky = trial(&format!("{kind:?} {name}"), kind, 8, rows(kind), |seed, _, received| {
                let mut rng = TestRng(seed + 5);
                for (_, _, sample) in received {
                    for joint in 0..2 {
                        let mut spike = |size: f64| match rng.between(0.0, 1.0) < 0.01 {
                            true => size * rng.between(0.5, 1.0) * if rng.bits() & 1 == 0 { 1.0 } else { -1.0 },
                            false => 0.0,
                        };
                        sample.q[joint] += spike(q_size);
                        sample.input[joint] += spike(u_size);
                    }
                }
            });
            if u_size == 0.0 {
                honest(&spiky);
                // in one run of 48, what is left of the spikes at an edge keeps σ of θ₃ as wide as viscous
                // friction makes it
                assert!(spiky.wider < 2.5, "{}", spiky.wider);
            } else {
                // a spike of the input on a step of the setpoint, or next to it, cannot be
                // distinguished from the step: once or twice a run
                assert!(spiky.covered > 0.8 && spiky.worst < 6.0 && spiky.alarms <= 3);
            }
            assert!(spiky.least_use_ok >= 3);
        }
        // nothing to find
        let clean = trial(&format!("{kind:?} no spikes"), kind, 8, rows(kind), |_, _, _| ());
        assert_eq!((clean.replaced, clean.wider), (0, 1.0));
    }
}

/// The true motion at other instants, from the simulator at ten times the rate.
fn jittered(seed: u64, sim: &SimOptions, jitter: f64) -> Vec<(usize, u64, JointSample)> {
    const FINE: u64 = 10;
    let mut fine = sim.clone();
    fine.sample_period_s = 1e-3 / FINE as f64;
    fine.sensors = SensorOptions::exact();
    let count = std::f64::consts::TAU / f64::from(BITS).exp2();
    let mut rng = TestRng(seed + 31);
    let total = (N * BLOCKS) as u64;
    // the instants of reading, in fine samples
    let mut wanted = (0..total).map(|k| {
        let off = (jitter * FINE as f64 * rng.between(-1.0, 1.0)).round();
        (k, (k * FINE).saturating_add_signed(off as i64))
    });
    let mut next = wanted.next();
    let mut received = Vec::new();
    let mut noise = TestRng(seed + 99);
    for (i, exact) in (0..total * FINE).zip(ArmSimulator::new(&fine).unwrap()) {
        let Some((k, at)) = next else { break };
        if i != at {
            continue;
        }
        let mut sample = exact;
        for joint in 0..2 {
            sample.q[joint] = (exact.q[joint] / count).round() * count;
            let normal: f64 = (0..12).map(|_| noise.between(-0.5, 0.5)).sum();
            sample.input[joint] += INPUT_NOISE * normal;
        }
        received.push((k as usize / N, at * 1_000_000 / FINE, sample));
        next = wanted.next();
    }
    received
}

#[test]
fn fault_irregular_time_stamps_are_used_as_they_are() {
    let kind = ControllerKind::Analog;
    for jitter in [0.1, 0.3] {
        let trial = trial(
            &format!("stamps off by {jitter} ms"),
            kind,
            4,
            rows(kind),
            |seed, sim, received| {
                let mut smooth = sim.clone();
                let sines = |shift: f64| Setpoint::Sines {
                    offset_rad: 0.0,
                    tones: [(0.31, 0.5), (1.1, 0.2), (3.3, 0.08), (7.1, 0.03)]
                        .map(|(frequency_hz, amplitude_rad)| thetabus::sim::Tone {
                            frequency_hz,
                            amplitude_rad,
                            phase_rad: shift + 10.0 * frequency_hz + seed as f64,
                        })
                        .to_vec(),
                };
                smooth.setpoint = [sines(0.0), sines(2.0)];
                *received = jittered(seed, &smooth, jitter);
            },
        );
        assert!(
            trial.covered > 0.7 && trial.alarms == 0,
            "{} {}",
            trial.covered,
            trial.alarms
        );
    }
}

#[test]
fn prop_a_few_lost_samples_change_the_estimate_by_less_than_its_deviation() {
    let kind = ControllerKind::Analog;
    let (_, samples) = arm(3, kind);
    let whole = identify(&stamped(&samples), rows(kind));
    let mut rng = TestRng(8);
    for _ in 0..6 {
        let mut received = stamped(&samples);
        let lost = 1 + (rng.bits() % 3) as usize;
        for _ in 0..lost {
            let at = (rng.bits() % received.len() as u64) as usize;
            received.remove(at);
        }
        let outcome = identify(&received, rows(kind));
        for i in 0..9 {
            let moved = (outcome.theta[i] - whole.theta[i]).abs() / whole.std[i];
            assert!(moved < 1.0, "{i}: {moved}");
        }
    }
}

#[test]
fn val_an_input_of_12_bits_is_weighed_by_its_resolution() {
    let kind = ControllerKind::Analog;
    // ±200 V over 12 bits
    let count = 400.0 / 4096.0;
    let mut rows = rows(kind);
    rows.noise.input_resolution = [count; 8];
    let coarse = trial("input of 12 bits", kind, 8, rows, |_, _, received| {
        for (_, _, sample) in received {
            for u in &mut sample.input {
                *u = (*u / count).round() * count;
            }
        }
    });
    honest(&coarse);
}
