//! One estimator without motion, and with one wrong row in a hundred.

use super::common::STUDY_NOISE_V;
use super::contenders::{BlockResult, RunRecord, run_blocks};
use super::document::{Section, Table, percent, two_digits};
use super::paper::ALL;
use super::simulated::{KNOWABLE, errors, noisy, worst};
use super::{CompareError, Reference, Scenario, for_each_index};
use crate::estimator::{ChangeKind, EstimatorOptions, Forgetting, Outliers};
use crate::sim::{Interpolation, MassSchedule, SensorOptions, Setpoint, SimOptions};

/// 20 blocks of steps, 300 blocks at rest or with joint 1 alone moving, 10 blocks of steps.
fn resting(sim: &SimOptions, block_len: usize, joint_1_moves: bool) -> SimOptions {
    let block_s = block_len as f64 * sim.sample_period_s;
    let (rest_s, wake_s, end_s) = (20.0 * block_s, 320.0 * block_s, 330.0 * block_s);
    let table = |golden: f64, reach: f64, moves_at_rest: bool| {
        let (mut t_s, mut values_rad) = (Vec::new(), Vec::new());
        let mut t = 0.0;
        while t < end_s {
            // Low-discrepancy levels and dwell times.
            let k = t_s.len() as f64;
            let resting = t >= rest_s - 2.0 && t < wake_s && !moves_at_rest;
            t_s.push(t);
            values_rad.push(if resting {
                0.0
            } else {
                reach * (2.0 * (k * golden).fract() - 1.0)
            });
            t += if resting {
                wake_s - t
            } else {
                0.7 + 0.8 * (k * golden * golden).fract()
            };
        }
        Setpoint::Table {
            t_s,
            values_rad,
            interpolation: Interpolation::Step,
        }
    };
    SimOptions {
        duration_s: end_s,
        mass_2: MassSchedule::constant(150.0),
        setpoint: [table(0.618_034, 1.0, joint_1_moves), table(0.754_878, 0.8, false)],
        ..noisy(sim, STUDY_NOISE_V)
    }
}

/// 300 blocks without excitation, then excitation: every forgetting rule.
///
/// # Errors
/// If the options are invalid.
pub fn windup_section(
    sim: &SimOptions,
    block_len: usize,
    ours: &EstimatorOptions,
    seeds: u64,
) -> Result<Section, CompareError> {
    let mut table = Table::new(&[
        "motion",
        "rule",
        "error before",
        "worst at rest",
        "in standard deviations",
        "standard deviation grows by",
        "alarms at rest",
        "1st block after",
        "2nd",
        "3rd",
    ]);
    let seeds = seeds.min(8);
    for joint_1_moves in [false, true] {
        let scenarios = for_each_index(seeds as usize, |seed| {
            let sim = SimOptions {
                seed: sim.seed + 4000 + seed as u64,
                ..sim.clone()
            };
            Scenario::simulate(&resting(&sim, block_len, joint_1_moves))
        });
        let scenarios = scenarios.into_iter().collect::<Result<Vec<_>, _>>()?;
        for rule in Forgetting::ALL {
            let options = EstimatorOptions {
                forgetting: rule,
                ..ours.clone()
            };
            let runs = for_each_index(scenarios.len(), |index| {
                windup_run(&scenarios[index], block_len, &options)
            });
            let runs = runs.into_iter().collect::<Result<Vec<_>, _>>()?;
            let of = |pick: fn(&WindupRun) -> f64| worst(runs.iter().map(pick));
            table.push(vec![
                if joint_1_moves { "joint 1 alone" } else { "at rest" }.to_owned(),
                rule.name().to_owned(),
                percent(of(|r| r.before)),
                percent(of(|r| r.at_rest)),
                two_digits(of(|r| r.deviations)),
                two_digits(of(|r| r.growth)),
                format!(
                    "{} of {}",
                    runs.iter().map(|r| r.alarms).sum::<usize>(),
                    REST.len() * runs.len()
                ),
                percent(of(|r| r.after[0])),
                percent(of(|r| r.after[1])),
                percent(of(|r| r.after[2])),
            ]);
        }
    }
    Ok(Section {
        heading: "Without excitation".to_owned(),
        text: vec![format!(
            "20 blocks of steps, 300 blocks at rest or with joint 1 alone moving, then steps again; {STUDY_NOISE_V} V of noise, the worst of {seeds} seeds. Errors are the worst of \
             θ2 and θ4 to θ9, at rest also in their own standard deviations. The growth of the standard deviation is that of the parameter where it is largest. It is taken from the \
             last block of steps to the last block of rest, or to the one before the first alarm, because after an alarm a resting joint is unconfirmed until it moves. Alarms \
             are counted in the blocks of rest."
        )],
        table,
    })
}

/// Blocks of rest in [`windup_run`].
const REST: std::ops::Range<usize> = 20..320;

/// Effect of a long rest; errors are the worst of θ₂ and θ₄…θ₉, relative.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct WindupRun {
    /// Error before the rest.
    pub before: f64,
    /// Largest error while resting.
    pub at_rest: f64,
    /// The same in standard deviations of the estimate.
    pub deviations: f64,
    /// Largest growth factor of a standard deviation, up to the end of the rest or its first alarm.
    pub growth: f64,
    /// Alarms while resting.
    pub alarms: usize,
    /// Errors in the first three blocks after the rest.
    pub after: [f64; 3],
}

/// One run through a rest of 300 blocks, without motion or with joint 1 alone moving.
///
/// # Errors
/// If the options are invalid.
pub fn rest_run(
    sim: &SimOptions,
    block_len: usize,
    options: &EstimatorOptions,
    joint_1_moves: bool,
) -> Result<WindupRun, CompareError> {
    windup_run(
        &Scenario::simulate(&resting(sim, block_len, joint_1_moves))?,
        block_len,
        options,
    )
}

fn windup_run(scenario: &Scenario, block_len: usize, options: &EstimatorOptions) -> Result<WindupRun, CompareError> {
    let record = run_blocks(scenario, block_len, options)?;
    let errors = errors(scenario, block_len, &record, &KNOWABLE);
    let resting = &record.blocks[REST];
    // an alarm, even a false one, leaves everything open that does not move
    let quiet = resting
        .iter()
        .position(|block| block.change.is_some())
        .unwrap_or(resting.len());
    let truth = scenario.truth(0);
    let deviations = |block: &BlockResult| worst(KNOWABLE.map(|p| ((block.theta[p] - truth[p]) / block.std[p]).abs()));
    Ok(WindupRun {
        before: errors[REST.start - 1],
        at_rest: worst(errors[REST].iter().copied()),
        deviations: worst(resting.iter().map(deviations)),
        growth: worst(ALL.map(|p| record.blocks[REST.start + quiet - 1].std[p] / record.blocks[REST.start - 1].std[p])),
        alarms: resting.iter().filter(|block| block.change.is_some()).count(),
        after: std::array::from_fn(|k| errors[REST.end + k]),
    })
}

/// Largest change of any estimate, in its own standard deviations, by spikes on 1 % of the
/// voltages, 100 times the noise; blocks from the second on.
///
/// # Errors
/// If the options are invalid.
pub fn outlier_effect(
    sim: &SimOptions,
    block_len: usize,
    options: &EstimatorOptions,
    kind: Reference,
    seed: u64,
) -> Result<(f64, usize), CompareError> {
    let clean = kind.apply(&noisy(sim, STUDY_NOISE_V), 3000 + seed);
    let sensors = SensorOptions {
        spike_probability: 0.01,
        spike_v: 100.0 * STUDY_NOISE_V,
        ..clean.sensors
    };
    let spiked = SimOptions {
        sensors,
        ..clean.clone()
    };
    let run = |sim: &SimOptions| run_blocks(&Scenario::simulate(sim)?, block_len, options);
    let (clean, spiked) = (run(&clean)?, run(&spiked)?);
    let pairs = clean.blocks.iter().zip(&spiked.blocks).skip(1);
    let moved = pairs.flat_map(|(a, b)| ALL.map(|p| ((a.theta[p] - b.theta[p]) / a.std[p]).abs()));
    let within = |record: &RunRecord| {
        record
            .blocks
            .iter()
            .filter(|b| b.change.is_some_and(|c| c.kind != ChangeKind::Drift))
            .count()
    };
    Ok((worst(moved), within(&spiked).abs_diff(within(&clean))))
}

/// Spikes and the treatments of outliers.
///
/// # Errors
/// If the options are invalid.
pub fn outliers_section(
    sim: &SimOptions,
    block_len: usize,
    ours: &EstimatorOptions,
    seeds: u64,
) -> Result<Section, CompareError> {
    let mut table = Table::new(&[
        "outliers",
        "reference",
        "worst change of an estimate",
        "alarms more or fewer",
    ]);
    for (name, outliers) in [
        ("keep", Outliers::Keep),
        ("huber 1.345", Outliers::Huber(1.345)),
        ("gate 6", Outliers::Gate(6.0)),
    ] {
        let options = EstimatorOptions {
            outliers,
            ..ours.clone()
        };
        for kind in Reference::ALL {
            let effects = for_each_index(seeds.min(5) as usize, |seed| {
                outlier_effect(sim, block_len, &options, kind, seed as u64)
            });
            let effects = effects.into_iter().collect::<Result<Vec<_>, _>>()?;
            table.push(vec![
                name.to_owned(),
                kind.name().to_owned(),
                format!("{} std", two_digits(worst(effects.iter().map(|e| e.0)))),
                effects.iter().map(|e| e.1).sum::<usize>().to_string(),
            ]);
        }
    }
    Ok(Section {
        heading: "Outliers".to_owned(),
        text: vec![format!(
            "1 % of the voltages carry a spike of 100 times the noise. The same runs with and without spikes, {} seeds each: difference of every estimate from the \
             second block on, in standard deviations of the run without spikes.",
            seeds.min(5)
        )],
        table,
    })
}
