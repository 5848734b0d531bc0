//! Computing time of the estimator, measured on the configured run.

use super::common::STUDY_NOISE_V;
use super::contenders::run_blocks;
use super::document::{Section, Table, two_digits};
use super::encoder_setup::{EncoderSetup, Signals};
use super::simulated::{changes, noisy};
use super::{CompareError, Reference, Scenario};
use crate::estimator::{BlockEstimator, ChangeKind, EstimatorOptions, Residuals};
use crate::model::Manipulator;
use crate::rows::{InputSource, PointwiseBlock, ProjectedBlock, SampleBlock, structure};
use crate::sim::{ArmSimulator, SimOptions};
use std::hint::black_box;
use std::time::{Duration, Instant};

/// Repetitions of each piece of work; the fastest one is used.
const REPETITIONS: usize = 5;

fn fastest(mut work: impl FnMut()) -> Duration {
    let once = |_| {
        let start = Instant::now();
        work();
        start.elapsed()
    };
    (0..REPETITIONS).map(once).min().unwrap_or_default()
}

/// The table of times for a block of this length \[s\].
struct Times {
    table: Table,
    block_s: f64,
}

impl Times {
    fn new(block_len: usize, sim: &SimOptions) -> Self {
        Self {
            table: Table::new(&["work", "count", "median", "worst", "share of the block's time, worst"]),
            block_s: block_len as f64 * sim.sample_period_s,
        }
    }

    /// A line for `times`, each of `per` pieces of work; none if there are no times.
    fn row(&mut self, work: &str, times: &mut [Duration], per: usize, (unit, name): (f64, &str)) {
        times.sort();
        let (Some(&middle), Some(&worst)) = (times.get(times.len() / 2), times.last()) else {
            return;
        };
        let value = |time: Duration| format!("{} {name}", two_digits(time.as_secs_f64() / per as f64 * unit));
        let share = 100.0 * worst.as_secs_f64() / self.block_s;
        self.table.push(vec![
            work.to_owned(),
            times.len().to_string(),
            value(middle),
            value(worst),
            format!("{} %", two_digits(share)),
        ]);
    }
}

const NANOSECONDS: (f64, &str) = (1e9, "ns");
const MICROSECONDS: (f64, &str) = (1e6, "µs");

fn how(block_len: usize) -> String {
    format!(
        "One core of a shared machine: each stage runs {REPETITIONS} times on the same input; the fastest time counts, because slower ones include \
         other load. Nine parameters, f64, N = {block_len}"
    )
}

/// Time per sample and per block; figures differ between runs and machines.
///
/// # Errors
/// If the options are invalid.
pub fn speed_section(
    sim: &SimOptions,
    block_len: usize,
    ours: &EstimatorOptions,
    seeds: u64,
) -> Result<Section, CompareError> {
    let mut times = Times::new(block_len, sim);
    let samples: Vec<_> = ArmSimulator::new(sim)?.take(20 * block_len).collect();
    let mut block = PointwiseBlock::new(Manipulator::default(), InputSource::Measured, block_len);
    let start = ours.theta_start();
    let (mut taking, mut rows) = (Vec::new(), Vec::new());
    for chunk in samples.chunks_exact(block_len) {
        taking.push(fastest(|| {
            block.clear();
            for sample in chunk {
                black_box(block.push(0, sample));
            }
        }));
        rows.push(fastest(|| {
            for index in 0..block.len() {
                for equation in 0..2 {
                    let mut regressor = [0.0; 5];
                    black_box(block.row(equation, index, &start, &mut regressor));
                    black_box(regressor);
                }
            }
        }));
    }
    times.row("take a sample in", &mut taking, block_len, NANOSECONDS);
    times.row("both rows of a sample at a new θ", &mut rows, block_len, NANOSECONDS);

    let (mut quiet, mut few, mut many) = (Vec::new(), Vec::new(), Vec::new());
    let (mut line, mut alarm) = (Vec::new(), Vec::new());
    for mass_2 in std::iter::once(sim.mass_2.clone()).chain(changes().into_iter().map(|(_, mass)| mass)) {
        for kind in Reference::ALL {
            for seed in 0..seeds {
                let sim = SimOptions {
                    mass_2: mass_2.clone(),
                    duration_s: 90.0,
                    ..noisy(sim, STUDY_NOISE_V)
                };
                let scenario = Scenario::simulate(&kind.apply(&sim, seed))?;
                let mut record = run_blocks(&scenario, block_len, ours)?;
                for _ in 1..REPETITIONS {
                    let again = run_blocks(&scenario, block_len, ours)?;
                    for (time, again) in record.times.iter_mut().zip(again.times) {
                        *time = again.min(*time);
                    }
                }
                for (block, &time) in record.blocks.iter().zip(&record.times) {
                    match (block.change.map(|change| change.kind), block.iterations) {
                        (Some(ChangeKind::Between | ChangeKind::Within), _) => alarm.push(time),
                        (Some(ChangeKind::Drift), _) => line.push(time),
                        (None, 0..=2) => quiet.push(time),
                        (None, 3) => few.push(time),
                        (None, _) => many.push(time),
                    }
                }
            }
        }
    }
    for (work, list) in [
        ("block, 1 or 2 iterations", &mut quiet),
        ("block, 3 iterations", &mut few),
        ("block, more iterations", &mut many),
        ("block of a drift", &mut line),
        ("block with an alarm: fit, test, locate, fit again", &mut alarm),
    ] {
        times.row(work, list, 1, MICROSECONDS);
    }
    Ok(Section {
        heading: "Speed".to_owned(),
        text: vec![format!(
            "{}, {STUDY_NOISE_V} V of noise; steps, sines and square with the configured jump and every change of the \
             payload above. The block's time is {:.1} s, all but these microseconds of which are left for other things.",
            how(block_len),
            times.block_s
        )],
        table: times.table,
    })
}

/// The same for projected rows with automatic differentiation.
///
/// # Errors
/// If the options are invalid.
pub fn projected_speed_section(setup: &EncoderSetup, seeds: u64) -> Result<Section, CompareError> {
    let (sim, block_len) = (&setup.sim, setup.block_len);
    let mut taking = Vec::new();
    let (mut quiet, mut three, mut many, mut alarm) = (Vec::new(), Vec::new(), Vec::new(), Vec::new());
    let mut preparing = Vec::new();
    for signals in Signals::MAIN {
        for seed in 0..seeds {
            let sim = SimOptions {
                duration_s: 90.0,
                ..signals.apply(sim, seed)
            };
            let samples: Vec<_> = ArmSimulator::new(&sim)?.take(sim.sample_count() as usize).collect();
            let mut fastest = vec![[Duration::MAX; 3]; samples.len() / block_len];
            let mut kinds = Vec::new();
            for _ in 0..REPETITIONS {
                kinds.clear();
                let plant = Manipulator::default();
                let rows = ProjectedBlock::new(plant, setup.rows, block_len)?;
                let mut rows = rows.starting_at(&setup.options.theta_start())?;
                let mut estimator = BlockEstimator::new(structure(&plant), setup.options.clone())?;
                for ((chunk, fastest), first) in samples
                    .chunks_exact(block_len)
                    .zip(&mut fastest)
                    .zip((0u64..).step_by(block_len))
                {
                    let start = Instant::now();
                    for (sample, k) in chunk.iter().zip(first..) {
                        let _taken = rows.push(k * 1_000_000, sample);
                    }
                    let taken = Instant::now();
                    rows.prepare(estimator.theta());
                    let prepared = Instant::now();
                    let report = estimator.update(&rows);
                    kinds.push((report.change.is_some(), report.iterations));
                    let done = Instant::now();
                    rows.clear();
                    for (fastest, time) in fastest
                        .iter_mut()
                        .zip([taken - start, prepared - taken, done - prepared])
                    {
                        *fastest = time.min(*fastest);
                    }
                }
            }
            for ([take, prepare, update], (changed, iterations)) in fastest.into_iter().zip(kinds) {
                taking.push(take);
                preparing.push(prepare);
                match (changed, iterations) {
                    (true, _) => alarm.push(prepare + update),
                    (false, 0..=2) => quiet.push(prepare + update),
                    (false, 3) => three.push(prepare + update),
                    (false, _) => many.push(prepare + update),
                }
            }
        }
    }
    let mut times = Times::new(block_len, sim);
    times.row("take a sample in", &mut taking, block_len, NANOSECONDS);
    for (work, list) in [
        ("rows of a block and their whitening", &mut preparing),
        ("block, whitening included, 1 or 2 iterations", &mut quiet),
        ("block, whitening included, 3 iterations", &mut three),
        ("block, whitening included, more iterations", &mut many),
        ("block with an alarm: whiten, fit, test, locate, fit again", &mut alarm),
    ] {
        times.row(work, list, 1, MICROSECONDS);
    }
    Ok(Section {
        heading: "Speed".to_owned(),
        text: vec![format!(
            "{}; steps, square and sines with the configured sensors and jump. Rows and exact Jacobians come from the definition of the plant by automatic differentiation.",
            how(block_len)
        )],
        table: times.table,
    })
}
