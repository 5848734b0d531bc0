//! The estimator on simulated runs of the arm: simulate, identify, compare with the truth.

use thetabus::estimator::{BlockEstimator, EstimatorOptions, Report};
use thetabus::model::Manipulator;
use thetabus::rows::{InputSource, PointwiseBlock, SampleBlock, structure};
use thetabus::sim::{ArmSimulator, Setpoint, SimOptions, Tone};

pub const BLOCK: usize = 1900;

/// Start values off by a mix of × 2.5 and ÷ 2.5.
pub fn start() -> Vec<f64> {
    let truth = SimOptions::cedro2022().true_theta(0.0);
    truth
        .iter()
        .enumerate()
        .map(|(i, t)| if i % 2 == 0 { t * 2.5 } else { t / 2.5 })
        .collect()
}

pub fn options() -> EstimatorOptions {
    let mut options = EstimatorOptions::recommended(start(), 2);
    options.lower = vec![0.0; 9];
    options
}

/// The three kinds of reference; the seed decides levels, times and phases.
pub fn reference(kind: &str, seed: u64) -> SimOptions {
    let mut sim = SimOptions::cedro2022();
    sim.seed = seed;
    let mut draw = crate::support::TestRng(seed.wrapping_mul(77) + 5);
    sim.setpoint = std::array::from_fn(|joint| {
        let reach = [1.0, 0.8][joint];
        match kind {
            "steps" => Setpoint::Random {
                min_rad: -reach,
                max_rad: reach,
                min_dwell_s: 1.0,
                max_dwell_s: 3.0,
            },
            "square" => Setpoint::Square {
                amplitude_rad: reach * draw.between(0.6, 1.0),
                offset_rad: draw.between(-0.15, 0.15),
                period_s: draw.between(1.2, 3.0),
                shift_s: draw.between(0.0, 1.0),
            },
            _ => Setpoint::Sines {
                offset_rad: 0.0,
                tones: (0..6)
                    .map(|k| Tone {
                        amplitude_rad: reach / 6.0,
                        frequency_hz: 0.23 * (5.3f64 / 0.23).powf(k as f64 / 5.0) * draw.between(0.95, 1.05),
                        phase_rad: draw.between(0.0, 6.28),
                    })
                    .collect(),
            },
        }
    });
    sim
}

/// Runs a simulation block by block; `each` gets the block number from 1, the report and the truth at the end of the block.
pub fn run(sim: &SimOptions, options: &EstimatorOptions, noise_v: f64, mut each: impl FnMut(u64, &Report, &[f64; 9])) {
    let mut estimator = BlockEstimator::new(structure(&Manipulator::default()), options.clone()).unwrap();
    let mut block = PointwiseBlock::new(Manipulator::default(), InputSource::Measured, BLOCK);
    let mut noise = Gauss(crate::support::TestRng(sim.seed.wrapping_mul(31) + 1));
    let mut number = 0;
    for (k, mut sample) in ArmSimulator::new(sim)
        .unwrap()
        .take(sim.sample_count() as usize)
        .enumerate()
    {
        for joint in 0..2 {
            sample.input[joint] += noise_v * noise.next();
        }
        assert!(block.push(k as u64 * 1_000_000, &sample));
        if (k + 1) % BLOCK == 0 {
            number += 1;
            let report = estimator.update(&block);
            each(number, report, &sim.true_theta(k as f64 * sim.sample_period_s));
            block.clear();
        }
    }
}

/// Normal deviates by Box and Muller.
pub struct Gauss(pub crate::support::TestRng);
impl Gauss {
    pub fn next(&mut self) -> f64 {
        let (a, b) = (self.0.between(1e-300, 1.0), self.0.between(0.0, 1.0));
        (-2.0 * a.ln()).sqrt() * (std::f64::consts::TAU * b).cos()
    }
}

pub fn worst_error(theta: &[f64], truth: &[f64]) -> f64 {
    theta
        .iter()
        .zip(truth)
        .map(|(a, b)| ((a - b) / b).abs())
        .fold(0.0, f64::max)
}

#[test]
#[ignore = "prints a table"]
fn ident_exact_signals_table() {
    for kind in ["steps", "sines", "square"] {
        for seed in 0..4 {
            let mut sim = reference(kind, seed);
            sim.duration_s = 100.0;
            let mut line = String::new();
            run(&sim, &options(), 0.0, |block, report, truth| {
                let error = worst_error(&report.theta, truth);
                if block <= 3 || (block >= 23 && block < 27) || report.change.is_some() {
                    line += &format!(
                        "\n   #{block} {error:.1e} it {} p {:.0e} {:?} us {:b}",
                        report.iterations,
                        report.change_probability,
                        report.change.map(|c| (c.kind, c.time as f64 / 1e9)),
                        report.usable
                    );
                }
            });
            println!("{kind} {seed}: {line}");
        }
    }
}
