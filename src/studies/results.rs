//! Comparison of the estimators, and the performance of the recommended one with realistic plants.

use super::common::{Effort, STUDY_NOISE_V, covers};
use super::contenders::{BlockResult, RunRecord, run_batch, run_blocks, run_ekf, run_wrls};
use super::document::{Document, Section, Table, count, percent, two_digits};
use super::ekf::EkfTuning;
use super::metrics::{blocks_to_stay_within, median, worst_relative_error};
use super::paper::{ALL, CHANGING};
use super::speed::speed_section;
use super::{CompareError, Scenario, emps, for_each_index, simulated, stress};
use crate::estimator::{CEDRO2022_START, EstimatorOptions, Forgetting, ParameterPrior, cedro2022_estimator};
use crate::sim::{SensorOptions, SimOptions};
use std::time::Duration;

/// All tables for a configured run; `ours` is the configured estimator, `recording` is that of a
/// real machine, position \[m\] and voltage \[V\] at 1 kHz, if available.
///
/// # Errors
/// If the options are invalid, or the run has no jump after the first block.
pub fn results_document(
    sim: &SimOptions,
    block_len: usize,
    ours: &EstimatorOptions,
    effort: Effort,
    recording: Option<&[(f64, f64)]>,
) -> Result<Document, CompareError> {
    Ok(Document {
        title: "Results".to_owned(),
        purpose: "This page compares thetabus with other estimators on the paper's arm, and shows changes, false alarms, calibration and one real axis.".to_owned(),
        sections: vec![
            baselines_section(sim, block_len, ours, 0.0, 1)?,
            baselines_section(sim, block_len, ours, STUDY_NOISE_V, effort.seeds.min(5))?,
            simulated::exact_section(sim, block_len, ours, effort.seeds)?,
            simulated::changes_section(sim, block_len, ours, effort.seeds)?,
            simulated::false_alarms_section(sim, block_len, ours, effort.seeds)?,
            simulated::calibration_section(sim, block_len, ours, effort.calibration_runs)?,
            stress::windup_section(sim, block_len, ours, effort.seeds)?,
            stress::outliers_section(sim, block_len, ours, effort.seeds)?,
            emps::section(recording)?,
            speed_section(sim, block_len, ours, effort.seeds.min(2))?,
        ],
    })
}

/// Evaluation of one run of one estimator.
#[derive(Debug, Clone, PartialEq)]
struct Judgement {
    before: f64,
    changing_to_1: Option<usize>,
    all_to_1: Option<usize>,
    at_end: f64,
    excursion: f64,
    /// Number of intervals that contain the truth, and of all.
    covered: (usize, usize),
    mean_time: Duration,
    worst_time: Duration,
}

/// Number of first blocks left out of the coverage.
const SETTLING: usize = 5;

fn judge(scenario: &Scenario, block_len: usize, jump: usize, record: &RunRecord) -> Judgement {
    let truth = |block: usize| scenario.truth((block + 1) * block_len - 1);
    let errors = |parameters: &[usize]| -> Vec<f64> {
        let of = |(b, block): (usize, &BlockResult)| worst_relative_error(&block.theta, &truth(b), parameters);
        record.blocks.iter().enumerate().map(of).collect()
    };
    let (changing, all) = (errors(&CHANGING), errors(&ALL));
    let judged = record.blocks.iter().enumerate().skip(SETTLING);
    let intervals = judged.flat_map(|(b, block)| ALL.map(|p| covers(block, &truth(b), p)));
    let held: Vec<bool> = intervals.collect();
    Judgement {
        before: all[jump - 1],
        changing_to_1: blocks_to_stay_within(&changing, jump, 0.01),
        all_to_1: blocks_to_stay_within(&all, jump, 0.01),
        at_end: all.last().copied().unwrap_or(f64::NAN),
        excursion: all[jump..].iter().copied().fold(0.0, f64::max),
        covered: (held.iter().filter(|held| **held).count(), held.len()),
        mean_time: record.mean_time(),
        worst_time: record.worst_time(),
    }
}

enum Contender {
    Blocks(EstimatorOptions),
    Wrls(EstimatorOptions),
    Ekf(EkfTuning),
}

impl Contender {
    fn run(&self, scenario: &Scenario, block_len: usize, start: &[f64]) -> Result<RunRecord, CompareError> {
        match self {
            Self::Blocks(options) => run_blocks(scenario, block_len, options),
            Self::Wrls(options) => run_wrls(scenario, block_len, options),
            Self::Ekf(tuning) => Ok(run_ekf(scenario, block_len, start, *tuning)),
        }
    }
}

/// Tunings of the Kalman filter to try; the best is shown.
const RANDOM_WALKS: [f64; 3] = [0.01, 0.03, 0.1];

/// Every estimator on the configured run, with noise of `noise_v` on the measured voltage, over
/// `seeds` seeds.
///
/// # Errors
/// As [`results_document`].
pub fn baselines_section(
    sim: &SimOptions,
    block_len: usize,
    ours: &EstimatorOptions,
    noise_v: f64,
    seeds: u64,
) -> Result<Section, CompareError> {
    let paper = |forgetting| EstimatorOptions {
        forgetting,
        parameters: ours
            .parameters
            .iter()
            .map(|prior| ParameterPrior::new(prior.start).std(prior.std))
            .collect(),
        ..cedro2022_estimator()
    };
    let from_length = |forgetting| EstimatorOptions {
        forgetting,
        ..cedro2022_estimator()
    };
    let mut contenders = vec![("thetabus".to_owned(), Contender::Blocks(ours.clone()))];
    for rule in [
        Forgetting::Exponential,
        Forgetting::BoundedAsPrinted,
        Forgetting::Bounded,
    ] {
        contenders.push((format!("paper, {}", rule.name()), Contender::Blocks(paper(rule))));
    }
    let known = Contender::Blocks(from_length(Forgetting::Bounded));
    contenders.push(("paper, bounded, θ9 known at the start".to_owned(), known));
    let wrls = Contender::Wrls(EstimatorOptions {
        forgetting_factor: 0.9,
        ..ours.clone()
    });
    contenders.push(("WRLS, linear in products".to_owned(), wrls));
    for random_walk in RANDOM_WALKS {
        let tuning = EkfTuning {
            random_walk,
            voltage_std_v: STUDY_NOISE_V,
        };
        contenders.push((
            format!("Kalman filter, walk {}", percent(random_walk)),
            Contender::Ekf(tuning),
        ));
    }

    let start = ours.theta_start();
    let runs = for_each_index(seeds as usize, |seed| -> Result<Vec<Judgement>, CompareError> {
        let sensors = SensorOptions {
            input_noise_v: noise_v,
            ..sim.sensors
        };
        let scenario = Scenario::simulate(&SimOptions {
            seed: sim.seed + seed as u64,
            sensors,
            ..sim.clone()
        })?;
        let (_, jump) = scenario
            .first_change(block_len)
            .filter(|&(_, b)| b > 0)
            .ok_or(CompareError::NoJump)?;
        let mut judged = Vec::new();
        for (_, contender) in &contenders {
            let record = contender.run(&scenario, block_len, &start)?;
            judged.push(judge(&scenario, block_len, jump, &record));
        }
        let last = scenario.len() / block_len - 1;
        let batch = run_batch(&scenario, block_len, &CEDRO2022_START, &[jump - 1, last])?;
        let error = |i: usize, block: usize| {
            worst_relative_error(
                &batch.blocks[i].theta,
                &scenario.truth((block + 1) * block_len - 1),
                &ALL,
            )
        };
        let covered = |i: usize, block: usize| {
            let truth = scenario.truth((block + 1) * block_len - 1);
            ALL.iter().filter(|&&p| covers(&batch.blocks[i], &truth, p)).count()
        };
        judged.push(Judgement {
            before: error(0, jump - 1),
            changing_to_1: None,
            all_to_1: None,
            at_end: error(1, last),
            excursion: error(1, last),
            covered: (covered(0, jump - 1) + covered(1, last), 2 * ALL.len()),
            mean_time: batch.mean_time(),
            worst_time: batch.worst_time(),
        });
        Ok(judged)
    });
    let runs: Vec<Vec<Judgement>> = runs.into_iter().collect::<Result<_, _>>()?;
    let names = contenders
        .iter()
        .map(|(name, _)| name.clone())
        .chain(["batch least squares over all so far".to_owned()]);

    let mut table = Table::new(&[
        "estimator",
        "before the jump",
        "θ2,4,6,7 to 1 %",
        "all to 1 %",
        "at the end",
        "worst after the jump",
        "95 % intervals hold",
        "mean a block",
        "worst",
    ]);
    for (index, name) in names.enumerate() {
        let of = |pick: &dyn Fn(&Judgement) -> f64| {
            median(&mut runs.iter().map(|run| pick(&run[index])).collect::<Vec<_>>())
        };
        let blocks = |pick: &dyn Fn(&Judgement) -> Option<usize>| {
            let middle = of(&|j| pick(j).map_or(f64::INFINITY, |blocks| blocks as f64));
            count(middle.is_finite().then_some(middle as usize))
        };
        let (held, all) = runs.iter().fold((0, 0), |sum, run| {
            (sum.0 + run[index].covered.0, sum.1 + run[index].covered.1)
        });
        let coverage = if noise_v > 0.0 {
            format!("{:.0} %", 100.0 * held as f64 / all as f64)
        } else {
            "–".to_owned()
        };
        let micros =
            |pick: &dyn Fn(&Judgement) -> Duration| format!("{} µs", two_digits(of(&|j| pick(j).as_secs_f64() * 1e6)));
        table.push(vec![
            name,
            percent(of(&|j| j.before)),
            blocks(&|j| j.changing_to_1),
            blocks(&|j| j.all_to_1),
            percent(of(&|j| j.at_end)),
            percent(of(&|j| j.excursion)),
            coverage,
            micros(&|j| j.mean_time),
            micros(&|j| j.worst_time),
        ]);
    }
    let heading = if noise_v > 0.0 {
        format!("Side by side, {noise_v} V of noise on the measured voltage")
    } else {
        "Side by side, exact signals".to_owned()
    };
    Ok(Section {
        heading,
        text: vec![
            format!(
                "The configured run with its start values, N = {block_len}{}. Errors are the worst of all nine parameters. Blocks are counted from the one that \
                 contains the jump (0) to the first after which the errors stay below 1 %; – is never. The intervals are θ̂ ± 1.96 standard deviations, counted \
                 after {SETTLING} blocks. Times are of one core of a shared machine and differ from run to run.",
                if seeds > 1 { format!(", medians over {seeds} seeds of the noise") } else { String::new() }
            ),
            "The paper's variants and WRLS have λ = 0.9 a block. WRLS takes θ6θ9 and θ7θ9 as separate parameters and computes θ9 from their \
             quotient. The \
             Kalman filter estimates 5 states and 9 parameters together at each sample, with three tunings of the random walk (relative, per block); it assumes \
             0.05 V of noise on the voltage. Batch least squares is off line, over all samples from the first to just before the jump, and to the end; it \
             cannot follow a change and has the better start values."
                .to_owned(),
        ],
        table,
    })
}
