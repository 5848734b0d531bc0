//! The data that every program of the comparison gets, and the estimators in Rust on it: `thetabus-peers FOLDER`.
//!
//! Writes `rows.csv`, a row of each equation per sample, and `log.csv`, positions and voltages as a drive reports them, with `truth.csv`, and prints
//! a line per estimator: job, estimator, samples, ns a sample, worst and median relative error of θ.

use flight_solver::rls::{CovarianceGuards, InverseQrRls, Rls};
use nalgebra_034::SVector;
use std::fmt::Write as _;
use std::hint::black_box;
use std::path::Path;
use std::time::Instant;
use thetabus::config::{Config, Source};
use thetabus::estimator::{BlockEstimator, EstimatorOptions, Wrls};
use thetabus::model::{JointSample, Manipulator, ManipulatorFeatures, PointwiseModel};
use thetabus::rows::{InputSource, PointwiseBlock, SampleBlock, structure};
use thetabus::sim::{ArmSimulator, SensorOptions, SimOptions};

type Failure = Box<dyn std::error::Error>;

/// Samples of a run at 1 kHz, twenty blocks.
const BLOCK: usize = 1900;
const COUNT: usize = 20 * BLOCK;
/// Each estimator runs so often; its fastest run counts, because the rest is other people's work.
const REPETITIONS: usize = 5;
/// Variance of each parameter at the start of a recursion, in squared units of the parameter; the start is 0.
const START_VARIANCE: f64 = 1e6;

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

/// The linear parameters: θ₁ … θ₅ and θ₆, θ₇, θ₈, θ₆θ₉, θ₇θ₉ become θ.
fn theta_of(one: &[f64], two: &[f64]) -> Vec<f64> {
    let mut theta = one.to_vec();
    theta.extend([two[0], two[1], two[2], two[4] / two[1]]);
    theta
}

/// Worst and median relative error.
fn errors(theta: &[f64], truth: &[f64]) -> (f64, f64) {
    let mut errors: Vec<f64> = theta
        .iter()
        .zip(truth)
        .map(|(t, truth)| (t / truth - 1.0).abs())
        .collect();
    errors.sort_by(f64::total_cmp);
    (errors[errors.len() - 1], errors[errors.len() / 2])
}

/// Runs `work` several times and prints its line.
fn report(job: &str, name: &str, truth: &[f64], mut work: impl FnMut() -> Vec<f64>) {
    let mut best = f64::INFINITY;
    let mut theta = Vec::new();
    for _ in 0..REPETITIONS {
        let start = Instant::now();
        theta = black_box(work());
        best = best.min(start.elapsed().as_secs_f64());
    }
    let (worst, median) = errors(&theta, truth);
    println!(
        "{job},{name},{COUNT},{:.4},{worst:.4e},{median:.4e}",
        best / COUNT as f64 * 1e9
    );
}

fn write(folder: &Path, name: &str, head: &str, rows: impl Iterator<Item = Vec<f64>>) -> Result<(), Failure> {
    let mut text = format!("{head}\n");
    for row in rows {
        for (i, value) in row.iter().enumerate() {
            write!(text, "{}{value:?}", if i > 0 { "," } else { "" })?;
        }
        text.push('\n');
    }
    Ok(std::fs::write(folder.join(name), text)?)
}

fn rows_of(features: &[ManipulatorFeatures]) -> Vec<[([f64; 5], f64); 2]> {
    features.iter().map(|f| [f.linear_row(0), f.linear_row(1)]).collect()
}

fn main() -> Result<(), Failure> {
    let folder = std::env::args()
        .nth(1)
        .ok_or("expected the folder for the data as the one argument")?;
    let folder = Path::new(&folder);
    std::fs::create_dir_all(folder)?;
    let config = configuration()?;
    let truth = config.plant.sim.true_theta(0.0);

    // exact signals with a noisy voltage: rows at each sample
    let sim = SimOptions {
        sensors: SensorOptions {
            input_noise_v: 0.05,
            ..SensorOptions::exact()
        },
        ..config.plant.sim.clone()
    };
    let exact: Vec<JointSample> = ArmSimulator::new(&sim)?.take(COUNT).collect();
    let model = Manipulator::default();
    let features: Vec<ManipulatorFeatures> = exact.iter().map(|sample| model.features(sample)).collect();
    let rows = rows_of(&features);
    let head = "a1,a2,a3,a4,a5,y_a,b1,b2,b3,b4,b5,y_b";
    write(
        folder,
        "rows.csv",
        head,
        rows.iter()
            .map(|[(a, y), (b, z)]| [&a[..], &[*y], &b[..], &[*z]].concat()),
    )?;
    write(folder, "truth.csv", "theta", truth.iter().map(|t| vec![*t]))?;
    // what drives report
    let seen: Vec<JointSample> = ArmSimulator::new(&config.plant.sim)?.take(COUNT).collect();
    let log = seen
        .iter()
        .map(|s| vec![s.q[0], s.q[1], s.setpoint[0], s.setpoint[1], s.input[0], s.input[1]]);
    write(
        folder,
        "log.csv",
        "q_1_rad,q_2_rad,setpoint_1_rad,setpoint_2_rad,voltage_1_v,voltage_2_v",
        log,
    )?;

    report("rows", "thetabus Wrls", &truth, || {
        let new = || Wrls::new(&[0.0; 5], 1.0, 1.0 / START_VARIANCE);
        let (Ok(mut one), Ok(mut two)) = (new(), new()) else {
            return Vec::new();
        };
        for [(a, y), (b, z)] in &rows {
            let _ = one.update(a, *y);
            let _ = two.update(b, *z);
        }
        theta_of(one.theta(), two.theta())
    });
    report("rows", "oxictl Rls f64", &truth, || {
        let new = || oxictl::adaptive::rls::Rls::<f64, 5>::new(1.0, START_VARIANCE);
        let (mut one, mut two) = (new(), new());
        for [(a, y), (b, z)] in &rows {
            one.update(a, *y);
            two.update(b, *z);
        }
        theta_of(&one.theta, &two.theta)
    });
    let narrow: Vec<[(SVector<f32, 5>, f32); 2]> = rows
        .iter()
        .map(|row| row.map(|(a, y)| (SVector::from(a.map(|x| x as f32)), y as f32)))
        .collect();
    let wide = |x: &SVector<f32, 5>| -> Vec<f64> { x.iter().map(|&x| f64::from(x)).collect() };
    report("rows", "flight-solver Rls f32", &truth, || {
        let new = || Rls::<5, 1>::new(START_VARIANCE as f32, 1.0, CovarianceGuards::default());
        let (mut one, mut two) = (new(), new());
        for [(a, y), (b, z)] in &narrow {
            one.update(a, &SVector::from([*y]));
            two.update(b, &SVector::from([*z]));
        }
        theta_of(&wide(one.params()), &wide(two.params()))
    });
    report("rows", "flight-solver InverseQrRls f32", &truth, || {
        let new = || InverseQrRls::<5, 1>::new(START_VARIANCE as f32, 1.0);
        let (mut one, mut two) = (new(), new());
        for [(a, y), (b, z)] in &narrow {
            one.update(a, &SVector::from([*y]));
            two.update(b, &SVector::from([*z]));
        }
        theta_of(&wide(one.params()), &wide(two.params()))
    });

    let options = EstimatorOptions {
        noise_floor: vec![0.0; 2],
        ..config.estimator.options.clone()
    };
    let blocks = BlockEstimator::new(structure(&model), options)?;
    report("samples", "thetabus pointwise (with blocks)", &truth, || {
        let mut estimator = blocks.clone();
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
