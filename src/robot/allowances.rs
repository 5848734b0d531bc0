//! Errors of the estimates for which their standard deviations allow, beyond P.

use super::block_scatter_room::BlockScatter;
use super::friction_drift::FrictionDrift;
use super::identify_options::IdentifyOptions;
use super::learning::{Arm, Beyond, Learner};
use super::left_out_room::{LeftOut, LeftOutCause, Priors};
use super::recent_blocks::RecentBlocks;
use super::state::RobotSample;
use super::torque_counts::TorqueCounts;
use crate::estimator::persist::Visit;

/// What may be wrong with the estimates although it is not noise.
#[derive(Debug, Clone)]
pub(super) struct Allowances {
    /// `None` if the model leaves nothing out.
    left_out: Option<LeftOut>,
    scatter: BlockScatter,
    drift: FrictionDrift,
    counts: TorqueCounts,
}

impl Allowances {
    /// For an arm and what its parameters leave out.
    pub fn new(arm: &Arm, beyond: &Beyond, options: &IdentifyOptions) -> Self {
        let friction = arm.model.parameters().len();
        let Beyond { terms, n, acting, .. } = beyond;
        let priors = Priors::new(options);
        let (empty, blocks) = (arm.empty_sums(), RecentBlocks::CAPACITY);
        Self {
            left_out: (!terms.is_empty()).then(|| LeftOut::new(terms.clone(), priors, *n, *acting)),
            scatter: BlockScatter::new(arm.parameters.len(), *n, *acting, blocks, &empty),
            drift: FrictionDrift::new(friction),
            counts: TorqueCounts::new(friction),
        }
    }

    /// Forgets everything.
    pub fn reset(&mut self) {
        self.left_out.iter_mut().for_each(LeftOut::reset);
        self.scatter.reset();
        self.drift.reset();
        self.counts.reset();
    }

    /// Forgets the errors of another estimate, after parameters were fixed or freed.
    pub fn forget_shifts(&mut self) {
        self.left_out.iter_mut().for_each(LeftOut::forget_shifts);
    }

    /// Keeps the scatter for blocks of another machine.
    pub fn carry_over(&mut self) {
        self.scatter.carry_over();
    }

    /// The missing term that makes estimates wrong, if the residuals show one.
    pub fn left_out_cause(&self) -> Option<LeftOutCause> {
        self.left_out.as_ref()?.found
    }

    /// Adds a sample.
    pub fn take(&mut self, sample: &RobotSample, learner: &Learner) {
        self.counts
            .take(&learner.arm.model, sample, learner.options.windows.length_s);
    }

    /// Renews what the misfit of the blocks shows.
    pub fn look_at_misfit(&mut self, learner: &Learner) {
        if let Some(left_out) = &mut self.left_out {
            left_out.look_at_block(learner);
        }
        self.scatter.look_at_block(learner);
    }

    /// Renews what the drift of friction, and the resolution of the torques, show.
    pub fn look_at_friction(&mut self, learner: &Learner) {
        self.drift.reset();
        for joint in 0..learner.arm.joints() {
            let model = &learner.arm.model;
            let own = || (model.friction_columns(joint), model.friction_of(joint));
            if learner.friction.is_on() {
                let last = learner.recent.newest_first().map(|block| &block[joint]);
                let effective = learner.estimate.effective();
                self.drift.look_at(last, own(), effective, learner.levels.level(joint));
            }
            let blocks = learner.recent.iter().map(|block| &block[joint]);
            let size = |i: usize| learner.arm.parameters[i].scale;
            self.counts.look_at(joint, blocks, own(), size);
        }
    }

    /// Covariance of two estimates.
    pub fn covariance(&self, learner: &Learner, i: usize, j: usize) -> f64 {
        let estimate = &learner.estimate;
        let drift = match i == j && !estimate.fixed()[i] {
            true => self.drift.variance(i) + learner.past.drift_variance(i) + self.counts.variance(i),
            false => 0.0,
        };
        let bias = estimate.bias()[i] * estimate.bias()[j]; // (2) of acceleration_noise.rs
        let scatter = &self.scatter.factor;
        let own = estimate.row(i)[j] * scatter[i] * scatter[j]; // (4) of block_scatter.rs
        let left_out = self.left_out.as_ref();
        own + drift + bias + left_out.map_or(0.0, |left_out| left_out.covariance(i, j, estimate.n()))
    }

    /// Standard deviation of an estimate.
    pub fn std(&self, learner: &Learner, i: usize) -> f64 {
        self.covariance(learner, i, i).max(0.0).sqrt()
    }

    /// Standard deviation of a sum of these parameters with these factors, without drifts.
    pub fn std_along(&self, learner: &Learner, columns: &[usize], factors: &[f64]) -> f64 {
        let estimate = &learner.estimate;
        let mut variance = 0.0;
        for (x, &i) in factors.iter().zip(columns).filter(|(x, _)| **x != 0.0) {
            let row = estimate.row(i);
            variance += x * columns.iter().zip(factors).map(|(&k, y)| row[k] * y).sum::<f64>();
        }
        let along = |shift: &[f64]| -> f64 { columns.iter().zip(factors).map(|(&k, y)| shift[k] * y).sum() };
        variance += along(estimate.bias()).powi(2);
        let shifts = self.left_out.iter().flat_map(|left_out| left_out.errors(estimate.n()));
        variance += shifts.map(|shift| along(shift).powi(2)).sum::<f64>();
        variance.max(0.0).sqrt()
    }

    /// State kept in a checkpoint.
    pub fn visit(&mut self, v: &mut impl Visit) {
        self.scatter.visit(v);
    }
}
