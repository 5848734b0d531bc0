//! One estimator on many runs: changes of every size, false alarms, calibration.

use super::common::{STUDY_NOISE_V, covers, every_run};
use super::contenders::{RunRecord, run_blocks};
use super::document::{Section, Table, percent, two_digits};
use super::metrics::{blocks_to_stay_within, median, worst_relative_error};
use super::paper::ALL;
use super::{CompareError, Reference, Scenario, for_each_index};
use crate::estimator::EstimatorOptions;
use crate::messages::nanoseconds;
use crate::sim::{Interpolation, MassSchedule, SensorOptions, SimOptions};

/// Parameters that gravity informs on: θ₆, θ₇, θ₉, and so the mass of the payload.
const PAYLOAD: [usize; 3] = [5, 6, 8];
/// Parameters that can be determined in a noisy run: θ₂, θ₄…θ₉. θ₁ and θ₃ belong only to link 1, a
/// twentieth of the moving mass.
pub(super) const KNOWABLE: [usize; 7] = [1, 3, 4, 5, 6, 7, 8];

pub(super) fn noisy(sim: &SimOptions, noise_v: f64) -> SimOptions {
    SimOptions {
        sensors: SensorOptions {
            input_noise_v: noise_v,
            ..SensorOptions::exact()
        },
        ..sim.clone()
    }
}

pub(super) fn worst(values: impl IntoIterator<Item = f64>) -> f64 {
    values.into_iter().fold(0.0, f64::max)
}

/// Errors of a run per block, over the chosen parameters.
pub(super) fn errors(scenario: &Scenario, block_len: usize, record: &RunRecord, parameters: &[usize]) -> Vec<f64> {
    let blocks = record.blocks.iter().enumerate();
    blocks
        .map(|(b, block)| worst_relative_error(&block.theta, &scenario.truth((b + 1) * block_len - 1), parameters))
        .collect()
}

/// Result of a run with exact signals and a jump; errors are the worst of all nine parameters.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ExactRun {
    /// Error after the first block.
    pub first: f64,
    /// Iterations of the first block.
    pub iterations: u32,
    /// Error of the block with the jump.
    pub jump: f64,
    /// Largest error of any block.
    pub worst: f64,
    /// True if the change was reported in its block, at the right sample.
    pub found: bool,
    /// Changes reported in other blocks.
    pub other_alarms: usize,
}

/// One run with exact signals; without `kind` as configured.
///
/// # Errors
/// If the options are invalid, or the run has no jump after the first block.
pub fn exact_run(
    sim: &SimOptions,
    block_len: usize,
    ours: &EstimatorOptions,
    kind: Option<Reference>,
    seed: u64,
) -> Result<ExactRun, CompareError> {
    let options = kind.map_or_else(|| sim.clone(), |kind| kind.apply(sim, seed));
    let scenario = Scenario::simulate(&noisy(&options, 0.0))?;
    let (sample, jump) = scenario
        .first_change(block_len)
        .filter(|&(_, b)| b > 0)
        .ok_or(CompareError::NoJump)?;
    let record = run_blocks(&scenario, block_len, ours)?;
    let errors = errors(&scenario, block_len, &record, &ALL);
    let at_ns = nanoseconds(scenario.time_s(sample));
    let alarms = |b: &usize| record.blocks[*b].change.is_some();
    Ok(ExactRun {
        first: errors[0],
        iterations: record.blocks[0].iterations,
        jump: errors[jump],
        worst: worst(errors),
        found: record.blocks[jump].change.is_some_and(|change| change.time == at_ns),
        other_alarms: (0..record.blocks.len()).filter(|b| *b != jump).filter(alarms).count(),
    })
}

/// Exact signals: the first block, the block of the jump, and the time of the jump, per reference.
///
/// # Errors
/// If the options are invalid, or the run has no jump after the first block.
pub fn exact_section(
    sim: &SimOptions,
    block_len: usize,
    ours: &EstimatorOptions,
    seeds: u64,
) -> Result<Section, CompareError> {
    let mut table = Table::new(&[
        "reference",
        "runs",
        "first block",
        "iterations",
        "block of the jump",
        "any block",
        "jump found at its sample",
        "other alarms",
    ]);
    for kind in [
        None,
        Some(Reference::Steps),
        Some(Reference::Sines),
        Some(Reference::Square),
    ] {
        let runs = if kind.is_some() { seeds } else { 1 };
        let results = for_each_index(runs as usize, |seed| exact_run(sim, block_len, ours, kind, seed as u64));
        let results = results.into_iter().collect::<Result<Vec<_>, _>>()?;
        let error = |pick: &dyn Fn(&ExactRun) -> f64| format!("{:.0e}", worst(results.iter().map(pick)));
        table.push(vec![
            kind.map_or("as configured", Reference::name).to_owned(),
            runs.to_string(),
            error(&|r| r.first),
            results.iter().map(|r| r.iterations).max().unwrap_or(0).to_string(),
            error(&|r| r.jump),
            error(&|r| r.worst),
            format!("{} of {runs}", results.iter().filter(|r| r.found).count()),
            results.iter().map(|r| r.other_alarms).sum::<usize>().to_string(),
        ]);
    }
    Ok(Section {
        heading: "Exact signals".to_owned(),
        text: vec![
            "Relative errors, the worst of all runs and all nine parameters. The rest is rounding, and differs with the computer's mathematical functions."
                .to_owned(),
        ],
        table,
    })
}

/// A change of the plant with its name.
pub(super) fn changes() -> Vec<(String, MassSchedule)> {
    let mut cases: Vec<(String, MassSchedule)> = [-0.02, 0.02, -0.133, 0.133, -0.5, 1.0]
        .map(|share| {
            (
                format!("{:+.0} %", share * 100.0),
                MassSchedule::jump(150.0, 45.0, 150.0 * (1.0 + share)),
            )
        })
        .into();
    let twice = MassSchedule {
        points: vec![(0.0, 150.0), (45.0, 170.0), (46.5, 140.0)],
        interpolation: Interpolation::Step,
    };
    cases.push(("+13 %, 1.5 s later −18 %".to_owned(), twice));
    let drift = vec![(0.0, 150.0), (30.0, 150.0), (130.0, 180.0)];
    cases.push((
        "150 to 180 kg in 100 s".to_owned(),
        MassSchedule {
            points: drift,
            interpolation: Interpolation::Linear,
        },
    ));
    cases
}

/// Result of a run with a change of the payload.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ChangeRun {
    /// Difference of the reported time from the true one \[s\]; `None` if the block of the change
    /// and the next report nothing.
    pub off_s: Option<f64>,
    /// Blocks from that of the last jump (0) until θ₆, θ₇ and θ₉ stay within 1 %.
    pub to_1_percent: Option<usize>,
    /// Largest error of a usable θ₂ or θ₄…θ₉ in a block with `use_ok`, from the change on.
    pub usable_error: f64,
    /// Share of blocks with `use_ok`, from the change on.
    pub usable_share: f64,
    /// Share of θ₂ and θ₄…θ₉ that are usable in a block with `use_ok`, of all blocks from the
    /// change on.
    pub usable_parameters: f64,
}

/// One run through a change of the payload.
///
/// # Errors
/// If the options are invalid, or the mass does not change.
pub fn change_run(sim: &SimOptions, block_len: usize, ours: &EstimatorOptions) -> Result<ChangeRun, CompareError> {
    let scenario = Scenario::simulate(sim)?;
    let (sample, block) = scenario.first_change(block_len).ok_or(CompareError::NoJump)?;
    let record = run_blocks(&scenario, block_len, ours)?;
    let announced = record.blocks.iter().skip(block).take(2).find_map(|b| b.change);
    // If there are two changes, the last one is used.
    let last_change_s = sim.mass_2.points.last().map_or(0.0, |point| point.0);
    let last_block = ((last_change_s / sim.sample_period_s).round() as usize) / block_len;
    let mut run = ChangeRun {
        off_s: announced.map(|change| (change.time as f64 * 1e-9 - scenario.time_s(sample)).abs()),
        to_1_percent: blocks_to_stay_within(&errors(&scenario, block_len, &record, &PAYLOAD), last_block, 0.01),
        usable_error: 0.0,
        usable_share: 0.0,
        usable_parameters: 0.0,
    };
    for (b, result) in record
        .blocks
        .iter()
        .enumerate()
        .skip(block)
        .filter(|(_, result)| result.use_ok)
    {
        let truth = scenario.truth((b + 1) * block_len - 1);
        let share = 1.0 / (record.blocks.len() - block) as f64;
        run.usable_share += share;
        for p in KNOWABLE.into_iter().filter(|p| result.usable.contains(*p)) {
            run.usable_parameters += share / KNOWABLE.len() as f64;
            run.usable_error = run.usable_error.max(worst_relative_error(&result.theta, &truth, &[p]));
        }
    }
    Ok(run)
}

/// Jumps of every size, two in a row, and a slow drift: exact and with noise.
///
/// # Errors
/// If the options are invalid.
pub fn changes_section(
    sim: &SimOptions,
    block_len: usize,
    ours: &EstimatorOptions,
    seeds: u64,
) -> Result<Section, CompareError> {
    let mut table = Table::new(&[
        "change",
        "noise",
        "announced",
        "time off by",
        "worst",
        "to 1 %",
        "worst",
        "usable, worst error",
        "usable blocks",
        "usable parameters",
    ]);
    for noise_v in [0.0, STUDY_NOISE_V] {
        for (name, mass_2) in changes() {
            let jumps = mass_2.interpolation == Interpolation::Step;
            let runs = every_run(seeds);
            let results = for_each_index(runs.len(), |index| {
                let (kind, seed) = runs[index];
                let base = SimOptions {
                    duration_s: if jumps { 90.0 } else { 150.0 },
                    mass_2: mass_2.clone(),
                    ..noisy(sim, noise_v)
                };
                change_run(&kind.apply(&base, seed), block_len, ours)
            });
            let results = results.into_iter().collect::<Result<Vec<_>, _>>()?;
            let mut off: Vec<f64> = results.iter().filter_map(|r| r.off_s).collect();
            let (announced, off_worst) = (off.len(), worst(off.iter().copied()));
            let mut blocks: Vec<f64> = results
                .iter()
                .map(|r| r.to_1_percent.map_or(f64::INFINITY, |b| b as f64))
                .collect();
            let (settled_worst, settled) = (worst(blocks.iter().copied()), median(&mut blocks));
            let dash = || "–".to_owned();
            let mean = |share: fn(&ChangeRun) -> f64| {
                format!(
                    "{:.0} %",
                    100.0 * results.iter().map(share).sum::<f64>() / results.len() as f64
                )
            };
            let millis = |s: f64| format!("{} ms", two_digits(s * 1e3));
            let blocks = |value: f64| if value.is_finite() { two_digits(value) } else { dash() };
            table.push(vec![
                name,
                if noise_v > 0.0 {
                    format!("{noise_v} V")
                } else {
                    "none".to_owned()
                },
                format!("{announced} of {}", results.len()),
                if jumps { millis(median(&mut off)) } else { dash() },
                if jumps { millis(off_worst) } else { dash() },
                if jumps { blocks(settled) } else { dash() },
                if jumps { blocks(settled_worst) } else { dash() },
                percent(worst(results.iter().map(|r| r.usable_error))),
                mean(|r| r.usable_share),
                mean(|r| r.usable_parameters),
            ]);
        }
    }
    Ok(Section {
        heading: "Changes of the payload".to_owned(),
        text: vec![format!(
            "{seeds} seeds each of steps, sines and square, runs of 90 s, those with a drift of 150 s.\n\n- A change counts as announced in the block that contains it or the one after \
             it.\n- Blocks are counted from the one that contains the (last) jump until θ6, θ7 and θ9, which depend on the payload, stay within 1 % to the end of the run: median and worst \
             of all runs, – if one never does.\n- Parameters are usable if the estimate marks them so while `use_ok` is set. The table has their worst error over θ2 and θ4 to θ9 in any \
             block from the change on, the share of blocks from the change on with `use_ok`, and the share of these parameters that are usable in them."
        )],
        table,
    })
}

/// Alarms of an unchanged plant.
///
/// # Errors
/// If the options are invalid.
pub fn false_alarms_section(
    sim: &SimOptions,
    block_len: usize,
    ours: &EstimatorOptions,
    seeds: u64,
) -> Result<Section, CompareError> {
    let mut table = Table::new(&["reference", "noise", "blocks", "alarms", "per 1000"]);
    for noise_v in [0.0, STUDY_NOISE_V] {
        for kind in Reference::ALL {
            let (blocks, alarms) = false_alarms(sim, block_len, ours, noise_v, kind, 1000..1000 + seeds)?;
            table.push(vec![
                kind.name().to_owned(),
                if noise_v > 0.0 {
                    format!("{noise_v} V")
                } else {
                    "none".to_owned()
                },
                blocks.to_string(),
                alarms.to_string(),
                two_digits(1000.0 * alarms as f64 / blocks as f64),
            ]);
        }
    }
    Ok(Section {
        heading: "False alarms".to_owned(),
        text: vec!["The payload does not change; no other study uses these seeds.".to_owned()],
        table,
    })
}

/// (blocks, alarms) of runs with a constant payload.
///
/// # Errors
/// If the options are invalid.
pub fn false_alarms(
    sim: &SimOptions,
    block_len: usize,
    ours: &EstimatorOptions,
    noise_v: f64,
    kind: Reference,
    seeds: std::ops::Range<u64>,
) -> Result<(usize, usize), CompareError> {
    let base = SimOptions {
        mass_2: MassSchedule::constant(150.0),
        ..noisy(sim, noise_v)
    };
    let counts = for_each_index((seeds.end - seeds.start) as usize, |index| -> Result<_, CompareError> {
        let scenario = Scenario::simulate(&kind.apply(&base, seeds.start + index as u64))?;
        let record = run_blocks(&scenario, block_len, ours)?;
        Ok((
            record.blocks.len(),
            record.blocks.iter().filter(|block| block.change.is_some()).count(),
        ))
    });
    counts.into_iter().try_fold((0, 0), |sum, count| {
        count.map(|(blocks, alarms)| (sum.0 + blocks, sum.1 + alarms))
    })
}

/// Share of runs whose 95 % interval contains the truth, per parameter, after each of the given
/// numbers of blocks.
///
/// # Errors
/// If the options are invalid.
pub fn calibration(
    sim: &SimOptions,
    block_len: usize,
    ours: &EstimatorOptions,
    kind: Reference,
    runs: u64,
    after: &[usize],
) -> Result<Vec<[f64; 9]>, CompareError> {
    let longest = after.iter().copied().max().unwrap_or(0);
    let base = SimOptions {
        mass_2: MassSchedule::constant(150.0),
        duration_s: (longest * block_len) as f64 * sim.sample_period_s,
        ..noisy(sim, STUDY_NOISE_V)
    };
    let held = for_each_index(runs as usize, |index| -> Result<Vec<[bool; 9]>, CompareError> {
        let scenario = Scenario::simulate(&kind.apply(&base, 2000 + index as u64))?;
        let record = run_blocks(&scenario, block_len, ours)?;
        Ok(after
            .iter()
            .map(|&m| ALL.map(|p| covers(&record.blocks[m - 1], &scenario.truth(m * block_len - 1), p)))
            .collect())
    });
    let held = held.into_iter().collect::<Result<Vec<_>, _>>()?;
    let share = |at: usize, p: usize| held.iter().filter(|run| run[at][p]).count() as f64 / held.len() as f64;
    Ok((0..after.len()).map(|at| ALL.map(|p| share(at, p))).collect())
}

/// Calibration as a table.
///
/// # Errors
/// If the options are invalid.
pub fn calibration_section(
    sim: &SimOptions,
    block_len: usize,
    ours: &EstimatorOptions,
    runs: u64,
) -> Result<Section, CompareError> {
    let mut table = Table::new(&[
        "reference",
        "after",
        "θ1",
        "θ2",
        "θ3",
        "θ4",
        "θ5",
        "θ6",
        "θ7",
        "θ8",
        "θ9",
    ]);
    let options = EstimatorOptions {
        forgetting_factor: 0.95,
        ..ours.clone()
    };
    for kind in [Reference::Steps, Reference::Sines] {
        for (after, shares) in [10, 50]
            .iter()
            .zip(calibration(sim, block_len, &options, kind, runs, &[10, 50])?)
        {
            let mut row = vec![kind.name().to_owned(), format!("{after} blocks")];
            row.extend(shares.iter().map(|share| format!("{:.1} %", share * 100.0)));
            table.push(row);
        }
    }
    Ok(Section {
        heading: "Calibration".to_owned(),
        text: vec![format!(
            "Share of {runs} runs, each with its own reference and {STUDY_NOISE_V} V of noise, whose 95 % interval (θ̂ ± 1.96 standard deviations) contains \
             the truth; λ = 0.95. One standard deviation of the counting itself is {:.1} points.",
            100.0 * (0.95 * 0.05 / runs as f64).sqrt()
        )],
        table,
    })
}
