//! What a block adds to the inquiry into the last change, see `inquiry.rs`.

use super::group::GroupState;
use super::groups::Groups;
use super::inquiry::BlockSums;
use super::options::EstimatorOptions;
use super::pass::Summable;
use std::ops::Range;

/// χ² per row beyond which a block is left out: its rows were smoothed with an estimate that was
/// still on its way.
const ROUGH: f64 = 1.4;

impl Groups {
    /// Adds the rows of `range` to what is asked about the last change, see `inquiry.rs`; not those
    /// of groups that follow a line, nor rows of a block that does not `fit`. `theta` holds all
    /// parameters, and is room afterwards.
    pub fn inquire(
        &mut self,
        rows: &dyn Summable,
        (range, lines, fit): (Range<usize>, u64, &[f64]),
        theta: &mut [f64],
        options: &EstimatorOptions,
    ) {
        let mut another = false;
        for (k, group) in self.iter_mut().enumerate() {
            if lines >> k & 1 == 0 && group.equations.iter().all(|e| fit[e.index] < ROUGH) {
                another |= group.add_to_inquiry(rows, range.clone(), theta, options);
            }
        }
        if another {
            self.iter_mut().for_each(|group| group.inquiry.clear());
        }
    }
}

impl GroupState {
    /// The plant may have changed from θ̄ of this block, which is known as was published last.
    pub fn inquire(&mut self) {
        self.inquiry.begin(&self.centre, &self.confirmation.covariance);
    }

    /// Adds the rows of `range` to the inquiry, if there is one. `theta` holds all parameters, and
    /// those of the group are θ₀ of the inquiry afterwards. True if the plant has changed.
    pub fn add_to_inquiry(
        &mut self,
        rows: &dyn Summable,
        range: Range<usize>,
        theta: &mut [f64],
        options: &EstimatorOptions,
    ) -> bool {
        if !self.inquiry.is_open() {
            return false;
        }
        theta[self.parameters.clone()].copy_from_slice(self.inquiry.reference());
        if !self.try_at(rows, range.clone(), theta) {
            return false;
        }
        self.suspect(rows, range, theta);
        let block = BlockSums {
            equations: &self.equations,
            sums: &self.trial,
            columns: self.considered.sums(),
            variance: self.variance(),
        };
        self.inquiry.take(rows, &block, options.forgetting_factor);
        let settled = self.confirmation.is_settled();
        self.inquiry.judge(&self.room.scale, &self.fixed, settled)
    }
}
