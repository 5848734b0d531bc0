//! Scores of a run's estimates.

use crate::messages::{Estimate, estimate_flags};

/// Number of first blocks left out of coverage and shares, because the estimate is still
/// converging.
const SETTLING: u64 = 5;
/// Relative bound below which a parameter counts as knowable.
const KNOWABLE: f64 = 0.01;
/// A value is dangerous if its error exceeds this many σ
const SIGMAS: f64 = 5.0;
/// and this share of the truth.
const SHARE: f64 = 0.005;
/// Number of alarms and dangerous blocks remembered individually.
const REMEMBERED: usize = 20;
/// Half the width of a 95 % interval in σ.
const INTERVAL: f64 = 1.959_963_984_540_054;

/// A value that was published as usable and is wrong.
#[derive(Debug, Clone, PartialEq)]
pub struct Danger {
    /// Block.
    pub block: u64,
    /// Its name: `theta_7`, `mass_2`.
    pub name: String,
    /// Error relative to the truth.
    pub error: f64,
    /// Error in published σ.
    pub sigmas: f64,
}

/// One parameter over a run.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct ParameterScore {
    /// Error after the last block relative to the truth; 0 if that is 0.
    pub end_error: f64,
    /// The same in published σ.
    pub end_sigmas: f64,
    /// Cramér–Rao bound in the last block that has one, relative to the parameter; 0 without.
    pub bound: f64,
    /// Squared errors over squared bounds, summed over the marks where the bound is below 1 %.
    pub squared_ratio: f64,
    /// Number of these marks.
    pub marks: u32,
    /// Number of known values (σ below half the value) in quiet blocks.
    pub intervals: u64,
    /// Number of these whose 95 % interval contains the truth.
    pub covered: u64,
}

/// One run.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct TrialResult {
    /// Estimates published.
    pub blocks: u64,
    /// With `use_ok = 1`.
    pub use_ok: u64,
    /// First block with `use_ok = 1`.
    pub first_use_ok: Option<u64>,
    /// Dangerous blocks.
    pub dangerous: u64,
    /// The worst of their values, by σ.
    pub worst: Option<Danger>,
    /// Blocks in which an alarm would be false: no change in them or in the block before.
    pub quiet: u64,
    /// Alarms in these.
    pub false_alarms: u64,
    /// The first blocks with a false alarm.
    pub alarmed: Vec<u64>,
    /// The worst value of each of the first dangerous blocks.
    pub dangers: Vec<Danger>,
    /// Number of changes.
    pub changes: u64,
    /// Changes reported in their block or the next.
    pub detected: u64,
    /// Parameters excited, over the settled blocks.
    pub excited: u64,
    /// Parameters excited and usable.
    pub usable: u64,
    /// Parameters excited whose bound is below 1 %, over the settled blocks that have a bound.
    pub knowable: u64,
    /// The same and usable.
    pub knowable_usable: u64,
    /// Number of usable values.
    pub usable_intervals: u64,
    /// Usable values whose 95 % interval contains the truth.
    pub usable_covered: u64,
    /// Each parameter.
    pub parameters: Vec<ParameterScore>,
    /// Cause of a misfit that the identifier named last, if any; set by the caller.
    pub named_cause: Option<String>,
    /// Main contribution to σ that the identifier named last; set by the caller.
    pub named_limit: Option<String>,
    /// Blocks by state name.
    pub states: Vec<(&'static str, u64)>,
}

/// The truth for one estimate.
pub(in crate::studies) struct Truth<'a> {
    /// Names of the parameters.
    pub names: &'a [String],
    /// θ at the block's end.
    pub theta: &'a [f64],
    /// Derived values at the block's end, with their names.
    pub derived: &'a [(String, f64)],
    /// Smallest standard deviations, if there is a bound.
    pub bound: Option<&'a [f64]>,
    /// True if the truth changed within this block.
    pub changed: bool,
    /// True if the truth changed within the block before.
    pub changed_before: bool,
    /// True if the efficiency is measured at this block.
    pub mark: bool,
}

impl TrialResult {
    /// Adds an estimate.
    pub(in crate::studies) fn add(&mut self, estimate: &Estimate, truth: &Truth<'_>) {
        let params = (estimate.params as usize).min(truth.theta.len());
        self.parameters.resize(params, ParameterScore::default());
        self.blocks += 1;
        if let Some(state) = crate::messages::State::from_wire(estimate.state) {
            match self.states.iter_mut().find(|(name, _)| *name == state.name()) {
                Some((_, count)) => *count += 1,
                None => self.states.push((state.name(), 1)),
            }
        }
        let use_ok = estimate.use_ok == 1;
        if use_ok {
            self.use_ok += 1;
            self.first_use_ok.get_or_insert(estimate.block);
        }
        let alarm = estimate.flags & estimate_flags::CHANGED != 0;
        if !truth.changed && !truth.changed_before {
            self.quiet += 1;
            self.false_alarms += u64::from(alarm);
            if alarm && self.alarmed.len() < REMEMBERED {
                self.alarmed.push(estimate.block);
            }
        }
        if use_ok {
            self.look_for_danger(estimate, truth, params);
        }
        let settled = estimate.block > SETTLING;
        for i in 0..params {
            let (value, std) = (estimate.theta[i], estimate.theta_std[i]);
            let error = value - truth.theta[i];
            let bound = truth.bound.and_then(|bound| bound.get(i)).copied();
            let score = &mut self.parameters[i];
            score.end_error = match truth.theta[i] {
                0.0 => 0.0,
                value => (error / value).abs(),
            };
            score.end_sigmas = (error / std).abs();
            if settled && estimate.excited.contains(i) {
                self.excited += 1;
                self.usable += u64::from(estimate.usable.contains(i));
                if bound.is_some_and(|bound| bound < KNOWABLE * truth.theta[i].abs()) {
                    self.knowable += 1;
                    self.knowable_usable += u64::from(estimate.usable.contains(i));
                }
            }
            if settled && !truth.changed {
                let covered = error.abs() <= INTERVAL * std;
                if std < 0.5 * value.abs() {
                    score.intervals += 1;
                    score.covered += u64::from(covered);
                }
                if estimate.usable.contains(i) {
                    self.usable_intervals += 1;
                    self.usable_covered += u64::from(covered);
                }
            }
            if let Some(bound) = bound {
                score.bound = bound / truth.theta[i].abs();
                if truth.mark && score.bound < KNOWABLE {
                    score.squared_ratio += (error / bound).powi(2);
                    score.marks += 1;
                }
            }
        }
    }

    fn look_for_danger(&mut self, estimate: &Estimate, truth: &Truth<'_>, params: usize) {
        let usable = (0..params.min(truth.names.len()))
            .filter(|&i| estimate.usable.contains(i))
            .map(|i| {
                (
                    truth.names[i].as_str(),
                    estimate.theta[i],
                    estimate.theta_std[i],
                    truth.theta[i],
                )
            });
        let derived = truth.derived.iter().zip(&estimate.derived).zip(&estimate.derived_std);
        let derived = derived
            .take(estimate.derived_len as usize)
            .map(|(((name, true_value), &value), &std)| (name.as_str(), value, std, *true_value));
        let mut worst: Option<Danger> = None;
        for (name, value, std, true_value) in usable.chain(derived) {
            let error = ((value - true_value) / true_value).abs();
            let sigmas = (value - true_value).abs() / std;
            // If σ is not a number, nothing is claimed.
            if sigmas > SIGMAS && error > SHARE && worst.as_ref().is_none_or(|worst| sigmas > worst.sigmas) {
                worst = Some(Danger {
                    block: estimate.block,
                    name: name.to_owned(),
                    error,
                    sigmas,
                });
            }
        }
        if let Some(danger) = worst {
            self.dangerous += 1;
            if self.dangers.len() < REMEMBERED {
                self.dangers.push(danger.clone());
            }
            if self.worst.as_ref().is_none_or(|worst| danger.sigmas > worst.sigmas) {
                self.worst = Some(danger);
            }
        }
    }
}
