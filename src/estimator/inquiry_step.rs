//! Adds a block to the inquiry into the last change, see `cause_search.rs`.

use super::group::GroupState;
use super::groups::Groups;
use super::index_set::IndexSet;
use super::inquiry::BlockSums;
use super::options::EstimatorOptions;
use super::pass::Summable;
use std::ops::Range;

/// χ² per row, relative to that before the change, above which a block is left out because no
/// hypothesis explains its rows yet.
const ROUGH: f64 = 1.4;
/// Noise variances by which the innovation may exceed the residual, in addition to twice the excess
/// before the change. Rows are smoothed with the estimate before the block and agree with it, so an
/// estimate that is still converging would be confirmed.
const MOVED: f64 = 1.0;

impl Groups {
    /// Adds the rows of `range` to the inquiry into the last change, see `cause_search.rs`, unless
    /// the block does not `fit`. `theta` holds all parameters; it is used as workspace.
    pub fn inquire(
        &mut self,
        rows: &dyn Summable,
        (range, fit): (Range<usize>, &[f64]),
        theta: &mut [f64],
        options: &EstimatorOptions,
    ) {
        let Self { states, cause_search } = self;
        if !cause_search.counts(states) {
            return;
        }
        let (mut added, mut on_its_way) = (false, IndexSet::EMPTY);
        for (k, group) in states.iter_mut().enumerate() {
            if group.is_on_its_way(fit) {
                on_its_way.insert(k);
            } else {
                added |= group.add_to_inquiry(rows, range.clone(), theta, options);
            }
        }
        cause_search.judge(states, added, on_its_way);
    }
}

impl GroupState {
    /// Begins the inquiry: the plant may have changed from θ̄ of this block, whose covariance is
    /// the one published last.
    pub fn begin_inquiry(&mut self) {
        for i in 0..self.n {
            self.room.scale[i] = self.sizes.of(i, self.prior.centre()[i]);
        }
        // considered errors have not changed
        self.widened
            .unconfirmed(self.errors.total(), &self.confirmation.covariance, &mut self.room.a);
        self.inquiry.begin(
            self.prior.centre(),
            &self.room.a,
            &self.room.scale,
            self.equations.usual(),
        );
    }

    /// True if the estimate was before the block, or is now, so far off that the rows are no
    /// evidence about the change.
    fn is_on_its_way(&self, fit: &[f64]) -> bool {
        let [level, surprise] = self.inquiry.usual();
        self.equations
            .pairs()
            .any(|(e, sums)| fit[e.index] >= ROUGH * level || e.excess(sums) > MOVED + 2.0 * surprise)
    }

    /// Adds the rows of `range` to the inquiry, if there is one. `theta` holds all parameters;
    /// afterwards those of the group are θ₀ of the inquiry. True if rows were added.
    fn add_to_inquiry(
        &mut self,
        rows: &dyn Summable,
        range: Range<usize>,
        theta: &mut [f64],
        options: &EstimatorOptions,
    ) -> bool {
        if !self.inquiry.is_open() {
            return false;
        }
        let own = &mut theta[self.parameters.clone()];
        self.inquiry.look_at(own, self.errors.total());
        own.copy_from_slice(self.inquiry.reference());
        if !self.equations.evaluate_trial(rows, range.clone(), theta) {
            return false;
        }
        self.suspect(rows, range, theta);
        let block = BlockSums {
            parameters: self.parameters.clone(),
            equations: self.equations.states(),
            sums: self.equations.trial(),
            columns: self.considered.sums(),
            variance: self.equations.variance(),
        };
        self.inquiry.take(rows, &block, options.forgetting_factor);
        true
    }
}
