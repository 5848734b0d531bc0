//! What the estimator costs, measured while it works on the configured run.

use super::contenders::run_blocks;
use super::document::{Section, Table, two_digits};
use super::results::STUDY_NOISE_V;
use super::studies::{changes, noisy};
use super::{CompareError, Reference, Scenario};
use crate::estimator::{ChangeKind, EstimatorOptions, Residuals};
use crate::model::Manipulator;
use crate::rows::{InputSource, PointwiseBlock, SampleBlock};
use crate::sim::{ArmSimulator, SimOptions};
use std::hint::black_box;
use std::time::{Duration, Instant};

/// How often each piece of work is done; its fastest time counts.
const REPETITIONS: usize = 5;

fn fastest(mut work: impl FnMut()) -> Duration {
    let once = |_| {
        let start = Instant::now();
        work();
        start.elapsed()
    };
    (0..REPETITIONS).map(once).min().unwrap_or_default()
}

/// Time per sample and per block; figures differ from run to run and from machine to machine.
///
/// # Errors
/// The options are not valid.
pub fn speed_section(
    sim: &SimOptions,
    block_len: usize,
    ours: &EstimatorOptions,
    seeds: u64,
) -> Result<Section, CompareError> {
    let mut table = Table::new(&["work", "count", "median", "worst", "share of the block's time, worst"]);
    let block_s = block_len as f64 * sim.sample_period_s;
    let mut row = |work: &str, times: &mut Vec<Duration>, per: usize, unit: f64, name: &str| {
        times.sort();
        let (Some(&middle), Some(&worst)) = (times.get(times.len() / 2), times.last()) else {
            return;
        };
        let value = |time: Duration| format!("{} {name}", two_digits(time.as_secs_f64() / per as f64 * unit));
        let share = 100.0 * worst.as_secs_f64() / block_s;
        table.push(vec![
            work.to_owned(),
            times.len().to_string(),
            value(middle),
            value(worst),
            format!("{} %", two_digits(share)),
        ]);
    };

    let samples: Vec<_> = ArmSimulator::new(sim)?.take(20 * block_len).collect();
    let mut block = PointwiseBlock::new(Manipulator::default(), InputSource::Measured, block_len);
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
                    black_box(block.row(equation, index, &ours.theta_start, &mut regressor));
                    black_box(regressor);
                }
            }
        }));
    }
    row("take a sample in", &mut taking, block_len, 1e9, "ns");
    row("both rows of a sample at a new θ", &mut rows, block_len, 1e9, "ns");

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
    row("block, 1 or 2 iterations", &mut quiet, 1, 1e6, "µs");
    row("block, 3 iterations", &mut few, 1, 1e6, "µs");
    row("block, more iterations", &mut many, 1, 1e6, "µs");
    row("block of a drift", &mut line, 1, 1e6, "µs");
    row(
        "block with an alarm: fit, test, locate, fit again",
        &mut alarm,
        1,
        1e6,
        "µs",
    );
    Ok(Section {
        heading: "Speed".to_owned(),
        text: vec![format!(
            "One core of a shared machine: each piece of work is done {REPETITIONS} times with equal input, and the fastest counts, because equal input is equal work and \
             the rest is other people's. Nine parameters, f64, N = {block_len}, {STUDY_NOISE_V} V of noise; steps, sines and square with the configured jump and every change of the \
             payload above. The block's time is {block_s:.1} s, all but these microseconds of which are left for other things."
        )],
        table,
    })
}
