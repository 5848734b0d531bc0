//! What a block adds to the inquiry into the last change, see `inquest.rs`.

use super::group::GroupState;
use super::groups::Groups;
use super::inquiry::BlockSums;
use super::options::EstimatorOptions;
use super::pass::Summable;
use std::ops::Range;

/// χ² per row, beside that before the change, beyond which a block is left out: nothing explains
/// its rows yet.
const ROUGH: f64 = 1.4;
/// Noise variances by which the innovation may exceed the residual, beside twice what it did before
/// the change. Rows are smoothed with the estimate before the block, and agree with it: one that is
/// still on its way would be confirmed.
const MOVED: f64 = 1.0;

impl Groups {
    /// Adds the rows of `range` to what is asked about the last change, see `inquest.rs`; not those
    /// of a block that does not `fit`. `theta` holds all parameters, and is room afterwards.
    pub fn inquire(
        &mut self,
        rows: &dyn Summable,
        (range, fit): (Range<usize>, &[f64]),
        theta: &mut [f64],
        options: &EstimatorOptions,
    ) {
        let Self { states, inquest } = self;
        if !inquest.counts(states) {
            return;
        }
        let (mut added, mut on_its_way) = (false, 0);
        for (k, group) in states.iter_mut().enumerate() {
            if group.is_on_its_way(fit) {
                on_its_way |= 1 << k;
            } else {
                added |= group.add_to_inquiry(rows, range.clone(), theta, options);
            }
        }
        inquest.judge(states, added, on_its_way);
    }
}

impl GroupState {
    /// The plant may have changed from θ̄ of this block, which is known as was published last.
    pub fn begin_inquiry(&mut self) {
        for i in 0..self.n {
            let size = self.centre[i].abs().max(self.start_std[i]);
            self.room.scale[i] = if size > 0.0 { size } else { 1.0 };
        }
        let levels = self.equations.iter().filter(|e| e.floor > 0.0);
        let level = levels.map(|e| e.variance / (e.floor * e.floor)).fold(1.0, f64::max);
        let surprise = self.equations.iter().map(|e| e.surprise).fold(0.0, f64::max);
        // without what considered errors may do: they have not changed
        let published = self.confirmation.covariance.iter().zip(&self.honest);
        let known = self.room.a.iter_mut().zip(&self.errors.total);
        known
            .zip(published)
            .for_each(|((a, own), (open, honest))| *a = own + open - honest);
        self.inquiry
            .begin(&self.centre, &self.room.a, &self.room.scale, [level, surprise]);
    }

    /// True if the estimate was so far off before the block, or is so now, that its rows tell
    /// nothing of the change.
    fn is_on_its_way(&self, fit: &[f64]) -> bool {
        let [level, surprise] = self.inquiry.usual();
        let equations = self.equations.iter().zip(&self.at);
        equations
            .into_iter()
            .any(|(e, sums)| fit[e.index] >= ROUGH * level || e.excess(sums) > MOVED + 2.0 * surprise)
    }

    /// Adds the rows of `range` to the inquiry, if there is one. `theta` holds all parameters, and
    /// those of the group are θ₀ of the inquiry afterwards. True if there are more rows now.
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
        self.inquiry.look_at(own, &self.errors.total);
        own.copy_from_slice(self.inquiry.reference());
        if !self.try_at(rows, range.clone(), theta) {
            return false;
        }
        self.suspect(rows, range, theta);
        let block = BlockSums {
            parameters: self.parameters.clone(),
            equations: &self.equations,
            sums: &self.trial,
            columns: self.considered.sums(),
            variance: self.variance(),
        };
        self.inquiry.take(rows, &block, options.forgetting_factor);
        true
    }
}
