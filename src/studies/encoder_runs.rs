//! Runs of the encoder study, and their evaluation.

use super::CompareError;
use super::document::count;
use super::encoder_setup::{EncoderSetup, Signals};
use super::metrics::{blocks_to_stay_within, median, worst_relative_error};
use super::paper::ALL;
use crate::estimator::{BlockEstimator, Change, EstimatorOptions, IndexSet, ParameterPrior};
use crate::model::{AutoDiff, Delayed, Manipulator, Plant};
use crate::rows::{ProjectedBlock, SampleBlock, SmoothedBlock, SmoothedOptions, structure};
use crate::sim::{ArmSimulator, SimOptions};

/// Parameters that gravity informs on: θ₆, θ₇, θ₉.
const PAYLOAD: [usize; 3] = [5, 6, 8];
/// Parameters that a run with 16 bits can determine: θ₂, θ₄…θ₉.
const KNOWABLE: [usize; 7] = [1, 3, 4, 5, 6, 7, 8];
/// Number of first blocks left out of the coverage.
const SETTLING: usize = 5;

/// Result of one block.
#[derive(Debug, Clone)]
pub struct Answer {
    /// θ̂.
    pub theta: Vec<f64>,
    /// Its standard deviations.
    pub std: Vec<f64>,
    /// Parameters that are marked usable.
    pub usable: IndexSet,
    /// A reported change.
    pub change: Option<Change>,
    /// True θ at the end of the block.
    pub truth: Vec<f64>,
}

/// Identifies from any rows; one result per complete block.
///
/// # Errors
/// If the options are invalid.
pub fn identify<B: SampleBlock>(
    sim: &SimOptions,
    mut rows: B,
    plant: &impl Plant,
    options: &EstimatorOptions,
    block_len: usize,
) -> Result<Vec<Answer>, CompareError> {
    let mut estimator = BlockEstimator::new(structure(plant), options.clone())?;
    let mut answers = Vec::new();
    let period_ns = sim.sample_period_s * 1e9;
    for (k, sample) in (0..sim.sample_count()).zip(ArmSimulator::new(sim)?) {
        // a block has capacity for all its samples
        let _taken = rows.push((k as f64 * period_ns).round() as u64, &sample);
        if (k + 1) % block_len as u64 == 0 {
            rows.prepare(estimator.theta());
            let report = estimator.update(&rows);
            let mut truth = sim.true_theta(k as f64 * sim.sample_period_s).to_vec();
            if plant.input_delay().is_some() {
                truth.push(sim.sensors.input_delay_s);
            }
            answers.push(Answer {
                theta: report.theta.clone(),
                std: report.theta_std.clone(),
                usable: report.usable,
                change: report.change,
                truth,
            });
            rows.clear();
        }
    }
    Ok(answers)
}

/// A run with projected rows.
///
/// # Errors
/// If the options are invalid.
pub fn run_projected(setup: &EncoderSetup, signals: Option<Signals>, seed: u64) -> Result<Vec<Answer>, CompareError> {
    let plant = Manipulator::default();
    let sim = signals.map_or_else(|| setup.sim.clone(), |signals| signals.apply(&setup.sim, seed));
    let rows = ProjectedBlock::new(plant, setup.rows, setup.block_len)?.starting_at(&setup.options.theta_start())?;
    identify(&sim, rows, &plant, &setup.options, setup.block_len)
}

/// Evaluation of a run with a jump of the payload.
#[derive(Debug, Clone)]
pub struct Judged {
    /// Relative error of each parameter at the end.
    pub end: Vec<f64>,
    /// Blocks from that of the jump (0) until θ₆, θ₇ and θ₉ stay within 1 %.
    pub payload_to_1: Option<usize>,
    /// Blocks from that of the jump (0) until all nine stay within 1 %.
    pub all_to_1: Option<usize>,
    /// Blocks from the start until all nine are within 1 % up to the jump.
    pub start_to_1: Option<usize>,
    /// Largest error of a usable θ₂ or θ₄…θ₉ in any block.
    pub usable_error: f64,
    /// Difference of the reported time of the jump from the true one \[s\].
    pub off_s: Option<f64>,
    /// Changes reported in blocks other than that of the jump and the next.
    pub other_alarms: usize,
    /// Number of 95 % intervals that contain the truth, and of all, from the sixth block on without
    /// the two of the jump.
    pub held: (usize, usize),
}

pub(super) fn within(answer: &Answer, p: usize) -> bool {
    (answer.theta[p] - answer.truth[p]).abs() <= 1.96 * answer.std[p]
}

pub(super) fn error(answer: &Answer, parameters: &[usize]) -> f64 {
    worst_relative_error(&answer.theta, &answer.truth, parameters)
}

/// Evaluates a run; `jump_s` is the time of the jump.
pub fn judge(setup: &EncoderSetup, answers: &[Answer], jump_s: f64) -> Judged {
    let jump = (jump_s / setup.sim.sample_period_s).round() as usize / setup.block_len;
    let errors = |parameters: &[usize]| -> Vec<f64> { answers.iter().map(|a| error(a, parameters)).collect() };
    let announced = answers.iter().skip(jump).take(2).find_map(|a| a.change);
    let usable = |a: &Answer| {
        let marked = KNOWABLE.into_iter().filter(|p| a.usable.contains(*p));
        marked.map(|p| error(a, &[p])).fold(0.0, f64::max)
    };
    let quiet = |b: &usize| !(jump..jump + 2).contains(b);
    let held: Vec<bool> = (SETTLING..answers.len())
        .filter(quiet)
        .flat_map(|b| ALL.map(|p| within(&answers[b], p)))
        .collect();
    Judged {
        end: answers
            .last()
            .map_or(Vec::new(), |a| ALL.map(|p| error(a, &[p])).to_vec()),
        payload_to_1: blocks_to_stay_within(&errors(&PAYLOAD), jump, 0.01),
        all_to_1: blocks_to_stay_within(&errors(&ALL), jump, 0.01),
        start_to_1: blocks_to_stay_within(&errors(&ALL)[..jump.min(answers.len())], 0, 0.01).map(|b| b + 1),
        usable_error: answers.iter().map(usable).fold(0.0, f64::max),
        off_s: announced.map(|change| (change.time as f64 * 1e-9 - jump_s).abs()),
        other_alarms: (0..answers.len())
            .filter(quiet)
            .filter(|&b| answers[b].change.is_some())
            .count(),
        held: (held.iter().filter(|h| **h).count(), held.len()),
    }
}

pub(super) fn pair(values: impl Iterator<Item = f64>, show: &dyn Fn(f64) -> String) -> String {
    let mut values: Vec<f64> = values.collect();
    let middle = median(&mut values);
    format!(
        "{} / {}",
        show(middle),
        show(values.last().copied().unwrap_or(f64::NAN))
    )
}

pub(super) fn blocks(value: f64) -> String {
    count(value.is_finite().then_some(value as usize))
}

pub(super) fn number(value: Option<usize>) -> f64 {
    value.map_or(f64::INFINITY, |v| v as f64)
}

/// Treatment of a delayed input.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Skew {
    /// Ignored.
    Ignored,
    /// The delay is configured.
    Configured,
    /// The delay is a parameter with a prior standard deviation of 1 ms.
    Estimated,
}

/// A run whose input acts `delay_s` late.
///
/// # Errors
/// If the options are invalid.
pub fn skew_run(
    setup: &EncoderSetup,
    signals: Signals,
    seed: u64,
    delay_s: f64,
    skew: Skew,
) -> Result<Vec<Answer>, CompareError> {
    let mut setup = setup.clone();
    setup.sim.sensors.input_delay_s = delay_s;
    match skew {
        Skew::Ignored => run_projected(&setup, Some(signals), seed),
        Skew::Configured => {
            setup.rows.input_delay_s = delay_s;
            run_projected(&setup, Some(signals), seed)
        }
        Skew::Estimated => {
            let plant = Delayed::new(Manipulator::default(), 0.0, 5e-3);
            let mut options = setup.options.clone();
            let delay = ParameterPrior::new(0.0).std(1e-3).within(-5e-3, 5e-3);
            options.parameters.push(delay);
            let rows =
                ProjectedBlock::new(plant.clone(), setup.rows, setup.block_len)?.starting_at(&options.theta_start())?;
            identify(
                &signals.apply(&setup.sim, seed),
                rows,
                &plant,
                &options,
                setup.block_len,
            )
        }
    }
}

/// The simple fallback on the arm.
///
/// # Errors
/// If the options are invalid.
pub fn run_smoothed(
    setup: &EncoderSetup,
    smoothed: SmoothedOptions,
    signals: Signals,
    seed: u64,
) -> Result<Vec<Answer>, CompareError> {
    let plant = Manipulator::default();
    let rows = SmoothedBlock::new(AutoDiff(plant), plant.joints(), smoothed, setup.block_len)?;
    let mut options = setup.options.clone();
    options.equations.iter_mut().for_each(|noise| noise.floor = 0.0);
    options.change_detection = None;
    identify(
        &signals.apply(&setup.sim, seed),
        rows,
        &plant,
        &options,
        setup.block_len,
    )
}
