//! Judges whether an estimate may be used: the states of a stream of reports, with hysteresis.
//!
//! | state | entered | left |
//! |---|---|---|
//! | `Collecting` | at the start | with the first block that gives an estimate |
//! | `Converging` | otherwise | |
//! | `Converged` | after two blocks in a row that the estimate before them predicted and that moved it little; more after repeated misfits | a block that it does not predict |
//! | `Changing` | a change of the plant in this block | a later block that was predicted, as soon as it is clear what has changed |
//! | `PoorlyExcited` | two blocks in a row that leave some direction of the free parameters open | a block that leaves none |
//! | `Degraded` | more than 5 % of the samples lost or of the rows outliers | two blocks in a row with at most 1 % |
//! | `Misfit` | a block that does not fit, a model that leaves too much unexplained, or a drive or sensor that has changed while the plant cannot have changed that way | a block that fits |
//! | `Invalid` | a block that cannot be evaluated at θ̂ | the next that can |
//!
//! *Predicted* means that the innovation is within 1.5 standard deviations of the noise, or 2 % of
//! the size of the equation's terms, in every equation; `Converged` is left only at twice the
//! former and 5 %. This judges θ̂ as a whole: a direction that hardly affects the plant need not be
//! known to predict the plant. *Moved little* means by less than three standard deviations or 1 %.
//!
//! A model that fails repeatedly is not right when a block happens to fit. Each misfit therefore
//! requires three blocks that fit, at most 11 in all; after a single one, the two that `Converged`
//! requires anyway are enough. A misfit of a block in which more than 0.1 % of the samples are lost
//! or replaced requires nothing more, because these may have caused it.
//!
//! Controllers may use θ̂ (`use_ok`) in `Converged`, and in `PoorlyExcited` if it had converged
//! before and no change was seen since; in both only with the evidence of `evidence.rs`: the data
//! have informed on more than half of the directions of some group, the block fits, the model
//! explains the signals of every equation, the data push no parameter against a bound, and at least
//! one parameter is usable. In a block in which the machine rests and no row counts, they may not.

use super::explained::LEAST_EXPLAINED;
use super::fit_statistic::MISFIT;
use super::persist::Visit;
use super::report::{ChangeKind, Held, Report};

/// State of the identification.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default)]
pub enum Phase {
    /// No estimate yet.
    #[default]
    Collecting,
    /// Estimates exist and still move.
    Converging,
    /// Estimates predict the plant.
    Converged,
    /// The data leave parameters, or combinations of them, open.
    PoorlyExcited,
    /// The plant has just changed.
    Changing,
    /// Too many rows are missing or outliers.
    Degraded,
    /// The model cannot be evaluated.
    Invalid,
    /// The block does not fit the model.
    Misfit,
}

/// The judgement on a report.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default)]
pub struct Verdict {
    /// State of the identification.
    pub phase: Phase,
    /// True if controllers may use θ̂.
    pub use_ok: bool,
}

/// Follows the reports of one estimator.
#[derive(Debug, Clone)]
pub struct StateMachine {
    theta: Vec<f64>,
    predicted: u32,
    poor: u32,
    clean: u32,
    /// One more than the number of blocks that must fit before θ̂ may be used again.
    distrust: u32,
    changing: bool,
    degraded: bool,
    converged: bool,
    seen: bool,
    misfit: bool,
    informed: bool,
    least_explained: f64,
}

impl StateMachine {
    // the numbers of the table at the top of this file
    const NOISE: f64 = 1.5;
    const SIGNAL: f64 = 0.02;
    const LEAVE_NOISE: f64 = 3.0;
    const LEAVE_SIGNAL: f64 = 0.05;
    const MOVED: f64 = 0.01;
    const LOST: f64 = 0.05;
    const CLEAN: f64 = 0.01;
    const SPOILT: f64 = 0.001;
    const MISFIT_COSTS: u32 = 3;
    const MOST_DISTRUST: u32 = 12;

    /// The state at the start, for the estimator's start value.
    pub fn new(theta_start: &[f64]) -> Self {
        Self {
            theta: theta_start.to_vec(),
            predicted: 0,
            poor: 0,
            clean: 0,
            distrust: 0,
            changing: false,
            degraded: false,
            converged: false,
            seen: false,
            misfit: false,
            informed: false,
            least_explained: LEAST_EXPLAINED,
        }
    }

    /// With another share of each signal's power that the model is required to explain, 0 to 1.
    #[must_use]
    pub fn explaining(mut self, share: f64) -> Self {
        self.least_explained = share;
        self
    }

    /// Resets to the start, for the estimator's start value.
    pub fn reset(&mut self, theta_start: &[f64]) {
        self.theta.copy_from_slice(theta_start);
        (self.predicted, self.poor, self.clean, self.distrust) = (0, 0, 0, 0);
        (self.changing, self.degraded, self.converged, self.seen) = (false, false, false, false);
        (self.misfit, self.informed) = (false, false);
    }

    /// What goes from block to block; see `persist.rs`.
    pub(crate) fn visit(&mut self, v: &mut impl Visit) {
        v.reals(&mut self.theta);
        for count in [&mut self.predicted, &mut self.poor, &mut self.clean, &mut self.distrust] {
            v.small(count);
        }
        for flag in [
            &mut self.changing,
            &mut self.degraded,
            &mut self.converged,
            &mut self.seen,
            &mut self.misfit,
            &mut self.informed,
        ] {
            v.flag(flag);
        }
    }

    /// Judges the next report; `lost` is the share of the block's samples that are missing or were
    /// refused, 0 to 1.
    pub fn step(&mut self, report: &Report, lost: f64) -> Verdict {
        let equations = report.residual_rms.len().max(1);
        let outliers = f64::from(report.outliers) / (report.rows * equations).max(1) as f64;
        let bad = lost.max(outliers);
        self.clean = if bad <= Self::CLEAN {
            self.clean.saturating_add(1)
        } else {
            0
        };
        self.degraded = bad > Self::LOST || self.degraded && self.clean < 2;
        if report.held == Some(Held::NotFinite) {
            (self.converged, self.predicted) = (false, 0);
            return Verdict {
                phase: Phase::Invalid,
                use_ok: false,
            };
        }
        if report.held.is_none() {
            self.judge(report, bad > Self::SPOILT);
        }
        let phase = if self.degraded {
            Phase::Degraded
        } else if !self.seen {
            Phase::Collecting
        } else if self.changing {
            Phase::Changing
        } else if self.misfit {
            Phase::Misfit
        } else if self.poor >= 2 {
            Phase::PoorlyExcited
        } else if self.converged && self.informed {
            Phase::Converged
        } else {
            Phase::Converging
        };
        // a block without an estimate is no evidence, nor one whose rows all have weight 0, because
        // the machine rested: at rest it may have changed
        let lacks_evidence = report.held.is_some() || report.signal_rms.iter().all(|rms| *rms == 0.0);
        let use_ok = self.converged
            && self.informed
            && !lacks_evidence
            && matches!(phase, Phase::Converged | Phase::PoorlyExcited);
        Verdict { phase, use_ok }
    }

    /// `spoilt`: samples that are lost or replaced may have caused a misfit.
    fn judge(&mut self, report: &Report, spoilt: bool) {
        let free = report.theta.len() as u32 - report.fixed.len() as u32;
        self.poor = if (report.rank as u32) < free {
            self.poor.saturating_add(1)
        } else {
            0
        };
        let within = |noise: f64, signal: f64| {
            (0..report.innovation_rms.len())
                .all(|e| report.innovation_rms[e] <= (noise * report.noise_std[e]).max(signal * report.signal_rms[e]))
        };
        let settled = (0..report.theta.len()).all(|i| {
            let moved = (report.theta[i] - self.theta[i]).abs();
            moved <= (3.0 * report.theta_std[i]).max(Self::MOVED * report.theta[i].abs())
        });
        // the first block has no earlier estimate that could have predicted it
        let predicted = self.seen && settled && within(Self::NOISE, Self::SIGNAL);
        self.predicted = if predicted { self.predicted.saturating_add(1) } else { 0 };
        // an open question, such as what has changed, is no failure of the model
        self.distrust = if report.fit_probability < MISFIT && !spoilt {
            (self.distrust + Self::MISFIT_COSTS).min(Self::MOST_DISTRUST)
        } else {
            self.distrust.saturating_sub(1)
        };
        self.converged = if self.converged {
            within(Self::LEAVE_NOISE, Self::LEAVE_SIGNAL)
        } else {
            self.predicted >= 2 && self.distrust <= 1
        };
        let changed = report.change.is_some_and(|change| change.kind != ChangeKind::Drift);
        if changed {
            (self.changing, self.converged, self.predicted) = (true, false, 0);
        } else if self.predicted > 0 && !report.unclear {
            self.changing = false;
        }
        // before θ̂ predicts a block, a model that explains little is still being learnt
        let judged = report.explained.iter().enumerate();
        let explains = judged
            .filter(|(e, _)| !report.uninformed.contains(*e))
            .all(|(_, &share)| share >= self.least_explained);
        // a machine, or a joint, at rest neither confirms nor refutes its model
        let refuted = self.converged && report.informed && !(explains && report.pressed.is_empty());
        self.misfit = !report.misfit.is_empty() || refuted || report.fault.is_some() && report.unclear;
        self.informed = report.informed && !report.usable.is_empty();
        if !report.misfit.is_empty() {
            (self.converged, self.predicted) = (false, 0);
        }
        self.seen = true;
        self.theta.copy_from_slice(&report.theta);
    }
}

#[cfg(test)]
mod tests {
    use super::super::{BlockEstimator, Change, EstimatorOptions, IndexSet, Structure};
    use super::*;

    // a report of a block that the estimate predicted well
    fn good() -> Report {
        let structure = Structure {
            params: 2,
            equations: std::iter::once(0..2).collect(),
        };
        let mut report = BlockEstimator::new(structure, EstimatorOptions::paper(vec![1.0, 2.0], 1))
            .expect("valid")
            .report()
            .clone();
        report.theta_std = vec![0.001, 0.001];
        (report.rows, report.rank, report.blocks) = (100, 2, 1);
        (report.informed, report.uninformed) = (true, IndexSet::EMPTY);
        (report.explained[0], report.usable) = (1.0, (0..2).collect());
        (report.innovation_rms[0], report.noise_std[0], report.signal_rms[0]) = (1.0, 1.0, 100.0);
        report
    }

    fn drive(machine: &mut StateMachine, change: impl Fn(&mut Report)) -> (Phase, bool) {
        let mut report = good();
        change(&mut report);
        let lost = 1.0 - report.rows as f64 / 100.0;
        let verdict = machine.step(&report, lost);
        (verdict.phase, verdict.use_ok)
    }

    #[test]
    fn fault_each_event_leads_to_its_state_and_back_with_hysteresis() {
        let mut m = StateMachine::new(&[3.0, 3.0]);
        // an empty block gives nothing to judge
        assert_eq!(
            drive(&mut m, |r| (r.held, r.rows) = (Some(Held::Empty), 0)),
            (Phase::Degraded, false)
        );
        let mut m = StateMachine::new(&[3.0, 3.0]);
        assert_eq!(drive(&mut m, |_| ()), (Phase::Converging, false));
        assert_eq!(drive(&mut m, |_| ()), (Phase::Converging, false));
        assert_eq!(drive(&mut m, |_| ()), (Phase::Converged, true));
        // 4 % of the signal is too much to enter `Converged`, but not to stay
        let wavering = |r: &mut Report| r.innovation_rms[0] = 4.0;
        assert_eq!(drive(&mut m, wavering), (Phase::Converged, true));
        assert_eq!(drive(&mut m, |r| r.innovation_rms[0] = 6.0), (Phase::Converging, false));
        assert_eq!(drive(&mut m, wavering), (Phase::Converging, false));
        assert_eq!(drive(&mut m, |_| ()), (Phase::Converging, false));
        assert_eq!(drive(&mut m, |_| ()), (Phase::Converged, true));
        // one poor block has no effect; θ̂ stays usable while nothing else happens
        let poor = |r: &mut Report| r.rank = 1;
        assert_eq!(drive(&mut m, poor), (Phase::Converged, true));
        assert_eq!(drive(&mut m, poor), (Phase::PoorlyExcited, true));
        assert_eq!(drive(&mut m, |_| ()), (Phase::Converged, true));
        // a machine that rests
        assert_eq!(drive(&mut m, |r| r.signal_rms.fill(0.0)), (Phase::Converged, false));
        assert_eq!(drive(&mut m, |_| ()), (Phase::Converged, true));
        // lost rows: entered at once, left after two clean blocks
        assert_eq!(drive(&mut m, |r| r.rows = 97), (Phase::Converged, true));
        assert_eq!(drive(&mut m, |r| r.rows = 90), (Phase::Degraded, false));
        assert_eq!(drive(&mut m, |_| ()), (Phase::Degraded, false));
        assert_eq!(drive(&mut m, |_| ()), (Phase::Converged, true));
        // a change
        let change = |kind| {
            let (row, time, is_late) = (5, 5, false);
            move |r: &mut Report| {
                r.change = Some(Change {
                    kind,
                    row,
                    time,
                    is_late,
                });
            }
        };
        assert_eq!(drive(&mut m, change(ChangeKind::Drift)), (Phase::Converged, true));
        assert_eq!(drive(&mut m, change(ChangeKind::Within)), (Phase::Changing, false));
        assert_eq!(drive(&mut m, |r| r.innovation_rms[0] = 6.0), (Phase::Changing, false));
        assert_eq!(drive(&mut m, |_| ()), (Phase::Converging, false));
        assert_eq!(drive(&mut m, |_| ()), (Phase::Converged, true));
        // not evaluable
        assert_eq!(
            drive(&mut m, |r| r.held = Some(Held::NotFinite)),
            (Phase::Invalid, false)
        );
        assert_eq!(drive(&mut m, |_| ()), (Phase::Converging, false));
    }

    /// Number of blocks that fit before θ̂ may be used again.
    fn blocks_to_use(m: &mut StateMachine) -> usize {
        1 + (0..100).take_while(|_| !drive(m, |_| ()).1).count()
    }

    #[test]
    fn fault_repeated_misfits_cost_more_blocks_that_fit() {
        let misfit = |r: &mut Report| (r.misfit, r.fit_probability) = ((0..1).collect(), 0.0);
        let mut m = StateMachine::new(&[1.0, 2.0]);
        blocks_to_use(&mut m);
        assert_eq!(drive(&mut m, misfit), (Phase::Misfit, false));
        // as many as `Converged` requires anyway
        assert_eq!(blocks_to_use(&mut m), 2);
        for _ in 0..10 {
            drive(&mut m, |_| ());
        }
        // every other block
        for _ in 0..3 {
            assert_eq!(drive(&mut m, misfit), (Phase::Misfit, false));
            assert_eq!(drive(&mut m, |_| ()), (Phase::Converging, false));
        }
        assert_eq!(blocks_to_use(&mut m), 3 * StateMachine::MISFIT_COSTS as usize - 4);
        // a lost sample may be the reason
        let spoilt = |r: &mut Report| (r.misfit, r.fit_probability, r.rows) = ((0..1).collect(), 0.0, 99);
        drive(&mut m, spoilt);
        assert_eq!(blocks_to_use(&mut m), 2);
        for _ in 0..50 {
            drive(&mut m, misfit);
        }
        assert_eq!(blocks_to_use(&mut m), StateMachine::MOST_DISTRUST as usize - 1);
    }

    #[test]
    fn fault_an_estimate_that_still_moves_has_not_converged() {
        let mut m = StateMachine::new(&[1.0, 2.0]);
        for k in 1..10 {
            let theta = 1.0 + 0.02 * f64::from(k);
            assert_eq!(drive(&mut m, |r| r.theta[0] = theta).0, Phase::Converging);
        }
    }
}
