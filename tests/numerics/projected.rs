//! Projected rows: what they give from positions and inputs alone.

use thetabus::estimator::{BlockEstimator, EstimatorOptions};
use thetabus::model::{Manipulator, Plant};
use thetabus::rows::{InputTiming, ProjectedBlock, ProjectedOptions, SampleBlock, SensorNoise, structure};
use thetabus::sim::{ArmSimulator, ControllerKind, MassSchedule, SensorOptions, Setpoint, SimOptions};

/// References of three kinds; each seed has its own.
fn reference(kind: &str) -> [Setpoint; 2] {
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
        "square" => [square(0.8, 3.1), square(0.6, 4.3)],
        _ => [sines(1.0), sines(0.8)],
    }
}

fn scenario(kind: &str, controller: ControllerKind, seed: u64, duration_s: f64) -> SimOptions {
    let mut options = SimOptions::cedro2022();
    options.duration_s = duration_s;
    options.setpoint = reference(kind);
    options.controller.kind = controller;
    options.seed = seed;
    options.mass_2 = MassSchedule::jump(150.0, 45.0, 170.0);
    options
}

fn start() -> Vec<f64> {
    let truth = SimOptions::cedro2022().true_theta(0.0);
    let factors = [2.5, 0.4, 0.4, 2.5, 0.4, 2.5, 0.4, 2.5, 0.4];
    truth.iter().zip(factors).map(|(t, f)| t * f).collect()
}

fn percent(theta: &[f64], truth: &[f64]) -> Vec<f64> {
    theta.iter().zip(truth).map(|(a, b)| 100.0 * (a / b - 1.0)).collect()
}

/// What one run of blocks gave.
struct Run {
    theta: Vec<Vec<f64>>,
    std: Vec<Vec<f64>>,
    truth: Vec<Vec<f64>>,
    noise: Vec<Vec<f64>>,
}

fn timing(sim: &SimOptions) -> InputTiming {
    match sim.controller.kind {
        ControllerKind::Analog => InputTiming::Continuous,
        ControllerKind::Sampled => InputTiming::Held,
    }
}

fn estimator_options(plant: &impl Plant, theta_start: Vec<f64>) -> EstimatorOptions {
    let mut options = EstimatorOptions::recommended(theta_start, plant.equations().len());
    options.lower = plant.parameters().iter().map(|p| p.lower).collect();
    options.upper = plant.parameters().iter().map(|p| p.upper).collect();
    options.forgetting_factor = 0.98;
    if let Some(detection) = &mut options.change_detection {
        detection.margin = 40_000_000;
    }
    options
}

fn identify<P: Plant + Clone>(plant: P, sim: &SimOptions, rows: ProjectedOptions, options: EstimatorOptions) -> Run {
    const N: u64 = 1900;
    let mut block = ProjectedBlock::new(plant.clone(), rows, N as usize).unwrap();
    let mut estimator = BlockEstimator::new(structure(&plant), options).unwrap();
    let mut run = Run {
        theta: Vec::new(),
        std: Vec::new(),
        truth: Vec::new(),
        noise: Vec::new(),
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
                ..ProjectedOptions::recommended()
            };
            let mut options = estimator_options(&plant, start());
            options.change_detection = None;
            let run = identify(plant, &sim, rows, options);
            let error = errors(&run, 9);
            // The velocity filter is off by 0.07 % at the resonance of 13 Hz, which meets theta_1 and theta_3 in full, for link 1 alone is
            // a twentieth of the inertia that they stand beside; everything else by a share of that.
            for (i, limit) in [0.2, 0.02, 0.2, 0.02, 0.002, 0.002, 0.002, 0.002, 0.002]
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

#[test]
#[ignore = "a look at the figures"]
fn explore_encoder() {
    for controller in [ControllerKind::Analog, ControllerKind::Sampled] {
        for kind in ["steps", "square", "sines"] {
            for (bits, volt, half) in [(16, 0.05, 10), (20, 0.0, 5)] {
                for seed in 0..3 {
                    let mut sim = scenario(kind, controller, seed, 170.0);
                    sim.sensors = SensorOptions::encoder(bits, volt);
                    let plant = Manipulator::default();
                    let rows = ProjectedOptions {
                        timing: timing(&sim),
                        noise: SensorNoise::encoder(bits, volt),
                        velocity_half_width: half,
                        ..ProjectedOptions::recommended()
                    };
                    let run = identify(plant, &sim, rows, estimator_options(&plant, start()));
                    println!("{controller:?} {kind} {bits} seed {seed}");
                    for block in [0, 9, 22, 23, 24, 26, 88] {
                        println!(
                            "{block:3} noise {:.2?} err {:7.3?} dev {:5.2?}",
                            run.noise[block],
                            errors(&run, block),
                            (0..9)
                                .map(|i| (run.theta[block][i] - run.truth[block][i]) / run.std[block][i])
                                .collect::<Vec<_>>()
                        );
                    }
                }
            }
        }
    }
}
