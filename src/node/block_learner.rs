//! The learner of a plant: rows of any form, and the block estimator.

use super::command::Change;
use super::estimate_message::{fill_derived, message};
use super::learner::{BlockEnd, Learner, Learnt};
use super::misfit;
use crate::estimator::{
    BlockEstimator, ChangeKind, EstimatorOptions, EstimatorState, Held, Report, StateError, StateMachine,
};
use crate::messages::{ErrorCode, Estimate, LastError, Sample, Status, estimate_flags};
use crate::model::{DerivedValues, MAX_PARAMS};
use crate::rows::{FirstBlocks, SampleBlock};
use std::any::Any;

/// Standard deviation, relative to that of the start, below which the data have informed on a
/// parameter.
const INFORMED: f64 = 0.5;
/// Passes over the first blocks as one, each with weights by the θ̂ of the pass before. After a
/// single one, θ₅ of an arm with encoders of 13 bits was off by 8 to 14 times its Cramér–Rao bound
/// for as long as the run (`tests/numerics/whole_runs.rs`).
const PASSES: usize = 4;

/// Rows, estimator, state machine and derived values.
pub struct BlockLearner<B> {
    rows: B,
    estimator: BlockEstimator,
    judge: StateMachine,
    derived: Option<Box<dyn DerivedValues + Send>>,
    first: FirstBlocks,
}

impl<B: SampleBlock + Send + 'static> BlockLearner<B> {
    /// A learner without data; `derived` values are added to its estimates.
    pub fn new(rows: B, estimator: BlockEstimator, derived: Option<Box<dyn DerivedValues + Send>>) -> Self {
        Self {
            judge: StateMachine::new(estimator.theta()),
            first: rows.first_blocks(),
            rows,
            estimator,
            derived,
        }
    }

    /// The estimator, for its evidence beyond the message.
    pub fn estimator(&self) -> &BlockEstimator {
        &self.estimator
    }

    /// True if the blocks so far have informed on some parameter.
    fn is_informed(&self) -> bool {
        let (report, options) = (self.estimator.report(), self.estimator.options());
        let mut pairs = report.theta_std.iter().zip(&options.parameters);
        pairs.any(|(std, prior)| !prior.fixed && *std < INFORMED * prior.std)
    }

    /// Learns from the first blocks again as one block, whose first pass finds the θ of its weights
    /// by itself.
    fn learn_again(&mut self) {
        self.rows.reset();
        self.rows.forget_theta();
        for k in 0..self.first.len() {
            for (t_ns, sample) in self.first.block(k) {
                // there is room for all of them
                let _ = self.rows.push(t_ns, &sample);
            }
        }
        self.rows.enable_scale_columns(false);
        for _ in 0..PASSES {
            self.rows.prepare(self.estimator.theta());
            self.estimator.begin_again();
            self.estimator.update(&self.rows);
            self.rows.know_theta();
        }
        self.first.end();
    }
}

impl<B: SampleBlock + Send + 'static> Learner for BlockLearner<B> {
    fn take(&mut self, sample: &Sample) -> bool {
        let joints = sample.joint_sample();
        self.first.push(sample.t_ns, &joints);
        // Rows have capacity for N samples, and a block has no more.
        self.rows.push(sample.t_ns, &joints)
    }

    fn enter_stream(&mut self, stream_id: u64) {
        self.estimator.enter_stream(stream_id);
    }

    fn drop_block(&mut self) {
        self.first.drop_block();
        self.rows.clear();
    }

    fn restart_rows(&mut self) {
        if self.first.is_empty() {
            self.first.drop_block();
        } else {
            self.first.end();
        }
        self.rows.reset();
    }

    fn learn(&mut self, end: &BlockEnd) -> Learnt {
        self.rows.enable_scale_columns(self.estimator.inquires());
        self.rows.prepare(self.estimator.theta());
        self.estimator.update(&self.rows);
        let replaced = self.rows.replaced();
        if self.estimator.report().change.is_some() {
            // one θ does not describe these blocks
            self.first.end();
        }
        if self.first.close_block(self.is_informed()) {
            self.learn_again();
        }
        let report = self.estimator.report();
        let spiky = f64::from(replaced) / (2 * end.joints.max(1)) as f64 / end.len as f64;
        let mut estimate = message(report, self.judge.step(report, end.lost.max(spiky)));
        estimate.outliers = estimate.outliers.saturating_add(replaced);
        let change = report
            .change
            .filter(|change| change.kind != ChangeKind::Drift && !change.is_late);
        if change.is_some() {
            estimate.flags |= estimate_flags::CHANGED;
        }
        let error = if report.held == Some(Held::NotFinite) {
            Some(LastError::new(ErrorCode::NotEvaluable, end.last_seq))
        } else {
            let fault = report.fault.and_then(|cause| {
                let suspect = self.rows.suspect(cause.error.suspect)?;
                let possible = suspect.is_possible(cause.error.amplitude);
                possible.then(|| misfit::fault(&suspect, &cause, end.last_seq))
            });
            let lacking = fault.or_else(|| {
                let suspicion = report.suspicion?;
                let suspect = self.rows.suspect(suspicion.suspect)?;
                let possible = suspect.is_possible_from_the_start(suspicion.amplitude);
                possible.then(|| misfit::error(&suspect, &suspicion, end.last_seq))
            });
            lacking.or_else(|| {
                let (parameter, error) = report.limited?;
                let drift = self.rows.suspect_rows().count() + parameter;
                let name = self.rows.suspect(drift)?.parameter?;
                Some(misfit::limit(name, &self.rows.suspect(error)?, end.last_seq))
            })
        };
        self.rows.clear();
        Learnt {
            estimate,
            change_ns: change.map(|change| change.time),
            error,
        }
    }

    fn derive(&self, estimate: &mut Estimate) {
        if let Some(derived) = &self.derived {
            fill_derived(estimate, derived.as_ref(), &self.estimator);
        }
    }

    fn report(&self) -> &Report {
        self.estimator.report()
    }

    fn describe(&self, status: &mut Status) {
        status.condition = self.estimator.report().condition;
        (status.information_ln, status.asymmetry) = self.estimator.information_figures();
    }

    fn window_s(&self) -> Option<f64> {
        self.rows.window_s()
    }

    fn held_at(&self, index: usize) -> Option<f64> {
        self.estimator.options().parameters[index]
            .fixed
            .then(|| self.estimator.report().theta[index])
    }

    fn fix(&mut self, index: usize, value: Option<f64>) {
        let value = value.unwrap_or(self.estimator.report().theta[index]);
        self.estimator.fix(index, Some(value));
    }

    fn free(&mut self, index: usize) {
        // The information on a parameter that is already free must not be dropped.
        if self.estimator.options().parameters[index].fixed {
            self.estimator.fix(index, None);
        }
    }

    fn accepts(&self, change: &Change) -> bool {
        match change {
            Change::Tune { rows: Some(rows), .. } => rows.is::<B>(),
            Change::Restart { .. } | Change::Payload { .. } => false,
            _ => true,
        }
    }

    fn begin_anew(&mut self, change: &mut Change) -> Result<bool, StateError> {
        let Change::Replace { estimator, judge, warm } = change else {
            return Ok(false);
        };
        std::mem::swap(&mut self.estimator, estimator);
        std::mem::swap(&mut self.judge, judge);
        self.rows.reset();
        if *warm {
            self.first.end();
        } else {
            self.rows.forget_theta();
            self.first.restart();
        }
        Ok(*warm)
    }

    fn tune(&mut self, options: &mut EstimatorOptions, rows: Option<&mut Box<dyn Any + Send>>) -> bool {
        self.estimator.exchange_tunables(options);
        self.first.end();
        match rows.and_then(|rows| rows.downcast_mut::<B>()) {
            Some(rows) => {
                std::mem::swap(&mut self.rows, rows);
                true
            }
            None => false,
        }
    }

    fn save(&mut self, into: &mut EstimatorState) -> u64 {
        self.estimator.save(&mut self.judge, into);
        self.estimator.report().blocks
    }

    fn load(&mut self, state: &EstimatorState) -> Result<(), StateError> {
        self.first.end();
        self.estimator.load(&mut self.judge, state)
    }

    fn load_kept(&mut self, state: &EstimatorState) -> Result<(), StateError> {
        let params = self.estimator.structure().params;
        let mut held = [None; MAX_PARAMS];
        for (i, held) in held.iter_mut().enumerate().take(params) {
            *held = self.held_at(i);
        }
        let loaded = self.load(state);
        for (i, held) in held.into_iter().enumerate().take(params) {
            if held != self.held_at(i) {
                self.estimator.fix(i, held);
            }
        }
        loaded
    }

    fn into_rows(self: Box<Self>) -> Box<dyn Any + Send> {
        Box::new(self.rows)
    }
}
