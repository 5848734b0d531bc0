//! The data that every program of the comparison gets, and the estimators in Rust on it:
//! `thetabus-peers FOLDER`.
//!
//! Writes `rows.csv`, a row of each equation per sample, `log.csv`, positions and voltages as a
//! drive reports them, `truth.csv`, and logs of a robot. Prints a line per estimator: job,
//! estimator, samples, ns a sample, worst and median relative error of θ.

mod recursions;
mod report;
mod robot;

use report::{report, write};
use std::path::Path;
use thetabus::config::{Config, Source};
use thetabus::estimator::{BlockEstimator, EquationNoise, EstimatorOptions};
use thetabus::messages::Sample;
use thetabus::model::{JointSample, Manipulator, PointwiseModel};
use thetabus::node::simulated_plant::sample_stream;
use thetabus::rows::{InputSource, PointwiseBlock, SampleBlock, structure};
use thetabus::sim::{ArmSimulator, SensorOptions, SimOptions};

type Failure = Box<dyn std::error::Error>;

/// Samples of a run at 1 kHz, twenty blocks.
const BLOCK: usize = 1900;
const COUNT: usize = 20 * BLOCK;

/// The run: the arm of the paper with 150 kg, smooth sines, 0.05 V of noise, 16 bits.
fn configuration() -> Result<Config, Failure> {
    let sets = [
        "plant.duration_s=38.0",
        "plant.setpoint.kind=\"sines\"",
        "plant.mass_2.t_s=[0.0]",
        "plant.mass_2.mass_kg=[150.0]",
    ];
    let sources: Vec<Source> = Config::embedded("encoder_only").into_iter().collect();
    Ok(Config::load(&sources, &sets.map(str::to_owned))?)
}

/// From samples with exact derivatives and a noisy voltage to estimates, block by block.
fn pointwise(config: &Config, exact: &[JointSample], truth: &[f64]) -> Result<(), Failure> {
    let model = Manipulator::default();
    let options = EstimatorOptions {
        equations: vec![EquationNoise::LEARNT; 2],
        ..config.estimator.options.clone()
    };
    let fresh = BlockEstimator::new(structure(&model), options)?;
    report("samples", "thetabus, pointwise rows", COUNT, truth, || {
        let mut estimator = fresh.clone();
        let mut block = PointwiseBlock::new(model, InputSource::Measured, BLOCK);
        for chunk in exact.chunks_exact(BLOCK) {
            for (k, sample) in chunk.iter().enumerate() {
                let _ = block.push(k as u64 * 1_000_000, sample);
            }
            estimator.update(&block);
            block.clear();
        }
        estimator.theta().to_vec()
    });
    Ok(())
}

/// The shipped configuration, as the service runs it.
fn projected(config: &Config, truth: &[f64]) -> Result<(), Failure> {
    let mut plant = sample_stream(&config.plant.sim, 1)?;
    let messages: Vec<Sample> = std::iter::from_fn(|| plant.next_sample()).take(COUNT).collect();
    config.identifier()?;
    report("log", "thetabus, encoder_only (on line)", COUNT, truth, || {
        let mut theta = vec![f64::NAN; truth.len()];
        if let Ok(mut node) = config.identifier() {
            for message in &messages {
                node.on_sample(message, &mut |estimate| {
                    theta = estimate.theta[..truth.len()].to_vec();
                });
            }
        }
        theta
    });
    Ok(())
}

fn main() -> Result<(), Failure> {
    let folder = std::env::args()
        .nth(1)
        .ok_or("expected the folder for the data as the one argument")?;
    let folder = Path::new(&folder);
    std::fs::create_dir_all(folder)?;
    let config = configuration()?;
    let truth = config.plant.sim.true_theta(0.0);
    write(folder, "truth.csv", "theta", truth.iter().map(|t| vec![*t]))?;

    let sim = SimOptions {
        sensors: SensorOptions {
            input_noise_v: 0.05,
            ..SensorOptions::exact()
        },
        ..config.plant.sim.clone()
    };
    let exact: Vec<JointSample> = ArmSimulator::new(&sim)?.take(COUNT).collect();
    let model = Manipulator::default();
    let rows: Vec<_> = exact
        .iter()
        .map(|sample| model.features(sample))
        .map(|features| [features.linear_row(0), features.linear_row(1)])
        .collect();
    write(
        folder,
        "rows.csv",
        "a1,a2,a3,a4,a5,y_a,b1,b2,b3,b4,b5,y_b",
        rows.iter()
            .map(|[(a, y), (b, z)]| [&a[..], &[*y], &b[..], &[*z]].concat()),
    )?;
    let log = ArmSimulator::new(&config.plant.sim)?.take(COUNT);
    write(
        folder,
        "log.csv",
        "q_1_rad,q_2_rad,voltage_1_v,voltage_2_v",
        log.map(|s| vec![s.q[0], s.q[1], s.input[0], s.input[1]]),
    )?;

    recursions::run(&rows, &truth);
    pointwise(&config, &exact, &truth)?;
    projected(&config, &truth)?;
    robot::run(folder)
}
